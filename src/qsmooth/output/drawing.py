"""The strokes that figures are made of. Needs matplotlib."""

from __future__ import annotations

import io
import itertools
import textwrap
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from qsmooth._types import BoolArray, FloatArray, IndexArray
from qsmooth._words import plural
from qsmooth.io.files import replace_bytes
from qsmooth.mesh import Mesh
from qsmooth.metrics import Metric, Quality, quality
from qsmooth.output.scales import ColourScale
from qsmooth.output.views import cell_corners, cells_in, edges_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# Colours that stay apart for all kinds of colour blindness: Okabe and Ito.
BEFORE_COLOUR, AFTER_COLOUR, OUTLINE_COLOUR = "#D55E00", "#0072B2", "#0072B2"
LINE_COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000")
# Cells that are not valid are darker than every colour of a scale, and have an edge of their own.
INVALID_COLOUR, INVALID_EDGE = "#202020", "#CC79A7"
# Cells beyond this many go into an SVG as an image; a picture of each would weigh megabytes.
VECTOR_CELLS = 6000
DPI = 120
# Of images inside an SVG, which a browser scales.
INNER_DPI = 100
# A third of the time of the usual 6, for larger files.
COMPRESSION = 1
# Inches: beside a panel for its ticks, the colour bar and its words, above for titles, below for
# ticks and for each line of the caption.
LEFT, BAR, RIGHT, TITLES, HEADING, TICKS, LINE = 0.75, 1.3, 0.2, 0.48, 0.4, 0.35, 0.19
# Points; edges of cells smaller than the first would hide them, others are this share of the cell.
LEAST_LINED, LINE_SHARE, WIDEST_LINE = 1.6, 0.045, 0.8
# Share of a panel that the words at a cell stand away from it at most, sideways.
LEADER = 0.3
WIDTH_STEP = 0.2  # of large meshes


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

    figure = Figure(figsize=(width, height), dpi=DPI)
    agg: Any = backend_agg
    agg.FigureCanvasAgg(figure)  # no display, and no state outside the figure
    return figure


@dataclass(frozen=True)
class Sheet:
    """Panels of a figure of its own, or those that a caller gave.

    Places are reckoned here: matplotlib finds them by drawing all texts several times, which
    takes longer than to draw 24K cells.

    Attributes
    ----------
    figure, panels
        What is drawn in.
    bar
        The place of the colour bar; None where it is beside the panels, or there is none.
    own
        Whether the figure is no caller's.
    """

    figure: Any
    panels: list[Axes]
    bar: Axes | None = None
    own: bool = True

    def finish(self, title: str, caption: str, path: str | Path | None) -> Figure:
        """Put the heading and the caption; save where there is a path."""
        figure: Figure = self.figure
        if self.own:
            width, height = figure.get_size_inches()
            figure.text(0.5, 1.0 - 0.12 / height, title, fontsize=13, ha="center", va="top")
            lines = textwrap.fill(caption, max(40, int(width / 0.066)))
            figure.text(
                0.5, 0.08 / height, lines, fontsize=9, color="#404040", ha="center", va="bottom"
            )
        elif title:
            self.panels[0].set_title(title, fontsize=10)
        if path is not None:
            save(figure, Path(path))
        return figure


