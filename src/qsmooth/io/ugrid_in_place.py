"""What changes in a UGRID file where vertices move."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any, ClassVar, TypeAlias

import numpy as np
import numpy.typing as npt

from qsmooth._types import FloatArray, IndexArray
from qsmooth.errors import MeshWarning
from qsmooth.io.apart import apart
from qsmooth.io.in_place import InPlace
from qsmooth.io.netcdf import HDF5, rewritten, variables
from qsmooth.io.netcdf_variable import Variable

Rule: TypeAlias = Callable[[FloatArray, IndexArray, IndexArray], FloatArray]

# Coordinates are taken for a mean or a centroid if none is farther off, as a share of its face.
CLOSE = 1e-4


@dataclass
class Derived:
    """Coordinates that belong to faces or edges, and may follow from those of the nodes.

    Parameters
    ----------
    names
        Variables of x and y.
    bounds
        Variables with x and y of all corners, or ().
    nodes : (n, k)
        Nodes of each; those beyond `counts`, (n,), stand for none.
    """

    names: tuple[str, str]
    bounds: tuple[str, ...]
    nodes: IndexArray
    counts: IndexArray


@dataclass
class NodeCoordinates(InPlace):
    """Variables of x and y of the nodes, and of what follows from them."""

    names: tuple[str, str]
    derived: tuple[Derived, ...]

    def write(self, data: bytes, old: FloatArray, new: FloatArray) -> bytes:
        """See `InPlace`. What does not follow from the nodes is kept, with a warning."""
        if np.array_equal(old.view(np.int64), np.ascontiguousarray(new).view(np.int64)):
            return data
        call = partial(apart, f"{__name__}:moved", len(data)) if data[:8] == HDF5 else moved
        fresh, kept = call(data, self, old, new)
        if kept:
            warnings.warn(
                f"{', '.join(kept)} are neither means nor centroids of their nodes: they stay "
                "as they were",
                MeshWarning,
                stacklevel=4,
            )
        written: bytes = fresh
        return written


@dataclass
class Values(InPlace):
    """A variable with a value, or several, for each node, whose dimension is at `axis`."""

    name: str
    axis: int
    steady: ClassVar[bool] = True

    def write(self, data: bytes, old: FloatArray, new: FloatArray) -> bytes:
        """See `InPlace`."""
        call = partial(apart, f"{__name__}:changed", len(data)) if data[:8] == HDF5 else changed
        written: bytes = call(data, self, old, new)
        return written


def moved(
    data: bytes, slots: NodeCoordinates, old: FloatArray, new: FloatArray
) -> tuple[bytes, list[str]]:
    """The bytes with other coordinates, and the names of those that are kept."""
    found, _ = variables(data)
    values = {name: new[:, k] for k, name in enumerate(slots.names)}
    kept: list[str] = []
    for one in slots.derived:
        places = np.column_stack([found[name].values() for name in one.names])
        rule = _rule(places.astype(np.float64), old, one)
        if rule is None:
            kept += one.names
            continue
        before, after = (rule(xy, one.nodes, one.counts) for xy in (old, new))
        fresh = np.where((before != after).any(axis=1)[:, None], after, places)
        values |= {name: fresh[:, k] for k, name in enumerate(one.names)}
        for k, name in enumerate(one.bounds):
            table = found[name].values()
            values[name] = _corners(table, old[:, k], new[:, k], one)
    return rewritten(data, values, frozenset(slots.names)), kept


def changed(data: bytes, slots: Values, old: FloatArray, new: FloatArray) -> bytes:
    """The bytes with other values where they differ."""
    one = variables(data)[0][slots.name]
    table = np.moveaxis(one.values(), slots.axis, 0)
    differ = (old.view(np.int64) != np.ascontiguousarray(new).view(np.int64)).reshape(table.shape)
    fresh = new.reshape(table.shape).astype(table.dtype)
    fill = _fill(one)
    if fill is not None:
        fresh = np.where(np.isnan(fresh), fill, fresh)
    fresh = np.where(differ, fresh, table)
    return rewritten(data, {slots.name: np.moveaxis(fresh, 0, slots.axis)})


def decoded(one: Variable, values: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """Values with NaN where floats are the fill value."""
    fill = _fill(one)
    if fill is None or values.dtype.kind != "f":
        return values
    return np.where(values == fill, values.dtype.type(np.nan), values)


def _fill(one: Variable) -> Any:
    value = one.attributes.get("_FillValue")
    if value is None or isinstance(value, str):
        return None
    return np.ravel(value)[0].astype(one.dtype)


def mean(points: FloatArray, nodes: IndexArray, counts: IndexArray) -> FloatArray:
    """Means of the nodes of each face, or middles of edges."""
    real = np.arange(nodes.shape[1]) < counts[:, None]
    total: FloatArray = np.where(real[:, :, None], points[nodes], 0.0).sum(axis=1)
    return total / np.maximum(counts, 1)[:, None]


def centroid(points: FloatArray, nodes: IndexArray, counts: IndexArray) -> FloatArray:
    """Centroids of the areas of faces; means where an area is 0."""
    centre = mean(points, nodes, counts)
    area, moment = np.zeros(len(nodes)), np.zeros((len(nodes), 2))
    rows = np.arange(len(nodes))
    for k in range(nodes.shape[1]):
        following = np.where(k + 1 < counts, k + 1, 0) % nodes.shape[1]
        a, b = points[nodes[:, k]] - centre, points[nodes[rows, following]] - centre
        part = np.where(k < counts, a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0], 0.0)
        area += part
        moment += part[:, None] * (a + b) / 3.0
    flat = area == 0.0
    shift = np.where(flat[:, None], 0.0, moment / np.where(flat, 1.0, area)[:, None])
    return centre + shift


RULES: tuple[Rule, ...] = (mean, centroid)


def _rule(places: FloatArray, points: FloatArray, one: Derived) -> Rule | None:
    """The rule by which places were made; None if by none of those known."""
    if not (one.counts >= 2).all():
        return None
    corners = np.where(
        (np.arange(one.nodes.shape[1]) < one.counts[:, None])[:, :, None],
        points[one.nodes],
        points[one.nodes[:, :1]],
    )
    sizes = np.ptp(corners, axis=1).max(axis=1)
    for rule in RULES:
        off = np.abs(rule(points, one.nodes, one.counts) - places).max(axis=1)
        rounding = np.spacing(np.abs(places).max(axis=1).astype(np.float32)).astype(np.float64)
        if (off <= np.maximum(CLOSE * sizes, rounding)).all():
            return rule
    return None


def _corners(
    table: npt.NDArray[Any], old: FloatArray, new: FloatArray, one: Derived
) -> npt.NDArray[Any]:
    """A table of a coordinate of all corners: those of nodes that moved, where it had theirs."""
    real = np.arange(one.nodes.shape[1]) < one.counts[:, None]
    moved = real & (old[one.nodes] != new[one.nodes]) & np.isclose(table, old[one.nodes])
    return np.where(moved, new[one.nodes], table)
