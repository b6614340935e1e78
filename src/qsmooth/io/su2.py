"""SU2: elements, points and boundary markers, in one zone or several."""

from __future__ import annotations

import re
from typing import NoReturn

import numpy as np

from qsmooth._types import FloatArray, IndexArray
from qsmooth.io.file_content import FACES, FileContent
from qsmooth.io.in_place import joined
from qsmooth.io.text import Text, blanked, finish, rows_of, with_newlines

NAME = "su2"
ENDINGS = (".su2",)
HOLDS = frozenset(("line", "names"))

# Element types are VTK's: number -> (name, vertices).
TYPES = {
    1: ("vertex", 1),
    3: ("line", 2),
    5: ("triangle", 3),
    9: ("quad", 4),
    10: ("tetra", 4),
    12: ("hexahedron", 8),
    13: ("wedge", 6),
    14: ("pyramid", 5),
}
CODES = {"vertex": 1, "line": 3, "triangle": 5, "quad": 9}
KEYWORD = re.compile(rb"^[ \t]*([A-Z_0-9]+)[ \t]*=[ \t]*([^\r\n]*?)[ \t]*\r?$", re.M)
COUNTED = (b"NELEM", b"NPOIN", b"MARKER_ELEMS")
# Read over: they say nothing of the mesh, or what is counted anyway.
KNOWN = (b"NDIME", b"NZONE", b"IZONE", b"NMARK", b"MARKER_TAG")
SENDING = (b"SEND_TO", b"SEND_RECV")
OTHER = (
    *(b"NCHUNK", b"ICHUNK", b"NCORNERS", b"AOA", b"AOS", b"FFD_NBOX"),
    *(b"NPERIOD", b"NPERIODIC", b"PERIODIC_INDEX", b"PERIODIC_CENTER", b"PERIODIC_ROTATION"),
    b"PERIODIC_TRANSLATE",
)


def sniff(head: bytes) -> bool:
    """Whether a file that starts so is SU2."""
    found = KEYWORD.search(with_newlines(blanked(head, rb"%[^\r\n]*")))
    return found is not None and found[1] in (*COUNTED, *KNOWN, *SENDING, *OTHER)


