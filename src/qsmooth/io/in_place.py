"""Writing coordinates back into the bytes they came from."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from qsmooth._types import FloatArray, IndexArray

Edit = tuple[int, int, bytes]


class InPlace(Protocol):
    """What can write coordinates back into the bytes they came from.

    An attribute ``steady`` that is True says that it holds, too, where others have been written.
    """

    def write(self, data: bytes, old: FloatArray, new: FloatArray) -> bytes:
        """The bytes of the file with the coordinates that changed, and nothing else, replaced."""
        ...


@dataclass
class Slots:
    """Where the coordinates stand in a file.

    Parameters
    ----------
    starts, ends : (n_vertices, n_coordinates)
        Bytes of each coordinate.
    dtype
        How a coordinate is stored; None for text.
    widen
        Edits of the header that declare the coordinates to be of double precision, for a file
        that declares less: made as soon as a vertex has moved.
    keeps_type
        Whether numbers are rounded to the type that is declared: of data, which can't get invalid.
    columns
        Whether the text is of fixed columns: a slot is then a column, blanks included, that a
        number fills from the right, written as Fortran does.
    """

    starts: IndexArray
    ends: IndexArray
    dtype: np.dtype[np.generic] | None = None
    widen: tuple[Edit, ...] = ()
    keeps_type: bool = False
    columns: bool = False

    def write(self, data: bytes, old: FloatArray, new: FloatArray) -> bytes:
        """The bytes of the file with the coordinates that changed, and nothing else, replaced."""
        n_coordinates = min(self.starts.shape[1], new.shape[1])
        old, new = old[:, :n_coordinates], np.ascontiguousarray(new[:, :n_coordinates])
        # Compared as bits: -0.0 is not 0.0.
        moved = np.ascontiguousarray(old).view(np.int64) != new.view(np.int64)
        if not moved.any():
            return data
        dtype = self.dtype
        if dtype is not None and dtype.itemsize < 8 and not self.keeps_type:
            dtype = np.dtype(dtype.str[0] + "f8")
            moved[:] = True  # all of them change their size
        starts = self.starts[:, :n_coordinates][moved]
        ends = self.ends[:, :n_coordinates][moved]
        if self.columns:
            widths = (ends - starts).tolist()
            values = zip(new[moved].tolist(), widths, strict=True)
            tokens = [f"{x:.16E}".rjust(width).encode() for x, width in values]
        elif dtype is None:
            tokens = [repr(x).encode() for x in new[moved].tolist()]
        else:
            raw, size = new[moved].astype(dtype).tobytes(), dtype.itemsize
            tokens = [raw[i : i + size] for i in range(0, len(raw), size)]
        edits = list(zip(starts.tolist(), ends.tolist(), tokens, strict=True))
        return replace(data, [*self.widen, *edits])


@dataclass
class Copies:
    """Slots of a file that has the place of a vertex several times.

    Parameters
    ----------
    slots
        One for each copy.
    vertices : (n_copies,)
        Whose place each is.
    """

    slots: Slots
    vertices: IndexArray

    def write(self, data: bytes, old: FloatArray, new: FloatArray) -> bytes:
        """The bytes of the file with the coordinates that changed, and nothing else, replaced."""
        return self.slots.write(data, old[self.vertices], new[self.vertices])


def joined(parts: Sequence[Slots]) -> Slots:
    """Slots of several stretches of vertices as one."""
    starts = np.concatenate([part.starts for part in parts])
    ends = np.concatenate([part.ends for part in parts])
    widen = tuple(edit for part in parts for edit in part.widen)
    return Slots(starts, ends, parts[0].dtype, widen, parts[0].keeps_type, parts[0].columns)


def binary_slots(
    first: int, n_vertices: int, dtype: np.dtype[np.generic], stride: int, n_coordinates: int = 3
) -> Slots:
    """Slots of coordinates that stand one after the other, a vertex each `stride` bytes."""
    rows = first + stride * np.arange(n_vertices, dtype=np.int64)
    starts = rows[:, None] + dtype.itemsize * np.arange(n_coordinates)
    return Slots(starts, starts + dtype.itemsize, dtype)


def replace(data: bytes, edits: list[Edit]) -> bytes:
    """Put new bytes in place of others; edits may come in any order but must not overlap."""
    edits.sort(key=lambda edit: edit[0])
    begins = [0, *(end for _, end, _ in edits)]
    stops = [*(start for start, _, _ in edits), len(data)]
    pieces = [b""] * (2 * len(edits) + 1)
    pieces[0::2] = [data[a:b] for a, b in zip(begins, stops, strict=True)]
    pieces[1::2] = [new for _, _, new in edits]
    return b"".join(pieces)
