"""Maps: a mesh by quality, before and after, by method. Needs matplotlib."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, TypeAlias

import numpy as np

from qsmooth._types import BoolArray, FloatArray, IndexArray
from qsmooth._words import plural
from qsmooth.mesh import Mesh
from qsmooth.metrics import Metric, Quality, find_metric, quality
from qsmooth.output import drawing
from qsmooth.output.displacement import overlay
from qsmooth.output.drawables import Drawable, before_of, mesh_of, named_results, pair
from qsmooth.output.scales import ColourScale, Scale, colour_scale
from qsmooth.output.tables import method_title
from qsmooth.output.views import (
    cells_in,
    good_window,
    narrow_window,
    whole_window,
    window_around,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from qsmooth.result import SmoothResult

View: TypeAlias = Literal["whole", "overlay", "worst", "left", "narrow", "good"]
MeshView: TypeAlias = Literal["whole", "worst"]

VIEWS: tuple[View, ...] = ("whole", "overlay", "worst", "left", "narrow", "good")
# Of a small mesh no more than this share of the cells is outlined.
LARGEST_OUTLINED_SHARE = 0.1
# Cells whose number and figure are written in a view of the whole, and in one that is zoomed.
WRITTEN_WHOLE, WRITTEN_ZOOMED = 3, 6


def plot_mesh(
    mesh: Drawable,
    *,
    metric: str = "max_angle",
    view: MeshView = "whole",
    scale: Scale = "linear",
    worst: int = 20,
    title: str = "",
    ax: Axes | None = None,
    path: str | Path | None = None,
) -> Figure:
    """Draw a mesh with its cells coloured by a metric, and the worst cells outlined.

    Parameters
    ----------
    mesh
        A `Mesh`, a pair ``(points, cells)`` or a `SmoothResult`.
    metric
        The name of one in `qsmooth.metrics.METRICS`. Cells that it is not defined for are grey,
        those that are not valid nearly black.
    view
        ``"whole"``, or ``"worst"``: zoomed on the worst cell.
    scale
        ``"linear"``: colours go with the figure, from the best to the worst that there is, and
        of sizes and ratios that span more than two decades with its logarithm.
        ``"quantiles"``: each of ten colours has a tenth of the cells, and the worst tenth three.
    worst
        How many of the worst cells to outline, a tenth of all cells at most. Number and figure are
        written at the first three of them, of those in a zoomed view at six.
    title
        Heading; by default it names the metric.
    ax
        The panel to draw in, of a figure of the caller's; a new figure by default.
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
        If an option is none of those above.
    """
    shown_metric, shown = find_metric(metric), mesh_of(mesh)
    if view not in ("whole", "worst"):
        raise ValueError(f"view must be one of whole, worst; got {view!r}")
    measured = quality(shown)
    worst = _most_outlined(shown, worst)
    colours = colour_scale(shown_metric, [measured], scale)
    window = whole_window(shown)
    if view == "worst":
        window = window_around(shown, _worst_cell(shown_metric, measured))
    sheet = drawing.map_sheet(ax, [window], bar=True)
    zoomed = view != "whole"
    staying = shown.is_fixed if zoomed else None
    ranked = _draw(sheet.panels[0], shown, shown_metric, colours, window, worst, staying)
    colours.draw_bar(sheet.panels, sheet.bar)
    caption = f"{drawing.size_of(shown)}. {drawing.extremes(measured, shown_metric)}."
    if ranked:
        caption += f" Outlined: the {plural(ranked, 'worst cell')}."
    if np.isnan(measured[metric]).any():
        caption += " Grey: not defined for these cells."
    caption += _invalid_words([measured]) + (_zoom_words(window) if zoomed else "")
    return sheet.finish(title or f"Cells by {shown_metric.words}", caption, path)


def plot_comparison(
    before: Drawable,
    after: Drawable | None = None,
    *,
    view: View = "whole",
    metric: str = "max_angle",
    scale: Scale = "linear",
    worst: int = 20,
    title: str = "",
    ax: Sequence[Axes] | None = None,
    path: str | Path | None = None,
) -> Figure:
    """Draw a mesh before and after smoothing.

    Parameters
    ----------
    before, after
        The same cells at two sets of coordinates; either may be a `SmoothResult`, which alone
        stands for both.
    view
        ``"whole"``: side by side. ``"overlay"``: drawn over each other in two colours, whole and
        around the worst cell; of 20 000 cells and more the whole shows how far vertices moved.
        ``"worst"``, ``"left"``, ``"narrow"``, ``"good"``: side by side, zoomed on the worst cell
        of `before`, on the worst that is left in `after`, on a narrow place of the domain, on the
        place that was best before. In these, numbers and figures are written at the worst cells,
        and vertices that stay are dots.
    metric, scale, worst, title, path
        As in `plot_mesh`; what is worst goes by the metric.
    ax
        Two panels to draw in, of a figure of the caller's.

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
    meshes = pair(before, after)
    measured = quality(meshes[0]), quality(meshes[1])
    worst = _most_outlined(meshes[0], worst)
    result = before if after is None else after
    names = "Before", _after_words(result)
    if view == "overlay":
        return overlay(
            meshes, _worst_cell(shown_metric, measured[0]), names, scale, title, ax, path
        )
    colours = colour_scale(shown_metric, measured, scale)
    window = {
        "whole": lambda: whole_window(*meshes),
        "worst": lambda: window_around(meshes[0], _worst_cell(shown_metric, measured[0])),
        "left": lambda: window_around(meshes[1], _worst_cell(shown_metric, measured[1])),
        "narrow": lambda: narrow_window(meshes[0]),
        "good": lambda: good_window(meshes[0], measured[0]),
    }[view]()
    sheet = drawing.map_sheet(ax, [window, window], bar=True)
    staying = None
    if view != "whole":
        staying = meshes[0].is_fixed & (meshes[0].xy == meshes[1].xy).all(axis=1)
    for axes, mesh, of, name in zip(sheet.panels, meshes, measured, names, strict=True):
        _draw(axes, mesh, shown_metric, colours, window, worst, staying)
        said = drawing.extremes(of, shown_metric, cells_in(mesh, window))
        axes.set_title(f"{name}\n{said}", fontsize=10)
    colours.draw_bar(sheet.panels, sheet.bar)
    headings = {
        "whole": f"Before and after: cells by {shown_metric.words}",
        "worst": f"Around the worst cell before, by {shown_metric.words}",
        "left": f"Around the worst cell that is left, by {shown_metric.words}",
        "narrow": "In a narrow place",
        "good": "Where the mesh was best before",
    }
    caption = f"{drawing.size_of(meshes[0])}. Outlined: the {plural(worst, 'worst cell')} of each "
    caption += "mesh." + _invalid_words(measured)
    if staying is not None:
        caption += _zoom_words(window)
    if view == "left":
        caption += _limit_words(shown_metric, result)
    return sheet.finish(title or headings[view], caption, path)


