"""Node data of Gmsh's files: a name, a time, and numbers at each node of those that it has.

Several sections of one name are the times of one quantity: they are columns side by side.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from qsmooth._types import FloatArray, IndexArray
from qsmooth.io.file_content import REGION_NAMES, FileContent
from qsmooth.io.in_place import InPlace, Slots
from qsmooth.io.text import Cursor, rows_of

# A row of a binary file: the node, then its numbers.
NODE = 4
# So many numbers a node may have: a scalar, a vector, a tensor.
WIDTHS = (1, 3, 9)


@dataclass
class NodeData:
    """One section.

    Parameters
    ----------
    name
        The first of its texts.
    ids : (n,)
        Nodes, by their tags.
    values : (n, n_components)
        Their numbers.
    slots
        Where these stand.
    """

    name: str
    ids: IndexArray
    values: FloatArray
    slots: Slots


def read_node_data(cursor: Cursor) -> NodeData | None:
    """Read a section up to its end; None, and nothing read, if it is not as Gmsh writes them."""
    begin = cursor.pos
    header = _header(cursor)
    data = None
    if header is not None:
        name, n_components, n = header
        room = len(cursor.data) - cursor.pos
        if 0 < n * (1 + n_components) <= room and n_components in WIDTHS:
            data = _rows(cursor, name, n, n_components)
    if data is None or cursor.line() != b"$EndNodeData":
        cursor.pos = begin
        return None
    return data


def data_at_points(
    parts: list[NodeData], ids: IndexArray
) -> tuple[dict[str, FloatArray], dict[str, InPlace], int]:
    """Point data by name, where it stands, and how many sections do not have each node once.

    Parameters
    ----------
    ids : (n_vertices,)
        Tags of the nodes, in the order of the mesh.
    """
    order = np.argsort(ids, kind="stable")
    columns: dict[str, list[tuple[FloatArray, Slots]]] = {}
    left_out = 0
    for part in parts:
        rows = np.argsort(part.ids, kind="stable")
        if not np.array_equal(part.ids[rows], ids[order]):
            left_out += 1
            continue
        place = np.empty(len(ids), np.int64)
        place[order] = rows
        slots = Slots(
            part.slots.starts[place], part.slots.ends[place], part.slots.dtype, keeps_type=True
        )
        columns.setdefault(part.name, []).append((part.values[place], slots))
    point_data, data_slots = {}, {}
    for name, found in columns.items():
        table = np.concatenate([values for values, _ in found], axis=1)
        point_data[name] = table[:, 0].copy() if table.shape[1] == 1 else table
        data_slots[name] = Slots(
            np.concatenate([slots.starts for _, slots in found], axis=1),
            np.concatenate([slots.ends for _, slots in found], axis=1),
            found[0][1].dtype,
            keeps_type=True,
        )
    return point_data, dict[str, InPlace](data_slots), left_out


def lines_of_data(content: FileContent) -> list[str]:
    """Sections of all point data that are numbers: with zeros up to a vector or a tensor, and
    columns beyond that as times.
    """
    lines: list[str] = []
    for name, values in content.point_data.items():
        array = np.asarray(values)
        if name in REGION_NAMES or array.dtype.kind not in "fiub" or not array.size:
            continue
        table = array.reshape(len(array), -1).astype(np.float64)
        n, n_columns = table.shape
        parts = [table] if n_columns <= WIDTHS[-1] else np.split(table, n_columns, axis=1)
        for step, part in enumerate(parts):
            width = next(width for width in WIDTHS if width >= part.shape[1])
            part = np.pad(part, ((0, 0), (0, width - part.shape[1])))
            lines += ["$NodeData", "1", f'"{name}"', "1", f"{step}.0", "3", str(step), str(width)]
            lines += [str(n), *rows_of(1 + np.arange(n), part), "$EndNodeData"]
    return lines


def _header(cursor: Cursor) -> tuple[str, int, int] | None:
    """Name, numbers a node and nodes; None where they are not to be found."""
    tags: list[list[bytes]] = []
    for _ in range(3):
        line = cursor.line()
        if not line.isdigit() or int(line) > len(cursor.data) - cursor.pos:
            return None
        tags.append([cursor.line() for _ in range(int(line))])
    texts, _, counts = tags
    if not texts or len(counts) < 3 or not all(word.isdigit() for word in counts[1:3]):
        return None
    name = texts[0].decode("utf-8", "replace").strip('"')
    return name, int(counts[1]), int(counts[2])


def _rows(cursor: Cursor, name: str, n: int, n_components: int) -> NodeData | None:
    """Rows of a node and its numbers, text or binary; None where the file has none so many."""
    if not cursor.order:
        return _text_rows(cursor, name, n, n_components)
    kind: Any = [("id", "i4"), ("values", "f8", (n_components,))]
    dtype = np.dtype(kind).newbyteorder("<" if cursor.order == "<" else ">")
    if n * dtype.itemsize > len(cursor.data) - cursor.pos:
        return None
    records = np.frombuffer(cursor.data, dtype, n, cursor.pos)
    rows = cursor.pos + dtype.itemsize * np.arange(n, dtype=np.int64)
    starts = rows[:, None] + NODE + 8 * np.arange(n_components)
    cursor.pos += n * dtype.itemsize
    slots = Slots(starts, starts + 8, np.dtype(cursor.order + "f8"))
    return NodeData(name, records["id"].astype(np.int64), _doubles(records["values"]), slots)


def _text_rows(cursor: Cursor, name: str, n: int, n_components: int) -> NodeData | None:
    first, text = cursor.token, cursor.text
    last = first + n * (1 + n_components)
    if last > len(text):
        return None
    tokens = first + (1 + n_components) * np.arange(n, dtype=np.int64)
    ids = text.numbers_at(tokens, np.int64)
    places = tokens[:, None] + 1 + np.arange(n_components)
    values = text.numbers_at(places.ravel()).reshape(n, n_components)
    cursor.pos = int(text.ends[last - 1])
    return NodeData(name, ids, values, text.slots(places))


def _doubles(values: npt.NDArray[Any]) -> FloatArray:
    return values.astype(np.float64)
