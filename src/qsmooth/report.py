"""Tables of a mesh's quality: one mesh, before and after, several methods side by side."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from qsmooth._words import plural
from qsmooth.metrics import HIGHER_IS_BETTER, Histogram, Quality, Summary, Validity

if TYPE_CHECKING:
    from rich.table import Table as RichTable

    from qsmooth.inspection import Finding, Inspection
    from qsmooth.result import SmoothResult

# Metrics in words, as they stand in a sentence.
METRIC_WORDS = {
    "min_angle": "smallest angle",
    "max_angle": "largest angle",
    "aspect_ratio": "aspect ratio",
    "scaled_jacobian": "scaled Jacobian",
    "shape": "shape",
}
WORST_WORDS = {
    "min_angle": "Smallest angle",
    "max_angle": "Largest angle",
    "aspect_ratio": "Largest aspect ratio",
    "scaled_jacobian": "Smallest scaled Jacobian",
    "shape": "Smallest shape",
}
MEAN_WORDS = {
    "min_angle": "Mean of smallest angles",
    "max_angle": "Mean of largest angles",
    "aspect_ratio": "Mean of aspect ratios",
    "scaled_jacobian": "Mean of scaled Jacobians",
    "shape": "Mean of shapes",
}
SIZE_WORDS = "Size ratio of neighbours"
HISTOGRAM_WORDS = {
    "max_angle": "Cells by largest angle",
    "min_angle": "Cells by smallest angle",
    "aspect_ratio": "Cells by aspect ratio",
}
DEFINITIONS = (
    "Aspect ratio: longest over shortest edge of a cell. Scaled Jacobian: sine of a cell's worst "
    "corner (in triangles over that of 60°). Shape: mean ratio of its worst corner. Size ratio of "
    "neighbours: largest ratio of a cell's area to that of a cell next to it (each over that of "
    "the ideal cell), geometric mean. Ideal: 1."
)
BEST = "*"
LONGEST_BAR = 12
NOTE_WIDTH = 100
# Eighths of a character cell, from one to seven, then a full one.
EIGHTHS = "▏▎▍▌▋▊▉█"
# For terminals whose encoding lacks these.
PLAIN = str.maketrans(
    {**dict.fromkeys("▍▌▋▊▉█", "#"), "▏": ".", "▎": ".", "°": "d", "−": "-", "×": "x"}
)


@dataclass(frozen=True)
class Row:
    """One line of a table.

    Attributes
    ----------
    label, cells
        What it says, and its value in each column.
    best
        Columns that hold the best value.
    """

    label: str
    cells: tuple[str, ...]
    best: frozenset[int] = frozenset()


@dataclass(frozen=True)
class Section:
    """A heading and the rows under it; `marked` where its rows may have a best value."""

    title: str
    rows: tuple[Row, ...]
    marked: bool = False


@dataclass(frozen=True)
class Table:
    """Rows in sections under named columns; prints as plain text, and in colour with rich."""

    columns: tuple[str, ...]
    sections: tuple[Section, ...]
    note: str = ""
    left: bool = False  # texts, not numbers: aligned left
    title: str = ""
    corner: str = ""  # name of the first column

    def __str__(self) -> str:
        heads = (self.corner, *self.columns)
        lines = [
            (row.label, *self._marked(section, row))
            for section in self.sections
            for row in section.rows
        ]
        widths = [max(map(len, column)) for column in zip(heads, *lines, strict=True)]

        def line(cells: Sequence[str]) -> str:
            padded = [cells[0].ljust(widths[0])]
            pad = str.ljust if self.left else str.rjust
            padded += [pad(c, w) for c, w in zip(cells[1:], widths[1:], strict=True)]
            return "  ".join(padded).rstrip()

        rule = sum(widths) + 2 * (len(widths) - 1)
        out = [self.title, ""] if self.title else []
        out += [line(heads)] if any(self.columns) else []
        for section in self.sections:
            out += ["", section.title, "-" * rule] if section.title else ["-" * rule]
            out += [line((row.label, *self._marked(section, row))) for row in section.rows]
        if self.note:
            out += ["", *textwrap.wrap(self.note, NOTE_WIDTH)]
        return "\n".join(out).lstrip("\n")

    def _marked(self, section: Section, row: Row) -> list[str]:
        if not section.marked:
            return list(row.cells)
        return [f"{c} {BEST if k in row.best else ' '}" for k, c in enumerate(row.cells)]

    def __rich__(self) -> RichTable:
        from rich import box
        from rich.table import Table as RichTable
        from rich.text import Text

        table = RichTable(
            box=box.SIMPLE_HEAD,
            caption=self.note or None,
            caption_justify="left",
            collapse_padding=True,
            pad_edge=False,
        )
        if self.title:
            table.title, table.title_justify = Text(self.title, style="bold"), "left"
        table.show_header = any(self.columns)
        table.add_column(self.corner, no_wrap=True, header_style="bold")
        for k, name in enumerate(self.columns):
            values = [
                self._marked(section, row)[k] for section in self.sections for row in section.rows
            ]
            table.add_column(
                name,
                justify="left" if self.left else "right",
                # Where room is short names are broken, and texts, but no number and no word.
                min_width=0 if self.left else max(map(len, [*values, *name.split()]), default=0),
                overflow="fold",
                header_style="bold",
            )
        for n, section in enumerate(self.sections):
            if section.title:
                if n:
                    table.add_row()
                table.add_row(Text(section.title, style="bold cyan"))
            for row in section.rows:
                cells = [
                    Text(text, style="bold green" if k in row.best else "")
                    for k, text in enumerate(self._marked(section, row))
                ]
                table.add_row(("  " if section.title else "") + row.label, *cells)
        return table


def summary_text(summary: Summary) -> str:
    """Lay out a summary as plain text: extremes, means, validity, histograms with bars."""
    return f"{size_text(summary)}\n\n{summary_table(summary)}"


def size_text(summary: Summary) -> str:
    """Say what the mesh consists of."""
    kinds = [
        plural(n, name)
        for n, name in ((summary.n_quads, "quad"), (summary.n_triangles, "triangle"))
        if n
    ]
    vertices = plural(summary.n_vertices, "vertex", "vertices")
    return f"{' and '.join(kinds)}, {vertices}, area {summary.area:.6g}"


def summary_table(summary: Summary) -> Table:
    """One mesh: extremes, means, validity, histograms."""
    bars = tuple(
        Section(
            HISTOGRAM_WORDS[name],
            tuple(
                Row(
                    f"{label}{_unit(name)}",
                    (
                        f"{count:>9} cells   {percent_text(percent)}   "
                        f"{bar(percent / max(max(h.percent), 1.0), 2 * LONGEST_BAR)}",
                    ),
                )
                for label, count, percent in zip(h.labels, h.counts, h.percent, strict=True)
            ),
        )
        for name, h in summary.histograms.items()
    )
    return Table(("",), (*_metric_sections([summary], mark=False), *bars), DEFINITIONS)


def change_table(before: Summary, after: Summary, *, bar_length: int = LONGEST_BAR) -> Table:
    """Before and after, side by side, and in words what became of it."""

    def changed(row: _Figure) -> str:
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
        for title, figures in _figures([before, after])
    ]
    sections += [
        Section(s.title, tuple(Row(r.label, (*r.cells, "")) for r in s.rows))
        for s in _histogram_sections([before, after], bar_length)
    ]
    return Table(("Before", "After", "Change"), tuple(sections), DEFINITIONS)


def comparison_tables(
    before: Summary, results: Sequence[SmoothResult], *, width: int | None = None
) -> list[Table]:
    """Put the original beside each method's result; the best of each row is marked.

    Parameters
    ----------
    before, results
        Quality of the original mesh, and what the methods made of it.
    width
        Characters in a line; the methods are spread over several tables where they do not fit.
        None: one table, as wide as it gets.

    Returns
    -------
    list of Table
        The original is the first column of each. Marks compare all methods.
    """
    summaries = [before, *(r.after for r in results)]
    names = ["Original", *(method_title(r.method) for r in results)]
    seconds = [r.seconds for r in results]
    quickest = _best(seconds, [time_text(s) for s in seconds], False)
    effort = Section(
        "Effort",
        (
            Row(
                "Time of the sweeps",
                ("", *map(time_text, seconds)),
                frozenset(k + 1 for k in quickest),
            ),
            Row("Sweeps", ("", *(str(r.sweeps) for r in results))),
            Row("Stopped by itself", ("", *("yes" if r.converged else "no" for r in results))),
        ),
        marked=True,
    )
    label = 2 + max(map(len, [*WORST_WORDS.values(), *MEAN_WORDS.values(), SIZE_WORDS]))
    per_table, length = len(names), LONGEST_BAR
    if width is not None:
        # A column is a bar, a blank, seven characters of per cent, the mark, and rich's padding.
        per_table = max(2, min(len(names), (width - label - 4) // 13))
        length = max(0, min(LONGEST_BAR, (width - label - 4) // per_table - 12))
    whole = (
        effort,
        *_metric_sections(summaries, mark=True),
        *_histogram_sections(summaries, length, marked=True),
    )
    tables = []
    for first in range(1, len(names), per_table - 1):
        columns = [0, *range(first, min(first + per_table - 1, len(names)))]
        sections = tuple(
            Section(
                s.title,
                tuple(
                    Row(
                        r.label,
                        tuple(r.cells[k] for k in columns),
                        frozenset(n for n, k in enumerate(columns) if k in r.best),
                    )
                    for r in s.rows
                ),
                s.marked,
            )
            for s in whole
        )
        tables.append(Table(tuple(names[k] for k in columns), sections))
    note = f"{BEST} best of the row, the original included. {DEFINITIONS}"
    tables[-1] = Table(tables[-1].columns, tables[-1].sections, note)
    return tables


def worst_table(quality: Quality, k: int, by: str) -> Table:
    """List the worst cells with their places and metrics."""
    worst = quality.worst(k, by)
    validity = quality.validity[worst.cells]
    centres = worst.centres
    if centres.shape[1] == 3 and len(centres) and np.ptp(centres[:, 2]) == 0.0:
        centres = centres[:, :2]  # a level mesh, most likely
    axes = "xyz"[: centres.shape[1]]
    extent = float(np.ptp(quality.points, axis=0).max())
    rows = tuple(
        Row(
            str(cell),
            (
                *(place_text(float(value), extent) for value in centres[n]),
                *(metric_text(name, float(worst.values[name][n])) for name in HIGHER_IS_BETTER),
                Validity(int(validity[n])).name.lower(),
            ),
        )
        for n, cell in enumerate(worst.cells)
    )
    heads = [f"Centre {axis}" for axis in axes]
    heads += [METRIC_WORDS[name].capitalize() for name in HIGHER_IS_BETTER]
    heads = [head.replace("jacobian", "Jacobian") for head in heads]
    title = f"The {plural(len(rows), 'worst cell')} by {METRIC_WORDS[by]} (cells count from 0)"
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
            f.name[0].upper() + f.name[1:],
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


def metric_text(metric: str, value: float) -> str:
    """Write a value of a metric, with its unit."""
    if metric in ("min_angle", "max_angle"):
        return f"{value:.2f}°"
    if metric == "aspect_ratio":
        return number_text(value)
    return f"{value:.4f}"


def place_text(value: float, extent: float) -> str:
    """Write a coordinate to a millionth of the mesh's extent."""
    decimals = 5 - math.floor(math.log10(extent)) if extent > 0.0 else 99
    return f"{value:.{max(decimals, 0)}f}" if -4 < decimals < 12 else f"{value:.8g}"


