"""VTK XML unstructured grids: text, base64 or raw appended data, compressed or not."""

from __future__ import annotations

import binascii
import dataclasses
import lzma
import re
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any
from xml.etree import ElementTree

import numpy as np
import numpy.typing as npt

from qsmooth._types import FloatArray, IndexArray
from qsmooth.errors import MeshError
from qsmooth.io.file_content import N_VERTICES, FileContent, region_tags
from qsmooth.io.in_place import Edit, InPlace, Slots, joined, replace
from qsmooth.io.text import Text
from qsmooth.io.vtk import cell_arrays
from qsmooth.io.vtk_cells import CODES, blocks_of
from qsmooth.io.vtu_blocks import MOST_MORE, MOST_TIMES, Storage

NAME = "vtu"
ENDINGS = (".vtu",)
HOLDS = frozenset(("z", "vertex", "line", "regions", "point_data", "cell_data", "field_data"))

DTYPES = {f"Int{8 * size}": f"i{size}" for size in (1, 2, 4, 8)}
DTYPES |= {f"UInt{8 * size}": f"u{size}" for size in (1, 2, 4, 8)}
DTYPES |= {"Float32": "f4", "Float64": "f8"}
NAMES = {dtype: name for name, dtype in DTYPES.items()}
# What an attribute may not have as it is; xml.sax.saxutils, which knows, loads a web client.
ESCAPED = str.maketrans(
    {"&": "&amp;", "<": "&lt;", ">": "&gt;", '"': "&quot;"}
    | {space: f"&#{ord(space)};" for space in "\n\r\t"}
)
POINTS = re.compile(rb"<Points\b[^>]*>\s*(<DataArray\b[^>]*>)")
ARRAY = re.compile(rb"(<(?:DataArray|Array)\b[^>]*>)")
APPENDED = re.compile(rb"<AppendedData\b[^>]*>\s*_")


def sniff(head: bytes) -> bool:
    """Whether a file that starts so is VTK XML."""
    return b"<VTKFile" in head and b"PUnstructuredGrid" not in head


def read(data: bytes) -> FileContent:
    """Read an unstructured grid of one piece or several; all data is kept on writing."""
    return _Reader(data).content()


@dataclass
class _Block(InPlace):
    """Coordinates stored as binary blocks in the XML: the blocks are replaced whole."""

    storage: Storage
    encoded: bool
    # For each piece: first vertex, end, begin and end of the block in the file.
    pieces: list[tuple[int, int, int, int]]
    widen: list[Edit]
    appended: int | None  # where appended data begins; None if it is inline
    dtype: str = "f8"

    def write(self, data: bytes, old: FloatArray, new: FloatArray) -> bytes:
        """See `InPlace`."""
        same = np.ascontiguousarray(old).view(np.int64) == np.ascontiguousarray(new).view(np.int64)
        if same.all():
            return data
        edits = list(self.widen)
        grown: list[tuple[int, int]] = []
        for first, last, begin, end in self.pieces:
            raw = new[first:last].astype(self.storage.order + self.dtype).tobytes()
            stored = self.storage.encode(raw, self.encoded)
            edits.append((begin, end, stored))
            grown.append((begin, len(stored) - (end - begin)))
        if self.appended is not None:
            # The blocks behind move: their offsets follow.
            for match in re.finditer(rb'(?<=\boffset=")\d+(?=")', data[: self.appended]):
                offset = int(match[0])
                shift = sum(by for begin, by in grown if begin < self.appended + offset)
                if shift:
                    edits.append((*match.span(), str(offset + shift).encode()))
        return replace(data, edits)


