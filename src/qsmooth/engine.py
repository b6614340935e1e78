"""Engines: who runs a sweep over a range of colours. Nothing else knows that there are several."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator
from typing import Protocol, TypeAlias

from qsmooth.options import OptionError

# From a first colour up to another, which is left out.
Colours: TypeAlias = tuple[int, int]

# Below this many movable vertices a sweep is over before a second thread has woken up, or waits for
# it on a busy machine (24K vertices, two cores of which one was taken: fifteen times slower).
PARALLEL_FROM = 100_000


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


def threads_for(wanted: int | None, n_movable: int) -> Threads:
    """Choose threads by the count of movable vertices, unless the caller wants a number of them.

    Raises
    ------
    ValueError
        If there are not so many.
    """
    from qsmooth.kernels._jit import available_threads

    most = available_threads()
    if wanted is not None and wanted > most:
        raise OptionError(f"`threads` must be at most {most} here, got {wanted}")
    if wanted is None:
        wanted = most if n_movable >= PARALLEL_FROM else 1
    return Threads(wanted)
