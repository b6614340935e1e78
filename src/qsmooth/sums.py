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
    from qsmooth.kernels.sums import EXPONENTS, HALF_BITS, add_exactly

    values = np.ascontiguousarray(values, dtype=np.float64).ravel()
    halves = np.zeros((EXPONENTS, 2), np.int64)
    add_exactly(read_only(values.view(np.int64)), halves)
    if halves[-1].any():
        with np.errstate(invalid="ignore"):
            return float(values.sum())
    used = np.flatnonzero(halves.any(axis=1)).tolist()
    if not used:
        return 0.0
    first = used[0]
    total = 0
    for exponent in used:
        high, low = halves[exponent].tolist()
        total += ((high << HALF_BITS) + low) << (exponent - first)
    try:
        return total / (1 << (BIAS - first)) if first < BIAS else float(total << (first - BIAS))
    except OverflowError:
        return math.inf if total > 0 else -math.inf


def exact_mean(values: FloatArray) -> float:
    """Mean; NaN of nothing."""
    return exact_sum(values) / values.size if values.size else math.nan
