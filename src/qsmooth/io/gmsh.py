"""Gmsh MSH: versions 1, 2, 4.0 and 4.1 as text, 2 and 4.1 as binary."""

from __future__ import annotations

import re
from typing import Any

import numpy as np

from qsmooth._types import FloatArray, IndexArray
from qsmooth.errors import MeshError
from qsmooth.io import gmsh_blocks
from qsmooth.io.file_content import FACES, N_VERTICES, Block, FileContent
from qsmooth.io.gmsh_blocks import Part, Physical
from qsmooth.io.gmsh_data import NodeData, data_at_points, lines_of_data, read_node_data
from qsmooth.io.gmsh_types import CODES, DIMENSIONS, TYPES, type_of
from qsmooth.io.in_place import Slots, joined
from qsmooth.io.text import Cursor, blocks_by_id, finish, rows_of

NAME = "gmsh"
ENDINGS = (".msh",)
PRIORITY = 1  # .msh is FreeFEM's too
HOLDS = frozenset(("z", "vertex", "line", "regions", "names", "point_data"))

INDENTED = 80  # bytes that are looked at before the end of a section, whether it starts a line
UNKNOWN = -1  # dimension of a physical name in the first form of version 2, which has none
TAGS = ("gmsh:physical", "gmsh:geometrical")


def sniff(head: bytes) -> bool:
    """Whether a file that starts so is MSH."""
    return head.lstrip().startswith((b"$MeshFormat", b"$NOD", b"$Comments", b"$PhysicalNames"))


def read(data: bytes) -> FileContent:
    """Read MSH; entities, periodic links and all other sections are kept on writing."""
    return _Reader(data).content()


