"""Called again and again: a mesh whose tables are made once, and smoothed at every time step."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
import numpy.typing as npt

from qsmooth._types import BoolArray, FloatArray
from qsmooth.adapters import as_mesh
from qsmooth.carrying import Depths
from qsmooth.checks import checked_points
from qsmooth.constraints import Constraints
from qsmooth.errors import MeshError
from qsmooth.geographic import require_degrees
from qsmooth.mesh import Mesh, Surface
from qsmooth.methods.base import Method
from qsmooth.methods.driver import valid_in_degrees
from qsmooth.optimizer.ground import Meant
from qsmooth.optimizer.method import Optimize
from qsmooth.optimizer.reading import meant_by, reading_of
from qsmooth.optimizer.stepping import Stepper
from qsmooth.optimizer.stepping import StepRecord as StepRecord
from qsmooth.result import SmoothResult
from qsmooth.smoothing import method_of
from qsmooth.targets import Targets
from qsmooth.together import SessionOnRanks, Work, comm_of

# Sweeps that a step makes at most if nothing else is said.
STEP_SWEEPS = 3


class Smoother:
    """A mesh that is smoothed again and again while its boundary moves, as in a simulation.

    What follows from the cells is worked out once: checks, topology, colours, tables, and what
    cells are meant to be. Each call takes the points as they are now, those on the boundary and
    fixed ones among them; where these are is where they stay.

    ``smoother(points)`` is `smooth` on the mesh at those points, with all that it reports.
    ``smoother.step(points)`` is for every time step: a few sweeps in place.

    One object belongs to one thread at a time. It can be pickled; the copy makes its tables when it
    is first called, and goes on where this one is.

    Parameters
    ----------
    mesh
        A `Mesh`, a pair ``(points, cells)``, or what `as_mesh` takes. It is not changed.
    method, constraints, surface, geographic, options
        As in `smooth`, with ``comm`` among the options: then all ranks make one together, and call
        it together, with their own points of a `DistributedMesh`, or else those that the first
        rank has. What `target` says is read from this mesh; only a function of places is
        asked again by ``smoother(points)``. Which vertices and cells `fixed` and `selection` mean
        is found here, too.

    Raises
    ------
    ValueError, TypeError, MeshError
        As in `smooth`.

    Examples
    --------
    >>> smoother = Smoother((points, cells))
    >>> for time in times:
    ...     points[body] = place_of_body(time)
    ...     record = smoother.step(points)
    """

    def __init__(
        self,
        mesh: Any,
        method: str | Method = "auto",
        *,
        constraints: Constraints | None = None,
        surface: Surface = "auto",
        geographic: bool | None = None,
        **options: Any,
    ) -> None:
        self._ranks: SessionOnRanks | None = None

        def make(mesh: Any) -> Work:
            made, chosen = method_of(method, options, constraints)
            return Work(as_mesh(mesh, surface=surface, geographic=geographic), [(made, chosen)])

        if (comm := comm_of(options, method, mesh)) is None:
            work = make(mesh)
        else:
            own = options if isinstance(method, str) else method.given()
            self._ranks = SessionOnRanks(comm, mesh)
            work = self._ranks.given_out(make, own)
        self._mesh, ((self._given, self._chosen),) = work.mesh, work.methods
        self._method = self._given.resolved(self._mesh)
        self._begin()

    def _begin(self) -> None:
        self._lock = threading.Lock()
        self._tables: _Tables | None = None
        self._meant: Meant | None = None
        self._aim: Targets | None = None
        self._state: tuple[Any, ...] | None = None

    def __repr__(self) -> str:
        return f"Smoother({self._mesh!r}, {self._method.name!r})"

    @property
    def mesh(self) -> Mesh:
        """The mesh that it was made of."""
        return self._mesh

    @property
    def method(self) -> Method:
        """The method with its options, as given."""
        return self._given

    def __call__(self, points: npt.ArrayLike) -> SmoothResult:
        """Smooth the mesh at these points, as `smooth` does, and report.

        Parameters
        ----------
        points
            Coordinates in the shape of `mesh.points`; they are not changed.

        Raises
        ------
        MeshError
            Another shape, coordinates that are not finite, or points outside the mesh's plane.
        RuntimeError
            If it is at work already, in another thread or in its own callback.
        """
        if self._ranks is not None:
            result: Any = self._whole(self._ranks.whole(points))
            return self._ranks.part(result)  # type: ignore[no-any-return]
        return self._whole(points)

    def _whole(self, points: npt.ArrayLike) -> SmoothResult:
        """As a call, of the whole mesh."""
        with self._alone():
            mesh = self._mesh.with_points(points)
            if isinstance(self._method, Optimize) and not callable(self._method.target):
                return self._method.smooth(mesh, self._chosen, self._read())
            return self._method.smooth(mesh, self._chosen)

    def step(
        self, points: FloatArray, out: FloatArray | None = None, *, max_sweeps: int = STEP_SWEEPS
    ) -> StepRecord:
        """Go to these points, and smooth a little: a few sweeps over what does not rest.

        What rested after the last step, and whose surroundings are where it left them, is not
        visited. Where boundary and fixed points go on as in the step before, the others follow
        first, if that costs no corner. Cells that are not valid then are untangled, near them
        alone; after that no cell is made invalid, and with the usual guards no angle worse than
        the worst of the mesh.

        What the host puts on the boundary, or fixes, stays there, unless ``boundary="slide"`` or
        ``interfaces="slide"`` lets it slide: along `curve`, or else along the outline as the host
        last gave it. That is the outline of this call where it has moved a vertex of it since the
        step before, and corners are what turns there by more than `corner_angle`. z of a flat mesh
        is interpolated in the mesh as it was given, where vertices have moved (`carry`).

        After the first step no memory is asked for that grows with the mesh, unless cells are to
        be untangled, `hold` is given, cells are ranked by quality, or a vertex whose z is
        interpolated has come to a place that is in no cell.

        Parameters
        ----------
        points : shape of `mesh.points`, float64
            Where the vertices are now.
        out : the same
            Overwritten with where they are to be; `points` by default.
        max_sweeps
            Sweeps at most; fewer are made where all vertices rest before.

        Returns
        -------
        StepRecord
            Whether the mesh is valid, its smallest scaled Jacobian, sweeps.

        Raises
        ------
        MeshError
            Another shape, coordinates that are not finite, or points outside the mesh's plane;
            nothing is changed then.
        TypeError
            If what is to be overwritten is no array of float64.
        RuntimeError
            As of a call.
        """
        if self._ranks is not None:
            return self._ranks.step(self._step, points, out, max_sweeps)
        return self._step(points, out, max_sweeps)

    def _step(self, points: FloatArray, out: FloatArray | None, max_sweeps: int) -> StepRecord:
        """As `step`, of the whole mesh."""
        out = points if out is None else out
        _require_writable(out)
        if max_sweeps < 0:
            raise ValueError(f"max_sweeps must be 0 or more, got {max_sweeps}")
        with self._alone():
            if np.shape(points) != self._mesh.points.shape or np.shape(out) != np.shape(points):
                raise MeshError(
                    f"points must have the shape {self._mesh.points.shape}, got "
                    f"{np.shape(points)}" + ("" if out is points else f" and {np.shape(out)}")
                )
            if self._tables is None:
                self._tables = self._make_tables()
            most = min(max_sweeps, self._method.max_sweeps)
            try:
                return self._tables.step(points, out, most)
            except MeshError:
                raise
            except BaseException:
                self._tables = None  # it may have stopped half-way
                raise

    def _make_tables(self) -> _Tables:
        if isinstance(self._method, Optimize) and self._aim is None:
            self._aim = reading_of(self._method, self._mesh, self._read())
        tables = _Tables(self._method, self._mesh, self._aim)
        if self._state is not None:
            tables.stepper.restore(self._state)
            self._state = None
        return tables

    def _read(self) -> Meant:
        """What cells are meant to be; read from the mesh when first asked for."""
        if self._meant is None:
            assert isinstance(self._method, Optimize)
            self._meant = meant_by(self._method, self._mesh)
        return self._meant

    @contextmanager
    def _alone(self) -> Iterator[None]:
        if not self._lock.acquire(blocking=False):
            raise RuntimeError(
                "this Smoother is at work already, in another thread or in its own callback: make "
                "one for each thread"
            )
        try:
            yield
        finally:
            self._lock.release()

    def __getstate__(self) -> dict[str, Any]:
        """Keep what it was made of and where it is; tables are made again."""
        with self._alone():
            if self._ranks is not None:
                raise TypeError("a Smoother of several ranks can't be pickled")
            state = {k: v for k, v in self.__dict__.items() if k not in ("_lock", "_tables")}
            if self._tables is not None:
                state["_state"] = self._tables.stepper.state()
        return state

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Go on where it was."""
        self._begin()
        self.__dict__.update(state)


