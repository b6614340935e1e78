"""SMS 2D mesh: a card on each line says what the line holds."""

from __future__ import annotations

import re

import numpy as np

from qsmooth._types import BoolArray, IndexArray
from qsmooth.io.chains import chains
from qsmooth.io.file_content import Block, FileContent
from qsmooth.io.text import Text, blocks_by_id, finish, integers, rows_of

NAME = "2dm"
ENDINGS = (".2dm",)
HOLDS = frozenset(("level", "line", "vertex", "regions", "names"))

ELEMENTS = {
    b"E2L": ("line", 2),
    b"E3L": ("line3", 3),
    b"E3T": ("triangle", 3),
    b"E4Q": ("quad", 4),
    b"E6T": ("triangle6", 6),
    b"E8Q": ("quad8", 8),
    b"E9Q": ("quad9", 9),
}
# Cards that say nothing that is not kept elsewhere.
SILENT = frozenset((b"MESH2D", b"MESHNAME", b"NUM_MATERIALS_PER_ELEM", b"MAT"))
CARD = re.compile(rb"[A-Za-z][A-Za-z0-9_]*")
# A card of so many letters is told from others by a number; longer ones are none that matter.
LONGEST = 4
# So many of the cards that are kept are named.
NAMED = 5
# SMS writes so many vertices of a node string into a line.
A_LINE = 10
NO_MATERIAL = 1
# Cards that come in pairs.
PAIRS = ((b"BEGPARAMDEF", b"ENDPARAMDEF"), (b"BEGCURVE", b"ENDCURVE"))


def sniff(head: bytes) -> bool:
    """Whether a file that starts so is SMS's."""
    return re.match(rb"(?:\s|#[^\r\n]*[\r\n])*MESH2D(?:\s|#|$)", head) is not None


def read(data: bytes) -> FileContent:
    """Read SMS; materials become regions, node strings line cells, every other card is kept."""
    text = Text(_without_comments(data))
    firsts, widths = text.rows[:-1], np.diff(text.rows)
    if text.word(0) != b"MESH2D":
        text.fail(0, "the first card must be MESH2D")
    keys = _keys(text, firsts)
    mark = keys == _key(b"ND")
    short = np.flatnonzero(mark & (widths < 5))
    if short.size:
        text.fail(int(firsts[short[0]]), "a node needs an id, x, y and z")
    tokens = firsts[mark][:, None] + np.arange(1, 5)
    table = text.numbers_at(tokens.ravel()).reshape(-1, 4)
    ids = integers(table[:, 0], "node")

    blocks, tags, places = _elements(text, firsts, widths, keys)
    names: dict[str, tuple[int, int]] = {}
    for row in np.flatnonzero(keys == _key(b"MAT")).tolist():
        _, number, *label = text.words(int(firsts[row]), int(firsts[row] + widths[row]))
        if number.isdigit() and label:
            names.setdefault(_label(label), (int(number), 2))
    strings = _Strings(text, firsts, widths)
    for row in np.flatnonzero(keys == _key(b"NS")).tolist():
        strings.add(row)
    strings.finish(blocks, tags, places, names)

    other = _others(text, firsts, keys)
    extras = [f"SMS cards {other}"] if other else []
    extras += ["comments"] if text.data != data else []
    found = blocks_by_id(ids, blocks)
    return FileContent(
        np.ascontiguousarray(table[:, 1:]),
        found,
        tags,
        names,
        extras=tuple(extras),
        notes=tuple(_cut(text, keys, found, len(ids))),
        z_means="height",
        slots=text.slots(tokens[:, 1:]),
        places=places,
    )


def _cut(text: Text, keys: IndexArray, cells: list[Block], n_nodes: int) -> list[str]:
    """Signs that the end of a file is missing; it has no counts that would tell."""
    notes = []
    if text.data.rstrip(b" \t")[-1:] not in (b"\n", b"\r"):
        notes.append("the last line has no end: the file may be cut off")
    for begin, end in PAIRS:
        if re.search(rb"(?m)^[ \t]*" + begin, text.data) and end not in text.data:
            notes.append(f"{begin.decode()} has no {end.decode()}: the file is cut off")
    nodes = np.flatnonzero(keys == _key(b"ND"))
    elements = np.flatnonzero(np.isin(keys, [_key(card) for card in ELEMENTS]))
    last = max((int(table.max()) for _, table in cells), default=-1)
    if nodes.size and elements.size and elements[-1] > nodes[-1] and last + 1 < n_nodes:
        notes.append(
            f"the last {n_nodes - 1 - last} nodes are in no element: the file may be cut off"
        )
    return notes


