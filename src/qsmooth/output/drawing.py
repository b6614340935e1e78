"""The strokes that figures are made of. Needs matplotlib."""

from __future__ import annotations

import io
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from qsmooth._types import BoolArray, FloatArray, IndexArray
from qsmooth._words import plural
from qsmooth.io.files import replace_bytes
from qsmooth.mesh import Mesh
from qsmooth.metrics import Metric, Quality, quality
from qsmooth.output.views import cell_corners, cells_in

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# Colours that stay apart for all kinds of colour blindness: Okabe and Ito.
BEFORE_COLOUR, AFTER_COLOUR, OUTLINE_COLOUR = "#D55E00", "#0072B2", "#0072B2"
# Of cells that the metric is not defined for.
UNDEFINED_COLOUR = "#D0D0D0"
# From good to bad: light to dark, readable without colour.
COLOURS = "YlOrRd"
# Cells beyond this many go into an SVG as an image; a picture of each would weigh megabytes.
VECTOR_CELLS = 6000
DPI = 200


def require_matplotlib() -> None:
    """Raise an `ImportError` that says what to install where matplotlib is missing."""
    try:
        import matplotlib.figure  # noqa: F401
    except ImportError as error:
        raise ImportError(
            "figures need matplotlib, which is not installed: pip install 'qsmooth[plot]'"
        ) from error


def new_figure(width: float, height: float) -> Figure:
    """Start a figure, in inches, that belongs to no display."""
    require_matplotlib()
    from matplotlib.backends import backend_agg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), dpi=DPI, layout="constrained")
    agg: Any = backend_agg
    agg.FigureCanvasAgg(figure)  # no display, and no state outside the figure
    return figure


def panels_for(n_panels: int, window: FloatArray, *, colours: bool) -> tuple[Figure, list[Axes]]:
    """Panels side by side, or one above the other where the window is wide."""
    width, height = np.ptp(window, axis=0)
    slope = float(np.clip(height / width, 0.1, 4.0))
    below = n_panels > 1 and slope < 0.55
    columns, rows = (1, n_panels) if below else (n_panels, 1)
    panel = min(11.0 if columns == 1 else 6.3, 7.5 / slope)
    extra = 0.9 if colours else 0.0
    figure = new_figure(columns * panel + 0.4 + extra, rows * (panel * slope + 0.5) + 1.1)
    panels = [figure.add_subplot(rows, columns, k + 1) for k in range(n_panels)]
    for axes in panels:
        axes.set_aspect("equal")
        axes.set_xlim(*window[:, 0])
        axes.set_ylim(*window[:, 1])
        axes.tick_params(labelsize=7)
        axes.ticklabel_format(useOffset=False)
        axes.locator_params(nbins=6)
    return figure, panels


def line_width(axes: Axes, mesh: Mesh, cells: IndexArray, window: FloatArray) -> float:
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


def draw_cells(
    axes: Axes,
    mesh: Mesh,
    metric: Metric,
    measured: Quality,
    scale: tuple[float, float],
    window: FloatArray,
) -> None:
    """Draw the cells in a window, coloured by a metric along a scale from best to worst."""
    from matplotlib.collections import PolyCollection
    from matplotlib.colors import to_rgba

    cells = np.flatnonzero(cells_in(mesh, window))
    width = line_width(axes, mesh, cells, window)
    sizes = np.diff(mesh.cell_offsets)[cells]
    best, worst = scale
    values = measured[metric.name][cells]
    shares = np.clip((values - best) / (worst - best), 0.0, 1.0)
    colours = _colour_map()(shares)
    colours[np.isnan(shares)] = to_rgba(UNDEFINED_COLOUR)
    for n, corners in zip((3, 4), cell_corners(mesh, cells), strict=True):
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


def outline(axes: Axes, mesh: Mesh, cells: IndexArray, window: FloatArray) -> None:
    """Outline cells; where they are too small to see, ring them."""
    from matplotlib.collections import PolyCollection

    for corners in cell_corners(mesh, cells):
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
    polygons = [corners for part in cell_corners(mesh, cells) for corners in part]
    small = [p.mean(axis=0) for p in polygons if np.ptp(p, axis=0).max() < 0.02 * extent]
    if small:
        x, y = np.array(small).T
        axes.scatter(
            x, y, s=45, facecolors="none", edgecolors=OUTLINE_COLOUR, linewidths=0.9, zorder=4
        )


