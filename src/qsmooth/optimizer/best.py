"""The best coordinates that were seen; what is held needs no look, as no sweep lets it go."""

from __future__ import annotations

import math

from qsmooth._types import FloatArray
from qsmooth.optimizer.figures import LEAST_GAIN, Figures
from qsmooth.optimizer.lanes import Lanes
from qsmooth.optimizer.progress import Progress
from qsmooth.outcome import Forbidden

# So near a sine of one the worst corner has nothing to gain: a quarter of a degree off.
AT_LIMIT = 1e-5
# A better worst corner that the allowed loss of the mean forbids is told of from this gain on.
LEAST_FORBIDDEN = 1e-2
# The share of the mean shape that the worst cells may cost if nothing else is said.
MEAN_LOSS = 0.1
# What the worst cells may cost the sizes: by so much may the mean of γ |log τ| grow.
MOST_RESIZED = 0.06
# The percentile that high angles stand for; how much they count, by what they lack to 180 degrees.
HIGH, HIGH_COUNTS = 99.0, 0.3


class Best:
    """The best coordinates so far.

    Parameters
    ----------
    lanes, xy, progress
        The sweeps, the coordinates to begin with, (n, 2), and where rounds are noted.
    mean_loss
        Share of the best mean shape towards the target that the worst cells may cost.
    enough
        Smallest scaled Jacobian that is enough, or None.
    keep_mean
        Whether the mean shape is to stay what it was given as, at least, unless `mean_loss` is more
        than usual.

    Attributes
    ----------
    xy, figures
        The best coordinates, (n, 2), and their figures.
    given, last
        Figures of the coordinates to begin with, and of those that were offered last.
    """

    def __init__(
        self,
        lanes: Lanes,
        xy: FloatArray,
        progress: Progress,
        *,
        mean_loss: float,
        enough: float | None,
        keep_mean: bool = False,
    ) -> None:
        self.lanes, self.progress = lanes, progress
        self._mean_loss, self._enough, self._keep_mean = mean_loss, enough, keep_mean
        # A metric asks for angles of its own: towards it only the energy tells what is better.
        self._by_energy = lanes.targets.kind == "metric"
        self._given_xy, self.xy = xy.copy(), xy.copy()
        self.given = self.figures = self.last = self.measure(xy)
        self._most_resized = math.inf
        self.best_shape = self.given.shape
        # The best worst corner that was seen at a cost beyond the allowed loss of the mean.
        self._too_dear = 0.0

    def offer(self, xy: FloatArray, *, by_mean: bool = False) -> Figures:
        """Measure coordinates, and keep them if they are the best.

        The better worst corner is, even at a loss of the mean; or, by the mean, the better mean.
        """
        now = self._see(xy)
        affordable = self.affords(now)
        # What was the best may have become too dear meanwhile.
        better = now.shape > self.figures.shape if by_mean else self._better(now)
        better |= not self.affords(self.figures)
        fewer = now.n_invalid < self.figures.n_invalid
        # Cells that nothing can mend keep no others from getting better.
        no_more = now.n_invalid <= self.figures.n_invalid
        kept = self._keep(xy, fewer or (affordable and no_more and better))
        if not kept and not affordable and no_more:
            self._too_dear = max(self._too_dear, now.free_jacobian)
        return now

    def _better(self, now: Figures) -> bool:
        if self._by_energy:
            return now.energy < self.figures.energy
        return now.better(self.figures)

    def offer_overall(self, xy: FloatArray, floor: float, low: float) -> bool:
        """Keep coordinates if they are better overall, with a mean shape and low angles like these.

        What is held sees to the worst corner.

        Returns
        -------
        bool
            Whether they are kept.
        """
        now = self._see(xy)
        enough = now.shape >= floor and now.low_angle >= low and self.affords(now)
        return self._keep(xy, enough and now.overall >= self.figures.overall)

    def offer_relaxed(self, xy: FloatArray, low: float, worst: float) -> bool:
        """Keep coordinates with a better mean shape, low angles and a worst shape like these.

        Returns
        -------
        bool
            Whether they are kept.
        """
        now = self._see(xy)
        enough = now.low_angle >= low and now.least_shape >= worst and self.affords(now)
        return self._keep(xy, enough and now.shape > self.figures.shape)

    def offer_eased(self, xy: FloatArray, floor: float, low: float) -> bool:
        """Keep coordinates if they are better overall, high angles included, and like these.

        Parameters
        ----------
        floor, low
            Mean shape and low angles that they must have.

        Returns
        -------
        bool
            Whether they are kept.
        """
        best = self.figures.overall * self._room(self.xy)
        now = self._see(xy)
        enough = now.shape >= floor and now.low_angle >= low and self.affords(now)
        return self._keep(xy, enough and now.overall * self._room(xy) > best)

    def _room(self, xy: FloatArray) -> float:
        """What high angles count for."""
        return float((180.0 - self.lanes.look(xy).high_angle(HIGH)) ** HIGH_COUNTS)

    def _see(self, xy: FloatArray) -> Figures:
        """Measure coordinates that are offered, and note the round."""
        self.last = self.measure(xy)
        self.lanes.report(xy, self.lanes.look(xy).glance, self.progress)
        self.best_shape = max(self.best_shape, self.last.shape)
        return self.last

    def _keep(self, xy: FloatArray, better: bool) -> bool:
        """Take the coordinates offered last for the best if they are better; give that back."""
        if better:
            self.xy[:], self.figures = xy, self.last
        return better

    def mark(self) -> tuple[FloatArray, Figures]:
        """Keep the best so far, to come back to it."""
        return self.xy.copy(), self.figures

    def pays_since(self, mark: tuple[FloatArray, Figures]) -> bool:
        """Whether the worst corner gained more since then than the worst shape lost."""
        old, new = mark[1], self.figures
        if new.n_invalid < old.n_invalid or not self.affords(old):
            return True
        return new.worst_of_all > old.worst_of_all

    def start_again(self, mark: tuple[FloatArray, Figures]) -> None:
        """Go back to what was kept, and forget what would have been too dear since."""
        self.back_to(mark)
        self._too_dear = 0.0

    def back_to(self, mark: tuple[FloatArray, Figures]) -> None:
        """Take what was kept for the best."""
        self.xy[:], self.figures = mark

    def take(self, xy: FloatArray) -> None:
        """Take these coordinates for the best, whatever they are like."""
        self.xy, self.figures = xy, self.measure(xy)

    def floor(self) -> float:
        """Mean shape that the worst cells may not cost more than."""
        share, least = 1.0 - self._mean_loss, 0.0
        if self._keep_mean:
            # What was there before is given up only by those who allow more than is usual.
            least = min(1.0, share / (1.0 - MEAN_LOSS)) * self.given.shape
        return max(share * self.best_shape, least)

    def affords(self, now: Figures) -> bool:
        """Whether neither the mean shape nor the sizes have lost more than is allowed."""
        if self._by_energy:
            return True  # there are no worst cells that shape is given up for
        return now.shape >= self.floor() and now.resized <= self._most_resized

    def limit_sizes(self) -> None:
        """From now on let sizes be little farther from their targets than at the best so far."""
        self._most_resized = self.figures.resized + MOST_RESIZED

    def good_enough(self) -> bool:
        """Whether the smallest scaled Jacobian is what the caller asked for."""
        if self._enough is None or self.lanes.caps.lost.any():
            return False
        return self.figures.free_jacobian >= self._enough

    def at_limit(self) -> bool:
        """Whether the worst corner is as good as any corner can be."""
        return self.figures.free_jacobian >= 1.0 - AT_LIMIT

    def settle(self) -> None:
        """Go back to the coordinates given where nothing of them was to gain."""
        fewer = self.figures.n_invalid < self.given.n_invalid
        gain = self.figures.gain(self.given)
        if self._by_energy:
            gain = 1.0 - self.figures.energy / self.given.energy
        if gain < LEAST_GAIN and not fewer:
            self.xy, self.figures = self._given_xy, self.given

    @property
    def forbidden(self) -> Forbidden | None:
        """A better worst cell that would have cost the mean more than is allowed."""
        if self._too_dear <= self.figures.free_jacobian + LEAST_FORBIDDEN:
            return None
        return Forbidden(scaled_jacobian=self._too_dear, mean_loss=self._mean_loss)

    def measure(self, xy: FloatArray) -> Figures:
        """Measure coordinates, (n, 2)."""
        return self.lanes.figures(xy)
