"""What HOHQMesh says of sides of quads, in files of its own and of Abaqus: curves, names."""

from __future__ import annotations

import re
from dataclasses import dataclass

import numpy as np

from qsmooth._types import BoolArray, FloatArray, IndexArray
from qsmooth.checks import counted
from qsmooth.errors import MeshError
from qsmooth.io.in_place import InPlace
from qsmooth.io.text import TO_BLANKS, Text, walked, with_newlines

NO_NAME = b"---"
HIGHEST_ORDER = 60  # an element then takes 247 lines; `walked` counts to 255
# In Abaqus's files it is in comments, behind all else.
COMMENTS = re.compile(
    rb"(?m)^\*\*[^\r\n]*HOHQMesh boundary information[^\r\n]*[\r\n]+"
    rb"\*\*[^\r\n=]*degree[ \t]*=[ \t]*(\d{1,9})[ \t]*[\r\n]+"
    rb"((?:\*\*[^\r\n]*[\r\n]*)*)"
)


@dataclass
class Quads:
    """Elements with the sides that are curved or have a name, as lines.

    Parameters
    ----------
    corners : (n, 4)
        Ids, from 1.
    lines : (n_lines, 2)
        Ids; a side is the line from its corner to the next.
    curved : (n_lines,)
    tags : (n_lines,)
        Number of the side's name, from 1; 0 where it has none.
    names
        Name of a side -> number and dimension.
    first_tokens
        Where each element stands.
    places : (n_lines,)
        Bytes of the names of lines.
    """

    corners: IndexArray
    lines: IndexArray
    curved: BoolArray
    tags: IndexArray
    names: dict[str, tuple[int, int]]
    first_tokens: IndexArray
    places: IndexArray

    def notes(self) -> tuple[str, ...]:
        """What to say of curves."""
        n = int(self.curved.sum())
        if n == 0:
            return ()
        kept = counted(n, "curved side stays as it is", "curved sides stay as they are")
        return (f"{kept}; cells are judged as if sides were straight",)


@dataclass
class CurvesStay:
    """Coordinates of a file whose curved sides are not moved: nor may be what they end at.

    Parameters
    ----------
    slots
        Of the coordinates.
    ends
        Vertices at the ends of curved sides.
    """

    slots: InPlace
    ends: IndexArray

    def write(self, data: bytes, old: FloatArray, new: FloatArray) -> bytes:
        """The bytes of the file with the coordinates that changed, and nothing else, replaced."""
        moved = (old[self.ends] != new[self.ends]).any(axis=1)
        if moved.any():
            first = int(self.ends[moved][0])
            what = f"vertex {first} at the end of a curved side has moved"
            if moved.sum() > 1:
                what = f"{moved.sum()} vertices at the ends of curved sides have moved"
            raise MeshError(
                f"{what}: the file has the curves where they were. Keep the boundary and "
                "interfaces fixed, or write another format"
            )
        return self.slots.write(data, old, new)


def read_quads(
    text: Text, first: int, last: int, order: int, n_heads: int, names_last: bool = False
) -> Quads:
    """Read elements of several lines each: corners, flags, points of curves, names.

    Parameters
    ----------
    text
        Elements are the tokens from `first` up to `last`, where lines begin.
    order
        A curved side has a line for each of `order` + 1 points.
    n_heads
        Words on the first line of each: 4 corners, and perhaps a material.
    names_last
        Whether the lines of names stand behind all elements.
    """
    if not 0 < order <= HIGHEST_ORDER:
        text.fail(first, f"sides of order {order} are not read, only up to {HIGHEST_ORDER}")
    rows = text.rows
    begin, end = np.searchsorted(rows, (first, last)).tolist()
    rows = rows[begin : end + 1]
    n_rows = len(rows) - 1
    widths = np.diff(rows)
    flags = _flags(text, rows[:-1], widths)
    n_fixed = 2 if names_last else 3
    # Of every line how many an element would take that began there.
    lengths = np.zeros(n_rows, np.int64)
    lengths[:-1] = np.where(flags[1:, 0] >= 0, n_fixed + (order + 1) * flags[1:].sum(axis=1), 0)
    lengths[widths != n_heads] = 0
    firsts, stop = walked(lengths)
    n_names = len(firsts) if names_last else 0
    if stop + n_names != n_rows:
        text.fail(
            int(rows[min(stop, n_rows - 1)]),
            f"this is no element: {n_heads} words, 4 flags, {order + 1} points of each curved "
            "side, 4 names",
        )
    flags = flags[np.minimum(firsts + 1, n_rows - 1)]
    name_rows = stop + np.arange(n_names) if names_last else firsts + lengths[firsts] - 1
    odd = np.flatnonzero(widths[name_rows] != 4)
    if odd.size:
        text.fail(int(rows[name_rows[odd[0]]]), "an element needs four names of its sides")
    on_curve = np.ones(n_rows, np.bool_)
    on_curve[np.concatenate([firsts, firsts + 1, name_rows])] = False
    odd = np.flatnonzero(on_curve & (widths != 3))
    if odd.size:
        text.fail(int(rows[odd[0]]), "a point of a curved side needs three coordinates")
    corners = text.numbers_at((rows[firsts][:, None] + np.arange(4)).ravel(), np.int64)
    corners = corners.reshape(-1, 4)
    tokens = rows[name_rows][:, None] + np.arange(4)
    named = ~_is(text, tokens, NO_NAME)
    cell, side = np.nonzero(named | (flags > 0))
    line_tokens = tokens[cell, side]
    words = [text.word(token) for token in line_tokens.tolist()]
    kinds = dict.fromkeys(word for word in words if word != NO_NAME)
    numbers = {word: k for k, word in enumerate(kinds, start=1)}
    return Quads(
        corners,
        np.stack([corners[cell, side], corners[cell, (side + 1) % 4]], axis=1),
        flags[cell, side] > 0,
        np.array([numbers.get(word, 0) for word in words], dtype=np.int64),
        {word.decode("utf-8", "replace"): (k, 1) for word, k in numbers.items()},
        rows[firsts],
        text.starts[line_tokens],
    )


def quads_in_comments(data: bytes) -> Quads | None:
    """What HOHQMesh has put into a file of Abaqus; None where it has not."""
    data = with_newlines(data)
    match = COMMENTS.search(data)
    if match is None:
        return None
    begin, end = match.span(2)
    section = data[begin:end].replace(b"**", b"  ")
    text = Text(data[:begin].translate(TO_BLANKS) + section)
    return read_quads(text, 0, len(text), int(match[1]), 4, names_last=True)


def _flags(text: Text, rows: IndexArray, widths: IndexArray) -> IndexArray:
    """Four flags of each line; -1 where it has something else."""
    four = np.flatnonzero(widths == 4)
    tokens = rows[four][:, None] + np.arange(4)
    zero, one = _is(text, tokens, b"0"), _is(text, tokens, b"1")
    flags = np.full((len(rows), 4), -1, np.int64)
    flags[four] = np.where((zero | one).all(axis=1, keepdims=True), one, -1)
    return flags


def _is(text: Text, tokens: IndexArray, word: bytes) -> BoolArray:
    """Which tokens are this word."""
    data = np.frombuffer(text.data, np.uint8)
    same: BoolArray = np.equal(text.ends[tokens] - text.starts[tokens], len(word))
    for k, byte in enumerate(word):
        same &= data[np.minimum(text.starts[tokens] + k, len(data) - 1)] == byte
    return same
