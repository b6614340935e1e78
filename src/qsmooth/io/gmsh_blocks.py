"""Gmsh's versions 4.0 and 4.1, in which nodes and elements stand in a block for each entity."""

from __future__ import annotations

import numpy as np

from qsmooth._types import FloatArray, IndexArray
from qsmooth.io.gmsh_types import TYPES, type_of
from qsmooth.io.in_place import Slots
from qsmooth.io.text import Cursor, runs

# Type, (physical, geometrical) tags, vertex ids and places in the file of a run of elements.
Part = tuple[int, IndexArray, IndexArray, IndexArray]
# (dimension, entity) -> physical tag
Physical = dict[tuple[int, int], int]


def entities(cursor: Cursor, version: float) -> Physical:
    """Read what physical group each entity is of; 0 where it is of none."""
    # Text and binary alike: counts of four dimensions, then each entity with its box.
    physical = {}
    for dimension, count in enumerate(cursor.numbers(4, "i8").tolist()):
        n_box = 3 if dimension == 0 and version > 4.0 else 6
        for _ in range(count):
            tag = int(cursor.numbers(1, "i4")[0])
            cursor.numbers(n_box, "f8")
            groups = cursor.numbers(int(cursor.numbers(1, "i8")[0]), "i4").tolist()
            physical[dimension, tag] = abs(groups[0]) if groups else 0
            if dimension:
                cursor.numbers(int(cursor.numbers(1, "i8")[0]), "i4")
    return physical


def nodes(cursor: Cursor, version: float) -> list[tuple[IndexArray, FloatArray, Slots]]:
    """Read ids, coordinates and the places of these, of each block of $Nodes."""
    n_blocks, n_nodes = _head_of_section(cursor, version)
    blocks: list[tuple[IndexArray, FloatArray, Slots]] = []
    for _ in range(n_blocks):
        dimension, _, parametric, n = _head_of_block(cursor, version)
        if n < 0 or n > len(cursor.data):
            cursor.fail(f"{n} nodes in a block")
        if n == 0 and blocks:
            continue
        n_columns = 3 + (dimension if parametric else 0)  # u, v, w after z
        if version == 4.0:
            token = cursor.token
            points, slots = cursor.points(n, 1 + n_columns, (1, 2, 3))
            ids = cursor.text.numbers_at(token + (1 + n_columns) * np.arange(n), np.int64)
        else:
            ids = cursor.numbers(n, "i8", "node tags")
            points, slots = cursor.points(n, n_columns)
        blocks.append((ids, points, slots))
    found = sum(len(ids) for ids, _, _ in blocks)
    if found != n_nodes:
        cursor.fail(f"$Nodes says {n_nodes} nodes, its blocks have {found}")
    return blocks


def elements(cursor: Cursor, version: float, physical: Physical) -> list[Part]:
    """Read the blocks of $Elements."""
    n_blocks, n_elements = _head_of_section(cursor, version)
    if cursor.order:
        parts = [_binary_elements(cursor, version, physical) for _ in range(n_blocks)]
    else:
        parts = _text_elements(cursor, version, physical, n_blocks)
    found = sum(len(cells) for _, _, cells, _ in parts)
    if found != n_elements:
        cursor.fail(f"$Elements says {n_elements} elements, its blocks have {found}")
    return parts


def _binary_elements(cursor: Cursor, version: float, physical: Physical) -> Part:
    dimension, entity, code, n = _head_of_block(cursor, version)
    _, n_corners = type_of(cursor, code)
    place = cursor.pos
    table = cursor.numbers(n * (1 + n_corners), "i8", "elements").reshape(n, 1 + n_corners)
    pair = np.array([[physical.get((dimension, entity), 0), entity]])
    return code, np.repeat(pair, n, axis=0), table[:, 1:], np.full(n, place)


def _text_elements(cursor: Cursor, version: float, physical: Physical, n_blocks: int) -> list[Part]:
    """All blocks of a section, parsed at once: some files have one for each cell."""
    text = cursor.text
    first, stop = cursor.token, cursor.data.find(b"$", cursor.pos)
    last = int(text.starts.searchsorted(stop)) if stop >= 0 else len(text)
    values = text.numbers(first, last, np.int64)
    heads = _heads_in_text(cursor, version, values, n_blocks, first)
    n_in, begins = heads[:, 3], heads[:, 4]
    parts: list[Part] = []
    for i, j in runs(heads[:, 2]):
        code, n = int(heads[i, 2]), n_in[i:j]
        width = 1 + TYPES[code][1]
        before = np.cumsum(n) - n
        rows = np.repeat(begins[i:j] - width * before, n) + width * np.arange(n.sum())
        of_blocks = zip(heads[i:j, 0].tolist(), heads[i:j, 1].tolist(), strict=True)
        pairs = np.array([[physical.get(one, 0), one[1]] for one in of_blocks])
        table = values[rows[:, None] + np.arange(1, width)]
        parts.append((code, np.repeat(pairs, n, axis=0), table, text.starts[first + rows]))
    return parts


def _heads_in_text(
    cursor: Cursor, version: float, values: IndexArray, n_blocks: int, first: int
) -> IndexArray:
    """Dimension, entity, type, elements of each block, and where these begin, (n_blocks, 5)."""
    text, place = cursor.text, 0
    heads: list[tuple[int, int, int, int, int]] = []
    for _ in range(n_blocks):
        head = values[place : place + 4].tolist()
        cursor.pos = int(text.starts[first + place]) if first + place < len(text) else cursor.pos
        if len(head) < 4:
            cursor.fail(f"{n_blocks} blocks of elements expected, {len(heads)} are there")
        one, two, code, n = head
        _, n_corners = type_of(cursor, code)
        begin, place = place + 4, place + 4 + n * (1 + n_corners)
        if n < 0 or place > len(values):
            cursor.fail(f"a block of {n} elements expected: the file ends too early")
        dimension, entity = (two, one) if version == 4.0 else (one, two)
        heads.append((dimension, entity, code, n, begin))
    if place:
        cursor.pos = int(text.ends[first + place - 1])
    return np.array(heads, np.int64).reshape(-1, 5)


def _head_of_section(cursor: Cursor, version: float) -> tuple[int, int]:
    """Number of blocks and of what is in them; 4.1 has the smallest and the largest tag, too."""
    head = cursor.numbers(2 if version == 4.0 else 4, "i8")
    return int(head[0]), int(head[1])


def _head_of_block(cursor: Cursor, version: float) -> tuple[int, int, int, int]:
    """Dimension, entity, type of element (of nodes: whether parametric), and how many."""
    if cursor.order:
        one, two, kind = cursor.numbers(3, "i4").tolist()
        n = int(cursor.numbers(1, "i8")[0])
    else:
        one, two, kind, n = cursor.numbers(4, "i8").tolist()
    return (two, one, kind, n) if version == 4.0 else (one, two, kind, n)
