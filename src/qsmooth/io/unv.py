"""I-deas universal files, Salome's too: nodes, elements and groups; other datasets are kept."""

from __future__ import annotations

import re
from functools import cached_property
from typing import NoReturn

import numpy as np

from qsmooth._types import FloatArray, IndexArray
from qsmooth.errors import MeshError
from qsmooth.io.file_content import FACES, FileContent
from qsmooth.io.in_place import Slots, joined
from qsmooth.io.sets import MOST_PARTS, by_block, line_markers, members, partition
from qsmooth.io.text import Text, blocks_by_id, finish, integers, line_of, walked, with_newlines

NAME = "unv"
ENDINGS = (".unv",)
HOLDS = frozenset(("z", "line", "regions", "names", "point_sets", "cell_sets"))

NODES = (15, 781, 2411)
COLUMN = 25  # characters of a coordinate in 781 and 2411; the 13 of 15 are too few for a float64
# Dataset of elements -> numbers that stand before the nodes of each.
ELEMENTS = {780: 8, 2412: 6}
BEAMS = (11, 21, 22, 23, 24)  # which have three numbers more
# Dataset of groups -> numbers of each member: type, label and what is not read here.
GROUPS = {2429: 2, 2430: 2, 2432: 2, 2435: 4, 2452: 4, 2467: 4, 2477: 4}
NODE, ELEMENT = 7, 8  # type of a group's member
# Family of two-dimensional elements, tens digit of the descriptor: plane stress, plane strain,
# plates, membranes, axisymmetric, thin shells.
FACE_FAMILIES = (4, 5, 6, 7, 8, 9)
FACE_KINDS = {3: "triangle", 4: "quad", 6: "triangle6", 8: "quad8", 9: "quad9", 10: "triangle10"}
OTHER_KINDS = {111: "tetra", 112: "wedge", 115: "hexahedron", 116: "hexahedron20", 118: "tetra10"}
POINT = 161
CODES = {"line": 11, "triangle": 41, "quad": 44}
MARK = re.compile(rb"(?m)^[ \t]*-1[ \t]*\r?$")
START = re.compile(rb"\s*-1[ \t]*\r?[\n\r]\s*\d{1,6}[ \t]*\r?[\n\r]")


def sniff(head: bytes) -> bool:
    """Whether a file that starts so is a universal file."""
    return START.match(head) is not None


def read(data: bytes) -> FileContent:
    """Read UNV; groups that divide the faces become regions."""
    return _Reader(data).content()


