"""TELEMAC's Selafin: records of Fortran, in either byte order and precision, steps of variables."""

from __future__ import annotations

import warnings
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from qsmooth._types import BoolArray, FloatArray
from qsmooth.errors import MeshError, MeshWarning
from qsmooth.io.chains import boundary_numbers
from qsmooth.io.file_content import FileContent
from qsmooth.io.rounding import bears_single
from qsmooth.io.selafin_layout import (
    BOTTOM,
    LABEL,
    MARK,
    TITLE,
    Layout,
    layout_of,
    order_of,
)

NAME = "selafin"
ENDINGS = (".slf", ".sel", ".res")
HOLDS = frozenset(("level", "point_data"))

TAG = 8  # last bytes of the title, which tell the precision
SINGLE, DOUBLE = b"SERAFIN ", b"SERAFIND"
TIME = "time"


def sniff(head: bytes) -> bool:
    """Whether a file that starts so is Selafin."""
    return order_of(head) != "" and head[MARK + TITLE : 2 * MARK + TITLE] == head[:MARK]


def read(data: bytes) -> FileContent:
    """Read Selafin; a bed known at one step is z, variables are data of points, a column a step."""
    layout = layout_of(data)
    points = layout.coordinates(data).T.astype(np.float64)
    if layout.bottom >= 0:
        points = np.column_stack((points, layout.variable(data, layout.bottom)[0]))
    point_data, data_slots = {}, {}
    for number, name in enumerate(layout.names if layout.n_steps else ()):
        if number != layout.bottom:
            table = layout.variable(data, number).T.astype(f"f{layout.size}", order="C")
            point_data[name] = table[:, 0] if layout.n_steps == 1 else table
            data_slots[name] = VariableSlots(number)
    times = layout.times(data)[:, 0].astype(np.float64)
    return FileContent(
        np.ascontiguousarray(points, np.float64),
        [(layout.kind, layout.cells(data))],
        point_data=point_data,
        field_data={TIME: times} if times.size > 1 or times.any() else {},
        fields=tuple(point_data),
        extras=layout.extras,
        z_means="height",
        slots=PointSlots(),
        data_slots=dict(data_slots),
    )


@dataclass(frozen=True)
class PointSlots:
    """Writes coordinates, and the bed, back into a file.

    A file of single precision gets them rounded. Where that would make a valid cell invalid, or the
    worst corner worse than the file's was, all of the file becomes double.
    """

    def write(self, data: bytes, old: FloatArray, new: FloatArray) -> bytes:
        """The bytes of the file with the coordinates that changed, and nothing else, replaced."""
        n_coordinates = min(old.shape[1], new.shape[1])
        moved = _differ(old[:, :n_coordinates], new[:, :n_coordinates])
        if not moved.any():
            return data
        layout = layout_of(data)
        xy = new[:, :2]
        if layout.size == 4 and not (
            _is_single(xy) or bears_single(old[:, :2], xy, [layout.cells(data)])
        ):
            _say_double()
            data, layout = _widened(data, layout)
        buffer = bytearray(data)
        rows = [*layout.coordinates(buffer)]
        if layout.bottom >= 0:
            rows.append(layout.variable(buffer, layout.bottom)[0])
        with np.errstate(over="ignore"):
            for column, row in enumerate(rows[:n_coordinates]):
                row[moved[:, column]] = new[moved[:, column], column]
        return bytes(buffer)


@dataclass(frozen=True)
class VariableSlots:
    """Writes a variable back into a file, in the precision of the file."""

    number: int
    steady: ClassVar[bool] = True

    def write(self, data: bytes, old: FloatArray, new: FloatArray) -> bytes:
        """The bytes of the file with the values that changed, and nothing else, replaced.

        A bytearray, as the last variable gave it, is changed itself: files have many variables.
        """
        moved = _differ(old, new)
        buffer = data if isinstance(data, bytearray) else bytearray(data)
        view = layout_of(buffer).variable(buffer, self.number)
        # Whole tables: by a mask, a byte order that is not the machine's takes ten times as long.
        with np.errstate(over="ignore"):
            view[:] = np.where(moved.T, new.T.astype(view.dtype), view)
        return buffer  # type: ignore[return-value]


def _differ(old: FloatArray, new: FloatArray) -> BoolArray:
    """Where numbers have other bits."""
    a, b = np.ascontiguousarray(old), np.ascontiguousarray(new)
    differ: BoolArray = a.view(np.int64) != b.view(np.int64)
    return differ


def _is_single(values: FloatArray) -> bool:
    with np.errstate(over="ignore"):
        return bool((values.astype(np.float32) == values).all())


