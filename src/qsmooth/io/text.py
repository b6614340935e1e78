"""Numbers in files, parsed in bulk, with the place of each."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from functools import cached_property
from itertools import pairwise
from typing import Any, NoReturn

import numpy as np
import numpy.typing as npt

from qsmooth._types import FloatArray, IndexArray
from qsmooth.errors import MeshError
from qsmooth.io.in_place import Slots, binary_slots

# Fortran writes 1.0D-3; both letters mean the same.
FORTRAN = bytes.maketrans(b"dD", b"ee")
# Makes all blank but the ends of lines.
TO_BLANKS = bytes(byte if byte in b"\r\n" else 32 for byte in range(256))
# All integers below are exact as floating-point numbers.
EXACT = 2.0**53
# Bytes a number from which on numbers are picked out one by one: what they stand among may be the
# whole file, and a file may ask for as many such columns as it has bytes.
SPARSE = 128


def blanked(data: bytes, pattern: bytes) -> bytes:
    """Spaces in place of what matches, so that every other byte stays where it is."""
    return re.sub(pattern, lambda match: b" " * len(match[0]), data)


def with_newlines(data: bytes) -> bytes:
    """Newlines in place of carriage returns that stand alone, of which some files have both."""
    return re.sub(rb"\r(?!\n)", b"\n", data) if b"\r" in data else data


def line_of(data: bytes, offset: int) -> int:
    """Line number of a byte, from 1."""
    newline = b"\n" if b"\n" in data else b"\r"
    return data.count(newline, 0, offset) + 1


def runs(kinds: IndexArray) -> list[tuple[int, int]]:
    """First and last + 1 of each run of equal values."""
    if len(kinds) == 0:
        return []
    cuts = [0, *(np.flatnonzero(kinds[1:] != kinds[:-1]) + 1).tolist(), len(kinds)]
    return list(pairwise(cuts))


class Text:
    """The tokens of a text: whatever stands between white space.

    Parameters
    ----------
    data
        The file, or a copy of the same length in which comments are blank.
    """

    def __init__(self, data: bytes) -> None:
        self.data = data
        self._bytes = np.frombuffer(data, np.uint8)
        inside = np.zeros(len(data) + 2, np.bool_)
        np.greater(self._bytes, 32, out=inside[1:-1])
        edges = np.flatnonzero(inside[1:] != inside[:-1])
        self.starts: IndexArray = edges[0::2]
        self.ends: IndexArray = edges[1::2]

    def __len__(self) -> int:
        return len(self.starts)

    @cached_property
    def rows(self) -> IndexArray:
        """Token at which each line begins, empty lines left out, and one past the last."""
        newline = 10 if b"\n" in self.data else 13  # 13 alone: old Macintosh
        newlines = np.flatnonzero(self._bytes == newline)
        places = np.searchsorted(self.starts, newlines)
        offsets: IndexArray = np.concatenate(([0], places, [len(self)]))
        rows: IndexArray = offsets[np.append(offsets[1:] > offsets[:-1], True)]
        return rows

    def word(self, token: int) -> bytes:
        """The token itself; b"" past the end."""
        if token >= len(self):
            return b""
        return self.data[self.starts[token] : self.ends[token]]

    def words(self, first: int, last: int) -> list[bytes]:
        """The tokens from `first` up to `last`."""
        last = min(last, len(self))
        if first >= last:
            return []
        return self.data[self.starts[first] : self.ends[last - 1]].split()

    def line(self, token: int) -> int:
        """Line number of a token, from 1; the last line where there is no such token."""
        if len(self) == 0:
            return 1
        return line_of(self.data, int(self.starts[min(token, len(self) - 1)]))

    def fail(self, token: int, what: str) -> NoReturn:
        """Raise a MeshError that names the line."""
        raise MeshError(f"line {self.line(token)}: {what}")

    def numbers(self, first: int, last: int, dtype: Any = np.float64) -> npt.NDArray[Any]:
        """Values of the tokens from `first` up to `last`.

        Raises
        ------
        MeshError
            If the file ends before, or a token is not a number.
        """
        if last > len(self):
            self.fail(len(self), f"the file ends too early: {last - len(self)} numbers are missing")
        if first >= last:
            return np.empty(0, dtype)
        piece = self.data[self.starts[first] : self.ends[last - 1]]
        return self._parse(piece, range(first, last), dtype)

    def numbers_at(self, tokens: IndexArray, dtype: Any = np.float64) -> npt.NDArray[Any]:
        """Values of these tokens, which must be in increasing order."""
        if tokens.size == 0:
            return np.empty(0, dtype)
        if tokens[-1] - tokens[0] + 1 == tokens.size:
            return self.numbers(int(tokens[0]), int(tokens[-1]) + 1, dtype)
        begin, end = self.starts[tokens[0]], self.ends[tokens[-1]]
        if end - begin > SPARSE * tokens.size:
            starts, ends = self.starts[tokens].tolist(), self.ends[tokens].tolist()
            words = [self.data[i:j] for i, j in zip(starts, ends, strict=True)]
            return self._parse(b" ".join(words), tokens, dtype)
        # Blank the rest rather than pick out tokens: one pass over bytes, no Python loop.
        edges = np.zeros(end - begin + 1, np.int8)
        edges[self.starts[tokens] - begin] = 1
        edges[self.ends[tokens] - begin] = -1
        inside = np.cumsum(edges[:-1], dtype=np.int8).view(np.bool_)
        piece = np.where(inside, self._bytes[begin:end], np.uint8(32)).tobytes()
        return self._parse(piece, tokens, dtype)

    def tables(
        self, firsts: IndexArray, lengths: IndexArray, kinds: IndexArray
    ) -> Iterator[tuple[int, int, IndexArray]]:
        """Integers of rows of several kinds, a table for each run of one kind.

        All are parsed at once, as there may be a run for every second row.

        Parameters
        ----------
        firsts, lengths
            Row `k` is the `lengths[k]` tokens from `firsts[k]` on.
        kinds
            Rows of equal kind must be of equal length.

        Yields
        ------
        First row, end, and the table of each run.
        """
        ends = np.cumsum(lengths)
        begins = ends - lengths
        tokens = np.arange(int(lengths.sum())) + np.repeat(firsts - begins, lengths)
        values = self.numbers_at(tokens, np.int64)
        for i, j in runs(kinds):
            yield i, j, values[begins[i] : ends[j - 1]].reshape(j - i, -1)

    def _parse(
        self, piece: bytes, tokens: Sequence[int] | IndexArray, dtype: Any
    ) -> npt.NDArray[Any]:
        values = _from_text(piece, dtype)
        if values is None or len(values) != len(tokens):
            values = _from_text(piece.translate(FORTRAN), dtype)
        if values is None or len(values) != len(tokens):
            self._fail_at_first_that_is_none(tokens, dtype)
        return values

    def _fail_at_first_that_is_none(
        self, tokens: Sequence[int] | IndexArray, dtype: Any
    ) -> NoReturn:
        convert = int if np.dtype(dtype).kind in "iu" else float
        for token in map(int, tokens):
            word = self.word(token).translate(FORTRAN)
            try:
                convert(word)
            except ValueError:
                kind = "an integer" if convert is int else "a number"
                self.fail(token, f"{_shown(self.word(token))} is not {kind}")
        self.fail(int(tokens[0]), "these are not numbers")

    def slots(self, tokens: IndexArray) -> Slots:
        """Slots of coordinates that stand at these tokens, shape (n_vertices, n_coordinates)."""
        return Slots(self.starts[tokens], self.ends[tokens])


def _from_text(piece: bytes, dtype: Any) -> npt.NDArray[Any] | None:
    """All of the numbers in `piece`, None where it holds something else."""
    # NumPy stops at what is no number and only warns (later versions may raise): a number set at
    # the end tells whether it came so far, without touching the filters of warnings, which all
    # threads share.
    try:
        values = np.fromstring(piece + b" 7", dtype, sep=" ")
    except (ValueError, DeprecationWarning):
        return None
    return values[:-1] if len(values) and values[-1] == 7 else None


def _shown(word: bytes) -> str:
    text = word[:40].decode("latin-1")
    return repr(text + "..." if len(word) > 40 else text)


class Cursor:
    """Reads a file from front to back, numbers as text or binary alike.

    Parameters
    ----------
    data
        The file, or a copy of the same length in which comments are blank.
    order
        "" if the numbers are text, else "<" or ">".
    """

    def __init__(self, data: bytes, order: str = "") -> None:
        self.data = data
        self.order = order
        self.pos = 0
        self.line_start = 0
        self._found = (-1, 0)  # the last place that was looked up, and its token

    @cached_property
    def text(self) -> Text:
        return Text(self.data)

    def fail(self, what: str) -> NoReturn:
        """Raise a MeshError that names the line (of a binary file, the byte)."""
        where = f"byte {self.pos}" if self.order else f"line {line_of(self.data, self.pos)}"
        raise MeshError(f"{where}: {what}")

    def line(self) -> bytes:
        """The next line that is not empty, without white space around it; b"" at the end."""
        while self.pos < len(self.data):
            end = self.data.find(b"\n", self.pos)
            end = len(self.data) if end < 0 else end
            line = self.data[self.pos : end].strip()
            if line:
                self.line_start = self.pos
                self.pos = end + 1
                return line
            self.pos = end + 1
        return b""

    @property
    def token(self) -> int:
        """Number of the next token."""
        place, token = self._found
        if place != self.pos:
            token = int(self.text.starts.searchsorted(self.pos))
            self._found = (self.pos, token)
        return token

    def word(self) -> bytes:
        """The next token; b"" at the end. Text only."""
        token = self.token
        word = self.text.word(token)
        self.pos = int(self.text.ends[token]) if word else len(self.data)
        return word

    def count(self, what: str) -> int:
        """The next token as a count of something. Text only."""
        word = self.word()
        if not word.isdigit():
            self.fail(f"number of {what} expected, found {_shown(word) if word else 'the end'}")
        return int(word)

    def numbers(self, n: int, dtype: str = "f8", what: str = "numbers") -> npt.NDArray[Any]:
        """The next `n` numbers; `dtype` without byte order."""
        if n < 0:
            self.fail(f"there cannot be {n} {what}")
        if self.order:
            stored = np.dtype(self.order + dtype)
            if n * stored.itemsize > len(self.data) - self.pos:
                self.fail(f"the file ends too early: {n} {what} expected")
            values = np.frombuffer(self.data, stored, n, self.pos)
            self.pos += n * stored.itemsize
            return values.astype(dtype)
        token = self.token
        if token + n > len(self.text):
            missing = token + n - len(self.text)
            self.fail(f"the file ends too early: {n} {what} expected, {missing} are missing")
        kind = "i8" if np.dtype(dtype).kind in "iu" else "f8"
        values = self.text.numbers(token, token + n, kind)
        if n:
            self.pos = int(self.text.ends[token + n - 1])
            self._found = (self.pos, token + n)
        return values

    def points(
        self, n: int, n_columns: int, columns: Sequence[int] = (0, 1, 2), dtype: str = "f8"
    ) -> tuple[FloatArray, Slots]:
        """Rows of `n_columns` numbers, `columns` of which are coordinates; with their slots."""
        first = self.pos
        token = -1 if self.order else self.token
        rows = self.numbers(n * n_columns, dtype, "coordinates").reshape(n, n_columns)
        points = np.ascontiguousarray(rows[:, list(columns)], np.float64)
        if self.order:
            stored = np.dtype(self.order + dtype)
            begin = first + columns[0] * stored.itemsize
            return points, binary_slots(begin, n, stored, n_columns * stored.itemsize, len(columns))
        tokens = token + n_columns * np.arange(n, dtype=np.int64)[:, None] + np.array(columns)
        return points, self.text.slots(tokens)


def integers(values: FloatArray, what: str) -> IndexArray:
    """Ids that were read beside coordinates, as numbers of any kind.

    Raises
    ------
    MeshError
        If one is not an integer, or too large to be known exactly.
    """
    wrong = ~(np.abs(values) < EXACT) | (values != np.floor(values))
    if wrong.any():
        first = float(values[np.argmax(wrong)])
        raise MeshError(f"{int(wrong.sum())} {what} ids are no integers, the first is {first:g}")
    return values.astype(np.int64)


def positions(ids: IndexArray, wanted: IndexArray, what: str = "vertex") -> IndexArray:
    """Where each of `wanted` stands among `ids`, which may have gaps and any order.

    Raises
    ------
    MeshError
        If an id comes twice or is wanted and does not exist.
    """
    n = len(ids)
    found: IndexArray
    if n and ids[0] in (0, 1) and np.array_equal(ids, np.arange(n) + ids[0]):
        found = wanted - ids[0]
        bad = (found < 0) | (found >= n)
    else:
        order = np.argsort(ids, kind="stable")
        ordered = ids[order]
        twice = np.flatnonzero(ordered[1:] == ordered[:-1])
        if twice.size:
            raise MeshError(f"{twice.size} {what} ids come twice, the first is {ordered[twice[0]]}")
        place = np.minimum(np.searchsorted(ordered, wanted), max(n - 1, 0))
        bad = ordered[place] != wanted if n else np.ones(wanted.shape, np.bool_)
        found = order[place] if n else wanted
    if bad.any():
        raise MeshError(
            f"{int(bad.sum())} corners name a {what} that does not exist, "
            f"the first is {what} id {int(wanted[bad][0])}"
        )
    return found


def blocks_by_id(
    ids: IndexArray, blocks: list[tuple[str, IndexArray]]
) -> list[tuple[str, IndexArray]]:
    """Blocks whose cells name vertices by their ids, now by their positions; see `positions`."""
    if not blocks:
        return []
    corners = [*(cells.ravel() for _, cells in blocks)]
    found = positions(ids, np.concatenate(corners), "node")
    parts = np.split(found, np.cumsum([cells.size for _, cells in blocks])[:-1])
    return [(kind, p.reshape(c.shape)) for (kind, c), p in zip(blocks, parts, strict=True)]


def walked(lengths: IndexArray) -> tuple[IndexArray, int]:
    """Where records begin that follow one another, and where the last one ends.

    Parameters
    ----------
    lengths
        Of each number how many the record would have that began there, below 256; 0 where none can.

    Returns
    -------
    The first numbers, and one past the last record; a place within where none can begin.
    """
    steps = lengths.astype(np.uint8).tobytes()
    firsts, place, end = [], 0, len(steps)
    while place < end and steps[place]:
        firsts.append(place)
        place += steps[place]
    return np.array(firsts, dtype=np.int64), place


def rows_of(*columns: npt.NDArray[Any]) -> list[str]:
    """Lines of text with the columns of arrays side by side; floats with all their digits."""
    parts: list[Any] = []
    if len(columns[0]) == 0:
        return []
    for array in columns:
        table = array.reshape(len(array), -1)
        show = str if table.dtype.kind in "iub" else repr
        parts.extend(map(show, column) for column in table.T.tolist())
    return list(map(" ".join, zip(*parts, strict=True)))


def finish(lines: list[str]) -> bytes:
    """Lines as the bytes of a file."""
    return ("\n".join(lines) + "\n").encode("latin-1", "replace")
