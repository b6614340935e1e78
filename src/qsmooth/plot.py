"""Figures: a mesh coloured by quality, before and after, histograms. Needs matplotlib."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, TypeAlias

import numpy as np

from qsmooth._types import BoolArray, FloatArray, IndexArray
from qsmooth._words import plural
from qsmooth.mesh import Mesh, as_mesh
from qsmooth.metrics import HIGHER_IS_BETTER, Quality, Summary, quality
from qsmooth.report import METRIC_WORDS, method_title, metric_text

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from qsmooth.result import SmoothResult

View: TypeAlias = Literal["whole", "overlay", "worst", "narrow", "good"]
Drawable: TypeAlias = "Mesh | SmoothResult | tuple[Any, Any]"

VIEWS: tuple[View, ...] = ("whole", "overlay", "worst", "narrow", "good")
# Colours that stay apart for all kinds of colour blindness: Okabe and Ito.
BEFORE_COLOUR, AFTER_COLOUR, OUTLINE_COLOUR = "#D55E00", "#0072B2", "#0072B2"
# From good to bad: light to dark, readable without colour.
COLOURS = "YlOrRd"
# Best and worst end of the colour scale; see `_scale` for triangles.
SCALES = {
    "min_angle": (90.0, 0.0),
    "max_angle": (90.0, 180.0),
    "aspect_ratio": (1.0, 10.0),
    "scaled_jacobian": (1.0, 0.0),
    "shape": (1.0, 0.0),
}
# Of a small mesh no more than this share of the cells is outlined.
LARGEST_OUTLINED_SHARE = 0.1
# A zoomed view shows about so many cells.
ZOOM_CELLS = 120
# Places that are tried when looking for the narrowest and the best.
CANDIDATES = 300
# Of the places with about the largest share of the boundary, from this fraction up, the smallest
# is shown as the narrow one.
NARROW_SHARE = 0.9
# Cells beyond this many go into an SVG as an image; a picture of each would weigh megabytes.
VECTOR_CELLS = 6000
DPI = 200


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
        ``min_angle``, ``max_angle``, ``aspect_ratio``, ``scaled_jacobian`` or ``shape``.
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
    _require_metric(metric)
    shown = _mesh_of(mesh)
    measured = quality(shown)
    worst = _most_outlined(shown, worst)
    ranked = measured.worst(worst, metric)
    window = _whole(shown)
    figure, (axes,) = _figure(1, window, colours=True)
    _draw_cells(axes, shown, getattr(measured, metric), metric, window)
    _outline(axes, shown, ranked.cells, window)
    figure.suptitle(title or f"Cells by {METRIC_WORDS[metric]}", fontsize=13)
    _colour_bar(figure, [axes], metric, shown)
    caption = f"{_size(shown)}. {_extremes(measured, metric)}."
    if len(ranked.cells):
        caption += f" Outlined: the {plural(len(ranked.cells), 'worst cell')}."
    _caption(figure, caption)
    return _saved(figure, path)


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
    _require_metric(metric)
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
        return _saved(_overlay(meshes, measured[0], method, title), path)
    worst_cell = int(measured[0].worst(1).cells[0])
    window = {
        "whole": lambda: _whole(*meshes),
        "worst": lambda: _around(meshes[0], worst_cell),
        "narrow": lambda: _narrow_window(meshes[0]),
        "good": lambda: _good_window(meshes[0], measured[0]),
    }[view]()
    figure, panels = _figure(2, window, colours=True)
    names = "Before", f"After ({method})" if method else "After"
    for axes, mesh, of, name in zip(panels, meshes, measured, names, strict=True):
        _draw_cells(axes, mesh, getattr(of, metric), metric, window)
        _outline(axes, mesh, of.worst(worst, metric).cells, window)
        axes.set_title(f"{name}\n{_extremes(of, metric, _seen(mesh, window))}", fontsize=10)
    headings = {
        "whole": f"Before and after: cells by {METRIC_WORDS[metric]}",
        "worst": "Around the worst cell",
        "narrow": "In a narrow place",
        "good": "Where the mesh was best before",
    }
    figure.suptitle(title or headings[view], fontsize=13)
    _colour_bar(figure, panels, metric, meshes[0])
    caption = f"{_size(meshes[0])}. Outlined: the {plural(worst, 'worst cell')} of each mesh."
    if view != "whole":
        caption += f" The view is {window[1, 0] - window[0, 0]:.3g} wide; figures are those of it."
    _caption(figure, caption)
    return _saved(figure, path)


def plot_histograms(
    before: Drawable | Summary,
    after: Drawable | Summary | None = None,
    *,
    title: str = "",
    path: str | Path | None = None,
) -> Figure:
    """Draw histograms of the largest and smallest angles and of the aspect ratios.

    Parameters
    ----------
    before, after
        Meshes, summaries, or a `SmoothResult`, which alone stands for both; `after` may be
        left out.
    title, path
        As in `plot_mesh`.

    Returns
    -------
    matplotlib.figure.Figure

    Raises
    ------
    ImportError
        If matplotlib is not installed.
    """
    if after is None and hasattr(before, "before"):
        result: Any = before
        summaries = [result.before, result.after]
    else:
        summaries = [_summary_of(mesh) for mesh in (before, after) if mesh is not None]
    names = ["Before", "After"] if len(summaries) == 2 else ["All cells"]
    colours = [BEFORE_COLOUR, AFTER_COLOUR] if len(summaries) == 2 else [AFTER_COLOUR]
    figure = _new_figure(13.0, 4.6)
    for n, metric in enumerate(summaries[0].histograms):
        axes = figure.add_subplot(1, 3, n + 1)
        labels = summaries[0].histograms[metric].labels
        places = np.arange(len(labels))
        width = 0.84 / len(summaries)
        for k, (summary, name, colour) in enumerate(zip(summaries, names, colours, strict=True)):
            at = places + (k - 0.5 * (len(summaries) - 1)) * width
            worst, mean = summary.worst[metric], summary.mean[metric]
            axes.bar(
                at,
                summary.histograms[metric].percent,
                width,
                color=colour,
                edgecolor="white",
                linewidth=0.4,
                hatch="" if k else ("////" if len(summaries) == 2 else ""),
                label=f"{name}: worst {metric_text(metric, worst)}, "
                f"mean {metric_text(metric, mean)}",
            )
        edges = summaries[0].histograms[metric].edges
        ticks = [f"{e:g}" for e in edges if np.isfinite(e)]
        axes.set_xticks(np.arange(len(ticks)) - 0.5, ticks, fontsize=8)
        axes.tick_params(axis="y", labelsize=8)
        axes.set_xlim(-0.6, len(labels) - 0.4)
        if np.isinf(edges[-1]):
            axes.text(len(labels) - 0.5, 0, "and\nmore", fontsize=7, ha="center", va="bottom")
        unit = "" if metric == "aspect_ratio" else ", degrees"
        axes.set_xlabel(f"{METRIC_WORDS[metric].capitalize()} of a cell{unit}", fontsize=9)
        axes.set_ylabel("Per cent of the cells", fontsize=9)
        axes.spines[["top", "right"]].set_visible(False)
        axes.set_ylim(0.0, 1.28 * max(max(s.histograms[metric].percent) for s in summaries))
        axes.legend(fontsize=8, frameon=False, loc="upper right")
    figure.suptitle(title or "Quality of the cells", fontsize=13)
    invalid = ", ".join(
        f"{summary.n_invalid} {name.lower() if len(summaries) == 2 else ''}".strip()
        for summary, name in zip(summaries, names, strict=True)
    )
    _caption(
        figure,
        f"{plural(summaries[0].n_cells, 'cell')}. Aspect ratio: longest over shortest edge. "
        f"Cells not valid: {invalid}.",
    )
    return _saved(figure, path)


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
            _save(figure, paths[-1])
    return paths


def require_matplotlib() -> None:
    """Raise an `ImportError` that says what to install where matplotlib is missing."""
    try:
        import matplotlib.figure  # noqa: F401
    except ImportError as error:
        raise ImportError(
            "figures need matplotlib, which is not installed: pip install 'qsmooth[plot]'"
        ) from error


def _mesh_of(mesh: Any) -> Mesh:
    inner = getattr(mesh, "mesh", None)
    return inner if isinstance(inner, Mesh) else as_mesh(mesh)


def _summary_of(mesh: Any) -> Summary:
    return mesh if isinstance(mesh, Summary) else quality(_mesh_of(mesh)).summary()


def _require_metric(metric: str) -> None:
    if metric not in SCALES:
        raise ValueError(f"metric must be one of {', '.join(SCALES)}; got {metric!r}")


# Windows are (2, 2): lower left and upper right corner, in the plane of the mesh.


def _whole(*meshes: Mesh) -> FloatArray:
    used = np.diff(meshes[0].star_offsets) > 0
    low = np.min([mesh.xy[used].min(axis=0) for mesh in meshes], axis=0)
    high = np.max([mesh.xy[used].max(axis=0) for mesh in meshes], axis=0)
    margin = 0.02 * _extent(low, high)
    return np.array([low - margin, high + margin])


def _extent(low: FloatArray, high: FloatArray) -> float:
    """Larger side of a box; of a mesh that is collapsed to a point, something to draw in."""
    extent = float((high - low).max())
    largest = float(max(np.abs(low).max(), np.abs(high).max()))
    return extent if extent > 1e-12 * largest else (1e-6 * largest or 1.0)


def _centres(mesh: Mesh) -> FloatArray:
    sums = np.add.reduceat(mesh.xy[mesh.cell_vertices], mesh.cell_offsets[:-1], axis=0)
    centres: FloatArray = sums / np.diff(mesh.cell_offsets)[:, None]
    return centres


def _nearest(centres: FloatArray, cell: int) -> IndexArray:
    """Cells around a cell, itself included: the nearest in the larger of the coordinates."""
    away = np.abs(centres - centres[cell]).max(axis=1)
    k = min(ZOOM_CELLS, len(away)) - 1
    return np.flatnonzero(away <= np.partition(away, k)[k])


def _around(mesh: Mesh, cell: int, slope: float = 1.0) -> FloatArray:
    """Window on the cells around a cell, its height `slope` times its width."""
    near = _nearest(_centres(mesh), cell)
    corners = np.concatenate([part.reshape(-1, 2) for part in _polygons(mesh, near)])
    low, high = corners.min(axis=0), corners.max(axis=0)
    width = max(float(high[0] - low[0]), float(high[1] - low[1]) / slope)
    width = 1.02 * (width if width > 0.0 else _extent(low, high))
    half = 0.5 * np.array([width, slope * width])
    middle = low + 0.5 * (high - low)
    return np.array([middle - half, middle + half])


def _candidates(mesh: Mesh) -> IndexArray:
    # On large meshes fewer, as each is compared with all cells.
    n = min(CANDIDATES, mesh.n_cells, max(20, 30_000_000 // mesh.n_cells))
    return np.unique(np.linspace(0, mesh.n_cells - 1, n).astype(np.int64))


def _narrow_window(mesh: Mesh) -> FloatArray:
    """Around the candidate whose neighbourhood has many corners on the boundary and is small."""
    sizes = np.diff(mesh.cell_offsets)
    on_boundary = mesh.is_boundary[mesh.cell_vertices].astype(np.float64)
    share = np.add.reduceat(on_boundary, mesh.cell_offsets[:-1]) / sizes
    centres, candidates = _centres(mesh), _candidates(mesh)
    near = [_nearest(centres, int(c)) for c in candidates]
    shares = np.array([share[cells].mean() for cells in near])
    extents = np.array([np.ptp(centres[cells], axis=0).max() for cells in near])
    extents[shares < NARROW_SHARE * shares.max()] = np.inf
    return _around(mesh, int(candidates[int(np.argmin(extents))]))


def _good_window(mesh: Mesh, measured: Quality) -> FloatArray:
    """Around the candidate whose neighbourhood has the best mean."""
    centres, candidates = _centres(mesh), _candidates(mesh)
    means = [measured.scaled_jacobian[_nearest(centres, int(c))].mean() for c in candidates]
    return _around(mesh, int(candidates[int(np.argmax(means))]))


def _seen(mesh: Mesh, window: FloatArray) -> BoolArray:
    """Cells whose bounding box meets the window, (n_cells,)."""
    corners, starts = mesh.xy[mesh.cell_vertices], mesh.cell_offsets[:-1]
    low = np.minimum.reduceat(corners, starts, axis=0)
    high = np.maximum.reduceat(corners, starts, axis=0)
    seen: BoolArray = ((high >= window[0]) & (low <= window[1])).all(axis=1)
    return seen


def _new_figure(width: float, height: float) -> Figure:
    require_matplotlib()
    from matplotlib.backends import backend_agg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), dpi=DPI, layout="constrained")
    agg: Any = backend_agg
    agg.FigureCanvasAgg(figure)  # no display, and no state outside the figure
    return figure


def _figure(n_panels: int, window: FloatArray, *, colours: bool) -> tuple[Figure, list[Axes]]:
    """Panels side by side, or one above the other where the window is wide."""
    width, height = np.ptp(window, axis=0)
    slope = float(np.clip(height / width, 0.1, 4.0))
    below = n_panels > 1 and slope < 0.55
    columns, rows = (1, n_panels) if below else (n_panels, 1)
    panel = min(11.0 if columns == 1 else 6.3, 7.5 / slope)
    extra = 0.9 if colours else 0.0
    figure = _new_figure(columns * panel + 0.4 + extra, rows * (panel * slope + 0.5) + 1.1)
    panels = [figure.add_subplot(rows, columns, k + 1) for k in range(n_panels)]
    for axes in panels:
        axes.set_aspect("equal")
        axes.set_xlim(*window[:, 0])
        axes.set_ylim(*window[:, 1])
        axes.tick_params(labelsize=7)
        axes.ticklabel_format(useOffset=False)
        axes.locator_params(nbins=6)
    return figure, panels


def _polygons(mesh: Mesh, cells: IndexArray) -> list[Any]:
    """Corners of the cells in arrays of equal length: triangles, then quads."""
    sizes = np.diff(mesh.cell_offsets)[cells]
    first = mesh.cell_offsets[:-1][cells]
    return [mesh.xy[mesh.cell_vertices[first[sizes == n][:, None] + np.arange(n)]] for n in (3, 4)]


def _line_width(axes: Axes, mesh: Mesh, cells: IndexArray, window: FloatArray) -> float:
    """Width of edges in points, for cells as large as these; 0 where lines would hide them."""
    if not len(cells):
        return 0.5
    centre_sizes = np.sqrt(np.abs(quality(mesh).area[cells]))
    size = float(np.median(centre_sizes))
    box = axes.get_position()
    figure: Any = axes.figure
    points = 72.0 * box.width * figure.get_size_inches()[0]
    across = points * size / float(np.ptp(window[:, 0]))
    return float(np.clip(0.045 * across, 0.0, 0.8)) if across > 1.6 else 0.0


def _draw_cells(
    axes: Axes, mesh: Mesh, values: FloatArray, metric: str, window: FloatArray
) -> None:
    from matplotlib.collections import PolyCollection

    cells = np.flatnonzero(_seen(mesh, window))
    width = _line_width(axes, mesh, cells, window)
    sizes = np.diff(mesh.cell_offsets)[cells]
    best, worst = _scale(metric, mesh)
    shares = np.clip((values[cells] - best) / (worst - best), 0.0, 1.0)
    colours = _colour_map()(shares)
    for n, corners in zip((3, 4), _polygons(mesh, cells), strict=True):
        if not len(corners):
            continue
        faces = colours[sizes == n]
        collection = PolyCollection(
            corners,
            facecolors=faces,
            # Without lines, faces reach over the seams between them.
            edgecolors="#404040" if width else faces,
            linewidths=width or 0.15,
        )
        collection.set_rasterized(len(cells) > VECTOR_CELLS)
        axes.add_collection(collection, autolim=False)


def _outline(axes: Axes, mesh: Mesh, cells: IndexArray, window: FloatArray) -> None:
    """Outline cells; where they are too small to see, ring them."""
    from matplotlib.collections import PolyCollection

    for corners in _polygons(mesh, cells):
        if len(corners):
            axes.add_collection(
                PolyCollection(
                    corners, facecolors="none", edgecolors=OUTLINE_COLOUR, linewidths=1.2, zorder=3
                ),
                autolim=False,
            )
    if not len(cells):
        return
    extent = float(np.ptp(window, axis=0).max())
    polygons = [corners for part in _polygons(mesh, cells) for corners in part]
    small = [p.mean(axis=0) for p in polygons if np.ptp(p, axis=0).max() < 0.02 * extent]
    if small:
        x, y = np.array(small).T
        axes.scatter(
            x, y, s=45, facecolors="none", edgecolors=OUTLINE_COLOUR, linewidths=0.9, zorder=4
        )


def _overlay(meshes: tuple[Mesh, Mesh], measured: Quality, method: str, title: str) -> Figure:
    from matplotlib.collections import LineCollection
    from matplotlib.lines import Line2D

    whole = _whole(*meshes)
    slope = float(np.clip(np.ptp(whole[:, 1]) / np.ptp(whole[:, 0]), 0.1, 4.0))
    zoom = _around(meshes[0], int(measured.worst(1).cells[0]), slope)
    figure, panels = _figure(2, whole, colours=False)
    names = "Before", f"After ({method})" if method else "After"
    for axes, window in zip(panels, (whole, zoom), strict=True):
        for mesh, colour in zip(meshes, (BEFORE_COLOUR, AFTER_COLOUR), strict=True):
            cells = np.flatnonzero(_seen(mesh, window))
            width = _line_width(axes, mesh, cells, window)
            segments: Any = mesh.xy[_edges_of(mesh, cells)]
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
    _caption(figure, f"{_size(meshes[0])}. The boundary does not move.")
    return figure


def _edges_of(mesh: Mesh, cells: IndexArray) -> IndexArray:
    """Every edge of the cells once, (k, 2)."""
    sizes = np.diff(mesh.cell_offsets)[cells]
    first = mesh.cell_offsets[:-1][cells]
    sides = []
    for n in (3, 4):
        corners = mesh.cell_vertices[first[sizes == n][:, None] + np.arange(n)]
        sides.append(np.stack([corners, np.roll(corners, -1, axis=1)], axis=2).reshape(-1, 2))
    return np.unique(np.sort(np.concatenate(sides), axis=1), axis=0)


def _scale(metric: str, mesh: Mesh) -> tuple[float, float]:
    """Best and worst end of the colour scale."""
    best, worst = SCALES[metric]
    sizes = np.diff(mesh.cell_offsets)
    if (metric == "max_angle" and sizes.min() == 3) or (metric == "min_angle" and sizes.max() == 3):
        best = 60.0
    return best, worst


def _most_outlined(mesh: Mesh, worst: int) -> int:
    if worst < 0:
        raise ValueError(f"worst must be 0 or more, got {worst}")
    return min(worst, math.ceil(LARGEST_OUTLINED_SHARE * mesh.n_cells))


def _colour_map() -> Any:
    from matplotlib import colormaps

    return colormaps[COLOURS]


def _colour_bar(figure: Figure, panels: Sequence[Axes], metric: str, mesh: Mesh) -> None:
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize

    best, worst = _scale(metric, mesh)
    low, high = min(best, worst), max(best, worst)
    colours = _colour_map() if worst > best else _colour_map().reversed()
    extend = "neither"
    if metric == "aspect_ratio":
        extend = "max"
    elif metric == "max_angle":
        extend = "max"  # concave cells go beyond 180 degrees
    elif metric == "scaled_jacobian":
        extend = "min"
    bar = figure.colorbar(
        ScalarMappable(Normalize(low, high), colours),
        ax=list(panels),
        fraction=0.03,
        pad=0.02,
        extend=extend,
        shrink=0.85,
    )
    unit = ", degrees" if metric in ("min_angle", "max_angle") else ""
    better = "more is better" if HIGHER_IS_BETTER[metric] else "less is better"
    words = METRIC_WORDS[metric]
    bar.set_label(f"{words[0].upper()}{words[1:]}{unit} ({better})", fontsize=9)
    bar.ax.tick_params(labelsize=8)


def _size(mesh: Mesh) -> str:
    sizes = np.diff(mesh.cell_offsets)
    kinds = [
        plural(int((sizes == n).sum()), name)
        for n, name in ((4, "quad"), (3, "triangle"))
        if (sizes == n).any()
    ]
    return f"{' and '.join(kinds)}, {plural(mesh.n_vertices, 'vertex', 'vertices')}"


def _extremes(measured: Quality, metric: str, seen: BoolArray | None = None) -> str:
    """Worst value and mean of a metric, and how many cells are not valid."""
    values = getattr(measured, metric)
    invalid = measured.validity != 0
    if seen is not None:
        values, invalid = values[seen], invalid[seen]
    if not len(values):
        return "no cell here"
    worst = float(values.min() if HIGHER_IS_BETTER[metric] else values.max())
    finite = values[np.isfinite(values)]
    mean = float(finite.mean()) if len(finite) else float("inf")
    words = METRIC_WORDS[metric]
    end = "smallest" if HIGHER_IS_BETTER[metric] else "largest"
    if words.startswith(end):
        words = words.removeprefix(end + " ")
    text = f"{end} {words} {metric_text(metric, worst)}, mean {metric_text(metric, mean)}"
    text = text[0].upper() + text[1:]
    n_invalid = int(invalid.sum())
    return f"{text}, {plural(n_invalid, 'cell')} not valid" if n_invalid else text


def _caption(figure: Figure, text: str) -> None:
    figure.supxlabel(text, fontsize=9, color="#404040")


def _saved(figure: Figure, path: str | Path | None) -> Figure:
    if path is not None:
        _save(figure, Path(path))
    return figure


def _save(figure: Figure, path: Path) -> None:
    from matplotlib import rc_context

    # Without a date and with ids of its own the same figure is the same file.
    with rc_context({"svg.hashsalt": "qsmooth", "path.simplify": False}):
        metadata = {"Date": None} if path.suffix.lower() == ".svg" else None
        figure.savefig(path, dpi=DPI, metadata=metadata)