def plot_methods(
    results: Mapping[str, SmoothResult] | Sequence[SmoothResult],
    *,
    view: MeshView = "whole",
    metric: str = "max_angle",
    scale: Scale = "linear",
    worst: int = 20,
    title: str = "",
    ax: Sequence[Axes] | None = None,
    path: str | Path | None = None,
) -> Figure:
    """Draw what several methods made of a mesh side by side, after the mesh itself.

    Parameters
    ----------
    results
        As `compare` gives them, or a sequence of results, all from the same start.
    view
        ``"whole"``, or ``"worst"``: zoomed on the worst cell before.
    metric, scale, worst, title, path
        As in `plot_mesh`.
    ax
        Panels to draw in, of a figure of the caller's: one more than there are results.

    Returns
    -------
    matplotlib.figure.Figure

    Raises
    ------
    ImportError, ValueError
        As in `plot_comparison`; or if there is no result.
    """
    shown_metric, named = find_metric(metric), named_results(results)
    if view not in ("whole", "worst"):
        raise ValueError(f"view must be one of whole, worst; got {view!r}")
    before = before_of(next(iter(named.values())))
    meshes = [before, *(pair(before, result)[1] for result in named.values())]
    measured = [quality(mesh) for mesh in meshes]
    worst = _most_outlined(before, worst)
    colours = colour_scale(shown_metric, measured, scale)
    window = whole_window(*meshes)
    if view == "worst":
        window = window_around(before, _worst_cell(shown_metric, measured[0]))
    columns = min(len(meshes), 3 if len(meshes) < 7 else 4)
    sheet = drawing.map_sheet(ax, [window] * len(meshes), bar=True, columns=columns)
    staying = before.is_fixed if view == "worst" else None
    for axes, mesh, of, name in zip(
        sheet.panels, meshes, measured, ("Before", *named), strict=True
    ):
        _draw(axes, mesh, shown_metric, colours, window, worst, staying)
        said = drawing.extremes(of, shown_metric, cells_in(mesh, window))
        axes.set_title(f"{name}\n{said}", fontsize=9)
    colours.draw_bar(sheet.panels, sheet.bar)
    caption = (
        f"{drawing.size_of(before)}. Outlined: the {plural(worst, 'worst cell')} of each mesh."
    )
    caption += _invalid_words(measured) + (_zoom_words(window) if view == "worst" else "")
    return sheet.finish(title or f"What methods make of it, by {shown_metric.words}", caption, path)


