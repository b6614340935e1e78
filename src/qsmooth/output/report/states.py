"""States of one mesh: before, and what methods or other programs made of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from qsmooth._types import BoolArray, IndexArray
from qsmooth.errors import MeshError
from qsmooth.mesh import Mesh
from qsmooth.metrics import Quality, quality
from qsmooth.metrics.bounds import Kept, kept_by
from qsmooth.output.tables import method_title

if TYPE_CHECKING:
    from qsmooth.constraints import Freedom
    from qsmooth.result import SmoothResult


@dataclass(frozen=True)
class State:
    """A placement of the vertices.

    Attributes
    ----------
    name, label
        For links, and to be read.
    mesh, quality
        The mesh there, and its metrics.
    movable, kept
        Vertices that may move, (n_vertices,); what keeps the others, as in `Freedom`.
    result
        How it came about, where qsmooth knows.
    freedom
        Where vertices may go to, where that is known.
    """

    name: str
    label: str
    mesh: Mesh
    quality: Quality
    movable: BoolArray
    kept: tuple[Kept, ...]
    result: SmoothResult | None = None
    freedom: Freedom | None = None


def of_mesh(name: str, label: str, mesh: Mesh) -> State:
    """Take a mesh of which nothing else is known."""
    topology = mesh.topology
    kept = tuple(kept_by(topology, keep_interfaces=True))
    return State(name, label, mesh, quality(mesh), topology.movable(True), kept)


def states_of(results: Sequence[SmoothResult], names: Sequence[str] = ()) -> list[State]:
    """Put results beside what all of them started from.

    Raises
    ------
    ValueError
        If there is none, or they started from different meshes.
    """
    if not results:
        raise ValueError("a report needs at least one result")
    first = results[0]
    start = first.mesh.with_points(first.quality_before.points)
    before = _constrained(of_mesh("before", "Before", start), first.freedom)
    states = [before]
    for result, name in zip(results, names or _numbered(results), strict=True):
        same = result.mesh.n_vertices == start.n_vertices and same_cells(result.mesh, start)
        if not same or not np.array_equal(result.quality_before.points, start.points):
            raise ValueError("the results of a report must have started from the same mesh")
        label = method_title(result.method)
        label += name[len(result.method) :] if name.startswith(f"{result.method} (") else ""
        state = of_mesh(name, label if name.startswith(result.method) else name, result.mesh)
        states.append(_constrained(state, result.freedom, result))
    return states


def _constrained(state: State, freedom: Any, result: SmoothResult | None = None) -> State:
    movable, kept = state.movable, state.kept
    if freedom is not None:
        movable, kept = freedom.movable, freedom.kept
    args = state.name, state.label, state.mesh, state.quality
    return State(*args, movable, tuple(kept), result, freedom)


def _numbered(results: Sequence[SmoothResult]) -> list[str]:
    """Name results by their methods: "star", "star (2)"."""
    names: list[str] = []
    for result in results:
        count = 1 + sum(name.split(" (")[0] == result.method for name in names)
        names.append(result.method if count == 1 else f"{result.method} ({count})")
    return names


def beside(before: State, name: str, label: str, after: Mesh) -> State:
    """Put a mesh with the same cells, from elsewhere, beside the first; what moved could move.

    Raises
    ------
    MeshError
        If it has other cells, or lies elsewhere in space.
    """
    start = before.mesh
    if difference := _difference(start, after):
        raise MeshError(f"{label} does not have the cells of {before.label}: {difference}")
    moved: BoolArray = (start.points[:, :2] != after.points[:, :2]).any(axis=1)
    points = after.points
    if points.shape != start.points.shape:
        points = _with_columns(points, start.points)
    try:
        mesh = start.with_points(points)
    except MeshError as error:
        raise MeshError(f"{label} beside {before.label}: {error}") from error
    free = before.movable | (moved & start.topology.used)
    kept = tuple((words, marks & ~free) for words, marks in before.kept)
    return State(name, label, mesh, quality(mesh), free, kept)


def _with_columns(points: npt.NDArray[np.float64], like: npt.NDArray[np.float64]) -> Any:
    """Take away z, or give it that of the other mesh."""
    return points[:, :2] if like.shape[1] == 2 else np.column_stack([points, like[:, 2]])


def _difference(start: Mesh, after: Mesh) -> str:
    """Say in which way two meshes differ in their cells; "" where they don't."""
    for what, own, others in (
        ("vertices", start.n_vertices, after.n_vertices),
        ("cells", start.n_cells, after.n_cells),
    ):
        if own != others:
            return f"{others} {what} instead of {own}"
    if same_cells(start, after):
        return ""
    if not np.array_equal(start.topology.cell_sizes, after.topology.cell_sizes):
        return "triangles and quads are in another order"
    ours, theirs = canonical(start), canonical(after)
    offsets = start.cell_offsets
    where = int(np.searchsorted(offsets, np.flatnonzero(ours != theirs)[0], side="right")) - 1
    return f"cell {where} has other vertices"


def same_cells(one: Mesh, other: Mesh) -> bool:
    """Whether two meshes have the same cells in the same order, wherever each begins."""
    return one.topology is other.topology or (
        np.array_equal(one.topology.cell_sizes, other.topology.cell_sizes)
        and np.array_equal(canonical(one), canonical(other))
    )


def canonical(mesh: Mesh) -> IndexArray:
    """Corners of each cell from its smallest vertex on, towards the smaller neighbour."""
    out = np.empty_like(mesh.cell_vertices)
    sizes, first = mesh.topology.cell_sizes, mesh.cell_offsets[:-1]
    for n in (3, 4):
        places = first[sizes == n][:, None] + np.arange(n)
        corners = mesh.cell_vertices[places]
        start = corners.argmin(axis=1)[:, None]
        on = np.take_along_axis(corners, (start + np.arange(n)) % n, axis=1)
        back = np.take_along_axis(corners, (start - np.arange(n)) % n, axis=1)
        out[places] = np.where(on[:, 1:2] < on[:, -1:], on, back)
    return out
