"""OFF: vertices, then faces with as many corners as each says."""

from __future__ import annotations

import re

import numpy as np

from qsmooth._types import IndexArray
from qsmooth.errors import MeshError
from qsmooth.io.file_content import FACES, FileContent
from qsmooth.io.text import Text, blanked, finish, rows_of

NAME = "off"
ENDINGS = (".off",)
HOLDS = frozenset(("z",))

KINDS = {1: "vertex", 2: "line", 3: "triangle", 4: "quad"}
# The letters before OFF say what each vertex has besides its place: ST texture (2 numbers),
# C colour (3 or 4), N normal (3); 4 and n mean other dimensions.
HEADER = re.compile(rb"(ST)?(C)?(N)?(4)?(n)?OFF$")


def sniff(head: bytes) -> bool:
    """Whether a file that starts so is OFF."""
    first = blanked(head, rb"#[^\r\n]*").split()[:1]
    return bool(first) and HEADER.match(first[0]) is not None


def read(data: bytes) -> FileContent:
    """Read OFF, with or without colours and normals; colours are kept on writing."""
    text = Text(blanked(data, rb"#[^\r\n]*") if b"#" in data else data)
    header = HEADER.match(text.word(0))
    token, extra = 0, 0
    if header:
        if header[4] or header[5]:
            text.fail(0, "OFF of other dimensions than 3 is not read")
        if text.word(1) == b"BINARY":
            text.fail(1, "binary OFF is not read")
        token = 1
        extra = 2 * bool(header[1]) + 4 * bool(header[2]) + 3 * bool(header[3])
    n_vertices, n_faces, _ = _counts(text, token)
    token += 3

    # Rows may hold more than they must (colours), so lines count where there is one for each
    # vertex; where the numbers flow on, the header says how many belong to a vertex.
    rows = text.rows
    row = int(np.searchsorted(rows, token))
    widths = np.diff(rows[row : row + n_vertices + 1])
    by_line = (
        rows[row] == token
        and len(widths) == n_vertices
        and (n_vertices == 0 or (widths[0] >= 3 and bool((widths == widths[0]).all())))
    )
    width = int(widths[0]) if by_line and n_vertices else 3 + extra
    n_left = len(text) - token - n_vertices * width
    if n_left < 0:
        found = (len(text) - token) // width
        text.fail(len(text), f"the header says {n_vertices} vertices, the file has {found}")
    points = text.numbers(token, token + n_vertices * width).reshape(n_vertices, width)[:, :3]
    slots = text.slots(
        token + width * np.arange(n_vertices, dtype=np.int64)[:, None] + np.arange(3)
    )
    token += n_vertices * width

    first = int(np.searchsorted(rows, token))
    if first < len(rows) and rows[first] == token and len(rows) - 1 - first == n_faces:
        firsts = rows[first:]
    else:
        firsts = _walk(text, token, n_faces)
    counts = text.numbers_at(firsts[:-1], np.int64)
    short = np.flatnonzero((np.diff(firsts) < counts + 1) | (counts < 1))
    if short.size:
        token = int(firsts[short[0]])
        text.fail(token, f"a face of {counts[short[0]]} corners does not fit on its line")

    blocks, places = [], []
    for i, j, table in text.tables(firsts[:-1], counts + 1, counts):
        kind = KINDS.get(int(counts[i]), f"polygon{counts[i]}")
        blocks.append((kind, np.ascontiguousarray(table[:, 1:])))
        places.append(text.starts[firsts[i:j]])
    extras = ["face colours"] if bool((np.diff(firsts) > counts + 1).any()) else []
    extras += ["vertex colours or normals"] if width > 3 else []
    extras += ["comments"] if b"#" in data else []
    return FileContent(
        np.ascontiguousarray(points), blocks, extras=tuple(extras), slots=slots, places=places
    )


def write(content: FileContent) -> bytes:
    """Write OFF."""
    n_faces = sum(len(content.blocks[b][1]) for b in content.faces)
    lines = ["OFF", f"{len(content.points)} {n_faces} 0", *rows_of(content.points_3d)]
    for cells, _ in content.of_type(*FACES):
        lines += rows_of(np.full(len(cells), cells.shape[1]), cells)
    return finish(lines)


def _counts(text: Text, token: int) -> IndexArray:
    """Vertices, faces and edges; refused where they cannot be true."""
    if token + 3 > len(text):
        raise MeshError("the file ends before the counts of vertices, faces and edges")
    counts = text.numbers(token, token + 3, np.int64)
    if counts.min() < 0:
        text.fail(token, f"counts are negative: {counts.tolist()}")
    if counts[:2].max() > len(text):
        text.fail(
            token,
            f"the header says {counts[0]} vertices and {counts[1]} faces, "
            f"the file has only {len(text) - token - 3} numbers",
        )
    return counts


def _walk(text: Text, token: int, n_faces: int) -> IndexArray:
    """First token of each face where faces have no lines of their own, hence no colours."""
    numbers = text.numbers(token, len(text)).tolist()
    firsts = [0]
    for _ in range(n_faces):
        if firsts[-1] >= len(numbers):
            text.fail(len(text), f"the header says {n_faces} faces, the file has {len(firsts) - 1}")
        firsts.append(firsts[-1] + 1 + int(numbers[firsts[-1]]))
        if firsts[-1] <= firsts[-2]:
            text.fail(token + firsts[-2], "a face has a negative number of corners")
    if firsts[-1] != len(numbers):
        text.fail(
            token + min(firsts[-1], len(numbers)),
            f"the header says {n_faces} faces, {len(numbers)} numbers follow the vertices, "
            f"the faces take {firsts[-1]}",
        )
    return token + np.array(firsts, dtype=np.int64)
