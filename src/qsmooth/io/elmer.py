"""Elmer: a folder with the files mesh.header, mesh.nodes, mesh.elements and mesh.boundary."""

from __future__ import annotations

import contextlib
import re
from collections.abc import Iterator, Mapping

import numpy as np

from qsmooth._types import IndexArray
from qsmooth.errors import MeshError
from qsmooth.io.file_content import FACES, FileContent
from qsmooth.io.sides import sides_of_lines
from qsmooth.io.text import Text, blocks_by_id, finish, integers, rows_of

NAME = "elmer"
FILES = ("mesh.header", "mesh.nodes", "mesh.elements", "mesh.boundary")
OPTIONAL = ("mesh.names",)
POINTS = "mesh.nodes"
HOLDS = frozenset(("z", "vertex", "line", "regions", "names"))

# Type of an element: hundreds say its shape, the rest its nodes.
SHAPES = {
    1: ("vertex", 1),
    2: ("line", 2),
    3: ("triangle", 3),
    4: ("quad", 4),
    5: ("tetra", 4),
    6: ("pyramid", 5),
    7: ("wedge", 6),
    8: ("hexahedron", 8),
}
CODES = {"vertex": 101, "line": 202, "triangle": 303, "quad": 404}
NAMED = re.compile(r"\$\s*(.*?)\s*=\s*(\d{1,9})\s*$")


def read_files(files: Mapping[str, bytes]) -> FileContent:
    """Read the files of a folder; bodies become regions, boundaries line cells."""
    with _named("mesh.header"):
        header = Text(files["mesh.header"])
        n_nodes, n_elements, n_sides = header.numbers(0, 3, np.int64).tolist()
    with _named("mesh.nodes"):
        text = Text(files["mesh.nodes"])
        if len(text) != 5 * n_nodes:
            text.fail(
                len(text),
                f"{n_nodes} nodes of the header take {5 * n_nodes} numbers, here are {len(text)}",
            )
        table = text.numbers(0, len(text)).reshape(n_nodes, 5)
        ids = integers(table[:, 0], "node")
        slots = text.slots(5 * np.arange(n_nodes)[:, None] + np.arange(2, 5))
    cells: list[tuple[str, IndexArray]] = []
    tags: list[IndexArray] = []
    for name, count, n_heads in (("mesh.elements", n_elements, 3), ("mesh.boundary", n_sides, 5)):
        with _named(name):
            for kind, corners, numbers in _rows(Text(files[name]), count, n_heads):
                cells.append((kind, corners))
                tags.append(numbers)
    read = [kind in CODES for kind, _ in cells]
    found = iter(blocks_by_id(ids, [c for c, r in zip(cells, read, strict=True) if r]))
    blocks = [
        next(found) if r else (c[0], np.zeros_like(c[1])) for c, r in zip(cells, read, strict=True)
    ]
    names = _names(files["mesh.names"]) if "mesh.names" in files else {}
    return FileContent(np.ascontiguousarray(table[:, 2:]), blocks, tags, names, slots=slots)


