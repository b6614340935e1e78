"""What a mesh consists of, and what is odd about it: the facts behind ``qsmooth info``."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from qsmooth._types import IndexArray
from qsmooth._words import plural
from qsmooth.adapters import as_mesh
from qsmooth.geographic import look_like_degrees
from qsmooth.merging import find_seams
from qsmooth.mesh import Mesh
from qsmooth.metrics import Validity, quality
from qsmooth.metrics.impossible import impossible

# A vertex hangs on an edge when it is this near to it, as a fraction of the edge's length: files
# often keep no more than six or seven figures.
HANGING_TOLERANCE = 1e-6


@dataclass(frozen=True)
class Finding:
    """Something odd in a mesh.

    Attributes
    ----------
    name
        What it is: "orphan vertices", "coincident vertices", ...
    meaning
        What that means, in a few words.
    count
        How many there are.
    items
        All of them: vertex ids, cell ids or groups of ids, counted from 0.
    kind
        What an item is: "vertex", "vertices", "cell" or "part".
    """

    name: str
    meaning: str
    count: int
    items: tuple[Any, ...]
    kind: str

    def to_dict(self, n_items: int) -> dict[str, Any]:
        """Plain values, fit for JSON, with the first `n_items` items."""
        return {"count": self.count, "kind": self.kind, "first": list(self.items[:n_items])}


@dataclass(frozen=True)
class Inspection:
    """The make-up of a mesh.

    Attributes
    ----------
    n_vertices, n_quads, n_triangles, n_lines
        Counts; lines are the line cells of the file.
    n_edges, n_boundary_edges, n_boundary_loops
        Edges of the cells; those with one cell; closed loops that these form.
    n_fixed, n_interface
        Vertices that never move, and those on lines between regions.
    low, high
        Corners of the bounding box of the points.
    plane
        How the points lie: "2D", "3D, z = 5", "3D, a tilted plane", "3D, z carried along".
    n_parts
        Parts that are connected by edges.
    n_turned
        Cells that had to be turned to run counter-clockwise.
    orientation
        The same in words.
    regions
        Count of cells by region id; empty where the mesh has none.
    validity
        Count of cells by class.
    format, notes
        Format of the file, empty without one; what was odd in it and yet could be read, and that
        coordinates look like degrees where nothing says whether they are.
    findings
        What is odd, counts of zero included.
    """

    n_vertices: int
    n_quads: int
    n_triangles: int
    n_lines: int
    n_edges: int
    n_boundary_edges: int
    n_boundary_loops: int
    n_fixed: int
    n_interface: int
    low: tuple[float, ...]
    high: tuple[float, ...]
    plane: str
    n_parts: int
    n_turned: int
    orientation: str
    regions: dict[int, int]
    validity: dict[str, int]
    format: str
    notes: tuple[str, ...]
    findings: tuple[Finding, ...]

    def to_dict(self, n_items: int = 10) -> dict[str, Any]:
        """Plain values, fit for JSON; of each finding the first `n_items` items."""
        plain = dict(vars(self))
        plain["low"], plain["high"] = list(self.low), list(self.high)
        plain["notes"] = list(self.notes)
        plain["regions"] = {str(region): count for region, count in self.regions.items()}
        plain["findings"] = {f.name: f.to_dict(n_items) for f in self.findings}
        return plain


def inspect(mesh: Any) -> Inspection:
    """Say what a mesh consists of and what is odd about it.

    Parameters
    ----------
    mesh
        A `Mesh`, a pair ``(points, cells)``, or what `as_mesh` takes.

    Raises
    ------
    MeshError
        If a pair is no mesh.
    """
    from qsmooth.kernels.topology import boundary_loops

    mesh = as_mesh(mesh)
    topology = mesh.topology
    sizes = np.diff(mesh.cell_offsets)
    twins = topology.twins
    n_loops, pinched = boundary_loops(mesh.n_vertices, mesh.cell_offsets, mesh.cell_vertices, twins)
    n_boundary = int((twins < 0).sum())
    n_turned = int(topology.turned.sum())
    validity = quality(mesh).validity
    classes = np.bincount(validity, minlength=len(Validity))
    proof = impossible(topology, mesh.xy, topology.movable())
    regions: dict[int, int] = {}
    if mesh.regions is not None:
        ids, counts = np.unique(mesh.regions, return_counts=True)
        regions = dict(zip(ids.tolist(), counts.tolist(), strict=True))
    source = mesh.source
    findings = (
        _list("orphan vertices", "in no cell", np.flatnonzero(~topology.used), "vertex"),
        _coincident(mesh),
        _unmerged(mesh),
        _zero_edges(mesh),
        _hanging(mesh, twins),
        _list(
            "pinched vertices",
            "where the boundary touches itself",
            np.flatnonzero(pinched),
            "vertex",
        ),
        _parts(mesh),
        _list(
            "cells not valid",
            "collapsed, concave, crossed or inverted",
            np.flatnonzero(validity != Validity.VALID),
            "cell",
        ),
        _list(
            "doublets",
            "interior vertices with two cells, of which one can't be valid",
            np.flatnonzero(proof.doublets),
            "vertex",
        ),
        _list(
            "cells that can't be valid",
            "wherever the vertices go that may move",
            np.flatnonzero(proof.cells),
            "cell",
        ),
    )
    return Inspection(
        n_vertices=mesh.n_vertices,
        n_quads=int((sizes == 4).sum()),
        n_triangles=int((sizes == 3).sum()),
        n_lines=len(mesh.topology.lines),
        n_edges=(int(mesh.cell_offsets[-1]) + n_boundary) // 2,
        n_boundary_edges=n_boundary,
        n_boundary_loops=int(n_loops),
        n_fixed=int(mesh.is_fixed.sum()),
        n_interface=int(mesh.is_interface.sum()),
        low=tuple(float(x) for x in mesh.points.min(axis=0)),
        high=tuple(float(x) for x in mesh.points.max(axis=0)),
        plane=_plane(mesh),
        n_parts=topology.n_parts,
        n_turned=n_turned,
        orientation=_orientation(n_turned, mesh.n_cells),
        regions=regions,
        validity={kind.name.lower(): int(classes[kind]) for kind in Validity},
        format=str(getattr(source, "format", "")),
        notes=(*(str(note) for note in getattr(source, "notes", ())), *_degrees(mesh)),
        findings=findings,
    )


def _list(name: str, meaning: str, ids: IndexArray, kind: str) -> Finding:
    return Finding(name, meaning, len(ids), tuple(ids.tolist()), kind)


def _coincident(mesh: Mesh) -> Finding:
    """Vertices of cells at exactly the same place, in groups; orphans are left out."""
    ids = np.flatnonzero(mesh.topology.used)
    xy = mesh.xy[ids]
    order = np.lexsort(xy.T[::-1])
    xy, ids = xy[order], ids[order]
    starts = np.flatnonzero(np.append(True, (xy[1:] != xy[:-1]).any(axis=1)))
    sizes = np.diff(starts, append=len(ids))
    groups = [
        tuple(sorted(ids[start : start + size].tolist()))
        for start, size in zip(starts[sizes > 1], sizes[sizes > 1], strict=True)
    ]
    groups.sort()
    return Finding(
        "coincident vertices",
        "at exactly the same place as another",
        sum(len(group) - 1 for group in groups),
        tuple(groups),
        "vertices",
    )


def _unmerged(mesh: Mesh) -> Finding:
    """Seams: pairs of edges, each the ids of its four vertices."""
    seams = find_seams(mesh)
    found = sorted(tuple(pair.ravel().tolist()) for pair in seams.edges)
    return Finding(
        "unmerged edges",
        "on the boundary, at the same place as another's",
        seams.n_edges,
        tuple(found),
        "vertices",
    )


def _zero_edges(mesh: Mesh) -> Finding:
    edges = _edges(mesh, mesh.topology.twins, every=True)
    same = (mesh.xy[edges[:, 0]] == mesh.xy[edges[:, 1]]).all(axis=1)
    found = sorted({tuple(sorted(edge)) for edge in edges[same].tolist()})
    return Finding(
        "zero-length edges", "both ends at one place", len(found), tuple(found), "vertices"
    )


def _hanging(mesh: Mesh, twins: IndexArray) -> Finding:
    """Vertices in the middle of another cell's edge; both are on the boundary, as cells go."""
    from qsmooth.kernels.hanging_nodes import hanging_nodes

    edges = _edges(mesh, twins)
    vertices = np.flatnonzero(mesh.is_boundary)
    axis = int(np.argmax(np.ptp(mesh.xy[mesh.topology.used], axis=0)))
    vertices = vertices[np.argsort(mesh.xy[vertices, axis], kind="stable")]
    found = np.empty(vertices.size, np.int64)
    hanging_nodes(mesh.xy, edges, vertices, HANGING_TOLERANCE, axis, found)
    hit = np.flatnonzero(found >= 0)
    hit = hit[np.argsort(vertices[hit])]
    return Finding(
        "hanging nodes",
        "in the middle of an edge of a cell without them",
        len(hit),
        tuple(vertices[hit].tolist()),
        "vertex",
    )


