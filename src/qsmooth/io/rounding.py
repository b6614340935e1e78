"""Whether coordinates bear being rounded to single precision."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from qsmooth._types import BoolArray, FloatArray, IndexArray

ERROR = 8.0 * np.finfo(np.float64).eps  # of a determinant, in units of its two products
SLACK = 1e-9


def bears_single(old: FloatArray, new: FloatArray, cells: Sequence[IndexArray]) -> bool:
    """Whether a mesh rounded to single precision is as good as the promises ask.

    Each corner that is convex stays so, by more than rounding errors of its determinant, and the
    worst corner, by the sines and cosines of its angle, is no worse than the old mesh's.

    Parameters
    ----------
    old, new
        Shape (n, 2): coordinates in single precision, as a file has them, and those to be rounded.
    cells
        Arrays of shape (m, corners), counter-clockwise or all clockwise.
    """
    with np.errstate(over="ignore"):
        rounded = new.astype(np.float32).astype(np.float64)
    if not np.isfinite(rounded).all():
        return False
    for block in cells:
        if not len(block):
            continue
        _, _, old_sine, old_cosine = _corners(old, block)
        convex, concave, new_sine, _ = _corners(new, block)
        safe, safe_clockwise, sine, cosine = _corners(rounded, block)
        if new_sine.sum() < 0:  # the cells run clockwise
            old_sine, sine = -old_sine, -sine
            convex, safe = concave, safe_clockwise
        if (convex & ~safe).any() or sine.min() < old_sine.min() - SLACK:
            return False
        if cosine.min() < old_cosine.min() - SLACK or cosine.max() > old_cosine.max() + SLACK:
            return False
    return True


def _corners(
    xy: FloatArray, block: IndexArray
) -> tuple[BoolArray, BoolArray, FloatArray, FloatArray]:
    """Which corners surely turn left, which right; the sines and cosines of their angles."""
    ahead = xy[np.roll(block, -1, axis=1)] - xy[block]
    behind = xy[np.roll(block, 1, axis=1)] - xy[block]
    one, two = ahead[..., 0] * behind[..., 1], ahead[..., 1] * behind[..., 0]
    length = np.hypot(*np.moveaxis(ahead, -1, 0)) * np.hypot(*np.moveaxis(behind, -1, 0))
    length[length == 0] = 1.0
    error = ERROR * (np.abs(one) + np.abs(two))
    cosine = (ahead * behind).sum(axis=-1) / length
    return one - two > error, two - one > error, (one - two) / length, cosine
