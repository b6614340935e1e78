"""Abaqus .inp: nodes, elements of many families, sets; all other keywords are kept."""

from __future__ import annotations

import re
from itertools import pairwise
from typing import NoReturn

import numpy as np

from qsmooth._types import IndexArray
from qsmooth.errors import MeshError
from qsmooth.io.abaqus_keywords import keyword_lines
from qsmooth.io.file_content import FACES, Block, FileContent
from qsmooth.io.hohq import CurvesStay, Quads, quads_in_comments
from qsmooth.io.sets import MOST_PARTS, by_block, members, partition
from qsmooth.io.text import (
    Text,
    blanked,
    blocks_by_id,
    finish,
    integers,
    line_of,
    positions,
    rows_of,
    with_newlines,
)

NAME = "abaqus"
ENDINGS = (".inp",)
PRIORITY = 1  # .inp is UCD's too
HOLDS = frozenset(("z", "line", "regions", "names", "point_sets", "cell_sets"))

# Families of two-dimensional elements; the digits that follow are the number of nodes.
SURFACE = re.compile(
    r"(?:CPS|CPE|CPEG|CAX|CGAX|M3D|MAX|R3D|SFM3D|STRI|S|DS|DC2D|DCC2D|DCAX|AC2D|ACAX|COH2D|WARP2D|DCCAX)"
    r"([3-9])(?:[A-Z]\w*|5)?$"
)
KINDS = {3: "triangle", 4: "quad", 6: "triangle6", 8: "quad8", 9: "quad9"}
LINE = re.compile(
    r"(?:T[23]D2|B[23][13]|R2D2|RB[23]D2|RAX2|SAX1|DC1D2|F2D2|LINE2|CONN[23]D2)[A-Z]*$"
)
LINE3 = re.compile(r"(?:T[23]D3|B[23]2|SAX2|DC1D3)[A-Z]*$")
POINT = re.compile(r"(?:MASS|ROTARYI|SPRING1|DASHPOT1|HEATCAP)$")
LONGEST_RANGE = 10**7  # ids of all GENERATE; a damaged number must not fill the memory
GENERATORS = ("NGEN", "NFILL", "NCOPY", "ELGEN", "ELCOPY", "NMAP")
GAP = rb",[ \t]*,"
NOTHING = np.empty(0, np.int64)
WRITTEN = {"triangle": "CPS3", "quad": "CPS4", "line": "T2D2"}


def sniff(head: bytes) -> bool:
    """Whether a file that starts so is Abaqus's."""
    return re.match(rb"\s*\*[*A-Za-z]", head) is not None


def read(data: bytes) -> FileContent:
    """Read Abaqus; element sets that divide the elements become regions."""
    return _Reader(data).content()


