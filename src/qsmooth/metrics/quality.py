"""Metrics of every cell, each computed when first asked for."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from enum import IntEnum
from functools import cached_property
from typing import Any
from weakref import WeakValueDictionary

import numpy as np

from qsmooth._frames import data_frame
from qsmooth._types import FloatArray, IndexArray
from qsmooth._words import plural
from qsmooth.adapters import as_mesh
from qsmooth.checks import read_only
from qsmooth.mesh import Surface
from qsmooth.metrics.histogram import count_by_bins
from qsmooth.metrics.registry import METRICS, find_metric, parse_metrics, unknown
from qsmooth.metrics.summary import Summary, WorstCells, figure_sections, size_text
from qsmooth.notebook import page, thumbnail
from qsmooth.sums import exact_mean
from qsmooth.table import Table
from qsmooth.topology import Topology


class Validity(IntEnum):
    """Class of a cell by the exact signs of its corners.

    A quad is valid with four positive corners, collapsed with a zero and no negative one, concave
    with one negative, crossed (or folded) with two or with one negative and a zero, inverted
    with three or four. A triangle is valid, collapsed or inverted.
    """

    VALID = 0
    COLLAPSED = 1
    CONCAVE = 2
    CROSSED = 3
    INVERTED = 4


# What one pass over the cells measures, in the order of the rows of `kernels.cell_figures`.
FIGURES = "min_angle", "max_angle", "aspect_ratio", "scaled_jacobian", "shape", "area"


# What is measured of a mesh, for as long as somebody holds it: it keeps the topology and the points
# that it is of, so that no others can have their identity.
_measured: WeakValueDictionary[tuple[int, int], Quality] = WeakValueDictionary()


class Quality:
    """Metrics of every cell of a mesh, in cell order; each is computed when first asked for.

    Arrays are read-only.

    ``quality(mesh)["taper"]`` and ``quality(mesh).taper`` are the same array, (n_cells,), for every
    name in `qsmooth.metrics.METRICS`, which also says what it means. NaN stands for a cell that a
    metric is not defined for: a triangle where it is about quads, a cell without a neighbour where
    it is about these. A broken cell never has NaN for that; it has the worst figure that there is.

    Angles are measured on the left of a cell's boundary as the mesh runs, so that a concave corner
    has more than 180°. On valid cells angles, `area` and the metrics that VTK's verdict has agree
    with it; on others verdict measures angles up to 180° only, and takes areas without their sign.
    `aspect_ratio` is the ratio of edges, verdict's ``edge_ratio``, and none of the other aspect
    ratios in the literature; verdict's own is `verdict_aspect_ratio`.

    Parameters
    ----------
    topology
        The cells.
    xy : (n_vertices, 2)
        Coordinates in the plane of the mesh.
    points : (n_vertices, 2) or (n_vertices, 3)
        Coordinates that places are named in; `xy` by default.
    """

    def __init__(
        self, topology: Topology, xy: FloatArray, points: FloatArray | None = None
    ) -> None:
        # Read-only, whoever has it, as kernels are compiled once more for arrays that are not.
        self.topology, self.xy = topology, read_only(xy)
        self.points = xy if points is None else points
        self._values: dict[str, FloatArray] = {}
        self._figures: dict[str, FloatArray] = {}
        # Extreme angles, in the measure of `kernels.cell_lanes`; and how many cells are not valid,
        # or not so beyond rounding: as far as they are known.
        self._extremes: tuple[float, float] | None = None
        self._doubtful: int | None = None

    def __repr__(self) -> str:
        low, high = self.extreme_angles
        return (
            f"Quality({plural(self.topology.n_cells, 'cell')}, {low:.1f}° to {high:.1f}°, "
            f"mean shape {self.mean_shape:.3f}, {self.n_invalid} not valid)"
        )

    def _repr_html_(self) -> str:
        """Show a table and a picture in a notebook."""
        summary = self.summary()
        table = Table(("",), tuple(figure_sections([summary], mark=False)))
        return page(size_text(summary), table, [self.picture()])

    def picture(self) -> str:
        """Draw the cells as a small SVG, coloured by their scaled Jacobian."""
        topology = self.topology
        worth = np.where(self.validity == Validity.VALID, self["scaled_jacobian"], -1.0)
        return thumbnail(self.xy, topology.cells, topology.twins, worth)

    def __getitem__(self, name: str) -> FloatArray:
        if name not in self._values:
            if name not in METRICS:
                raise KeyError(unknown(name))
            self._values[name] = read_only(METRICS[name].measure(self))
        return self._values[name]

    def __getattr__(self, name: str) -> FloatArray:
        if name in METRICS:
            return self[name]
        # Python asks for names of its own, as when it copies.
        message = f"{type(self).__name__!r} object has no attribute {name!r}"
        raise AttributeError(message if name.startswith("_") else f"{message}; {unknown(name)}")

    def __dir__(self) -> list[str]:
        return sorted({*super().__dir__(), *METRICS})

    def figure(self, name: str) -> FloatArray:
        """One of `FIGURES`, (n_cells,); the first measures them all, in one pass."""
        if name not in self._figures:
            self._measure()
        return self._figures[name]

    def _measure(self) -> None:
        from qsmooth.kernels.cell_figures import cell_figures
        from qsmooth.kernels.cell_lanes import n_chunks

        n_cells = self.topology.n_cells
        out, doubtful = np.empty((len(FIGURES), n_cells)), np.empty(n_chunks(n_cells))
        cell_figures(self.xy, *self.topology.cells, out, doubtful)
        self._doubtful = int(doubtful.sum())
        self._figures.update(zip(FIGURES, read_only(out), strict=True))

    def _glance(self) -> None:
        """Measure what is asked after every sweep, quicker than all figures are."""
        from qsmooth.kernels.cell_lanes import n_chunks
        from qsmooth.kernels.glance import N_COLUMNS, glance

        n_cells = self.topology.n_cells
        shape, out = np.empty(n_cells), np.empty((n_chunks(n_cells), N_COLUMNS))
        glance(self.xy, *self.topology.cells, shape, out)
        self._figures.setdefault("shape", read_only(shape))
        self._doubtful = int(out[:, 2].sum())
        # Where a coordinate is NaN its cells' shapes are, and the angles only those of the others.
        lost = 0.0 * self.mean_shape
        self._extremes = float(out[:, 0].min()) + lost, float(out[:, 1].max()) + lost

    @property
    def angles(self) -> tuple[FloatArray, FloatArray]:
        """Smallest and largest interior angle of each cell, degrees in [0, 360), (n_cells,)."""
        return self.figure("min_angle"), self.figure("max_angle")

    @property
    def area(self) -> FloatArray:
        """Signed area of each cell, in the square of the unit; negative where turned."""
        return self.figure("area")

    @cached_property
    def extreme_angles(self) -> tuple[float, float]:
        """Smallest and largest angle of the mesh, degrees; quicker than by way of all cells'."""
        if self._extremes is None:
            self._glance()
        low, high = in_degrees(self._extremes)
        return low, high

    @cached_property
    def mean_shape(self) -> float:
        """Mean of the cells' shape; quicker than by way of all figures."""
        return exact_mean(self.shape_of_glance)

    @property
    def shape_of_glance(self) -> FloatArray:
        """Shape of each cell, (n_cells,), quicker than by way of all figures."""
        if "shape" not in self._figures:
            self._glance()
        return self._figures["shape"]

    def low_angle(self, percent: float) -> float:
        """Percentile of the cells' smallest angles, degrees."""
        return percentile(self.angles[0], percent)

    def high_angle(self, percent: float) -> float:
        """Percentile of the cells' largest angles, degrees."""
        return percentile(self.angles[1], percent)

    def know_valid(self) -> None:
        """Take all cells to be valid, which is known already."""
        self._doubtful = 0

    @property
    def _all_valid(self) -> bool:
        """Whether all cells are valid beyond rounding; False when unsure."""
        if self._doubtful is None:
            self._glance()
        return self._doubtful == 0

    @cached_property
    def validity(self) -> IndexArray:
        """Class of each cell, as `Validity`, decided in exact arithmetic."""
        from qsmooth.kernels.cell_metrics import validity

        out = np.full(self.topology.n_cells, Validity.VALID, np.int64)
        if not self._all_valid:
            validity(self.xy, *self.topology.cells, out)
        return read_only(out)

    @property
    def n_invalid(self) -> int:
        """Count of cells that are not valid."""
        if "validity" not in self.__dict__ and self._all_valid:
            return 0
        return int((self.validity != Validity.VALID).sum())

    def summary(self, metrics: str | Sequence[str] | None = None) -> Summary:
        """Sum up: extremes, means and histograms.

        Parameters
        ----------
        metrics
            Names, in a sequence or with commas between, or ``"all"``; by default the short list.

        Raises
        ------
        ValueError
            If a name is no metric.
        """
        names = parse_metrics(metrics)
        area = float(self.area.sum())
        n_cells, n_quads = self.topology.n_cells, self.topology.n_quads
        kinds = np.array([4] * (n_quads > 0) + [3] * (n_cells > n_quads))  # what bins depend on
        invalid = self.validity[self.validity != Validity.VALID] if self.n_invalid else []
        classes = np.bincount(invalid, minlength=len(Validity))
        classes[Validity.VALID] = n_cells - classes.sum()
        worst, mean, histograms = {}, {}, {}
        for name in names:
            metric = METRICS[name]
            values = metric.defined(self[name])
            worst[name], mean[name] = metric.worst_of(values), metric.mean_of(values)
            if edges := metric.edges_of(kinds):
                histograms[name] = count_by_bins(values, edges)
        return Summary(
            n_vertices=self.topology.n_vertices,
            n_quads=n_quads,
            n_triangles=n_cells - n_quads,
            area=area,
            worst=worst,
            mean=mean,
            validity={kind.name.lower(): int(classes[kind]) for kind in Validity},
            histograms=histograms,
        )

    def worst(
        self,
        k: int = 20,
        by: str = "scaled_jacobian",
        metrics: str | Sequence[str] | None = None,
    ) -> WorstCells:
        """List the `k` worst cells by one metric, the worst first.

        Parameters
        ----------
        k
            How many; all that the metric is defined for where there are fewer.
        by
            Name of the metric.
        metrics
            Whose figures to give, as in `summary`; that which ranks them is always among these.

        Raises
        ------
        ValueError
            If `k` is negative, or a name is no metric.
        """
        ranking = find_metric(by, "by")
        if k < 0:
            raise ValueError(f"k must be 0 or more, got {k}")
        cells = ranking.worst_cells(self[by], k)
        offsets, vertices = self.topology.cells
        centres = [self.points[vertices[offsets[c] : offsets[c + 1]]].mean(axis=0) for c in cells]
        names = dict.fromkeys((*parse_metrics(metrics), by))
        return WorstCells(
            metric=by,
            cells=cells,
            centres=np.array(centres).reshape(len(cells), self.points.shape[1]),
            values={name: self[name][cells] for name in names},
        )

    def to_dataframe(self, metrics: str | Sequence[str] | None = None) -> Any:
        """Give a ``pandas.DataFrame`` with a row a cell: metrics, and the name of its class.

        Parameters
        ----------
        metrics
            As in `summary`.

        Raises
        ------
        ValueError
            If a name is no metric.
        ImportError
            Where there is no pandas.
        """
        classes = np.array([kind.name.lower() for kind in Validity])
        columns: dict[str, Any] = {name: self[name] for name in parse_metrics(metrics)}
        columns["validity"] = classes[self.validity]
        return data_frame(columns, np.arange(self.topology.n_cells), "cell")


