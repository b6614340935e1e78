"""PLY: a header that declares elements and their properties, then text or binary."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, NoReturn

import numpy as np
import numpy.typing as npt

from qsmooth._types import IndexArray
from qsmooth.errors import MeshError
from qsmooth.io.file_content import FACES, Block, FileContent
from qsmooth.io.in_place import Edit, InPlace, Slots
from qsmooth.io.text import Text, finish, line_of, rows_of, runs

NAME = "ply"
ENDINGS = (".ply",)
HOLDS = frozenset(("z", "line", "point_data"))

DTYPES = {"char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4"}
DTYPES |= {"int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2", "int32": "i4"}
DTYPES |= {"uint32": "u4", "float": "f4", "float32": "f4", "double": "f8", "float64": "f8"}
DTYPES |= {"int64": "i8", "uint64": "u8"}
NAMES = {"i1": "char", "u1": "uchar", "i2": "short", "u2": "ushort", "i4": "int", "u4": "uint"}
NAMES |= {"f4": "float", "f8": "double"}
ORDERS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
CORNERS = ("vertex_indices", "vertex_index")
KINDS = {2: "line", 3: "triangle", 4: "quad"}

# Name, dtype of a value, dtype of the count of a list or "".
Property = tuple[str, str, str]


def sniff(head: bytes) -> bool:
    """Whether a file that starts so is PLY."""
    return head[:3] == b"ply" and head[3:4] in (b"\n", b"\r", b" ")


def read(data: bytes) -> FileContent:
    """Read PLY; every other property and element is kept on writing."""
    return _Reader(data).content()


class _Reader:
    """The header, then one element after the other."""

    def __init__(self, data: bytes) -> None:
        self.data = data
        self.order = "?"
        self.elements: list[tuple[str, int, list[Property]]] = []
        self.widen: list[Edit] = []
        self.comments = False
        self.pos = self.header()

    def fail(self, offset: int, what: str) -> NoReturn:
        where = f"byte {offset}" if self.order and offset >= self.pos else ""
        raise MeshError(f"{where or f'line {line_of(self.data, offset)}'}: {what}")

    def header(self) -> int:
        """Read the declarations; give back where the data begins."""
        self.pos = len(self.data)
        pos = 0
        while True:
            end = self.data.find(b"\n", pos)
            if end < 0:
                raise MeshError("the header has no end_header")
            words = self.data[pos:end].decode("latin-1").split()
            key = words[0] if words else ""
            if key == "end_header":
                break
            try:
                if key == "format":
                    self.order = ORDERS[words[1]]
                elif key == "element":
                    self.elements.append((words[1], int(words[2]), []))
                elif key == "property" and words[1] == "list":
                    item = (words[4], DTYPES[words[3]], DTYPES[words[2]])
                    self.elements[-1][2].append(item)
                elif key == "property":
                    self.elements[-1][2].append((words[2], DTYPES[words[1]], ""))
                    is_coordinate = self.elements[-1][0] == "vertex" and words[2] in "xyz"
                    if is_coordinate and DTYPES[words[1]] == "f4":
                        begin = self.data.index(words[1].encode(), pos + len("property"))
                        self.widen.append((begin, begin + len(words[1]), b"double"))
                elif key in ("comment", "obj_info"):
                    self.comments = True
                elif key not in ("ply", ""):
                    self.fail(pos, f"{key[:40]!r} is no declaration of PLY")
            except (KeyError, IndexError, ValueError) as error:
                if isinstance(error, MeshError):
                    raise
                self.fail(pos, f"{' '.join(words)[:60]!r} is no declaration of PLY")
            pos = end + 1
        if self.order == "?":
            raise MeshError("the header has no format")
        for name, n, _ in self.elements:
            if not 0 <= n <= len(self.data):
                raise MeshError(f"the header says {n} of {name}: the file is too small for them")
        return end + 1

    def content(self) -> FileContent:
        # Blank the header rather than cut it off: places stay those of the file.
        text = None if self.order else Text(b"\n" * self.pos + self.data[self.pos :])
        token, row = 0, 0
        points = slots = None
        point_data: dict[str, Any] = {}
        data_slots: dict[str, InPlace] = {}
        blocks: list[Block] = []
        places, extras = [], []
        for name, n, properties in self.elements:
            if text is None:
                columns, where = self.binary(name, n, properties)
            else:
                columns, where, row = self.ascii(text, row, name, n, properties)
            if name == "vertex":
                if not {"x", "y"} <= set(columns):
                    raise MeshError("the vertices have no x and y")
                axes = [axis for axis in "xyz" if axis in columns]
                points = np.stack([columns[a].astype(np.float64) for a in axes], axis=1)
                if any(np.dtype(d).kind != "f" for p, d, _ in properties if p in axes):
                    raise MeshError("coordinates that are declared integers cannot move")
                index = {p: i for i, (p, _, _) in reversed([*enumerate(properties)])}
                sizes = [np.dtype(d).itemsize for _, d, _ in properties]
                offsets = np.cumsum([0, *sizes])
                slots = self.slots(text, [index[a] for a in axes], properties, offsets, where)
                point_data = {p: v for p, v in columns.items() if p not in "xyz"}
                for p, dtype, count_type in properties:
                    if p in point_data and not count_type and np.dtype(dtype).kind == "f":
                        own = self.slots(text, [index[p]], properties, offsets, where)
                        data_slots[p] = replace(own, widen=(), keeps_type=True)
            elif name == "face":
                corners = next((columns[key] for key in CORNERS if key in columns), None)
                if corners is None:
                    raise MeshError("the faces have no vertex_indices")
                first = 0
                for cells in corners:
                    n_corners = cells.shape[1]
                    kind = KINDS.get(n_corners, f"polygon{n_corners}")
                    blocks.append((kind, cells.astype(np.int64)))
                    places.append(where[first : first + len(cells)])
                    first += len(cells)
                others = [p for p, _, _ in properties if p not in CORNERS]
                extras += [f"face property {p}" for p in others]
            elif name == "edge" and {"vertex1", "vertex2"} <= set(columns):
                cells = np.stack((columns["vertex1"], columns["vertex2"]), axis=1)
                blocks.append(("line", cells.astype(np.int64)))
                places.append(where)
                others = [p for p, _, _ in properties if p not in ("vertex1", "vertex2")]
                extras += [f"edge property {p}" for p in others]
            else:
                extras.append(f"element {name}")
        if points is None:
            raise MeshError("the header declares no element vertex")
        if text is not None and row != len(text.rows) - 1:
            token = int(text.rows[row])
            text.fail(token, f"{len(text.rows) - 1 - row} lines more than the header declares")
        if text is None and self.pos < len(self.data) and self.data[self.pos :].strip():
            self.fail(self.pos, f"{len(self.data) - self.pos} bytes more than the header declares")
        if self.order:  # places are of no use in a binary file
            places = None  # type: ignore[assignment]
        extras += ["comments"] if self.comments else []
        return FileContent(
            points,
            blocks,
            point_data=point_data,
            extras=tuple(extras),
            slots=slots,
            data_slots=data_slots,
            places=places,
        )

    def slots(
        self,
        text: Text | None,
        index: list[int],
        properties: list[Property],
        offsets: IndexArray,
        where: IndexArray,
    ) -> Slots:
        """Where the properties of these numbers are, of each vertex."""
        if text is not None:
            slots = text.slots(np.searchsorted(text.starts, where)[:, None] + np.array(index))
            return Slots(slots.starts, slots.ends, None, tuple(self.widen))
        dtypes = {properties[i][1] for i in index}
        if len(dtypes) > 1:
            raise MeshError("x, y and z are of different types")
        starts = where[:, None] + offsets[index]
        dtype = np.dtype(self.order + dtypes.pop())
        return Slots(starts, starts + dtype.itemsize, dtype, tuple(self.widen))

    def ascii(
        self, text: Text, row: int, name: str, n: int, properties: list[Property]
    ) -> tuple[dict[str, Any], IndexArray, int]:
        """Columns of an element that has a line for each of its `n`."""
        rows = text.rows
        if row + n > len(rows) - 1:
            text.fail(
                len(text),
                f"the header says {n} of {name}, the file ends after {len(rows) - 1 - row}",
            )
        rows = rows[row : row + n + 1]
        at = rows[:-1].copy()  # next token of each line
        columns: dict[str, Any] = {}
        for label, dtype, count in properties:
            parse = np.int64 if np.dtype(dtype).kind in "iu" else np.float64
            self.require(text, rows, at + 1, name)
            if not count:
                columns[label] = text.numbers_at(at, parse)
                at += 1
                continue
            counts = text.numbers_at(at, np.int64)
            self.require(text, rows, at + 1 + counts, name)
            columns[label] = [
                text.numbers_at((at[i:j, None] + 1 + np.arange(counts[i])).ravel(), parse).reshape(
                    j - i, counts[i]
                )
                for i, j in runs(counts)
            ]
            at += 1 + counts
        odd = np.flatnonzero(at != rows[1:])
        if odd.size:
            text.fail(int(rows[odd[0]]), f"this {name} has more numbers than the header declares")
        return columns, text.starts[rows[:-1]], row + n

    def require(self, text: Text, rows: IndexArray, upto: IndexArray, name: str) -> None:
        short = np.flatnonzero((upto > rows[1:]) | (upto < rows[:-1]))
        if short.size:
            text.fail(
                int(rows[short[0]]), f"this {name} has fewer numbers than the header declares"
            )

    def binary(
        self, name: str, n: int, properties: list[Property]
    ) -> tuple[dict[str, Any], IndexArray]:
        """Columns of an element, read in stretches where its lists are of equal length."""
        pieces: list[dict[str, npt.NDArray[Any]]] = []
        where: list[IndexArray] = []
        done, step = 0, 64
        while done < n:
            counts = self.list_lengths(name, properties)
            dtype = np.dtype(self.fields(properties, counts))
            n_left = (len(self.data) - self.pos) // max(dtype.itemsize, 1)
            if n_left == 0:
                self.fail(self.pos, f"the file ends after {done} of {n} {name}")
            take = min(n - done, step, n_left)
            records = np.frombuffer(self.data, dtype, take, self.pos)
            same = np.ones(take, np.bool_)
            for i, count in counts.items():
                same &= records[f"n{i}"] == count
            take = take if same.all() else int(np.argmin(same))
            pieces.append({p: records[:take][p] for p, _, _ in properties})
            where.append(self.pos + dtype.itemsize * np.arange(take, dtype=np.int64))
            self.pos += take * dtype.itemsize
            done += take
            step = 4 * step if same.all() else 64
        columns: dict[str, Any] = {}
        for label, _, count_type in properties:
            parts = [piece[label] for piece in pieces]
            if count_type:
                widths = np.array([part.shape[1] for part in parts])
                columns[label] = [np.concatenate(parts[i:j]) for i, j in runs(widths)]
            elif parts:
                columns[label] = np.concatenate(parts)
            else:
                columns[label] = np.empty(0)
        return columns, np.concatenate([np.empty(0, np.int64), *where])

    def list_lengths(self, name: str, properties: list[Property]) -> dict[int, int]:
        """Length of each list of the record at the present place."""
        counts: dict[int, int] = {}
        at = self.pos
        for i, (_, dtype, count_type) in enumerate(properties):
            size = np.dtype(dtype).itemsize
            if count_type:
                kind = np.dtype(self.order + count_type)
                if at + kind.itemsize > len(self.data):
                    self.fail(at, f"the file ends within a {name}")
                counts[i] = int(np.frombuffer(self.data, kind, 1, at)[0])
                if not 0 <= counts[i] * size <= len(self.data) - at:
                    self.fail(at, f"a list of {counts[i]} in a {name}")
                at += kind.itemsize + counts[i] * size
            else:
                at += size
        return counts

    def fields(self, properties: list[Property], counts: dict[int, int]) -> list[Any]:
        fields: list[Any] = []
        for i, (label, dtype, count_type) in enumerate(properties):
            if count_type:
                fields.append((f"n{i}", self.order + count_type))
                fields.append((label, self.order + dtype, (counts[i],)))
            else:
                fields.append((label, self.order + dtype))
        return fields


def write(content: FileContent) -> bytes:
    """Write PLY as text, with numbers of one component at the vertices as properties."""
    n = len(content.points)
    columns = {axis: content.points_3d[:, i] for i, axis in enumerate("xyz")}
    columns |= _scalars(content)
    lines = ["ply", "format ascii 1.0", f"element vertex {n}"]
    for name, values in columns.items():
        lines.append(f"property {NAMES.get(values.dtype.str[1:], 'double')} {name}")
    faces = content.of_type(*FACES)
    lines.append(f"element face {sum(len(cells) for cells, _ in faces)}")
    lines.append("property list uchar int vertex_indices")
    edges = content.of_type("line")
    if edges:
        lines.append(f"element edge {sum(len(cells) for cells, _ in edges)}")
        lines += ["property int vertex1", "property int vertex2"]
    lines += ["end_header", *rows_of(*columns.values())]
    for cells, _ in faces:
        lines += rows_of(np.full(len(cells), cells.shape[1]), cells)
    for cells, _ in edges:
        lines += rows_of(cells)
    return finish(lines)


def _scalars(content: FileContent) -> dict[str, npt.NDArray[Any]]:
    """Point data as columns of one component, of types that PLY has."""
    columns = {}
    for name, values in content.point_data.items():
        array = np.asarray(values)
        if array.dtype.str[1:] not in NAMES:
            small = array.dtype.kind in "iub" and (not array.size or abs(array).max() < 2**31)
            array = array.astype(np.int32 if small else np.float64)
        table = array.reshape(len(array), -1)
        label = "_".join(name.split())
        for i, column in enumerate(table.T):
            columns[label if table.shape[1] == 1 else f"{label}_{i}"] = column
    return columns
