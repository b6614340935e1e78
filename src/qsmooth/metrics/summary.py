"""A mesh's quality in a few figures, and these as rows of a table."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from qsmooth._frames import data_frame
from qsmooth._json import finite
from qsmooth._types import FloatArray, IndexArray
from qsmooth._words import plural
from qsmooth.metrics.histogram import Histogram
from qsmooth.metrics.metric import Metric
from qsmooth.metrics.registry import METRICS
from qsmooth.notebook import page
from qsmooth.table import (
    LONGEST_BAR,
    Row,
    Section,
    Table,
    bar,
    best_columns,
    percent_text,
)


@dataclass(frozen=True)
class Summary:
    """A mesh's quality in a few figures: extremes, means, histograms, validity counts.

    By metric, and in the order in which these were asked for. A metric that is not defined for
    some cells, as some are not for triangles, leaves these out; one that is for no cell has NaN.

    Attributes
    ----------
    worst, mean
        The worst figure, and the mean over the cells of the kind that `Metric.mean` says.
    validity
        Count of cells by class name: valid, collapsed, concave, crossed, inverted.
    histograms
        Of the metrics that have bins, without those beyond the best that the mesh's cells can have.
    """

    n_vertices: int
    n_quads: int
    n_triangles: int
    area: float
    worst: dict[str, float]
    mean: dict[str, float]
    validity: dict[str, int]
    histograms: dict[str, Histogram]

    @property
    def n_cells(self) -> int:
        """Count of cells."""
        return self.n_quads + self.n_triangles

    @property
    def n_invalid(self) -> int:
        """Count of cells that are not valid."""
        return self.n_cells - self.validity["valid"]

    def to_dict(self) -> dict[str, Any]:
        """Plain numbers, lists and dicts, fit for JSON (infinite figures become None)."""
        return {
            "n_vertices": self.n_vertices,
            "n_cells": self.n_cells,
            "n_quads": self.n_quads,
            "n_triangles": self.n_triangles,
            "n_invalid": self.n_invalid,
            "area": self.area,
            "worst": finite(self.worst),
            "mean": finite(self.mean),
            "validity": dict(self.validity),
            "histograms": {name: h.to_dict() for name, h in self.histograms.items()},
        }

    def __repr__(self) -> str:
        worst = ", ".join(f"{name} {METRICS[name].text(v)}" for name, v in self.worst.items())
        return f"Summary({size_text(self)}, {self.n_invalid} not valid; worst {worst})"

    def _repr_html_(self) -> str:
        """Show a table in a notebook."""
        return page(size_text(self), Table(("",), tuple(figure_sections([self], mark=False))))

    def to_dataframe(self) -> Any:
        """Give a ``pandas.DataFrame`` with a row a metric: its worst figure and its mean.

        Raises
        ------
        ImportError
            Where there is no pandas.
        """
        columns = {"worst": list(self.worst.values()), "mean": list(self.mean.values())}
        return data_frame(columns, list(self.worst), "metric")

    def __str__(self) -> str:
        return f"{size_text(self)}\n\n{summary_table(self)}"


@dataclass(frozen=True)
class WorstCells:
    """The worst cells of a mesh by one metric, the worst first.

    Attributes
    ----------
    metric
        Which metric ranks them.
    cells : (k,)
        Cell ids.
    centres : (k, 2) or (k, 3)
        Means of the cells' corners, in the mesh's own coordinates.
    values : dict of (k,)
        Metrics of these cells, by name.
    """

    metric: str
    cells: IndexArray
    centres: FloatArray
    values: dict[str, FloatArray]

    def __repr__(self) -> str:
        if not len(self.cells):
            return f"WorstCells({self.metric}: none)"
        text, ranked = METRICS[self.metric].text, self.values[self.metric]
        worst, last = text(float(ranked[0])), text(float(ranked[-1]))
        return (
            f"WorstCells({plural(len(self.cells), 'cell')} by {self.metric}, {worst} to {last}; "
            f"the worst is cell {self.cells[0]})"
        )

    def to_dict(self) -> list[dict[str, Any]]:
        """One plain dict a cell, fit for JSON."""
        return [
            {
                "cell": int(cell),
                "centre": self.centres[k].tolist(),
                **{name: finite(float(values[k])) for name, values in self.values.items()},
            }
            for k, cell in enumerate(self.cells)
        ]

    def to_dataframe(self) -> Any:
        """Give a ``pandas.DataFrame`` with a row a cell: its centre and metrics.

        Raises
        ------
        ImportError
            Where there is no pandas.
        """
        centre = dict(zip("xyz", self.centres.T, strict=False))
        return data_frame(centre | self.values, self.cells, "cell")


# ------------------------------------------------------------------------------- as a table


@dataclass(frozen=True)
class SummaryRow:
    """One figure of a summary: its name, how to get and to write it, which way is better."""

    label: str
    value: Callable[[Summary], float]
    text: Callable[[float], str]
    higher_is_better: bool


def summary_rows(summaries: Sequence[Summary]) -> list[tuple[str, list[SummaryRow]]]:
    """List what there is to say of several summaries of the same metrics, by section."""

    def row(metric: Metric, part: str, words: str) -> SummaryRow:
        return SummaryRow(
            words,
            lambda summary: getattr(summary, part)[metric.name],
            metric.text,
            metric.higher_is_better,
        )

    def count(label: str, value: Callable[[Summary], float]) -> SummaryRow:
        return SummaryRow(label, value, lambda n: str(int(n)), False)

    def of_class(name: str) -> Callable[[Summary], float]:
        return lambda summary: summary.validity[name]

    metrics = [METRICS[name] for name in summaries[0].worst]
    validity = [count("Cells not valid", lambda summary: summary.n_invalid)]
    validity += [
        count(f"  of these {kind}", of_class(kind))
        for kind in summaries[0].validity
        if kind != "valid" and any(s.validity[kind] for s in summaries)
    ]
    return [
        ("Worst cell", [row(metric, "worst", metric.worst_words) for metric in metrics]),
        ("Mean of all cells", [row(metric, "mean", metric.mean_words) for metric in metrics]),
        ("Validity", validity),
    ]


def figure_sections(summaries: Sequence[Summary], *, mark: bool) -> list[Section]:
    """Lay out the figures of several summaries side by side, the best of a row marked or not."""
    sections = []
    for title, figures in summary_rows(summaries):
        rows = []
        for f in figures:
            values = [f.value(s) for s in summaries]
            texts = tuple(f.text(v) for v in values)
            best = best_columns(values, texts, higher_is_better=f.higher_is_better)
            rows.append(Row(f.label, texts, best if mark else frozenset()))
        sections.append(Section(title, tuple(rows), mark))
    return sections


def histogram_sections(
    summaries: Sequence[Summary], length: int, *, marked: bool = False
) -> list[Section]:
    """Lay out the histograms of several summaries side by side, with bars of `length`."""
    sections = []
    for name in summaries[0].histograms:
        columns: list[Histogram] = [s.histograms[name] for s in summaries]
        longest = max(max(h.percent) for h in columns) or 1.0
        rows = tuple(
            Row(
                bin_text(name, label),
                tuple(
                    f"{bar(h.percent[k] / longest, length)} {percent_text(h.percent[k])}"
                    for h in columns
                ),
            )
            for k, label in enumerate(columns[0].labels)
        )
        sections.append(Section(f"Cells by {METRICS[name].words}", rows, marked))
    return sections


def bin_text(name: str, label: str) -> str:
    """Name a bin with its unit: "60 to 70 degrees"."""
    return f"{label} degrees" if METRICS[name].unit == "°" else label


def definitions(summary: Summary) -> str:
    """Define the metrics of a summary whose names do not."""
    return " ".join(text for name in summary.worst if (text := METRICS[name].explanation))


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
            f"Cells by {METRICS[name].words}",
            tuple(
                Row(
                    bin_text(name, label),
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
    sections = (*figure_sections([summary], mark=False), *bars)
    return Table(("",), sections, definitions(summary))
