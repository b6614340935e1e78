"""How good a mesh is: metrics of every cell, and their summary."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from enum import IntEnum
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from qsmooth._types import FloatArray, IndexArray
from qsmooth.mesh import Mesh, MeshLike, as_mesh


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


# Metrics by name: what the best value is, and whether a larger one is better.
HIGHER_IS_BETTER = {
    "min_angle": True,
    "max_angle": False,
    "aspect_ratio": False,
    "scaled_jacobian": True,
    "shape": True,
}


@dataclass(frozen=True)
class Histogram:
    """Cells per bin of one metric.

    Attributes
    ----------
    edges
        Bin k holds values from ``edges[k]`` (included) to ``edges[k + 1]``; the last may be inf.
    counts
        Cells in each bin.
    """

    edges: tuple[float, ...]
    counts: tuple[int, ...]

    @property
    def percent(self) -> tuple[float, ...]:
        """Share of the cells in each bin, in per cent."""
        total = sum(self.counts)
        return tuple(100.0 * count / total if total else 0.0 for count in self.counts)

    @property
    def labels(self) -> tuple[str, ...]:
        """Bins in words, such as "60 to 70" and "180 and more"."""
        return tuple(
            f"{low:g} and more" if np.isinf(high) else f"{low:g} to {high:g}"
            for low, high in zip(self.edges[:-1], self.edges[1:], strict=True)
        )

    def to_dict(self) -> dict[str, Any]:
        """Plain lists, fit for JSON: bins in words, counts, per cent."""
        return {
            "bins": list(self.labels),
            "counts": list(self.counts),
            "percent": list(self.percent),
        }


@dataclass(frozen=True)
class Summary:
    """A mesh's quality in a few figures: extremes, means, histograms, validity counts.

    Angles are degrees. Means of the aspect ratio leave out cells that have an edge of no length.

    Attributes
    ----------
    size_jump
        How uniform the cells are: geometric mean over the cells of `Quality.size_jump`, 1 where
        all are alike; cells without a finite one are left out.
    worst, mean
        The worst value and the mean over the cells, by metric: ``min_angle``, ``max_angle``,
        ``aspect_ratio``, ``scaled_jacobian``, ``shape``.
    validity
        Count of cells by class name: valid, collapsed, concave, crossed, inverted.
    histograms
        By metric: ``max_angle`` by 10° up to 180° and beyond, from 60° where there are triangles
        and from 90° else; ``min_angle`` by 10°; ``aspect_ratio`` by 2.
    """

    n_vertices: int
    n_quads: int
    n_triangles: int
    area: float
    size_jump: float
    worst: dict[str, float]
    mean: dict[str, float]
    validity: dict[str, int]
    histograms: dict[str, Histogram] = field(repr=False)

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
            "size_jump": _finite(self.size_jump),
            "worst": {name: _finite(value) for name, value in self.worst.items()},
            "mean": {name: _finite(value) for name, value in self.mean.items()},
            "validity": dict(self.validity),
            "histograms": {name: h.to_dict() for name, h in self.histograms.items()},
        }

    def __str__(self) -> str:
        from qsmooth.report import summary_text

        return summary_text(self)


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
        Every metric of these cells, by name.
    """

    metric: str
    cells: IndexArray
    centres: FloatArray
    values: dict[str, FloatArray]

    def to_dict(self) -> list[dict[str, Any]]:
        """One plain dict a cell, fit for JSON."""
        return [
            {
                "cell": int(cell),
                "centre": self.centres[k].tolist(),
                **{name: _finite(float(values[k])) for name, values in self.values.items()},
            }
            for k, cell in enumerate(self.cells)
        ]