def number_text(value: float) -> str:
    """Write a ratio to two decimals, or a large one to four figures."""
    if math.isnan(value):
        return "none"
    if math.isinf(value):
        return "infinite"
    return f"{value:.2f}" if abs(value) < 1e5 else f"{value:.3e}"


def time_text(seconds: float) -> str:
    """Write a time in seconds, to three figures or milliseconds."""
    return f"{seconds:.3f} s" if seconds < 10.0 else f"{seconds:.1f} s"


def percent_text(percent: float) -> str:
    """Write a share in seven characters."""
    if percent == 0.0:
        return "    0 %"
    return f"{percent:5.1f} %" if percent >= 0.05 else " <0.1 %"


def bar(share: float, length: int) -> str:
    """Draw a share of a bar, padded to `length` characters; what is not zero is seen."""
    eighths = math.ceil(min(max(share, 0.0), 1.0) * 8 * length - 1e-9)
    full, rest = divmod(eighths, 8)
    return (EIGHTHS[-1] * full + (EIGHTHS[rest - 1] if rest else "")).ljust(length)


@dataclass(frozen=True)
class _Figure:
    """One figure of a summary: its name, how to get and to write it, which way is better."""

    label: str
    value: Callable[[Summary], float]
    text: Callable[[float], str]
    higher_is_better: bool


