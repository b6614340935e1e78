"""Arrays as text in a page: rounded, put in an order that packs well, packed, and in base64."""

from __future__ import annotations

import base64
import gzip
from typing import Any

import numpy as np
import numpy.typing as npt

# Bits of a figure's 23 that are kept: it is off by 8e-6 of itself at most, .0014° of 180°.
BITS = 16
# Packing more tightly than by this level takes much longer and gains a hundredth.
LEVEL = 6


class Packed:
    """Arrays of a report, each known by its place.

    Attributes
    ----------
    specs
        What the page has to know of each: type, length, how it was put in order.
    texts
        What each became.
    """

    def __init__(self) -> None:
        self.specs: list[dict[str, Any]] = []
        self.texts: list[bytes] = []

    def ids(self, values: npt.ArrayLike) -> int:
        """Add ids as differences, each to the one before."""
        given = np.asarray(values, dtype=np.uint32).ravel()
        steps = np.diff(given, prepend=np.zeros(1, np.uint32))
        return self._add(steps.astype("<u4"), planes=True, delta=True)

    def marks(self, values: npt.ArrayLike) -> int:
        """Add small numbers, a byte each."""
        return self._add(np.asarray(values, dtype=np.uint8).ravel())

    def places(self, values: npt.ArrayLike) -> int:
        """Add coordinates in single precision."""
        return self._add(np.asarray(values).ravel().astype("<f4"), planes=True)

    def figures(self, values: npt.ArrayLike) -> int:
        """Add figures of cells, rounded to `BITS`."""
        with np.errstate(over="ignore"):
            single = np.asarray(values).ravel().astype("<f4")
        return self._add(rounded(single), planes=True)

    def _add(self, array: npt.NDArray[Any], **how: bool) -> int:
        plain = array.view(np.uint8).reshape(array.size, array.itemsize)
        data = np.ascontiguousarray(plain.T).tobytes() if how else plain.tobytes()
        text = base64.b64encode(gzip.compress(data, LEVEL, mtime=0))
        kind = {"f": "f4", "u": f"u{array.itemsize}"}[array.dtype.kind]
        self.specs.append({"type": kind, "length": array.size, **how})
        self.texts.append(text)
        return len(self.texts) - 1


def rounded(values: npt.NDArray[np.float32]) -> npt.NDArray[np.float32]:
    """Round to `BITS` bits; what is not finite stays."""
    dropped = 23 - BITS
    bits = values.view(np.uint32)
    near = (bits + np.uint32(1 << (dropped - 1))) & np.uint32(0xFFFFFFFF << dropped & 0xFFFFFFFF)
    return np.where(np.isfinite(values), near, bits).astype("<u4").view("<f4")