class _Reader:
    """Goes through the sections of one file."""

    def __init__(self, data: bytes) -> None:
        self.data = data
        self.cursor = Cursor(data)
        self.version = 1.0
        self.ids: list[IndexArray] = []
        self.points: list[FloatArray] = []
        self.slots: list[Slots] = []
        self.parts: list[Part] = []
        self.names: dict[str, tuple[int, int]] = {}
        self.physical: Physical = {}
        self.data_parts: list[NodeData] = []
        self.others: list[str] = []

    def content(self) -> FileContent:
        sections = {
            b"$MeshFormat": self.format,
            b"$PhysicalNames": self.physical_names,
            b"$Entities": self.entities,
            b"$Nodes": self.nodes,
            b"$NOD": self.nodes,
            b"$Elements": self.elements,
            b"$ELM": self.elements,
        }
        cursor = self.cursor
        seen = set()
        while line := cursor.line():
            if not line.startswith(b"$"):
                cursor.pos = cursor.line_start
                cursor.fail(f"a section must begin with $, found {line[:40]!r}")
            end = b"$End" + line[1:] if line not in (b"$NOD", b"$ELM") else b"$END" + line[1:]
            if line == b"$NodeData" and (data := read_node_data(cursor)) is not None:
                self.data_parts.append(data)
                continue
            if line not in sections:
                self.others.append(line.decode("latin-1"))
                stop = _stop(self.data, end, cursor.pos)
                if stop < 0:
                    cursor.fail(f"{line.decode('latin-1')} has no {end.decode('latin-1')}")
                cursor.pos = stop
                continue
            if line in seen:
                cursor.fail(f"a second section {line.decode()}")
            seen.add(line)
            sections[line]()
            closing = cursor.line()
            if closing != end:
                cursor.pos = cursor.line_start if closing else len(self.data)
                found = closing[:40].decode("latin-1") or "the end"
                cursor.fail(
                    f"{end.decode()} expected, found {found!r}: "
                    "the count of the section is wrong or the file is cut off"
                )
        if not self.points:
            hint = ""
            if b"$ParametricNodes" in self.data:
                hint = ": $ParametricNodes is not read, save without parametric coordinates"
            raise MeshError(f"the file has no section of nodes{hint}")
        if not self.parts:
            raise MeshError("the file has no elements")
        return self.assemble()

    def format(self) -> None:
        words = self.cursor.line().split()
        try:
            self.version, binary, size = float(words[0]), int(words[1]), int(words[2])
        except (IndexError, ValueError):
            self.cursor.fail("$MeshFormat needs version, file type and data size")
        if int(self.version) not in (2, 4) or self.version > 4.1:
            self.cursor.fail(f"MSH version {words[0].decode('latin-1')}; read are 1, 2, 4.0, 4.1")
        if size != 8:
            self.cursor.fail(f"data size {size}; only 8 is read")
        if binary:
            if self.version == 4.0:
                self.cursor.fail("binary MSH 4.0 is not read; save it as 4.1")
            one = self.data[self.cursor.pos : self.cursor.pos + 4]
            if one not in (b"\1\0\0\0", b"\0\0\0\1"):
                self.cursor.fail("the number 1 that tells the byte order is missing")
            self.cursor.order = "<" if one[0] else ">"
            self.cursor.pos += 4

    def physical_names(self) -> None:
        n = _integer(self.cursor, "physical names")
        for _ in range(n):
            line = self.cursor.line()
            match = re.match(rb'(?:(\d+)\s+)?(-?\d+)\s+"(.*)"$', line)
            if not match:
                self.cursor.fail(f"dimension, tag and name expected, found {line[:40]!r}")
            dimension = int(match[1] or UNKNOWN)
            self.names[match[3].decode("utf-8", "replace")] = (int(match[2]), dimension)

    def entities(self) -> None:
        self.physical = gmsh_blocks.entities(self.cursor, self.version)

    def nodes(self) -> None:
        cursor = self.cursor
        if self.version < 4:
            n = _integer(cursor, "nodes")
            if not cursor.order:
                first = cursor.token
                points, slots = cursor.points(n, 4, (1, 2, 3))
                ids = cursor.text.numbers_at(first + 4 * np.arange(n), np.int64)
            else:
                records = _records(cursor, n, [("id", "i4"), ("xyz", "f8", (3,))], "nodes")
                ids, points, slots = _from_records(cursor, records)
            self.keep(ids, points, slots)
            return
        for block in gmsh_blocks.nodes(cursor, self.version):
            self.keep(*block)

    def keep(self, ids: IndexArray, points: FloatArray, slots: Slots) -> None:
        self.ids.append(ids)
        self.points.append(points)
        self.slots.append(slots)

    def elements(self) -> None:
        if self.version >= 4:
            self.parts += gmsh_blocks.elements(self.cursor, self.version, self.physical)
        elif self.cursor.order:
            self.elements_2_binary()
        else:
            self.elements_by_line()

    def elements_by_line(self) -> None:
        """Versions 1 and 2: id, type, tags, vertices on a line of each element."""
        cursor = self.cursor
        n = _integer(cursor, "elements")
        text, rows = cursor.text, cursor.text.rows
        row = int(np.searchsorted(rows, cursor.token))
        if row + n >= len(rows):
            cursor.pos = len(self.data)
            cursor.fail(f"the file ends too early: {n} elements expected")
        rows = rows[row : row + n + 1]
        widths = np.diff(rows)
        if n and widths.min() < 4:
            text.fail(int(rows[np.argmin(widths)]), f"{n} elements expected, this is none")
        codes = text.numbers_at(rows[:-1] + 1, np.int64)
        # Version 1 has two tags, then the number of vertices; version 2 says how many tags.
        old = self.version < 2
        n_tags = np.full(n, 2) if old else text.numbers_at(rows[:-1] + 2, np.int64)
        kinds = (codes * 64 + n_tags) * 64 + widths
        for i, j, table in text.tables(rows[:-1], widths, kinds):
            code, tags, width = int(codes[i]), int(n_tags[i]), int(widths[i])
            kind, n_corners = type_of(cursor, code, int(rows[i]))
            if width != (5 if old else 3 + tags) + n_corners or tags < 0:
                text.fail(int(rows[i]), f"a {kind} with {tags} tags cannot have {width} numbers")
            first_tag = 2 if old else 3
            pair = np.zeros((j - i, 2), np.int64)
            pair[:, : min(tags, 2)] = table[:, first_tag : first_tag + min(tags, 2)]
            self.parts.append((code, pair, table[:, width - n_corners :], text.starts[rows[i:j]]))
        if n:
            cursor.pos = int(text.ends[rows[n] - 1])

    def elements_2_binary(self) -> None:
        cursor = self.cursor
        n, done = _integer(cursor, "elements"), 0
        while done < n:
            code, count, n_tags = cursor.numbers(3, "i4", "element header").tolist()
            _, n_corners = type_of(cursor, code)
            if count <= 0 or n_tags < 0:
                cursor.fail(f"{count} elements with {n_tags} tags")
            place, width = cursor.pos, 1 + n_tags + n_corners
            table = cursor.numbers(count * width, "i4", "elements").reshape(count, width)
            table = table.astype(np.int64)
            pair = np.zeros((count, 2), np.int64)
            pair[:, : min(n_tags, 2)] = table[:, 1 : 1 + min(n_tags, 2)]
            self.parts.append((code, pair, table[:, 1 + n_tags :], np.full(count, place)))
            done += count
        if done != n:
            cursor.fail(f"$Elements says {n} elements, the file has {done}")

    def assemble(self) -> FileContent:
        ids = np.concatenate(self.ids)
        blocks = blocks_by_id(ids, [(TYPES[code][0], cells) for code, _, cells, _ in self.parts])
        pairs = [pair for _, pair, _, _ in self.parts]
        cell_data = {name: [pair[:, c] for pair in pairs] for c, name in enumerate(TAGS)}
        for name, (tag, dimension) in self.names.items():
            if dimension == UNKNOWN:
                self.names[name] = (tag, _dimension_of(tag, blocks, pairs))
        # Without physical groups the geometrical entities are the regions.
        physical = any(
            pair[:, 0].any() for (kind, _), pair in zip(blocks, pairs, strict=True) if kind in FACES
        )
        if not any(pair.any() for pair in pairs):
            cell_data = {}
        point_data, data_slots, left_out = data_at_points(self.data_parts, ids)
        others = self.others + left_out * ["$NodeData"]
        return FileContent(
            np.concatenate(self.points),
            blocks,
            [pair[:, 0 if physical else 1] for pair in pairs] if cell_data else None,
            self.names,
            point_data=point_data,
            cell_data=cell_data,
            field_data={name: np.array(pair) for name, pair in self.names.items()},
            extras=tuple(f"section {name}" for name in others),
            slots=joined(self.slots),
            data_slots=data_slots,
            places=[place for _, _, _, place in self.parts],
        )