def _without_comments(data: bytes) -> bytes:
    """Blank what follows a ``#`` that does not stand in quotes."""
    if b"#" not in data:
        return data
    return re.sub(
        rb'"[^"\r\n]*"|#[^\r\n]*',
        lambda match: match[0] if match[0][:1] == b'"' else b" " * len(match[0]),
        data,
    )


def _key(card: bytes) -> int:
    return int.from_bytes(card, "little")


def _keys(text: Text, firsts: IndexArray) -> IndexArray:
    """A number for the card of each row, 0 where it is longer than those that matter."""
    letters = np.frombuffer(text.data + bytes(LONGEST), np.uint8)
    begins, lengths = text.starts[firsts], text.ends[firsts] - text.starts[firsts]
    keys = np.zeros(len(firsts), np.int64)
    for k in range(LONGEST):
        keys |= np.where(lengths > k, letters[begins + k].astype(np.int64) << (8 * k), 0)
    keys[lengths > LONGEST] = 0
    return keys


def _elements(
    text: Text, firsts: IndexArray, widths: IndexArray, keys: IndexArray
) -> tuple[list[Block], list[IndexArray], list[IndexArray]]:
    """Cells by the ids of their nodes, their materials, and where they stand."""
    corners = np.zeros(len(keys), np.int64)
    for card, (_, n_corners) in ELEMENTS.items():
        corners[keys == _key(card)] = n_corners
    rows = np.flatnonzero(corners)
    firsts, widths, keys, corners = firsts[rows], widths[rows], keys[rows], corners[rows]
    short = np.flatnonzero(widths < corners + 2)
    if short.size:
        text.fail(int(firsts[short[0]]), f"an element needs an id and {corners[short[0]]} nodes")
    has_material: BoolArray = widths > corners + 2
    blocks: list[Block] = []
    tags, places = [], []
    kinds = 2 * keys + has_material
    for i, j, table in text.tables(firsts + 2, corners + has_material, kinds):
        kind, n_corners = ELEMENTS[int(keys[i]).to_bytes(LONGEST, "little").rstrip(b"\0")]
        blocks.append((kind, table[:, :n_corners]))
        tags.append(table[:, n_corners] if has_material[i] else np.full(j - i, NO_MATERIAL))
        places.append(text.starts[firsts[i:j]])
    return blocks, tags, places


class _Strings:
    """Node strings: ids over as many rows as it takes, the last one negative; perhaps a name."""

    def __init__(self, text: Text, firsts: IndexArray, widths: IndexArray) -> None:
        self.text, self.firsts, self.widths = text, firsts.tolist(), widths.tolist()
        self.open: list[int] = []
        self.rows: list[int] = []
        self.whole: list[tuple[list[int], list[int], int, str]] = []

    def add(self, row: int) -> None:
        """Read on with this row."""
        first = self.firsts[row]
        words = self.text.words(first + 1, first + self.widths[row])
        for k, word in enumerate(words):
            if not word.lstrip(b"-").isdigit():
                self.text.fail(first + 1 + k, f"{word[:40].decode('latin-1')!r} is no node id")
            node = int(word)
            self.open.append(abs(node))
            self.rows.append(first)
            if node < 0:
                self._close(words[k + 1 :])
                return

    def _close(self, rest: list[bytes]) -> None:
        number = len(self.whole) + 1
        if rest and rest[0].isdigit():
            number, rest = int(rest[0]), rest[1:]
        self.whole.append((self.open, self.rows, number, _label(rest)))
        self.open, self.rows = [], []

    def finish(
        self,
        blocks: list[Block],
        tags: list[IndexArray],
        places: list[IndexArray],
        names: dict[str, tuple[int, int]],
    ) -> None:
        """Append them as line cells, those of one vertex as point cells."""
        if self.open:
            self.text.fail(self.rows[-1], "the node string that ends here has no negative id")
        for kind, size in (("line", 2), ("vertex", 1)):
            cells, numbers, rows = [], [], []
            for nodes, at, number, name in self.whole:
                if (len(nodes) == 1) == (size == 1):
                    n_cells = len(nodes) - size + 1
                    cells += [nodes[k : k + size] for k in range(n_cells)]
                    numbers += n_cells * [number]
                    rows += at[size - 1 :]
                    if name:
                        names.setdefault(name, (number, size - 1))
            if cells:
                blocks.append((kind, np.array(cells, np.int64)))
                tags.append(np.array(numbers, np.int64))
                places.append(self.text.starts[np.array(rows)])


