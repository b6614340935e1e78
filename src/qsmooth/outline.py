"""The lines that vertices may slide along: the boundary, and lines between regions, as chains."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np

from qsmooth._types import BoolArray, FloatArray, IndexArray
from qsmooth.io.file_content import FileContent
from qsmooth.mesh import Mesh
from qsmooth.options import OptionError
from qsmooth.topology import Topology

# Places on a curve for (k, 2) places near it.
Projection: TypeAlias = Callable[[FloatArray], FloatArray]
# A curve given as polylines, or as a projection.
Curve: TypeAlias = "list[FloatArray] | Projection"

# A projection is asked for so many places an edge.
SAMPLES = 32
# A curve is that of a chain if no vertex of the chain is farther from it than this share of its
# longer edge on the chain.
NEAR = 1.0
# Distances to a curve are worked out for so many pairs at a time.
PAIRS = 1_000_000


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
    """

    vertices: IndexArray
    offsets: IndexArray
    on_boundary: BoolArray
    nodes: FloatArray
    segments: IndexArray
    fractions: FloatArray
    off: BoolArray

    @property
    def inner(self) -> IndexArray:
        """Entries of the vertices that slide."""
        marked = np.ones(self.vertices.size, np.bool_)
        marked[self.offsets[:-1]] = marked[self.offsets[1:] - 1] = False
        return np.flatnonzero(marked)

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
    free &= may & ~mesh.topology.given_fixed
    found: list[tuple[bool, IndexArray]] = []
    at_outer, at_inner = _degrees(outer, mesh), _degrees(inner, mesh)
    if boundary:
        found += [(True, c) for c in _walk(mesh.xy, outer, free & (at_inner == 0), corner_angle)]
    if interfaces:
        found += [(False, c) for c in _walk(mesh.xy, inner, free & (at_outer == 0), corner_angle)]
    lines = [_line(mesh.xy[chain], curve) for _, chain in found]
    starts = np.cumsum([0, *(len(line[0]) for line in lines)])
    return Chains(
        vertices=_joined([chain for _, chain in found], np.int64),
        offsets=np.cumsum([0, *(chain.size for _, chain in found)]),
        on_boundary=np.array([on for on, _ in found], np.bool_),
        nodes=np.concatenate([np.empty((0, 2)), *(line[0] for line in lines)]),
        segments=_joined([s + line[1] for s, line in zip(starts, lines, strict=False)], np.int64),
        fractions=_joined([line[2] for line in lines], np.float64),
        off=_joined([line[3] for line in lines], np.bool_),
    )


def boundary_sides(topology: Topology) -> IndexArray:
    """List the edges with one cell, as the cell has them, (n_sides, 2)."""
    return _sides(topology, np.flatnonzero(topology.twins < 0))


def parse_curve(text: str) -> list[FloatArray]:
    """Read curves from a file: a line of x and y for each place, an empty line between two curves.

    Raises
    ------
    OptionError
        If there is no such file, or something else in it.
    """
    try:
        blocks = Path(text).read_text(encoding="utf-8").replace(",", " ").split("\n\n")
        curves = [
            np.array([[float(word) for word in row.split()] for row in block.splitlines() if row])
            for block in blocks
            if block.strip()
        ]
    except (OSError, UnicodeDecodeError) as error:
        raise OptionError(f"`curve` can't be read from {text}: {error}") from None
    except ValueError as error:
        raise OptionError(f"`curve` takes a file of lines x y; in {text}: {error}") from None
    return checked_curve(curves)  # type: ignore[return-value]


def checked_curve(curve: Any) -> Curve:
    """Take what a caller gives as curve: an array (k, 2), a list of such, or a function.

    Raises
    ------
    OptionError
        If it is none of these.
    """
    if callable(curve):
        return curve  # type: ignore[no-any-return]
    listed = list(curve) if isinstance(curve, (list, tuple)) else [curve]
    if listed and np.ndim(listed[0]) == 1:
        listed = [curve]
    try:
        curves = [np.array(one, dtype=np.float64) for one in listed]
    except (TypeError, ValueError):
        curves = []
    good = [one.ndim == 2 and one.shape[1] == 2 and len(one) > 1 for one in curves]
    if not curves or not all(good) or not all(np.isfinite(one).all() for one in curves):
        raise OptionError(
            "`curve` takes places (k, 2), finite and two at least, a list of such arrays, or a "
            "function that projects (k, 2) places"
        )
    return curves


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
    known = {_key(a, b) for a, b in outer.tolist()}
    listed = {_key(a, b): (a, b) for a, b in inner.tolist()}
    free = np.ones(mesh.n_vertices, np.bool_)
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
    if not groups:
        return ends
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


# ------------------------------------------------------------------------------- lines

# Nodes of a line; and of each vertex of the chain its segment, fraction, and whether it is off.
Line: TypeAlias = tuple[FloatArray, IndexArray, FloatArray, BoolArray]


