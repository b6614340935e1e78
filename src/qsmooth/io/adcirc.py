"""ADCIRC's fort.14 and SCHISM's gr3: nodes with depths, elements, boundaries in sections."""

from __future__ import annotations

import re
from dataclasses import dataclass, field

import numpy as np

from qsmooth._types import IndexArray
from qsmooth.io.chains import boundary_edges, chains, is_island
from qsmooth.io.file_content import FACES, Block, FileContent
from qsmooth.io.text import Text, blanked, blocks_by_id, finish, integers, positions, rows_of

NAME = "adcirc"
ENDINGS = (".14", ".grd", ".gr3")
HOLDS = frozenset(("z", "line"))

KINDS = {2: "line", 3: "triangle", 4: "quad"}
COMMENT = rb"![^\r\n]*"
NUMBER = rb"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eEdD][-+]?\d+)?"
# A title, which may be empty; two counts and no third; a node.
BEGINNING = re.compile(
    rb"(?:(?P<title>[^\r\n]*)(?:\r\n?|\n))?\s*"
    rb"\d+[ \t]+\d+(?:(?![ \t]+" + NUMBER + rb"(?:\s|$))[ \t]+[^\r\n]*)?[\r\n]\s*"
    rb"\d+(?:[ \t]+" + NUMBER + rb"){3}(?:\s|$)"
)
# What a boundary is by the last digit of its IBTYPE.
WORDS = {0: "land", 1: "island", 2: "flux", 3: "barrier", 4: "weir", 5: "culvert"}
CLOSED, BARRIER, PAIRED = (1,), (3, 4, 5), (4, 5)


def sniff(head: bytes) -> bool:
    """Whether a file that starts so is ADCIRC's or SCHISM's."""
    return BEGINNING.match(head) is not None


def read(data: bytes) -> FileContent:
    """Read ADCIRC and SCHISM; depths become z, boundary sections line cells."""
    body = re.sub(rb"\A[^\r\n]*", lambda title: b" " * len(title[0]), data)
    text = Text(blanked(body, COMMENT) if b"!" in body else body)
    rows = text.rows
    if len(rows) < 2 or rows[1] - rows[0] < 2:
        text.fail(0, "the second line must have the numbers of elements and of nodes")
    n_cells, n_points = text.numbers(int(rows[0]), int(rows[0]) + 2, np.int64).tolist()
    n_rows = len(rows) - 2
    if min(n_cells, n_points) < 0 or n_cells + n_points > n_rows:
        text.fail(
            0, f"the header says {n_points} nodes and {n_cells} elements, {n_rows} lines follow"
        )

    firsts, widths = rows[1 : 1 + n_points], np.diff(rows[1 : 2 + n_points])
    short = np.flatnonzero(widths < 4)
    if short.size:
        text.fail(int(firsts[short[0]]), "a node needs an id, x, y and a depth")
    tokens = firsts[:, None] + np.arange(4)
    table = text.numbers_at(tokens.ravel()).reshape(-1, 4)
    ids = integers(table[:, 0], "node")
    blocks, places = _elements(text, rows[1 + n_points : 2 + n_points + n_cells])
    tags = [np.ones(len(cells), np.int64) for _, cells in blocks]

    sections = _Sections(text, rows[1 + n_points + n_cells :])
    sections.read()
    edges, marks, at = sections.edges()
    if len(edges):
        blocks.append(("line", edges))
        tags.append(marks)
        places.append(at)
    held = sections.held()
    return FileContent(
        np.ascontiguousarray(table[:, 1:]),
        blocks_by_id(ids, blocks),
        tags if len(edges) else None,
        sections.names,
        extras=(*sections.extras, *(["comments"] if text.data != body else [])),
        notes=tuple(sections.notes),
        z_means="depth",
        held=np.unique(positions(ids, held, "node")) if held.size else None,
        slots=text.slots(tokens[:, 1:]),
        places=places,
    )


