"""Cells counted by bins of a metric."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from qsmooth._types import FloatArray

# Values that are counted at one go.
PIECE = 16_384


@dataclass(frozen=True)
class Histogram:
    """Cells per bin of one metric.

    Attributes
    ----------
    edges
        Bin k holds values from ``edges[k]`` (included) to ``edges[k + 1]``; the last may be inf.
    counts
        Cells in each bin. Those under the first edge or over the last count at the ends.
    """

    edges: tuple[float, ...]
    counts: tuple[int, ...]

    @property
    def percent(self) -> tuple[float, ...]:
        """Share of the cells in each bin, in per cent."""
        total = sum(self.counts)
        return tuple(100.0 * count / total if total else 0.0 for count in self.counts)

    @property
    def labels(self) -> tuple[str, ...]:
        """Bins in words, such as "60 to 70" and "180 and more"."""
        return tuple(
            f"{low:g} and more" if np.isinf(high) else f"{low:g} to {high:g}"
            for low, high in zip(self.edges[:-1], self.edges[1:], strict=True)
        )

    def to_dict(self) -> dict[str, Any]:
        """Plain lists, fit for JSON: bins in words, counts, per cent."""
        return {
            "bins": list(self.labels),
            "counts": list(self.counts),
            "percent": list(self.percent),
        }


def count_by_bins(values: FloatArray, edges: Sequence[float]) -> Histogram:
    """Count values by bin."""
    # To look at all values for each edge, in pieces that stay in cache, is quicker than to search
    # for each value. NaN is below no edge and counts at the end.
    at_least = np.zeros(len(edges) - 2, np.int64)
    for first in range(0, values.size, PIECE):
        piece = values[first : first + PIECE]
        at_least += [piece.size - np.count_nonzero(piece < edge) for edge in edges[1:-1]]
    counts = -np.diff([values.size, *at_least.tolist(), 0])
    return Histogram(tuple(float(e) for e in edges), tuple(int(n) for n in counts))