class _Reader:
    """Goes through the datasets of one file."""

    def __init__(self, data: bytes) -> None:
        self.data = with_newlines(data)
        self.text = Text(self.data)
        self.ids: list[IndexArray] = []
        self.points: list[FloatArray] = []
        self.slots: list[Slots] = []
        # (type, labels, node labels, materials, tokens) of each run of elements
        self.cells: list[tuple[str, IndexArray, IndexArray, IndexArray, IndexArray]] = []
        self.groups: dict[int, dict[str, list[IndexArray]]] = {NODE: {}, ELEMENT: {}}
        self.others: list[str] = []

    def content(self) -> FileContent:
        marks = [match.span() for match in MARK.finditer(self.data)]
        if len(marks) % 2:
            self.fail(len(self.data), "a dataset has no end: a line of -1 is missing")
        for (_, begin), (end, _) in zip(marks[::2], marks[1::2], strict=True):
            first, last = np.searchsorted(self.text.starts, (begin, end)).tolist()
            word = self.text.word(first) if first < last else b""
            if not word.isdigit():
                self.fail(
                    begin, f"number of a dataset expected, found {word[:40].decode('latin-1')!r}"
                )
            number = int(word[:9])
            if number in NODES:
                self.nodes(number, first + 1, last)
            elif number in ELEMENTS:
                self.elements(ELEMENTS[number], first + 1, last)
            elif number in GROUPS:
                self.read_groups(GROUPS[number], first + 1, last)
            else:
                self.others.append(f"dataset {number}")
        if not self.points:
            raise MeshError("the file has no dataset of nodes (2411, 781 or 15)")
        if not self.cells:
            raise MeshError("the file has no dataset of elements (2412 or 780)")
        return self.assemble()

    def fail(self, offset: int, what: str) -> NoReturn:
        raise MeshError(f"line {line_of(self.data, offset)}: {what}")

    def nodes(self, dataset: int, first: int, last: int) -> None:
        """Label, two coordinate systems, colour; x, y, z."""
        n, left = divmod(last - first, 7)
        if left:
            self.text.fail(last, "the nodes before have not seven numbers each")
        table = self.text.numbers(first, last).reshape(n, 7)
        self.ids.append(integers(table[:, 0], "node"))
        self.points.append(np.ascontiguousarray(table[:, 4:]))
        tokens = first + 7 * np.arange(n)[:, None] + np.arange(4, 7)
        slots = self.text.slots(tokens)
        if dataset != 15:
            slots = Slots(self.column_starts(tokens), slots.ends, columns=True)
        self.slots.append(slots)

    @cached_property
    def newlines(self) -> IndexArray:
        """Bytes of newlines, and one before the file."""
        return np.append(-1, np.flatnonzero(np.frombuffer(self.data, np.uint8) == 10))

    def column_starts(self, tokens: IndexArray) -> IndexArray:
        """Where the columns begin that end with these tokens: behind what stands before."""
        text = self.text
        newlines = self.newlines
        before = np.empty_like(tokens)
        line = np.searchsorted(newlines, text.starts[tokens[:, 0]]) - 1
        before[:, 0] = newlines[line] + 1
        before[:, 1:] = text.ends[tokens[:, 1:] - 1]
        return np.maximum(before, text.ends[tokens] - COLUMN)

    def elements(self, n_heads: int, first: int, last: int) -> None:
        """Label, descriptor, properties, number of nodes; nodes."""
        text = self.text
        values = text.numbers(first, last, np.int64)
        if len(values) == 0:
            return
        # Of every number, how long an element would be that began there.
        codes = np.zeros_like(values)
        codes[:-1] = values[1:]
        counts = np.zeros_like(values)
        counts[: len(values) - n_heads + 1] = values[n_heads - 1 :]
        heads = n_heads + 3 * np.isin(codes, BEAMS)
        lengths = np.where((counts > 0) & (counts < 99), heads + counts, 0)
        firsts, rest = walked(lengths)
        if rest < len(values):
            text.fail(first + rest, "this is no element: label, descriptor, properties, nodes")
        if rest > len(values):
            text.fail(last, "the dataset ends within an element")
        tokens = first + firsts
        if not np.array_equal(text.rows[np.searchsorted(text.rows, tokens)], tokens):
            text.fail(first, "elements of this dataset do not begin on lines of their own")
        codes, counts, heads = codes[firsts], counts[firsts], heads[firsts]
        material = values[firsts + n_heads - 3]
        for i, j, table in text.tables(tokens + heads, counts, 256 * codes + counts):
            kind = _kind(int(codes[i]), int(counts[i]))
            labels = values[firsts[i:j]]
            self.cells.append((kind, labels, table, material[i:j], tokens[i:j]))

    def read_groups(self, width: int, first: int, last: int) -> None:
        """Number, seven numbers, the last of which counts members; name; members."""
        text = self.text
        while first < last:
            count = int(text.numbers(first, first + 8, np.int64)[7])
            # The name is a line of its own, and may be empty.
            begin = self.data.find(b"\n", int(text.ends[first + 7])) + 1
            end = self.data.find(b"\n", begin)
            name = self.data[begin:end].decode("utf-8", "replace").strip()
            token = int(np.searchsorted(text.starts, end))
            if count < 0 or token + width * count > last:
                text.fail(first, f"a group of {count} members: they are not there")
            table = text.numbers(token, token + width * count, np.int64).reshape(-1, width)
            for kind, sets in self.groups.items():
                if (labels := table[table[:, 0] == kind, 1]).size:
                    sets.setdefault(name or f"group_{text.word(first).decode()}", []).append(labels)
            first = token + width * count

    def assemble(self) -> FileContent:
        ids = np.concatenate(self.ids)
        read = [kind in (*FACES, "line", "vertex") for kind, *_ in self.cells]
        found = iter(
            blocks_by_id(ids, [(e[0], e[2]) for e, r in zip(self.cells, read, strict=True) if r])
        )
        blocks = [
            next(found) if r else (e[0], np.zeros_like(e[2]))
            for e, r in zip(self.cells, read, strict=True)
        ]
        labels = np.concatenate([e[1] for e in self.cells])
        cell_rows = members(labels, self.groups[ELEMENT])
        regions, names = partition(blocks, cell_rows)
        markers, line_names = line_markers(blocks, cell_rows)
        materials = [e[3] for e in self.cells]
        varied = len(np.unique(np.concatenate([np.empty(0), *self.of_faces(materials)]))) > 1
        if regions is None:
            regions = materials if varied else [np.zeros_like(m) for m in materials]
        tags = [
            markers[b] if kind == "line" and markers is not None else regions[b]
            for b, (kind, _) in enumerate(blocks)
        ]
        if len(cell_rows) * len(blocks) > MOST_PARTS:
            self.others.append(f"{len(cell_rows)} groups of elements")
            cell_rows = {}
        ends = np.cumsum([len(cells) for _, cells in blocks])
        return FileContent(
            np.concatenate(self.points),
            blocks,
            tags if names or varied or markers is not None else None,
            line_names | names,
            point_sets=members(ids, self.groups[NODE]),
            cell_sets={name: by_block(rows, ends) for name, rows in cell_rows.items()},
            extras=tuple(dict.fromkeys(self.others)),
            slots=joined(self.slots) if len({s.columns for s in self.slots}) == 1 else None,
            places=[self.text.starts[tokens] for *_, tokens in self.cells],
        )

    def of_faces(self, parts: list[IndexArray]) -> list[IndexArray]:
        return [part for part, (kind, *_) in zip(parts, self.cells, strict=True) if kind in FACES]