class _Tables:
    """The steps of a session, and the way from points as the caller has them and back."""

    def __init__(self, method: Method, mesh: Mesh, aim: Targets | None) -> None:
        self._mesh = mesh
        self.stepper = Stepper(method, mesh, aim)
        n, topology = mesh.n_vertices, self.stepper.inside.topology
        self._ids = topology.vertex_ids if topology.is_renumbered else None
        self._places = np.argsort(self._ids) if self._ids is not None else None
        self._given, self._inside = np.empty((n, 2)), np.empty((n, 2))
        self._space = np.empty((n, 3)) if mesh.plane is not None else None
        self._rounded = mesh.plane is not None or mesh.projection is not None
        has_depth = mesh.surface == "flat" and mesh.points.shape[1] == 3
        self._depths = Depths(mesh) if has_depth and method.carry == "interpolate" else None
        self._column, self._unused = np.empty(n), ~mesh.topology.used
        self._first = int(np.argmax(mesh.topology.used))
        self._sizes = np.diff(mesh.cell_offsets)

    def step(self, points: FloatArray, out: FloatArray, most: int) -> StepRecord:
        """As `Smoother.step`."""
        self._require_plane(points)
        record = self.stepper.step(self._come_in(points), most)
        if record is None:
            checked_points(points)
            raise MeshError("points must be finite coordinates")
        depths = self._depths
        if self._rounded:
            given = points.copy(), self._given.copy()  # `out` may be `points`
            record = self._put_in_plane(points, out, record)
            if depths is not None:
                np.copyto(out[:, 2], depths.carry(*given, self._back()))
            return record
        xy = self._back()
        z = None if depths is None else depths.carry(points, self._given, xy)
        np.copyto(out, points)
        np.copyto(out[:, :2], xy)
        if z is not None:
            np.copyto(out[:, 2], z)
        return record

    def _come_in(self, points: FloatArray) -> FloatArray:
        """Coordinates in the plane and in the order inside, (n, 2)."""
        plane = self._mesh.plane
        if self._mesh.projection is not None:
            np.copyto(self._given, self._mesh.projection.project(points))
        elif plane is None or self._space is None:
            np.copyto(self._given, points[:, :2])
        else:
            np.subtract(points, plane.origin, out=self._space)
            np.matmul(self._space, plane.axes.T, out=self._given)
        if self._ids is None:
            return self._given
        return np.take(self._given, self._ids, axis=0, out=self._inside, mode="clip")

    def _back(self) -> FloatArray:
        """Where the vertices are, in the caller's order."""
        xy = self.stepper.resting.xy
        if self._places is None:
            return xy
        return np.take(xy, self._places, axis=0, out=self._inside, mode="clip")

    def _put_in_plane(self, points: FloatArray, out: FloatArray, record: StepRecord) -> StepRecord:
        """Write down moves in space, or in degrees, certified once more as they are rounded."""
        plane, space, stepper = self._mesh.plane, self._space, self.stepper
        given, xy = points.copy(), self._back()
        moves = xy - self._given
        moved = (moves != 0.0).any(axis=1)
        np.copyto(out, given)
        if self._mesh.projection is not None:
            out[moved, :2] = self._mesh.projection.unproject(xy[moved])
        else:
            assert plane is not None
            assert space is not None
            np.matmul(moves, plane.axes, out=space)
            np.add(given, space, out=out, where=moved[:, None])
        was_invalid, put_back = stepper.figures.invalid(), False
        were_valid = self._valid_in_degrees(given)
        while True:
            broken = stepper.go_on_from(self._come_in(out), was_invalid)
            lost = were_valid & ~self._valid_in_degrees(out)
            broken = np.union1d(broken, self._mesh.cell_vertices[np.repeat(lost, self._sizes)])
            broken = broken[moved[broken]]
            if not broken.size:
                break
            out[broken], moved[broken], put_back = given[broken], False, True
        if put_back:
            stepper.go_on_along_lines()
        return stepper.record(record.sweeps, record.untangled)

    def _valid_in_degrees(self, points: FloatArray) -> BoolArray:
        """Mark the cells that are valid as they lie in degrees; none where that is not asked."""
        if self._mesh.projection is None or not self.stepper.guards:
            return np.zeros(self._mesh.n_cells, np.bool_)
        return valid_in_degrees(self._mesh, points)

    def _require_plane(self, points: FloatArray) -> None:
        """Raise a `MeshError` where points have left the plane of the mesh, or the globe."""
        mesh, plane = self._mesh, self._mesh.plane
        if mesh.projection is not None:
            checked_points(points[:, :2])
            require_degrees(points)
        if mesh.points.shape[1] == 2 or mesh.surface == "flat":
            return
        if plane is None or self._space is None:
            np.copyto(self._column, points[:, 2])
            off = 0.0
        else:
            np.subtract(points, plane.origin, out=self._space)
            np.matmul(self._space, plane.normal, out=self._column)
            off = plane.tolerance
        self._column[self._unused] = self._column[self._first]
        # Where the level is not quite one, the mesh decides.
        if not self._column.max() - self._column.min() <= off:
            mesh.with_points(points)


def _require_writable(out: Any) -> None:
    if not isinstance(out, np.ndarray) or out.dtype != np.float64 or not out.flags.writeable:
        raise TypeError("a step overwrites its points, or `out`: a NumPy array of float64")
