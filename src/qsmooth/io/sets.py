"""Sets of cells that a file names, and what they come to: regions, markers of lines."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from qsmooth._types import IndexArray
from qsmooth.io.file_content import FACES, Block

MOST_PARTS = 10**6  # sets times blocks of elements: a set has an array for each block


def members(ids: IndexArray, sets: dict[str, list[IndexArray]]) -> dict[str, IndexArray]:
    """Where the members of each set stand among `ids`, ascending."""
    if not sets:
        return {}
    order = np.argsort(ids, kind="stable")
    ordered = ids[order]
    sizes = [sum(map(len, parts)) for parts in sets.values()]
    wanted = np.concatenate([part for parts in sets.values() for part in parts])
    wanted, owners = _each_once(wanted, np.repeat(np.arange(len(sets)), sizes))
    begins = np.searchsorted(ordered, wanted)
    counts = np.searchsorted(ordered, wanted, side="right") - begins
    rows = np.repeat(begins - np.cumsum(counts) + counts, counts) + np.arange(counts.sum())
    rows, owners = _each_once(order[rows], np.repeat(owners, counts))
    cuts = np.searchsorted(owners, np.arange(len(sets) + 1)).tolist()
    return {name: rows[i:j] for name, (i, j) in zip(sets, pairwise(cuts), strict=True)}


def _each_once(values: IndexArray, owners: IndexArray) -> tuple[IndexArray, IndexArray]:
    """Values in order within each owner, repeated ones left out."""
    order = np.lexsort((values, owners))
    values, owners = values[order], owners[order]
    first = np.ones(len(values), np.bool_)
    first[1:] = (values[1:] != values[:-1]) | (owners[1:] != owners[:-1])
    return values[first], owners[first]


def by_block(rows: IndexArray, ends: IndexArray) -> list[IndexArray]:
    """Cells counted through all blocks, as cells of each."""
    if len(ends) == 1:
        return [rows]
    cuts = np.searchsorted(rows, ends)
    begins = np.append(0, cuts[:-1])
    firsts = np.append(0, ends[:-1])
    return [rows[i:j] - first for i, j, first in zip(begins, cuts, firsts, strict=True)]


def partition(
    blocks: list[Block], cell_rows: dict[str, IndexArray]
) -> tuple[list[IndexArray] | None, dict[str, tuple[int, int]]]:
    """Regions from the element sets, where each face is in exactly one of them.

    Sets of all faces or of none are left out.
    """
    lengths = [len(cells) for _, cells in blocks]
    is_face = np.repeat([kind in FACES for kind, _ in blocks], lengths)
    count = np.zeros(len(is_face), np.int64)
    tags = np.zeros(len(is_face), np.int64)
    names: dict[str, tuple[int, int]] = {}
    n_faces = np.count_nonzero(is_face)
    for name, rows in cell_rows.items():
        if 0 < np.count_nonzero(is_face[rows]) < n_faces:
            names[name] = (len(names) + 1, 2)
            count[rows] += 1
            tags[rows] = len(names)
    if not names or (count[is_face] != 1).any():
        return None, {}
    return np.split(tags, np.cumsum(lengths)[:-1]), names


def line_markers(
    blocks: list[Block], cell_rows: dict[str, IndexArray]
) -> tuple[list[IndexArray] | None, dict[str, tuple[int, int]]]:
    """Markers of lines from the sets with lines, where none is in two of them; 0 for no set."""
    lengths = [len(cells) for _, cells in blocks]
    is_line = np.repeat([kind == "line" for kind, _ in blocks], lengths)
    tags = np.zeros(len(is_line), np.int64)
    names: dict[str, tuple[int, int]] = {}
    for name, rows in cell_rows.items():
        lines = rows[is_line[rows]]
        if tags[lines].any():
            return None, {}
        if len(lines):
            names[name] = (len(names) + 1, 1)
            tags[lines] = len(names)
    return (np.split(tags, np.cumsum(lengths)[:-1]), names) if names else (None, {})
