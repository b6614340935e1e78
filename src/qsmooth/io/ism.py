"""HOHQMesh ISM, ISM-V2 and ISM-MM: quads, whose sides may have names and curves."""

from __future__ import annotations

import re

import numpy as np

from qsmooth._types import IndexArray
from qsmooth.io.file_content import FileContent
from qsmooth.io.hohq import CurvesStay, read_quads
from qsmooth.io.in_place import InPlace
from qsmooth.io.sides import sides_of_lines
from qsmooth.io.text import Cursor, finish, positions, rows_of

NAME = "ism"
ENDINGS = (".mesh",)
HOLDS = frozenset(("z", "line", "regions", "names"))
ONLY = "quad"

VERSIONS = (b"ISM", b"ISM-V2", b"ISM-MM")
# The first form has no name: three counts; x, y and z, of which no label could be written so.
START = re.compile(
    rb"\s*\d+[ \t]+\d+[ \t]+\d+[ \t]*[\r\n]\s*"
    rb"[-+.\dEeDd]+[ \t]+[-+.\dEeDd]+[ \t]+[-+\d]*[.EeDd][-+.\dEeDd]*[ \t]*[\r\n]"
)


def sniff(head: bytes) -> bool:
    """Whether a file that starts so is HOHQMesh's."""
    return head.split(None, 1)[:1] in [[word] for word in VERSIONS] or START.match(head) is not None


def read(data: bytes) -> FileContent:
    """Read ISM; materials become regions, sides with a name or a curve line cells."""
    cursor = Cursor(data)
    version = VERSIONS[0]
    if not cursor.text.word(0).isdigit():
        version = cursor.word()
        if version not in VERSIONS:
            cursor.fail("ISM, ISM-V2 or ISM-MM must come first")
    n = cursor.count("nodes")
    n_edges = 0 if version == VERSIONS[0] else cursor.count("edges")
    n_elements, order = cursor.count("elements"), cursor.count("the order")
    points, slots = cursor.points(n, 3)
    text, rows = cursor.text, cursor.text.rows
    row = int(np.searchsorted(rows, cursor.token))
    # HOHQMesh counts edges of ISM-MM and does not write them.
    if n_edges and row + 1 < len(rows) and rows[row + 1] - rows[row] == 6:
        cursor.numbers(6 * n_edges, "i8", "edges")
    n_heads = 5 if version == b"ISM-MM" else 4
    quads = read_quads(text, cursor.token, len(text), order, n_heads)
    if len(quads.corners) != n_elements:
        cursor.fail(f"{n_elements} elements expected, the file has {len(quads.corners)}")
    ids = np.arange(1, n + 1)
    tags, names = np.zeros(n_elements, np.int64), dict(quads.names)
    if n_heads == 5:
        words = [text.word(token) for token in (quads.first_tokens + 4).tolist()]
        numbers = {word: k for k, word in enumerate(dict.fromkeys(words), start=1)}
        tags = np.array([numbers[word] for word in words], dtype=np.int64)
        names |= {word.decode("utf-8", "replace"): (k, 2) for word, k in numbers.items()}
    blocks = [("quad", positions(ids, quads.corners))]
    parts, places = [tags], [text.starts[quads.first_tokens]]
    if len(quads.lines):
        blocks.append(("line", positions(ids, quads.lines)))
        parts.append(quads.tags)
        places.append(quads.places)
    ends = np.unique(quads.lines[quads.curved]) - 1
    where: InPlace = CurvesStay(slots, ends) if ends.size else slots
    return FileContent(
        points,
        blocks,
        parts,
        names,
        extras=("curved sides",) if ends.size else (),
        notes=quads.notes(),
        slots=where,
        places=places,
    )


def write(content: FileContent) -> bytes:
    """Write ISM-V2, or ISM-MM where there are regions; all sides are straight."""
    parts = content.of_type("quad")
    cells = np.concatenate([cells for cells, _ in parts])
    tags = np.concatenate([np.zeros(len(c), np.int64) if t is None else t for c, t in parts])
    has_materials = len(np.unique(tags)) > 1
    edges = _edges(cells)
    n = len(content.points)
    out = ["ISM-MM" if has_materials else "ISM-V2", f"{n} {len(edges)} {len(cells)} 1"]
    out += rows_of(content.points_3d)
    heads = rows_of(cells + 1)
    if has_materials:
        names = {tag: _word(name) for name, (tag, dim) in content.names.items() if dim == 2}
        heads = [
            f"{head} {names.get(tag, f'region_{tag}')}"
            for head, tag in zip(heads, tags.tolist(), strict=True)
        ]
    else:
        out += rows_of(edges)
    sides = np.full((len(cells), 4), "---", dtype=object)
    lines, markers = content.lines
    names = {tag: _word(name) for name, (tag, dim) in content.names.items() if dim == 1}
    cell, side, _ = sides_of_lines([cells], lines)
    for c, k, tag in zip(cell.tolist(), side.tolist(), markers.tolist(), strict=True):
        sides[c, k] = names.get(tag, f"line_{tag}")
    for head, of_cell in zip(heads, sides.tolist(), strict=True):
        out += [head, "0 0 0 0", " ".join(of_cell)]
    return finish(out)


def _word(name: str) -> str:
    """A name that is read as one word, and not as none."""
    word = "_".join(name.split())
    return word if word.strip("-") else f"_{word}"


def _edges(cells: IndexArray) -> IndexArray:
    """Each edge once: its ends, its elements and the sides it is of them, all from 1.

    Sides go from corner 1 to 2, 2 to 3, 4 to 3 and 1 to 4; that of the second element is negative
    where it goes the other way. A boundary edge has 0 for the second.
    """
    ends = np.stack([cells[:, [0, 1, 3, 0]], cells[:, [1, 2, 2, 3]]], axis=2).reshape(-1, 2)
    element = np.repeat(np.arange(1, len(cells) + 1), 4)
    side = np.tile(np.arange(1, 5), len(cells))
    keys = ends.min(axis=1) * (int(ends.max()) + 1) + ends.max(axis=1)
    _, first, place, counts = np.unique(
        keys, return_index=True, return_inverse=True, return_counts=True
    )
    second = np.full(len(first), -1, np.int64)
    later = np.flatnonzero(first[place] != np.arange(len(keys)))
    second[place[later]] = later
    turned = ends[second, 0] != ends[first, 0]
    sides = np.where(counts > 1, np.where(turned, -side[second], side[second]), 0)
    others = np.where(counts > 1, element[second], 0)
    edges = np.column_stack([ends[first] + 1, element[first], others, side[first], sides])
    ordered: IndexArray = edges[np.argsort(first, kind="stable")]
    return ordered
