"""The section nodes of MFEM: places of vertices as a grid function, read where it is linear."""

from __future__ import annotations

import re
from dataclasses import dataclass

import numpy as np

from qsmooth._types import FloatArray, IndexArray
from qsmooth.errors import MeshError
from qsmooth.io.file_content import FACES, Block
from qsmooth.io.in_place import Copies, InPlace, Slots
from qsmooth.io.sides import sides_of_lines
from qsmooth.io.text import Cursor

# One place for each vertex; one for each corner of a cell, in lexicographic order.
CONTINUOUS = re.compile(rb"Linear|H1(?:Pos|@\w)?_[23]D_P1")
DISCONTINUOUS = re.compile(rb"L2_T1_[23]D_P1")
LEXICOGRAPHIC = {3: (0, 1, 2), 4: (0, 1, 3, 2)}


@dataclass
class Nodes:
    """Places, where they stand in the file, and the cells upon them."""

    points: FloatArray
    slots: InPlace
    blocks: list[Block]
    notes: tuple[str, ...] = ()


def read_nodes(
    cursor: Cursor, n_vertices: int, elements: list[Block], boundary: list[Block]
) -> Nodes:
    """Read what follows the word nodes."""
    for word in (b"FiniteElementSpace", b"FiniteElementCollection:"):
        if cursor.word() != word:
            cursor.fail(f"{word.decode()} expected in the section nodes")
    collection = cursor.word()
    if cursor.word() != b"VDim:":
        cursor.fail("VDim: expected in the section nodes")
    dimension = cursor.count("coordinates of a node")
    if dimension not in (2, 3):
        cursor.fail(f"{dimension} coordinates of a node: must be 2 or 3")
    if cursor.word() != b"Ordering:":
        cursor.fail("Ordering: expected in the section nodes")
    interleaved = cursor.count("the ordering")
    if interleaved not in (0, 1):
        cursor.fail(f"Ordering: {interleaved}, must be 0 or 1")
    if CONTINUOUS.fullmatch(collection):
        points, slots = _table(cursor, n_vertices, dimension, bool(interleaved))
        return Nodes(points, slots, [*elements, *boundary])
    if not DISCONTINUOUS.fullmatch(collection):
        shown = collection[:40].decode("latin-1")
        cursor.fail(
            f"nodes of {shown!r} are not read, only linear ones: "
            "a mesh of higher order is curved, and its vertices alone are not the mesh"
        )
    if any(kind not in FACES for kind, _ in elements):
        cursor.fail(f"nodes of {collection.decode()} with other cells than triangles and quads")
    n = sum(cells.size for _, cells in elements)
    points, slots = _table(cursor, n, dimension, bool(interleaved))
    return _merged(points, slots, n_vertices, elements, boundary)


def _table(cursor: Cursor, n: int, dimension: int, interleaved: bool) -> tuple[FloatArray, Slots]:
    """Coordinates of `n` nodes, node by node or all x first."""
    token = cursor.token
    values = cursor.numbers(n * dimension, "f8", "coordinates of nodes")
    tokens = token + np.arange(n * dimension)
    if interleaved:
        return values.reshape(n, dimension), cursor.text.slots(tokens.reshape(n, dimension))
    columns = np.ascontiguousarray(values.reshape(dimension, n).T)
    return columns, cursor.text.slots(tokens.reshape(dimension, n).T)


def _merged(
    corners: FloatArray,
    slots: Slots,
    n_vertices: int,
    elements: list[Block],
    boundary: list[Block],
) -> Nodes:
    """One vertex for each place that a vertex of the file has."""
    copies: list[IndexArray] = []  # the node of each corner of a cell
    first = 0
    for _, cells in elements:
        n, size = cells.shape
        nodes = first + np.arange(n * size).reshape(n, size)
        copies.append(nodes[:, LEXICOGRAPHIC[size]])
        first += n * size
    vertex = np.empty(len(corners), np.int64)
    for nodes, (_, cells) in zip(copies, elements, strict=True):
        vertex[nodes] = cells
    wrong = (vertex < 0) | (vertex >= n_vertices)
    if wrong.any():
        row = int(np.argmax(wrong))
        raise MeshError(
            f"{int(wrong.sum())} corners name a vertex that does not exist, "
            f"the first is vertex {int(vertex[row])}"
        )
    order = np.lexsort((*corners.T[::-1], vertex))
    differs = (corners[order[1:]] != corners[order[:-1]]).any(axis=1)
    differs |= vertex[order[1:]] != vertex[order[:-1]]
    place = np.empty(len(corners), np.int64)
    group = np.cumsum(np.append(False, differs))
    # By vertex, then by the first copy: coordinates, which may change, do not number places.
    leads = order[np.append(0, np.flatnonzero(differs) + 1)]
    rank = np.empty(len(leads), np.int64)
    rank[np.lexsort((leads, vertex[leads]))] = np.arange(len(leads))
    place[order] = rank[group]
    n_places = int(place.max(initial=-1)) + 1
    points = np.empty((n_places, corners.shape[1]))
    points[place] = corners
    blocks = [(kind, place[nodes]) for nodes, (kind, _) in zip(copies, elements, strict=True)]
    blocks += [(kind, _moved(lines, elements, blocks)) for kind, lines in boundary]
    notes: tuple[str, ...] = ()
    n_used = len(np.unique(vertex))
    if n_places > n_used:
        notes = (
            f"{n_used} vertices have {n_places} places, as where a mesh is periodic: each is a "
            "vertex here; sides that belong together stay alike as long as none slides",
        )
    return Nodes(points, Copies(slots, place), blocks, notes)


def _moved(lines: IndexArray, elements: list[Block], blocks: list[Block]) -> IndexArray:
    """Lines on the places of the cells whose sides they are; left where they are no sides."""
    cell, side, _ = sides_of_lines([cells for _, cells in elements], lines)
    moved = np.full_like(lines, -1)
    first = 0
    for (_, old), (_, new) in zip(elements, blocks, strict=False):
        n, size = old.shape
        mine = np.flatnonzero((cell >= first) & (cell < first + n))
        rows, k = cell[mine] - first, side[mine]
        ends = np.stack([new[rows, k], new[rows, (k + 1) % size]], axis=1)
        turned = old[rows, k] != lines[mine, 0]
        moved[mine] = np.where(turned[:, None], ends[:, ::-1], ends)
        first += n
    return moved
