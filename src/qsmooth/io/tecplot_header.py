"""The words in a file of Tecplot: names of variables, and what each zone says of itself."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from typing import NoReturn

from qsmooth.errors import MeshError
from qsmooth.io.text import TO_BLANKS, blanked, line_of, with_newlines

# Lines that do not begin with a number, comments left out before.
WORDS = re.compile(rb"(?m)^[ \t]*(?!(?i:nan|inf)\b)[^\s\d+\-.][^\n]*")
RECORD = re.compile(
    r"(?im)^[ \t]*(title|variables|zone|text|geometry|customlabels|datasetauxdata|varauxdata"
    r"|functionset|filetype)\b"
)
NAMES = re.compile(r'"((?:[^"\\]|\\.)*)"|([^\s,"=]+)')
PAIR = re.compile(r'([A-Za-z]\w*)\s*=\s*("(?:[^"\\]|\\.)*"|\((?:[^()]|\([^()]*\))*\)|[^\s,]+)')
SHARED = re.compile(r"(?:\[([\d,\-\s]+)\]|(\d+))\s*(?:=\s*(\d+))?")
LOCATED = re.compile(r"(?i)\[([\d,\-\s]+)\]\s*=\s*(\w+)|(nodal|cellcentered)")
Fail = Callable[[str], NoReturn]
MOST_VARIABLES, MOST_VALUES = 10_000, 10**6  # times zones: each zone has a record of each
KINDS = {
    "TRIANGLE": ("triangle", 3),
    "QUADRILATERAL": ("quad", 4),
    "LINESEG": ("line", 2),
}


@dataclass
class Zone:
    """What a zone says of itself.

    Parameters
    ----------
    title, kind, n_corners, n_nodes, n_cells, by_point
        Its name, its cells and how values are laid out.
    at_cells
        Variables that have a value for each cell.
    shared
        Variable -> zone that has its values.
    connectivity
        The zone whose cells these are, or None.
    offset, begin, end
        Bytes of the word ZONE and of its numbers.
    first, last
        Tokens of its numbers.
    """

    title: str
    kind: str
    n_corners: int
    n_nodes: int
    n_cells: int
    by_point: bool
    offset: int = 0
    begin: int = 0
    end: int = 0
    at_cells: set[int] = field(default_factory=set)
    shared: dict[int, int] = field(default_factory=dict)
    connectivity: int | None = None
    first: int = 0
    last: int = 0


def headers(data: bytes) -> tuple[list[str], list[Zone], bytes, list[str]]:
    """Names of variables, zones, the file with all words blank, and what else is in it."""
    clean = with_newlines(data)
    if b"#" in clean:
        clean = blanked(clean, rb"(?m)^[ \t]*#[^\n]*|#[^\"\n]*$")
    extras = ["comments"] if b"#" in data else []
    words = [match.span() for match in WORDS.finditer(clean)]
    groups: list[tuple[int, int]] = []
    for begin, end in words:
        if groups and not clean[groups[-1][1] : begin].strip():
            groups[-1] = (groups[-1][0], end)
        else:
            groups.append((begin, end))
    variables: list[str] = []
    zones: list[Zone] = []
    for k, (begin, end) in enumerate(groups):
        following = groups[k + 1][0] if k + 1 < len(groups) else len(clean)
        text = clean[begin:end].decode("latin-1")
        records = list(RECORD.finditer(text))
        if not records or text[: records[0].start()].strip():
            _fail(clean, begin, f"{text[:40]!r} is no record of Tecplot")
        for number, match in enumerate(records):
            stop = records[number + 1].start() if number + 1 < len(records) else len(text)
            body, word = text[match.end() : stop], match[1].upper()
            if word == "VARIABLES":
                variables = [a or b for a, b in NAMES.findall(body.partition("=")[2])]
                if len(variables) > MOST_VARIABLES:
                    _fail(clean, begin, f"{len(variables)} variables are too many")
            elif word == "ZONE":
                last = following if number + 1 == len(records) else begin + stop
                offset = begin + match.start(1)
                if len(zones) * (100 + len(variables)) > MOST_VALUES:
                    _fail(clean, offset, f"more than {len(zones)} such zones are not read")
                fail = partial(_fail, clean, offset)
                zone = _zone(body, fail, len(variables), len(zones))
                zone.offset, zone.begin, zone.end = offset, min(end, last), last
                zones.append(zone)
            elif word not in ("TITLE", "FILETYPE"):
                extras.append(f"records {word}")
    kept = bytearray(clean)
    for begin, end in groups:
        kept[begin:end] = clean[begin:end].translate(TO_BLANKS)
    if (at := kept.find(b"*")) >= 0:
        _fail(clean, at, "values written once for several, as 3*1.5, are not read")
    return variables, zones, bytes(kept), extras


def _zone(body: str, fail: Fail, n_variables: int, n_zones: int) -> Zone:
    """A zone from the text behind the word."""
    body = re.sub(r"(?im)^[ \t]*auxdata\b[^\n]*", "", body)
    said = {key.upper(): value.strip() for key, value in PAIR.findall(body)}

    def count(*keys: str) -> int:
        value = next((said[key] for key in keys if key in said), "")
        if not re.fullmatch(r"\d{1,18}", value):
            fail(f"a zone needs {' or '.join(keys)}, found {value[:20]!r}")
        return int(value)

    old, packing = said.get("F", "").upper(), said.get("DATAPACKING", "").upper()
    if old in ("FEPOINT", "FEBLOCK"):
        packing, kind = old[2:], said.get("ET", "").upper()
    else:
        kind = said.get("ZONETYPE", "ORDERED").upper().removeprefix("FE")
    if kind not in KINDS:
        fail(
            f"a zone of type {kind[:20] or 'ORDERED'!r} is not read, only finite elements: "
            "triangles, quads and line segments"
        )
    if packing not in ("POINT", "BLOCK"):
        fail("a zone needs DATAPACKING=POINT or BLOCK")
    if "D" in said:
        fail("D=, values of another zone in the old form, is not read")
    zone = Zone(
        said.get("T", "").strip('"').strip(),
        *KINDS[kind],
        count("N", "NODES"),
        count("E", "ELEMENTS"),
        packing == "POINT",
    )
    for numbers, where, every in LOCATED.findall(_inner(said.get("VARLOCATION", ""))):
        if where.upper() == "CELLCENTERED":
            zone.at_cells |= set(_variables(numbers, n_variables, fail))
        elif every:
            fail("VARLOCATION needs numbers of variables in brackets")
    if zone.at_cells and zone.by_point:
        fail("values at cells need DATAPACKING=BLOCK")
    for several, one, source in SHARED.findall(_inner(said.get("VARSHARELIST", ""))):
        for variable in _variables(several or one, n_variables, fail):
            zone.shared[variable] = int(source or n_zones) - 1
    if "CONNECTIVITYSHAREZONE" in said:
        zone.connectivity = count("CONNECTIVITYSHAREZONE") - 1
    return zone


def _inner(text: str) -> str:
    """What stands in parentheses."""
    return text.strip().removeprefix("(").removesuffix(")")


def _variables(text: str, n_variables: int, fail: Fail) -> list[int]:
    """Numbers of variables, from 0, of a list such as 1,3-5."""
    found: list[int] = []
    for part in text.split(","):
        low, _, high = part.strip().partition("-")
        if not low.isdigit() or not (high or low).isdigit() or len(part) > 20:
            fail(f"{part.strip()[:20]!r} is no number of a variable")
        begin, end = int(low), int(high or low)
        if not 1 <= begin <= end <= n_variables:
            fail(f"there is no variable {end}, of {n_variables}")
        found += range(begin - 1, end)
    return found


def _fail(data: bytes, offset: int, what: str) -> NoReturn:
    raise MeshError(f"line {line_of(data, offset)}: {what}")
