"""Targets that a caller asks for: the input's own, ratios of sides, metrics."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeAlias

import numpy as np
import numpy.typing as npt

from qsmooth._types import FloatArray
from qsmooth.mesh import Mesh
from qsmooth.targets.algebra import (
    ROOT3,
    SQUARE,
    of_eigenvalues,
    rectangle_corners,
    squared,
    sums,
    unit_root,
)
from qsmooth.targets.base import Targets, blocks, ideal, ideal_corners
from qsmooth.topology import Topology

# Determinant, of a tensor over its largest entry, below which rounding could decide: the root
# of this is the thinnest that cells can be asked to be, 1e-7 of their length.
SINGULAR = 1e-14
# Areas that differ from the mesh's by more powers of ten than this would overflow in the energy.
FARTHEST = 60.0

Metric: TypeAlias = "npt.ArrayLike | Callable[[FloatArray], npt.ArrayLike]"


def initial(topology: Topology, xy: FloatArray) -> Targets:
    """Ask each cell for its own size, ratio and direction, quads with right angles.

    A quad's are those of the parallelogram of its bimedians: their lengths, and the rotation that
    comes nearest to their directions (the orthogonal factor of the polar decomposition).

    Parameters
    ----------
    xy : (n_vertices, 2)
        A valid mesh; a cell without area counts as ideal, of any size.
    """
    n = topology.n_cells
    area, weight, maps = np.full(n, np.nan), np.zeros(n), np.tile(SQUARE, (n, 1))
    for size, cells, places in blocks(topology):
        p = xy[topology.cell_vertices[places]]
        if size == 4:
            u, w = p[:, 1] + p[:, 2] - p[:, 0] - p[:, 3], p[:, 2] + p[:, 3] - p[:, 0] - p[:, 1]
            u, w = 0.5 * u, 0.5 * w
        else:  # what maps the square's sides to these maps the equilateral triangle to the cell
            u, w = p[:, 1] - p[:, 0], (2.0 * p[:, 2] - p[:, 0] - p[:, 1]) / ROOT3
        det = u[:, 0] * w[:, 1] - u[:, 1] * w[:, 0]
        good = det > 0.0
        u, w, det = u[good], w[good], det[good]
        if size == 4:
            u, w = squared(u, w)
        # M = (A Aᵀ)⁻¹ with A = (u, w).
        xx, xy_, yy = (sums(u, w, i, j) for i, j in ((0, 0), (0, 1), (1, 1)))
        maps[cells[good]] = unit_root(np.stack([yy, -xy_, xx], axis=1))
        area[cells[good]] = det if size == 4 else 0.5 * ROOT3 * det
        weight[cells[good]] = 1.0
    return Targets(ideal_corners(topology), area, weight, np.zeros(n, np.bool_), "initial", maps)


def from_ratios(mesh: Mesh, ratios: npt.ArrayLike) -> Targets:
    """Ask each quad for a rectangle of a given ratio, of any size.

    Parameters
    ----------
    ratios : (n_cells,)
        Length of sides 0 (from the cell's first vertex to its second) and 2 over that of sides 1
        and 3, cells and vertices in the caller's order.

    Raises
    ------
    ValueError
        If the mesh has triangles, or if that is no array of positive numbers, one a cell.
    """
    topology = mesh.topology
    if (topology.cell_sizes == 3).any():
        raise ValueError("target: ratios of sides are for meshes of quads only")
    array = _numbers(ratios, "ratios")
    if array.shape != (topology.n_cells,):
        raise ValueError(
            f"target: ratios must have the shape ({topology.n_cells},), got {array.shape}"
        )
    if not (np.isfinite(array) & (array > 0.0)).all():
        bad = int(np.argmin(np.isfinite(array) & (array > 0.0)))
        raise ValueError(f"target: ratios must be positive, got {array[bad]} for cell {bad}")
    # A turned cell keeps its first corner: the caller's side 0 is its side 3.
    ratio = np.where(topology.turned, 1.0 / array, array)
    corners = rectangle_corners(np.log(ratio)).reshape(-1, 3)
    return ideal(topology)._replace(corners=corners, kind="ratios")


def from_metric(mesh: Mesh, metric: Metric, xy: FloatArray | None = None) -> Targets:
    """Ask for cells of size one in a metric: eᵀ M e = 1 for an edge e that is as long as is meant.

    Parameters
    ----------
    metric
        Symmetric, positive definite tensors M in 1/length², (n_vertices, 2, 2), in the axes of
        `mesh.xy`, which are averaged over the corners of each cell in logarithms; or a function of
        places, (k, 2) → (k, 2, 2), called with the middles of the cells.
    xy : (n_vertices, 2), optional
        Where the vertices are now, for a function: once they have moved it is to be asked again.

    Raises
    ------
    ValueError
        If there is not one such tensor for each. What the function raises gets a note that says
        what it was called for.
    """
    topology = mesh.topology
    xy = mesh.xy if xy is None else xy
    count = topology.cell_sizes[:, None]
    if callable(metric):
        middles = np.add.reduceat(xy[topology.cell_vertices], topology.cell_offsets[:-1]) / count
        tensors = _checked_tensors(_asked(metric, middles), topology.n_cells, by_function=True)
    else:
        at_vertices = _checked_tensors(metric, topology.n_vertices)
        logs = of_eigenvalues(at_vertices, np.log)[topology.cell_vertices]
        means = np.add.reduceat(logs, topology.cell_offsets[:-1]) / count
        tensors = of_eigenvalues(means, np.exp)
    # Of tensors over their largest entry: a determinant of their own may overflow.
    largest = np.abs(tensors).max(axis=1)
    tensors = tensors / largest[:, None]
    det = tensors[:, 0] * tensors[:, 2] - tensors[:, 1] ** 2
    shape = np.where(topology.cell_sizes == 3, 0.5 * ROOT3, 1.0)
    area = shape / (largest * np.sqrt(det))
    n = topology.n_cells
    far = ~(np.abs(np.log10(area) - 2.0 * np.log10(np.ptp(xy, axis=0).max())) < FARTHEST)
    if far.any():
        raise ValueError(
            f"target: the metric asks cell {int(np.argmax(far))} for an area of "
            f"{area[np.argmax(far)]:.3g}, which is out of all proportion to the mesh"
        )
    return Targets(
        corners=ideal_corners(topology),
        area=area,
        size_weight=np.ones(n),
        is_layer=np.zeros(n, np.bool_),
        kind="metric",
        maps=unit_root(tensors),
    )


def _asked(metric: Callable[[FloatArray], npt.ArrayLike], places: FloatArray) -> npt.ArrayLike:
    try:
        return metric(places)
    except Exception as error:
        error.add_note(
            f"raised by the function given as target, for {len(places)} places, an array "
            f"{places.shape}"
        )
        raise


def _numbers(values: npt.ArrayLike, what: str) -> FloatArray:
    try:
        array = np.array(values)
        if np.iscomplexobj(array):
            raise TypeError("they are complex")
        return array.astype(np.float64)
    except (TypeError, ValueError) as error:
        raise ValueError(f"target: {what} must be real numbers: {error}") from None


def _checked_tensors(values: npt.ArrayLike, n: int, *, by_function: bool = False) -> FloatArray:
    """Take tensors, (n, 2, 2), as xx, xy, yy, (n, 3); ValueError where they are no metrics."""
    whose = "metric tensors of the function" if by_function else "metric tensors"
    one, many = ("cell", "cells") if by_function else ("vertex", "vertices")
    m = _numbers(values, whose)
    if m.shape != (n, 2, 2):
        raise ValueError(
            f"target: {whose} must be one for each of {n} {many}, ({n}, 2, 2), got {m.shape}"
        )
    sizes = np.abs(m).max(axis=(1, 2))
    is_finite = np.isfinite(sizes)
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        scaled = m / sizes[:, None, None]
        symmetric = np.abs(scaled[:, 0, 1] - scaled[:, 1, 0]) <= 1e-9
        det = scaled[:, 0, 0] * scaled[:, 1, 1] - scaled[:, 0, 1] * scaled[:, 1, 0]
        definite = (scaled[:, 0, 0] > 0.0) & (det > SINGULAR)
    for good, what in (
        (is_finite, "finite"),
        (symmetric | (sizes == 0.0), "symmetric"),
        (definite, "positive definite"),
    ):
        if not good.all():
            bad = int(np.argmin(good))
            raise ValueError(
                f"target: {whose} must be {what}, that of {one} {bad} is not: {m[bad].tolist()}"
            )
    return np.stack([m[:, 0, 0], 0.5 * (m[:, 0, 1] + m[:, 1, 0]), m[:, 1, 1]], axis=1)