def colour_scale(metric: Metric, measured: Sequence[Quality]) -> tuple[float, float]:
    """Best and worst end of the colour scale, from the metric or else from the meshes."""
    best, worst = metric.ideal_of(measured[0].topology.cell_sizes), metric.worst_colour
    if best is not None and worst is not None:
        return best, worst
    values = np.concatenate([of[metric.name] for of in measured])
    values = values[np.isfinite(values)]
    low, high = (float(values.min()), float(values.max())) if values.size else (0.0, 1.0)
    if low == high:
        low, high = low - 0.5 * (abs(low) or 1.0), high + 0.5 * (abs(high) or 1.0)
    if best is None:
        best = high if metric.higher_is_better else low
    if worst is None:
        worst = low if metric.higher_is_better else high
    return best, worst


def _colour_map() -> Any:
    from matplotlib import colormaps

    return colormaps[COLOURS]


def colour_bar(
    figure: Figure, panels: Sequence[Axes], metric: Metric, scale: tuple[float, float]
) -> None:
    """Put the colour scale beside the panels."""
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize

    best, worst = scale
    low, high = min(best, worst), max(best, worst)
    colours = _colour_map() if worst > best else _colour_map().reversed()
    extend = "neither"
    if metric.worst_colour is not None and worst > best and metric.span[1] > worst:
        extend = "max"
    elif metric.worst_colour is not None and worst < best and metric.span[0] < worst:
        extend = "min"
    bar = figure.colorbar(
        ScalarMappable(Normalize(low, high), colours),
        ax=list(panels),
        fraction=0.03,
        pad=0.02,
        extend=extend,
        shrink=0.85,
    )
    better = "more is better" if metric.higher_is_better else "less is better"
    bar.set_label(f"{metric.title}{metric.unit_words} ({better})", fontsize=9)
    bar.ax.tick_params(labelsize=8)


def size_of(mesh: Mesh) -> str:
    """Say what a mesh consists of."""
    sizes = np.diff(mesh.cell_offsets)
    kinds = [
        plural(int((sizes == n).sum()), name)
        for n, name in ((4, "quad"), (3, "triangle"))
        if (sizes == n).any()
    ]
    return f"{' and '.join(kinds)}, {plural(mesh.n_vertices, 'vertex', 'vertices')}"


def extremes(measured: Quality, metric: Metric, seen: BoolArray | None = None) -> str:
    """Worst value and mean of a metric, and how many cells are not valid."""
    values = measured[metric.name]
    invalid = measured.validity != 0
    if seen is not None:
        values, invalid = values[seen], invalid[seen]
    if not len(values):
        return "no cell here"
    worst, mean = metric.worst_of(values), metric.mean_of(values)
    text = f"{metric.worst_words} {metric.text(worst)}, mean {metric.text(mean)}"
    n_invalid = int(invalid.sum())
    return f"{text}, {plural(n_invalid, 'cell')} not valid" if n_invalid else text


def add_caption(figure: Figure, text: str) -> None:
    """Put a line of text under a figure."""
    figure.supxlabel(text, fontsize=9, color="#404040")


def saved(figure: Figure, path: str | Path | None) -> Figure:
    """Save a figure where there is a path, and give it back."""
    if path is not None:
        save(figure, Path(path))
    return figure


def save(figure: Figure, path: Path) -> None:
    """Save a figure in the format of the name's ending."""
    from matplotlib import rc_context, rcParams

    # Without a date and with ids of its own the same figure is the same file.
    with rc_context({"svg.hashsalt": "qsmooth", "path.simplify": False}):
        ending = path.suffix[1:].lower() or rcParams["savefig.format"]
        metadata = {"Date": None} if ending == "svg" else None
        drawn = io.BytesIO()
        figure.savefig(drawn, dpi=DPI, metadata=metadata, format=ending)
    if not path.suffix:
        path = path.with_name(f"{path.name}.{ending}")
    replace_bytes(path, drawn.getvalue())
