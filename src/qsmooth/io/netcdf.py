"""NetCDF files as variables with dimensions and attributes, whichever of the two forms they have.

The classic form is read and written by `netcdf_classic`; NetCDF-4 files are HDF5, for which
`netcdf_hdf5` asks h5py: it reads from memory, tells where values stand, and bears damage.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from qsmooth.io.netcdf_classic import VERSIONS, compose, parse
from qsmooth.io.netcdf_variable import Attributes, Variable, widened

HDF5 = b"\x89HDF\r\n\x1a\n"


def is_netcdf(head: bytes) -> bool:
    """Whether a file that begins so is NetCDF, or HDF5 that may be."""
    return head[:8] == HDF5 or (head[:3] == b"CDF" and head[3:4] in map(bytes, zip(VERSIONS)))


def variables(data: bytes) -> tuple[dict[str, Variable], Attributes]:
    """The variables of a file, by name, and its own attributes.

    Raises
    ------
    MeshError
        If it is damaged, or h5py is needed and not there.
    """
    if data[:8] == HDF5:
        from qsmooth.io.netcdf_hdf5 import hdf5_variables

        return hdf5_variables(data)
    content = parse(data)
    found = {
        name: Variable(
            name,
            stored.dims,
            stored.values.shape,
            stored.values.dtype.newbyteorder("="),
            stored.attributes,
            lambda values=stored.values: values.astype(values.dtype.newbyteorder("=")),  # type: ignore[misc]
        )
        for name, stored in content.variables.items()
    }
    return found, content.attributes


def rewritten(
    data: bytes, values: Mapping[str, npt.NDArray[Any]], widen: frozenset[str] = frozenset()
) -> bytes:
    """The bytes of a file in which variables have other values of the same shape.

    Parameters
    ----------
    values
        By the variable's name.
    widen
        Those of these that are stored as float64 from now on, if they are floats of less.
    """
    if data[:8] == HDF5:
        from qsmooth.io.netcdf_hdf5 import hdf5_rewritten

        return hdf5_rewritten(data, values, widen)
    copy = bytearray(data)
    content = parse(copy)
    wide = False
    for name, new in values.items():
        stored = content.variables[name]
        if name in widen and stored.values.dtype.kind == "f" and stored.values.dtype.itemsize < 8:
            stored.values = np.asarray(new, ">f8")
            widened(stored.attributes)
            wide = True
        else:
            stored.values[...] = new
    return compose(content) if wide else bytes(copy)
