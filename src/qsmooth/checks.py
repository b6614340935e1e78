"""What comes in as a mesh is checked here, once: points, cells, fixed vertices, regions."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt

from qsmooth._types import BoolArray, FloatArray, IndexArray
from qsmooth.errors import MeshError

A = TypeVar("A", bound=npt.NDArray[Any])

# Products of four coordinates must not overflow, nor those of a mesh's lengths vanish.
LARGEST_COORDINATE = 1e75
SMALLEST_DIAMETER = 1e-75


def require_vertices(points: FloatArray, n: int) -> None:
    """Raise a ValueError where points, (m, ...), are not those of `n` vertices."""
    if len(points) != n:
        raise ValueError(f"{len(points)} vertices for a mesh that has {n}")


def read_only(array: A) -> A:
    """View an array that can't be written to."""
    view = array.view()
    view.flags.writeable = False
    return view


def all_read_only(value: Any) -> Any:
    """View an array, or those in a tuple, such that they can't be written to."""
    if isinstance(value, np.ndarray):
        return read_only(value)
    return tuple(map(all_read_only, value)) if isinstance(value, tuple) else value


def checked_points(points: npt.ArrayLike) -> FloatArray:
    """Copy coordinates as float64, (n, 2) or (n, 3); MeshError where they are none."""
    try:
        if np.iscomplexobj(points):
            raise TypeError("they are complex")
        array = np.array(points, dtype=np.float64, order="C")
    except (TypeError, ValueError) as error:
        raise MeshError(f"points must be numbers in an (n, 2) or (n, 3) array: {error}") from None
    if array.size == 0 and array.ndim < 3:
        raise MeshError("the mesh is empty: it has no vertices")
    if array.ndim != 2 or array.shape[1] not in (2, 3):
        raise MeshError(f"points must have the shape (n, 2) or (n, 3), got {array.shape}")
    # By columns, and point by point only where something is wrong: reductions of rows of two are
    # ten times as slow.
    columns = list(array.T)
    lows, highs = [float(c.min()) for c in columns], [float(c.max()) for c in columns]
    if not np.isfinite(lows + highs).all():
        raise MeshError(_count(~np.isfinite(array).all(axis=1), "not finite"))
    spans = np.ptp(np.clip([lows, highs], -LARGEST_COORDINATE, LARGEST_COORDINATE), axis=0)
    diameter = float(np.linalg.norm(spans))
    if 0.0 < diameter < SMALLEST_DIAMETER:
        raise MeshError(f"the mesh is {diameter:.3g} across, where areas vanish: scale it up")
    if max(map(abs, lows + highs)) > LARGEST_COORDINATE:
        bad = (np.abs(array) > LARGEST_COORDINATE).any(axis=1)
        raise MeshError(_count(bad, f"beyond {LARGEST_COORDINATE:g}, where areas overflow"))
    return array


def _count(bad: Any, what: str) -> str:
    n, first = int(bad.sum()), int(np.argmax(bad))
    return f"{counted(n, 'vertex is', 'vertices are')} {what}, the first is vertex {first}"


def counted(n: int, one: str, many: str) -> str:
    """Count offenders, with their verb: "1 vertex is", "3 vertices are"."""
    return f"{n} {one if n == 1 else many}"


def checked_blocks(cells: npt.ArrayLike | Sequence[npt.ArrayLike]) -> list[IndexArray]:
    """Copy cells as int64 blocks of one width each, (m, 3) or (m, 4), empty ones left out."""
    blocks = [_checked_block(block, name) for block, name in _split_blocks(cells)]
    return [block for block in blocks if len(block)]


def _split_blocks(cells: Any) -> Iterable[tuple[Any, str]]:
    """One array, a list of rows, or a list of arrays."""
    if isinstance(cells, np.ndarray):
        return [(cells, "cells")]
    try:
        blocks = list(cells)
    except TypeError:
        raise MeshError(
            f"cells must be an integer array or a list of them, got {type(cells).__name__}"
        ) from None
    if any(np.ndim(row) != 1 for block in blocks[:1] for row in _rows(block)):
        return [(cells, "cells")]  # a list of rows, or something that is refused as such
    return [(block, f"cells[{k}]") for k, block in enumerate(blocks)]


def _rows(block: Any) -> list[Any]:
    try:
        return list(block[:1])
    except TypeError:
        return [block]


def _checked_block(block: Any, name: str) -> IndexArray:
    try:
        array = np.asarray(block)
    except ValueError:
        raise MeshError(f"{name} must be an (m, 3) or (m, 4) integer array: rows differ") from None
    if array.size == 0:
        return np.empty((0, 4), np.int64)
    if array.ndim != 2 or array.shape[1] not in (3, 4):
        what = f"{array.shape[1]}-vertex cells" if array.ndim == 2 else f"the shape {array.shape}"
        raise MeshError(f"{name} must be an (m, 3) or (m, 4) integer array, got {what}")
    if array.dtype.kind not in "iu":
        raise MeshError(f"{name} must hold integers, got {array.dtype}")
    if array.dtype == np.uint64 and array.max() > np.iinfo(np.int64).max:
        raise MeshError(f"{name} has a vertex id beyond 64 bits: {array.max()}")
    return np.array(array, dtype=np.int64, order="C")


def checked_fixed(fixed: npt.ArrayLike | None, n_vertices: int) -> BoolArray | None:
    """Take a mask or vertex ids as a mask, (n_vertices,)."""
    if fixed is None:
        return None
    array = np.asarray(fixed)
    if array.dtype == np.bool_:
        if array.shape != (n_vertices,):
            raise MeshError(f"a fixed mask must have the shape ({n_vertices},), got {array.shape}")
        return array.copy()
    mask = np.zeros(n_vertices, np.bool_)
    if array.shape == (n_vertices,) and n_vertices > 2 and np.isin(array, (0, 1)).all():
        raise MeshError(
            "fixed looks like a mask of 0 and 1: give booleans, or a list of vertex ids"
        )
    if array.size:
        if array.dtype.kind not in "iu" or array.ndim != 1:
            raise MeshError("fixed must be a boolean mask or a list of vertex ids")
        bad = (array < 0) | (array >= n_vertices)
        if bad.any():
            count = counted(int(bad.sum()), "id in fixed is", "ids in fixed are")
            raise MeshError(
                f"{count} outside 0 .. {n_vertices - 1}, the first is {array[np.argmax(bad)]}"
            )
        mask[array.astype(np.int64)] = True
    return mask


def checked_regions(regions: npt.ArrayLike | None, n_cells: int) -> IndexArray | None:
    """Copy region ids, (n_cells,)."""
    if regions is None:
        return None
    array = np.asarray(regions)
    if array.shape != (n_cells,) or array.dtype.kind not in "iub":
        raise MeshError(
            f"regions must be {n_cells} integers, one for each cell, "
            f"got {array.dtype} of the shape {array.shape}"
        )
    return np.array(array, dtype=np.int64)
