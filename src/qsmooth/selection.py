"""Which cells to smooth: by number, or by a threshold on their quality, grown by rings."""

from __future__ import annotations

import operator
import re
from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt

from qsmooth._types import BoolArray
from qsmooth._words import did_you_mean
from qsmooth.mesh import Mesh
from qsmooth.metrics import METRICS, quality
from qsmooth.options import OptionError

_COMPARE: dict[str, Callable[[Any, Any], Any]] = {
    "<": operator.lt,
    "<=": operator.le,
    ">": operator.gt,
    ">=": operator.ge,
}
_IDS = re.compile(r"[\d\s,]*\d[\d\s,]*")
# What else options take than ids and masks.
OTHERWISE = {"selection": "a threshold", "fixed": "a condition"}
_THRESHOLD = re.compile(r"\s*([\w-]+)\s*(<=|>=|<|>)\s*(\S+)\s*")


def parse_threshold(text: str) -> tuple[str, str, float]:
    """Take a threshold such as ``"max_angle > 150"`` apart: metric, comparison, number.

    Raises
    ------
    OptionError
        If it does not read like that.
    """
    match = _THRESHOLD.fullmatch(text)
    if match is None or match[1].replace("-", "_") not in METRICS:
        near = "" if match is None else did_you_mean(match[1], METRICS)
        raise OptionError(
            "`selection` takes cell ids such as 3,7,12 or a threshold such as 'max_angle > 150' on "
            f"one of {', '.join(METRICS)}; got {text!r}{near}"
        )
    name, comparison, number = match.groups()
    try:
        return name.replace("-", "_"), comparison, float(number)
    except ValueError:
        raise OptionError(
            f"`selection` takes a threshold such as 'max_angle > 150', and {number!r} is no number"
        ) from None


def parse_selection(text: str) -> list[int] | str:
    """Take a selection in words: cell ids such as ``"3,7,12"``, or a threshold, which stays one.

    Raises
    ------
    OptionError
        If it is neither.
    """
    if _IDS.fullmatch(text):
        return [int(number) for number in re.split(r"[\s,]+", text.strip(" ,"))]
    parse_threshold(text)
    return text


def select_cells(mesh: Mesh, selection: npt.ArrayLike | str, rings: int = 0) -> BoolArray:
    """Mark the selected cells.

    Parameters
    ----------
    selection
        Cell ids, a boolean mask over the cells, or a threshold such as ``"max_angle > 150"`` or
        ``"scaled_jacobian <= 0.2"``, on any metric; a cell that it is not defined for stays out.
    rings
        How often the selection grows by all cells that share a vertex with it.

    Returns
    -------
    (n_cells,) bool

    Raises
    ------
    OptionError
        If `selection` is none of these, or has ids that are no cells.
    """
    if isinstance(selection, str):
        name, comparison, threshold = parse_threshold(selection)
        chosen: BoolArray = np.asarray(_COMPARE[comparison](quality(mesh)[name], threshold))
    else:
        chosen = marked(np.asarray(selection), mesh.n_cells, "cell", "selection")
    for _ in range(rings):
        touched = vertices_of(mesh, chosen)
        chosen = np.logical_or.reduceat(touched[mesh.cell_vertices], mesh.cell_offsets[:-1])
    return chosen


def vertices_of(mesh: Mesh, cells: BoolArray) -> BoolArray:
    """Mark the corners of the marked cells, (n_vertices,)."""
    vertices = np.zeros(mesh.n_vertices, np.bool_)
    vertices[mesh.cell_vertices[np.repeat(cells, np.diff(mesh.cell_offsets))]] = True
    return vertices


def marked(array: npt.NDArray[Any], n: int, what: str, option: str) -> BoolArray:
    """Take a mask or ids of cells or vertices as a mask, (n,).

    Parameters
    ----------
    what, option
        "cell" or "vertex", and the option that it is given as, for messages.

    Raises
    ------
    OptionError
        If it is neither, or has ids that there are not.
    """
    if array.dtype == np.bool_:
        if array.shape != (n,):
            raise OptionError(f"a `{option}` mask must have the shape ({n},), got {array.shape}")
        return array.copy()
    mask = np.zeros(n, np.bool_)
    if array.size == 0:
        return mask
    if array.dtype.kind not in "iu" or array.ndim != 1:
        raise OptionError(f"`{option}` must be {what} ids, a boolean mask or {OTHERWISE[option]}")
    bad = (array < 0) | (array >= n)
    if bad.any():
        count = int(bad.sum())
        raise OptionError(
            f"{count} {what} {'id' if count == 1 else 'ids'} in `{option}` "
            f"{'is' if count == 1 else 'are'} outside 0 .. {n - 1}, "
            f"the first is {array[np.argmax(bad)]}"
        )
    mask[array.astype(np.int64)] = True
    return mask
