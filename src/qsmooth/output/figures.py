"""Figures: a mesh coloured by quality, before and after, histograms. Needs matplotlib."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, TypeAlias

import numpy as np

from qsmooth._words import plural
from qsmooth.adapters import as_mesh
from qsmooth.mesh import Mesh
from qsmooth.metrics import METRICS, Quality, Summary, find_metric, parse_metrics, quality
from qsmooth.output.drawing import (
    AFTER_COLOUR,
    BEFORE_COLOUR,
    VECTOR_CELLS,
    add_caption,
    colour_bar,
    colour_scale,
    draw_cells,
    extremes,
    line_width,
    new_figure,
    outline,
    panels_for,
    require_matplotlib,
    save,
    saved,
    size_of,
)
from qsmooth.output.tables import method_title
from qsmooth.output.views import (
    cells_in,
    edges_of,
    good_window,
    narrow_window,
    whole_window,
    window_around,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from qsmooth.result import SmoothResult

View: TypeAlias = Literal["whole", "overlay", "worst", "narrow", "good"]
Drawable: TypeAlias = "Mesh | SmoothResult | tuple[Any, Any]"

VIEWS: tuple[View, ...] = ("whole", "overlay", "worst", "narrow", "good")
# Of a small mesh no more than this share of the cells is outlined.
LARGEST_OUTLINED_SHARE = 0.1


def plot_mesh(
    mesh: Drawable,
    *,
    metric: str = "max_angle",
    worst: int = 20,
    title: str = "",
    path: str | Path | None = None,
) -> Figure:
    """Draw a mesh with its cells coloured by a metric, and the worst cells outlined.

    Parameters
    ----------
    mesh
        A `Mesh`, a pair ``(points, cells)`` or a `SmoothResult`.
    metric
        The name of one in `qsmooth.metrics.METRICS`. Cells that it is not defined for are grey.
    worst
        How many of the worst cells to outline, a tenth of all cells at most.
    title
        Heading; by default it names the metric.
    path
        Where to save the figure, by the ending of its name: .png, .svg, .pdf.

    Returns
    -------
    matplotlib.figure.Figure

    Raises
    ------
    ImportError
        If matplotlib is not installed.
    ValueError
        If `metric` is no metric or `worst` is negative.
    """
    shown_metric = find_metric(metric)
    shown = _mesh_of(mesh)
    measured = quality(shown)
    worst = _most_outlined(shown, worst)
    ranked = measured.worst(worst, metric)
    window = whole_window(shown)
    figure, (axes,) = panels_for(1, window, colours=True)
    scale = colour_scale(shown_metric, [measured])
    draw_cells(axes, shown, shown_metric, measured, scale, window)
    outline(axes, shown, ranked.cells, window)
    figure.suptitle(title or f"Cells by {shown_metric.words}", fontsize=13)
    colour_bar(figure, [axes], shown_metric, scale)
    caption = f"{size_of(shown)}. {extremes(measured, shown_metric)}."
    if len(ranked.cells):
        caption += f" Outlined: the {plural(len(ranked.cells), 'worst cell')}."
    if np.isnan(measured[metric]).any():
        caption += " Grey: not defined for these cells."
    add_caption(figure, caption)
    return saved(figure, path)


def plot_comparison(
    before: Drawable,
    after: Drawable,
    *,
    view: View = "whole",
    metric: str = "max_angle",
    worst: int = 20,
    title: str = "",
    path: str | Path | None = None,
) -> Figure:
    """Draw a mesh before and after smoothing.

    Parameters
    ----------
    before, after
        The same cells at two sets of coordinates; `after` may be a `SmoothResult`.
    view
        ``"whole"``: side by side. ``"overlay"``: drawn over each other in two colours,
        whole and around the worst cell. ``"worst"``, ``"narrow"``, ``"good"``: side by side,
        zoomed on the worst cell of `before`, on a narrow place of the domain, on the place that
        was best before.
    metric, worst, title, path
        As in `plot_mesh`.

    Returns
    -------
    matplotlib.figure.Figure

    Raises
    ------
    ImportError
        If matplotlib is not installed.
    ValueError
        If the meshes have different cells, or an option is none of those above.
    """
    shown_metric = find_metric(metric)
    if view not in VIEWS:
        raise ValueError(f"view must be one of {', '.join(VIEWS)}; got {view!r}")
    meshes = _mesh_of(before), _mesh_of(after)
    if not np.array_equal(meshes[0].cell_offsets, meshes[1].cell_offsets) or not np.array_equal(
        meshes[0].cell_vertices, meshes[1].cell_vertices
    ):
        raise ValueError("before and after must have the same cells")
    measured = quality(meshes[0]), quality(meshes[1])
    worst = _most_outlined(meshes[0], worst)
    method = getattr(after, "method", "")
    if method:
        method = f"{method_title(method)}, {plural(getattr(after, 'sweeps', 0), 'sweep')}"
    if view == "overlay":
        return saved(_overlay(meshes, measured[0], method, title), path)
    worst_cell = int(measured[0].worst(1).cells[0])
    window = {
        "whole": lambda: whole_window(*meshes),
        "worst": lambda: window_around(meshes[0], worst_cell),
        "narrow": lambda: narrow_window(meshes[0]),
        "good": lambda: good_window(meshes[0], measured[0]),
    }[view]()
    figure, panels = panels_for(2, window, colours=True)
    names = "Before", f"After ({method})" if method else "After"
    scale = colour_scale(shown_metric, measured)
    for axes, mesh, of, name in zip(panels, meshes, measured, names, strict=True):
        draw_cells(axes, mesh, shown_metric, of, scale, window)
        outline(axes, mesh, of.worst(worst, metric).cells, window)
        axes.set_title(f"{name}\n{extremes(of, shown_metric, cells_in(mesh, window))}", fontsize=10)
    headings = {
        "whole": f"Before and after: cells by {shown_metric.words}",
        "worst": "Around the worst cell",
        "narrow": "In a narrow place",
        "good": "Where the mesh was best before",
    }
    figure.suptitle(title or headings[view], fontsize=13)
    colour_bar(figure, panels, shown_metric, scale)
    caption = f"{size_of(meshes[0])}. Outlined: the {plural(worst, 'worst cell')} of each mesh."
    if view != "whole":
        caption += f" The view is {window[1, 0] - window[0, 0]:.3g} wide; figures are those of it."
    add_caption(figure, caption)
    return saved(figure, path)


def plot_histograms(
    before: Drawable | Summary,
    after: Drawable | Summary | None = None,
    *,
    metrics: str | Sequence[str] | None = None,
    title: str = "",
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
    title, path
        As in `plot_mesh`.

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
    names = ["Before", "After"] if len(summaries) == 2 else ["All cells"]
    colours = [BEFORE_COLOUR, AFTER_COLOUR] if len(summaries) == 2 else [AFTER_COLOUR]
    figure = new_figure(max(13.0, 4.3 * len(shown)), 4.6)
    for n, name in enumerate(shown):
        metric = METRICS[name]
        axes = figure.add_subplot(1, len(shown), n + 1)
        labels = summaries[0].histograms[name].labels
        places = np.arange(len(labels))
        width = 0.84 / len(summaries)
        for k, (summary, which, colour) in enumerate(zip(summaries, names, colours, strict=True)):
            at = places + (k - 0.5 * (len(summaries) - 1)) * width
            worst, mean = summary.worst[name], summary.mean[name]
            axes.bar(
                at,
                summary.histograms[name].percent,
                width,
                color=colour,
                edgecolor="white",
                linewidth=0.4,
                hatch="" if k else ("////" if len(summaries) == 2 else ""),
                label=f"{which}: worst {metric.text(worst)}, mean {metric.text(mean)}",
            )
        edges = summaries[0].histograms[name].edges
        ticks = [f"{e:g}" for e in edges if np.isfinite(e)]
        axes.set_xticks(np.arange(len(ticks)) - 0.5, ticks, fontsize=8)
        axes.tick_params(axis="y", labelsize=8)
        axes.set_xlim(-0.6, len(labels) - 0.4)
        if np.isinf(edges[-1]):
            axes.text(len(labels) - 0.5, 0, "and\nmore", fontsize=7, ha="center", va="bottom")
        axes.set_xlabel(f"{metric.title} of a cell{metric.unit_words}", fontsize=9)
        axes.set_ylabel("Per cent of the cells", fontsize=9)
        axes.spines[["top", "right"]].set_visible(False)
        axes.set_ylim(0.0, 1.28 * max(max(s.histograms[name].percent) for s in summaries))
        axes.legend(fontsize=8, frameon=False, loc="upper right")
    figure.suptitle(title or "Quality of the cells", fontsize=13)
    invalid = ", ".join(
        f"{summary.n_invalid} {name.lower() if len(summaries) == 2 else ''}".strip()
        for summary, name in zip(summaries, names, strict=True)
    )
    add_caption(
        figure,
        " ".join(
            [
                f"{plural(summaries[0].n_cells, 'cell')}.",
                *(METRICS[name].explanation for name in shown if not METRICS[name].evident),
                f"Cells not valid: {invalid}.",
            ]
        ),
    )
    return saved(figure, path)


def save_figures(
    before: Mesh, result: SmoothResult, folder: str | Path, *, metric: str = "max_angle"
) -> list[Path]:
    """Draw every figure of a smoothing, and save each as PNG and SVG.

    Parameters
    ----------
    before, result
        The mesh that was smoothed and what came out.
    folder
        Made if it is not there.
    metric
        What the cells are coloured by.

    Returns
    -------
    list of Path
        The files written.
    """
    require_matplotlib()
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    figures: dict[str, Callable[[], Figure]] = {
        "before": partial(plot_mesh, before, metric=metric, title="Before smoothing"),
        "after": partial(plot_mesh, result, metric=metric, title="After smoothing"),
        "histograms": partial(plot_histograms, result),
    }
    for view in VIEWS:
        figures[f"comparison-{view}"] = partial(
            plot_comparison, before, result, view=view, metric=metric
        )
    paths = []
    for name, draw in figures.items():
        figure = draw()
        for ending in ("png", "svg"):
            paths.append(folder / f"{name}.{ending}")
            save(figure, paths[-1])
    return paths


def _mesh_of(mesh: Any) -> Mesh:
    inner = getattr(mesh, "mesh", None)
    return inner if isinstance(inner, Mesh) else as_mesh(mesh)


def _summary_of(mesh: Any, metrics: str | Sequence[str] | None) -> Summary:
    return mesh if isinstance(mesh, Summary) else quality(_mesh_of(mesh)).summary(metrics)


def _most_outlined(mesh: Mesh, worst: int) -> int:
    if worst < 0:
        raise ValueError(f"worst must be 0 or more, got {worst}")
    return min(worst, math.ceil(LARGEST_OUTLINED_SHARE * mesh.n_cells))


def _overlay(meshes: tuple[Mesh, Mesh], measured: Quality, method: str, title: str) -> Figure:
    from matplotlib.collections import LineCollection
    from matplotlib.lines import Line2D

    whole = whole_window(*meshes)
    slope = float(np.clip(np.ptp(whole[:, 1]) / np.ptp(whole[:, 0]), 0.1, 4.0))
    zoom = window_around(meshes[0], int(measured.worst(1).cells[0]), slope)
    figure, panels = panels_for(2, whole, colours=False)
    names = "Before", f"After ({method})" if method else "After"
    for axes, window in zip(panels, (whole, zoom), strict=True):
        for mesh, colour in zip(meshes, (BEFORE_COLOUR, AFTER_COLOUR), strict=True):
            cells = np.flatnonzero(cells_in(mesh, window))
            width = line_width(axes, mesh, cells, window)
            segments: Any = mesh.xy[edges_of(mesh, cells)]
            lines = LineCollection(
                segments, colors=colour, linewidths=max(1.6 * width, 0.12), alpha=0.85
            )
            lines.set_rasterized(len(cells) > VECTOR_CELLS)
            axes.add_collection(lines, autolim=False)
    panels[0].set_title("Whole", fontsize=10)
    panels[1].set_title("Around the worst cell", fontsize=10)
    panels[1].set_xlim(*zoom[:, 0])
    panels[1].set_ylim(*zoom[:, 1])
    figure.suptitle(title or "Both meshes drawn over each other", fontsize=13)
    figure.legend(
        [Line2D([], [], color=c, linewidth=2) for c in (BEFORE_COLOUR, AFTER_COLOUR)],
        names,
        loc="outside upper right",
        fontsize=9,
        frameon=False,
    )
    add_caption(figure, f"{size_of(meshes[0])}. The boundary does not move.")
    return figure
