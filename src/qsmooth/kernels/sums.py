"""Sums that do not depend on order: of floating-point numbers, in integers."""

from typing import Any

import numpy as np

from qsmooth._types import IndexArray
from qsmooth.kernels._jit import kernel

# A float64 is its fraction times a power of two. Fractions are added up in two halves, for each
# power by itself: 2 ** 36 of them fit into 64 bits.
EXPONENTS = 2048
FRACTION_BITS, HALF_BITS = 52, 26
LAST_HALF: Any = np.int64((1 << HALF_BITS) - 1)
FRACTION: Any = np.int64((1 << FRACTION_BITS) - 1)
HIDDEN: Any = np.int64(1 << FRACTION_BITS)


@kernel()
def add_exactly(bits: IndexArray, halves: IndexArray) -> None:
    """Add up numbers by their exponents.

    Parameters
    ----------
    bits : (n,)
        The numbers, float64, seen as integers.
    halves : (EXPONENTS, 2)
        Added to: the upper and the lower halves of the fractions with each exponent. The last row
        is not 0 where a number is not finite.
    """
    last, high, low = np.int64(0), np.int64(0), np.int64(0)
    for word in bits:
        exponent = (word >> FRACTION_BITS) & (EXPONENTS - 1)
        fraction = word & FRACTION
        if exponent == 0:
            exponent = 1
        else:
            fraction |= HIDDEN
        if word < 0 and exponent != EXPONENTS - 1:
            fraction = -fraction
        if exponent != last:  # seldom: most of what is summed up is of one size
            halves[last, 0] += high
            halves[last, 1] += low
            last, high, low = exponent, np.int64(0), np.int64(0)
        high += fraction >> HALF_BITS
        low += fraction & LAST_HALF
    halves[last, 0] += high
    halves[last, 1] += low
