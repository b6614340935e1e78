"""ADCIRC's fort.14 and SCHISM's gr3: nodes with depths, elements, boundaries in sections."""

from __future__ import annotations

import re

import numpy as np

from qsmooth._types import BoolArray, IndexArray
from qsmooth.io.adcirc_control import in_degrees as in_degrees
from qsmooth.io.chains import boundary_edges, chains, is_island
from qsmooth.io.file_content import Block, FileContent
from qsmooth.io.text import Text, blanked, blocks_by_id, finish, integers, positions, rows_of

NAME = "adcirc"
ENDINGS = (".14", ".grd", ".gr3", ".ll")
HOLDS = frozenset(("level", "line"))

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
OPEN = -1  # in place of an IBTYPE
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


class _Sections:
    """The part after the elements: open boundaries, then those of land, by the ids of nodes."""

    def __init__(self, text: Text, rows: IndexArray) -> None:
        self.text, self.rows, self.firsts = text, rows, rows[:-1]
        letters = np.frombuffer(text.data, np.uint8)[text.starts[self.firsts]]
        numeric = (letters >= ord("0")) & (letters <= ord("9"))
        # What each row begins with, -1 where that is no count.
        self.leading = np.full(len(self.firsts), -1, np.int64)
        self.leading[numeric] = text.numbers_at(self.firsts[numeric], np.int64)
        self.counts: list[int] = self.leading.tolist()
        self.row = 0
        self.names: dict[str, tuple[int, int]] = {}
        self.notes: list[str] = []
        self.extras: list[str] = []
        # Of each section the first row of its nodes, their number, and its type, OPEN or IBTYPE.
        self.table = np.empty((0, 3), np.int64)

    def read(self) -> None:
        """Find all of them; a file may end before the first."""
        if not self.counts:
            return
        for kind in ("open", "land"):
            n_sections = self.count(f"number of {kind} boundaries")
            total = self.count(f"number of nodes on {kind} boundaries")
            table = np.array([self.section(kind) for _ in range(n_sections)], np.int64)
            table = table.reshape(-1, 3)
            listed = int(table[:, 1].sum())
            if total not in (listed, listed + int(table[_ends(table, PAIRED), 1].sum())):
                self.notes.append(
                    f"{total} nodes are declared on {kind} boundaries, {listed} are listed"
                )
            first = len(self.table) + 1
            for number, ibtype in enumerate(table[:, 2].tolist()):
                word = kind if ibtype == OPEN else WORDS.get(ibtype % 10, kind)
                self.names[f"{word}_{number + 1}"] = (first + number, 1)
            self.table = np.concatenate((self.table, table))
        if (self.table[:, 2] > 1).any():
            self.extras.append("types of boundaries")
        if _ends(self.table, BARRIER).any():
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

    def section(self, kind: str) -> tuple[int, int, int]:
        """Read one boundary: a row of the table."""
        n_nodes = self.count("number of nodes of a boundary")
        first = self.row
        self.row += n_nodes
        known = self.counts[first : self.row]
        if len(known) < n_nodes or (known and min(known) < 0):
            bad = first + (known.index(-1) if -1 in known else len(known))
            self.text.fail(
                int(self.rows[bad]),
                f"{n_nodes} nodes of a boundary ({kind}) expected, this is none",
            )
        if kind == "open":
            return first, n_nodes, OPEN
        token = int(self.firsts[first - 1]) + 1
        word = self.text.word(token) if token < self.rows[first] else b""
        return first, n_nodes, int(word[:9]) if word.isdigit() else 0

    def edges(self) -> tuple[IndexArray, IndexArray, IndexArray]:
        """Edges, (k, 2), the number of the section of each, and where its first node stands.

        Islands are closed; of weirs, which are slits of the mesh, there are both sides.
        """
        table, pairs = self.table, self.partners()
        first, length = table[:, 0], table[:, 1]
        last = self.leading[np.maximum(first + length - 1, 0)] if len(table) else length
        closing = _ends(table, CLOSED) & (length > 2)
        closing[closing] = self.leading[first[closing]] != last[closing]
        paired = _ends(table, PAIRED)
        # Strings of nodes: one a section, and of weirs another one behind it.
        section = np.repeat(np.arange(len(table)), 1 + paired)
        across = np.zeros(len(section), np.bool_)
        across[1:] = section[1:] == section[:-1]
        lengths = (length + closing)[section]
        string = np.repeat(np.arange(len(section)), lengths)
        at = np.arange(len(string)) - np.repeat(np.cumsum(lengths) - lengths, lengths)
        own = section[string]
        rows = first[own] + np.where(at < length[own], at, 0)
        nodes = np.where(across[string], pairs[rows], self.leading[rows])
        joins = (string[1:] == string[:-1]) & (nodes[1:] != nodes[:-1])
        begin = np.flatnonzero(joins)
        edges = np.stack((nodes[begin], nodes[begin + 1]), axis=1)
        return edges, own[begin] + 1, self.text.starts[self.firsts[rows[begin]]]

    def partners(self) -> IndexArray:
        """For each row of a weir the node across, else -1."""
        found = np.full(len(self.firsts), -1, np.int64)
        rows = self.rows_in(PAIRED)
        alone = rows[np.diff(self.rows)[rows] < 2]
        if alone.size:
            self.text.fail(int(self.firsts[alone[0]]), "a node of a weir needs one across")
        found[rows] = self.text.numbers_at(self.firsts[rows] + 1, np.int64)
        return found

    def rows_in(self, kinds: tuple[int, ...]) -> IndexArray:
        """Rows of the nodes of sections whose type ends so."""
        own = self.table[_ends(self.table, kinds)]
        starts = np.cumsum(own[:, 1]) - own[:, 1]
        rows: IndexArray = np.arange(own[:, 1].sum()) + np.repeat(own[:, 0] - starts, own[:, 1])
        return rows

    def held(self) -> IndexArray:
        """Nodes of barriers: figures hang on them, and on pairs of them."""
        rows = self.rows_in(BARRIER)
        across = self.partners()[rows]
        return np.concatenate((self.leading[rows], across[across >= 0]))


def _ends(table: IndexArray, kinds: tuple[int, ...]) -> BoolArray:
    """Mark the sections whose type ends so."""
    ends: BoolArray = (table[:, 2] != OPEN) & np.isin(table[:, 2] % 10, kinds)
    return ends


def write(content: FileContent) -> bytes:
    """Write ADCIRC and SCHISM; line cells on the boundary become its sections."""
    faces = content.counter_clockwise()
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
