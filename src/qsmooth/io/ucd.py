"""AVS UCD: counts, then a line for each node and each cell."""

from __future__ import annotations

import numpy as np

from qsmooth.errors import MeshError
from qsmooth.io.file_content import N_VERTICES, FileContent
from qsmooth.io.text import Text, blanked, blocks_by_id, finish, integers, rows_of

NAME = "ucd"
ENDINGS = (".inp", ".avs", ".ucd")
REPLACES = ("avsucd",)
HOLDS = frozenset(("z", "vertex", "line", "regions"))

TYPES = {
    b"pt": ("vertex", 1),
    b"line": ("line", 2),
    b"tri": ("triangle", 3),
    b"quad": ("quad", 4),
    b"tet": ("tetra", 4),
    b"pyr": ("pyramid", 5),
    b"prism": ("wedge", 6),
    b"hex": ("hexahedron", 8),
    b"line3": ("line3", 3),
    b"tri6": ("triangle6", 6),
    b"quad8": ("quad8", 8),
}
WORDS = {"vertex": "pt", "line": "line", "triangle": "tri", "quad": "quad"}


def sniff(head: bytes) -> bool:
    """Whether a file that starts so is UCD."""
    for line in blanked(head, rb"(?m)^[ \t]*#[^\r\n]*").splitlines():
        if words := line.split():
            return len(words) == 5 and all(word.isdigit() for word in words)
    return False


def read(data: bytes) -> FileContent:
    """Read UCD; material ids become regions, the data after the cells is kept on writing."""
    text = Text(blanked(data, rb"#[^\r\n]*") if b"#" in data else data)
    if len(text) < 5:
        raise MeshError("the file ends before the five counts of its header")
    counts = text.numbers(0, 5, np.int64)
    n_points, n_cells, n_data = int(counts[0]), int(counts[1]), int(counts[2:4].sum())
    rows = text.rows
    if counts.min() < 0 or n_points + n_cells > len(rows) - 2:
        text.fail(
            0 if counts.min() < 0 else len(text),
            f"the header says {n_points} nodes and {n_cells} cells, {len(rows) - 2} lines follow",
        )
    firsts = rows[1 : n_points + 2]
    odd = np.flatnonzero(np.diff(firsts) != 4)
    if odd.size:
        text.fail(int(firsts[odd[0]]), f"node {odd[0] + 1} of {n_points} needs an id, x, y and z")
    table = text.numbers(int(firsts[0]), int(firsts[-1])).reshape(-1, 4)
    ids = integers(table[:, 0], "node")
    slots = text.slots(firsts[:-1, None] + np.arange(1, 4))

    firsts = rows[n_points + 1 : n_points + n_cells + 2]
    widths = np.diff(firsts)
    if n_cells and widths.min() < 4:
        cell = int(np.argmin(widths))
        text.fail(int(firsts[cell]), f"cell {cell + 1} of {n_cells}: id, material, type, nodes")
    words = [text.word(token) for token in (firsts[:-1] + 2).tolist()]
    numbers = {word: number for number, word in enumerate(dict.fromkeys(words))}
    codes = np.array([numbers[word] for word in words], dtype=np.int64)
    blocks, tags, places = [], [], []
    for word, code in numbers.items():
        rows_of_code = np.flatnonzero(codes == code)
        if word not in TYPES:
            shown = word[:20].decode("latin-1")
            text.fail(int(firsts[rows_of_code[0]]), f"cell type {shown!r} is unknown")
        kind, n_corners = TYPES[word]
        odd = rows_of_code[widths[rows_of_code] != 3 + n_corners]
        if odd.size:
            text.fail(int(firsts[odd[0]]), f"a {kind} has {n_corners} nodes")
    materials = text.numbers_at(firsts[:-1] + 1, np.int64)
    for i, j, nodes in text.tables(firsts[:-1] + 3, widths - 3, codes):
        blocks.append((TYPES[words[i]][0], nodes))
        tags.append(materials[i:j])
        places.append(text.starts[firsts[i:j]])
    n_left = len(rows) - 2 - n_points - n_cells
    if n_left and not n_data:
        text.fail(
            int(rows[n_points + n_cells + 1]),
            f"{n_left} lines after the {n_points} nodes and {n_cells} cells of the header",
        )
    extras = [] if not n_data else ["node and cell data of the UCD file"]
    extras += ["comments"] if b"#" in data else []
    return FileContent(
        np.ascontiguousarray(table[:, 1:]),
        blocks_by_id(ids, blocks),
        tags,
        cell_data={"avsucd:material": list(tags)},
        extras=tuple(extras),
        slots=slots,
        places=places,
    )


def write(content: FileContent) -> bytes:
    """Write UCD, with the regions as materials."""
    blocks = [b for b, (kind, _) in enumerate(content.blocks) if kind in N_VERTICES]
    n_points = len(content.points)
    lines = [f"{n_points} {sum(len(content.blocks[b][1]) for b in blocks)} 0 0 0"]
    lines += rows_of(np.arange(1, n_points + 1), content.points_3d)
    first = 1
    for b in blocks:
        kind, cells = content.blocks[b]
        tags = np.zeros(len(cells), np.int64) if content.tags is None else content.tags[b]
        heads = rows_of(np.arange(first, first + len(cells)), tags)
        corners = rows_of(cells + 1)
        lines += [f"{h} {WORDS[kind]} {c}" for h, c in zip(heads, corners, strict=True)]
        first += len(cells)
    return finish(lines)
