"""What may move, where to, and how far: the caller's word on the vertices."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

from qsmooth.options import Options, opaque, option
from qsmooth.selection import parse_selection


@dataclass(frozen=True, kw_only=True)
class Constraints(Options):
    """What may move, where to, and how far; the fields are keywords of `smooth`, too."""

    owner = "constraints"

    selection: Any = opaque(
        None,
        metavar="CELLS",
        parse=parse_selection,
        help="Cells whose vertices may move: ids, as in 3,7,12 (in Python also a mask), or a "
        "threshold on a metric, as in 'max_angle > 150'.",
    )
    selection_rings: int = option(
        0, within="[0, inf)", help="How often the selection grows by the cells that touch it."
    )
    fixed: Any = opaque(
        None,
        metavar="VERTICES",
        help="Vertices that stay besides those that do anyway: ids or a mask.",
    )
    boundary: Literal["fixed", "slide"] = option(
        "fixed", help="Whether boundary vertices stay, or slide along the boundary."
    )
    interfaces: Literal["fixed", "slide"] = option(
        "fixed", help="Whether vertices on lines between regions stay, or slide along these."
    )
    keep_interfaces: bool = option(
        True, help="Whether vertices on lines between regions, and on line cells, stay."
    )
    corner_angle: float = option(
        20.0,
        within="[0, 180]",
        unit="degrees",
        help="Sliding vertices where the outline turns by more than this are corners, and stay.",
    )
    outline_tolerance: float = option(
        0.01,
        within="[0, 1)",
        help="How far sliding may take the outline from where it was, as a share of the local "
        "edge.",
    )
    curve: Any = opaque(
        None,
        metavar="FILE",
        help="What sliding vertices slide along instead of the mesh's own outline: a finer "
        "polyline (in Python also a function that projects places onto a curve).",
    )
    max_move: float | None = option(
        None, within="(0, inf)", help="How far a vertex may come from where it was, a length."
    )
    max_move_share: float | None = option(
        None,
        within="(0, inf)",
        help="How far a vertex may come from where it was, as a share of its shortest edge there.",
    )
    directions: Any = opaque(
        None,
        metavar="DIRECTIONS",
        help="Directions along which alone vertices may move, (n_vertices, 2), NaN for free.",
    )
