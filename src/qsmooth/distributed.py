"""A mesh that lies in parts on the ranks of an MPI simulation."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from qsmooth._types import FloatArray, IndexArray
from qsmooth._words import plural
from qsmooth.checks import checked_blocks, checked_points
from qsmooth.errors import MeshError
from qsmooth.mesh import Mesh, Surface
from qsmooth.team import FIRST, Team, is_comm, team_of


class DistributedMesh:
    """The part of a mesh that this rank brings along; all ranks together have the whole.

    Vertices and cells have global numbers. What several ranks have, ghosts that is, they have
    alike. Each vertex is swept by the first rank, by number, that has it in a cell of its own: in
    one that no rank before it has.

    Parameters
    ----------
    points : (n, 2) or (n, 3)
        Coordinates of this rank's vertices; there may be none.
    cells : (m, 4) or (m, 3) integers, or a list of such arrays
        Rows of `points`, counted from 0; also none, in an array of shape (0, 4).
    vertex_ids : (n,)
        Global numbers of the vertices; those of all ranks are 0, 1, 2 ... without a gap.
    cell_ids : (m,)
        Global numbers of the cells, as listed, likewise.
    comm
        An ``mpi4py.MPI.Comm``.
    fixed : (n,) bool, or rows of `points`
        Vertices that must not move, besides those on the boundary of the whole mesh.
    regions : (m,) integers
        Region of each cell, as `Mesh` has it; on all ranks or on none.
    surface, geographic
        As in `Mesh`, on all ranks alike.

    Raises
    ------
    MeshError
        On every rank the same: what is wrong with one's part, or what does not fit together, with
        global numbers.
    """

    def __init__(
        self,
        points: npt.ArrayLike,
        cells: npt.ArrayLike | Sequence[npt.ArrayLike],
        vertex_ids: npt.ArrayLike,
        cell_ids: npt.ArrayLike,
        comm: Any,
        *,
        fixed: npt.ArrayLike | None = None,
        regions: npt.ArrayLike | None = None,
        surface: Surface = "auto",
        geographic: bool = False,
    ) -> None:
        if not is_comm(comm):
            raise TypeError(f"comm must be a communicator of mpi4py, got {comm!r}")
        self.comm = comm
        self._surface: Surface = surface
        self._geographic = geographic
        self._ids: IndexArray | None = None  # those of all ranks
        self._regions: IndexArray | None = None
        self.points: FloatArray = np.empty((0, 2))
        team = team_of(comm)

        def check() -> None:
            try:
                self._take(points, cells, vertex_ids, cell_ids, fixed, regions)
            except MeshError as error:
                raise MeshError(f"on rank {team.rank}: {error}") from None

        team.tried(check)
        self._agree(team)

    def _agree(self, team: Team) -> None:
        """Learn from the others what a rank without vertices does not know; MeshError if unlike."""
        own = (self.points.shape[1], self._regions is not None) if len(self.points) else None
        said = {other for other in team.of_all(own) if other is not None}
        if len(said) > 1:
            raise MeshError("points must have as many columns, and regions be given, on all ranks")
        if not said:
            raise MeshError("the mesh is empty: no rank has vertices")
        if own is None:
            n_columns, has_regions = said.pop()
            self.points = np.empty((0, n_columns))
            self._regions = np.empty(0, np.int64) if has_regions else None

    def _take(
        self, points: Any, cells: Any, vertex_ids: Any, cell_ids: Any, fixed: Any, regions: Any
    ) -> None:
        self.vertex_ids = _ids(vertex_ids, len(points), "vertex_ids")
        _require_finite(points, self.vertex_ids)
        self.points = checked_points(points) if len(points) else np.empty((0, 2))
        self.cells = _blocks(cells)
        n_cells = sum(len(block) for block in self.cells)
        self.cell_ids = _ids(cell_ids, n_cells, "cell_ids")
        for block in self.cells:
            if block.size and not (block.min() >= 0 and block.max() < len(self.points)):
                raise MeshError(f"cells must be rows of the {len(self.points)} points")
        self._fixed = np.zeros(len(self.points), np.bool_)
        if fixed is not None:
            try:
                self._fixed[np.asarray(fixed)] = True
            except IndexError:
                raise MeshError("fixed must be a mask or rows of points") from None
        if regions is not None:
            self._regions = np.asarray(regions, np.int64)
            if self._regions.shape != (n_cells,):
                raise MeshError(f"regions must have the shape ({n_cells},)")

    @property
    def n_vertices(self) -> int:
        """Vertices of this rank."""
        return len(self.points)

    def __repr__(self) -> str:
        n_cells = sum(len(block) for block in self.cells)
        return f"DistributedMesh({self.n_vertices} vertices and {n_cells} cells on this rank)"

    def with_points(self, points: npt.ArrayLike) -> DistributedMesh:
        """Give the same cells at other points, (n, 2) or (n, 3)."""
        return DistributedMesh(
            points,
            self.cells,
            self.vertex_ids,
            self.cell_ids,
            self.comm,
            fixed=self._fixed,
            regions=self._regions,
            surface=self._surface,
            geographic=self._geographic,
        )

    def whole(self, team: Team) -> Mesh | None:
        """Put all parts together: the mesh on the first rank, None on the others.

        All ranks call. It also tells the team which rank each vertex belongs to.

        Raises
        ------
        MeshError
            On every rank, where the parts do not fit together.
        """
        ids, counts = team.arrays_of_all(self.vertex_ids)
        rank_of_row = np.repeat(np.arange(team.size), counts)
        n = _complete(ids, "vertex")
        points = self._alike(team, ids, n, self.points, "vertex", "coordinates")
        fixed = np.zeros(n, np.bool_)
        fixed[ids[team.joined(self._fixed, counts)]] = True
        corners = np.full((len(self.cell_ids), 4), -1, np.int64)
        first = 0
        for block in self.cells:
            corners[first : first + len(block), : block.shape[1]] = self.vertex_ids[block]
            first += len(block)
        cell_ids, cell_counts = team.arrays_of_all(self.cell_ids)
        n_cells = _complete(cell_ids, "cell")
        if not n_cells:
            raise MeshError("the mesh is empty: it has no cells")
        cells = self._alike(team, cell_ids, n_cells, corners, "cell", "vertices")
        regions = None
        if self._regions is not None:
            regions = self._alike(team, cell_ids, n_cells, self._regions, "cell", "regions")
        cell_owner = np.full(n_cells, team.size)
        np.minimum.at(cell_owner, cell_ids, np.repeat(np.arange(team.size), cell_counts))
        team.owner = np.full(n, team.size)
        used = cells >= 0
        np.minimum.at(
            team.owner, cells[used], np.broadcast_to(cell_owner[:, None], cells.shape)[used]
        )
        lone = team.owner == team.size  # vertices of no cell
        team.owner[ids[lone[ids]]] = rank_of_row[lone[ids]]
        return team.tried(
            lambda: self._mesh(points, cells, fixed, regions) if team.rank == FIRST else None
        )

    def joined(self, team: Team, points: FloatArray) -> FloatArray:
        """Put the points of all ranks, in the shape of `points`, in the order of their numbers.

        Raises
        ------
        MeshError
            Where two ranks have a vertex at different places.
        """
        if self._ids is None:
            self._ids = team.arrays_of_all(self.vertex_ids)[0]
        n = int(self._ids.max()) + 1
        found: FloatArray = self._alike(team, self._ids, n, points, "vertex", "coordinates")
        return found

    def _mesh(self, points: FloatArray, cells: IndexArray, fixed: Any, regions: Any) -> Mesh:
        """Make the mesh, with cells in the order of their numbers."""
        sizes = np.where(cells[:, 3] < 0, 3, 4)
        starts = np.flatnonzero(np.diff(sizes, prepend=0))
        blocks = [
            cells[start:stop, : sizes[start]]
            for start, stop in zip(starts, [*starts[1:], len(cells)], strict=True)
        ]
        return Mesh(
            points,
            blocks,
            fixed=fixed,
            regions=regions,
            surface=self._surface,
            geographic=self._geographic,
        )

    @staticmethod
    def _alike(team: Team, ids: IndexArray, n: int, own: Any, kind: str, what: str) -> Any:
        """Sort what all ranks have by number; MeshError where two differ."""
        rows = team.arrays_of_all(own)[0]
        out = np.empty((n, *rows.shape[1:]), rows.dtype)
        out[ids] = rows
        differ = out[ids] != rows
        if differ.ndim > 1:
            differ = differ.any(axis=1)
        if differ.any():
            raise MeshError(
                f"{kind} {ids[differ].min()} has other {what} on one rank than on another"
            )
        return out


def _blocks(cells: Any) -> list[IndexArray]:
    """Check cells, of which a rank may have none."""
    array = cells if isinstance(cells, np.ndarray) else None
    if (array is not None and len(array) == 0) or (array is None and len(cells) == 0):
        return []
    if array is None and all(isinstance(b, np.ndarray) and b.ndim == 2 for b in cells):
        cells = [block for block in cells if len(block)]
    return checked_blocks(cells) if len(cells) else []


def _ids(ids: Any, n: int, name: str) -> IndexArray:
    """Check global numbers, one for each of n."""
    array = np.asarray(ids)
    if array.shape != (n,) or (n and array.dtype.kind not in "iu"):
        raise MeshError(f"{name} must be {n} integers, got {array.dtype} of shape {array.shape}")
    found = array.astype(np.int64)
    if n and found.min() < 0:
        raise MeshError(f"{name} must be 0 or more, got {found.min()}")
    unique, counts = np.unique(found, return_counts=True)
    if unique.size < n:
        raise MeshError(f"{name} has {unique[counts > 1][0]} twice")
    return found


def _require_finite(points: Any, ids: IndexArray) -> None:
    """Raise a `MeshError` that names the first vertex, by its global number, that is nowhere."""
    array = np.asarray(points)
    if array.ndim != 2 or array.dtype.kind != "f":
        return
    lost = ids[~np.isfinite(array).all(axis=1)]
    if lost.size:
        raise MeshError(
            f"{plural(lost.size, 'vertex')} {'is' if lost.size == 1 else 'are'} not finite, the "
            f"first is vertex {lost.min()}"
        )


def _complete(ids: IndexArray, kind: str) -> int:
    """Count the numbers that all ranks have together; MeshError where one is missing."""
    n = int(ids.max(initial=-1)) + 1
    if n > ids.size:
        there = np.unique(ids)
        missing = int(np.flatnonzero(np.append(there, n) != np.arange(there.size + 1))[0])
        raise MeshError(f"{kind} {missing} is on no rank")
    there = np.zeros(n, np.bool_)
    there[ids] = True
    if not there.all():
        raise MeshError(f"{kind} {int(np.argmin(there))} is on no rank")
    return n