class _Reader:
    """Goes through the keywords of one file."""

    def __init__(self, data: bytes) -> None:
        self.data = data
        clean = blanked(with_newlines(data), rb"(?m)^[ \t]*\*\*[^\r\n]*")
        self.clean = clean
        self.text = Text(clean.replace(b",", b" "))
        self.ids: list[np.ndarray] = []  # as numbers of any kind: they stand beside coordinates
        self.points: list[np.ndarray] = []
        self.slots: list[IndexArray] = []
        # (type, element ids, node ids, tokens) of each *ELEMENT
        self.elements: list[tuple[str, IndexArray, IndexArray, IndexArray]] = []
        self.named: list[str] = []  # ELSET= of each *ELEMENT
        self.sets: dict[str, dict[str, list[IndexArray]]] = {"NSET": {}, "ELSET": {}}
        self.others: list[str] = []
        self.n_generated = 0
        self.has_gaps = re.search(GAP, clean) is not None

    def content(self) -> FileContent:
        parts: set[str] = set()
        in_assembly = False
        keywords, begins, bodies = keyword_lines(self.clean)
        if not keywords:
            raise MeshError("no keyword of Abaqus found")
        ends = [*begins[1:], len(self.clean)]
        firsts, lasts = (np.searchsorted(self.text.starts, at).tolist() for at in (bodies, ends))
        for (key, options), begin, body, end, first, last in zip(
            keywords, begins, bodies, ends, firsts, lasts, strict=True
        ):
            if key == "PART":
                parts.add(options.get("NAME", ""))
            elif key in ("ASSEMBLY", "INSTANCE", "END INSTANCE", "END ASSEMBLY"):
                # Nodes of the assembly itself are reference points, numbered apart.
                in_assembly = key in ("ASSEMBLY", "END INSTANCE")
            elif key in GENERATORS:
                self.fail(begin, f"*{key} makes nodes or elements by rule: not read")
            elif key == "NODE" and not in_assembly:
                self.nodes(options, begin, first, last, self.clean[body:end])
            elif key == "ELEMENT" and not in_assembly:
                self.element(options, begin, first, last)
            elif key in ("NSET", "ELSET"):
                self.set(key, options, begin, first, last)
            elif key == "INCLUDE" or key not in ("HEADING", "PREPRINT", "END PART"):
                self.others.append(key)
        if not self.points:
            hint = "; *INCLUDE is not followed" if "INCLUDE" in self.others else ""
            raise MeshError(f"the file has no *NODE with coordinates{hint}")
        if not self.elements:
            raise MeshError("the file has no *ELEMENT")
        if len(parts) > 1:
            raise MeshError(f"{len(parts)} parts ({', '.join(sorted(parts))}): one is read")
        return self.assemble()

    def fail(self, offset: int, what: str) -> NoReturn:
        raise MeshError(f"line {line_of(self.data, offset)}: {what}")

    def nodes(
        self, options: dict[str, str], begin: int, first: int, last: int, body: bytes
    ) -> None:
        """*NODE: id, x, y and perhaps z on each line."""
        if "INPUT" in options:
            self.fail(begin, f"nodes in another file ({options['INPUT']}) are not read")
        if options.get("SYSTEM", "R").upper() != "R":
            self.fail(begin, f"coordinate system {options['SYSTEM']} is not read, only rectangular")
        if first == last:
            return
        if self.has_gaps and (empty := re.search(GAP, body)):
            at = int(self.text.starts[first]) if first < len(self.text) else begin
            self.fail(at + empty.start(), "an empty field among coordinates is not read")
        rows = self.rows(first, last)
        width = int(rows[1] - rows[0])
        if width < 3 or (last - first) != width * (len(rows) - 1) or not _even(rows):
            widths = np.diff(rows)
            width = int(widths.min())
            row = int(np.argmin(widths)) if width < 3 else int(np.argmax(widths != widths[0]))
            self.text.fail(
                int(rows[row]), f"a node with {widths[row]} numbers: id and 2 or 3 coordinates"
            )
        table = self.text.numbers(first, last).reshape(-1, width)
        self.ids.append(table[:, 0])
        self.points.append(table[:, 1:4])
        self.slots.append(rows[:-1, None] + np.arange(1, min(width, 4)))
        if "NSET" in options:
            self.add("NSET", options, integers(self.ids[-1], "node"))

    def element(self, options: dict[str, str], begin: int, first: int, last: int) -> None:
        """*ELEMENT: id and nodes; on several lines where there are many."""
        name = options.get("TYPE", "").upper()
        if not name:
            self.fail(begin, "*ELEMENT without TYPE=")
        if "INPUT" in options:
            self.fail(begin, f"elements in another file ({options['INPUT']}) are not read")
        if first == last:
            return
        rows = self.rows(first, last)
        kind, n_corners = _kind(name)
        if n_corners == 0:
            # Not read; a line that ends in a comma goes on in the next.
            self.elements.append(
                (kind, rows[:-1], np.zeros((len(rows) - 1, 1), np.int64), rows[:-1])
            )
            self.named.append("")
            return
        if n_corners <= 4:
            odd = np.flatnonzero(np.diff(rows) != n_corners + 1)
            if odd.size:
                self.text.fail(
                    int(rows[odd[0]]),
                    f"an element {name} with {rows[odd[0] + 1] - rows[odd[0]]} numbers: "
                    f"it has an id and {n_corners} nodes",
                )
        elif (last - first) % (n_corners + 1):
            self.text.fail(first, f"elements {name} have an id and {n_corners} nodes each")
        table = self.text.numbers(first, last, np.int64).reshape(-1, n_corners + 1)
        tokens = first + (n_corners + 1) * np.arange(len(table))
        self.elements.append((kind, table[:, 0], table[:, 1:], tokens))
        self.named.append(options.get("ELSET", ""))
        self.add("ELSET", options, table[:, 0])

    def set(self, key: str, options: dict[str, str], begin: int, first: int, last: int) -> None:
        """*NSET, *ELSET: ids, names of sets, or first, last and step."""
        if key not in options:
            self.fail(begin, f"*{key} without {key}=")
        if "GENERATE" in options:
            members = []
            numbers = self.text.numbers(first, last, np.int64).tolist()
            for row, end in pairwise(self.rows(first, last).tolist()):
                if end - row not in (2, 3):
                    self.text.fail(row, "GENERATE needs first, last and perhaps step")
                start, stop, step = [*numbers[row - first : end - first], 1][:3]
                if step < 1 or stop < start:
                    self.text.fail(row, f"{start}, {stop}, {step}: no range")
                self.n_generated += (stop - start) // step
                if self.n_generated > LONGEST_RANGE:
                    self.text.fail(row, f"{start}, {stop}, {step}: no range, or too many of them")
                members.append(np.arange(start, stop + 1, step))
        else:
            words = b" ".join(self.text.words(first, last))
            members = []
            if re.fullmatch(rb"[\d\s]*", words):
                members = [self.text.numbers(first, last, np.int64)]
            else:  # names of other sets among the ids
                for word in words.split():
                    if word.isdigit():
                        members.append(np.array([int(word)]))
                    else:
                        members += self.sets[key].get(word.decode("latin-1").upper(), [])
                # Sets of sets of sets may name an id over and over.
                members = [np.unique(np.concatenate([NOTHING, *members]))]
        self.add(key, options, np.concatenate([NOTHING, *members]))

    def rows(self, first: int, last: int) -> IndexArray:
        rows = self.text.rows
        i, j = rows.searchsorted((first, last)).tolist()
        return rows[i : j + 1]

    def add(self, key: str, options: dict[str, str], ids: IndexArray) -> None:
        if name := options.get(key):
            self.sets[key].setdefault(name.upper(), []).append(ids)

    def assemble(self) -> FileContent:
        ids = integers(np.concatenate(self.ids), "node")
        if len({points.shape[1] for points in self.points}) > 1:
            raise MeshError("some *NODE have two coordinates, others three")
        linear = [kind in (*FACES, "line", "vertex") for kind, *_ in self.elements]
        found = iter(
            blocks_by_id(
                ids,
                [(e[0], e[2]) for e, read in zip(self.elements, linear, strict=True) if read],
            )
        )
        blocks: list[Block] = [
            next(found) if read else (kind, np.zeros_like(corners))
            for (kind, _, corners, _), read in zip(self.elements, linear, strict=True)
        ]
        every = np.concatenate([numbers for _, numbers, _, _ in self.elements])
        cell_rows = members(every, self.sets["ELSET"])
        unique = len(np.unique(every)) == len(every)
        tags, names = self.tags_by_block(blocks)
        if tags is None and unique:
            tags, names = partition(blocks, cell_rows)
        cell_sets = {}
        others = sorted(f"*{key}" for key in set(self.others))
        if len(cell_rows) * len(blocks) > MOST_PARTS:
            others.append(f"{len(cell_rows)} sets of elements")
        elif unique:  # ids say nothing else
            ends = np.cumsum([len(cells) for _, cells in blocks])
            cell_sets = {name: by_block(rows, ends) for name, rows in cell_rows.items()}
        content = FileContent(
            np.ascontiguousarray(np.concatenate(self.points)),
            blocks,
            tags,
            names,
            point_sets=members(ids, self.sets["NSET"]),
            cell_sets=cell_sets,
            extras=tuple(others),
            slots=self.text.slots(np.concatenate(self.slots)),
            places=[self.text.starts[tokens] for *_, tokens in self.elements],
        )
        if quads := quads_in_comments(self.data):
            _add_sides(content, quads, ids)
        return content

    def tags_by_block(
        self, blocks: list[Block]
    ) -> tuple[list[IndexArray] | None, dict[str, tuple[int, int]]]:
        """Regions from ELSET= of *ELEMENT, where each of the faces has one."""
        labels = [name.upper() for name in self.named]
        of_faces = [n for n, (kind, _) in zip(labels, blocks, strict=True) if kind in FACES]
        if not of_faces or not all(of_faces) or len(set(of_faces)) == 1:
            return None, {}
        numbers = {name: k for k, name in enumerate(dict.fromkeys(filter(None, labels)), start=1)}
        tags = [
            np.full(len(c), numbers.get(n, 0)) for n, (_, c) in zip(labels, blocks, strict=True)
        ]
        return tags, {name: (numbers[name], 2) for name in dict.fromkeys(of_faces)}


