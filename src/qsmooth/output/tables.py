"""Tables of a mesh's quality: one mesh, before and after, several methods side by side."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from qsmooth._words import capitalised, in_a_row, plural
from qsmooth.inspection import Finding, Inspection
from qsmooth.metrics import METRICS, Quality, Summary, Validity
from qsmooth.metrics.summary import (
    SummaryRow,
    definitions,
    figure_sections,
    histogram_sections,
    size_text,
    summary_rows,
    summary_table,
)
from qsmooth.table import BEST, LONGEST_BAR, Row, Section, Table, best_columns, time_text

if TYPE_CHECKING:
    from qsmooth.result import SmoothResult

# Where room is short bars have so many characters at least.
LEAST_BAR = 4

__all__ = [
    "change_table",
    "comparison_tables",
    "inspection_table",
    "method_title",
    "place_text",
    "size_text",
    "summary_table",
    "verdict",
    "worst_table",
]


def change_table(before: Summary, after: Summary, *, width: int | None = None) -> Table:
    """Before and after, side by side, and in words what became of it.

    Bars are shorter where a line of `width` characters asks for that.
    """

    def changed(row: SummaryRow) -> str:
        old, new = row.value(before), row.value(after)
        if row.text(old) == row.text(new):
            return "same"
        word = "better" if (new > old) == row.higher_is_better else "worse"
        if math.isnan(new) or math.isnan(old):
            return ""
        if not math.isfinite(new - old):
            return word
        return f"{word} by {row.text(abs(new - old))}"

    sections = [
        Section(
            title,
            tuple(
                Row(f.label, (f.text(f.value(before)), f.text(f.value(after)), changed(f)))
                for f in figures
            ),
        )
        for title, figures in summary_rows([before, after])
    ]

    def with_bars(length: int) -> Table:
        bars = tuple(
            Section(s.title, tuple(Row(r.label, (*r.cells, "")) for r in s.rows))
            for s in histogram_sections([before, after], length)
        )
        return Table(("Before", "After", "Change"), (*sections, *bars), definitions(before))

    table = with_bars(LONGEST_BAR)
    beyond = 0 if width is None else max(_room(table) - width, 0)
    return with_bars(max(LEAST_BAR, LONGEST_BAR - math.ceil(beyond / 2))) if beyond else table


def comparison_tables(
    before: Summary,
    results: Sequence[SmoothResult],
    *,
    width: int | None = None,
    histograms: bool = False,
) -> list[Table]:
    """Put the original beside each method's result; the best of each figure is marked.

    Parameters
    ----------
    before, results
        Quality of the original mesh, and what the methods made of it.
    width
        Characters in a line. Where a column for each method does not fit, each is a row, and each
        section a table. None: a column for each, as wide as it gets.
    histograms
        Whether to add the histograms.

    Returns
    -------
    list of Table
        Marks compare all methods.
    """
    summaries = [before, *(r.after for r in results)]
    names = ("Original", *(method_title(r.method) for r in results))
    sections = (*figure_sections(summaries, mark=True), _effort(results))
    whole = Table(names, sections)
    note = f"{BEST} best, the original included. {definitions(before)}"
    if width is None or _room(whole) <= width:
        shown = histogram_sections(summaries, LONGEST_BAR, marked=True) if histograms else []
        whole = replace(whole, sections=(*sections, *shown))
        if width is None or _room(whole) <= width:
            return [replace(whole, note=note.replace("best,", "best of the row,"))]
    head, *others = figure_sections(summaries, mark=True)
    tables = [_turned(section, names) for section in (head, *others[:-1])]
    validity = Section("Effort", others[-1].rows + _effort(results).rows, True)
    tables.append(_turned(validity, names))
    tables = [part for table in tables for part in table.narrowed(width)]
    if histograms:
        bars = Table(names, tuple(histogram_sections(summaries, 4, marked=True)))
        tables += bars.narrowed(width, kept=1)
    tables[-1] = replace(tables[-1], note=note)
    return tables


def verdict(before: Summary, results: Sequence[SmoothResult], skipped: Sequence[str] = ()) -> str:
    """Say in a line which method is best or equal in how many figures of quality.

    Whoever leaves fewer cells invalid comes first; the original counts among the rivals.
    """
    summaries = [before, *(r.after for r in results)]
    counts, total = [0] * len(summaries), 0
    for _, rows in summary_rows(summaries):
        for row in rows:
            values = [row.value(s) for s in summaries]
            known = [v for v in values if not math.isnan(v)]
            if not known or row.label.startswith(" "):
                continue
            best = row.text(max(known) if row.higher_is_better else min(known))
            total += 1
            for k, value in enumerate(values):
                counts[k] += row.text(value) == best
    ranks = [(-s.n_invalid, n) for s, n in zip(summaries, counts, strict=True)][1:]
    first = [r for r, rank in zip(results, ranks, strict=True) if rank == max(ranks)]
    names = in_a_row([r.method for r in first])
    text = f"{names}: best or equal in {max(ranks)[1]} of {total} figures"
    if all(r.outcome.unchanged for r in results):
        text = f"no method changed the mesh: equal in all {total} figures"
    left = [f"{r.method} {r.after.n_invalid}" for r in results if r.after.n_invalid]
    if left:
        text += f"; cells left invalid: {', '.join(left)}"
    return text + (f"; skipped: {', '.join(skipped)}" if skipped else "")


def _effort(results: Sequence[SmoothResult]) -> Section:
    seconds = [r.seconds for r in results]
    quickest = best_columns(seconds, [time_text(s) for s in seconds], higher_is_better=False)
    times = Row(
        "Time of the sweeps", ("", *map(time_text, seconds)), frozenset(k + 1 for k in quickest)
    )
    sweeps = Row("Sweeps", ("", *(str(r.sweeps) for r in results)))
    stopped = Row("Stopped by itself", ("", *("yes" if r.converged else "no" for r in results)))
    return Section("Effort", (times, sweeps, stopped), marked=True)


def _turned(section: Section, names: Sequence[str]) -> Table:
    """Make a table of a section, with its rows as columns."""
    rows = tuple(
        Row(
            name,
            tuple(row.cells[k] for row in section.rows),
            frozenset(n for n, row in enumerate(section.rows) if k in row.best),
        )
        for k, name in enumerate(names)
    )
    heads = tuple(
        row.label.removeprefix("Mean of ").strip().capitalize().replace("jacobian", "Jacobian")
        for row in section.rows
    )
    return Table(
        heads,
        (Section("", rows, section.marked),),
        corner=section.title.removesuffix(" of all cells"),
    )


def _room(table: Table) -> int:
    """Characters that a table takes on a terminal, which indents rows and pads columns."""
    return table.natural_width + len(table.columns) + 3


def worst_table(
    quality: Quality, k: int, by: str, metrics: str | Sequence[str] | None = None
) -> Table:
    """List the worst cells with their places and metrics, by default those of the short list."""
    worst = quality.worst(k, by, metrics)
    validity = quality.validity[worst.cells]
    centres = worst.centres
    if centres.shape[1] == 3 and len(centres) and np.ptp(centres[:, 2]) == 0.0:
        centres = centres[:, :2]  # a level mesh, most likely
    axes = "xyz"[: centres.shape[1]]
    extent = float(np.ptp(quality.points, axis=0).max())
    shown = [METRICS[name] for name in worst.values]
    rows = tuple(
        Row(
            str(cell),
            (
                *(place_text(float(value), extent) for value in centres[n]),
                *(metric.text(float(worst.values[metric.name][n])) for metric in shown),
                Validity(int(validity[n])).name.lower(),
            ),
        )
        for n, cell in enumerate(worst.cells)
    )
    heads = [*(f"Centre {axis}" for axis in axes), *(metric.title for metric in shown)]
    words = METRICS[by].words
    title = f"The {plural(len(rows), 'worst cell')} by {words} (cells count from 0)"
    return Table((*heads, "State"), (Section("", rows),), title=title, corner="Cell")


def inspection_table(facts: Inspection, n_ids: int) -> Table:
    """Lay out what a mesh consists of and what is odd, with the first `n_ids` ids of each."""
    vertices = str(facts.n_vertices)
    if facts.n_fixed or facts.n_interface:
        vertices += f", {facts.n_fixed} of them fixed (on the boundary, by choice or in no cell)"
    if facts.n_interface:
        vertices += f", {facts.n_interface} on lines between regions or line cells"
    box = " by ".join(f"{high - low:.6g}" for low, high in zip(facts.low, facts.high, strict=True))
    corner = ", ".join(f"{low:.6g}" for low in facts.low)
    regions = "none given"
    if facts.regions:
        shown = list(facts.regions.items())[: max(n_ids, 1)]
        regions = f"{len(facts.regions)}: " + ", ".join(
            f"region {region} with {plural(count, 'cell')}" for region, count in shown
        )
        if len(facts.regions) > len(shown):
            regions += ", ..."
    rows = [
        Row("Quads", (str(facts.n_quads),)),
        Row("Triangles", (str(facts.n_triangles),)),
        Row("Line cells", (str(facts.n_lines),)),
        Row("Vertices", (vertices,)),
        Row("Edges", (f"{facts.n_edges}, {facts.n_boundary_edges} of them on the boundary",)),
        Row("Boundary loops", (str(facts.n_boundary_loops),)),
        Row("Parts", (f"{facts.n_parts}, each connected by edges",)),
        Row("Orientation", (facts.orientation,)),
        Row("Regions", (regions,)),
        Row("Extent", (f"{box}, from {corner}",)),
        Row("Plane", (facts.plane,)),
    ]
    if facts.format:
        rows.insert(0, Row("Format", (facts.format,)))
    rows += [Row("In the file", (note,)) for note in facts.notes]
    odd = tuple(
        Row(
            capitalised(f.name),
            (f"{f.count}, {f.meaning}{_first_ids(f, n_ids)}" if f.count else "none",),
        )
        for f in facts.findings
    )
    sections = (Section("The mesh", tuple(rows)), Section("Odd in it", odd))
    return Table(("",), sections, "Vertices and cells count from 0.", left=True)


def _first_ids(finding: Finding, n_ids: int) -> str:
    if not n_ids:
        return ""
    items = [
        "-".join(map(str, item)) if isinstance(item, tuple) else str(item)
        for item in finding.items[:n_ids]
    ]
    more = ", ..." if len(finding.items) > n_ids else ""
    what = "cells" if finding.kind == "cell" else "vertices"
    return f": {what} {', '.join(items)}{more}"


def method_title(name: str) -> str:
    """Write a method's name as a title."""
    from qsmooth.registry import all_methods

    known = all_methods()
    return known[name].title if name in known else name.capitalize()


def place_text(value: float, extent: float) -> str:
    """Write a coordinate to a millionth of the mesh's extent."""
    decimals = 5 - math.floor(math.log10(extent)) if extent > 0.0 else 99
    return f"{value:.{max(decimals, 0)}f}" if -4 < decimals < 12 else f"{value:.8g}"