def _parts(mesh: Mesh) -> Finding:
    """Parts beyond the first, which no edge joins to it; each by its first cell."""
    from qsmooth.kernels.orientation import orient_parts

    _, parts, n_parts, _ = orient_parts(mesh.cell_offsets, mesh.cell_vertices, mesh.topology.twins)
    first = np.unique(parts, return_index=True)[1]
    return Finding(
        "disconnected parts",
        "joined to the first by no edge; the first cell of each",
        int(n_parts) - 1,
        tuple(first[1:].tolist()),
        "cell",
    )


def _edges(mesh: Mesh, twins: IndexArray, *, every: bool = False) -> IndexArray:
    """Boundary edges as cells run, or every edge once, (k, 2)."""
    tails = mesh.cell_vertices
    next_corner = np.arange(1, tails.size + 1)
    next_corner[mesh.cell_offsets[1:] - 1] = mesh.cell_offsets[:-1]
    wanted = (twins < 0) | (every & (np.arange(tails.size) < twins))
    return np.stack([tails[wanted], tails[next_corner[wanted]]], axis=1)


def _plane(mesh: Mesh) -> str:
    if mesh.geographic:
        return "longitudes and latitudes; angles are true ones, lengths in metres"
    if mesh.points.shape[1] == 2:
        return "2D"
    z = mesh.points[mesh.topology.used, 2]
    if mesh.plane is not None:
        return "3D, a tilted plane"
    if z.min() == z.max():
        return f"3D, z = {z[0]:.6g}"
    if mesh.surface == "flat":
        return f"3D, z from {z.min():.6g} to {z.max():.6g} as a value"
    return f"3D, z = {z[0]:.6g} but for rounding"


def may_be_degrees(mesh: Mesh) -> bool:
    """Whether a mesh is in lengths only because nothing says that its numbers are degrees."""
    said = mesh.geographic or getattr(mesh.source, "geographic", None) is not None
    return not said and look_like_degrees(mesh.points)


def _degrees(mesh: Mesh) -> tuple[str, ...]:
    if not may_be_degrees(mesh):
        return ()
    return ("coordinates look like degrees, and are taken as lengths: geographic=True or False",)


def _orientation(n_turned: int, n_cells: int) -> str:
    if n_turned == 0:
        return "counter-clockwise"
    if n_turned == n_cells:
        return "clockwise"
    return f"mixed: {plural(n_turned, 'cell')} of {n_cells} run clockwise"