def quality(mesh: Any, *, surface: Surface = "auto", geographic: bool | None = None) -> Quality:
    """Measure every cell of a mesh.

    Parameters
    ----------
    mesh
        A `Mesh`, a pair ``(points, cells)``, or what `as_mesh` takes.
    surface
        What a third coordinate means, see `Mesh`; by default what the mesh says.
    geographic
        Whether x and y are longitudes and latitudes in degrees, see `Mesh`: then angles are the
        true ones, lengths in metres. By default what the mesh says.

    Returns
    -------
    Quality
        Arrays per cell by the name of the metric, as an attribute or in brackets: ``min_angle``,
        ``max_angle``, ``aspect_ratio``, ``scaled_jacobian``, ``shape``, ``size_jump`` and those
        others in `qsmooth.metrics.METRICS`; ``area``, ``validity``; ``n_invalid``, ``summary()``
        and ``worst(k)``.

    Raises
    ------
    MeshError
        If a pair is no mesh.
    """
    mesh = as_mesh(mesh, surface=surface, geographic=geographic)
    key = id(mesh.topology), id(mesh.points)
    found = _measured.get(key)
    if found is None:
        found = _measured[key] = Quality(mesh.topology, mesh.xy, mesh.points)
    return found


def percentile(
    values: FloatArray, percent: float, unit: Callable[[list[float]], list[float]] = list
) -> float:
    """Percentile of values, between the two next to it in the unit that these are turned into."""
    place = percent / 100.0 * (values.size - 1)
    at = min(int(place), max(values.size - 2, 0))
    ends = [at, min(at + 1, values.size - 1)]
    low, high = unit(np.partition(values, ends)[ends].tolist())
    return float(low + (place - at) * (high - low))


def in_degrees(diamonds: Sequence[float] | None) -> list[float]:
    """Give angles in the measure of `kernels.cell_lanes` in degrees."""
    from qsmooth.kernels.cell_lanes import in_degrees

    out = np.array(diamonds)
    in_degrees(out)
    degrees: list[float] = out.tolist()
    return degrees
