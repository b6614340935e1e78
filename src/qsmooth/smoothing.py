"""The ways in: smooth a mesh by one method, untangle it, compare several methods."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from contextlib import ExitStack
from dataclasses import replace
from typing import Any

from qsmooth._words import did_you_mean
from qsmooth.adapters import as_mesh
from qsmooth.bars import Shown, watched
from qsmooth.constraints import Constraints
from qsmooth.distributed import DistributedMesh
from qsmooth.mesh import Surface
from qsmooth.methods.base import Method
from qsmooth.options import spelled
from qsmooth.registry import all_methods, choose, method_class, methods
from qsmooth.result import SmoothResult
from qsmooth.team import team_of
from qsmooth.together import Work, comm_of, given_out, parts_of, run_all


def smooth(
    mesh: Any,
    method: str | Method = "auto",
    *,
    constraints: Constraints | None = None,
    progress: bool | Shown | None = None,
    surface: Surface = "auto",
    geographic: bool | None = None,
    **options: Any,
) -> SmoothResult:
    """Make a mesh better by moving its vertices; the cells stay as they are.

    Parameters
    ----------
    mesh
        A `Mesh`, a pair ``(points, cells)``, or what `as_mesh` takes. It is not changed.
    method
        A name, as in ``smooth(mesh, "star", step=0.3)``, or a method with its options, as in
        ``smooth(mesh, Star(step=0.3))``, which is the same: ``"optimize"``, ``"star"``,
        ``"quad"``, ``"aspect-ratio"``, ``"angle"``, ``"smart-laplacian"``, ``"laplacian"``; see
        `Optimize`, `Star` and their like. ``"auto"`` means optimize, or aspect-ratio where
        `split_quads` is given.
    constraints
        What may move, where to, and how far; the same as its fields given among the options.
    progress
        True shows how far it is: a bar on a terminal or in a notebook, else a line on standard
        error in the end. A function is called with each `SweepRecord`, the sweeps so far, and the
        most that there can be, None where that is not known. By default nothing is shown.
    surface
        What a third coordinate means: ``"flat"`` for a value, a depth say, see `Mesh`; by default
        what the mesh says, or else points in one plane.
    geographic
        Whether x and y are longitudes and latitudes in degrees, see `Mesh`; by default what the
        mesh, or its file, says.
    options
        Options of the method, described there. All have ``max_sweeps``, ``time_limit``,
        ``threads``, ``callback``, ``carry``, ``interpolate``, and the fields of `Constraints`:
        ``fixed``, ``max_move``, ``directions``, ``selection`` and others.

    Returns
    -------
    SmoothResult
        Its ``outcome`` says what was done and why it stopped. Not converging is an outcome too.

    Raises
    ------
    ValueError
        No such method, an option out of its range, or a method that can do nothing with the
        mesh's cells.
    TypeError
        An option that the method does not have, options beside a method that has its own, or one
        that is in `constraints`, too.
    MeshError
        If a pair is no mesh.
    """

    def make(mesh: Any) -> Work:
        made, chosen = method_of(method, options, constraints)
        return Work(as_mesh(mesh, surface=surface, geographic=geographic), [(made, chosen)])

    if (comm := comm_of(options, method, mesh)) is not None:
        found: SmoothResult = _on_ranks(comm, mesh, make, _own(options, method), progress)[0][0]
        return found
    method, chosen = method_of(method, options, constraints)
    with watched(method, progress) as shown:
        return shown.smooth(as_mesh(mesh, surface=surface, geographic=geographic), chosen)


def untangle(
    mesh: Any,
    *,
    constraints: Constraints | None = None,
    progress: bool | Shown | None = None,
    surface: Surface = "auto",
    geographic: bool | None = None,
    **options: Any,
) -> SmoothResult:
    """Make an invalid mesh valid by moving vertices, and stop there; see `Untangle`.

    Parameters
    ----------
    mesh
        A `Mesh`, a pair ``(points, cells)``, or what `as_mesh` takes. It is not changed.
    constraints, progress, surface, geographic, options
        As in `smooth`. Options are ``max_sweeps`` (20,000), ``time_limit``, ``threads``,
        ``callback``, and the fields of `Constraints`.

    Returns
    -------
    SmoothResult
        ``converged`` says whether the mesh is valid.

    Raises
    ------
    ValueError
        An option out of its range.
    TypeError
        An option that it does not have, or one that is in `constraints`, too.
    MeshError
        If a pair is no mesh.
    """
    given = _with_constraints(options, constraints)

    def make(mesh: Any) -> Work:
        method = all_methods()["untangle"].of(given)
        return Work(as_mesh(mesh, surface=surface, geographic=geographic), [(method, "")])

    if (comm := comm_of(options, mesh)) is not None:
        found: SmoothResult = _on_ranks(comm, mesh, make, options, progress)[0][0]
        return found
    with watched(all_methods()["untangle"].of(given), progress) as shown:
        return shown.smooth(as_mesh(mesh, surface=surface, geographic=geographic))


def compare(
    mesh: Any,
    names: Iterable[str | Method] | None = None,
    *,
    constraints: Constraints | None = None,
    surface: Surface = "auto",
    geographic: bool | None = None,
    **options: Any,
) -> tuple[dict[str, SmoothResult], dict[str, str]]:
    """Smooth a mesh with several methods, each from the same start.

    Parameters
    ----------
    mesh
        A `Mesh`, a pair ``(points, cells)``, or what `as_mesh` takes.
    names
        Methods, by name or with their options; all by default.
    constraints, surface, geographic
        As in `smooth`.
    options
        Each goes to the methods given by name that take it: that have it and, where it is a
        choice, that value of it.

    Returns
    -------
    results
        By the method's name; a second one of that name is "star (2)".
    skipped
        By name, why a method can do nothing with the mesh's cells.

    Raises
    ------
    ValueError, TypeError, MeshError
        As in `smooth`; an option that none of the methods has is a TypeError.
    """

    def make(mesh: Any) -> Work:
        mesh = as_mesh(mesh, surface=surface, geographic=geographic)
        given = _with_constraints(options, constraints)
        chosen = numbered(configured(methods() if names is None else names, given))
        skipped = {name: spelled(why) for name, m in chosen.items() if (why := m.why_not(mesh))}
        if len(chosen) == 1:
            skipped = {}  # asked for alone it says itself why it can't
        taken = {name: m for name, m in chosen.items() if name not in skipped}
        return Work(mesh, [(m, "") for m in taken.values()], (list(taken), skipped))

    if (comm := comm_of(options, mesh)) is not None:
        results, (taken, skipped) = _on_ranks(comm, mesh, make, options, None)
    else:
        work = make(mesh)
        taken, skipped = work.note
        results = [method.smooth(work.mesh) for method, _ in work.methods]
    return dict(zip(taken, results, strict=True)), skipped


def _on_ranks(
    comm: Any,
    mesh: Any,
    make: Callable[[Any], Work],
    own: dict[str, Any],
    progress: bool | Shown | None,
) -> tuple[list[Any], Any]:
    """Smooth on all ranks of a communicator; also the note that came with the work."""
    team = team_of(comm)
    with ExitStack() as stack:
        whole = mesh.whole(team) if isinstance(mesh, DistributedMesh) else mesh
        work = given_out(team, lambda: make(whole), own, progress, stack)
        return parts_of(mesh, run_all(team, work)), work.note


def _own(options: dict[str, Any], method: str | Method) -> dict[str, Any]:
    """Options as this rank has them."""
    return options if isinstance(method, str) else method.given()


def numbered(chosen: Iterable[Method]) -> dict[str, Method]:
    """Name methods; from the second of a name on with a number: "star", "star (2)"."""
    named: dict[str, Method] = {}
    for method in chosen:
        count = 1 + sum(other.name == method.name for other in named.values())
        named[method.name if count == 1 else f"{method.name} ({count})"] = method
    return named


def configured(
    names: str | Method | Iterable[str | Method], options: Mapping[str, Any]
) -> list[Method]:
    """Make methods of names, each with those of the options that it takes.

    Raises
    ------
    TypeError
        If an option belongs to none of those given by name.
    OptionError
        If none of them takes its value.
    """
    each = [names] if isinstance(names, (str, Method)) else names
    given = [name if isinstance(name, Method) else method_class(name) for name in each]
    classes = [thing for thing in given if isinstance(thing, type)]
    if not classes:
        for thing in given:
            if isinstance(thing, Method):
                _require_none_beside(thing, options)
    own: dict[str, dict[str, Any]] = {known.name: {} for known in classes}
    for option, value in options.items():
        having = [known for known in classes if option in known.specs()]
        if not having:
            known = ", ".join(c.name for c in classes)
            every = dict.fromkeys(name for c in classes for name in c.specs())
            raise TypeError(
                f"no option {option!r} in any of the methods {known}{did_you_mean(option, every)}"
            )
        for taking in [known for known in having if known.takes(option, value)] or having:
            own[taking.name][option] = value
    return [thing.of(own[thing.name]) if isinstance(thing, type) else thing for thing in given]


def method_of(
    method: str | Method, options: dict[str, Any], constraints: Constraints | None
) -> tuple[Method, str]:
    """Make the method with its options; also why it was chosen, for ``"auto"``.

    Raises
    ------
    ValueError, TypeError
        As in `smooth`.
    """
    if isinstance(method, Method):
        _require_none_beside(method, options)
        if constraints is not None:
            method = replace(method, **_with_constraints(method.given(), constraints))
        return method, ""
    options = _with_constraints(options, constraints)
    if method != "auto":
        return method_class(method).of(options), ""
    name, why = choose(options)
    return method_class(name).of(options), why


def _with_constraints(options: dict[str, Any], constraints: Constraints | None) -> dict[str, Any]:
    """Add those constraints that are given to options.

    Raises
    ------
    TypeError
        If one of them is among the options.
    """
    given = {} if constraints is None else constraints.given()
    if twice := [name for name in given if name in options]:
        raise TypeError(f"given in constraints and beside them: {', '.join(twice)}")
    return options | given


def _require_none_beside(method: Method, options: Mapping[str, Any]) -> None:
    if options:
        raise TypeError(
            f"options go into {type(method).__name__}(...), not beside it: {', '.join(options)}"
        )
