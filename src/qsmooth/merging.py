"""Seams: edges of the boundary that lie on one another, as of blocks that were never joined.

Vertices on a seam are boundary vertices, which do not move; welded they are vertices like others.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from qsmooth._types import BoolArray, FloatArray, IndexArray
from qsmooth._words import plural
from qsmooth.adapters import as_mesh
from qsmooth.errors import MeshError
from qsmooth.io.file_content import FileContent
from qsmooth.mesh import Mesh
from qsmooth.options import is_number

# As a share of the shortest edge: far above the rounding of coordinates, in any unit, and far
# below what anybody models.
TOLERANCE = 1e-9
# Ends that are farther apart could be those of edges that merely lie side by side; lengths of edges
# that coincide then differ by less than a factor of two, which the bins rely on.
MOST = 0.25
# So many of those that share a bin are compared: more than two edges at one place cannot be joined.
NEIGHBOURS = 8


@dataclass(frozen=True)
class Seams:
    """Edges of the boundary that lie on another, of another cell that is on their other side.

    Attributes
    ----------
    edges : (k, 2, 2)
        Vertex ids of both edges of each pair: the first from tail to head as its cell runs, the
        second turned, so that ``edges[:, 0, i]`` is to be one with ``edges[:, 1, i]``.
    n_vertices
        Count of the mesh's vertices.
    """

    edges: IndexArray
    n_vertices: int

    @property
    def n_edges(self) -> int:
        """Count of the pairs."""
        return len(self.edges)

    @cached_property
    def one_with(self) -> IndexArray:
        """The lowest id among those that each vertex is one with, (n_vertices,)."""
        found = np.arange(self.n_vertices)
        one, other = self.edges.transpose(1, 0, 2).reshape(2, -1)
        while True:
            low = np.minimum(found[one], found[other])
            new = found.copy()
            for side in (one, other):
                np.minimum.at(new, found[side], low)
                np.minimum.at(new, side, low)
            while not np.array_equal(new, new[new]):
                new = new[new]
            if np.array_equal(new, found):
                return found
            found = new

    @property
    def n_welded(self) -> int:
        """Count of the vertices that are gone once the others take their place."""
        return int((self.one_with != np.arange(self.n_vertices)).sum())

    def __str__(self) -> str:
        edges = plural(self.n_edges, "edge of the boundary lies", "edges of the boundary lie")
        return f"{edges} on {'another' if self.n_edges == 1 else 'others'}"


def merge(mesh: Any, tolerance: float = TOLERANCE) -> Mesh:
    """Weld the seams of a mesh: where edges of its boundary coincide, their vertices become one.

    Parameters
    ----------
    mesh
        A `Mesh`, a pair ``(points, cells)``, or a mesh of a library that qsmooth knows.
    tolerance
        How far vertices may be apart that become one, as a share of the shortest edge at either;
        in [0, 0.25], 0 for the same place to the bit. z of a flat mesh may differ by this share of
        its range.

    Returns
    -------
    Mesh
        The lowest vertex of each place stays, with its coordinates and data; the vertices after
        those that are gone have other numbers. Cells keep their order, regions and data, and fixed
        vertices stay fixed. This mesh itself where it has no seam. A file that it came from can't
        be written back in place: it is written anew.

    Raises
    ------
    MeshError
        If a cell would have a vertex twice or would no longer be valid, or an edge three cells.
    ValueError
        If `tolerance` is out of range.
    """
    given: Mesh = as_mesh(mesh)
    seams = find_seams(given, tolerance)
    if not seams.n_edges:
        return given
    stays = seams.one_with == np.arange(given.n_vertices)
    ids = (np.cumsum(stays) - 1)[seams.one_with]
    _refuse_degenerate(given, ids)
    try:
        merged = _renumbered(given, stays, ids)
    except MeshError as error:
        raise MeshError(f"the seams cannot be merged: {error}") from None
    _refuse_worse(given, merged, ids)
    return merged


def find_seams(mesh: Mesh, tolerance: float = TOLERANCE) -> Seams:
    """Find the edges that `merge` would join with the same arguments."""
    if not is_number(tolerance) or not 0.0 <= tolerance <= MOST:
        raise ValueError(f"tolerance must be in [0, {MOST:g}], got {tolerance!r}")
    tails, heads, cells = _boundary(mesh)
    shortest = _shortest(mesh)
    one, other = _candidates(mesh.xy[tails], mesh.xy[heads], float(tolerance))
    near = cells[one] != cells[other]
    for these, those in ((tails[one], heads[other]), (heads[one], tails[other])):
        gap = mesh.xy[these] - mesh.xy[those]
        reach = tolerance * np.minimum(shortest[these], shortest[those])
        near &= np.hypot(gap[:, 0], gap[:, 1]) <= reach
        near &= _same_value(mesh, these, those, float(tolerance))
    one, other = np.divmod(np.unique(one[near] * len(tails) + other[near]), max(len(tails), 1))
    edges = np.stack([tails[one], heads[one], heads[other], tails[other]], axis=1)
    return Seams(edges.reshape(-1, 2, 2), mesh.n_vertices)


def _boundary(mesh: Mesh) -> tuple[IndexArray, IndexArray, IndexArray]:
    """Tail, head and cell of each edge with one cell, as the cells run."""
    topology = mesh.topology
    corners = np.flatnonzero(topology.twins < 0)
    return (
        mesh.cell_vertices[corners],
        mesh.cell_vertices[_next(mesh)[corners]],
        topology.corner_cells[corners],
    )


def _next(mesh: Mesh) -> IndexArray:
    """The corner after each."""
    following = np.arange(1, mesh.cell_vertices.size + 1)
    following[mesh.cell_offsets[1:] - 1] = mesh.cell_offsets[:-1]
    return following


def _shortest(mesh: Mesh) -> FloatArray:
    """Length of the shortest edge at each vertex of the boundary; infinite elsewhere."""
    tails, heads = mesh.cell_vertices, mesh.cell_vertices[_next(mesh)]
    near = mesh.is_boundary[tails] | mesh.is_boundary[heads]
    tails, heads = tails[near], heads[near]
    along = mesh.xy[heads] - mesh.xy[tails]
    lengths = np.hypot(along[:, 0], along[:, 1])
    shortest = np.full(mesh.n_vertices, np.inf)
    np.minimum.at(shortest, tails, lengths)
    np.minimum.at(shortest, heads, lengths)
    return shortest


def _same_value(mesh: Mesh, one: IndexArray, other: IndexArray, tolerance: float) -> BoolArray:
    """Whether z is the same, where it is a value: a step in the sea bed is no seam."""
    if mesh.surface != "flat" or mesh.points.shape[1] != 3:
        return np.ones(len(one), np.bool_)
    z = mesh.points[:, 2]
    same: BoolArray = np.abs(z[one] - z[other]) <= tolerance * float(np.ptp(z))
    return same


def _candidates(
    tails: FloatArray, heads: FloatArray, tolerance: float
) -> tuple[IndexArray, IndexArray]:
    """Pairs of edges whose midpoints share a bin, which those that coincide do.

    A bin is some times as wide as the edges' reach, a power of two, so that the reach of few
    touches two of them. Each edge is in bins of two widths: those that coincide may differ by one.
    """
    middle = 0.5 * tails + 0.5 * heads
    lengths = np.hypot(*(heads - tails).T)
    rounding = 8.0 * np.finfo(np.float64).eps * float(np.abs(middle).max(initial=0.0))
    reach = np.maximum(tolerance * lengths + rounding, np.finfo(np.float64).tiny)
    exponents = np.frexp(reach)[1].astype(np.int64) + 2
    edge = np.arange(len(middle))
    keys, edges = [], []
    for level in (exponents, exponents + 1):
        width = np.ldexp(1.0, level)
        (x, y), (far_x, far_y) = (
            np.floor((middle + side * reach[:, None]) / width[:, None]).astype(np.int64).T
            for side in (-1.0, 1.0)
        )
        split_x, split_y = x != far_x, y != far_y
        every = np.ones(len(edge), np.bool_)
        for p, q, touched in (
            (x, y, every),
            (far_x, y, split_x),
            (x, far_y, split_y),
            (far_x, far_y, split_x & split_y),
        ):
            keys.append(_hashed(p[touched], q[touched], level[touched]))
            edges.append(edge[touched])
    return _sharing(np.concatenate(keys), np.concatenate(edges))


def _hashed(x: IndexArray, y: IndexArray, level: IndexArray) -> npt.NDArray[np.uint64]:
    """One number for a bin; two that share it by chance are told apart by distances."""
    a, b, c = (part.astype(np.uint64) for part in (x, y, level))
    mixed: npt.NDArray[np.uint64] = (
        a * np.uint64(0x9E3779B97F4A7C15)
        ^ (b * np.uint64(0xC2B2AE3D27D4EB4F) << np.uint64(1))
        ^ c * np.uint64(0x165667B19E3779F9)
    )
    return mixed


def _sharing(keys: npt.NDArray[np.uint64], edges: IndexArray) -> tuple[IndexArray, IndexArray]:
    """Pairs of edges with the same key, the lower first."""
    order = np.argsort(keys, kind="stable")
    keys, edges = keys[order], edges[order]
    found = [np.empty((2, 0), np.int64)]
    for k in range(1, min(NEIGHBOURS, len(keys))):
        same = np.flatnonzero(keys[k:] == keys[:-k])
        if not same.size:
            break
        found.append(np.stack([edges[same], edges[same + k]]))
    one, other = np.concatenate(found, axis=1)
    return np.minimum(one, other), np.maximum(one, other)


def _refuse_degenerate(mesh: Mesh, ids: IndexArray) -> None:
    first = 0
    for cells in mesh.cells:
        ordered = np.sort(ids[cells], axis=1)
        bad = (ordered[:, 1:] == ordered[:, :-1]).any(axis=1)
        if bad.any():
            row = int(np.argmax(bad))
            raise MeshError(
                f"merging would make cell {first + row} degenerate: of its vertices "
                f"{cells[row].tolist()} two would be one; a smaller tolerance keeps them apart"
            )
        first += len(cells)


def _refuse_worse(mesh: Mesh, merged: Mesh, ids: IndexArray) -> None:
    """Refuse where a vertex that took another's place spoils one of the other's cells."""
    if np.array_equal(merged.xy[ids], mesh.xy):
        return
    from qsmooth.metrics import Validity, quality

    valid, still = (quality(one).validity == Validity.VALID for one in (mesh, merged))
    lost = np.flatnonzero(valid & ~still)
    if lost.size:
        raise MeshError(
            f"merging would make {plural(lost.size, 'cell')} invalid, the first is cell {lost[0]}; "
            "a smaller tolerance keeps their vertices apart"
        )


def _renumbered(mesh: Mesh, stays: BoolArray, ids: IndexArray) -> Mesh:
    """The mesh with the vertices that stay, `ids` being their numbers by the old ones."""
    fixed = np.zeros(int(stays.sum()), np.bool_)
    fixed[ids[mesh.topology.given_fixed]] = True
    points, source = mesh.points[stays], mesh.source
    if not isinstance(source, FileContent):
        blocks = [ids[cells] for cells in mesh.cells]
        return Mesh(
            points, blocks, surface=mesh.surface, fixed=fixed, regions=mesh.regions,
            geographic=mesh.geographic,
        )  # fmt: skip
    content = replace(
        source,
        points=points,
        blocks=[(kind, ids[cells]) for kind, cells in source.blocks],
        point_data={name: np.asarray(values)[stays] for name, values in source.point_data.items()},
        point_sets={
            name: np.unique(ids[np.asarray(members)]) for name, members in source.point_sets.items()
        },
        changed=frozenset(),
        held=None if source.held is None else np.unique(ids[source.held]),
        turned=None,
        geographic=mesh.geographic,
        data=b"",
        slots=None,
        data_slots={},
        beside={},
        places=None,
        pieces=(),
    )
    return content.to_mesh(mesh.surface).with_fixed(fixed)
