"""Sums and means of floating-point numbers that do not depend on their order.

What decides how a run goes on has to have the same bits however vertices and cells are numbered,
and whoever adds up which part of them.
"""

from __future__ import annotations

import math

import numpy as np

from qsmooth._types import FloatArray
from qsmooth.checks import read_only

# A float64 is an integer times 2 to the power of its exponent's field less this.
BIAS = 1075


def exact_sum(values: FloatArray) -> float:
    """Add up, and round once.

    Of numbers some of which are not finite it is what any order gives: infinite or NaN.
    """
    scaled = scaled_sum(values)
    if scaled is None:
        with np.errstate(invalid="ignore"):
            return float(np.asarray(values).sum())
    return sum_of_scaled(scaled)


def scaled_sum(values: FloatArray) -> int | None:
    """Add up, as a whole number of 2 ** -1075; None where some are not finite."""
    from qsmooth.kernels.sums import N_LIMBS, add_exactly

    values = np.ascontiguousarray(values, dtype=np.float64).ravel()
    limbs = np.empty(N_LIMBS, np.int64)
    if not add_exactly(read_only(values.view(np.int64)), limbs):
        return None
    return int.from_bytes(limbs.astype("<u4").tobytes(), "little", signed=True)


def sum_of_scaled(scaled: int) -> float:
    """Round what `scaled_sum` gives, or several of these together."""
    try:
        return scaled / (1 << BIAS)
    except OverflowError:
        return math.inf if scaled > 0 else -math.inf


def exact_mean(values: FloatArray) -> float:
    """Mean; NaN of nothing."""
    return exact_sum(values) / values.size if values.size else math.nan
