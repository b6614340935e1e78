"""Control files beside grids of ADCIRC and SCHISM, which say whether coordinates are degrees."""

from __future__ import annotations

import re
from pathlib import Path

# ICS of ADCIRC: longitudes and latitudes, in the projection that it computes in.
SPHERICAL = frozenset((2, *range(20, 25)))
ICS_LINE = 6  # RUNDES, RUNID, NFOVER, NABOUT, NSCREEN and IHOT come first
# SCHISM's ICS, an entry of a Fortran namelist.
ICS = re.compile(rb"(?im)(?:^|,)[ \t]*ics[ \t]*=[ \t]*(\d+)")
SCHISM, LON_LAT = ("param.nml", "param.in"), ".ll"
MOST = 1 << 20  # bytes that are looked at


def in_degrees(path: Path) -> bool | None:
    """Whether what lies beside a grid says that it is in degrees; None where nothing says it.

    Of ``NAME.14`` and ``NAME.grd`` that is ``NAME.15``, of a ``.gr3`` file ``param.nml``;
    a ``.ll`` file is in degrees by its name.
    """
    ending = path.suffix.lower()
    if ending == LON_LAT:
        return True
    if ending == ".gr3":
        head = next(filter(None, (_head(path.with_name(name)) for name in SCHISM)), b"")
        found = ICS.search(head)
        return int(found[1]) == 2 if found else None
    if ending not in (".14", ".grd"):
        return None
    lines = _head(path.with_suffix(".15")).splitlines()
    words = lines[ICS_LINE].split() if len(lines) > ICS_LINE else []
    number = re.match(rb"-?\d{1,9}(?![\w.])", words[0]) if words else None
    return abs(int(number[0])) in SPHERICAL if number else None


def _head(path: Path) -> bytes:
    """How a file begins; nothing where it is none, or cannot be read."""
    try:
        if not path.is_file():
            return b""
        with path.open("rb") as file:
            return file.read(MOST)
    except (OSError, ValueError):
        return b""
