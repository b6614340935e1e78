"""Sides of cells: which one a line is."""

from __future__ import annotations

import numpy as np

from qsmooth._types import IndexArray


def sides_of_lines(
    cells: list[IndexArray], lines: IndexArray
) -> tuple[IndexArray, IndexArray, IndexArray]:
    """Find the cells that lines are sides of.

    Parameters
    ----------
    cells
        Blocks of cells; side `k` goes from corner `k` to the next.
    lines : (n_lines, 2)

    Returns
    -------
    For each line a cell, counted through all blocks, its side, and the other cell at it; -1 where
    there is none.
    """
    if len(lines) == 0 or not cells:
        nothing = np.full(len(lines), -1, np.int64)
        return nothing, nothing.copy(), nothing.copy()
    ends = np.concatenate(
        [np.stack([block, np.roll(block, -1, axis=1)], axis=2).reshape(-1, 2) for block in cells]
    )
    widths = np.concatenate([np.full(len(block), block.shape[1]) for block in cells])
    cell = np.repeat(np.arange(len(widths)), widths)
    side = np.arange(len(cell)) - np.repeat(np.cumsum(widths) - widths, widths)
    largest = 1 + max(int(ends.max()), int(lines.max()))
    keys, wanted = _keys(ends, largest), _keys(lines, largest)
    order = np.argsort(keys, kind="stable")
    begins = np.searchsorted(keys[order], wanted)
    counts = np.searchsorted(keys[order], wanted, side="right") - begins
    first, second = (order[np.minimum(begins + k, len(keys) - 1)] for k in (0, 1))
    return (
        np.where(counts > 0, cell[first], -1),
        np.where(counts > 0, side[first], -1),
        np.where(counts > 1, cell[second], -1),
    )


def _keys(ends: IndexArray, largest: int) -> IndexArray:
    """A number for each pair of vertices, the same in both directions."""
    keys: IndexArray = ends.min(axis=1) * largest + ends.max(axis=1)
    return keys
