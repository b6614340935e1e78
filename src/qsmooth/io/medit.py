"""Medit: sections of vertices, edges, triangles, quadrilaterals, each with a reference."""

from __future__ import annotations

import re

import numpy as np

from qsmooth._types import IndexArray
from qsmooth.errors import MeshError
from qsmooth.io.file_content import Block, FileContent
from qsmooth.io.text import Cursor, blanked, finish, rows_of

NAME = "medit"
ENDINGS = (".mesh",)
PRIORITY = 1  # .mesh is MFEM's too
HOLDS = frozenset(("z", "line", "regions"))

CELLS = {
    "Edges": ("line", 2),
    "Triangles": ("triangle", 3),
    "Quadrilaterals": ("quad", 4),
    "Tetrahedra": ("tetra", 4),
    "Hexahedra": ("hexahedron", 8),
    "Hexaedra": ("hexahedron", 8),
    "Prisms": ("wedge", 6),
    "Pyramids": ("pyramid", 5),
    "EdgesP2": ("line3", 3),
    "TrianglesP2": ("triangle6", 6),
    "QuadrilateralsQ2": ("quad9", 9),
}
# Sections that are kept and not understood: name -> numbers of each entry.
OTHERS = {
    "Corners": 1,
    "RequiredVertices": 1,
    "Ridges": 1,
    "RequiredEdges": 1,
    "RequiredTriangles": 1,
    "RequiredQuadrilaterals": 1,
    "Normals": 3,
    "NormalAtVertices": 2,
    "Tangents": 3,
    "TangentAtVertices": 2,
    "NormalAtTriangleVertices": 3,
    "NormalAtQuadrilateralVertices": 3,
    "SubDomainFromMesh": 4,
    "SubDomainFromGeom": 4,
    "VertexOnGeometricVertex": 2,
    "VertexOnGeometricEdge": 3,
    "EdgeOnGeometricEdge": 2,
}


def sniff(head: bytes) -> bool:
    """Whether a file that starts so is Medit's."""
    words = blanked(head, rb"#[^\r\n]*").split(None, 1)[:1]
    return bool(words) and words[0] == b"MeshVersionFormatted"


def read(data: bytes) -> FileContent:
    """Read Medit; references become regions, all other sections are kept on writing."""
    cursor = Cursor(blanked(data, rb"#[^\r\n]*") if b"#" in data else data)
    cursor.word()
    if cursor.count("the version") not in (1, 2, 3, 4):
        cursor.fail("MeshVersionFormatted must be 1 to 4")
    dimension = 0
    points = slots = None
    blocks: list[Block] = []
    tags, places, others = [], [], []
    point_tags = np.zeros(0)
    while word := cursor.word():
        name = word.decode("latin-1")
        if name == "End":
            break
        if name == "Dimension":
            dimension = cursor.count("dimensions")
            if dimension not in (2, 3):
                cursor.fail(f"Dimension {dimension} must be 2 or 3")
        elif name == "Vertices":
            if not dimension:
                cursor.fail("Vertices before Dimension")
            n = cursor.count(name)
            token = cursor.token
            points, slots = cursor.points(n, dimension + 1, range(dimension))
            point_tags = cursor.text.numbers_at(
                token + dimension + (dimension + 1) * np.arange(n), np.int64
            )
        elif name in CELLS:
            kind, n_corners = CELLS[name]
            n = cursor.count(name)
            token = cursor.token
            table = cursor.numbers(n * (n_corners + 1), "i8", name).reshape(n, n_corners + 1)
            if n == 0:
                continue
            blocks.append((kind, table[:, :-1] - 1))
            tags.append(np.ascontiguousarray(table[:, -1]))
            places.append(cursor.text.starts[token + (n_corners + 1) * np.arange(n)])
        elif name in OTHERS:
            cursor.numbers(cursor.count(name) * OTHERS[name], "f8", name)
            others.append(name)
        else:
            cursor.fail(
                f"{name[:40]!r} is no section of Medit, or a section has more rows than it says"
            )
    if points is None:
        raise MeshError("the file has no section Vertices")
    return FileContent(
        points,
        blocks,
        tags,
        point_data={"medit:ref": point_tags} if point_tags.any() else {},
        cell_data={"medit:ref": list(tags)},
        extras=tuple(f"section {name}" for name in others) + _comments(data),
        slots=slots,
        places=places,
    )


def write(content: FileContent) -> bytes:
    """Write Medit, with the regions as references."""
    n, dimension = content.plain_points.shape
    lines = ["MeshVersionFormatted 2", f"Dimension {dimension}", "Vertices", str(n)]
    references = content.point_data.get("medit:ref", np.zeros(n))
    lines += rows_of(content.plain_points, np.asarray(references).astype(np.int64))
    for section in ("Edges", "Triangles", "Quadrilaterals"):
        kind = CELLS[section][0]
        parts = content.of_type(kind)
        if not parts:
            continue
        cells = np.concatenate([cells for cells, _ in parts])
        lines += [section, str(len(cells))]
        lines += rows_of(cells + 1, np.concatenate([_tags(*part) for part in parts]))
    return finish([*lines, "End"])


def _tags(cells: IndexArray, tags: IndexArray | None) -> IndexArray:
    return np.zeros(len(cells), np.int64) if tags is None else tags


def _comments(data: bytes) -> tuple[str, ...]:
    return ("comments",) if re.search(rb"#", data) else ()
