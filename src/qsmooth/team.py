"""The ranks of an MPI communicator that smooth one mesh together, and what they tell each other.

All of them run the same program on the same figures and so come to the same decisions. What only
one of them can know, as the time that has gone by or what a callback says, the first one tells.
mpi4py is imported here alone, and only where there is a communicator.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from functools import cache
from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt

T = TypeVar("T")
A = TypeVar("A", bound=npt.NDArray[Any])

FIRST = 0


class Team:
    """The ranks of a communicator.

    Parameters
    ----------
    comm
        An ``mpi4py.MPI.Comm``; what is sent here is not to mix with messages of others.

    Attributes
    ----------
    rank, size
        Which of how many this process is.
    owner : (n_vertices,) or None
        Which rank each of the caller's vertices belongs to, where that is given.
    messages, sent
        Messages between two ranks that this one has sent during sweeps, and their bytes.
    """

    def __init__(self, comm: Any) -> None:
        self.comm = comm
        self.rank, self.size = comm.Get_rank(), comm.Get_size()
        self.messages = self.sent = 0
        self.owner: npt.NDArray[np.int64] | None = None

    @property
    def is_first(self) -> bool:
        """Whether this is the rank that has the mesh, reads the clock and asks the callback."""
        return bool(self.rank == FIRST)

    def told(self, thing: T) -> T:
        """Give what the first rank has; the others' is not looked at."""
        from mpi4py.util.pkl5 import Intracomm

        return Intracomm(self.comm).bcast(thing, FIRST)  # type: ignore[no-any-return]

    def of_all(self, thing: T) -> list[T]:
        """Give what each rank has, by rank; for small things."""
        return self.comm.allgather(thing)  # type: ignore[no-any-return]

    def arrays_of_all(self, own: A) -> tuple[A, npt.NDArray[np.int64]]:
        """Join arrays along their first axis, by rank; and how long each rank's is."""
        own = np.ascontiguousarray(own)  # type: ignore[assignment]
        counts = np.array(self.of_all(len(own)), np.int64)
        return self.joined(own, counts), counts

    def joined(self, own: A, counts: npt.NDArray[np.int64]) -> A:
        """Join arrays along their first axis, by rank, whose lengths are known."""
        from mpi4py import MPI

        own = np.ascontiguousarray(own)  # type: ignore[assignment]
        out: Any = np.empty((int(counts.sum()), *own.shape[1:]), own.dtype)
        row = MPI.BYTE.Create_contiguous(own.dtype.itemsize * int(np.prod(own.shape[1:]))).Commit()
        try:
            starts = np.cumsum(counts) - counts
            self.comm.Allgatherv([own, len(own), row], [out, counts, starts, row])
        finally:
            row.Free()
        return out  # type: ignore[no-any-return]

    def either(self, marks: npt.NDArray[np.bool_]) -> None:
        """Mark what any rank has marked, in place."""
        from mpi4py import MPI

        self.comm.Allreduce(MPI.IN_PLACE, [marks.view(np.uint8), MPI.UINT8_T], MPI.BOR)

    def all_well(self, error: Exception | None) -> None:
        """Raise on every rank what one of them has met with, the first by rank; all must ask."""
        errors = [found for found in self.of_all(error) if found is not None]
        if errors:
            raise errors[0] if error is None else error

    def tried(self, function: Callable[[], T]) -> T:
        """Call a function on every rank; where it fails on one, it fails on all.

        Raises
        ------
        Exception
            What it raised here, or else on the first rank where it did.
        """
        error, found = None, None
        try:
            found = function()
        except Exception as met:
            error = met
        self.all_well(_fit_to_send(error))
        return found  # type: ignore[return-value]


def _fit_to_send(error: Exception | None) -> Exception | None:
    """Give an error that can be pickled."""
    import pickle

    try:
        pickle.loads(pickle.dumps(error))
    except Exception:
        return RuntimeError(f"{type(error).__name__}: {error}")
    return error


def is_comm(thing: object) -> bool:
    """Whether this is a communicator of mpi4py; imports nothing."""
    mpi = sys.modules.get("mpi4py.MPI")
    return mpi is not None and isinstance(thing, mpi.Intracomm)


def team_of(comm: Any) -> Team:
    """Make the ranks of a communicator a team, with messages of their own.

    For these it is duplicated, once: MPI has no more than some two thousand communicators.
    """
    own = comm.Get_attr(_key())
    if own is None:
        own = comm.Dup()
        comm.Set_attr(_key(), own)
    return Team(own)


@cache
def _key() -> int:
    """Under what a communicator keeps its duplicate."""
    from mpi4py import MPI

    return int(MPI.Comm.Create_keyval())