def _even(rows: IndexArray) -> bool:
    """Whether all rows are of one width."""
    return len(rows) == 2 or not np.diff(rows, 2).any()


def _add_sides(content: FileContent, quads: Quads, ids: IndexArray) -> None:
    """Sides that HOHQMesh has named or curved, as line cells."""
    if len(quads.lines) == 0:
        return
    if content.tags is None:
        content.tags = [np.zeros(len(cells), np.int64) for _, cells in content.blocks]
    lines = positions(ids, quads.lines)
    content.blocks.append(("line", lines))
    content.tags.append(quads.tags)
    for parts in content.cell_sets.values():
        parts.append(NOTHING)
    if content.places is not None:
        content.places.append(quads.places)
    content.names = quads.names | content.names
    ends = np.unique(lines[quads.curved])
    if ends.size and content.slots is not None:
        content.slots = CurvesStay(content.slots, ends)
        content.extras += ("curved sides",)
        content.notes = quads.notes()


def _kind(name: str) -> tuple[str, int]:
    """Type and vertices of an element by its name; 0 vertices for one that is only refused."""
    if match := SURFACE.match(name):
        digits = 6 if name == "STRI65" else int(match[1])
        if digits in KINDS:
            return KINDS[digits], digits
    if LINE.match(name):
        return "line", 2
    if LINE3.match(name):
        return "line3", 3
    if POINT.match(name):
        return "vertex", 1
    return name, 0


