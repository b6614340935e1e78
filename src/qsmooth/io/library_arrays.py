"""Coordinates of Exodus and MED files, which meshio reads, written back where they stand."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from qsmooth._types import FloatArray
from qsmooth.io.apart import apart
from qsmooth.io.in_place import InPlace
from qsmooth.io.netcdf import rewritten, variables

# The library of the extra io that meshio asks for each of these formats.
LIBRARIES = {"exodus": "netCDF4", "med": "h5py", "cgns": "h5py", "h5m": "h5py", "hmf": "h5py"}


@dataclass
class Arrays(InPlace):
    """Arrays in a file with the coordinates, in an order that `order` names.

    Parameters
    ----------
    names
        One array, or one for each coordinate.
    order
        ``"each"``, an array a coordinate; ``"rows"``, a row each; ``"flat"``, one after the other.
    """

    names: tuple[str, ...]
    order: str

    def write(self, data: bytes, old: FloatArray, new: FloatArray) -> bytes:
        """See `InPlace`."""
        if np.array_equal(old.view(np.int64), np.ascontiguousarray(new).view(np.int64)):
            return data
        written: bytes = apart(f"{__name__}:put", len(data), data, self, new)
        return written

    def values(self, points: FloatArray) -> dict[str, FloatArray]:
        """What stands in each array."""
        if self.order == "each":
            return {name: points[:, k] for k, name in enumerate(self.names)}
        columns = points.T if self.order == "rows" else points.T.ravel()
        return {self.names[0]: np.ascontiguousarray(columns)}


def put(data: bytes, slots: Arrays, points: FloatArray) -> bytes:
    """The bytes with other coordinates."""
    return rewritten(data, slots.values(points), frozenset(slots.names))


def find_arrays(data: bytes, name: str, points: FloatArray) -> Arrays | None:
    """Where a file has these coordinates; None where it has them in no way that is known."""
    if name == "exodus":
        return _of_exodus(data, points)
    return _of_med(data, points) if name == "med" else None


def _of_exodus(data: bytes, points: FloatArray) -> Arrays | None:
    found, _ = variables(data)
    each = tuple(name for name in ("coordx", "coordy", "coordz") if name in found)
    if "coord" not in found and points[:, len(each) :].any():
        return None  # meshio adds a z of 0
    slots = Arrays(("coord",), "rows") if "coord" in found else Arrays(each, "each")
    there = {name: found[name].values() for name in slots.names if name in found}
    return slots if _are_the_same(there, slots.values(points)) else None


def _of_med(data: bytes, points: FloatArray) -> Arrays | None:
    import io

    import h5py

    with h5py.File(io.BytesIO(data), "r") as file:
        for mesh in file["ENS_MAA"].values():
            steps = [mesh] if "NOE" in mesh else list(mesh.values())
            for step in steps:
                place = f"{step.name}/NOE/COO"
                slots = Arrays((place,), "flat")
                if place in file and _are_the_same({place: file[place][()]}, slots.values(points)):
                    return slots
    return None


def _are_the_same(there: dict[str, Any], wanted: dict[str, FloatArray]) -> bool:
    return there.keys() == wanted.keys() and all(
        np.array_equal(there[name], wanted[name]) for name in wanted
    )
