"""MIKE 21/3 flexible mesh: nodes with a bed level and a code, elements of three or four nodes."""

from __future__ import annotations

import re

import numpy as np

from qsmooth._types import IndexArray
from qsmooth.io.chains import boundary_edges
from qsmooth.io.file_content import Block, FileContent
from qsmooth.io.text import Text, blocks_by_id, finish, integers, rows_of, runs

NAME = "mike"
ENDINGS = (".mesh",)
HOLDS = frozenset(("level", "geographic"))

# EUM numbers, item and unit, in the newer header; the number of nodes; the projection.
HEADER = re.compile(rb"\s*(?:\d+[ \t]+\d+[ \t]+)?(\d+)[ \t]+([^\s\d][^\r\n]*?)[ \t]*(?:[\r\n]|$)")
NODE = re.compile(rb"\s*\d+(?:[ \t]+[-+.\deE]+){3}[ \t]+\d+\s")
TRIANGLES, MIXED = 21, 25
CODES = "mike:code"
LAND = 1
# What MIKE calls coordinates in no projection; EUM's bathymetry in metres.
LOCAL, BATHYMETRY, METRES = "NON-UTM", 100079, 1000
LON_LAT = "LONG/LAT"


def sniff(head: bytes) -> bool:
    """Whether a file that starts so is MIKE's."""
    header = HEADER.match(head)
    return header is not None and NODE.match(head, header.end()) is not None


def read(data: bytes) -> FileContent:
    """Read MIKE; bed levels become z, codes data of points."""
    header = HEADER.match(data)
    if header is None:
        Text(data).fail(0, "the first line must have the number of nodes and the projection")
    text = Text(b" " * header.end() + data[header.end() :])
    rows, n_points = text.rows, int(header[1])
    if n_points > len(rows) - 2:
        text.fail(0, f"the header says {n_points} nodes, {len(rows) - 1} lines follow")
    firsts = rows[:n_points]
    odd = np.flatnonzero(np.diff(rows[: n_points + 1]) != 5)
    if odd.size:
        text.fail(
            int(firsts[odd[0]]), f"node {odd[0] + 1} of {n_points} needs an id, x, y, z, code"
        )
    table = text.numbers(int(rows[0]), int(rows[n_points])).reshape(-1, 5)
    codes = integers(table[:, 4], "code")
    blocks, places = _elements(text, rows[n_points:])
    projection = header[2].decode("latin-1").strip('"')
    return FileContent(
        np.ascontiguousarray(table[:, 1:4]),
        blocks_by_id(integers(table[:, 0], "node"), blocks),
        point_data={CODES: codes},
        extras=() if projection.upper() in (LOCAL, LON_LAT) else (f"projection {projection}",),
        geographic=_is_geographic(projection),
        z_means="height",
        slots=text.slots(firsts[:, None] + np.arange(1, 4)),
        places=places,
    )


def _is_geographic(projection: str) -> bool:
    return projection.upper().startswith((LON_LAT, "GEOGCS"))


def _elements(text: Text, rows: IndexArray) -> tuple[list[Block], list[IndexArray]]:
    """Cells by the ids of their nodes, and where they stand; triangles may end with a 0."""
    n_cells, n_most, kind = text.numbers(int(rows[0]), int(rows[0]) + 3, np.int64).tolist()
    if rows[1] - rows[0] != 3 or kind not in (TRIANGLES, MIXED) or n_most not in (3, 4):
        text.fail(
            int(rows[0]),
            "number of elements, most nodes of one (3 or 4) and type (21 or 25) expected",
        )
    if n_cells != len(rows) - 2:
        text.fail(int(rows[0]), f"the header says {n_cells} elements, {len(rows) - 2} lines follow")
    firsts, widths = rows[1:-1], np.diff(rows[1:])
    odd = np.flatnonzero((widths < 4) | (widths > n_most + 1))
    if odd.size:
        text.fail(int(firsts[odd[0]]), f"an element needs an id and 3 to {n_most} nodes")
    values = np.append(text.numbers(int(rows[1]), int(rows[-1]), np.int64), 0)
    begins = firsts - rows[1]
    fourth = np.where(widths == 5, values[np.minimum(begins + 4, len(values) - 1)], 0)
    corners = np.where(fourth != 0, 4, 3)
    blocks: list[Block] = []
    places = []
    for i, j in runs(corners):
        n_corners = int(corners[i])
        cells = values[begins[i:j, None] + np.arange(1, n_corners + 1)]
        blocks.append(("triangle" if n_corners == 3 else "quad", cells))
        places.append(text.starts[firsts[i:j]])
    return blocks, places


def write(content: FileContent) -> bytes:
    """Write MIKE with its newer header; where there are no codes, the boundary is land."""
    n = len(content.points)
    codes = np.zeros(n, np.int64)
    codes[boundary_edges(content).ravel()] = LAND
    others = dict(content.point_data)
    codes = np.asarray(others.pop(CODES, codes)).astype(np.int64)
    content.point_data = others  # what is lost
    xyz = np.column_stack((content.points[:, :2], content.z("height")))
    projection = LON_LAT if content.geographic else LOCAL
    lines = [f"{BATHYMETRY} {METRES} {n} {projection}"]
    lines += rows_of(np.arange(1, n + 1), xyz, codes)
    faces = [cells for cells, _ in content.counter_clockwise()]
    n_most = max(cells.shape[1] for cells in faces)
    kind = TRIANGLES if n_most == 3 else MIXED
    lines.append(f"{sum(map(len, faces))} {n_most} {kind}")
    first = 1
    for cells in faces:
        # Triangles among quads end with a 0, as MIKE's own tools write them.
        padded = np.pad(cells + 1, ((0, 0), (0, n_most - cells.shape[1])))
        lines += rows_of(np.arange(first, first + len(cells)), padded)
        first += len(cells)
    return finish(lines)