def _elements(text: Text, rows: IndexArray) -> tuple[list[Block], list[IndexArray]]:
    """Cells by the ids of their nodes, and where they stand."""
    firsts, widths = rows[:-1], np.diff(rows)
    short = np.flatnonzero(widths < 5)
    if short.size:
        text.fail(int(firsts[short[0]]), "an element needs an id, a count and its nodes")
    counts = text.numbers_at(firsts + 1, np.int64)
    wrong = np.flatnonzero((counts < 2) | (counts > widths - 2))
    if wrong.size:
        count = int(counts[wrong[0]])
        text.fail(int(firsts[wrong[0]]), f"an element of {count} nodes that does not fit its line")
    blocks: list[Block] = []
    places = []
    for i, j, cells in text.tables(firsts + 2, counts, counts):
        n_corners = cells.shape[1]
        blocks.append((KINDS.get(n_corners, f"polygon{n_corners}"), cells))
        places.append(text.starts[firsts[i:j]])
    return blocks, places


@dataclass
class _Section:
    """One boundary: its rows, the first and the end, its type and its number among all."""

    first: int
    end: int
    type: int
    number: int

    def is_any(self, kinds: tuple[int, ...]) -> bool:
        """Whether its type ends so; those of open boundaries are -1."""
        return self.type >= 0 and self.type % 10 in kinds


@dataclass
class _Sections:
    """The part after the elements: open boundaries, then those of land, by the ids of nodes."""

    text: Text
    rows: IndexArray
    all: list[_Section] = field(default_factory=list)
    names: dict[str, tuple[int, int]] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)
    extras: list[str] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.firsts = self.rows[:-1]
        letters = np.frombuffer(self.text.data, np.uint8)[self.text.starts[self.firsts]]
        numeric = (letters >= ord("0")) & (letters <= ord("9"))
        # What each row begins with, -1 where that is no count.
        self.leading = np.full(len(self.firsts), -1, np.int64)
        self.leading[numeric] = self.text.numbers_at(self.firsts[numeric], np.int64)
        self.counts: list[int] = self.leading.tolist()
        self.row = 0

    def read(self) -> None:
        """Find all of them; a file may end before the first."""
        if not self.counts:
            return
        for kind in ("open", "land"):
            n_sections = self.count(f"number of {kind} boundaries")
            total = self.count(f"number of nodes on {kind} boundaries")
            first = len(self.all)
            for number in range(1, n_sections + 1):
                self.section(kind, number)
            own = self.all[first:]
            listed = sum(section.end - section.first for section in own)
            twice = sum(s.end - s.first for s in own if s.is_any(PAIRED))
            if total not in (listed, listed + twice):
                self.notes.append(
                    f"{total} nodes are declared on {kind} boundaries, {listed} are listed"
                )
        if any(section.type > 1 for section in self.all):
            self.extras.append("types of boundaries")
        if any(section.is_any(BARRIER) for section in self.all):
            self.extras.append("figures of barriers")
        if self.row < len(self.counts):
            self.extras.append("text behind the boundaries")

    def count(self, what: str) -> int:
        """The count that the next row begins with."""
        count = self.counts[self.row] if self.row < len(self.counts) else -1
        if count < 0:
            self.text.fail(int(self.rows[self.row]), f"{what} expected")
        self.row += 1
        return count

    def section(self, kind: str, number: int) -> None:
        """Read one boundary."""
        n_nodes = self.count(f"number of nodes of {kind} boundary {number}")
        first = self.row
        self.row += n_nodes
        if self.row > len(self.counts) or min(self.counts[first : self.row], default=0) < 0:
            known = self.counts[first : self.row]
            at = first + (known.index(-1) if -1 in known else len(known))
            self.text.fail(
                int(self.rows[at]), f"{kind} boundary {number} has {n_nodes} nodes, this is none"
            )
        section = _Section(first, self.row, -1, len(self.all) + 1)
        if kind == "land":
            token = int(self.firsts[first - 1]) + 1
            word = self.text.word(token) if token < self.rows[first] else b""
            section.type = int(word) if word.isdigit() else 0
            kind = WORDS.get(section.type % 10, kind)
        self.all.append(section)
        self.names[f"{kind}_{number}"] = (section.number, 1)

    def edges(self) -> tuple[IndexArray, IndexArray, IndexArray]:
        """Edges, (k, 2), the number of the section of each, and where its first node stands.

        Islands are closed; of weirs, which are slits of the mesh, there are both sides.
        """
        pairs = self.partners()
        nodes, marks, rows = [np.empty(0, np.int64)], [], [np.empty(0, np.int64)]
        for section in self.all:
            own = np.arange(section.first, section.end)
            ids = self.leading[own]
            if section.is_any(CLOSED) and ids.size > 2 and ids[0] != ids[-1]:
                own = np.append(own, section.first)
            for side in (self.leading, pairs) if section.is_any(PAIRED) else (self.leading,):
                nodes.append(side[own])
                rows.append(own)
                marks.append(np.full(own.size, section.number))
        if not marks:
            return np.empty((0, 2), np.int64), np.empty(0, np.int64), np.empty(0, np.int64)
        ids, at, mark = np.concatenate(nodes), np.concatenate(rows), np.concatenate(marks)
        starts = np.cumsum([part.size for part in nodes[1:]])
        wanted = np.ones(ids.size, np.bool_)
        wanted[starts[starts > 0] - 1] = False  # none from one string to the next
        wanted[:-1] &= ids[:-1] != ids[1:]
        firsts = np.flatnonzero(wanted)
        edges = np.stack((ids[firsts], ids[firsts + 1]), axis=1)
        return edges, mark[firsts], self.text.starts[self.firsts[at[firsts]]]

    def partners(self) -> IndexArray:
        """For each row of a weir the node across, else -1."""
        found = np.full(len(self.firsts), -1, np.int64)
        parts = [np.arange(s.first, s.end) for s in self.all if s.is_any(PAIRED)]
        if parts:
            rows = np.concatenate(parts)
            alone = rows[np.diff(self.rows)[rows] < 2]
            if alone.size:
                self.text.fail(int(self.firsts[alone[0]]), "a node of a weir needs one across")
            found[rows] = self.text.numbers_at(self.firsts[rows] + 1, np.int64)
        return found

    def held(self) -> IndexArray:
        """Nodes of barriers: figures hang on them, and on pairs of them."""
        pairs = self.partners()
        rows = [np.arange(s.first, s.end) for s in self.all if s.is_any(BARRIER)]
        chosen = np.concatenate(rows) if rows else np.empty(0, np.int64)
        across = pairs[chosen]
        return np.concatenate((self.leading[chosen], across[across >= 0]))


