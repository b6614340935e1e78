"""libMesh XDA: elements, nodes, conditions on sides and nodes; text, from 0.7.0 on."""

from __future__ import annotations

import re
from typing import NoReturn

import numpy as np

from qsmooth._types import FloatArray, IndexArray
from qsmooth.io.file_content import FACES, FileContent
from qsmooth.io.sides import sides_of_lines
from qsmooth.io.text import Cursor, blanked, finish, rows_of, runs

NAME = "xda"
ENDINGS = (".xda",)
HOLDS = frozenset(("z", "vertex", "line", "regions", "names", "point_sets"))

# Element type, as libMesh counts them -> (name, vertices); what is not first order in two
# dimensions is here only so that it can be refused by name.
TYPES = {
    0: ("line", 2),
    1: ("line3", 3),
    2: ("line4", 4),
    3: ("triangle", 3),
    4: ("triangle6", 6),
    5: ("quad", 4),
    6: ("quad8", 8),
    7: ("quad9", 9),
    8: ("tetra", 4),
    9: ("tetra10", 10),
    10: ("hexahedron", 8),
    11: ("hexahedron20", 20),
    12: ("hexahedron27", 27),
    13: ("wedge", 6),
    14: ("wedge15", 15),
    15: ("wedge18", 18),
    16: ("pyramid", 5),
    17: ("pyramid13", 13),
    18: ("pyramid14", 14),
    27: ("vertex", 1),
    30: ("triangle", 3),
    31: ("quad", 4),
    32: ("quad8", 8),
    33: ("triangle7", 7),
}
CODES = {"vertex": 27, "line": 0, "triangle": 3, "quad": 5}
HEADER = re.compile(rb"libMesh-(\d+)\.(\d+)\.(\d+)")
ABSENT = b"n/a"
# What the header of a new file says: no partition and no levels, ids of 8 bytes.
HEAD = """libMesh-1.8.0
{elements}\t # number of elements
{nodes}\t # number of nodes
.\t # boundary condition specification file
.\t # subdomain id specification file
n/a\t # processor id specification file
n/a\t # p-level specification file
8\t # type size
8\t # uid size
0\t # pid size
8\t # sid size
0\t # p-level size
8\t # eid size
8\t # side size
8\t # bid size
0\t # extra integer size
0\t # vector length
\t # node integer names
0\t # vector length
\t # elem integer names
0\t # vector length
\t # elemset codes"""


def sniff(head: bytes) -> bool:
    """Whether a file that starts so is libMesh's."""
    return HEADER.match(head) is not None


def read(data: bytes) -> FileContent:
    """Read XDA; subdomains become regions, sides with a condition line cells."""
    return _Reader(data).content()


