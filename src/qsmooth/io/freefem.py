"""FreeFEM .msh: vertices, triangles and boundary edges, each with a label."""

from __future__ import annotations

import re

import numpy as np

from qsmooth.errors import MeshError
from qsmooth.io.file_content import FileContent
from qsmooth.io.text import Text, finish, rows_of

NAME = "freefem"
ENDINGS = (".msh",)
HOLDS = frozenset(("line", "regions"))
ONLY = "triangle"

# Three counts; x, y and a label.
START = re.compile(
    rb"\s*\d+[ \t]+\d+[ \t]+\d+[ \t]*[\r\n]"
    rb"\s*[^\s$#]+[ \t]+[^\s$#]+[ \t]+[+-]?\d+[ \t]*[\r\n]"
)
LABELS = "medit:ref"  # of vertices; the two programs share their meshes


def sniff(head: bytes) -> bool:
    """Whether a file that starts so is FreeFEM's."""
    return START.match(head) is not None


def read(data: bytes) -> FileContent:
    """Read FreeFEM; the labels of triangles become regions, edges line cells."""
    text = Text(data)
    if len(text) < 3:
        raise MeshError("the file ends before the counts of vertices, triangles and edges")
    counts = text.numbers(0, 3, np.int64)
    n, n_triangles, n_edges = counts.tolist()
    wanted = 3 + 3 * n + 4 * n_triangles + 3 * n_edges
    if counts.min() < 0 or wanted != len(text):
        text.fail(
            0,
            f"{n} vertices, {n_triangles} triangles and {n_edges} edges take {wanted} numbers, "
            f"the file has {len(text)}",
        )
    token = 3
    tokens = token + 3 * np.arange(n)[:, None] + np.arange(2)
    table = text.numbers(token, token + 3 * n).reshape(n, 3)
    labels = text.numbers_at(token + 2 + 3 * np.arange(n), np.int64)
    token += 3 * n
    blocks, tags, places = [], [], []
    for kind, size, count in (("triangle", 3, n_triangles), ("line", 2, n_edges)):
        width = size + 1
        rows = text.numbers(token, token + width * count, np.int64).reshape(count, width)
        if count:
            blocks.append((kind, rows[:, :-1] - 1))
            tags.append(np.ascontiguousarray(rows[:, -1]))
            places.append(text.starts[token + width * np.arange(count)])
        token += width * count
    return FileContent(
        np.ascontiguousarray(table[:, :2]),
        blocks,
        tags,
        point_data={LABELS: labels} if labels.any() else {},
        slots=text.slots(tokens),
        places=places,
    )


def write(content: FileContent) -> bytes:
    """Write FreeFEM; a vertex has its own label, or that of an edge on it."""
    triangles = content.of_type("triangle")
    lines, markers = content.lines
    n, n_triangles = len(content.points), sum(len(cells) for cells, _ in triangles)
    labels = np.zeros(n, np.int64)
    labels[lines] = markers[:, None]
    if LABELS in content.point_data:
        labels = np.asarray(content.point_data[LABELS]).astype(np.int64)
    out = [f"{n} {n_triangles} {len(lines)}", *rows_of(content.points[:, :2], labels)]
    for cells, tags in triangles:
        out += rows_of(cells + 1, np.zeros(len(cells), np.int64) if tags is None else tags)
    return finish([*out, *rows_of(lines + 1, markers)])