class _Reader:
    """The XML tree, and the bytes it came from."""

    def __init__(self, data: bytes) -> None:
        self.data = data
        self.appended: int | None = None
        xml = data
        if found := APPENDED.search(data):
            # What follows the underscore may be raw bytes, which are no XML.
            self.appended = found.end()
            end = data.rfind(b"</AppendedData>")
            if end < 0:
                raise MeshError("AppendedData has no end: the file is cut off")
            xml = data[: found.end()] + data[end:]
        try:
            self.root = ElementTree.fromstring(xml)
        except (ElementTree.ParseError, ValueError, LookupError) as error:
            raise MeshError(f"no valid XML: {error}") from error
        kind = self.root.get("type")
        if self.root.tag != "VTKFile" or kind != "UnstructuredGrid":
            raise MeshError(f"VTKFile of type {kind} is not read, only UnstructuredGrid")
        order = "<" if self.root.get("byte_order", "LittleEndian") == "LittleEndian" else ">"
        header = self.root.get("header_type", "UInt32")
        compressor = self.root.get("compressor")
        if header not in ("UInt32", "UInt64"):
            raise MeshError(f"header_type {header} is not read")
        room = MOST_TIMES * len(data) + MOST_MORE
        self.storage = Storage(order, order + DTYPES[header], compressor, room)
        element = self.root.find("AppendedData")
        self.appended_base64 = element is not None and element.get("encoding") == "base64"
        self.extras: list[str] = []

    def content(self) -> FileContent:
        pieces = self.root.findall("UnstructuredGrid/Piece")
        places = list(POINTS.finditer(self.data, 0, self.appended or len(self.data)))
        if not pieces:
            raise MeshError("the file has no Piece")
        if len(places) != len(pieces):
            raise MeshError(f"{len(pieces)} pieces, but {len(places)} with Points")
        points, offsets, vertices, types = [], [np.zeros(1, np.int64)], [], []
        point_data: list[dict[str, Any]] = []
        cell_data: list[dict[str, Any]] = []
        slots: list[tuple[str, Any]] = []
        data_slots: dict[str, list[tuple[str, Any]]] = {}
        n_points = n_corners = 0
        for piece, place in zip(pieces, places, strict=True):
            n, n_cells = self.integer(piece, "NumberOfPoints"), self.integer(piece, "NumberOfCells")
            element = piece.find("Points/DataArray")
            xyz = self.values(element)
            if len(xyz) != 3 * n:
                raise MeshError(f"a piece says {n} points, its Points have {len(xyz)} numbers")
            xyz = xyz.reshape(n, 3)
            if element is not None and element.get("type") not in ("Float32", "Float64"):
                raise MeshError(f"points of type {element.get('type')} cannot move")
            cells = {e.get("Name"): e for e in piece.findall("Cells/DataArray")}
            v, o, t = (
                self.integers(cells.get(name)) for name in ("connectivity", "offsets", "types")
            )
            last = int(o[-1]) if len(o) else 0
            bad = len(o) != n_cells or len(t) != n_cells or last != len(v)
            if bad or (np.diff(o, prepend=0) < 0).any():
                raise MeshError(
                    f"a piece says {n_cells} cells, it has {len(o)} offsets up to {last}, "
                    f"{len(t)} types and a connectivity of {len(v)}"
                )
            if v.size and not (v.min() >= 0 and v.max() < n):
                wrong = v[(v < 0) | (v >= n)]
                raise MeshError(
                    f"{len(wrong)} corners name points outside the {n} of their piece, "
                    f"the first is {wrong[0]}"
                )
            points.append(xyz.astype(np.float64))
            slots.append(self.place(place, element, n_points, n))
            for name, stands in self.data_places(place, piece, n_points, n):
                data_slots.setdefault(name, []).append(stands)
            vertices.append(v + n_points)
            offsets.append(o + n_corners)
            types.append(t)
            point_data.append(self.arrays(piece.find("PointData"), n))
            cell_data.append(self.arrays(piece.find("CellData"), n_cells))
            n_points, n_corners = n_points + n, n_corners + last
        blocks, sources = blocks_of(
            np.concatenate(offsets), np.concatenate(vertices), np.concatenate(types)
        )
        data = {name: [a[s] for s in sources] for name, a in _joined(cell_data).items()}
        return FileContent(
            np.concatenate(points),
            blocks,
            region_tags(data, blocks),
            point_data=_joined(point_data),
            cell_data=data,
            field_data=self.arrays(self.root.find("UnstructuredGrid/FieldData"), None),
            extras=tuple(self.extras),
            slots=self.in_place(slots),
            data_slots=self.data_in_place(data_slots, len(pieces)),
        )

    def integer(self, element: ElementTree.Element, name: str) -> int:
        value = element.get(name, "")
        if not value.strip().isdigit():
            raise MeshError(f"{element.tag} needs {name}, found {value[:40]!r}")
        return int(value)

    def values(self, element: ElementTree.Element | None) -> npt.NDArray[Any]:
        """Numbers of a DataArray."""
        if element is None:
            raise MeshError("a DataArray of Points or Cells is missing")
        name = element.get("Name", "?")
        dtype = DTYPES.get(element.get("type", ""))
        if dtype is None:
            raise MeshError(f"array {name!r} has the unknown type {element.get('type')}")
        try:
            if element.get("format") == "ascii":
                text = Text((element.text or "").encode("latin-1", "replace"))
                parse = np.int64 if dtype[0] in "iu" else np.float64
                return text.numbers(0, len(text), parse)
            stored, encoded = self.stored(element)
            if not stored:  # an empty array may have no block at all
                return np.empty(0, dtype)
            raw, _ = self.storage.decode(stored, encoded)
            return np.frombuffer(raw, self.storage.order + dtype).astype(dtype)
        except (MeshError, ValueError, binascii.Error, zlib.error, lzma.LZMAError) as error:
            raise MeshError(f"array {name!r}: {error}") from error

    def integers(self, element: ElementTree.Element | None) -> IndexArray:
        values = self.values(element)
        if values.dtype.kind == "f" and element is not None:
            raise MeshError(f"array {element.get('Name')!r} has no integers")
        return values.astype(np.int64)

    def stored(self, element: ElementTree.Element) -> tuple[bytes, bool]:
        """Bytes that begin with the block of a DataArray, and whether they are base64."""
        if element.get("format") == "appended":
            if self.appended is None:
                raise MeshError("is appended, but the file has no AppendedData")
            begin = self.appended + self.integer(element, "offset")
            return self.data[begin:], self.appended_base64
        if element.get("format") != "binary":
            raise MeshError(f"format {element.get('format')} is unknown")
        return b"".join((element.text or "").encode("ascii").split()), True

    def arrays(self, parent: ElementTree.Element | None, n: int | None) -> dict[str, Any]:
        """The arrays of PointData, CellData or FieldData; `n` values each if given."""
        found: dict[str, Any] = {}
        for element in () if parent is None else parent.iter():
            name = element.get("Name", "?")
            if element.tag != "DataArray" or element.get("type") not in DTYPES:
                if element.tag in ("DataArray", "Array"):
                    self.extras.append(f"text data {name}")
                continue
            values = self.values(element)
            n_components = int(element.get("NumberOfComponents") or 1)
            if n is not None and len(values) != n * n_components:
                raise MeshError(f"array {name!r} has {len(values)} values, not {n * n_components}")
            found[name] = values if n_components < 2 else values.reshape(-1, n_components)
        return found

    def data_places(
        self, points: re.Match[bytes], piece: ElementTree.Element, first: int, n: int
    ) -> Iterator[tuple[str, tuple[str, Any]]]:
        """Where point data of floats stands, of the piece whose points stand there."""
        parent = piece.find("PointData")
        arrays = [] if parent is None else list(parent.iter())[1:]
        limit = self.appended or len(self.data)
        before = self.data.rfind(b"<Piece", 0, points.start())
        begin = self.data.find(b"<PointData", before, limit)
        end = self.data.find(b"</PointData>", begin, limit)
        tags = list(ARRAY.finditer(self.data, begin, end)) if begin >= 0 else []
        if len(tags) != len(arrays):  # something else is among them, such as a comment
            return
        for tag, element in zip(tags, arrays, strict=True):
            if element.tag == "DataArray" and DTYPES.get(element.get("type", ""), "")[:1] == "f":
                width = max(1, int(element.get("NumberOfComponents") or 1))
                if n:
                    yield element.get("Name", "?"), self.place(tag, element, first, n, width)

    def data_in_place(
        self, places: dict[str, list[tuple[str, Any]]], n_pieces: int
    ) -> dict[str, InPlace]:
        """Slots of the arrays that each piece has, of one type in all."""
        found: dict[str, InPlace] = {}
        for name, parts in places.items():
            slots = self.in_place(parts) if len(parts) == n_pieces else None
            if isinstance(slots, Slots):
                found[name] = dataclasses.replace(slots, widen=(), keeps_type=True)
            elif isinstance(slots, _Block) and len(slots.widen) in (0, n_pieces):
                dtype = "f4" if slots.widen else "f8"
                found[name] = dataclasses.replace(slots, widen=[], dtype=dtype)
        return found

    def place(
        self, match: re.Match[bytes], element: Any, first: int, n: int, width: int = 3
    ) -> tuple[str, Any]:
        """Where the points of one piece stand in the file, or other numbers, `width` a point."""
        begin, end = match.end(), self.data.find(b"<", match.end())
        widen: tuple[Edit, ...] = ()
        if found := re.search(rb'(?<=\btype=")Float32(?=")', match[1]):
            at = match.start(1)
            widen = ((at + found.start(), at + found.end(), b"Float64"),)
        mode = element.get("format")
        if mode == "ascii":
            text = Text(self.data[begin:end])
            slots = text.slots(np.arange(width * n).reshape(n, width))
            return mode, Slots(slots.starts + begin, slots.ends + begin, None, widen)
        stored, encoded = self.stored(element)
        length = self.storage.decode(stored, encoded)[1] if stored else 0
        if mode == "appended":
            begin = (self.appended or 0) + self.integer(element, "offset")
            return mode, (first, first + n, begin, begin + length, widen)
        stored = self.data[begin:end]
        begin += len(stored) - len(stored.lstrip())
        return mode, (first, first + n, begin, begin + len(stored.strip()), widen)

    def in_place(self, slots: list[tuple[str, Any]]) -> InPlace | None:
        modes = {mode for mode, _ in slots}
        if modes == {"ascii"}:
            return joined([part for _, part in slots])
        if len(modes) > 1:
            return None
        appended = modes == {"appended"}
        return _Block(
            self.storage,
            self.appended_base64 if appended else True,
            [part[:4] for _, part in slots],
            [edit for _, part in slots for edit in part[4]],
            self.appended if appended else None,
        )