class _Reader:
    """Goes through one file from front to back."""

    def __init__(self, data: bytes) -> None:
        clean = blanked(data, rb"[ \t]#[^\r\n]*")
        self.cursor = Cursor(clean)
        match = HEADER.match(self.cursor.word())
        if match is None:
            self.cursor.fail("'libMesh-' and a version must come first")
        self.version = tuple(map(int, match.groups()))
        self.names: dict[str, tuple[int, int]] = {}
        self.cells: list[tuple[str, IndexArray, IndexArray, IndexArray]] = []

    def content(self) -> FileContent:
        cursor = self.cursor
        n_elements, n_nodes = cursor.count("elements"), cursor.count("nodes")
        conditions, *columns = (cursor.word() != ABSENT for _ in range(4))
        has_uid, n_integers = self.sizes()
        if self.version >= (0, 9, 2):
            self.keep_names(2)
        heads = 1 + has_uid + sum(columns)
        # Type, unique id, processor, subdomain, level; what is absent has no column.
        region = 1 + has_uid + columns[1] if columns[0] else -1
        self.elements(n_elements, heads, region, n_integers)
        points, slots = cursor.points(n_nodes, 3)
        if self.version >= (0, 9, 6) and cursor.count("the presence of unique ids"):
            cursor.numbers(n_nodes, "i8", "unique ids")
        extras: list[str] = []
        point_sets: dict[str, IndexArray] = {}
        if conditions:
            self.sides(points)
            if self.version >= (0, 9, 2):
                point_sets = self.node_sets(n_nodes)
            for what in ("edges", "shell faces") if self.version >= (1, 1, 0) else ():
                self.map_of_names()
                n_rows = cursor.count(what)
                cursor.numbers(3 * n_rows, "i8", what)
                extras += [f"conditions on {what}"] if n_rows else []
        if word := cursor.word():
            cursor.fail(f"{word[:40].decode('latin-1')!r} after the end of the mesh")
        return FileContent(
            points,
            [(kind, cells) for kind, cells, _, _ in self.cells],
            [tags for _, _, tags, _ in self.cells],
            self.names,
            point_sets=point_sets,
            extras=tuple(extras),
            slots=slots,
            places=[places for *_, places in self.cells],
        )

    def sizes(self) -> tuple[bool, int]:
        """Whether elements have a unique id, and how many integers follow their nodes."""
        cursor = self.cursor
        if self.version < (0, 9, 2):
            return False, 0
        has_uid = int(cursor.numbers(8, "i8", "sizes")[1]) > 0
        if self.version < (1, 8, 0):
            return has_uid, 0
        cursor.count("the size of extra integers")
        if cursor.count("node integers"):
            cursor.fail("integers of nodes are not read")
        n_integers = cursor.count("element integers")
        for _ in range(n_integers):
            cursor.word()
        if cursor.count("element sets"):
            cursor.fail("element sets are not read")
        return has_uid, n_integers

    def map_of_names(self) -> dict[int, str]:
        """Names by id."""
        cursor = self.cursor
        n = cursor.count("names")
        if n == 0:
            return {}
        if cursor.count("ids of names") != n:
            cursor.fail(f"{n} ids of names expected")
        ids = cursor.numbers(n, "i8", "ids of names").tolist()
        if cursor.count("names") != n:
            cursor.fail(f"{n} names expected")
        return {number: cursor.word().decode("utf-8", "replace") for number in ids}

    def keep_names(self, dimension: int) -> None:
        """Names of subdomains or sides; one that both have is set apart."""
        for number, name in self.map_of_names().items():
            self.names[name if name not in self.names else f"{name}_{number}"] = (number, dimension)

    def elements(self, n: int, heads: int, region: int, n_integers: int) -> None:
        """Elements, a line each: type, ids, nodes, integers; `region` is a column, or -1."""
        cursor = self.cursor
        if cursor.count("elements at level 0") != n:
            cursor.fail("elements that were refined are not read: save the active ones alone")
        text, rows = cursor.text, cursor.text.rows
        row = int(np.searchsorted(rows, cursor.token))
        if row + n >= len(rows):
            cursor.pos = len(cursor.data)
            cursor.fail(f"the file ends too early: {n} elements expected")
        rows = rows[row : row + n + 1]
        widths = np.diff(rows)
        codes = text.numbers_at(rows[:-1], np.int64)
        for code in np.unique(codes).tolist():
            of_code = np.flatnonzero(codes == code)
            if code not in TYPES:
                text.fail(int(rows[of_code[0]]), f"element type {code} is unknown")
            kind, n_corners = TYPES[code]
            odd = of_code[widths[of_code] != heads + n_corners + n_integers]
            if odd.size:
                self.wrong_width(int(rows[odd[0]]), kind, heads + n_corners + n_integers)
        for i, j, table in text.tables(rows[:-1], widths, codes):
            kind, n_corners = TYPES[int(codes[i])]
            tags = np.zeros(j - i, np.int64) if region < 0 else table[:, region].copy()
            corners = np.ascontiguousarray(table[:, heads : heads + n_corners])
            self.cells.append((kind, corners, tags, text.starts[rows[i:j]]))
        if n:
            cursor.pos = int(text.ends[rows[n] - 1])

    def wrong_width(self, token: int, kind: str, width: int) -> NoReturn:
        self.cursor.text.fail(token, f"a {kind} needs {width} numbers, as the header says")

    def sides(self, points: FloatArray) -> None:
        """Conditions on sides: element, side, id; each becomes a line cell with its id."""
        cursor = self.cursor
        if self.version >= (0, 9, 2):
            self.keep_names(1)
        n = cursor.count("conditions on sides")
        token = cursor.token
        element, side, tags = cursor.numbers(3 * n, "i8", "conditions on sides").reshape(n, 3).T
        if n == 0:
            return
        counts = np.array([len(cells) for _, cells, _, _ in self.cells])
        sizes = np.array([c.shape[1] if k in FACES else 0 for k, c, _, _ in self.cells])
        corners = np.zeros((counts.sum(), 4), np.int64)
        ends = np.cumsum(counts)
        for (_, cells, _, _), end, size in zip(self.cells, ends, sizes, strict=True):
            corners[end - len(cells) : end, :size] = cells[:, :size]
        size = np.repeat(sizes, counts)
        wrong = (element < 0) | (element >= len(corners))
        element = np.where(wrong, 0, element)
        wrong |= (side < 0) | (side >= size[element])
        if wrong.any():
            row = int(np.argmax(wrong))
            cursor.text.fail(
                token + 3 * row, f"{int(wrong.sum())} conditions are on no side of an element"
            )
        following = np.where(side + 1 == size[element], 0, side + 1)
        lines = np.stack([corners[element, side], corners[element, following]], axis=1)
        places = cursor.text.starts[token + 3 * np.arange(n)]
        self.cells.append(("line", lines, np.ascontiguousarray(tags), places))

    def node_sets(self, n_nodes: int) -> dict[str, IndexArray]:
        """Conditions on nodes: node, id."""
        cursor = self.cursor
        names = self.map_of_names()
        n = cursor.count("conditions on nodes")
        token = cursor.token
        table = cursor.numbers(2 * n, "i8", "conditions on nodes").reshape(n, 2)
        wrong = (table[:, 0] < 0) | (table[:, 0] >= n_nodes)
        if wrong.any():
            row = int(np.argmax(wrong))
            cursor.text.fail(token + 2 * row, f"there is no node {table[row, 0]}")
        table = table[np.lexsort((table[:, 0], table[:, 1]))]
        return {
            names.get(int(table[i, 1]), f"nodeset_{table[i, 1]}"): table[i:j, 0].copy()
            for i, j in runs(table[:, 1])
        }


