"""How long qsmooth takes to come as far as another program came.

For each method the fewest sweeps that reach the quality are looked for by doubling and halving, as
whole calls of `qsmooth.smooth` with `max_sweeps`; then calls with exactly so many are timed. That
is what a user gets who asks for so many sweeps: warm kernels, one thread, a new mesh each time.
Seconds are of processor time, which other programs on the machine disturb least.
"""

import math
import statistics
from typing import NamedTuple

from apart import processor_time
from peer_meshes import Figures, measure

# Methods with options. None of them invalidates a valid cell, but for the plain Laplacian. The
# first come far on all meshes, and what they take is as long as the others are tried.
METHODS = {
    "optimize": ("optimize", {}),
    "optimize, target=ideal": ("optimize", {"target": "ideal"}),
    "optimize, worst=False": ("optimize", {"worst": False}),
    "untangle": ("untangle", {}),
    "laplacian": ("laplacian", {"rtol": 0.0}),
    "smart-laplacian": ("smart-laplacian", {"rtol": 0.0}),
    "star": ("star", {"rtol": 0.0}),
    "quad": ("quad", {"rtol": 0.0}),
}
# As good as the other program but for this much: figures are told to three digits.
TOLERANCE = 1e-3
# A count is known to this share of itself.
RESOLUTION = 8
# More sweeps than this of what goes through no stages gain little.
MOST, STAGED = 256, ("optimize", "untangle")
REPEATS, REPEATS_OF_LONG, LONG = 5, 3, 1.0


class Call(NamedTuple):
    """What came of one call."""

    seconds: float
    figures: Figures
    used_up: bool


class Reached(NamedTuple):
    """The quickest way to a quality: method, sweeps, median of the seconds, what it came to."""

    method: str
    sweeps: int
    seconds: float
    figures: Figures


def enough(found: Figures, wanted: Figures) -> bool:
    """Whether a mesh is as good in its worst cell and in the mean, or valid where that is not."""
    if found.invalid or wanted.invalid:
        return not found.invalid
    return (
        found.worst >= wanted.worst - TOLERANCE
        and found.mean >= wanted.mean - TOLERANCE
        and found.shape >= wanted.shape - TOLERANCE
    )


class Calls:
    """Calls on one mesh; each is made once, as the same call gives the same mesh."""

    def __init__(self, points, cells):
        self.points, self.cells = points, cells
        self._seen, self._reached = {}, {}

    def timed(self, method, sweeps=None):
        """Processor time of a call, and its result."""
        from qsmooth import Mesh, smooth, untangle

        name, options = METHODS[method]
        if sweeps is not None:
            options = {**options, "max_sweeps": sweeps}
        mesh = Mesh(self.points, self.cells)
        begin = processor_time()
        if name == "untangle":
            result = untangle(mesh, threads=1, **options)
        else:
            result = smooth(mesh, name, threads=1, **options)
        return processor_time() - begin, result

    def median(self, method, sweeps=None):
        """Median of the seconds of several calls, and the last result."""
        seconds, result = self.timed(method, sweeps)
        all_of_them = [seconds]
        for _ in range((REPEATS_OF_LONG if seconds > LONG else REPEATS) - 1):
            seconds, result = self.timed(method, sweeps)
            all_of_them.append(seconds)
        return statistics.median(all_of_them), result

    def with_sweeps(self, method, sweeps) -> Call:
        """What so many sweeps come to."""
        key = method, sweeps
        if key not in self._seen:
            seconds, result = self.timed(method, sweeps)
            figures = measure(result.points, self.cells)
            used_up = result.outcome.stop.value == "max_sweeps"
            self._seen[key] = Call(seconds, figures, used_up)
        return self._seen[key]

    def fewest(self, method, wanted: Figures, limit: float) -> int | None:
        """Fewest sweeps that are enough, or None where they are not, or take longer than that."""
        failed, sweeps = 0, 1
        while not enough((call := self.with_sweeps(method, sweeps)).figures, wanted):
            most = math.inf if method.startswith(STAGED) else MOST
            if not call.used_up or call.seconds > limit or sweeps >= most:
                return None
            failed, sweeps = sweeps, 2 * sweeps
        while sweeps - failed > max(1, sweeps // RESOLUTION):
            middle = (failed + sweeps) // 2
            if enough(self.with_sweeps(method, middle).figures, wanted):
                sweeps = middle
            else:
                failed = middle
        return sweeps

    def quickest(self, wanted: Figures, limit: float, guarded: bool = True) -> Reached | None:
        """Quickest of the methods to a quality; of the guarded ones where that is asked for."""
        best = None
        for method in METHODS:
            if guarded and method == "laplacian":
                continue
            sweeps = self.fewest(method, wanted, limit)
            if sweeps is None:
                continue
            call = self.with_sweeps(method, sweeps)
            if best is None or call.seconds < limit:
                best, limit = (method, sweeps), call.seconds
        if best is None:
            return None
        if best not in self._reached:
            seconds, result = self.median(*best)
            self._reached[best] = Reached(*best, seconds, measure(result.points, self.cells))
        return self._reached[best]