class Quality:
    """Metrics of every cell of a mesh, in cell order; each is computed when first asked for.

    Angles are measured on the left of a cell's boundary as the mesh runs, so that a concave corner
    has more than 180°. On valid cells angles, `scaled_jacobian`, `shape` and `area` agree with
    VTK's verdict; on others verdict measures angles up to 180° only, and has no sign in triangles.
    `aspect_ratio` is the ratio of edges, verdict's ``edge_ratio``, and none of the other aspect
    ratios in the literature.
    """

    def __init__(self, mesh: Mesh) -> None:
        self._mesh = mesh
        self._arguments = mesh.xy, mesh.cell_offsets, mesh.cell_vertices

    def __repr__(self) -> str:
        return f"Quality of {self._mesh!r}"

    @cached_property
    def _angles(self) -> tuple[FloatArray, FloatArray]:
        from qsmooth.kernels.cell_metrics import angles

        smallest, largest = np.empty(self._mesh.n_cells), np.empty(self._mesh.n_cells)
        angles(*self._arguments, smallest, largest)
        return smallest, largest

    def _measure(self, name: str) -> FloatArray:
        from qsmooth.kernels import cell_metrics

        out = np.empty(self._mesh.n_cells)
        getattr(cell_metrics, name)(*self._arguments, out)
        return out

    @property
    def min_angle(self) -> FloatArray:
        """Smallest interior angle of each cell, degrees in [0, 360), (n_cells,)."""
        return self._angles[0]

    @property
    def max_angle(self) -> FloatArray:
        """Largest interior angle of each cell, degrees in [0, 360), (n_cells,)."""
        return self._angles[1]

    @cached_property
    def extreme_angles(self) -> tuple[float, float]:
        """Smallest and largest angle of the mesh, degrees; quicker than by way of all cells'."""
        from qsmooth.kernels.cell_metrics import angles, diamond_angles

        smallest, largest = np.empty(self._mesh.n_cells), np.empty(self._mesh.n_cells)
        diamond_angles(*self._arguments, smallest, largest)
        xy, offsets, vertices = self._arguments
        low, high = np.empty(2), np.empty(2)
        two = [int(np.argmin(smallest)), int(np.argmax(largest))]
        corners = [vertices[offsets[c] : offsets[c + 1]] for c in two]
        sizes = np.cumsum([0, *map(len, corners)])
        angles(xy, sizes, np.concatenate(corners), low, high)
        return float(low[0]), float(high[1])

    @cached_property
    def aspect_ratio(self) -> FloatArray:
        """Longest over shortest edge of each cell, infinite where an edge has no length."""
        return self._measure("aspect_ratio")

    @cached_property
    def scaled_jacobian(self) -> FloatArray:
        """Sine of each cell's worst corner, in triangles over that of 60°; 1 is ideal.

        0 where an edge has no length, below 0 where a corner is not convex. P. M. Knupp, 2001.
        """
        return self._measure("scaled_jacobian")

    @cached_property
    def shape(self) -> FloatArray:
        """Mean ratio of each cell's worst corner; 1 is ideal, 0 a cell that is not valid.

        The "shape" of VTK's verdict; P. M. Knupp, 2003.
        """
        return self._measure("shape")

    @cached_property
    def area(self) -> FloatArray:
        """Signed area of each cell, in the square of the unit; negative where turned."""
        return self._measure("area")

    @cached_property
    def size_jump(self) -> FloatArray:
        """Largest ratio of size between each cell and one it shares an edge with, 1 or more.

        Sizes are areas over that of the ideal cell with edges of one, so that a square and an
        equilateral triangle on its edge are alike. Neighbours are compared, and not all cells with
        their mean, as a mesh that is graded on purpose would count as uneven. NaN where a cell has
        no neighbour, infinite where an area is not positive.
        """
        from qsmooth.kernels.uniformity import size_jump

        out = np.empty(self._mesh.n_cells)
        size_jump(self.area, self._mesh.cell_offsets, *self._mesh._neighbours, out)
        return out

    @cached_property
    def validity(self) -> IndexArray:
        """Class of each cell, as `Validity`, decided in exact arithmetic."""
        from qsmooth.kernels import cell_metrics

        out = np.empty(self._mesh.n_cells, np.int64)
        cell_metrics.validity(*self._arguments, out)
        return out

    @property
    def n_invalid(self) -> int:
        """Count of cells that are not valid."""
        return int((self.validity != Validity.VALID).sum())

    def summary(self) -> Summary:
        """Sum up: extremes, means and histograms."""
        sizes = np.diff(self._mesh.cell_offsets)
        metrics = {name: getattr(self, name) for name in HIGHER_IS_BETTER}
        finite = self.aspect_ratio[np.isfinite(self.aspect_ratio)]
        mean = {name: float(values.mean()) for name, values in metrics.items()}
        mean["aspect_ratio"] = float(finite.mean()) if finite.size else np.inf
        classes = np.bincount(self.validity, minlength=len(Validity))
        has_triangles = bool((sizes == 3).any())
        return Summary(
            n_vertices=self._mesh.n_vertices,
            n_quads=int((sizes == 4).sum()),
            n_triangles=int((sizes == 3).sum()),
            area=float(self.area.sum()),
            size_jump=_geometric_mean(self.size_jump),
            worst={
                name: float(values.min() if HIGHER_IS_BETTER[name] else values.max())
                for name, values in metrics.items()
            },
            mean=mean,
            validity={kind.name.lower(): int(classes[kind]) for kind in Validity},
            histograms={
                "max_angle": _histogram(
                    self.max_angle,
                    np.append(np.arange(60 if has_triangles else 90, 181, 10), np.inf),
                ),
                "min_angle": _histogram(
                    self.min_angle, np.arange(0, 70 if sizes.max() == 3 else 100, 10)
                ),
                "aspect_ratio": _histogram(
                    self.aspect_ratio, np.append(np.arange(0, 21, 2), np.inf)
                ),
            },
        )

    def worst(self, k: int = 20, by: str = "scaled_jacobian") -> WorstCells:
        """List the `k` worst cells by one metric, the worst first.

        Parameters
        ----------
        k
            How many; all where the mesh has fewer.
        by
            ``min_angle``, ``max_angle``, ``aspect_ratio``, ``scaled_jacobian`` or ``shape``.

        Raises
        ------
        ValueError
            If `k` is negative or `by` is no metric.
        """
        if by not in HIGHER_IS_BETTER:
            raise ValueError(f"by must be one of {', '.join(HIGHER_IS_BETTER)}; got {by!r}")
        if k < 0:
            raise ValueError(f"k must be 0 or more, got {k}")
        values = getattr(self, by)
        badness = -values if HIGHER_IS_BETTER[by] else values
        cells = np.argsort(-badness, kind="stable")[:k]
        offsets, vertices = self._mesh.cell_offsets, self._mesh.cell_vertices
        centres = [
            self._mesh.points[vertices[offsets[c] : offsets[c + 1]]].mean(axis=0) for c in cells
        ]
        return WorstCells(
            metric=by,
            cells=cells,
            centres=np.array(centres).reshape(len(cells), self._mesh.points.shape[1]),
            values={name: getattr(self, name)[cells] for name in HIGHER_IS_BETTER},
        )


