"""The records of a Selafin file: where its parts stand."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from qsmooth._types import IndexArray
from qsmooth.errors import MeshError

TITLE, VARIABLE, LABEL = 80, 32, 16
KINDS = {2: "line", 3: "triangle", 4: "quad", 6: "wedge"}
# Names of the bed's level, in English and in French.
BOTTOM = ("BOTTOM", "FOND")
MARK = 4  # bytes of the length that stands before and after each record
# Entries of IPARAM, from 0: what to add to x and y, planes of a 3D file, whether a date follows.
ORIGIN, PLANES, DATE = slice(2, 4), 6, 9


def order_of(head: bytes | bytearray) -> str:
    """Byte order of a file that begins so, "<" or ">"; "" where it is no Selafin."""
    orders = {TITLE.to_bytes(MARK, "little"): "<", TITLE.to_bytes(MARK, "big"): ">"}
    return orders.get(bytes(head[:MARK]), "")


@dataclass(frozen=True)
class Layout:
    """Where the parts of a file stand.

    Parameters
    ----------
    order, size
        "<" or ">", and the bytes of a real number, 4 or 8.
    names
        Of the variables, each once.
    n_points
        Values of each record of reals, but for those of times.
    kind, n_cells, cells_at
        Type and number of the cells, and the byte at which their ids of vertices begin.
    x_at
        Byte at which the record of x begins; that of y follows, then the steps.
    n_steps
        Of each the time is stored, then every variable.
    extras
        What else the file has, in words.
    """

    order: str
    size: int
    names: tuple[str, ...]
    n_points: int
    kind: str
    n_cells: int
    cells_at: int
    x_at: int
    n_steps: int
    extras: tuple[str, ...] = ()

    def cells(self, data: bytes | bytearray) -> IndexArray:
        """Vertices of each cell, from 0; shape (n_cells, corners)."""
        n_corners = next(n for n, kind in KINDS.items() if kind == self.kind)
        nodes = np.frombuffer(data, self.order + "i4", self.n_cells * n_corners, self.cells_at)
        return nodes.reshape(-1, n_corners).astype(np.int64) - 1

    @property
    def record(self) -> int:
        """Bytes of a record with a real number for each vertex."""
        return 2 * MARK + self.size * self.n_points

    @property
    def steps_at(self) -> int:
        """Byte at which the first step begins."""
        return self.x_at + 2 * self.record

    @property
    def step(self) -> int:
        """Bytes of a step."""
        return 2 * MARK + self.size + len(self.names) * self.record

    @property
    def end(self) -> int:
        """Bytes of the file."""
        return self.steps_at + self.n_steps * self.step

    @cached_property
    def bottom(self) -> int:
        """Number of the variable that is z: the bed of a file with one step; -1 where none is."""
        found = [i for i, name in enumerate(self.names) if name.upper() in BOTTOM]
        return found[0] if found and self.n_steps == 1 else -1

    def variable_at(self, number: int) -> int:
        """Byte at which the record of a variable begins in the first step."""
        return self.steps_at + 2 * MARK + self.size + number * self.record

    def coordinates(self, buffer: Any) -> npt.NDArray[Any]:
        """View x and y of a file, (2, n_points)."""
        return self._view(buffer, self.x_at, 2, self.record, self.n_points)

    def variable(self, buffer: Any, number: int) -> npt.NDArray[Any]:
        """View a variable, (n_steps, n_points)."""
        return self._view(buffer, self.variable_at(number), self.n_steps, self.step, self.n_points)

    def times(self, buffer: Any) -> npt.NDArray[Any]:
        """View the times, (n_steps, 1)."""
        return self._view(buffer, self.steps_at, self.n_steps, self.step, 1)

    def marks(self, buffer: Any) -> list[tuple[int, npt.NDArray[Any]]]:
        """View the lengths around all records of reals, each kind with what they must be."""
        rows = [
            (self.x_at, 2, self.record, self.n_points),
            (self.steps_at, self.n_steps, self.step, 1),
        ]
        rows += [
            (self.variable_at(number), self.n_steps, self.step, self.n_points)
            for number in range(len(self.names))
        ]
        kind = np.dtype(self.order + "i4")
        return [
            (
                self.size * n,
                np.ndarray((count, 2), kind, buffer, at, (stride, MARK + self.size * n)),
            )
            for at, count, stride, n in rows
            if count
        ]

    def _view(self, buffer: Any, at: int, n_rows: int, stride: int, n: int) -> npt.NDArray[Any]:
        kind = np.dtype(f"{self.order}f{self.size}")
        if n_rows == 0:
            return np.empty((0, n), kind)
        return np.ndarray((n_rows, n), kind, buffer, at + MARK, (stride, self.size))


class _Records:
    """Reads records from the front."""

    def __init__(self, data: bytes | bytearray) -> None:
        self.data, self.order, self.pos = data, order_of(data), 0
        if not self.order:
            raise MeshError(f"byte 0: the record of a title, of {TITLE} bytes, expected")

    def next(self, length: int, what: str) -> int:
        """Byte at which the content of the next record begins, which must be so long."""
        begin = self.pos + MARK
        found = self.peek()
        tail = self.data[begin + length : begin + length + MARK]
        if found != length or tail != self.data[self.pos : begin]:
            raise MeshError(
                f"byte {self.pos}: {what}, a record of {length} bytes, expected; "
                + (f"found one of {found}" if found != length else "it is cut off or too long")
            )
        self.pos = begin + length + MARK
        return begin

    def peek(self) -> int:
        """Length of the next record, -1 at the end."""
        mark = self.data[self.pos : self.pos + MARK]
        if len(mark) < MARK:
            return -1
        return int.from_bytes(mark, "little" if self.order == "<" else "big", signed=True)

    def integers(self, n: int, what: str) -> list[int]:
        """Integers that fill the next record."""
        begin = self.next(4 * n, what)
        found: list[int] = np.frombuffer(self.data, self.order + "i4", n, begin).tolist()
        return found


def layout_of(data: bytes | bytearray) -> Layout:
    """Find the parts of a file, and check every record.

    Raises
    ------
    MeshError
        Naming the byte of what is wrong.
    """
    records = _Records(data)
    records.next(TITLE, "the title")
    counts = records.integers(2, "the numbers of variables")
    if min(counts) < 0 or sum(counts) * (VARIABLE + 2 * MARK) > len(data):
        raise MeshError(f"byte {records.pos}: there cannot be {sum(counts)} variables")
    names = []
    for _ in range(sum(counts)):
        begin = records.next(VARIABLE, "the name of a variable")
        names.append(data[begin : begin + LABEL].decode("latin-1").strip(" \0"))
    parameters = records.integers(10, "the parameters")
    if parameters[PLANES] > 1:
        raise MeshError(f"the file is 3D, of {parameters[PLANES]} planes; only 2D can be smoothed")
    extras = []
    if any(parameters[ORIGIN]):
        extras.append(f"the origin of coordinates, {parameters[ORIGIN]}")
    if parameters[DATE] == 1:
        records.integers(6, "the date")
        extras.append("the date")
    n_cells, n_points, n_corners, _ = records.integers(4, "the numbers of elements and points")
    if n_corners not in KINDS or min(n_cells, n_points) < 1:
        raise MeshError(
            f"byte {records.pos}: {n_cells} elements of {n_corners} nodes, {n_points} points"
        )
    cells_at = records.next(4 * n_cells * n_corners, "the nodes of elements")
    records.next(4 * n_points, "the numbers on the boundary")
    size = 8 if records.peek() == 8 * n_points else 4
    kind = KINDS[n_corners]
    layout = Layout(
        records.order,
        size,
        _unique(names),
        n_points,
        kind,
        n_cells,
        cells_at,
        records.pos,
        0,
        tuple(extras),
    )
    records.next(size * n_points, "x")
    records.next(size * n_points, "y")
    n_steps, rest = divmod(len(data) - layout.steps_at, layout.step)
    layout = replace(layout, n_steps=n_steps)
    if rest:
        raise MeshError(f"byte {layout.end}: the file ends within time step {n_steps + 1}")
    for length, marks in layout.marks(data):
        wrong = np.flatnonzero((marks != length).any(axis=1))
        if wrong.size:
            raise MeshError(f"a record of {length} bytes expected in time step {wrong[0] + 1}")
    return layout


def _unique(names: list[str]) -> tuple[str, ...]:
    """Names, with a number behind those that come again."""
    found: dict[str, None] = {}
    seen: Counter[str] = Counter()
    for name in names:
        unique = name
        while unique in found:
            seen[name] += 1
            unique = f"{name} ({seen[name] + 1})"
        found[unique] = None
    return tuple(found)