def _kind(code: int, n_nodes: int) -> str:
    """Type of an element by its descriptor and number of nodes."""
    if code in BEAMS:
        return "line" if n_nodes == 2 else "line3"
    if code // 10 in FACE_FAMILIES and n_nodes in FACE_KINDS:
        return FACE_KINDS[n_nodes]
    if code == POINT and n_nodes == 1:
        return "vertex"
    return OTHER_KINDS.get(code, f"I-deas {code} of {n_nodes} nodes")


def write(content: FileContent) -> bytes:
    """Write nodes, elements and groups; a group for each region, marker and set."""
    lines = ["    -1", "  2411"]
    for label, (x, y, z) in enumerate(content.points_3d.tolist(), start=1):
        lines += [f"{label:10}{1:10}{1:10}{11:10}", f"{x:25.16E}{y:25.16E}{z:25.16E}"]
    lines += ["    -1", "    -1", "  2412"]
    firsts = []
    first = 1
    for kind, cells in content.blocks:
        firsts.append(first)
        if kind not in CODES:
            continue
        head = f"{CODES[kind]:10}{1:10}{1:10}{7:10}{cells.shape[1]:10}"
        beam = [f"{0:10}{1:10}{1:10}"] if kind == "line" else []
        for label, corners in enumerate((cells + 1).tolist(), start=first):
            lines += [f"{label:10}{head}", *beam, "".join(f"{v:10}" for v in corners)]
        first += len(cells)
    lines.append("    -1")
    groups = _groups(content, firsts)
    groups += [(m, NODE, np.asarray(v, np.int64) + 1) for m, v in content.point_sets.items()]
    groups = [group for group in groups if len(group[2])]
    if groups:
        lines += ["    -1", "  2467"]
    for number, (name, kind_of_member, labels) in enumerate(groups, start=1):
        lines += ["".join(f"{k:10}" for k in (number, 0, 0, 0, 0, 0, 0, len(labels))), name]
        words = [f"{kind_of_member:10}{label:10}{0:10}{0:10}" for label in labels.tolist()]
        lines += ["".join(words[k : k + 2]) for k in range(0, len(words), 2)]
    return finish([*lines, "    -1"] if groups else lines)


def _groups(content: FileContent, firsts: list[int]) -> list[tuple[str, int, IndexArray]]:
    """Name, type and labels of the elements of each region, marker and set."""
    groups = []
    written = [b for b, (kind, _) in enumerate(content.blocks) if kind in CODES]
    for dimension, word, kinds in ((2, "region", FACES), (1, "line", ("line",))):
        if content.tags is None:
            break
        names = {tag: name for name, (tag, dim) in content.names.items() if dim == dimension}
        parts = [b for b in written if content.blocks[b][0] in kinds]
        nothing = np.empty(0, np.int64)
        labels = np.concatenate(
            [nothing, *(firsts[b] + np.arange(len(content.blocks[b][1])) for b in parts)]
        )
        tags = np.concatenate([nothing, *(content.tags[b] for b in parts)])
        groups += [
            (names.get(tag, f"{word}_{tag}"), ELEMENT, labels[tags == tag])
            for tag in np.unique(tags).tolist()
        ]
    for name, sets in content.cell_sets.items():
        if name not in content.names:
            rows = [firsts[b] + np.asarray(sets[b], np.int64) for b in written]
            groups.append((name, ELEMENT, np.concatenate(rows)))
    return groups