def quality(mesh: MeshLike) -> Quality:
    """Measure every cell of a mesh.

    Parameters
    ----------
    mesh
        A `Mesh`, or a pair ``(points, cells)``.

    Returns
    -------
    Quality
        Arrays per cell: ``min_angle``, ``max_angle``, ``aspect_ratio``, ``scaled_jacobian``,
        ``shape``, ``area``, ``validity``; ``n_invalid``, ``summary()`` and ``worst(k)``.

    Raises
    ------
    MeshError
        If a pair is no mesh.
    """
    return Quality(as_mesh(mesh))


def _histogram(values: FloatArray, edges: npt.NDArray[Any]) -> Histogram:
    """Count values by bin; those under the first edge or over the last count at the ends."""
    bins = np.clip(np.searchsorted(edges, values, side="right") - 1, 0, len(edges) - 2)
    counts = np.bincount(bins, minlength=len(edges) - 1)
    return Histogram(tuple(float(e) for e in edges), tuple(int(n) for n in counts))


def _geometric_mean(values: FloatArray) -> float:
    finite = values[np.isfinite(values)]
    return float(np.exp(np.log(finite).mean())) if finite.size else np.nan


def _finite(value: float) -> float | None:
    return value if np.isfinite(value) else None


@dataclass(frozen=True)
class Limits:
    """How good the angles of a mesh can get by moving vertices alone.

    Round a vertex with d cells and the angle θ between them all one of the d angles is at most
    θ / d, and one at least that. A quad has an angle of at most and one of at least 90°, a triangle
    60°. No placement of the movable vertices that keeps the mesh valid can do better.

    Attributes
    ----------
    min_angle, max_angle
        Degrees: the smallest angle can't be larger, the largest can't be smaller than this.
    min_angle_vertex, max_angle_vertex
        The vertex that sets the limit; -1 where the angle sum of a cell does.
    reached_min_angle, reached_max_angle
        The mesh's own smallest and largest angle, degrees.
    """

    min_angle: float
    max_angle: float
    min_angle_vertex: int
    max_angle_vertex: int
    reached_min_angle: float
    reached_max_angle: float

    def to_dict(self) -> dict[str, Any]:
        """Plain numbers, fit for JSON."""
        return asdict(self)

    def __str__(self) -> str:
        return "\n".join(
            [
                f"smallest angle {self.reached_min_angle:.2f}°; no placement of this connectivity "
                f"can exceed {self.min_angle:.2f}°{_set_at(self.min_angle_vertex)}",
                f"largest angle {self.reached_max_angle:.2f}°; no placement of this connectivity "
                f"can go below {self.max_angle:.2f}°{_set_at(self.max_angle_vertex)}",
            ]
        )


