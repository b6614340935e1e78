"""NetCDF-4 files, which are HDF5: datasets of the root group, dimensions by attached scales."""

from __future__ import annotations

import io
from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from qsmooth.errors import MeshError
from qsmooth.io.in_place import replace
from qsmooth.io.netcdf_variable import Attributes, Variable, widened
from qsmooth.io.vtu_blocks import MOST_MORE, MOST_TIMES

# What HDF5 and NetCDF keep for themselves.
HIDDEN = {"DIMENSION_LIST", "REFERENCE_LIST", "CLASS", "NAME", "_Netcdf4Dimid"}
HIDDEN |= {"_Netcdf4Coordinates", "_nc3_strict", "_NCProperties"}
NO_VARIABLE = "This is a netCDF dimension but not a netCDF variable"


def hdf5_variables(data: bytes) -> tuple[dict[str, Variable], Attributes]:
    """See `netcdf.variables`."""
    import h5py

    file = h5py.File(io.BytesIO(data), "r")
    room = MOST_TIMES * len(data) + MOST_MORE
    found = {}
    for name in file:
        dataset = file.get(name)
        if isinstance(dataset, h5py.Dataset) and dataset.dtype.kind in "fiuSOb":
            attributes = _attributes(dataset)
            if not _text(dataset.attrs.get("NAME", "")).startswith(NO_VARIABLE):
                found[name] = _variable(name, dataset, attributes, room)
    return found, _attributes(file)


def _variable(name: str, dataset: Any, attributes: Attributes, room: int) -> Variable:
    def values() -> npt.NDArray[Any]:
        sizes = (dataset.shape, dataset.chunks or ())
        if max(int(np.prod(size, dtype=float)) for size in sizes) * dataset.dtype.itemsize > room:
            raise MeshError(f"variable {name!r} says to be of shape {dataset.shape}")
        array = np.asarray(dataset[()])
        return array.astype(array.dtype.newbyteorder("="))

    return Variable(name, _dims(name, dataset), dataset.shape, dataset.dtype, attributes, values)


def _dims(name: str, dataset: Any) -> tuple[str, ...]:
    """Names of the dimensions; one without a scale has a name of its own."""
    if dataset.attrs.get("CLASS") is not None and dataset.ndim == 1:
        return (name,)  # it is the scale of its own dimension
    scales = [dimension.values() for dimension in dataset.dims]
    return tuple(
        scale[0].name.rsplit("/", 1)[-1] if len(scale) else f"{name}:{k}"
        for k, scale in enumerate(scales)
    )


def _attributes(thing: Any) -> Attributes:
    found: Attributes = {}
    for name in thing.attrs:
        if name not in HIDDEN:
            value = thing.attrs[name]
            array = np.asarray(value)
            found[name] = np.atleast_1d(value) if array.dtype.kind in "fiu" else _text(value)
    return found


def _text(value: Any) -> str:
    if isinstance(value, np.ndarray):
        value = value.flat[0] if value.size else ""
    return value.decode("utf-8", "replace") if isinstance(value, bytes) else str(value)


def hdf5_rewritten(
    data: bytes, values: Mapping[str, npt.NDArray[Any]], widen: frozenset[str]
) -> bytes:
    """See `netcdf.rewritten`; where values stand in one piece, no other byte changes."""
    import h5py

    edits, others = [], {}
    with h5py.File(io.BytesIO(data), "r") as file:
        for name, new in values.items():
            dataset = file[name]
            begin = dataset.id.get_offset()
            raw = np.asarray(new).astype(dataset.dtype).tobytes()
            old = b"" if begin is None else data[begin : begin + len(raw)]
            if (name in widen and _is_narrow(dataset)) or old != dataset[()].tobytes():
                others[name] = new
            else:
                edits.append((begin, begin + len(raw), raw))
    if not others:
        return replace(data, edits)
    buffer = io.BytesIO(replace(data, edits))
    with h5py.File(buffer, "r+") as file:
        for name, new in others.items():
            if name in widen and _is_narrow(file[name]):
                _widen(file, name)
            file[name][...] = new
    return buffer.getvalue()


def _is_narrow(dataset: Any) -> bool:
    return bool(dataset.dtype.kind == "f" and dataset.dtype.itemsize < 8)


def _widen(file: Any, name: str) -> None:
    """Put a dataset of float64 in the place of one of less, with all that belongs to it."""
    old = file[name]
    scales = [list(dimension.values()) for dimension in old.dims]
    attributes = dict(old.attrs)
    for dimension, attached in zip(old.dims, scales, strict=True):
        for scale in attached:
            dimension.detach_scale(scale)
    fill = attributes.get("_FillValue")
    filters = {"compression": old.compression, "compression_opts": old.compression_opts}
    filters |= {"shuffle": old.shuffle, "fletcher32": old.fletcher32}
    chunked = {"chunks": old.chunks, "maxshape": old.maxshape} if old.chunks else {}
    shape = old.shape
    del file[name]
    new = file.create_dataset(
        name, shape, "f8", fillvalue=None if fill is None else np.float64(np.ravel(fill)[0]),
        **chunked, **(filters if chunked else {}),
    )  # fmt: skip
    widened(attributes)
    for key in attributes.keys() - {"DIMENSION_LIST", "REFERENCE_LIST", "CLASS", "NAME"}:
        new.attrs[key] = attributes[key]
    for dimension, attached in zip(new.dims, scales, strict=True):
        for scale in attached:
            dimension.attach_scale(scale)
