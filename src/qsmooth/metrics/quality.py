"""Metrics of every cell, each computed when first asked for."""

from __future__ import annotations

from collections.abc import Sequence
from enum import IntEnum
from functools import cached_property
from typing import Any

import numpy as np

from qsmooth._types import FloatArray, IndexArray
from qsmooth.adapters import to_mesh
from qsmooth.checks import read_only
from qsmooth.metrics.histogram import count_by_bins
from qsmooth.metrics.registry import METRICS, find_metric, parse_metrics, unknown
from qsmooth.metrics.summary import Summary, WorstCells
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


class Quality:
    """Metrics of every cell of a mesh, in cell order; each is computed when first asked for.

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

    def __repr__(self) -> str:
        return f"Quality of {self.topology.n_cells} cells"

    def __getitem__(self, name: str) -> FloatArray:
        if name not in self._values:
            if name not in METRICS:
                raise KeyError(unknown(name))
            self._values[name] = METRICS[name].measure(self)
        return self._values[name]

    def __getattr__(self, name: str) -> FloatArray:
        if name in METRICS:
            return self[name]
        # Python asks for names of its own, as when it copies.
        message = f"{type(self).__name__!r} object has no attribute {name!r}"
        raise AttributeError(message if name.startswith("_") else f"{message}; {unknown(name)}")

    def __dir__(self) -> list[str]:
        return sorted({*super().__dir__(), *METRICS})

    @cached_property
    def angles(self) -> tuple[FloatArray, FloatArray]:
        """Smallest and largest interior angle of each cell, degrees in [0, 360), (n_cells,)."""
        from qsmooth.kernels.cell_metrics import angles

        smallest, largest = np.empty(self.topology.n_cells), np.empty(self.topology.n_cells)
        angles(self.xy, *self.topology.cells, smallest, largest)
        return smallest, largest

    @cached_property
    def extreme_angles(self) -> tuple[float, float]:
        """Smallest and largest angle of the mesh, degrees; quicker than by way of all cells'."""
        smallest, largest = self.diamonds
        low, high = self._angles_of([int(np.argmin(smallest)), int(np.argmax(largest))])
        return float(low[0]), float(high[1])

    def low_angle(self, percent: float) -> float:
        """Percentile of the cells' smallest angles, degrees; quicker than by way of all cells'."""
        smallest, _ = self.diamonds
        place = percent / 100.0 * (smallest.size - 1)
        at = min(int(place), max(smallest.size - 2, 0))
        ends = [at, min(at + 1, smallest.size - 1)]
        low, _ = self._angles_of(np.argpartition(smallest, ends)[ends])
        return float(low[0] + (place - at) * (low[1] - low[0]))

    @cached_property
    def diamonds(self) -> tuple[FloatArray, FloatArray]:
        """What stands in for `angles` where only their order counts, 0 to 4, (n_cells,)."""
        from qsmooth.kernels.cell_metrics import diamond_angles

        smallest, largest = np.empty(self.topology.n_cells), np.empty(self.topology.n_cells)
        diamond_angles(self.xy, *self.topology.cells, smallest, largest)
        return smallest, largest

    def _angles_of(self, cells: Sequence[int] | IndexArray) -> tuple[FloatArray, FloatArray]:
        """Smallest and largest angle of these cells."""
        from qsmooth.kernels.cell_metrics import angles

        offsets, vertices = self.topology.cells
        corners = [vertices[offsets[c] : offsets[c + 1]] for c in cells]
        sizes = np.cumsum([0, *map(len, corners)])
        low, high = np.empty(len(corners)), np.empty(len(corners))
        angles(self.xy, read_only(sizes), read_only(np.concatenate(corners)), low, high)
        return low, high

    def know(
        self,
        *,
        shape: FloatArray,
        area: FloatArray,
        diamonds: tuple[FloatArray, FloatArray],
        valid: bool,
    ) -> None:
        """Take what is measured already, and whether all cells are valid; False when unsure."""
        self._values["shape"], self.area, self.diamonds = shape, area, diamonds
        if valid:
            self.validity = np.full(shape.size, Validity.VALID, np.int64)

    @cached_property
    def area(self) -> FloatArray:
        """Signed area of each cell, in the square of the unit; negative where turned."""
        from qsmooth.kernels.cell_metrics import area

        out = np.empty(self.topology.n_cells)
        area(self.xy, *self.topology.cells, out)
        return out

    @cached_property
    def validity(self) -> IndexArray:
        """Class of each cell, as `Validity`, decided in exact arithmetic."""
        from qsmooth.kernels.cell_metrics import validity

        out = np.empty(self.topology.n_cells, np.int64)
        validity(self.xy, *self.topology.cells, out)
        return out

    @property
    def n_invalid(self) -> int:
        """Count of cells that are not valid."""
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
        sizes = self.topology.cell_sizes
        kinds = np.array([sizes.min(), sizes.max()])  # all that bins depend on
        classes = np.bincount(self.validity, minlength=len(Validity))
        return Summary(
            n_vertices=self.topology.n_vertices,
            n_quads=int((sizes == 4).sum()),
            n_triangles=int((sizes == 3).sum()),
            area=float(self.area.sum()),
            worst={name: METRICS[name].worst_of(self[name]) for name in names},
            mean={name: METRICS[name].mean_of(self[name]) for name in names},
            validity={kind.name.lower(): int(classes[kind]) for kind in Validity},
            histograms={
                name: count_by_bins(METRICS[name].defined(self[name]), edges)
                for name in names
                if (edges := METRICS[name].edges_of(kinds))
            },
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


def quality(mesh: Any) -> Quality:
    """Measure every cell of a mesh.

    Parameters
    ----------
    mesh
        A `Mesh`, a pair ``(points, cells)``, or a mesh of meshio.

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
    mesh = to_mesh(mesh)
    return Quality(mesh.topology, mesh.xy, mesh.points)