def write(content: FileContent) -> bytes:
    """Write nodes, elements and sets; an element set for each region."""
    lines = ["*HEADING", "written by qsmooth", "*NODE"]
    n = len(content.points)
    lines += _commas(rows_of(np.arange(1, n + 1), content.plain_points))
    names = {tag: name for name, (tag, dim) in content.names.items() if dim == 2}
    first = 1
    firsts: list[int] = []
    for b, (kind, cells) in enumerate(content.blocks):
        firsts.append(first)
        if kind not in WRITTEN:
            continue
        tags = np.zeros(len(cells), np.int64) if content.tags is None else content.tags[b]
        ids = np.arange(first, first + len(cells))
        for tag in np.unique(tags).tolist():
            name = names.get(tag, f"region_{tag}") if kind in FACES else f"line_{tag}"
            option = "" if content.tags is None else f", ELSET={name}"
            lines.append(f"*ELEMENT, TYPE={WRITTEN[kind]}{option}")
            lines += _commas(rows_of(ids[tags == tag], cells[tags == tag] + 1))
        first += len(cells)
    for name, vertices in content.point_sets.items():
        lines += [f"*NSET, NSET={name}", *_list(np.asarray(vertices) + 1)]
    for name, parts in content.cell_sets.items():
        if name not in content.names:
            numbers = [
                np.asarray(rows) + start
                for rows, start, (kind, _) in zip(parts, firsts, content.blocks, strict=True)
                if kind in WRITTEN
            ]
            lines += [f"*ELSET, ELSET={name}", *_list(np.concatenate(numbers))]
    return finish(lines)


def _commas(rows: list[str]) -> list[str]:
    return [row.replace(" ", ", ") for row in rows]


def _list(ids: IndexArray) -> list[str]:
    """Ids, sixteen on a line, as many as Abaqus takes."""
    words = list(map(str, ids.tolist()))
    return [", ".join(words[i : i + 16]) for i in range(0, len(words), 16)]