def _worst_cell(metric: Metric, measured: Quality) -> int:
    """The worst cell by a metric, by that which ranks all where it is not defined for any."""
    ranked = metric.worst_cells(measured[metric.name], 1)
    return int(ranked[0] if len(ranked) else measured.worst(1).cells[0])


def _most_outlined(mesh: Mesh, worst: int) -> int:
    if worst < 0:
        raise ValueError(f"worst must be 0 or more, got {worst}")
    return min(worst, math.ceil(LARGEST_OUTLINED_SHARE * mesh.n_cells))


def _draw(
    axes: Axes,
    mesh: Mesh,
    metric: Metric,
    colours: ColourScale,
    window: FloatArray,
    worst: int,
    staying: BoolArray | None,
) -> int:
    """Draw a mesh and its worst cells, zoomed where `staying` is given; count of the worst."""
    measured = quality(mesh)
    values = measured[metric.name]
    drawing.draw_cells(axes, mesh, values, colours, window)
    drawing.mark_invalid(axes, mesh, measured, window)
    ranked: IndexArray = metric.worst_cells(values, worst)
    drawing.outline(axes, mesh, ranked, window)
    written = ranked[:WRITTEN_WHOLE]
    if staying is not None:
        drawing.mark_staying(axes, mesh, staying, window)
        seen = np.flatnonzero(cells_in(mesh, window))
        written = seen[metric.worst_cells(values[seen], min(worst, WRITTEN_ZOOMED))]

    def text(cell: int) -> str:
        corners = mesh.cell_vertices[mesh.cell_offsets[cell] : mesh.cell_offsets[cell + 1]]
        said = f"{cell}: {metric.text(float(values[cell]))}"
        n_staying = 0 if staying is None else int(staying[corners].sum())
        return f"{said}, {n_staying} of {len(corners)} stay" if n_staying else said

    drawing.label_cells(axes, mesh, written, window, text)
    return len(ranked)


def _after_words(after: Any) -> str:
    method = getattr(after, "method", "")
    if not method:
        return "After"
    return f"After ({method_title(method)}, {plural(getattr(after, 'sweeps', 0), 'sweep')})"


def _invalid_words(measured: Sequence[Quality]) -> str:
    return " Nearly black: not valid." if any(of.n_invalid for of in measured) else ""


def _zoom_words(window: FloatArray) -> str:
    return (
        f" The view is {window[1, 0] - window[0, 0]:.3g} wide; figures are those of it. Numbers: "
        "cells, and corners of these that stay; dots: vertices that stay."
    )


def _limit_words(metric: Metric, result: Any) -> str:
    """Say how far from the best of any placement what is left is, if a run has found that."""
    limits = getattr(getattr(result, "outcome", None), "limits", None)
    if limits is None or metric.name not in ("min_angle", "max_angle"):
        return ""
    text = str(limits).splitlines()[0 if metric.name == "min_angle" else 1]
    return f" Of the mesh: {text}."
