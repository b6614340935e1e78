"""The command line under ``mpiexec``: the first rank is it, the others do what it gives out."""

from __future__ import annotations

import os
import sys
import warnings
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from typing import TYPE_CHECKING

from qsmooth.cli import terminal

if TYPE_CHECKING:
    from qsmooth.mesh import Mesh
    from qsmooth.methods.base import Method
    from qsmooth.result import SmoothResult
    from qsmooth.team import Team

# How those that start several processes say how many these are: MPICH and its like, Open MPI,
# MVAPICH, and Slurm where it starts processes of MPI.
SIZES = ("PMI_SIZE", "OMPI_COMM_WORLD_SIZE", "MV2_COMM_WORLD_SIZE")
SLURM_SIZE, OF_MPI = "SLURM_STEP_NUM_TASKS", ("PMI_RANK", "PMIX_RANK")
# A descriptor by which MPICH talks to whoever has started the process.
TALKS = "PMI_FD"
# 0 keeps a process that an MPI program has started from taking part in it.
SWITCH = "QSMOOTH_MPI"

_team: Team | None = None


def started_by_mpi() -> bool:
    """Whether this is one of several processes that ``mpiexec`` or its like has started.

    Not one that such a process has started itself: it inherits what the environment says, and
    none of the connections.
    """
    told = os.environ
    if told.get(SWITCH) == "0":
        return False
    names = (*SIZES, SLURM_SIZE) if any(name in told for name in OF_MPI) else SIZES
    if not any(told.get(name, "").isdigit() and int(told[name]) > 1 for name in names):
        return False
    if told.get(TALKS, "").isdigit():
        try:
            os.fstat(int(told[TALKS]))
        except OSError:
            return False
    return True


def smooth(method: Method, mesh: Mesh, chosen: str = "") -> SmoothResult:
    """Smooth a mesh, on all ranks where there are several."""
    if _team is None:
        return method.smooth(mesh, chosen)
    from qsmooth.together import Work, given_out, run_all

    team = _team
    team.told(True)
    with ExitStack() as stack:
        work = given_out(team, lambda: Work(mesh, [(method, chosen)]), {}, None, stack)
        stack.enter_context(_ended_together(team, but=ValueError))
        results = run_all(team, work)
    return results[0]


def size() -> int:
    """How many processes smooth together."""
    return 1 if _team is None else _team.size


def run(command: Callable[[], int]) -> int:
    """Run the command line on the first rank, and on the others what that gives out.

    Returns
    -------
    int
        The exit code: on the first rank that of the command, on others 0.
    """
    global _team
    try:
        from mpi4py import MPI
    except ImportError as error:
        terminal.say(f"error: several processes need mpi4py: pip install 'qsmooth[mpi]' ({error})")
        return terminal.ERROR
    from qsmooth.team import Team

    comm = MPI.COMM_WORLD
    if comm.Get_size() == 1:
        return command()
    _team = Team(comm)
    with _ended_together(_team):
        if not _team.is_first:
            _do_as_told(_team)
            return terminal.PASSED
        code = command()
        _team.told(False)
    return code


@contextmanager
def _ended_together(
    team: Team, but: type[Exception] | tuple[type[Exception], ...] = ()
) -> Iterator[None]:
    """End all ranks where one fails in a way that the others do not: none waits for it.

    `but` is what all fail with alike.
    """
    try:
        yield
    except but:
        raise
    except BaseException as error:
        interrupted = isinstance(error, KeyboardInterrupt)
        what = "interrupted" if interrupted else f"error: {type(error).__name__}: {error}"
        terminal.say(f"{what} (on rank {team.rank})")
        sys.stdout.flush()
        sys.stderr.flush()
        code = terminal.INTERRUPTED if interrupted else terminal.ERROR
        team.comm.Abort(code)
        os._exit(code)  # where that comes back


def _do_as_told(team: Team) -> None:
    """Smooth what the first rank gives out until it is done."""
    from qsmooth.together import Work, given_out, run_all

    def none() -> Work:
        raise NotImplementedError

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        while team.told(None):
            with ExitStack() as stack:
                try:
                    work = given_out(team, none, {}, None, stack)
                except Exception:
                    continue  # what the first rank has met with, and tells
                with suppress(ValueError):  # which the first rank meets with, too
                    run_all(team, work)
