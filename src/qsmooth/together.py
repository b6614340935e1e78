"""One mesh smoothed by several ranks: the first one gives out what to do, all of them do it."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from contextlib import ExitStack
from dataclasses import replace
from typing import Any, NamedTuple, TypeVar

import numpy as np

from qsmooth._types import FloatArray
from qsmooth.bars import watched
from qsmooth.carrying import require_data
from qsmooth.distributed import DistributedMesh
from qsmooth.errors import MeshError
from qsmooth.mesh import Mesh
from qsmooth.methods.base import Method
from qsmooth.result import SmoothResult, SweepRecord
from qsmooth.team import Team, team_of
from qsmooth.vectors import directions_of

T = TypeVar("T")


class Work(NamedTuple):
    """What the first rank gives out.

    Attributes
    ----------
    mesh
        What is smoothed.
    methods
        With which methods, each with why it was chosen.
    note
        What else there is to tell the callers of all ranks.
    """

    mesh: Mesh
    methods: list[tuple[Method, str]]
    note: Any = None


class _Own:
    """Stands for a function among the options: each rank takes its own."""


def comm_of(*things: Any) -> Any:
    """Find the communicator in options, methods or meshes; None where there is none."""
    for thing in things:
        found = thing.get("comm") if isinstance(thing, dict) else getattr(thing, "comm", None)
        if found is not None and isinstance(thing, (dict, Method, DistributedMesh)):
            return found
    return None


def given_out(
    team: Team, make: Callable[[], Work], own: dict[str, Any], progress: Any, stack: ExitStack
) -> Work:
    """Give every rank the work that the first one makes, with the mesh, and the team in it.

    Parameters
    ----------
    make
        Called on the first rank; what it raises is raised on all.
    own
        The options of this rank: functions among them are taken from here.
    progress
        As in `smooth`; on the first rank.
    stack
        Holds what shows the progress.
    """

    def prepare() -> tuple[Work, list[tuple[type[Method], dict[str, Any], str]]] | None:
        if not team.is_first:
            return None
        work, shipped, methods = make(), [], []
        for method, chosen in work.methods:
            require_data(work.mesh, method.interpolate)
            shown = stack.enter_context(watched(_fit_for_all(method, work.mesh), progress))
            given = shown.given()
            given.pop("comm", None)
            methods.append((replace(shown, comm=team), chosen))
            given = {k: _Own() if callable(v) else v for k, v in given.items()}
            shipped.append((type(method), given, chosen))
        return Work(work.mesh, methods, work.note), shipped

    prepared = team.tried(prepare)
    sent: Any = None
    if prepared is not None:
        sent = prepared[0].mesh, prepared[1], prepared[0].note
    mesh, shipped, note = team.told(sent)

    def take() -> Work:
        if prepared is not None:
            return prepared[0]
        methods = [
            (kind(**_with_own(given, own), comm=team), chosen) for kind, given, chosen in shipped
        ]
        return Work(mesh, methods, note)

    return team.tried(take)


def run_all(team: Team, work: Work) -> list[SmoothResult]:
    """Smooth with each of the methods, on all ranks together."""
    return [method.smooth(work.mesh, chosen) for method, chosen in work.methods]


def _fit_for_all(method: Method, mesh: Mesh) -> Method:
    """Find out here what only the first rank can: what names in the file mean, and files say."""
    method = method.resolved(mesh)
    if method.directions is not None:
        method = replace(method, directions=directions_of(mesh, method.directions))
    return method


def _with_own(given: dict[str, Any], own: dict[str, Any]) -> dict[str, Any]:
    out = dict(given)
    for name, value in given.items():
        if isinstance(value, _Own):
            if name == "callback":
                out[name] = _elsewhere
            elif callable(own.get(name)):
                out[name] = own[name]
            else:
                raise TypeError(f"`{name}` is a function, which each rank has to be given")
    return out


def _elsewhere(record: SweepRecord) -> bool:
    """Stand for the callback, which the first rank calls."""
    return False


class DistributedResult:
    """What smoothing a `DistributedMesh` came to, for this rank.

    Everything that a `SmoothResult` has is there, too, and is about the whole mesh: ``outcome``,
    ``converged``, ``history``, ``before``, ``after`` ...

    Attributes
    ----------
    mesh
        This rank's part at its new places.
    whole
        The result of the whole mesh.
    """

    def __init__(self, mesh: DistributedMesh, whole: SmoothResult) -> None:
        self.whole = whole
        self.mesh = mesh.with_points(whole.points[mesh.vertex_ids])

    @property
    def points(self) -> FloatArray:
        """Coordinates of this rank's vertices, as its mesh has them."""
        return self.mesh.points

    def __getattr__(self, name: str) -> Any:
        if name.startswith("_") or name == "whole":
            raise AttributeError(name)
        return getattr(self.whole, name)

    def __repr__(self) -> str:
        return f"DistributedResult({self.whole!r})"


def parts_of(mesh: Any, results: Iterable[SmoothResult]) -> list[Any]:
    """Give each rank its part of a distributed mesh's results; else the results."""
    if isinstance(mesh, DistributedMesh):
        return [DistributedResult(mesh, result) for result in results]
    return list(results)


class SessionOnRanks:
    """What the ranks of a session tell each other: the work, and the points of each call.

    Parameters
    ----------
    comm
        The communicator.
    mesh
        This rank's: a `DistributedMesh`, or what the first rank has; not looked at on others.
    """

    def __init__(self, comm: Any, mesh: Any) -> None:
        self._team = team_of(comm)
        self._mesh: DistributedMesh | None = None
        self._given = mesh
        if isinstance(mesh, DistributedMesh):
            self._mesh = mesh

    def given_out(self, make: Callable[[Any], Work], own: dict[str, Any]) -> Work:
        """As `given_out`."""
        team, whole = self._team, self._given
        if self._mesh is not None:
            whole = self._mesh.whole(team)
        self._given = None
        with ExitStack() as stack:
            return given_out(team, lambda: make(whole), own, None, stack)

    def whole(self, points: Any) -> FloatArray:
        """Put the points of all ranks together, or give all those of the first; a copy."""
        team, mesh = self._team, self._mesh
        if mesh is None:
            own = team.tried(lambda: np.array(points if team.is_first else (), np.float64))
            return team.told(own)

        def checked() -> FloatArray:
            own = np.array(points, np.float64)
            if own.shape != mesh.points.shape:
                raise MeshError(
                    f"points must have the shape {mesh.points.shape} on rank {team.rank}, got "
                    f"{own.shape}"
                )
            return own

        return mesh.joined(team, team.tried(checked))

    def part(self, result: SmoothResult) -> Any:
        """Give this rank's part of a result."""
        return result if self._mesh is None else DistributedResult(self._mesh, result)

    def step(
        self,
        step: Callable[[FloatArray, FloatArray | None, int], T],
        points: Any,
        out: Any,
        max_sweeps: int,
    ) -> T:
        """Have all ranks step to the whole points, and write down each one's own."""
        whole = self.whole(points)
        record = step(whole, None, max_sweeps)
        out = points if out is None else out
        if out is not None:
            np.copyto(out, whole if self._mesh is None else whole[self._mesh.vertex_ids])
        return record
