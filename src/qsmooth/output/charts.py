"""Charts: histograms of metrics, and how sweeps converged. Needs matplotlib."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from qsmooth._types import FloatArray
from qsmooth._words import plural
from qsmooth.metrics import METRICS, Summary, parse_metrics, quality
from qsmooth.output.drawables import Drawable, mesh_of, named_results
from qsmooth.output.drawing import AFTER_COLOUR, BEFORE_COLOUR, LINE_COLOURS, chart_sheet

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from qsmooth.result import SmoothResult

DASHES = ("-", "--", ":", "-.")


def plot_histograms(
    before: Drawable | Summary,
    after: Drawable | Summary | None = None,
    *,
    metrics: str | Sequence[str] | None = None,
    log: bool = False,
    title: str = "",
    ax: Any = None,
    path: str | Path | None = None,
) -> Figure:
    """Draw histograms of metrics, by default of the angles and of the aspect ratios.

    Parameters
    ----------
    before, after
        Meshes, summaries, or a `SmoothResult`, which alone stands for both; `after` may be
        left out.
    metrics
        Names, in a sequence or with commas between; those without bins are left out. Summaries
        have those that they were made with.
    log
        Whether the axis of shares is logarithmic, which shows the few bad cells of many.
    title, path
        As in `plot_mesh`. Counts of cells stand over the bars.
    ax
        A panel for each histogram, of a figure of the caller's.

    Returns
    -------
    matplotlib.figure.Figure

    Raises
    ------
    ImportError
        If matplotlib is not installed.
    ValueError
        If a name is no metric, or there is none with bins.
    """
    if after is None and hasattr(before, "before"):
        result: Any = before
        summaries = [result.before, result.after]
    else:
        summaries = [_summary_of(mesh, metrics) for mesh in (before, after) if mesh is not None]
    measured = summaries[0].histograms
    shown = (
        list(measured) if metrics is None else [n for n in parse_metrics(metrics) if n in measured]
    )
    if not shown:
        raise ValueError("none of the metrics has a histogram")
    sheet = chart_sheet(ax, len(shown))
    for axes, name in zip(sheet.panels, shown, strict=True):
        _draw_histogram(axes, name, summaries, log)
    names = ["before", "after"] if len(summaries) == 2 else [""]
    invalid = ", ".join(
        f"{summary.n_invalid} {name}".strip()
        for summary, name in zip(summaries, names, strict=True)
    )
    caption = " ".join(
        [
            f"{plural(summaries[0].n_cells, 'cell')}; counts stand over the bars.",
            *(METRICS[name].explanation for name in shown if not METRICS[name].evident),
            f"Cells not valid: {invalid}.",
        ]
    )
    return sheet.finish(title or "Quality of the cells", caption, path)


def _draw_histogram(axes: Axes, name: str, summaries: Sequence[Summary], log: bool) -> None:
    metric, both = METRICS[name], len(summaries) == 2
    names = ["Before", "After"] if both else ["All cells"]
    colours = [BEFORE_COLOUR, AFTER_COLOUR] if both else [AFTER_COLOUR]
    edges = summaries[0].histograms[name].edges
    places = np.arange(len(edges) - 1)
    width = 0.84 / len(summaries)
    highest = max(max(s.histograms[name].percent) for s in summaries)
    for k, (summary, which, colour) in enumerate(zip(summaries, names, colours, strict=True)):
        counted = summary.histograms[name]
        bars = axes.bar(
            places + (k - 0.5 * (len(summaries) - 1)) * width,
            counted.percent,
            width,
            color=colour,
            edgecolor="white",
            linewidth=0.4,
            hatch="////" if both and k == 0 else "",
            label=f"{which}: worst {metric.text(summary.worst[name])}, "
            f"mean {metric.text(summary.mean[name])}",
        )
        counts = [str(n) if n else "" for n in counted.counts]
        axes.bar_label(bars, counts, padding=1.5, fontsize=6, rotation=90)
    ticks = [f"{e:g}" if np.isfinite(e) else "more" for e in edges]
    axes.set_xticks(np.arange(len(ticks)) - 0.5, ticks, fontsize=8)
    axes.tick_params(axis="y", labelsize=8)
    axes.set_xlim(-0.6, len(places) - 0.4)
    axes.set_xlabel(f"{metric.title} of a cell{metric.unit_words}", fontsize=9)
    axes.set_ylabel("Per cent of the cells", fontsize=9)
    axes.spines[["top", "right"]].set_visible(False)
    if log:
        least = 50.0 / max(summary.n_cells for summary in summaries)  # half of one cell
        axes.set_yscale("log")
        axes.set_ylim(least, max(10.0 * least, highest * (highest / least) ** 0.35))
    else:
        axes.set_ylim(0.0, 1.35 * highest or 1.0)
    axes.legend(fontsize=8, frameon=False, loc="upper right")


def plot_convergence(
    results: SmoothResult | Mapping[str, SmoothResult] | Sequence[SmoothResult],
    *,
    title: str = "",
    ax: Sequence[Axes] | None = None,
    path: str | Path | None = None,
) -> Figure:
    """Draw the smallest and the largest angle, the mean shape and the invalid cells by sweeps.

    Parameters
    ----------
    results
        One result, or several, as `compare` gives them. At 0 is the mesh before.
    title, path
        As in `plot_mesh`.
    ax
        Four panels, of a figure of the caller's.

    Returns
    -------
    matplotlib.figure.Figure

    Raises
    ------
    ImportError
        If matplotlib is not installed.
    ValueError
        If there is no result.
    """
    one: Any = results
    named = named_results([one] if hasattr(one, "history") else one)
    sheet = chart_sheet(ax, 4)
    for k, (name, result) in enumerate(named.items()):
        style: dict[str, Any] = {
            "color": LINE_COLOURS[k % len(LINE_COLOURS)],
            "linestyle": DASHES[k % len(DASHES)],
            "label": name,
            "linewidth": 1.5,
        }
        for axes, values in zip(sheet.panels, _courses(result), strict=True):
            marker = "o" if len(values) < 30 else ""
            axes.plot(values, marker=marker, markersize=3, **style)
    names = "Smallest angle, degrees", "Largest angle, degrees", "Mean shape", "Cells not valid"
    for axes, words in zip(sheet.panels, names, strict=True):
        axes.set_ylabel(words, fontsize=9)
        axes.set_xlabel("Record", fontsize=9)
        axes.tick_params(labelsize=8)
        axes.ticklabel_format(useOffset=False)
        axes.locator_params(axis="x", integer=True, nbins=6)
        axes.spines[["top", "right"]].set_visible(False)
    sheet.panels[3].set_ylim(bottom=0.0)
    sheet.panels[3].locator_params(axis="y", integer=True, nbins=6)
    sheet.panels[2].legend(fontsize=8, frameon=False)
    caption = (
        "A record is a sweep, of Optimise a round of ten; its result is the best that was seen, "
        "which need not be the last."
    )
    return sheet.finish(title or "How it converged", caption, path)


def _courses(result: SmoothResult) -> list[FloatArray]:
    """Figures before and after each record, (n_records + 1,) each."""
    before = result.quality_before
    starts = [*before.extreme_angles, before.mean_shape, float(before.n_invalid)]
    columns = "min_angle", "max_angle", "mean_shape", "n_invalid"
    return [
        np.array([start, *result.history[column]])
        for start, column in zip(starts, columns, strict=True)
    ]


def _summary_of(mesh: Any, metrics: str | Sequence[str] | None) -> Summary:
    return mesh if isinstance(mesh, Summary) else quality(mesh_of(mesh)).summary(metrics)
