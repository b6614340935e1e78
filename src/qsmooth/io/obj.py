"""Wavefront OBJ: a letter says what each line holds."""

from __future__ import annotations

import re

import numpy as np

from qsmooth._types import IndexArray
from qsmooth.io.file_content import FACES, FileContent
from qsmooth.io.text import Text, blanked, finish, rows_of, runs

NAME = "obj"
ENDINGS = (".obj",)
HOLDS = frozenset(("z", "line", "vertex"))

KINDS = {1: "vertex", 2: "line", 3: "triangle", 4: "quad"}
# Statements that are kept as they are: they say nothing of the mesh itself.
OTHER = frozenset((b"vt", b"vn", b"vp", b"g", b"o", b"s", b"mg", b"usemtl", b"mtllib", b"usemap"))


def sniff(head: bytes) -> bool:
    """Whether a file that starts so is OBJ."""
    first = blanked(head, rb"#[^\r\n]*").split(None, 1)[:1]
    return bool(first) and (first[0] in OTHER or first[0] in (b"v", b"f"))


def read(data: bytes) -> FileContent:
    """Read OBJ; texture, normals, groups and materials are kept on writing."""
    clean = blanked(data, rb"#[^\r\n]*") if b"#" in data else data
    if b"\\" in clean:  # a line that goes on in the next one
        clean = blanked(clean, rb"\\[ \t]*\r?\n")
    if b"/" in clean:  # 7/1/3: vertex, texture, normal
        clean = blanked(clean, rb"(?<=\d)/[\d/-]*")
    text = Text(clean)
    rows = text.rows
    firsts, widths = rows[:-1], np.diff(rows)
    letters = np.frombuffer(clean, np.uint8)[text.starts[firsts]]
    alone = text.ends[firsts] - text.starts[firsts] == 1

    of_letter = {letter: alone & (letters == ord(letter)) for letter in "vflp"}
    known = of_letter["v"] | of_letter["f"] | of_letter["l"] | of_letter["p"]
    others = set()
    for row in np.flatnonzero(~known).tolist():
        word = text.word(int(firsts[row]))
        if word not in OTHER:
            text.fail(int(firsts[row]), f"{word[:40].decode('latin-1')!r} is no statement of OBJ")
        others.add(word.decode())

    vertex = of_letter["v"]
    short = np.flatnonzero(vertex & (widths < 4))
    if short.size:
        text.fail(int(firsts[short[0]]), "a vertex needs three coordinates")
    tokens = firsts[vertex][:, None] + 1 + np.arange(3)
    points = text.numbers_at(tokens.ravel()).reshape(-1, 3)
    # A negative number counts back from the vertices read so far.
    n_before = np.cumsum(vertex)

    blocks, places = [], []
    cell = of_letter["f"] | of_letter["l"] | of_letter["p"]
    numbers = np.flatnonzero(cell)
    short = numbers[widths[cell] < np.where(of_letter["f"][cell], 4, 2)]
    if short.size:
        text.fail(int(firsts[short[0]]), f"a cell with {widths[short[0]] - 1} vertices")
    lengths = widths[cell] - 1
    ends = np.cumsum(lengths)
    before = np.repeat(firsts[cell] + 1 - ends + lengths, lengths)
    ids = text.numbers_at(before + np.arange(len(before)), np.int64)
    if not ids.all():
        row = int(np.searchsorted(ends, np.argmax(ids == 0), side="right"))
        text.fail(int(firsts[numbers[row]]), "vertex 0: OBJ counts from 1")
    ids = np.where(ids > 0, ids - 1, np.repeat(n_before[numbers], lengths) + ids)
    all_places, begins = text.starts[firsts[numbers]], ends - lengths
    for i, j in runs(widths[cell] * 256 + letters[cell]):
        n_corners = int(lengths[i])
        letter = chr(letters[numbers[i]])
        cells, place = ids[begins[i] : ends[j - 1]].reshape(j - i, n_corners), all_places[i:j]
        kind = KINDS.get(n_corners) or f"polygon{n_corners}"
        if letter == "l" and n_corners > 2:  # a polyline: one line cell for each of its edges
            place = np.repeat(place, n_corners - 1)
            cells = np.stack((cells[:, :-1], cells[:, 1:]), axis=-1).reshape(-1, 2)
            kind = "line"
        elif letter == "p" and n_corners > 1:
            place, cells, kind = np.repeat(place, n_corners), cells.reshape(-1, 1), "vertex"
        blocks.append((kind, cells))
        places.append(place)
    extras = [f"OBJ statements {', '.join(sorted(others))}"] if others else []
    if bool((widths[vertex] > 4).any()):
        extras.append("vertex weights or colours")
    if b"/" in data and re.search(rb"^[ \t]*f[^#\n]*/", data, re.M):
        extras.append("texture and normal numbers of faces")
    extras += ["comments"] if b"#" in data else []
    return FileContent(
        points, blocks, extras=tuple(extras), slots=text.slots(tokens), places=places
    )


def write(content: FileContent) -> bytes:
    """Write OBJ."""
    lines = ["v " + row for row in rows_of(content.points_3d)]
    for letter, kinds in (("f ", FACES), ("l ", ("line",)), ("p ", ("vertex",))):
        for cells, _ in content.of_type(*kinds):
            lines += [letter + row for row in rows_of(_from_one(cells))]
    return finish(lines)


def _from_one(cells: IndexArray) -> IndexArray:
    return cells + 1
