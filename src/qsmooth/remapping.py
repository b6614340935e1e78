"""What is known on a mesh, taken over to the same cells at other places."""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from qsmooth._types import FloatArray, IndexArray
from qsmooth.adapters import as_mesh
from qsmooth.checks import read_only
from qsmooth.mesh import Mesh

# From so many places on all threads look for them.
PARALLEL_FROM = 100_000
# Bins along a side at most.
MOST_BINS = 4096.0
# An edge may sweep over this share of the smaller of its two cells in one step; and the most steps.
SWEPT, MOST_STEPS = 0.25, 100


@dataclass(frozen=True)
class Located:
    """Where places are in a mesh.

    Attributes
    ----------
    cells : (m,)
        The cell that each is in, or else is nearest to; -1 where all cells are folded.
    corners, weights : (m, 4)
        Vertices and their weights, which add up to 1.
    """

    cells: IndexArray
    corners: IndexArray
    weights: FloatArray

    def onto(self, values: FloatArray, vertices: IndexArray) -> FloatArray:
        """Values at vertices, (n_vertices, k), with those interpolated that have moved, (m,).

        A value that all corners share keeps its bits, and so does one for which there is no cell.
        """
        base = values[self.corners[:, 0]]
        found = base.copy()
        for i in range(1, 4):
            weight = self.weights[:, i, None]
            counts = weight > 0.0  # what is NaN at a corner of no weight is not asked
            found += weight * np.where(counts, values[self.corners[:, i]] - base, 0.0)
        out = values.copy()
        known = self.cells >= 0
        out[vertices[known]] = found[known]
        return out


def locate(
    mesh: Mesh, places: FloatArray, starts: IndexArray, near: FloatArray, threads: int | None = None
) -> Located:
    """Find the cell of each place, (m, 2) in the coordinates of `mesh.xy`.

    Each is walked to from the cell in `starts`, (m,). Where the mesh is folded on the way, or the
    walk ends at its boundary, all cells are looked through: of several that hold the place it is
    the one nearest to `near`, (m, 2), and where none does the nearest one.
    """
    from qsmooth.kernels import locating
    from qsmooth.kernels._jit import available_threads, use_threads

    topology, n_places = mesh.topology, len(places)
    if threads is None:
        threads = available_threads() if n_places >= PARALLEL_FROM else 1
    found = np.empty(n_places, np.int64)
    corners, weights = np.zeros((n_places, 4), np.int64), np.zeros((n_places, 4))
    with use_threads(threads):
        locating.locate(
            mesh.xy,
            topology.cells,
            topology.twins,
            topology.corner_cells,
            read_only(places),
            read_only(starts),
            found,
            corners,
            weights,
        )
        lost = np.flatnonzero(found < 0)
        if lost.size:
            others = _by_bins(mesh, places[lost], near[lost])
            found[lost], corners[lost], weights[lost] = others
    return Located(found, corners, weights)


def _by_bins(
    mesh: Mesh, places: FloatArray, near: FloatArray
) -> tuple[IndexArray, IndexArray, FloatArray]:
    """Look through all cells."""
    from qsmooth.kernels import bins as kernels

    low, span = mesh.xy.min(axis=0), np.ptp(mesh.xy, axis=0)
    size = max(float(span.max()) / MOST_BINS, float(np.sqrt(span.prod() / mesh.n_cells))) or 1.0
    while True:
        shape = int(span[0] / size) + 1, int(span[1] / size) + 1
        bins = kernels.build_bins(mesh.xy, *mesh.topology.cells, low, size, shape)
        if bins[1].size or shape == (1, 1) or not bins[0].any():
            break
        size *= 2.0
    found = np.empty(len(places), np.int64)
    corners, weights = np.zeros((len(places), 4), np.int64), np.zeros((len(places), 4))
    kernels.locate_by_bins(
        mesh.xy,
        mesh.topology.cells,
        bins,
        low,
        size,
        shape,
        read_only(places),
        read_only(near),
        found,
        corners,
        weights,
    )
    return found, corners, weights


def at_vertices(
    old: Mesh, xy: FloatArray, vertices: IndexArray, threads: int | None = None
) -> Located:
    """Where vertices of a mesh, (m,), are in it as it was, now that they are at `xy`, (m, 2)."""
    topology = old.topology
    starts = topology.star_cells[topology.star_offsets[vertices]]
    return locate(old, xy, starts, old.xy[vertices], threads)