def _line(places: FloatArray, curve: Curve | None) -> Line:
    """Give the line that a chain at these places, (m, 2), slides along."""
    if callable(curve):
        return _sampled(places, curve)
    for one in curve or []:
        line = _on_curve(places, one)
        if line is not None:
            return line
    return _with_end(places, np.arange(len(places)), np.zeros(len(places), np.bool_))


def _with_end(nodes: FloatArray, at_nodes: IndexArray, off: BoolArray) -> Line:
    """Make a line whose chain has its vertices at nodes."""
    segments, fractions = at_nodes.copy(), np.zeros(at_nodes.size)
    segments[-1], fractions[-1] = len(nodes) - 2, 1.0
    return nodes, segments, fractions, off


def _sampled(places: FloatArray, project: Projection) -> Line:
    """Ask for places on a curve, as many for each edge."""
    shares = np.arange(SAMPLES)[:, None] / SAMPLES
    steps = np.diff(places, axis=0)
    between = places[:-1, None] + shares * steps[:, None]
    asked = np.concatenate([between.reshape(-1, 2), places[-1:]])
    nodes = np.array(project(asked.copy()), dtype=np.float64)
    if nodes.shape != asked.shape or not np.isfinite(nodes).all():
        raise OptionError(
            f"`curve` must give finite places {asked.shape} for as many, got {nodes.shape}"
        )
    at = np.arange(len(places)) * SAMPLES
    return _with_end(nodes, at, (nodes[at] != places).any(axis=1))


def _on_curve(places: FloatArray, curve: FloatArray) -> Line | None:
    """Find the stretch of a polyline that a chain follows; None if it does not follow it."""
    at, distance = _nearest(places, curve)
    edges = np.sqrt((np.diff(places, axis=0) ** 2).sum(axis=1))
    longer = np.maximum(np.r_[0.0, edges], np.r_[edges, 0.0])
    if (distance > NEAR * longer).any():
        return None
    n, closed = len(curve) - 1, bool((curve[0] == curve[-1]).all())
    steps = np.diff(at)
    if closed:
        steps = (steps + 0.5 * n) % n - 0.5 * n
    if steps.sum() < 0.0:
        return _on_curve(places, curve[::-1].copy())
    if (steps <= 0.0).any() or steps.sum() > n:
        return None
    way = at[0] + np.r_[0.0, np.cumsum(steps)]  # in segments of the curve, on and on round a loop
    first, last = int(np.floor(way[0])) + 1, int(np.ceil(way[-1])) - 1
    nodes = np.concatenate(
        [_on(curve, way[:1]), curve[np.arange(first, last + 1) % n], _on(curve, way[-1:])]
    ) if closed else np.concatenate(
        [_on(curve, way[:1]), curve[first : last + 1], _on(curve, way[-1:])]
    )  # fmt: skip
    segments = np.clip(np.floor(way).astype(np.int64) - first + 1, 0, len(nodes) - 2)
    a, d = nodes[segments], nodes[segments + 1] - nodes[segments]
    squares = (d * d).sum(axis=1)
    fractions = np.divide(((places - a) * d).sum(axis=1), squares, where=squares > 0.0,
                          out=np.zeros(len(places)))  # fmt: skip
    fractions = np.clip(fractions, 0.0, 1.0 - 2.0**-53)
    segments[0], fractions[0] = 0, 0.0
    segments[-1], fractions[-1] = len(nodes) - 2, 1.0
    return nodes, segments, fractions, np.ones(len(places), np.bool_)


def _on(curve: FloatArray, at: FloatArray) -> FloatArray:
    """Places at so many segments along a polyline, modulo its length."""
    n = len(curve) - 1
    at = np.where(at > n, at - n, at)
    k = np.minimum(at.astype(np.int64), n - 1)
    share = (at - k)[:, None]
    return np.asarray(curve[k] + share * (curve[k + 1] - curve[k]))


def _nearest(places: FloatArray, curve: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Where each place is nearest to a polyline, in segments along it, and how near."""
    a, d = curve[:-1], np.diff(curve, axis=0)
    squares = (d * d).sum(axis=1)
    at, distance = np.empty(len(places)), np.empty(len(places))
    chunk = max(1, PAIRS // len(a))
    for first in range(0, len(places), chunk):
        p = places[first : first + chunk, None]
        f = np.divide(((p - a) * d).sum(axis=2), squares, where=squares > 0.0,
                      out=np.zeros((len(p), len(a))))  # fmt: skip
        f = np.clip(f, 0.0, 1.0)
        off = ((p - (a + f[..., None] * d)) ** 2).sum(axis=2)
        k = off.argmin(axis=1)
        rows = np.arange(len(p))
        at[first : first + chunk] = k + f[rows, k]
        distance[first : first + chunk] = np.sqrt(off[rows, k])
    return at, distance
