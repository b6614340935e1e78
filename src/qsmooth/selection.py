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
        marked: BoolArray = np.asarray(_COMPARE[comparison](quality(mesh)[name], threshold))
    else:
        marked = _marked(np.asarray(selection), mesh.n_cells)
    for _ in range(rings):
        touched = vertices_of(mesh, marked)
        marked = np.logical_or.reduceat(touched[mesh.cell_vertices], mesh.cell_offsets[:-1])
    return marked


def vertices_of(mesh: Mesh, cells: BoolArray) -> BoolArray:
    """Mark the corners of the marked cells, (n_vertices,)."""
    vertices = np.zeros(mesh.n_vertices, np.bool_)
    vertices[mesh.cell_vertices[np.repeat(cells, np.diff(mesh.cell_offsets))]] = True
    return vertices


def _marked(array: npt.NDArray[Any], n_cells: int) -> BoolArray:
    if array.dtype == np.bool_:
        if array.shape != (n_cells,):
            raise OptionError(
                f"a `selection` mask must have the shape ({n_cells},), got {array.shape}"
            )
        return array.copy()
    marked = np.zeros(n_cells, np.bool_)
    if array.size == 0:
        return marked
    if array.dtype.kind not in "iu" or array.ndim != 1:
        raise OptionError("`selection` must be cell ids, a boolean mask or a threshold")
    bad = (array < 0) | (array >= n_cells)
    if bad.any():
        n = int(bad.sum())
        raise OptionError(
            f"{n} {'cell id in `selection` is' if n == 1 else 'cell ids in `selection` are'} "
            f"outside 0 .. {n_cells - 1}, the first is {array[np.argmax(bad)]}"
        )
    marked[array.astype(np.int64)] = True
    return marked
