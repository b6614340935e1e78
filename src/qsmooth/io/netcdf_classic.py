"""The classic form of NetCDF files: versions 1, 2 (64-bit offsets) and 5 (64-bit data).

Read and written here, as the form is small and a damaged header then ends in a sentence; the C
library may go on for ever on one. Unidata, "NetCDF Classic Format Specification".
"""

from __future__ import annotations

import math
import struct
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from qsmooth.errors import MeshError
from qsmooth.io.netcdf_variable import Attributes

VERSIONS = (1, 2, 5)
TYPES = {1: ">i1", 2: "S1", 3: ">i2", 4: ">i4", 5: ">f4", 6: ">f8"}
TYPES |= {7: ">u1", 8: ">u2", 9: ">u4", 10: ">i8", 11: ">u8"}
CODES = {np.dtype(name): code for code, name in TYPES.items()}
DIMENSIONS, VARIABLES, ATTRIBUTES = 10, 11, 12
STREAMING = {4: 0xFFFFFFFF, 8: 0xFFFFFFFFFFFFFFFF}  # the number of records is not yet known
MOST_DIMENSIONS = 32  # NumPy has arrays of up to 64
# Version 1 has offsets of 32 bits, with a sign.
MOST_OFFSET = (1 << 31) - 1


@dataclass
class Stored:
    """A variable: names of its dimensions, attributes, and values as they stand in the file."""

    dims: tuple[str, ...]
    attributes: Attributes
    values: npt.NDArray[Any]


@dataclass
class Classic:
    """A whole file; `record` is the dimension that may grow, or None."""

    version: int
    dims: dict[str, int]
    attributes: Attributes
    variables: dict[str, Stored]
    record: str | None = None


def parse(data: bytes | bytearray) -> Classic:
    """Parse a header; values are views of `data`.

    Raises
    ------
    MeshError
        If the header is none, or names what lies behind the end of the file.
    """
    return _Header(data).content()


class _Header:
    """Reads the header from front to back."""

    def __init__(self, data: bytes | bytearray) -> None:
        self.data, self.pos = data, 4
        self.version = data[3]
        # Width of counts, and of the places where variables begin.
        self.count = 8 if self.version == 5 else 4
        self.offset = 4 if self.version == 1 else 8

    def content(self) -> Classic:
        n_records = self.number(self.count)
        dims = [(self.name(), self.number(self.count)) for _ in self.items(DIMENSIONS)]
        attributes = self.attributes()
        heads = [self.variable(dims) for _ in self.items(VARIABLES)]
        record = next((name for name, length in dims if length == 0), None)
        grows = {name for name, ids, *_ in heads if ids and dims[ids[0]][1] == 0}
        sizes = {
            name: _slab(dims, ids[1:] if name in grows else ids) * dtype.itemsize
            for name, ids, _, dtype, _ in heads
        }
        step = sum(_padded(sizes[name]) for name in grows)
        if len(grows) == 1:  # then it is not padded
            step = sum(sizes[name] for name in grows)
        if n_records == STREAMING[self.count]:
            first = min((begin for name, *_, begin in heads if name in grows), default=0)
            n_records = (len(self.data) - first) // step if step else 0
        variables = {}
        for name, ids, own, dtype, begin in heads:
            shape = [dims[i][1] for i in ids]
            if name in grows:
                shape[0] = n_records
            values = self.values(name, shape, dtype, begin, step if name in grows else 0)
            variables[name] = Stored(tuple(dims[i][0] for i in ids), own, values)
        lengths = {name: length or n_records for name, length in dims}
        return Classic(self.version, lengths, attributes, variables, record)

    def fail(self, what: str) -> MeshError:
        return MeshError(f"NetCDF header, byte {self.pos}: {what}")

    def number(self, width: int) -> int:
        end = self.pos + width
        if end > len(self.data):
            raise self.fail("the file ends too early")
        value = int.from_bytes(self.data[self.pos : end], "big")
        self.pos = end
        return value

    def items(self, tag: int) -> range:
        found, n = self.number(4), self.number(self.count)
        if found not in (0, tag) or (found == 0 and n):
            raise self.fail(f"list of kind {tag} expected, found {found}")
        if n * 8 > len(self.data) - self.pos:
            raise self.fail(f"a list of {n} does not fit into the file")
        return range(n)

    def raw(self, size: int) -> bytes:
        if size > len(self.data) - self.pos:
            raise self.fail(f"{size} bytes do not fit into the file")
        raw = bytes(self.data[self.pos : self.pos + size])
        self.pos += _padded(size)
        return raw

    def name(self) -> str:
        return self.raw(self.number(self.count)).decode("utf-8", "surrogateescape")

    def dtype(self) -> np.dtype[Any]:
        code = self.number(4)
        if code not in TYPES:
            raise self.fail(f"there is no type {code}")
        return np.dtype(TYPES[code])

    def attributes(self) -> Attributes:
        found: Attributes = {}
        for _ in self.items(ATTRIBUTES):
            name, dtype, n = self.name(), self.dtype(), self.number(self.count)
            raw = self.raw(n * dtype.itemsize)
            text = dtype.kind == "S"
            found[name] = raw.decode("utf-8", "surrogateescape") if text else np.frombuffer(
                raw, dtype
            )  # fmt: skip
        return found

    def variable(
        self, dims: list[tuple[str, int]]
    ) -> tuple[str, list[int], Attributes, np.dtype[Any], int]:
        name, n = self.name(), self.number(self.count)
        if n > MOST_DIMENSIONS:
            raise self.fail(f"variable {name!r} has {n} dimensions")
        ids = [self.number(self.count) for _ in range(n)]
        if any(i >= len(dims) or (k and dims[i][1] == 0) for k, i in enumerate(ids)):
            raise self.fail(f"variable {name!r} has wrong dimensions")
        own, dtype = self.attributes(), self.dtype()
        self.number(self.count)  # its size, which follows from the rest
        return name, ids, own, dtype, self.number(self.offset)

    def values(
        self, name: str, shape: list[int], dtype: np.dtype[Any], begin: int, step: int
    ) -> npt.NDArray[Any]:
        unit = math.prod(shape[1:]) if step else math.prod(shape)
        end = begin + (max(shape[0] - 1, 0) * step if step else 0) + unit * dtype.itemsize
        size: int = math.prod(shape)
        if size and end > len(self.data):
            raise MeshError(f"variable {name!r} ends behind the file, which is cut off")
        if not size:
            return np.empty(shape, dtype)
        strides = [dtype.itemsize * math.prod(shape[k + 1 :]) for k in range(len(shape))]
        if step:
            strides[0] = step
        return np.ndarray(tuple(shape), dtype, self.data, begin, tuple(strides))