def _joined(pieces: list[dict[str, Any]]) -> dict[str, Any]:
    """Data of all pieces as one; arrays that are not in each of them are left out."""
    names = [name for name in pieces[0] if all(name in piece for piece in pieces)]
    return {name: np.concatenate([piece[name] for piece in pieces]) for name in names}


def write(content: FileContent) -> bytes:
    """Write one piece, numbers as base64 without compression."""
    blocks = [b for b, (kind, _) in enumerate(content.blocks) if kind in N_VERTICES]
    cells = [content.blocks[b] for b in blocks]
    n = sum(len(c) for _, c in cells)
    sizes = np.concatenate([np.full(len(c), c.shape[1]) for _, c in cells])
    types = np.concatenate([np.full(len(c), CODES[kind], np.uint8) for kind, c in cells])
    lines = [
        '<?xml version="1.0"?>',
        '<VTKFile type="UnstructuredGrid" version="1.0" byte_order="LittleEndian" '
        'header_type="UInt64">',
        "<UnstructuredGrid>",
        *_section("FieldData", content.field_data),
        f'<Piece NumberOfPoints="{len(content.points)}" NumberOfCells="{n}">',
        *_section("PointData", content.point_data),
        *_section("CellData", cell_arrays(content, blocks)),
        *_section("Points", {"Points": content.points_3d}),
        *_section(
            "Cells",
            {
                "connectivity": np.concatenate([c.ravel() for _, c in cells]),
                "offsets": np.cumsum(sizes),
                "types": types,
            },
        ),
        "</Piece>",
        "</UnstructuredGrid>",
        "</VTKFile>",
    ]
    return ("\n".join(lines) + "\n").encode()


def _section(tag: str, arrays: dict[str, Any]) -> list[str]:
    storage = Storage("<", "<u8", None)
    lines = [f"<{tag}>"]
    for name, values in arrays.items():
        array = np.atleast_1d(np.asarray(values))
        if array.dtype.str[1:] not in NAMES:
            array = array.astype(np.int64 if array.dtype.kind == "b" else np.float64)
        raw = array.astype(array.dtype.newbyteorder("<")).tobytes()
        components = f' NumberOfComponents="{array[0].size}"' if array.ndim > 1 else ""
        tuples = f' NumberOfTuples="{len(array)}"' if tag == "FieldData" else ""
        lines.append(
            f'<DataArray type="{NAMES[array.dtype.str[1:]]}" Name="{name.translate(ESCAPED)}"'
            f'{components}{tuples} format="binary">'
        )
        lines += [storage.encode(raw, True).decode(), "</DataArray>"]
    return [*lines, f"</{tag}>"]
