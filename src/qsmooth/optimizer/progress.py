"""The clock, the counts and the history of one run of the optimiser."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from qsmooth.methods.base import Method
from qsmooth.methods.driver import gain, record, record_of
from qsmooth.methods.watching import Watch
from qsmooth.metrics import Quality
from qsmooth.outcome import Aim, Stage, Stop
from qsmooth.parts import Glance, Moved
from qsmooth.result import SweepRecord

# Sweeps between two looks at the mesh.
ROUND = 10


class Progress:
    """How far a run is: sweeps, stages, history, and whether what the caller allows is used up.

    Attributes
    ----------
    sweeps, steps
        Sweeps over the vertices and Newton steps on all of them so far.
    stop
        What the caller allows that is used up, None so far.
    watch
        Tells the caller, and knows how long a run may take.
    """

    def __init__(self, options: Method, before: Quality, started: float | None = None) -> None:
        self._options, self.watch = options, Watch(options, started)
        self.sweeps, self.steps = 0, 0
        self.stop: Stop | None = None
        self.stages: list[Stage] = []
        self.history: list[SweepRecord] = []
        self._last = record_of(before)

    @property
    def seconds(self) -> float:
        """Time since the start; callbacks and the compiling of kernels left out."""
        return self.watch.seconds

    def spent(self) -> bool:
        """Whether what the caller allows is used up, or he has asked to stop."""
        if self.sweeps >= self._options.max_sweeps:
            self.stop = self.stop or Stop.MAX_SWEEPS
        return self.cut_short()

    def cut_short(self) -> bool:
        """Whether time is up, or the caller has asked to stop; to ask within a round, too."""
        self.stop = self.stop or self.watch.stop()
        return self.stop is not None

    def next_round(self) -> int:
        """Sweeps of the next round."""
        return min(ROUND, self._options.max_sweeps - self.sweeps)

    def note(self, now: Quality | Glance, moved: Moved) -> None:
        """Put a round into the history, and tell the caller."""
        self.history.append(record(now, moved))
        self.watch.tell(self.history[-1])

    @contextmanager
    def stage(self, aim: Aim) -> Iterator[None]:
        """Count what is done inside the block as one stage."""
        sweeps, steps, seconds = self.sweeps, self.steps, self.seconds
        yield
        past, self._last = self._last, self.history[-1] if self.history else self._last
        self.stages.append(
            Stage(
                aim=aim,
                sweeps=self.sweeps - sweeps,
                steps=self.steps - steps,
                seconds=self.seconds - seconds,
                gain=gain(past, self._last),
            )
        )
