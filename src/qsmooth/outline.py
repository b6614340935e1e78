"""The lines that vertices may slide along: the boundary, and lines between regions, as chains."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from qsmooth._types import BoolArray, FloatArray, IndexArray
from qsmooth.curves import Curve, Projection, line_of
from qsmooth.io.file_content import FileContent
from qsmooth.mesh import Mesh
from qsmooth.topology import Topology


@dataclass(frozen=True)
class Chains:
    """Chains of vertices, from one that stays to another, and the lines that they slide along.

    Attributes
    ----------
    vertices, offsets : (n_entries,), (n_chains + 1,)
        Vertices of each chain; all but the first and the last of each slide.
    on_boundary : (n_chains,)
        Whether a chain is one of the boundary.
    nodes : (n_nodes, 2)
        Places that the segments of the lines join, chain by chain.
    segments, fractions : (n_entries,)
        Place of each vertex: on the way from this node to the next, by this share of it; that of
        the last of a chain is 1.
    off : (n_entries,)
        Whether a vertex is beside its line, whose nearest place that is.
    follows : (n_chains,)
        Whether a line is part of a curve that was given.
    project
        What gives places on that curve, if it is a function.
    n_unused
        Curves given that no chain follows.
    n_on_lines, n_given
        Vertices on the lines asked for; and those of them that the caller keeps where they are.
    """

    vertices: IndexArray
    offsets: IndexArray
    on_boundary: BoolArray
    nodes: FloatArray
    segments: IndexArray
    fractions: FloatArray
    off: BoolArray
    follows: BoolArray
    project: Projection | None = None
    n_unused: int = 0
    n_on_lines: int = 0
    n_given: int = 0

    @property
    def inner(self) -> IndexArray:
        """Entries of the vertices that slide."""
        marked = np.ones(self.vertices.size, np.bool_)
        marked[self.offsets[:-1]] = marked[self.offsets[1:] - 1] = False
        return np.flatnonzero(marked)

    @property
    def ends(self) -> IndexArray:
        """First and last entry of each chain, (n_chains, 2)."""
        return np.stack([self.offsets[:-1], self.offsets[1:] - 1], axis=1)

    def sliding(self, n_vertices: int) -> BoolArray:
        """Mark the vertices that slide, (n_vertices,)."""
        marked = np.zeros(n_vertices, np.bool_)
        marked[self.vertices[self.inner]] = True
        return marked


def find_chains(
    mesh: Mesh,
    may: BoolArray,
    *,
    boundary: bool,
    interfaces: bool,
    corner_angle: float,
    curve: Curve | None = None,
) -> Chains:
    """Find what can slide, and along which lines.

    A vertex slides if it lies between two edges of the boundary, or between two of the lines inside
    the mesh, and nothing else ends or begins there: no other line, no group of line cells. Of a
    loop without any vertex that stays one does: where it turns most, the first of these.

    Parameters
    ----------
    may : (n_vertices,)
        Vertices that the caller lets move.
    boundary, interfaces
        Whether vertices slide along the boundary, and along lines inside the mesh: those between
        two regions and line cells.
    corner_angle
        Degrees; where the line turns by more a vertex stays.
    curve
        What takes the place of the chains near it.
    """
    outer, inner, free = _edges(mesh)
    may = may & ~mesh.topology.given_fixed
    free &= may
    found: list[tuple[bool, IndexArray]] = []
    at_outer, at_inner = _degrees(outer, mesh), _degrees(inner, mesh)
    on_lines = np.zeros(mesh.n_vertices, np.bool_)
    if boundary:
        on_lines |= at_outer > 0
        found += [(True, c) for c in _walk(mesh.xy, outer, free & (at_inner == 0), corner_angle)]
    if interfaces:
        on_lines |= at_inner > 0
        found += [(False, c) for c in _walk(mesh.xy, inner, free & (at_outer == 0), corner_angle)]
    each = [line_of(mesh.xy[chain], curve) for _, chain in found]
    lines, which = [line for line, _ in each], [k for _, k in each]
    starts = np.cumsum([0, *(len(line[0]) for line in lines)])
    listed = [] if curve is None or callable(curve) else curve
    return Chains(
        vertices=_joined([chain for _, chain in found], np.int64),
        offsets=np.cumsum([0, *(chain.size for _, chain in found)]),
        on_boundary=np.array([on for on, _ in found], np.bool_),
        nodes=np.concatenate([np.empty((0, 2)), *(line[0] for line in lines)]),
        segments=_joined([s + line[1] for s, line in zip(starts, lines, strict=False)], np.int64),
        fractions=_joined([line[2] for line in lines], np.float64),
        off=_joined([line[3] for line in lines], np.bool_),
        follows=np.array(which, np.int64) >= 0,
        project=curve if callable(curve) else None,
        n_unused=len(set(range(len(listed))) - set(which)),
        n_on_lines=int(on_lines.sum()),
        n_given=int((on_lines & ~may).sum()),
    )


def boundary_sides(topology: Topology) -> IndexArray:
    """List the edges with one cell, as the cell has them, (n_sides, 2)."""
    return _sides(topology, np.flatnonzero(topology.twins < 0))


# ------------------------------------------------------------------------------- which


def _sides(topology: Topology, corners: IndexArray) -> IndexArray:
    offsets, vertices = topology.cells
    cells = topology.corner_cells[corners]
    following = np.where(corners + 1 < offsets[cells + 1], corners + 1, offsets[cells])
    return np.stack([vertices[corners], vertices[following]], axis=1)


def _edges(mesh: Mesh) -> tuple[IndexArray, IndexArray, BoolArray]:
    """Edges of the boundary, and of lines inside, (k, 2); and the vertices that could slide.

    These have two such edges and lie on no line cell but such, of the same groups on both sides.
    """
    topology = mesh.topology
    outer = boundary_sides(topology)
    inner = _region_edges(topology)
    groups = _line_groups(mesh)
    free = np.ones(mesh.n_vertices, np.bool_)
    if not groups:
        return outer, inner, free
    known = {_key(a, b) for a, b in outer.tolist()}
    listed = {_key(a, b): (a, b) for a, b in inner.tolist()}
    offsets, ring = topology.rings
    for a, b in groups:
        if (a, b) not in known:
            if b in ring[offsets[a] : offsets[a + 1]]:
                listed.setdefault((a, b), (a, b))
            else:
                free[[a, b]] = False
    inner = np.array([*listed.values()], np.int64).reshape(-1, 2)
    for edges in (outer, inner):
        free &= ~_group_ends(edges, groups, mesh.n_vertices)
    return outer, inner, free


def _region_edges(topology: Topology) -> IndexArray:
    """List the edges between two regions once, (k, 2)."""
    if topology.regions is None:
        return np.empty((0, 2), np.int64)
    twins = topology.twins
    region = topology.regions[topology.corner_cells]
    between = (twins > np.arange(twins.size)) & (region != region[twins])
    return _sides(topology, np.flatnonzero(between))


def _line_groups(mesh: Mesh) -> dict[tuple[int, int], set[int]]:
    """For each edge that is a line cell the groups of the file that it belongs to."""
    groups: dict[tuple[int, int], set[int]] = {}
    parts: list[tuple[IndexArray, Any]] = [(mesh.topology.lines, None)]
    if isinstance(mesh.source, FileContent):
        parts += list(mesh.source.of_type("line"))
    for cells, tags in parts:
        marks = [0] * len(cells) if tags is None else np.asarray(tags).tolist()
        for (a, b), mark in zip(np.asarray(cells).tolist(), marks, strict=True):
            groups.setdefault(_key(a, b), set()).add(mark)
    return groups


def _group_ends(
    edges: IndexArray, groups: dict[tuple[int, int], set[int]], n_vertices: int
) -> BoolArray:
    """Mark the vertices where edges of different groups meet, (n_vertices,)."""
    ends = np.zeros(n_vertices, np.bool_)
    at: dict[int, set[int] | None] = {}
    for a, b in edges.tolist():
        own = groups.get(_key(a, b))
        for v in (a, b):
            if at.setdefault(v, own) != own:
                ends[v] = True
    return ends


def _degrees(edges: IndexArray, mesh: Mesh) -> IndexArray:
    return np.bincount(edges.ravel(), minlength=mesh.n_vertices)


def _key(a: int, b: int) -> tuple[int, int]:
    return (a, b) if a < b else (b, a)


def _joined(parts: list[Any], kind: Any) -> Any:
    return np.concatenate([np.empty(0, kind), *parts]).astype(kind)


# ------------------------------------------------------------------------------- chains


def _walk(
    xy: FloatArray, edges: IndexArray, free: BoolArray, corner_angle: float
) -> Iterator[IndexArray]:
    """Follow the edges from each vertex that stays to the next, over those that slide."""
    n = len(xy)
    half = np.concatenate([edges, edges[:, ::-1]])
    order = np.argsort(half[:, 0], kind="stable")
    degree = np.bincount(half[:, 0], minlength=n)
    first = np.cumsum(degree) - degree
    free = free & (degree == 2)
    at = np.flatnonzero(free)
    beside = np.full((n, 2), -1)
    for k in range(2):
        beside[at, k] = half[order[first[at] + k], 1]
    turn = np.zeros(n)
    turn[at] = _turns(xy, beside[at, 0], at, beside[at, 1])
    free &= turn <= corner_angle
    done = ~free
    near = beside.tolist()

    def follow(a: int, b: int) -> IndexArray:
        chain = [a, b]
        while free[chain[-1]]:
            done[chain[-1]] = True
            p, q = near[chain[-1]]
            chain.append(q if p == chain[-2] else p)
        return np.array(chain)

    for a, b in half[~free[half[:, 0]] & free[half[:, 1]]].tolist():
        if not done[b]:
            yield follow(a, b)
    for v in np.flatnonzero(free).tolist():
        if not done[v]:
            seam = _seam(v, near, turn)
            free[seam] = False
            done[seam] = True
            yield follow(seam, near[seam][1] if _runs(edges, seam, near) else near[seam][0])


def _seam(start: int, near: list[list[int]], turn: FloatArray) -> int:
    """Choose the vertex of a loop that stays: where it turns most, the first of these."""
    loop, v = [start], near[start][0]
    while v != start:
        p, q = near[v]
        loop, v = [*loop, v], (q if p == loop[-1] else p)
    most = max(turn[loop])
    return min(v for v in loop if turn[v] == most)


def _runs(edges: IndexArray, v: int, near: list[list[int]]) -> bool:
    """Whether the second of a vertex's neighbours is the one that its edge leads to."""
    leading = edges[edges[:, 0] == v, 1]
    return leading.size == 0 or int(leading[0]) == near[v][1]


def _turns(xy: FloatArray, a: IndexArray, v: IndexArray, b: IndexArray) -> FloatArray:
    """By how much the way from a over v to b turns, degrees."""
    u, w = xy[v] - xy[a], xy[b] - xy[v]
    cross = u[:, 0] * w[:, 1] - u[:, 1] * w[:, 0]
    return np.asarray(np.abs(np.degrees(np.arctan2(cross, (u * w).sum(axis=1)))))
