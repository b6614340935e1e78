"""Engines: who runs a sweep over a range of colours. Nothing else knows that there are several."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator
from functools import cached_property
from typing import TypeAlias

import numpy as np

from qsmooth._types import IndexArray
from qsmooth.kernels.compiling import clock
from qsmooth.kernels.stars import Stars
from qsmooth.numbering import Inside
from qsmooth.options import OptionError
from qsmooth.parts import Part, Share, Steps
from qsmooth.team import Team
from qsmooth.topology import Topology, along_curve

# From a first colour up to another, which is left out.
Colours: TypeAlias = tuple[int, int]

# From so many movable vertices on all threads are taken: sweeps are long beside what it takes to
# wait for each other, even on a busy machine.
PARALLEL_FROM = 100_000
# Of fewer, so many are one thread's share of the work; below two shares one thread does it all.
SHARE = 5_000
# More threads are tried from this sweep on, as the first ones fetch tables and code, again after so
# many sweeps at least, and while trials have cost at most this share of the time of all sweeps.
FIRST_TRIAL = 3
TRIAL_EVERY = 25
MOST_LOST = 0.05
# A schedule with fewer vertices for each rank is swept whole by all of them.
LEAST_DIVIDED = 2_500
# On several threads a sweep that takes so many times what one thread took is the last one.
TOO_LONG = 1.5


class Engine:
    """Runs sweeps; the result is the same whatever runs them."""

    def running(self) -> contextlib.AbstractContextManager[None]:
        """Hold what it needs for the sweeps inside the block."""
        raise NotImplementedError

    def run(self, sweep: Callable[[Colours], None], n_colours: int) -> None:
        """Sweep over all colours, in order."""
        raise NotImplementedError

    def part(self, topology: Topology, stars: Stars, measured: Topology | None = None) -> Part:
        """Give what this process sweeps of a schedule; and measures, if other cells than those."""
        return Part(self.run, stars)

    def steps(self, topology: Topology, stars: Stars, block_of: IndexArray) -> Part:
        """Give what this process sweeps of a schedule in the steps of a session.

        `block_of`, (n_vertices,), is the block of lanes that each vertex is in.
        """
        return Part(self.run, stars)

    @property
    def alone(self) -> Engine:
        """Who runs what each process does for itself."""
        return self


class Threads(Engine):
    """Threads of this process: all colours in one call of the compiled loop.

    Parameters
    ----------
    count
        How many threads.
    """

    def __init__(self, count: int) -> None:
        self.count = count

    @contextlib.contextmanager
    def running(self) -> Iterator[None]:
        """Run parallel kernels on so many threads inside the block."""
        from qsmooth.kernels._jit import use_threads

        with use_threads(self.count):
            yield

    def run(self, sweep: Callable[[Colours], None], n_colours: int) -> None:
        """Sweep over all colours at one go."""
        sweep((0, n_colours))


class Quickest(Engine):
    """One thread or several: whichever sweeps are over sooner with, found out on the way.

    Several nearly divide the time by their count where cores are free. Where one is taken, a sweep
    of 24K vertices takes fifteen times as long: each colour waits for the thread that waits for a
    core. Nothing but time depends on it.

    Parameters
    ----------
    count
        How many threads are several.
    """

    def __init__(self, count: int) -> None:
        self.count, self.others = 1, count
        self._wait = FIRST_TRIAL
        # Seconds: the last sweep, the quicker of two, one on one thread, all, and what trials cost.
        self._last = self._usual = self._single = self._total = self._lost = 0.0

    @contextlib.contextmanager
    def running(self) -> Iterator[None]:
        """Run what is no sweep on one thread inside the block."""
        from qsmooth.kernels._jit import use_threads

        with use_threads(1):
            yield

    def run(self, sweep: Callable[[Colours], None], n_colours: int) -> None:
        """Sweep over all colours at one go; now and then on the other count of threads."""
        self._wait -= 1
        trial = self._wait <= 0 and self._lost <= MOST_LOST * self._total
        seconds = self._timed(self.others if trial else self.count, sweep, n_colours)
        if trial and seconds < self._usual:
            self._single = self._usual
            self._exchange(seconds)
        elif trial:
            self._lost += seconds - self._usual
            # The first sweep on several threads starts them: it has a second chance at once.
            self._wait = TRIAL_EVERY if self._wait < 0 or self.count > 1 else 0
        elif self.count > 1 and seconds > TOO_LONG * self._single:
            self._lost += seconds - self._single
            self._exchange(self._single)
        else:
            self._last, self._usual = seconds, min(seconds, self._last)

    def _exchange(self, seconds: float) -> None:
        self.count, self.others = self.others, self.count
        self._last = self._usual = seconds
        self._wait = TRIAL_EVERY

    def _timed(self, count: int, sweep: Callable[[Colours], None], n_colours: int) -> float:
        from qsmooth.kernels._jit import use_threads

        with use_threads(count):
            started = clock()
            sweep((0, n_colours))
            seconds = clock() - started
        self._total += seconds
        return seconds


class Stepwise(Engine):
    """One call a colour, with something between them: what several processes need.

    Parameters
    ----------
    between
        Called after each colour with its number; coordinates may be exchanged there.
    """

    def __init__(self, between: Callable[[int], None] | None = None) -> None:
        self.between = between

    @contextlib.contextmanager
    def running(self) -> Iterator[None]:
        """Run on one thread."""
        from qsmooth.kernels._jit import use_threads

        with use_threads(1):
            yield

    def run(self, sweep: Callable[[Colours], None], n_colours: int) -> None:
        """Sweep colour by colour."""
        for colour in range(n_colours):
            sweep((colour, colour + 1))
            if self.between is not None:
                self.between(colour)


class Ranks(Threads):
    """The ranks of a team, each with threads of its own: every one sweeps its part of the vertices.

    Parameters
    ----------
    team
        The ranks.
    inside
        The mesh as it lies in memory.
    owner : (n_vertices,) or None
        Which rank each of the caller's vertices belongs to; None: pieces of a space-filling curve
        with as many vertices each.
    count
        Threads of this rank.
    """

    def __init__(
        self, team: Team, inside: Inside, owner: IndexArray | None = None, count: int = 1
    ) -> None:
        super().__init__(count)
        self._team, self._inside, self._given = team, inside, owner
        self._shares: list[Share] = []

    @cached_property
    def _owner(self) -> IndexArray:
        """Which rank each vertex belongs to, in the order inside, (n_vertices,)."""
        n = self._inside.topology.n_vertices
        if self._given is not None:
            return self._inside.at_vertices(self._given)
        owner = np.empty(n, np.int64)
        order = along_curve(self._inside.at_vertices(self._inside.mesh.xy))
        owner[order] = np.arange(n) * self._team.size // n
        return owner

    @contextlib.contextmanager
    def running(self) -> Iterator[None]:
        """Run on so many threads inside the block; afterwards no sweep can be run."""
        try:
            with super().running():
                yield
        finally:
            while self._shares:
                self._shares.pop().close()

    def part(self, topology: Topology, stars: Stars, measured: Topology | None = None) -> Part:
        """Give what this rank sweeps of a schedule: all of it where it is too little to divide."""
        if stars.vertices.size < LEAST_DIVIDED * self._team.size:
            return Part(self.run, stars)
        share = Share(self._team, self.run, topology, stars, self._owner, measured)
        self._shares.append(share)
        return share

    def steps(self, topology: Topology, stars: Stars, block_of: IndexArray) -> Part:
        """Give the blocks of lanes that this rank sweeps: all where they are too few to divide."""
        if stars.vertices.size < LEAST_DIVIDED * self._team.size:
            return Part(self.run, stars)
        return Steps(self._team, self.run, topology, stars, block_of)

    @property
    def alone(self) -> Engine:
        """Who runs what each rank does for itself."""
        return Threads(self.count)


def engine_for(wanted: int | None, n_movable: int, inside: Inside, team: Team | None) -> Engine:
    """Choose who runs the sweeps: the ranks of a team, or threads as `threads_for` does.

    Raises
    ------
    ValueError
        If there are not so many threads.
    """
    if team is None or team.size == 1:
        return threads_for(wanted, n_movable)
    # Where one rank has fewer than others, none begins.
    count = team.tried(lambda: threads_for(wanted or 1, n_movable).count)
    return Ranks(team, inside, team.owner, count)


def threads_for(wanted: int | None, n_movable: int) -> Threads | Quickest:
    """Choose threads by the count of movable vertices, unless the caller wants a number of them.

    Raises
    ------
    ValueError
        If there are not so many.
    """
    from qsmooth.kernels._jit import available_threads, useful_threads

    if wanted is not None:
        if wanted > (most := available_threads()):
            raise OptionError(f"`threads` must be at most {most} here, got {wanted}")
        return Threads(wanted)
    useful = useful_threads()
    if n_movable >= PARALLEL_FROM:
        return Threads(useful)
    several = min(useful, n_movable // SHARE)
    return Quickest(several) if several > 1 else Threads(1)