def _dimension_of(tag: int, blocks: list[Block], pairs: list[IndexArray]) -> int:
    """The highest dimension of elements with this physical tag; that of faces if it has none."""
    found = [
        DIMENSIONS.get(kind, 3)
        for (kind, _), pair in zip(blocks, pairs, strict=True)
        if (pair[:, 0] == tag).any()
    ]
    return max(found, default=2)


def write(content: FileContent) -> bytes:
    """Write MSH 2.2 as text, which every reader of MSH understands."""
    lines = ["$MeshFormat", "2.2 0 8", "$EndMeshFormat"]
    if content.names:
        lines += ["$PhysicalNames", str(len(content.names))]
        lines += [f'{dim} {tag} "{name}"' for name, (tag, dim) in content.names.items()]
        lines += ["$EndPhysicalNames"]
    n_points = len(content.points)
    lines += ["$Nodes", str(n_points)]
    lines += [*rows_of(np.arange(1, n_points + 1), content.points_3d), "$EndNodes"]
    blocks = [(b, kind, cells) for b, (kind, cells) in enumerate(content.blocks)]
    blocks = [block for block in blocks if block[1] in N_VERTICES]
    lines += ["$Elements", str(sum(len(cells) for _, _, cells in blocks))]
    first = 1
    for b, kind, cells in blocks:
        n = len(cells)
        tags = np.zeros(n, np.int64) if content.tags is None else content.tags[b]
        physical, geometrical = (
            content.cell_data[name][b] if name in content.cell_data else tags for name in TAGS
        )
        head = np.repeat([[CODES[kind], 2]], n, axis=0)
        ids = np.arange(first, first + n)
        lines += rows_of(ids, head, physical, geometrical, cells + 1)
        first += n
    return finish([*lines, "$EndElements", *lines_of_data(content)])


def _stop(data: bytes, end: bytes, begin: int) -> int:
    """Where the first line that starts with `end` goes on after it; -1 where there is none."""
    at = data.find(end, begin)
    while at >= 0:
        before = data[max(begin, at - INDENTED) : at]
        if not before.rpartition(b"\n")[2].strip():
            return at + len(end)
        at = data.find(end, at + 1)
    return -1


def _integer(cursor: Cursor, what: str) -> int:
    line = cursor.line()
    if not line.isdigit():
        cursor.fail(
            f"number of {what} expected, found {line[:40].decode('latin-1') or 'the end'!r}"
        )
    if int(line) > len(cursor.data):
        cursor.fail(f"the header says {int(line)} {what}: the file is too small for them")
    return int(line)


def _records(cursor: Cursor, n: int, fields: list[Any], what: str) -> Any:
    dtype = np.dtype(fields).newbyteorder("<" if cursor.order == "<" else ">")
    if n * dtype.itemsize > len(cursor.data) - cursor.pos:
        cursor.fail(f"the file ends too early: {n} {what} expected")
    records = np.frombuffer(cursor.data, dtype, n, cursor.pos)
    cursor.pos += n * dtype.itemsize
    return records


def _from_records(cursor: Cursor, records: Any) -> tuple[IndexArray, FloatArray, Slots]:
    n, size = len(records), records.dtype.itemsize
    starts = cursor.pos - n * size + size * np.arange(n)[:, None] + 4 + 8 * np.arange(3)
    slots = Slots(starts, starts + 8, np.dtype(cursor.order + "f8"))
    return records["id"].astype(np.int64), records["xyz"].astype(np.float64), slots
