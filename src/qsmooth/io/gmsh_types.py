"""Types of elements as Gmsh numbers them."""

from __future__ import annotations

from qsmooth.io.text import Cursor

# Element type -> (name, vertices), from Gmsh's manual; what is not first order in two dimensions
# is here only so that it can be refused by name.
TYPES = {
    1: ("line", 2),
    2: ("triangle", 3),
    3: ("quad", 4),
    4: ("tetra", 4),
    5: ("hexahedron", 8),
    6: ("wedge", 6),
    7: ("pyramid", 5),
    8: ("line3", 3),
    9: ("triangle6", 6),
    10: ("quad9", 9),
    11: ("tetra10", 10),
    12: ("hexahedron27", 27),
    13: ("wedge18", 18),
    14: ("pyramid14", 14),
    15: ("vertex", 1),
    16: ("quad8", 8),
    17: ("hexahedron20", 20),
    18: ("wedge15", 15),
    19: ("pyramid13", 13),
    20: ("triangle9", 9),
    21: ("triangle10", 10),
    23: ("triangle15", 15),
    26: ("line4", 4),
    27: ("line5", 5),
    36: ("quad16", 16),
    37: ("quad25", 25),
}
CODES = {"vertex": 15, "line": 1, "triangle": 2, "quad": 3}
DIMENSIONS = {"vertex": 0, "line": 1, "triangle": 2, "quad": 2}


def type_of(cursor: Cursor, code: int, token: int | None = None) -> tuple[str, int]:
    """Name and vertices of a type; a MeshError at that token, or where the cursor stands."""
    if code not in TYPES:
        if token is not None:
            cursor.text.fail(token, f"element type {code} is unknown")
        cursor.fail(f"element type {code} is unknown")
    return TYPES[code]