def map_sheet(
    ax: Any, windows: Sequence[FloatArray], *, bar: bool, columns: int | None = None
) -> Sheet:
    """Panels for windows on a mesh: of a new figure, or those of the caller."""
    width, height = np.ptp(windows[0], axis=0)
    slope = float(np.clip(height / width, 0.1, 4.0))
    if columns is None:
        columns = 1 if len(windows) > 1 and slope < 0.55 else len(windows)
    rows = -(-len(windows) // columns)
    across = min({1: 10.0, 2: 6.0}.get(columns, 4.6), 7.5 / slope)
    sheet = _sheet(ax, len(windows), (rows, columns), (across, across * slope), bar)
    for axes, window in zip(sheet.panels, windows, strict=True):
        axes.set_aspect("equal")
        axes.set_xlim(*window[:, 0])
        axes.set_ylim(*window[:, 1])
        axes.tick_params(labelsize=7)
        axes.ticklabel_format(useOffset=False)
        axes.locator_params(nbins=5)
    return sheet


def chart_sheet(ax: Any, n: int) -> Sheet:
    """Panels for charts, in a row."""
    return _sheet(ax, n, (1, n), (max(3.3, 11.0 / n), 3.4), bar=False)


def _sheet(ax: Any, n: int, grid: tuple[int, int], size: tuple[float, float], bar: bool) -> Sheet:
    if ax is not None:
        require_matplotlib()
        panels = list(np.ravel(np.array(ax, dtype=object)))
        if len(panels) != n:
            raise ValueError(f"ax must be {plural(n, 'panel')} of matplotlib, got {len(panels)}")
        return Sheet(panels[0].figure, panels, own=False)
    (rows, columns), (across, up) = grid, size
    step = LEFT + across, up + TITLES + TICKS
    least = 6.0 if n == 1 else 0.0  # room for a heading
    width = max(least, columns * step[0] + RIGHT + (BAR if bar else 0.0))
    height = rows * step[1] + HEADING + 3 * LINE
    figure = new_figure(width, height)

    def place(x: float, y: float, w: float, h: float) -> Any:
        return figure.add_axes((x / width, y / height, w / width, h / height))

    floor = 3 * LINE + TICKS
    panels = [
        place(LEFT + k % columns * step[0], floor + (rows - 1 - k // columns) * step[1], across, up)
        for k in range(n)
    ]
    if not bar:
        return Sheet(figure, panels)
    tall = (rows - 1) * step[1] + up
    high = max(min(0.9 * tall, 7.0), min(tall, 3.0))
    left = columns * step[0] + 0.2
    return Sheet(figure, panels, place(left, floor + 0.5 * (tall - high), 0.16, high))


def points_a_unit(axes: Axes) -> float:
    """Points on paper of a unit of the mesh."""
    figure: Any = axes.figure
    box, low, high = axes.get_position(), *axes.get_xlim()
    width, height = figure.get_size_inches()
    bottom, top = axes.get_ylim()
    return float(
        72.0 * min(box.width * width / abs(high - low), box.height * height / abs(top - bottom))
    )


def line_widths(axes: Axes, areas: FloatArray) -> FloatArray:
    """Width of the edges of each cell in points; 0 where lines would hide it."""
    across = np.sqrt(np.abs(areas)) * points_a_unit(axes)
    widths: FloatArray = np.clip(LINE_SHARE * across, 0.0, WIDEST_LINE)
    widths[~(across > LEAST_LINED)] = 0.0
    return widths


def draw_cells(
    axes: Axes, mesh: Mesh, values: FloatArray, scale: ColourScale, window: FloatArray
) -> None:
    """Draw the cells in a window, coloured by a figure; large ones with their edges."""
    from matplotlib.collections import PolyCollection

    measured = quality(mesh)
    cells = np.flatnonzero(cells_in(mesh, window))
    widths = line_widths(axes, measured.area[cells])
    if len(cells) > VECTOR_CELLS:
        # A width of its own for each takes longer than to draw it.
        widths = np.ceil(widths / WIDTH_STEP) * WIDTH_STEP
    sizes = np.diff(mesh.cell_offsets)[cells]
    faces = scale.faces(values[cells])
    corners = cell_corners(mesh, cells)
    for n, width in itertools.product(
        (3, 4), np.unique(widths) if len(cells) > VECTOR_CELLS else (None,)
    ):
        of_kind = widths[sizes == n]
        chosen = slice(None) if width is None else of_kind == width
        polygons = corners[n - 3][chosen]
        if not len(polygons):
            continue
        collection = PolyCollection(
            polygons,
            facecolors=faces[sizes == n][chosen],
            edgecolors="#404040",
            linewidths=of_kind if width is None else width,
            # Cells without lines would have seams between them.
            antialiaseds=of_kind > 0.0 if width is None else bool(width),
        )
        collection.set_rasterized(width is not None)
        axes.add_collection(collection, autolim=False)


def mark_invalid(axes: Axes, mesh: Mesh, measured: Quality, window: FloatArray) -> int:
    """Darken the cells in a window that are not valid, and give their count in the mesh."""
    if not measured.n_invalid:
        return 0
    invalid = measured.validity != 0
    seen = np.flatnonzero(invalid & cells_in(mesh, window))
    _add_polygons(
        axes, mesh, seen, facecolors=INVALID_COLOUR, edgecolors=INVALID_EDGE, linewidths=0.7,
        alpha=0.85, zorder=2,
    )  # fmt: skip
    return int(invalid.sum())


def outline(axes: Axes, mesh: Mesh, cells: IndexArray, window: FloatArray) -> None:
    """Outline cells; where they are too small to see, ring them."""
    cells = cells[cells_in(mesh, window)[cells]]
    _add_polygons(
        axes, mesh, cells, facecolors="none", edgecolors=OUTLINE_COLOUR, linewidths=1.2, zorder=3
    )
    extent = float(np.ptp(window, axis=0).max())
    polygons = [corners for part in cell_corners(mesh, cells) for corners in part]
    small = [p.mean(axis=0) for p in polygons if np.ptp(p, axis=0).max() < 0.02 * extent]
    if small:
        x, y = np.array(small).T
        axes.scatter(
            x, y, s=45, facecolors="none", edgecolors=OUTLINE_COLOUR, linewidths=0.9, zorder=4
        )


def _add_polygons(axes: Axes, mesh: Mesh, cells: IndexArray, **style: Any) -> None:
    from matplotlib.collections import PolyCollection

    for corners in cell_corners(mesh, cells):
        if len(corners):
            collection = PolyCollection(corners, **style)
            collection.set_rasterized(len(corners) > VECTOR_CELLS)
            axes.add_collection(collection, autolim=False)


def label_cells(
    axes: Axes, mesh: Mesh, cells: IndexArray, window: FloatArray, text: Callable[[int], str]
) -> None:
    """Write at cells: towards the nearer side of the panel, with a line to each."""
    cells = cells[cells_in(mesh, window)[cells]]
    first = mesh.cell_offsets
    middles = np.array(
        [mesh.xy[mesh.cell_vertices[first[c] : first[c + 1]]].mean(axis=0) for c in cells]
    ).reshape(-1, 2)
    middles = np.clip(middles, window[0], window[1])  # of cells that are seen in part
    shares = np.clip((middles - window[0]) / np.ptp(window, axis=0), 0.02, 0.98)
    across = np.clip(shares[:, 0] + np.where(shares[:, 0] >= 0.5, LEADER, -LEADER), 0.015, 0.985)
    for side in (0, 1):
        here = np.flatnonzero((shares[:, 0] >= 0.5) == bool(side))
        here = here[np.argsort(-shares[here, 1], kind="stable")]
        if not len(here):
            continue
        heights = _spread(shares[here, 1])
        for k, height in zip(here.tolist(), heights, strict=True):
            axes.annotate(
                text(int(cells[k])),
                middles[k],
                (across[k], height),
                textcoords="axes fraction",
                fontsize=7,
                ha="right" if side else "left",
                va="center",
                annotation_clip=True,
                zorder=6,
                bbox={"facecolor": "white", "edgecolor": "none", "alpha": 0.85, "pad": 1.0},
                arrowprops={"arrowstyle": "-", "color": OUTLINE_COLOUR, "linewidth": 0.8},
            )


def _spread(heights: FloatArray, room: float = 0.075) -> list[float]:
    """Falling heights in a panel, kept apart by `room`."""
    found: list[float] = []
    last = 0.96 + room
    for height in heights.tolist():
        last = min(height, last - room)
        found.append(last)
    lift = max(0.0, 0.04 - found[-1])
    return [min(height + lift, 0.96 - k * room) for k, height in enumerate(found)]


def mark_staying(axes: Axes, mesh: Mesh, staying: BoolArray, window: FloatArray) -> None:
    """Mark the vertices in a window that stay where they are."""
    seen = staying & (mesh.xy >= window[0]).all(axis=1) & (mesh.xy <= window[1]).all(axis=1)
    x, y = mesh.xy[seen].T
    axes.scatter(x, y, s=9, marker="s", color="#000000", linewidths=0.0, zorder=5)


def draw_nets(axes: Axes, meshes: tuple[Mesh, Mesh], window: FloatArray) -> None:
    """Draw the edges of two meshes over each other."""
    from matplotlib.collections import LineCollection

    for mesh, colour in zip(meshes, (BEFORE_COLOUR, AFTER_COLOUR), strict=True):
        cells = np.flatnonzero(cells_in(mesh, window))
        widths = line_widths(axes, quality(mesh).area[cells])
        width = float(np.median(widths)) if len(cells) else 0.0
        segments: Any = mesh.xy[edges_of(mesh, cells)]
        lines = LineCollection(
            segments, colors=colour, linewidths=max(1.6 * width, 0.12), alpha=0.85
        )
        lines.set_rasterized(len(cells) > VECTOR_CELLS)
        axes.add_collection(lines, autolim=False)


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


def save(figure: Figure, path: Path) -> None:
    """Save a figure in the format of the name's ending."""
    from matplotlib import rc_context, rcParams

    # Without a date and with ids of its own the same figure is the same file.
    with rc_context({"svg.hashsalt": "qsmooth", "path.simplify": False}):
        ending = path.suffix[1:].lower() or rcParams["savefig.format"]
        options: dict[str, Any] = {"dpi": DPI}
        if ending == "svg":
            options = {"dpi": min(DPI, INNER_DPI), "metadata": {"Date": None}}
        elif ending == "png":
            options["pil_kwargs"] = {"compress_level": COMPRESSION}
        drawn = io.BytesIO()
        figure.savefig(drawn, format=ending, **options)
    if not path.suffix:
        path = path.with_name(f"{path.name}.{ending}")
    replace_bytes(path, drawn.getvalue())