def _label(words: list[bytes]) -> str:
    joined = b" ".join(words).strip(b'" ')
    try:
        return joined.decode()
    except UnicodeDecodeError:
        return joined.decode("latin-1")


def _others(text: Text, firsts: IndexArray, keys: IndexArray) -> str:
    """The cards that are kept as they are, in words."""
    known = np.isin(keys, [_key(card) for card in (b"ND", b"NS", b"MAT", *ELEMENTS)])
    found: dict[bytes, None] = {}
    in_curve = False  # which holds rows of numbers
    for first in firsts[~known].tolist():
        word = text.word(first)
        in_curve = word == b"BEGCURVE" or (in_curve and word != b"ENDCURVE")
        if word not in found and not (in_curve and word != b"BEGCURVE"):
            if not CARD.fullmatch(word) or re.fullmatch(rb"E\d\w", word):
                text.fail(first, f"{word[:40].decode('latin-1')!r} is no card of SMS")
            found[word] = None
    others = [word.decode()[:40] for word in found if word not in SILENT]
    more = f" and {len(others) - NAMED} more" if len(others) > NAMED else ""
    return ", ".join(others[:NAMED]) + more


def write(content: FileContent) -> bytes:
    """Write SMS; line cells become node strings, a number each for those of one tag."""
    lines = ["MESH2D", 'MESHNAME "mesh"', "NUM_MATERIALS_PER_ELEM 1"]
    first = 1
    for cells, tags in content.counter_clockwise():
        card = "E3T" if cells.shape[1] == 3 else "E4Q"
        numbers = np.arange(first, first + len(cells))
        materials = np.full(len(cells), NO_MATERIAL) if tags is None else tags
        lines += [f"{card} {row}" for row in rows_of(numbers, cells + 1, materials)]
        first += len(cells)
    n = len(content.points)
    xyz = np.column_stack((content.points[:, :2], content.z("height")))
    lines += [f"ND {row}" for row in rows_of(np.arange(1, n + 1), xyz)]
    names = {(tag, dim): name for name, (tag, dim) in content.names.items()}
    for kind, dimension in (("line", 1), ("vertex", 0)):
        for cells, tags in content.of_type(kind):
            marks = np.ones(len(cells), np.int64) if tags is None else np.asarray(tags)
            for mark in np.unique(marks).tolist():
                own = cells[marks == mark]
                for chain in chains(own) if dimension else list(own):
                    lines += _string(chain, mark, names.get((mark, dimension), ""))
    materials_named = [(tag, name) for (tag, dim), name in names.items() if dim == 2]
    if materials_named:
        lines += ["BEGPARAMDEF", 'GM  "Mesh"', "SI  0", "DY  0", 'TU  ""', "TD  0  0", "NUME  3"]
        lines += [f"MAT {tag} {_quoted(name)}" for tag, name in sorted(materials_named)]
        lines += ["ENDPARAMDEF"]
    return finish(lines)


def _string(chain: IndexArray, mark: int, name: str) -> list[str]:
    ids = [str(v + 1) for v in chain.tolist()]
    ids[-1] = f"-{ids[-1]} {mark}" + (f" {_quoted(name)}" if name else "")
    return ["NS " + " ".join(ids[k : k + A_LINE]) for k in range(0, len(ids), A_LINE)]


def _quoted(name: str) -> str:
    return '"' + re.sub(r'["\r\n]', "'", name) + '"'