def read(data: bytes) -> FileContent:
    """Read SU2; zones become regions, markers become line cells."""
    clean = with_newlines(blanked(data, rb"%[^\r\n]*") if b"%" in data else data)
    # SEND_TO stands between a marker and its elements, and ends no section.
    found = list(KEYWORD.finditer(clean))
    keywords = [match for match in found if match[1] not in SENDING]
    # Keywords made blank, every token left is a number of a section.
    text = Text(KEYWORD.sub(lambda m: b" " * len(m[0]), clean))
    zones: list[_Zone] = []
    zone = _Zone()
    sections: list[_Section] = []
    stops = [match.start() for match in keywords[1:]] + [len(clean)]
    firsts = np.searchsorted(text.starts, [match.end() for match in keywords]).tolist()
    lasts = np.searchsorted(text.starts, stops).tolist()
    dimension = n_zones = 0
    tag = "?"
    n_read = 0
    for match, token, last in zip(keywords, firsts, lasts, strict=True):
        key, value = match[1], match[2]
        if key == b"NDIME":
            dimension = _integer(text, match, value)
            if dimension not in (2, 3):
                _fail(text, match, f"NDIME= {dimension}: must be 2 or 3")
        elif key == b"NZONE":
            n_zones = _integer(text, match, value)
        elif key == b"IZONE":
            zone = _Zone()
            zones.append(zone)
        elif key == b"MARKER_TAG":
            tag = value.strip().decode("latin-1")
        elif key in COUNTED:
            if not zones:
                zones.append(zone)
            n_rows = _integer(text, match, value)
            n_read = last
            if key == b"NPOIN":
                if not dimension:
                    _fail(text, match, "NPOIN before NDIME")
                zone.read_points(text, match, n_rows, dimension, token, last)
            else:
                marker = tag if key == b"MARKER_ELEMS" else None
                sections.append((zone, match, n_rows, marker, token, last))
        if key not in COUNTED and key in KNOWN and last > token:
            text.fail(token, f"numbers after {key.decode()}= that belong to nothing")
    _read_cells(text, sections)
    if not zones or not any(zone.parts for zone in zones):
        text.fail(len(text), "no NPOIN= section" if n_read else "no section of SU2 found")
    if n_zones and n_zones != len(zones):
        text.fail(len(text), f"the header says {n_zones} zones, the file has {len(zones)}")

    blocks, tags, places = [], [], []
    names: dict[str, tuple[int, int]] = {}
    offset = 0
    for zone_number, zone in enumerate(zones, start=1):
        if not zone.parts:
            text.fail(len(text), f"zone {zone_number} has no NPOIN= section")
        n_points = len(zone.parts[0][0])
        sound = zone.is_sound(n_points)
        for marker, kind, cells, place in zone.cells:
            if not sound and cells.size and not (cells.min() >= 0 and cells.max() < n_points):
                bad = ((cells < 0) | (cells >= n_points)).any(axis=1)
                row = int(np.flatnonzero(bad)[0])
                text.fail(
                    int(np.searchsorted(text.starts, place[row])),
                    f"{int(bad.sum())} {kind} elements of zone {zone_number} name points "
                    f"outside 0..{n_points - 1}, this is the first: {cells[row].tolist()}",
                )
            number = zone_number
            if marker is not None:
                number = names.setdefault(marker, (len(names) + 1, 1))[0]
            blocks.append((kind, cells + offset))
            tags.append(np.full(len(cells), number, dtype=np.int64))
            places.append(place)
        offset += n_points
    extras = ["comments"] if b"%" in data else []
    extras += sorted({match[1].decode() for match in keywords if match[1] in OTHER})
    extras += ["SEND_TO of markers"] if len(keywords) < len(found) else []
    return FileContent(
        np.concatenate([zone.parts[0][0] for zone in zones]),
        blocks,
        tags,
        names,
        extras=tuple(extras),
        slots=joined([text.slots(zone.parts[0][1]) for zone in zones]),
        places=places,
    )


class _Zone:
    """Points and cells of one zone, vertices counted from its own 0."""

    def __init__(self) -> None:
        self.parts: list[tuple[FloatArray, IndexArray]] = []
        self.cells: list[tuple[str | None, str, IndexArray, IndexArray]] = []

    def read_points(
        self, text: Text, match: re.Match[bytes], n: int, dimension: int, first: int, last: int
    ) -> None:
        """Points: coordinates, and after them perhaps a number."""
        if self.parts:
            _fail(text, match, "a second NPOIN= in one zone")
        rows = _rows(text, match, n, first, last)
        widths = np.diff(rows)
        short = np.flatnonzero(widths < dimension)
        if short.size:
            text.fail(int(rows[short[0]]), f"a point needs {dimension} coordinates")
        tokens = rows[:-1, None] + np.arange(dimension)
        if n and bool((widths == widths[0]).all()):
            points = text.numbers(int(rows[0]), int(rows[-1])).reshape(n, -1)
            points = np.ascontiguousarray(points[:, :dimension])
        else:
            points = text.numbers_at(tokens.ravel()).reshape(n, dimension)
        self.parts.append((points, tokens))

    def is_sound(self, n_points: int) -> bool:
        """Whether all cells name points of the zone, at one look: there may be many markers."""
        if not self.cells:
            return True
        every = np.concatenate([cells.ravel() for _, _, cells, _ in self.cells])
        return not every.size or bool(every.min() >= 0 and every.max() < n_points)


# Elements of a zone or a marker: its keyword, count of rows, name, first token and the end.
_Section = tuple[_Zone, re.Match[bytes], int, str | None, int, int]


