"""The best coordinates that were seen; what is held needs no look, as no sweep lets it go."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from qsmooth._types import FloatArray
from qsmooth.metrics import Quality
from qsmooth.optimizer.lanes import Lanes
from qsmooth.optimizer.progress import Progress
from qsmooth.outcome import Forbidden

# A result that is better by less than this in every figure is not worth moving a vertex for.
LEAST_GAIN = 1e-3
# A better worst corner that the allowed loss of the mean forbids is told of from this gain on.
LEAST_FORBIDDEN = 1e-2
# What the worst cells may cost the sizes: by so much may the mean of γ |log τ| grow.
MOST_RESIZED = 0.06
# Areas count as this multiple of their target at least.
TINY = 1e-6


@dataclass(frozen=True)
class Figures:
    """What coordinates are judged by.

    Attributes
    ----------
    free_jacobian
        Smallest scaled Jacobian of the corners that can change, 0 where one is not positive.
    shape
        Mean over the cells of one over the worst corner's energy towards its target.
    plain_shape
        The same towards squares and equilateral triangles.
    n_invalid
        Cells that are not valid.
    resized
        Mean over the cells of γ |log τ|, τ the area over its target, γ how much that counts.
    energy
        Mean energy of the cells towards their targets, size included.
    """

    free_jacobian: float
    shape: float
    plain_shape: float
    n_invalid: int
    resized: float = 0.0
    energy: float = 0.0

    def better(self, other: Figures) -> bool:
        """Whether the worst corner is better, or about as good with a better mean."""
        gain = self.free_jacobian - other.free_jacobian
        return gain > LEAST_GAIN or (gain > -LEAST_GAIN and self.shape > other.shape)

    def gain(self, other: Figures) -> float:
        """Largest gain over the other in any figure."""
        return max(self.free_jacobian - other.free_jacobian, self.shape - other.shape)


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

    Attributes
    ----------
    xy, figures
        The best coordinates, (n, 2), and their figures.
    given
        Figures of the coordinates to begin with.
    updates
        How often the worst corner got better.
    """

    def __init__(
        self,
        lanes: Lanes,
        xy: FloatArray,
        progress: Progress,
        *,
        mean_loss: float,
        enough: float | None,
    ) -> None:
        self.lanes, self.progress = lanes, progress
        self._mean_loss, self._enough = mean_loss, enough
        # A metric asks for angles of its own: towards it only the energy tells what is better.
        self._by_energy = lanes.targets.kind == "metric"
        self.updates = 0
        self._given_xy, self.xy = xy.copy(), xy.copy()
        self.given = self.figures = self.measure(xy)
        self._most_resized = math.inf
        self.best_shape = self.given.shape
        # The best worst corner that was seen at a cost beyond the allowed loss of the mean.
        self._too_dear = 0.0

    def offer(self, xy: FloatArray) -> Figures:
        """Measure coordinates, and keep them if they are the best."""
        now = self.measure(xy)
        self.lanes.report(xy, self.lanes.quality(xy), self.progress)
        self.best_shape = max(self.best_shape, now.shape)
        affordable = self.affords(now)
        # What was the best may have become too dear meanwhile.
        better = not self.affords(self.figures) or self._better(now)
        fewer = now.n_invalid < self.figures.n_invalid
        # Cells that nothing can mend keep no others from getting better.
        no_more = now.n_invalid <= self.figures.n_invalid
        if fewer or (affordable and no_more and better):
            self.updates += now.free_jacobian > self.figures.free_jacobian + LEAST_GAIN
            self.xy[:], self.figures = xy, now
        elif not affordable and no_more:
            self._too_dear = max(self._too_dear, now.free_jacobian)
        return now

    def _better(self, now: Figures) -> bool:
        if self._by_energy:
            return now.energy < self.figures.energy
        return now.better(self.figures)

    def relaxed(self, xy: FloatArray) -> bool:
        """Keep coordinates with less energy, unless the mean shape is worse; whether they are kept.

        What is held sees to the worst corner.
        """
        now = self.measure(xy)
        self.lanes.report(xy, self.lanes.quality(xy), self.progress)
        self.best_shape = max(self.best_shape, now.shape)
        if now.shape < self.figures.shape - LEAST_GAIN or not self.affords(now):
            return False
        self.xy[:], self.figures = xy, now
        return True

    def floor(self) -> float:
        """Mean shape that the worst cells may not cost more than."""
        return (1.0 - self._mean_loss) * self.best_shape

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
        return self._enough is not None and self.figures.free_jacobian >= self._enough

    def settle(self) -> None:
        """Go back to the coordinates given where nothing of them was to gain."""
        gain = self.figures.gain(self.given)
        if self._by_energy:
            gain = 1.0 - self.figures.energy / self.given.energy
        if gain < LEAST_GAIN and self.given.n_invalid == 0:
            self.xy, self.figures = self._given_xy, self.given

    @property
    def forbidden(self) -> Forbidden | None:
        """A better worst cell that would have cost the mean more than is allowed."""
        if self._too_dear <= self.figures.free_jacobian + LEAST_FORBIDDEN:
            return None
        return Forbidden(scaled_jacobian=self._too_dear, mean_loss=self._mean_loss)

    def measure(self, xy: FloatArray) -> Figures:
        """Measure coordinates, (n, 2)."""
        quality = self.lanes.quality(xy)
        badness, energy = self.lanes.energy(xy)
        return Figures(
            free_jacobian=1.0 / float(badness.max()),
            energy=float(energy.mean()),
            shape=float((1.0 / self.lanes.worst_shape(xy)).mean()),
            plain_shape=float(np.mean(quality.shape)),
            n_invalid=quality.n_invalid,
            resized=self._resized(quality),
        )

    def _resized(self, quality: Quality) -> float:
        inv_area, weight = self.lanes.sizes.T
        if not weight.any():
            return 0.0
        # Twice the area of a triangle, as the targets are.
        twice = np.where(self.lanes.topology.cell_sizes == 3, 2.0, 1.0)
        tau = np.where(weight > 0.0, twice * quality.area * inv_area, 1.0)
        return float((weight * np.abs(np.log(np.maximum(tau, TINY)))).mean())
