"""Cells the way that VTK has them: their types, and offsets into one array of vertices."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from qsmooth._types import IndexArray
from qsmooth.errors import MeshError
from qsmooth.io.file_content import N_VERTICES, Block
from qsmooth.io.text import runs

POLY_VERTEX, POLY_LINE, POLYGON, PIXEL, QUAD = 2, 4, 7, 8, 9
TYPES = {
    1: "vertex",
    3: "line",
    5: "triangle",
    6: "triangle_strip",
    QUAD: "quad",
    10: "tetra",
    11: "voxel",
    12: "hexahedron",
    13: "wedge",
    14: "pyramid",
    21: "line3",
    22: "triangle6",
    23: "quad8",
    24: "tetra10",
    25: "hexahedron20",
    26: "wedge15",
    27: "pyramid13",
    28: "quad9",
    34: "triangle7",
    69: "VTK_LAGRANGE_TRIANGLE",
    70: "VTK_LAGRANGE_QUADRILATERAL",
}
CODES = {"vertex": 1, "line": 3, "triangle": 5, "quad": QUAD}


def walk(table: npt.NDArray[Any], n: int) -> IndexArray | None:
    """Where each of `n` rows of a count and so many numbers begins, and the end of the last.

    None where `table` is not `n` such rows.
    """
    size = len(table)
    if n == 0:
        return np.zeros(1, np.int64) if size == 0 else None
    if size < n:
        return None
    if size % n == 0 and bool((table[:: size // n][:n] == size // n - 1).all()):
        return np.arange(0, size + 1, size // n)
    rows, row, numbers = [0], 0, table.tolist()
    for _ in range(n):
        if row >= size or numbers[row] < 0:
            return None
        row += 1 + numbers[row]
        rows.append(row)
    return np.array(rows) if row == size else None


def blocks_of(
    offsets: IndexArray, vertices: IndexArray, types: IndexArray
) -> tuple[list[Block], list[IndexArray]]:
    """Blocks of cells given VTK's way, and for each block the VTK cell each of its cells is of."""
    sizes = np.diff(offsets)
    blocks: list[Block] = []
    sources = []
    for i, j in runs(types * (len(vertices) + 1) + sizes):
        code, size = int(types[i]), int(sizes[i])
        cells = vertices[offsets[i] : offsets[j]].reshape(j - i, size)
        source = np.arange(i, j)
        kind = TYPES.get(code, f"VTK_{code}")
        if code in (POLY_VERTEX, POLY_LINE):  # one cell for each vertex or edge
            step = 1 if code == POLY_LINE else 0
            kind = "line" if step else "vertex"
            parts = [cells[:, k : k + 1 + step] for k in range(size - step)]
            source = np.repeat(source, len(parts))
            cells = np.stack(parts, axis=1).reshape(-1, 1 + step) if parts else cells[:0, :2]
        elif code == POLYGON:
            kind = {3: "triangle", 4: "quad"}.get(size, f"polygon{size}")
        elif code == PIXEL and size == 4:
            kind, cells = "quad", cells[:, [0, 1, 3, 2]]
        if kind in N_VERTICES and cells.shape[1] != N_VERTICES[kind]:
            raise MeshError(f"cell {i} is a {kind} (VTK type {code}) of {size} vertices")
        blocks.append((kind, np.ascontiguousarray(cells)))
        sources.append(source)
    return blocks, sources


def structured(dimensions: Sequence[int]) -> tuple[IndexArray, IndexArray, IndexArray]:
    """The quads of a structured grid one layer thick."""
    sides = [n for n in dimensions if n > 1]
    if len(sides) != 2:
        raise MeshError(f"a structured grid of {list(dimensions)} points is not a surface")
    nx, ny = sides
    first = (np.arange(ny - 1)[:, None] * nx + np.arange(nx - 1)).ravel()
    cells = np.stack((first, first + 1, first + nx + 1, first + nx), axis=1)
    return 4 * np.arange(len(cells) + 1), cells.ravel(), np.full(len(cells), QUAD)