def _say_double() -> None:
    warnings.warn(
        "the Selafin file is in double precision (SERAFIND), as rounding to single could make "
        "cells invalid: TELEMAC needs GEOMETRY FILE FORMAT = 'SERAFIND' to read it",
        MeshWarning,
        stacklevel=5,
    )


def _widened(data: bytes, layout: Layout) -> tuple[bytes, Layout]:
    """The same file in double precision."""
    wide = replace(layout, size=8)
    title = data[: MARK + TITLE - TAG] + DOUBLE
    buffer = bytearray(title + data[len(title) : layout.x_at])
    buffer += bytes(wide.end - len(buffer))
    _fill_marks(buffer, wide)
    wide.coordinates(buffer)[:] = layout.coordinates(data)
    wide.times(buffer)[:] = layout.times(data)
    for number in range(len(layout.names)):
        wide.variable(buffer, number)[:] = layout.variable(data, number)
    return bytes(buffer), wide


def _fill_marks(buffer: bytearray, layout: Layout) -> None:
    for length, marks in layout.marks(buffer):
        marks[:] = length


def write(content: FileContent) -> bytes:
    """Write Selafin, big-endian; of single precision where that holds the coordinates.

    Raises
    ------
    MeshError
        If there are triangles and quads: the format has cells of one size.
    """
    faces = [cells for cells, _ in content.counter_clockwise()]
    n_quads, n_triangles = (sum(len(c) for c in faces if c.shape[1] == n) for n in (4, 3))
    if n_quads and n_triangles:
        raise MeshError(
            "a file of format selafin holds triangles or quads, "
            f"the mesh has {n_triangles} triangles and {n_quads} quads"
        )
    cells = np.concatenate(faces)
    n = len(content.points)
    times, tables = _variables(content)
    size = 4 if _is_single(content.points[:, :2]) else 8
    if size == 8:
        _say_double()
    head = [b"mesh".ljust(TITLE - TAG) + (SINGLE if size == 4 else DOUBLE)]
    head.append(_integers(len(tables), 0))
    head += [_label(name) for name in tables]
    head.append(_integers(1, *[0] * 9))
    head.append(_integers(len(cells), n, cells.shape[1], 1))
    head.append((cells + 1).astype(">i4").tobytes())
    head.append(boundary_numbers(content).astype(">i4").tobytes())
    marks = [len(part).to_bytes(MARK, "big") for part in head]
    buffer = bytearray(b"".join(m + part + m for m, part in zip(marks, head, strict=True)))
    layout = Layout(">", size, tuple(tables), n, "", len(cells), 0, len(buffer), len(times))
    buffer += bytes(layout.end - len(buffer))
    _fill_marks(buffer, layout)
    layout.coordinates(buffer)[:] = content.points[:, :2].T
    layout.times(buffer)[:, 0] = times
    with np.errstate(over="ignore"):
        for number, table in enumerate(tables.values()):
            layout.variable(buffer, number)[:] = table
    return bytes(buffer)


def _integers(*values: int) -> bytes:
    return np.array(values, ">i4").tobytes()


def _label(name: str) -> bytes:
    unit = "M" if name in BOTTOM else ""
    return f"{name[:LABEL]:<{LABEL}}{unit:<{LABEL}}".encode("latin-1", "replace")


def _variables(content: FileContent) -> tuple[FloatArray, dict[str, FloatArray]]:
    """Times, and of each variable a row for each step or one for all; what they say is kept."""
    others = dict(content.field_data)
    times = np.asarray(others.get(TIME, 0.0), np.float64).ravel()
    data = {name: np.asarray(values) for name, values in content.point_data.items()}
    in_steps = {name for name, a in data.items() if a.ndim == 2 and a.shape[1] == times.size > 1}
    if in_steps or times.size == 1:
        others.pop(TIME, None)
    else:
        times = np.zeros(1)
    content.field_data = others
    tables: dict[str, FloatArray] = {}
    if content.plain_points.shape[1] == 3 or (content.z_means and content.points.shape[1] == 3):
        tables[BOTTOM[0]] = content.z("height")[None]
    lost = {}
    for name, array in data.items():
        if array.dtype.kind not in "fiub":
            lost[name] = content.point_data[name]
        elif name in in_steps:
            tables[_unique(name, tables)] = array.T
        else:
            columns = array.reshape(len(array), -1).T
            for k, column in enumerate(columns, start=1):
                label = name if len(columns) == 1 else f"{name[: LABEL - 2]} {k}"
                tables[_unique(label, tables)] = column[None]
    content.point_data = lost or content.point_data
    return times, tables


def _unique(name: str, tables: dict[str, FloatArray]) -> str:
    """A name of at most 16 letters that no other variable has."""
    found, number = name[:LABEL], 1
    while found in tables:
        number += 1
        found = f"{name[: LABEL - len(str(number))]}{number}"
    return found