def _figures(summaries: Sequence[Summary]) -> list[tuple[str, list[_Figure]]]:
    def figure(words: dict[str, str], part: str, name: str) -> _Figure:
        return _Figure(
            words[name],
            lambda summary: getattr(summary, part)[name],
            lambda value: metric_text(name, value),
            HIGHER_IS_BETTER[name],
        )

    def count(label: str, value: Callable[[Summary], float]) -> _Figure:
        return _Figure(label, value, lambda n: str(int(n)), False)

    def of_class(name: str) -> Callable[[Summary], float]:
        return lambda summary: summary.validity[name]

    means = [figure(MEAN_WORDS, "mean", name) for name in HIGHER_IS_BETTER]
    means.append(_Figure(SIZE_WORDS, lambda summary: summary.size_jump, number_text, False))
    validity = [count("Cells not valid", lambda summary: summary.n_invalid)]
    validity += [
        count(f"  of these {kind}", of_class(kind))
        for kind in summaries[0].validity
        if kind != "valid" and any(s.validity[kind] for s in summaries)
    ]
    return [
        ("Worst cell", [figure(WORST_WORDS, "worst", name) for name in HIGHER_IS_BETTER]),
        ("Mean of all cells", means),
        ("Validity", validity),
    ]


def _metric_sections(summaries: Sequence[Summary], *, mark: bool) -> list[Section]:
    sections = []
    for title, figures in _figures(summaries):
        rows = []
        for f in figures:
            values = [f.value(s) for s in summaries]
            texts = tuple(f.text(v) for v in values)
            best = _best(values, texts, f.higher_is_better) if mark else frozenset()
            rows.append(Row(f.label, texts, best))
        sections.append(Section(title, tuple(rows), mark))
    return sections