def transfer(
    old_mesh: Any,
    new_mesh: Any,
    values: npt.ArrayLike,
    at: Literal["vertices", "cells"] = "vertices",
    conserve: bool = False,
) -> npt.NDArray[np.floating[Any]]:
    """Take values over from a mesh to the same cells at other places, as smoothing gives them.

    What is known at places does not move with the vertices. At vertices it is interpolated in the
    old cell that each has come to, linearly in triangles and bilinearly in quads: exact for linear
    functions, and vertices that have not moved keep their values to the bit. At cells the values
    are means; linear functions are fitted to each and its neighbours, so that means of linear
    functions are exact, up to cells whose neighbours all lie on a line.

    Parameters
    ----------
    old_mesh, new_mesh
        A `Mesh` each, a pair ``(points, cells)``, or what `as_mesh` takes; with the same cells.
    values : (n,) or (n, k)
        Floats, one or `k` at each vertex or each cell of the old mesh.
    at
        Whether values are those of vertices or of cells.
    conserve
        Of cells: keep the sum of value times area, to rounding. Through each edge goes what it has
        swept over, by the linear function of the cell that it has swept into. Values that were all
        the same stay so where the boundary has not moved. In other places new values may lie
        outside the range of the old ones. Both meshes must be valid.

    Returns
    -------
    array like `values`

    Raises
    ------
    ValueError
        Meshes with other cells, values of another shape, `conserve` at vertices or for a mesh with
        a cell that has no positive area.
    TypeError
        Values that are no floats.

    Notes
    -----
    L. G. Margolin, M. Shashkov, "Second-order sign-preserving conservative interpolation
    (remapping) on general grids", J. Comput. Phys. 184 (2003): swept regions, without the repair
    of signs. Where an edge would sweep over more than a quarter of a cell it goes in several
    steps, as long as cells on the way have positive areas.

    A quad that is not valid is interpolated in as two triangles, if a diagonal makes these
    positive; it is left out else, like an inverted triangle. Of several cells on top of each other
    the first on the way counts, or the one nearest to where the vertex was.
    """
    old, new = as_mesh(old_mesh), as_mesh(new_mesh)
    if at not in ("vertices", "cells"):
        raise ValueError(f"at must be 'vertices' or 'cells', got {at!r}")
    if conserve and at == "vertices":
        raise ValueError("conserve=True is for means of cells: at='cells'")
    if old.topology is not new.topology and not _same_cells(old, new):
        raise ValueError("the meshes must have the same cells")
    given = np.asarray(values)
    if given.dtype.kind != "f":
        raise TypeError(f"values must be floats, got {given.dtype}")
    n_rows = old.n_vertices if at == "vertices" else old.n_cells
    if given.ndim not in (1, 2) or len(given) != n_rows:
        raise ValueError(f"values at {at} must be ({n_rows},) or ({n_rows}, k), got {given.shape}")
    table = np.array(given, np.float64, order="C").reshape(n_rows, -1)
    if at == "vertices":
        moved = np.flatnonzero((old.xy != new.xy).any(axis=1) & old.topology.used)
        table = at_vertices(old, new.xy[moved], moved).onto(table, moved)
    elif conserve:
        table = _conserved(old, new.xy, table)
    else:
        table = _means(old, new.xy, table)
    return table.astype(given.dtype).reshape(given.shape)


def _same_cells(old: Mesh, new: Mesh) -> bool:
    return (
        old.n_vertices == new.n_vertices
        and np.array_equal(old.cell_offsets, new.cell_offsets)
        and np.array_equal(old.topology.given_vertices, new.topology.given_vertices)
    )


def _means(old: Mesh, new_xy: FloatArray, values: FloatArray) -> FloatArray:
    """Linear functions of the old cells at the new centroids."""
    centres, _ = _moments(old, old.xy)
    places, _ = _moments(old, new_xy)
    slopes = _slopes(old, centres, values)
    moved = np.flatnonzero((places != centres).any(axis=1))
    cells = locate(old, places[moved], moved, centres[moved]).cells
    moved, cells = moved[cells >= 0], cells[cells >= 0]
    out = values.copy()
    steps = (places[moved] - centres[cells])[:, None, :]
    out[moved] = values[cells] + (slopes[cells] * steps).sum(axis=2)
    return out


def _moments(mesh: Mesh, xy: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Centroids, (n_cells, 2), and areas; where an area is 0 the mean of the corners."""
    from qsmooth.kernels.swept import cell_moments

    centres, areas = np.empty((mesh.n_cells, 2)), np.empty(mesh.n_cells)
    cell_moments(read_only(xy), mesh.topology.cells, centres, areas)
    return centres, areas


def _slopes(mesh: Mesh, centres: FloatArray, values: FloatArray) -> FloatArray:
    """Slopes of the fitted linear functions, (n_cells, k, 2)."""
    from qsmooth.kernels.gradients import cell_gradients

    out = np.empty((*values.shape, 2))
    stars = mesh.star_offsets, mesh.star_cells
    cell_gradients(centres, mesh.topology.cells, stars, values, out)
    return out


def _conserved(old: Mesh, new_xy: FloatArray, values: FloatArray) -> FloatArray:
    """Move the edges in steps, and through each what it has swept over."""
    from qsmooth.kernels.swept import exchange

    topology = old.topology
    way = _way(old, new_xy)
    centres, areas = _moments(old, way[0])
    for here, there in itertools.pairwise(way):
        slopes, gained = _slopes(old, centres, values), np.empty_like(values)
        exchange(
            read_only(here),
            read_only(there),
            topology.cells,
            topology.twins,
            topology.corner_cells,
            centres,
            values,
            slopes,
            gained,
        )
        sums = areas[:, None] * values + gained
        centres, areas = _moments(old, there)
        values = sums / areas[:, None]
    return values


def _way(old: Mesh, new_xy: FloatArray) -> list[FloatArray]:
    """Coordinates step by step; in one step where cells have no area on the way."""
    from qsmooth.kernels.swept import swept_shares

    topology, areas = old.topology, _moments(old, old.xy)[1]
    if not (areas > 0.0).all() or not (_moments(old, new_xy)[1] > 0.0).all():
        raise ValueError("conserve=True is for meshes whose cells all have a positive area")
    shares = np.empty(old.n_cells)
    swept_shares(
        old.xy,
        read_only(new_xy),
        topology.cells,
        topology.twins,
        topology.corner_cells,
        areas,
        shares,
    )
    n_steps = int(min(MOST_STEPS, max(1.0, np.ceil(shares.max() / SWEPT))))
    between = [old.xy + (k / n_steps) * (new_xy - old.xy) for k in range(1, n_steps)]
    if not all((_moments(old, xy)[1] > 0.0).all() for xy in between):
        between = []
    return [old.xy, *between, new_xy]