def _read_cells(text: Text, sections: list[_Section]) -> None:
    """Elements: type, vertices, and after them perhaps a number; of all sections at once."""
    if not sections:
        return
    found = [_rows(text, *section[1:3], *section[4:]) for section in sections]
    counts = np.array([len(rows) - 1 for rows in found])
    owners = np.repeat(np.arange(len(sections)), counts)
    firsts = np.concatenate([rows[:-1] for rows in found])
    widths = np.concatenate([rows[1:] for rows in found]) - firsts
    codes = text.numbers_at(firsts, np.int64)
    lengths = np.zeros(len(codes), np.int64)
    for code in np.unique(codes).tolist():
        rows_of_code = np.flatnonzero(codes == code)
        if code not in TYPES:
            text.fail(int(firsts[rows_of_code[0]]), f"element type {code} is unknown")
        kind, n_corners = TYPES[code]
        short = rows_of_code[widths[rows_of_code] < n_corners + 1]
        if short.size:
            text.fail(int(firsts[short[0]]), f"a {kind} needs {n_corners} vertices")
        lengths[rows_of_code] = n_corners + 1
    places = text.starts[firsts]
    for i, j, table in text.tables(firsts, lengths, owners * (1 + max(TYPES)) + codes):
        zone, _, _, tag, *_ = sections[owners[i]]
        zone.cells.append((tag, TYPES[int(codes[i])][0], table[:, 1:], places[i:j]))


def write(content: FileContent) -> bytes:
    """Write SU2: one zone, its markers from the tags of line cells."""
    faces = content.of_type(*FACES)
    n_faces = sum(len(cells) for cells, _ in faces)
    lines = ["NDIME= 2", f"NELEM= {n_faces}"]
    first = 0
    for cells, _ in faces:
        code = CODES["triangle" if cells.shape[1] == 3 else "quad"]
        numbers = np.arange(first, first + len(cells))
        lines += rows_of(np.full(len(cells), code), cells, numbers)
        first += len(cells)
    lines.append(f"NPOIN= {len(content.points)}")
    lines += rows_of(content.points[:, :2], np.arange(len(content.points)))
    edges = [(cells, tags) for cells, tags in content.of_type("line")]
    if edges:
        cells = np.concatenate([cells for cells, _ in edges])
        tags = np.concatenate([np.zeros(len(c), np.int64) if t is None else t for c, t in edges])
        names = {tag: name for name, (tag, dim) in content.names.items() if dim == 1}
        markers = np.unique(tags).tolist()
        lines.append(f"NMARK= {len(markers)}")
        for marker in markers:
            chosen = cells[tags == marker]
            lines.append(f"MARKER_TAG= {names.get(marker, f'marker_{marker}')}")
            lines.append(f"MARKER_ELEMS= {len(chosen)}")
            lines += rows_of(np.full(len(chosen), CODES["line"]), chosen)
    else:
        lines.append("NMARK= 0")
    return finish(lines)


def _rows(text: Text, match: re.Match[bytes], n: int, first: int, last: int) -> IndexArray:
    """Token at which each of the `n` rows of a section begins, and its end."""
    rows = text.rows
    i, j = rows.searchsorted((first, last)).tolist()
    if j - i != n:
        key = match[1].decode()
        token = last if j - i < n else int(rows[i + n])
        text.fail(token, f"{key}= says {n} rows, the file has {j - i}")
    return rows[i : j + 1]


def _integer(text: Text, match: re.Match[bytes], value: bytes) -> int:
    word = (value.split() or [b""])[0]
    if not word.isdigit():
        _fail(text, match, f"{match[1].decode()}= needs a count, not {value.decode('latin-1')!r}")
    return int(word)


def _fail(text: Text, match: re.Match[bytes], what: str) -> NoReturn:
    text.fail(int(np.searchsorted(text.starts, match.start())), what)