def compose(content: Classic) -> bytes:
    """The bytes of a file; of a higher version where offsets ask for it."""
    version = content.version
    if version == 1 and _written(content, 2)[1] > MOST_OFFSET:
        version = 2
    head, end, begins = _written(content, version)
    data = bytearray(end)
    data[: len(head)] = head
    step = _record_size(content)
    for name, stored in content.variables.items():
        values = stored.values
        if not values.size:
            continue
        if _grows(content, stored):
            rows = values.reshape(len(values), -1)
            strides = (step, values.dtype.itemsize)
            np.ndarray(rows.shape, values.dtype, data, begins[name], strides)[...] = rows
        else:
            data[begins[name] : begins[name] + values.nbytes] = values.tobytes()
    return bytes(data)


def _written(content: Classic, version: int) -> tuple[bytes, int, dict[str, int]]:
    """Header, length of the file and where each variable begins."""
    count, offset = (">Q" if version == 5 else ">I"), (">I" if version == 1 else ">Q")

    def named(name: str) -> bytes:
        raw = name.encode("utf-8", "surrogateescape")
        return struct.pack(count, len(raw)) + raw.ljust(_padded(len(raw)), b"\0")

    def listed(tag: int, items: list[bytes]) -> bytes:
        return struct.pack(">I", tag if items else 0) + struct.pack(count, len(items)) + b"".join(
            items
        )  # fmt: skip

    def attributes(given: Attributes) -> bytes:
        rows = []
        for name, value in given.items():
            array = _attribute(value)
            raw = array.tobytes()
            head = named(name) + struct.pack(">I", CODES[array.dtype])
            rows.append(head + struct.pack(count, array.size) + raw.ljust(_padded(len(raw)), b"\0"))
        return listed(ATTRIBUTES, rows)

    names, record = list(content.dims), content.record
    dims = [
        named(name) + struct.pack(count, 0 if name == record else length)
        for name, length in content.dims.items()
    ]
    heads, sizes = {}, {}
    for name, stored in content.variables.items():
        sizes[name] = _padded(_unit(content, stored))
        ids = b"".join(struct.pack(count, names.index(dim)) for dim in stored.dims)
        heads[name] = (
            named(name) + struct.pack(count, len(stored.dims)) + ids
            + attributes(stored.attributes) + struct.pack(">I", CODES[stored.values.dtype])
            + struct.pack(count, min(sizes[name], 0xFFFFFFFF if version < 5 else sizes[name]))
        )  # fmt: skip
    n_records = content.dims[record] if record is not None else 0
    start = b"CDF" + bytes([version]) + struct.pack(count, n_records)
    start += listed(DIMENSIONS, dims) + attributes(content.attributes)
    width = struct.calcsize(offset)
    end = len(start) + 4 + struct.calcsize(count) + sum(len(h) + width for h in heads.values())
    begins = {}
    for growing in (False, True):
        for name, stored in content.variables.items():
            if _grows(content, stored) is growing:
                begins[name] = end
                end += sizes[name]
    step = _record_size(content)
    first = min((begins[n] for n, v in content.variables.items() if _grows(content, v)), default=0)
    if first:
        end = first + n_records * step
    rows = [head + struct.pack(offset, begins[n] & (256**width - 1)) for n, head in heads.items()]
    return start + listed(VARIABLES, rows), end, begins


def _attribute(value: Any) -> npt.NDArray[Any]:
    """An attribute as the file has it: text as bytes, numbers big-endian."""
    if isinstance(value, str):
        raw = value.encode("utf-8", "surrogateescape")
        return np.frombuffer(raw, "S1") if raw else np.empty(0, "S1")
    array = np.atleast_1d(value)
    return array.astype(array.dtype.newbyteorder(">"))


def _grows(content: Classic, stored: Stored) -> bool:
    return bool(stored.dims) and stored.dims[0] == content.record


def _unit(content: Classic, stored: Stored) -> int:
    """Bytes of all values, or of those of one record."""
    shape = stored.values.shape[1:] if _grows(content, stored) else stored.values.shape
    return math.prod(shape) * stored.values.dtype.itemsize


def _record_size(content: Classic) -> int:
    growing = [_unit(content, v) for v in content.variables.values() if _grows(content, v)]
    return growing[0] if len(growing) == 1 else sum(map(_padded, growing))


def _slab(dims: list[tuple[str, int]], ids: list[int]) -> int:
    return math.prod(dims[i][1] for i in ids)


def _padded(size: int) -> int:
    return size + -size % 4