def write(content: FileContent) -> bytes:
    """Write ADCIRC and SCHISM; line cells on the boundary become its sections."""
    faces = content.of_type(*FACES)
    n, n_faces = len(content.points), sum(len(cells) for cells, _ in faces)
    lines = ["mesh", f"{n_faces} {n} ! number of elements, nodes"]
    xyz = np.column_stack((content.points[:, :2], content.z("depth")))
    lines += rows_of(np.arange(1, n + 1), xyz)
    first = 1
    for cells, _ in faces:
        numbers = np.arange(first, first + len(cells))
        lines += rows_of(numbers, np.full(len(cells), cells.shape[1]), cells + 1)
        first += len(cells)
    opens, lands = _parts(content)
    for kind, found in (("open", opens), ("land", lands)):
        lines.append(f"{len(found)} ! number of {kind} boundaries")
        lines.append(f"{sum(len(chain) for chain in found)} ! nodes on {kind} boundaries")
        for number, chain in enumerate(found, start=1):
            island = chain[0] == chain[-1] and is_island(content.points, chain)
            shown = f" {int(island)}" if kind == "land" else ""
            lines.append(f"{len(chain)}{shown} ! nodes of {kind} boundary {number}")
            lines += rows_of(chain + 1)
    return finish(lines)


def _parts(content: FileContent) -> tuple[list[IndexArray], list[IndexArray]]:
    """Strings of the boundary that line cells mark: those with a name like open_1, and the rest."""
    edges = boundary_edges(content)
    place = {(min(a, b), max(a, b)): k for k, (a, b) in enumerate(edges.tolist())}
    of_tag: dict[int, dict[int, None]] = {}
    inside = 0
    for cells, tags in content.of_type("line"):
        marks = [0] * len(cells) if tags is None else np.asarray(tags).tolist()
        for (a, b), mark in zip(cells.tolist(), marks, strict=True):
            k = place.get((min(a, b), max(a, b)))
            if k is None:
                inside += 1
            else:
                of_tag.setdefault(mark, {})[k] = None
    if inside:
        content.extras = (*content.extras, f"{inside} line cells that are not on the boundary")
    opened = {tag for name, (tag, dim) in content.names.items() if dim == 1 and _is_open(name)}
    opens: list[IndexArray] = []
    lands: list[IndexArray] = []
    for tag, chosen in of_tag.items():
        (opens if tag in opened else lands).extend(chains(edges[list(chosen)]))
    return opens, lands


def _is_open(name: str) -> bool:
    return name.lower().startswith("open")
