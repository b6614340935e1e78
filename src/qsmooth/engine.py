"""Engines: who runs a sweep over a range of colours. Nothing else knows that there are several."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator
from typing import Protocol, TypeAlias

from qsmooth.kernels.compiling import clock
from qsmooth.options import OptionError

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
# On several threads a sweep that takes so many times what one thread took is the last one.
TOO_LONG = 1.5


class Engine(Protocol):
    """Runs sweeps; the result is the same whatever runs them."""

    def running(self) -> contextlib.AbstractContextManager[None]:
        """Hold what it needs for the sweeps inside the block."""
        ...

    def run(self, sweep: Callable[[Colours], None], n_colours: int) -> None:
        """Sweep over all colours, in order."""
        ...


class Threads:
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


class Quickest:
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


class Stepwise:
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


def threads_for(wanted: int | None, n_movable: int) -> Engine:
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