def _rows(text: Text, n: int, n_heads: int) -> Iterator[tuple[str, IndexArray, IndexArray]]:
    """Type, nodes and tags of each run of elements: id, tag, perhaps parents, type, nodes."""
    rows = text.rows
    if len(rows) - 1 != n:
        text.fail(len(text), f"the header says {n} lines, the file has {len(rows) - 1}")
    widths = np.diff(rows)
    if n and widths.min() <= n_heads:
        text.fail(int(rows[np.argmin(widths)]), f"an element takes more than {n_heads} numbers")
    codes = text.numbers_at(rows[:-1] + n_heads - 1, np.int64)
    odd = np.flatnonzero((codes % 100 != widths - n_heads) | ~np.isin(codes // 100, list(SHAPES)))
    if odd.size:
        row = int(odd[0])
        text.fail(
            int(rows[row]),
            f"an element of type {codes[row]} with {widths[row] - n_heads} nodes is not known",
        )
    for i, _, table in text.tables(rows[:-1], widths, codes):
        shape, size = SHAPES[int(codes[i]) // 100]
        kind = shape if codes[i] % 100 == size else f"{shape}{codes[i] % 100}"
        yield kind, np.ascontiguousarray(table[:, n_heads:]), np.ascontiguousarray(table[:, 1])


def _names(data: bytes) -> dict[str, tuple[int, int]]:
    """Names of bodies and, behind the comment that says so, of boundaries."""
    names: dict[str, tuple[int, int]] = {}
    dimension = 2
    for line in data.decode("utf-8", "replace").splitlines():
        if line.lstrip().startswith("!"):
            dimension = 1 if "boundar" in line.lower() else 2
        elif match := NAMED.match(line.strip()):
            name = match[1] if match[1] not in names else f"{match[1]}_{match[2]}"
            names[name] = (int(match[2]), dimension)
    return names


@contextlib.contextmanager
def _named(file: str) -> Iterator[None]:
    try:
        yield
    except MeshError as error:
        raise MeshError(f"{file}, {error}") from error.__cause__


def write_files(content: FileContent) -> dict[str, bytes]:
    """Write the files of a folder; Elmer's ids count from 1, so that lower ones are all raised."""
    n = len(content.points)
    faces, points = content.of_type(*FACES), content.of_type("vertex")
    lines, markers = content.lines
    elements, n_elements = [], 0
    raised = _raised([tags for _, tags in faces if tags is not None])
    for cells, tags in faces:
        bodies = np.ones(len(cells), np.int64) if tags is None else tags + raised
        elements += rows_of(
            n_elements + 1 + np.arange(len(cells)),
            bodies,
            np.full(len(cells), 303 if cells.shape[1] == 3 else 404),
            cells + 1,
        )
        n_elements += len(cells)
    cell, _, other = sides_of_lines([cells for cells, _ in faces], lines)
    raised_sides = _raised([markers, *(tags for _, tags in points if tags is not None)])
    sides = [(lines, markers, cell + 1, other + 1)]
    for cells, tags in points:
        none = np.zeros(len(cells), np.int64)
        sides.append((cells, none if tags is None else tags, none, none))
    boundary: list[str] = []
    for cells, tags, left, right in sides:
        numbers = len(boundary) + 1 + np.arange(len(cells))
        codes = np.full(len(cells), 101 * cells.shape[1])
        boundary += rows_of(numbers, tags + raised_sides, left, right, codes, cells + 1)
    nodes = rows_of(np.arange(1, n + 1), np.full(n, -1), content.points_3d)
    files = {
        "mesh.header": finish(_header(content, n, n_elements, len(boundary))),
        "mesh.nodes": finish(nodes),
        "mesh.elements": finish(elements),
        "mesh.boundary": finish(boundary) if boundary else b"",
    }
    if content.names:
        out = []
        for what, dim, shift in (("bodies", 2, raised), ("boundaries", 1, raised_sides)):
            out.append(f"! ----- names for {what} -----")
            out += [
                f"$ {'_'.join(name.split())} = {tag + shift}"
                for name, (tag, dimension) in content.names.items()
                if dimension == dim
            ]
        files["mesh.names"] = finish(out)
    return files


def _raised(tags: list[IndexArray]) -> int:
    """What is added to tags so that the lowest is 1, where it is lower."""
    lowest = min((int(t.min()) for t in tags if len(t)), default=1)
    return max(0, 1 - lowest)


def _header(content: FileContent, n: int, n_elements: int, n_sides: int) -> list[str]:
    counts = {
        code: sum(len(cells) for cells, _ in content.of_type(kind)) for kind, code in CODES.items()
    }
    types = [f"{code} {count}" for code, count in counts.items() if count]
    return [f"{n} {n_elements} {n_sides}", str(len(types)), *types]
