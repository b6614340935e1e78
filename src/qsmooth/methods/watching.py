"""Who watches a run: the caller's callback, which may stop it, and the time that it is allowed."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from qsmooth.kernels.compiling import clock
from qsmooth.outcome import Stop
from qsmooth.result import SmoothResult, SweepRecord

if TYPE_CHECKING:
    from qsmooth.methods.base import Method

# A time limit is held to this: no piece of work begins that would end later.
HELD_TO = 1.1
# The share of it that is kept back at most for what comes after the sweeps.
MOST_AFTERWARDS = 0.5


class Watch:
    """What the caller allows a run: until when, and what his callback says.

    Parameters
    ----------
    options
        The method, with its `callback` and `time_limit`.
    started
        When the run began, by `compiling.clock`; now, by default.

    Attributes
    ----------
    asked
        Whether the callback has asked to stop, or raised an exception.
    """

    def __init__(self, options: Method, started: float | None = None) -> None:
        self._callback, self._limit = options.callback, options.time_limit
        self._team = options.team
        self._started = self._last = clock() if started is None else started
        self.asked = False
        self._afterwards = 0.0
        self._error: Exception | None = None

    @property
    def seconds(self) -> float:
        """Time since the start; callbacks and the compiling of kernels left out."""
        return clock() - self._started

    def tell(self, record: SweepRecord) -> None:
        """Call back. True asks to stop, and so does an exception, which waits for the result."""
        if self._callback is None or self.asked:
            return
        called = clock()
        try:
            answer = self._callback(record)
            self.asked = isinstance(answer, (bool, np.bool_)) and bool(answer)
        except Exception as error:
            self._error, self.asked = error, True
        self.asked = self._told(self.asked)
        away = clock() - called
        self._started += away
        self._last += away

    def set_up(self) -> None:
        """Note that sweeps begin: what comes after them takes about as long as what came before.

        Both go over the whole mesh a few times. Only the first call counts.
        """
        if self._limit is not None and not self._afterwards:
            self._last = clock()
            self._afterwards = min(self._last - self._started, MOST_AFTERWARDS * self._limit)

    def stop(self) -> Stop | None:
        """Why to stop now, if there is a reason; asked between two pieces of work.

        The next piece is taken to be as long as the last one.
        """
        if self.asked:
            return Stop.CALLBACK
        if self._limit is None:
            return None
        now = clock()
        spent, piece, self._last = now - self._started, now - self._last, now
        spent += self._afterwards
        over = spent >= self._limit or spent + piece > HELD_TO * self._limit
        return Stop.TIME_LIMIT if self._told(over) else None

    def leaves_time_for(self, seconds: float) -> bool:
        """Whether a piece of work that takes so long would end in time."""
        if self._limit is None:
            return True
        spent = self.seconds + self._afterwards
        return self._told(spent + seconds <= HELD_TO * self._limit)

    def _told(self, decided: bool) -> bool:
        """What the first of several ranks has decided."""
        return decided if self._team is None else self._team.told(decided)

    def give_back(self, result: SmoothResult) -> SmoothResult:
        """Return the result; or raise what the callback raised, with the result as `result`."""
        error, self._error = self._error, None
        if error is None:
            return result
        error.result = result  # type: ignore[attr-defined]
        raise error
