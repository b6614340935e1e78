"""Legacy VTK, text and binary: unstructured grids, polygonal data and structured grids."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt

from qsmooth._types import FloatArray, IndexArray
from qsmooth.errors import MeshError
from qsmooth.io.file_content import N_VERTICES, FileContent, region_tags
from qsmooth.io.in_place import Edit, InPlace, Slots, binary_slots
from qsmooth.io.text import Cursor, finish, rows_of
from qsmooth.io.vtk_cells import (
    CODES,
    POLY_LINE,
    POLY_VERTEX,
    POLYGON,
    blocks_of,
    structured,
    walk,
)

NAME = "vtk"
ENDINGS = (".vtk",)
HOLDS = frozenset(("z", "vertex", "line", "regions", "point_data", "cell_data", "field_data"))

# Names of number types in the file -> dtype.
DTYPES = {
    "char": "i1",
    "signed_char": "i1",
    "unsigned_char": "u1",
    "short": "i2",
    "unsigned_short": "u2",
    "int": "i4",
    "unsigned_int": "u4",
    "long": "i8",
    "unsigned_long": "u8",
    "vtkidtype": "i4",  # VTK writes these as int, whatever they are in memory
    "vtktypeint64": "i8",
    "vtktypeuint64": "u8",
    "vtktypeint32": "i4",
    "float": "f4",
    "double": "f8",
}
NAMES = {"i8": "long", "u8": "unsigned_long", "f8": "double", "i4": "int", "u4": "unsigned_int"}
NAMES |= {"f4": "float", "i2": "short", "u2": "unsigned_short", "i1": "char", "u1": "unsigned_char"}
ATTRIBUTES = {"VECTORS": 3, "NORMALS": 3, "TENSORS": 9, "TENSORS6": 6}
ATTRIBUTES |= {"GLOBAL_IDS": 1, "PEDIGREE_IDS": 1}


def sniff(head: bytes) -> bool:
    """Whether a file that starts so is legacy VTK."""
    return head.lstrip().lower().startswith(b"# vtk datafile")


def read(data: bytes) -> FileContent:
    """Read legacy VTK, versions 1 to 5.1; all data is kept on writing."""
    return _Reader(data).content()


class _Reader:
    """Goes through the keywords of one file."""

    def __init__(self, data: bytes) -> None:
        self.cursor = Cursor(data)
        self.points: FloatArray | None = None
        self.slots: Slots | None = None
        # Cells of each keyword: offsets into vertices, vertices, VTK types, place of each
        self.parts: dict[str, tuple[IndexArray, IndexArray]] = {}
        self.places: dict[str, IndexArray] = {}
        self.types: IndexArray | None = None
        self.dimensions: list[int] = []
        self.data: dict[str, dict[str, npt.NDArray[Any]]] = {"": {}, "POINT": {}, "CELL": {}}
        self.data_slots: dict[str, InPlace] = {}
        self.extras: list[str] = []
        self.notes: list[str] = []

    def content(self) -> FileContent:
        cursor = self.cursor
        cursor.line()
        end = cursor.data.find(b"\n", cursor.pos)  # the title may be empty
        cursor.pos = len(cursor.data) if end < 0 else end + 1
        kind = cursor.line().upper()
        if kind not in (b"ASCII", b"BINARY"):
            cursor.fail(f"ASCII or BINARY expected, found {kind[:40].decode('latin-1')!r}")
        if kind == b"BINARY":
            cursor.order = ">"
        words = [word.upper() for word in _words(cursor.line())]
        while words[:1] == ["FIELD"]:  # ParaView puts one before the data set
            self.field(words, "")
            words = [word.upper() for word in _words(cursor.line())]
        if len(words) != 2 or words[0] != "DATASET":
            cursor.fail(f"DATASET expected, found {' '.join(words)[:40]!r}")
        dataset = words[1]
        if dataset not in ("UNSTRUCTURED_GRID", "POLYDATA", "STRUCTURED_GRID"):
            cursor.fail(
                f"DATASET {dataset[:40]} is not read: its points cannot move; "
                "save it as UNSTRUCTURED_GRID"
            )
        where, size = "", 0
        while line := cursor.line():
            original = _words(line)
            words = [original[0].upper(), *original[1:]]
            key = words[0]
            if key in ("POINT_DATA", "CELL_DATA"):
                where, size = key[:-5], self.integer(words, 1)
                expected = self.n_points if where == "POINT" else len(self.all_cells()[0]) - 1
                if size != expected:
                    cursor.fail(f"{key} says {size}, the file has {expected}")
            elif key == "METADATA":
                blank = re.compile(rb"\n[ \t\r]*\n").search(cursor.data, cursor.pos - 1)
                cursor.pos = blank.end() if blank else len(cursor.data)
            elif key == "FIELD":
                self.field(words, where)
            elif where:
                self.attribute(words, where, size)
            else:
                self.geometry(words)
        return self.assemble(dataset)

    def geometry(self, words: list[str]) -> None:
        cursor, key = self.cursor, words[0]
        if key == "POINTS":
            n = self.integer(words, 1)
            dtype = self.dtype(words, 2)
            line_start = cursor.line_start
            self.points, slots = cursor.points(n, 3, dtype=dtype)
            # Other readers would round what is written to a file that says float.
            widen: tuple[Edit, ...] = ()
            if dtype == "f4":
                begin = cursor.data.lower().index(b"float", line_start)
                widen = ((begin, begin + 5, b"double"),)
            elif dtype != "f8":
                cursor.fail(f"points of type {words[2]} cannot move: save them as double")
            self.slots = replace(slots, widen=widen)
        elif key == "DIMENSIONS":
            self.dimensions = [self.integer(words, i) for i in (1, 2, 3)]
        elif key in ("CELLS", "POLYGONS", "LINES", "VERTICES", "TRIANGLE_STRIPS"):
            self.cells(words)
        elif key == "CELL_TYPES":
            self.types = cursor.numbers(self.integer(words, 1), "i4", "cell types")
        else:
            cursor.pos = cursor.line_start
            cursor.fail(f"{key[:40]!r} is no keyword of VTK, or a count before it is wrong")

    def cells(self, words: list[str]) -> None:
        """Rows of a count and so many vertices; from version 5 on offsets and vertices."""
        cursor, key = self.cursor, words[0]
        n, size = self.integer(words, 1), self.integer(words, 2)
        after = cursor.pos
        line = cursor.line().split()
        if line[:1] == [b"OFFSETS"]:
            offsets = cursor.numbers(
                n, self.dtype([word.decode("latin-1") for word in line], 1), "offsets"
            )
            line = cursor.line().split()
            if line[:1] != [b"CONNECTIVITY"]:
                cursor.fail("CONNECTIVITY expected")
            dtype = self.dtype([word.decode("latin-1") for word in line], 1)
            vertices = cursor.numbers(size, dtype, "vertices")
            if offsets.dtype.kind == "f" or vertices.dtype.kind == "f":
                cursor.fail(f"the offsets and vertices of {key} are no integers")
            offsets, vertices = offsets.astype(np.int64), vertices.astype(np.int64)
            if n and (offsets[0] != 0 or offsets[-1] != size or (np.diff(offsets) < 0).any()):
                cursor.fail(f"the offsets of {key} do not fit its {size} vertices")
            self.parts[key] = offsets, vertices
            return
        cursor.pos = after
        if cursor.order:
            table = cursor.numbers(size, "i4", key.lower())
            rows = walk(table, n)
            if rows is None:
                cursor.fail(f"{key} says {n} cells in {size} numbers, its rows are otherwise")
        else:
            # Rows say their own length: what counts is where the next keyword stands.
            stop = re.compile(rb"^[ \t]*[A-Za-z]", re.M).search(cursor.data, cursor.pos)
            end = stop.start() if stop else len(cursor.data)
            token = cursor.token
            n_numbers = int(np.searchsorted(cursor.text.starts, end)) - token
            table = cursor.numbers(n_numbers, "i8", key.lower())
            rows = walk(table, n)
            if rows is None:
                cursor.pos = cursor.line_start
                cursor.fail(
                    f"{key} says {n} cells in {size} numbers, "
                    f"the {n_numbers} numbers that follow are not {n} rows"
                )
            if n_numbers != size:
                self.notes.append(
                    f"{key} says {size} integers, its {n} rows have {n_numbers}: read by rows"
                )
            self.places[key] = cursor.text.starts[token + rows[:-1]]
        keep = np.ones(len(table), np.bool_)
        keep[rows[:-1]] = False
        self.parts[key] = rows - np.arange(n + 1), table[keep].astype(np.int64)

    def attribute(self, words: list[str], where: str, size: int) -> None:
        cursor, key = self.cursor, words[0]
        name = words[1] if len(words) > 1 else ""
        n_components = ATTRIBUTES.get(key, 0)
        if key == "SCALARS":
            n_components = self.integer(words, 3) if len(words) > 3 else 1
            before = cursor.pos
            if not cursor.line().upper().startswith(b"LOOKUP_TABLE"):
                cursor.pos = before
        elif key == "COLOR_SCALARS":
            n_components = self.integer(words, 2)
            words = [key, name, "unsigned_char" if cursor.order else "float"]
        elif key == "LOOKUP_TABLE":
            size, n_components = self.integer(words, 2), 4
            words = [key, name, "unsigned_char" if cursor.order else "float"]
        elif key == "TEXTURE_COORDINATES":
            n_components = self.integer(words, 2)
            words = [key, name, *words[3:]]
        elif not n_components:
            cursor.pos = cursor.line_start
            cursor.fail(f"{key[:40]!r} is no keyword of VTK, or a count before it is wrong")
        if len(words) < 3:
            cursor.fail(f"{key} needs a name and a type")
        place = cursor.pos
        values = self.values(size, n_components, words[2])
        if key == "LOOKUP_TABLE":
            self.extras.append(f"lookup table {name}")
        elif values is not None:
            self.keep(where, name, values, place, words[2])

    def field(self, words: list[str], where: str) -> None:
        cursor = self.cursor
        for _ in range(self.integer(words, 2)):
            line = _words(cursor.line())
            while line[:1] == ["METADATA"]:
                blank = re.compile(rb"\n[ \t\r]*\n").search(cursor.data, cursor.pos - 1)
                cursor.pos = blank.end() if blank else len(cursor.data)
                line = _words(cursor.line())
            if len(line) != 4:
                cursor.fail("an array of a FIELD needs name, components, tuples and type")
            place = cursor.pos
            values = self.values(self.integer(line, 2), self.integer(line, 1), line[3])
            if values is not None:
                self.keep(where, line[0].replace("%20", " "), values, place, line[3])

    def keep(
        self, where: str, name: str, values: npt.NDArray[Any], place: int, type_name: str
    ) -> None:
        """Keep an array; of point data that are floats, also where they stand in the file."""
        self.data[where][name] = values
        if where != "POINT" or values.dtype.kind != "f" or not values.size:
            return
        cursor, table = self.cursor, values.reshape(len(values), -1)
        if cursor.order:
            dtype = np.dtype(cursor.order + self.dtype([type_name], 0))
            stride = dtype.itemsize * table.shape[1]
            slots = binary_slots(place, len(table), dtype, stride, table.shape[1])
        else:
            token = int(np.searchsorted(cursor.text.starts, place))
            slots = cursor.text.slots(token + np.arange(table.size).reshape(table.shape))
        self.data_slots[name] = replace(slots, keeps_type=True)

    def values(self, size: int, n_components: int, type_name: str) -> npt.NDArray[Any] | None:
        cursor, n = self.cursor, size * n_components
        if type_name.lower() == "string":
            if n > len(cursor.data) - cursor.pos:
                cursor.fail(f"the file ends too early: {n} texts expected")
            for _ in range(n):
                self.skip_string()
            self.extras.append("text data")
            return None
        if type_name.lower() == "bit":
            if cursor.order:
                packed = cursor.numbers((n + 7) // 8, "u1", "bits")
                values = np.unpackbits(packed, count=n).astype(np.int64)
            else:
                values = cursor.numbers(n, "i8", "bits")
        else:
            values = cursor.numbers(n, self.dtype(["", type_name], 1), "values")
        return values if n_components == 1 else values.reshape(size, n_components)

    def skip_string(self) -> None:
        """Pass over one text: a line, or in a binary file its length and so many bytes."""
        cursor = self.cursor
        if not cursor.order:
            end = cursor.data.find(b"\n", cursor.pos)
            cursor.pos = len(cursor.data) if end < 0 else end + 1
            return
        # The first two bits say in how many bytes the length is given.
        size = {3: 1, 2: 2, 1: 4, 0: 8}[int(cursor.numbers(1, "u1", "lengths")[0]) >> 6]
        cursor.pos -= 1
        length = int.from_bytes(cursor.data[cursor.pos : cursor.pos + size], "big")
        cursor.numbers(size + (length & ((1 << (8 * size - 2)) - 1)), "u1", "letters")

    def integer(self, words: Sequence[str], i: int) -> int:
        if i >= len(words) or not re.fullmatch(r"[0-9]+", words[i]):
            self.cursor.fail(f"{words[0][:40]} needs a count, found {' '.join(words[i : i + 1])!r}")
        return int(words[i])

    def dtype(self, words: Sequence[str], i: int) -> str:
        if i >= len(words) or words[i].lower() not in DTYPES:
            self.cursor.fail(f"number type {' '.join(words[i : i + 1])[:40]!r} is unknown")
        return DTYPES[words[i].lower()]

    @property
    def n_points(self) -> int:
        return 0 if self.points is None else len(self.points)

    def all_cells(self) -> tuple[IndexArray, IndexArray, IndexArray]:
        """Offsets, vertices and VTK types of all cells, in the order of cell data."""
        if self.dimensions:
            return structured(self.dimensions)
        if "CELLS" in self.parts:
            offsets, vertices = self.parts["CELLS"]
            if self.types is None or len(self.types) != len(offsets) - 1:
                found = "no" if self.types is None else len(self.types)
                self.cursor.fail(
                    f"{len(offsets) - 1} cells need as many CELL_TYPES, there are {found}"
                )
            return offsets, vertices, self.types.astype(np.int64)
        keys = ("VERTICES", "LINES", "POLYGONS", "TRIANGLE_STRIPS")
        types = (POLY_VERTEX, POLY_LINE, POLYGON, 6)
        found_parts = [
            (self.parts[key], t) for key, t in zip(keys, types, strict=True) if key in self.parts
        ]
        sizes = [np.diff(offsets) for (offsets, _), _ in found_parts]
        none = np.empty(0, np.int64)
        return (
            np.cumsum(np.concatenate(([0], *sizes))),
            np.concatenate([none, *(vertices for (_, vertices), _ in found_parts)]),
            np.concatenate(
                [none, *(np.full(len(s), t) for s, (_, t) in zip(sizes, found_parts, strict=True))]
            ),
        )

    def assemble(self, dataset: str) -> FileContent:
        if self.points is None:
            raise MeshError("the file has no POINTS")
        if self.dimensions and math.prod(self.dimensions) != self.n_points:
            raise MeshError(f"DIMENSIONS {self.dimensions} do not fit {self.n_points} points")
        offsets, vertices, types = self.all_cells()
        places = self.places.get("CELLS")
        blocks, sources = blocks_of(offsets, vertices, types)
        data = {name: [array[s] for s in sources] for name, array in self.data["CELL"].items()}
        return FileContent(
            self.points,
            blocks,
            region_tags(data, blocks),
            point_data=dict(self.data["POINT"]),
            cell_data=data,
            field_data=dict(self.data[""]),
            extras=tuple(self.extras),
            notes=tuple(self.notes),
            slots=self.slots,
            data_slots=self.data_slots,
            places=None if places is None else [places[s] for s in sources],
        )


def _words(line: bytes) -> list[str]:
    """Split first: as text, more than white space of ASCII would divide words."""
    return [word.decode("latin-1") for word in line.split()]


def write(content: FileContent) -> bytes:
    """Write an unstructured grid as text, version 3.0, which every reader of VTK understands."""
    blocks = [b for b, (kind, _) in enumerate(content.blocks) if kind in N_VERTICES]
    cells = [content.blocks[b] for b in blocks]
    n = sum(len(c) for _, c in cells)
    size = sum(c.size + len(c) for _, c in cells)
    lines = ["# vtk DataFile Version 3.0", "written by qsmooth", "ASCII"]
    lines += ["DATASET UNSTRUCTURED_GRID"]
    lines += _fields(content.field_data)
    lines += [f"POINTS {len(content.points)} double", *rows_of(content.points_3d)]
    lines.append(f"CELLS {n} {size}")
    for _, c in cells:
        lines += rows_of(np.full(len(c), c.shape[1]), c)
    lines.append(f"CELL_TYPES {n}")
    for kind, c in cells:
        lines += [str(CODES[kind])] * len(c)
    cell_data = cell_arrays(content, blocks)
    for where, count, arrays in (
        ("POINT_DATA", len(content.points), content.point_data),
        ("CELL_DATA", n, cell_data),
    ):
        if arrays:
            lines += [f"{where} {count}", *_fields(arrays)]
    return finish(lines)


def cell_arrays(content: FileContent, blocks: list[int]) -> dict[str, npt.NDArray[Any]]:
    """Cell data over all of these blocks, the regions among them."""
    arrays = {
        name: np.concatenate([np.asarray(parts[b]) for b in blocks])
        for name, parts in content.cell_data.items()
    }
    if content.tags is not None and region_tags(content.cell_data, content.blocks) is None:
        arrays["region"] = np.concatenate([content.tags[b] for b in blocks])
    return arrays


def _fields(arrays: dict[str, Any]) -> list[str]:
    """Arrays in the form that VTK gives data of any shape."""
    if not arrays:
        return []
    lines = [f"FIELD FieldData {len(arrays)}"]
    for name, values in arrays.items():
        array = np.atleast_1d(np.asarray(values))
        if array.dtype.kind == "b":
            array = array.astype(np.uint8)
        table = array.reshape(len(array), -1)
        type_name = NAMES.get(array.dtype.str[1:], "double")
        label = name.replace(" ", "%20")  # as VTK does
        lines.append(f"{label} {table.shape[1]} {len(table)} {type_name}")
        lines += rows_of(table)
    return lines
