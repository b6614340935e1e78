"""MFEM mesh v1.x: elements, boundary elements and vertices of straight-sided meshes."""

from __future__ import annotations

import numpy as np

from qsmooth._types import FloatArray, IndexArray
from qsmooth.errors import MeshError
from qsmooth.io.file_content import FACES, Block, FileContent
from qsmooth.io.in_place import InPlace
from qsmooth.io.mfem_nodes import read_nodes
from qsmooth.io.text import Cursor, blanked, finish, rows_of

NAME = "mfem"
ENDINGS = (".mesh",)
HOLDS = frozenset(("z", "line", "regions"))

# Geometry -> (name, vertices)
TYPES = {
    0: ("vertex", 1),
    1: ("line", 2),
    2: ("triangle", 3),
    3: ("quad", 4),
    4: ("tetra", 4),
    5: ("hexahedron", 8),
    6: ("wedge", 6),
    7: ("pyramid", 5),
}
CODES = {"vertex": 0, "line": 1, "triangle": 2, "quad": 3}


def sniff(head: bytes) -> bool:
    """Whether a file that starts so is MFEM's."""
    return head.lstrip().startswith(b"MFEM ")


def read(data: bytes) -> FileContent:
    """Read MFEM; attributes become regions, boundary elements line cells."""
    cursor = Cursor(blanked(data, rb"#[^\r\n]*") if b"#" in data else data)
    first = cursor.line().split()
    if first[:2] != [b"MFEM", b"mesh"] or first[2:3] not in ([b"v1.0"], [b"v1.2"], [b"v1.3"]):
        shown = b" ".join(first).decode("latin-1")
        cursor.fail(f"{shown[:60]!r}: only 'MFEM mesh' v1.0, v1.2 and v1.3 are read")
    points: FloatArray | None = None
    slots: InPlace | None = None
    blocks: list[Block] = []
    tags, places = [], []
    n_vertices = n_elements = 0
    notes: tuple[str, ...] = ()
    others = []
    while word := cursor.word():
        if word == b"dimension":
            cursor.count("dimensions")
        elif word in (b"elements", b"boundary"):
            n = cursor.count(word.decode())
            text, rows = cursor.text, cursor.text.rows
            row = int(np.searchsorted(rows, cursor.token))
            if row + n >= len(rows):
                cursor.pos = len(data)
                cursor.fail(f"the file ends too early: {n} {word.decode()} expected")
            rows = rows[row : row + n + 1]
            if n == 0:
                continue
            widths = np.diff(rows)
            if widths.min() < 3:
                text.fail(
                    int(rows[np.argmin(widths)]), f"{n} {word.decode()} expected, this is none"
                )
            codes = text.numbers_at(rows[:-1] + 1, np.int64)
            for code in np.unique(codes).tolist():
                rows_of_code = np.flatnonzero(codes == code)
                if code not in TYPES:
                    text.fail(int(rows[rows_of_code[0]]), f"geometry {code} is unknown")
                kind, n_corners = TYPES[code]
                odd = rows_of_code[widths[rows_of_code] != 2 + n_corners]
                if odd.size:
                    text.fail(int(rows[odd[0]]), f"a {kind} needs {2 + n_corners} numbers")
            for i, j, table in text.tables(rows[:-1], widths, codes):
                kind = TYPES[int(codes[i])][0]
                blocks.append((kind, np.ascontiguousarray(table[:, 2:])))
                tags.append(np.ascontiguousarray(table[:, 0]))
                places.append(text.starts[rows[i:j]])
            cursor.pos = int(text.ends[rows[n] - 1])
            if word == b"elements":
                n_elements = len(blocks)
        elif word == b"vertices":
            n = cursor.count("vertices")
            if cursor.text.word(cursor.token) == b"nodes":
                n_vertices = n
                continue
            dimension = cursor.count("coordinates of a vertex")
            if dimension not in (2, 3):
                cursor.fail(f"{dimension} coordinates of a vertex: must be 2 or 3")
            points, slots = cursor.points(n, dimension, range(dimension))
        elif word == b"nodes":
            nodes = read_nodes(cursor, n_vertices, blocks[:n_elements], blocks[n_elements:])
            points, slots, notes = nodes.points, nodes.slots, nodes.notes
            blocks = nodes.blocks
        elif word in (b"attribute_sets", b"bdr_attribute_sets"):
            n = cursor.count(word.decode())
            for _ in range(n):
                cursor.line()
            others.append(word.decode())
        elif word == b"mfem_mesh_end":
            break
        else:
            cursor.fail(
                f"{word[:40].decode('latin-1')!r} is no section of MFEM, or a count is wrong"
            )
    if points is None:
        raise MeshError("the file has no section of vertices")
    return FileContent(
        points,
        blocks,
        tags,
        cell_data={"mfem:attribute": list(tags)},
        extras=tuple(f"section {name}" for name in others)
        + (("comments",) if b"#" in data else ()),
        notes=notes,
        slots=slots,
        places=places,
    )


def write(content: FileContent) -> bytes:
    """Write MFEM mesh v1.0."""
    n, dimension = content.plain_points.shape
    lines = ["MFEM mesh v1.0", "", "dimension", "2", ""]
    for section, kinds in (("elements", FACES), ("boundary", ("line",))):
        parts = content.of_type(*kinds)
        lines += [section, str(sum(len(cells) for cells, _ in parts))]
        for cells, tags in parts:
            # Attributes must be positive.
            attributes = np.ones(len(cells), np.int64) if tags is None else _positive(tags)
            code = {2: 1, 3: 2, 4: 3}[cells.shape[1]]
            lines += rows_of(attributes, np.full(len(cells), code), cells)
        lines.append("")
    return finish([*lines, "vertices", str(n), str(dimension), *rows_of(content.plain_points)])


def _positive(tags: IndexArray) -> IndexArray:
    return np.where(tags > 0, tags, 1)