def _histogram_sections(
    summaries: Sequence[Summary], length: int, *, marked: bool = False
) -> list[Section]:
    sections = []
    for name in summaries[0].histograms:
        columns: list[Histogram] = [s.histograms[name] for s in summaries]
        longest = max(max(h.percent) for h in columns) or 1.0
        rows = tuple(
            Row(
                f"{label}{_unit(name)}",
                tuple(
                    f"{bar(h.percent[k] / longest, length)} {percent_text(h.percent[k])}".strip(
                        "\n"
                    )
                    for h in columns
                ),
            )
            for k, label in enumerate(columns[0].labels)
        )
        sections.append(Section(HISTOGRAM_WORDS[name], rows, marked))
    return sections


def _best(values: Sequence[float], texts: Sequence[str], higher: bool) -> frozenset[int]:
    """Columns of the best value; what reads the same is equal, and among equals none is best."""
    if len(set(texts)) < 2:
        return frozenset()
    known = [value for value in values if not math.isnan(value)]
    best = texts[values.index(max(known) if higher else min(known))]
    return frozenset(k for k, text in enumerate(texts) if text == best)


def _unit(name: str) -> str:
    return "" if name == "aspect_ratio" else " degrees"


def plain(text: str, encoding: str | None) -> str:
    """Replace bars and signs that an encoding lacks."""
    try:
        text.encode(encoding or "ascii")
    except (UnicodeEncodeError, LookupError):
        return text.translate(PLAIN)
    return text


def finite(value: Any) -> Any:
    """Make nested lists and dicts fit for JSON: numbers that are not finite become None."""
    if isinstance(value, dict):
        return {str(key): finite(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [finite(item) for item in value]
    if hasattr(value, "tolist"):
        return finite(value.tolist())
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value