def limits(mesh: MeshLike, *, keep_interfaces: bool = True) -> Limits:
    """Bound the smallest and the largest angle that any placement of the vertices can have.

    Parameters
    ----------
    mesh
        A `Mesh`, or a pair ``(points, cells)``.
    keep_interfaces
        Whether vertices on the line between two regions, or on line cells of the file, stay.

    Returns
    -------
    Limits

    Raises
    ------
    MeshError
        If a pair is no mesh.

    Notes
    -----
    The bound at a vertex: between two fixed edges that follow each other round a fixed vertex the
    angle θ is given, and shared by the d cells there; round any other vertex it is 360°. In a
    valid mesh these angles add up to θ, so their mean is θ / d.
    """
    from qsmooth.kernels.angle_bounds import angle_bounds
    from qsmooth.kernels.topology import corner_cells, stars

    mesh = as_mesh(mesh)
    topology = mesh._topology
    movable = np.zeros(mesh.n_vertices, np.bool_)
    movable[topology.schedule(keep_interfaces).vertices] = True
    offsets, _, corners = stars(mesh.n_vertices, mesh.cell_offsets, mesh.cell_vertices)
    smallest, largest = np.empty(mesh.n_vertices), np.empty(mesh.n_vertices)
    angle_bounds(
        mesh.xy, mesh.cell_offsets, mesh.cell_vertices, corner_cells(mesh.cell_offsets),
        topology.twins, offsets, corners, movable, smallest, largest,
    )  # fmt: skip
    sizes = np.diff(mesh.cell_offsets)
    by_sum = 60.0 if (sizes == 3).any() else 90.0, 90.0 if (sizes == 4).any() else 60.0
    low, high = int(np.argmin(smallest)), int(np.argmax(largest))
    now = Quality(mesh)
    return Limits(
        min_angle=float(min(by_sum[0], smallest[low])),
        max_angle=float(max(by_sum[1], largest[high])),
        min_angle_vertex=low if smallest[low] < by_sum[0] else -1,
        max_angle_vertex=high if largest[high] > by_sum[1] else -1,
        reached_min_angle=float(now.min_angle.min()),
        reached_max_angle=float(now.max_angle.max()),
    )


def _set_at(vertex: int) -> str:
    return f"; set at vertex {vertex}" if vertex >= 0 else ", the mean angle of a cell"
