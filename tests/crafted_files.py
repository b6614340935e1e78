"""Files of at most a megabyte that are made on purpose to take long: nothing but sections."""

from format_samples import ADCIRC, SMS

SQUARE = "*NODE\n1,0,0\n2,1,0\n3,1,1\n4,0,1\n*ELEMENT,TYPE=S4\n1,1,2,3,4\n"
MSH = (
    "$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$Nodes\n4\n1 0 0 0\n2 1 0 0\n3 1 1 0\n4 0 1 0\n"
    "$EndNodes\n$Elements\n1\n1 3 0 1 2 3 4\n$EndElements\n"
)
ONE = "NDIME= 2\nNPOIN= 4\n0 0\n1 0\n1 1\n0 1\nNELEM= 1\n9 0 1 2 3\n"
CORNERS = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf 1 2 3 4\n"


def properties(n: int) -> str:
    head = "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\n"
    head += "".join(f"property float {k:x}\n" for k in range(n))
    head += "element face 1\nproperty list uchar int vertex_indices\nend_header\n"
    return (
        head + "".join(f"{xy} {n * '0 '}\n" for xy in ("0 0", "1 0", "1 1", "0 1")) + "4 0 1 2 3\n"
    )


def one_cell_blocks() -> str:
    n = 44_000
    lines = "".join(f"1 {k} 1 1\n{k} 1 2\n" for k in range(1, n))
    return (
        "$MeshFormat\n4.1 0 8\n$EndMeshFormat\n$Nodes\n1 4 1 4\n2 1 0 4\n1\n2\n3\n4\n"
        "0 0 0\n1 0 0\n1 1 0\n0 1 0\n$EndNodes\n"
        f"$Elements\n{n} {n} 1 {n}\n{lines}2 1 3 1\n{n} 1 2 3 4\n$EndElements\n"
    )


# As many sections, or columns, as a file of a megabyte has room for.
SECTIONS = {
    "keywords.inp": lambda: SQUARE + 349_000 * "*A\n",
    "continued.inp": lambda: SQUARE + 260_000 * "*A,\n",
    "goes_on.inp": lambda: f"{SQUARE}*A,\n" + 340_000 * "b,\n",
    "elsets.inp": lambda: SQUARE + "".join(f"*ELSET,ELSET=A{k}\n1\n" for k in range(48_000)),
    "nodes.inp": lambda: SQUARE + "".join(f"*NODE\n{k + 5},0,0\n" for k in range(66_000)),
    "sections.msh": lambda: MSH + "".join(f"$A{k}\n$EndA{k}\n" for k in range(56_000)),
    "ends.msh": lambda: f"{MSH}$A\n{170_000 * 'x$EndA'}\n$EndA\n",
    "markers.su2": lambda: ONE + 49_000 * "MARKER_ELEMS=1\n3 0 1\n",
    "blocks.msh": one_cell_blocks,
    "points.obj": lambda: CORNERS + 104_000 * "p 1\nl 1 2\n",
    "columns.ply": lambda: properties(36_000),
}

MANY = {
    "strings.2dm": lambda: SMS + 150_000 * "NS -5\n",
    "sections.14": lambda: (
        ADCIRC.replace("1 = Number of land", "200001 = Number of land") + 200_000 * "0 20\n"
    ),
    "weirs.14": lambda: (
        ADCIRC.replace("1 = Number of land", "80001 = Number of land") + 80_000 * "1 24\n5 15\n"
    ),
}


def one_card_an_element() -> str:
    n = 9000
    nodes = "".join(f"{2 * i + k + 1}, {i}, {k}\n" for i in range(n + 1) for k in (0, 1))
    faces = (f"{k + 1}, {2 * k + 1}, {2 * k + 3}, {2 * k + 4}, {2 * k + 2}\n" for k in range(n))
    cards = (f"*ELEMENT, TYPE=CPS4, ELSET=e{k}\n{face}" for k, face in enumerate(faces))
    return f"*NODE\n{nodes}{''.join(cards)}"
