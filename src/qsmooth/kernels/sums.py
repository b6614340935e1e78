"""Sums that do not depend on order: of floating-point numbers, in integers."""

from typing import Any

import numpy as np

from qsmooth._types import IndexArray
from qsmooth.kernels._jit import helper, kernel

# A float64 is its fraction times a power of two. Fractions are added up in two halves, for each
# power by itself: 2 ** 36 of them fit into 64 bits.
EXPONENTS = 2048
FRACTION_BITS, HALF_BITS = 52, 26
LAST_HALF: Any = np.int64((1 << HALF_BITS) - 1)
FRACTION: Any = np.int64((1 << FRACTION_BITS) - 1)
HIDDEN: Any = np.int64(1 << FRACTION_BITS)
# The sum is an integer of so many limbs, enough for 2 ** 36 numbers of any exponent and a sign.
LIMB_BITS = 32
LIMB: Any = np.int64((1 << LIMB_BITS) - 1)
N_LIMBS = (EXPONENTS + FRACTION_BITS + 36) // LIMB_BITS + 2


@helper()
def _by_exponents(bits: IndexArray, halves: IndexArray) -> None:
    """Add up the upper and the lower halves of the fractions with each exponent.

    The last row is not 0 where a number is not finite.
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


@kernel()
def add_exactly(bits: IndexArray, limbs: IndexArray) -> bool:
    """Add up numbers.

    Parameters
    ----------
    bits : (n,)
        The numbers, float64, seen as integers.
    limbs : (N_LIMBS,)
        Overwritten: the sum over 2 ** -1075, an integer in limbs of `LIMB_BITS`, the lowest first,
        in two's complement.

    Returns
    -------
    bool
        Whether all numbers are finite; else the limbs say nothing.
    """
    halves = np.zeros((EXPONENTS, 2), np.int64)
    _by_exponents(bits, halves)
    limbs[:] = 0
    for exponent in range(EXPONENTS):
        for half in range(2):
            value = halves[exponent, half]
            if value != 0:
                place = exponent + (0 if half else HALF_BITS)
                k, shift = place // LIMB_BITS, place % LIMB_BITS
                low, high = (value & LIMB) << shift, (value >> LIMB_BITS) << shift
                limbs[k] += low & LIMB
                limbs[k + 1] += (low >> LIMB_BITS) + (high & LIMB)
                limbs[k + 2] += high >> LIMB_BITS
    carry = np.int64(0)
    for k in range(limbs.size):
        total = limbs[k] + carry
        limbs[k], carry = total & LIMB, total >> LIMB_BITS
    return bool(halves[EXPONENTS - 1, 0] == 0 and halves[EXPONENTS - 1, 1] == 0)