def write(content: FileContent) -> bytes:
    """Write XDA 1.8.0; lines on sides become conditions, others elements of their own."""
    parts = content.of_type(*FACES) + content.of_type("vertex")
    lines, ids = content.lines
    element, side, _ = sides_of_lines([cells for cells, _ in content.of_type(*FACES)], lines)
    beside = element < 0
    if beside.any():
        parts.append((lines[beside], ids[beside]))
    n_elements, n_nodes = sum(len(cells) for cells, _ in parts), len(content.points)
    regions = {tag: name for name, (tag, dim) in content.names.items() if dim == 2}
    sides = {tag: name for name, (tag, dim) in content.names.items() if dim == 1}
    out = HEAD.format(elements=n_elements, nodes=n_nodes).split("\n")
    out += _names(regions, "subdomain id")
    out.append(f"{n_elements}\t # n_elem at level 0, [ type uid sid (n0 ... nN-1) ]")
    first = n_nodes
    by_size = {1: CODES["vertex"], 2: CODES["line"], 3: CODES["triangle"], 4: CODES["quad"]}
    for cells, tags in parts:
        n = len(cells)
        numbers = np.zeros(n, np.int64) if tags is None else tags
        code = np.full(n, by_size[cells.shape[1]])
        out += rows_of(code, first + np.arange(n), numbers, cells)
        first += n
    out += rows_of(content.points_3d)
    out += ["1\t # presence of unique ids", *rows_of(np.arange(n_nodes))]
    out += [
        *_names(sides, "sideset id"),
        f"{(~beside).sum()}\t # number of side boundary conditions",
    ]
    out += rows_of(element[~beside], side[~beside], ids[~beside])
    sets = list(content.point_sets)
    members = [np.asarray(content.point_sets[name], np.int64) for name in sets]
    out += _names(dict(enumerate(sets)), "nodeset id")
    out.append(f"{sum(map(len, members))}\t # number of nodesets")
    for number, nodes in enumerate(members):
        out += rows_of(nodes, np.full(len(nodes), number))
    for what in ("edge", "shellface"):
        out += [*_names({}, "sideset id"), f"0\t # number of {what} boundary conditions"]
    return finish(out)


def _names(names: dict[int, str], what: str) -> list[str]:
    n = len(names)
    lines = [f"{n}\t # {what} to name map"]
    if n:
        # libMesh reads names up to the next white space.
        words = ["_".join(name.split()) or "_" for name in names.values()]
        lines += [f"{n}\t # vector length", "".join(f"{number}\t " for number in names)]
        lines += [f"{n}\t # vector length", "".join(f"{word}\t " for word in words)]
    return lines
