"""The best coordinates that were seen, by the promise that no figure gets worse than it was."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from qsmooth._types import FloatArray
from qsmooth.metrics import Quality
from qsmooth.optimizer.lanes import Lanes
from qsmooth.optimizer.progress import Progress
from qsmooth.outcome import Forbidden, Trade

# A result that is better by less than this in every figure is not worth moving a vertex for.
LEAST_GAIN = 1e-3
# Gain in the smallest scaled Jacobian for which the mean shape may get worse than it was.
LEAST_TRADE = 1e-2


@dataclass
class Figures:
    """The four figures that a result must not lower, and two more.

    `free_jacobian` is the smallest scaled Jacobian of the corners that can change, 0 where one of
    them is not positive.
    """

    min_angle: float
    max_angle: float
    scaled_jacobian: float
    shape: float
    free_jacobian: float
    n_invalid: int

    def no_worse(self, other: Figures) -> bool:
        """Whether none of the four figures is worse than the other's."""
        return self.worst_no_worse(other) and self.shape >= other.shape

    def worst_no_worse(self, other: Figures) -> bool:
        """Whether the worst cells are no worse than the other's."""
        return (
            self.n_invalid <= other.n_invalid
            and self.min_angle >= other.min_angle
            and self.max_angle <= other.max_angle
            and self.scaled_jacobian >= other.scaled_jacobian
        )

    def better(self, other: Figures) -> bool:
        """Whether the worst corner is better, or about as good with a better mean."""
        gain = self.free_jacobian - other.free_jacobian
        return gain > LEAST_GAIN or (gain > -LEAST_GAIN and self.shape > other.shape)

    def gain(self, other: Figures) -> float:
        """Largest gain over the other in any figure; angles count in radians."""
        return max(
            math.radians(self.min_angle - other.min_angle),
            math.radians(other.max_angle - self.max_angle),
            self.scaled_jacobian - other.scaled_jacobian,
            self.free_jacobian - other.free_jacobian,
            self.shape - other.shape,
        )


class Best:
    """The best coordinates so far, and what could be had at a price.

    Parameters
    ----------
    lanes, xy, progress
        The sweeps, the coordinates to begin with, (n, 2), and where rounds are noted.
    mean_loss
        Share of the best mean shape that the worst cells may cost.
    target
        Smallest scaled Jacobian that is enough, or None.

    Attributes
    ----------
    xy, figures
        The best coordinates, (n, 2), and their figures.
    given
        Figures that the result must not be worse than.
    updates
        How often the worst corner got better.
    trades, forbidden
        What `settle` found, as in `Outcome`.
    """

    def __init__(
        self,
        lanes: Lanes,
        xy: FloatArray,
        progress: Progress,
        *,
        mean_loss: float,
        target: float | None,
    ) -> None:
        self.lanes, self.progress = lanes, progress
        self._mean_loss, self._target = mean_loss, target
        self.updates = 0
        self.trades: tuple[Trade, ...] = ()
        self.forbidden: Forbidden | None = None
        self.restart(xy)

    def restart(self, xy: FloatArray, *, mean_counts: bool = True) -> None:
        """Take these coordinates as the ones that the result must not be worse than.

        The mean shape of a mesh that has just been untangled need not be kept.
        """
        self._given_xy, self.xy = xy.copy(), xy.copy()
        self.given = self.figures = self._measure(xy, self.lanes.quality(xy))
        self.best_shape = self.given.shape if self.given.n_invalid == 0 else 0.0
        if not mean_counts:
            self.given = replace(self.given, shape=0.0)
        # The best of those that lower the mean shape alone: taken where nothing keeps all figures.
        self._trade: tuple[FloatArray, Figures] | None = None
        # The best worst corner that was seen at a cost beyond the allowed loss of the mean.
        self._too_dear = 0.0

    def offer(self, xy: FloatArray) -> Figures:
        """Measure coordinates, and keep them if they are the best."""
        quality = self.lanes.quality(xy)
        now = self._measure(xy, quality)
        self.lanes.report(xy, quality, self.progress)
        self.best_shape = max(self.best_shape, now.shape)
        affordable = now.shape >= self.floor()
        if now.n_invalid < self.figures.n_invalid or (
            affordable and now.no_worse(self.given) and now.better(self.figures)
        ):
            self.updates += now.free_jacobian > self.figures.free_jacobian + LEAST_GAIN
            self.xy[:], self.figures = xy, now
        elif affordable and now.n_invalid == 0 and now.worst_no_worse(self.given):
            then = self.given if self._trade is None else self._trade[1]
            if self._trade is None or now.better(then):
                self.updates += now.free_jacobian > then.free_jacobian + LEAST_GAIN
                self._trade = xy.copy(), now
        elif now.n_invalid == 0 and now.worst_no_worse(self.given):
            self._too_dear = max(self._too_dear, now.free_jacobian)
        return now

    def floor(self) -> float:
        """Mean shape that the worst cells may not cost more than."""
        return (1.0 - self._mean_loss) * self.best_shape

    def reached_target(self) -> bool:
        """Whether the smallest scaled Jacobian is what the caller asked for."""
        return self._target is not None and self.figures.free_jacobian >= self._target

    def settle(self) -> None:
        """Settle on the result: the best, or else a trade, or else the coordinates given."""
        if self.figures.gain(self.given) >= LEAST_GAIN:
            return
        trade = self._trade
        if trade and trade[1].free_jacobian > self.given.free_jacobian + LEAST_TRADE:
            self.xy, self.figures = trade
            shapes = {"before": self.given.shape, "after": self.figures.shape}
            self.trades = (Trade(figure="mean_shape", gained="scaled_jacobian", **shapes),)
            return
        self.xy, self.figures = self._given_xy, self.given
        if self._too_dear > self.given.free_jacobian + LEAST_TRADE:
            self.forbidden = Forbidden(scaled_jacobian=self._too_dear, mean_loss=self._mean_loss)

    def _measure(self, xy: FloatArray, quality: Quality) -> Figures:
        smallest, largest = quality.extreme_angles
        return Figures(
            min_angle=smallest,
            max_angle=largest,
            scaled_jacobian=float(quality.scaled_jacobian.min()),
            shape=float(quality.shape.mean()),
            free_jacobian=1.0 / float(self.lanes.energy(xy)[0].max()),
            n_invalid=quality.n_invalid,
        )
