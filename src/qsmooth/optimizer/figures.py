"""What coordinates are judged by, and which of two are better."""

from __future__ import annotations

from dataclasses import dataclass

# A result that is better by less than this in every figure is not worth moving a vertex for.
LEAST_GAIN = 1e-3
# Areas count as this multiple of their target at least.
TINY = 1e-6
# The percentile that low angles stand for; how much they and the worst shape count beside the mean.
LOW, LOW_COUNTS, SHAPE_COUNTS = 1.0, 0.3, 0.1


@dataclass(frozen=True)
class Figures:
    """What coordinates are judged by.

    Attributes
    ----------
    free_jacobian
        Smallest scaled Jacobian of the corners that can change, 0 where one is not positive; cells
        that nothing can be done for left out.
    shape
        Mean over the cells of one over the worst corner's energy towards its target.
    plain_shape
        The same towards squares and equilateral triangles.
    n_invalid
        Cells that are not valid.
    least_shape
        One over the energy of the worst of all corners towards its target.
    low_angle
        1st percentile of the cells' smallest angle, in degrees.
    resized
        Mean over the cells of γ |log τ|, τ the area over its target, γ how much that counts.
    energy
        Mean energy of the cells towards their targets, size included.
    """

    free_jacobian: float
    shape: float
    plain_shape: float
    n_invalid: int
    least_shape: float
    low_angle: float
    resized: float
    energy: float

    @property
    def overall(self) -> float:
        """What counts where the worst corners are held: the mean, low angles, the worst shape."""
        return float(self.shape * self.lowest)

    @property
    def lowest(self) -> float:
        """Low angles and the worst shape."""
        return float(self.low_angle**LOW_COUNTS * self.least_shape**SHAPE_COUNTS)

    @property
    def worst_of_all(self) -> float:
        """What counts where a better worst corner costs the worst shape."""
        return self.free_jacobian * self.least_shape

    def better(self, other: Figures) -> bool:
        """Whether the worst corner is better, or about as good with a better mean."""
        gain = self.free_jacobian - other.free_jacobian
        return gain > LEAST_GAIN or (gain > -LEAST_GAIN and self.shape > other.shape)

    def gain(self, other: Figures) -> float:
        """Largest gain over the other: of the worst corner, the mean, or what else counts."""
        gains = [self.free_jacobian - other.free_jacobian, self.shape - other.shape]
        if other.lowest > 0.0:
            gains.append(self.lowest / other.lowest - 1.0)
        return max(gains)
