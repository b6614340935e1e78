"""Which cells and vertices: by number, condition, name, region or polygon; cells grown by rings."""

from __future__ import annotations

import operator
import re
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from qsmooth._types import BoolArray, FloatArray
from qsmooth._words import did_you_mean
from qsmooth.io.groups import cell_groups, cells_of_group, vertex_groups, vertices_of_group
from qsmooth.mesh import Mesh
from qsmooth.metrics import METRICS, quality
from qsmooth.options import OptionError, text_of

_COMPARE: dict[str, Callable[[Any, Any], Any]] = {
    "<": operator.lt,
    "<=": operator.le,
    ">": operator.gt,
    ">=": operator.ge,
}
_IDS = re.compile(r"[\d\s,]*\d[\d\s,]*")
_THRESHOLD = re.compile(r"\s*([\w-]+)\s*(<=|>=|<|>)\s*(\S+)\s*")
_REGION = re.compile(r"\s*region\s*==?\s*(.*\S)\s*")
_POLYGON = re.compile(r"\s*polygon\s*:\s*(.*\S)\s*", re.S)
_CONDITION = re.compile(r"\s*([xyz])\s*(<=|>=|<|>)\s*(\S+)\s*")
_AND = re.compile(r"\s+and\s+", re.I)
# What is said of options that take more than ids and masks.
_OTHERWISE = {
    "selection": "a boolean mask, a threshold, a region or a polygon",
    "fixed": "a boolean mask, a condition or a name",
    "fixed_file": "one a line",
}
# So many names, or regions, are listed in a message at most.
MOST_LISTED = 20


# ------------------------------------------------------------------------------- cells


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
            f"one of {', '.join(METRICS)}; or a region, as in 'region == 3', or a polygon, as in "
            f"'polygon: 0,0 1,0 1,1'; got {text!r}{near}"
        )
    name, comparison, number = match.groups()
    try:
        return name.replace("-", "_"), comparison, float(number)
    except ValueError:
        raise OptionError(
            f"`selection` takes a threshold such as 'max_angle > 150', and {number!r} is no number"
        ) from None


def parse_selection(text: str) -> list[Any] | str:
    """Take a selection in words: cell ids such as ``"3,7,12"``, or a polygon such as
    ``"polygon: 0,0 1,0 1,1"``, as lists; a threshold or a region stays as it is.

    Raises
    ------
    OptionError
        If it is none of these.
    """
    if _IDS.fullmatch(text):
        return _ids(text)
    if match := _POLYGON.fullmatch(text):
        pairs: list[list[float]] = _read_polygon(match[1]).tolist()
        return pairs
    if not _REGION.fullmatch(text):
        parse_threshold(text)
    return text


def select_cells(mesh: Mesh, selection: npt.ArrayLike | str, rings: int = 0) -> BoolArray:
    """Mark the selected cells.

    Parameters
    ----------
    selection
        Cell ids; a boolean mask over the cells; a threshold such as ``"max_angle > 150"`` or
        ``"scaled_jacobian <= 0.2"``, on any metric, where a cell that it is not defined for stays
        out; a region, ``"region == 3"``, or by its name in the file, ``"region == wing"``; or a
        polygon in x and y, (k, 2) with k of 3 or more, or ``"polygon: 0,0 1,0 1,1"``, or
        ``"polygon: FILE"`` with a pair a line, for cells whose mean corner is inside.
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
        selection = parse_selection(selection)
    if isinstance(selection, str):
        chosen = _by_words(mesh, selection)
    else:
        array = np.asarray(selection)
        if array.ndim == 2 and array.shape[0] > 2 and array.shape[1] == 2:
            chosen = _in_polygon(mesh, array)
        else:
            chosen = marked(array, mesh.n_cells, "cell", "selection")
    for _ in range(rings):
        touched = vertices_of(mesh, chosen)
        chosen = np.logical_or.reduceat(touched[mesh.cell_vertices], mesh.cell_offsets[:-1])
    return chosen


def vertices_of(mesh: Mesh, cells: BoolArray) -> BoolArray:
    """Mark the corners of the marked cells, (n_vertices,)."""
    vertices = np.zeros(mesh.n_vertices, np.bool_)
    vertices[mesh.cell_vertices[np.repeat(cells, np.diff(mesh.cell_offsets))]] = True
    return vertices


def _by_words(mesh: Mesh, text: str) -> BoolArray:
    match = _REGION.fullmatch(text)
    if match is not None:
        return _in_region(mesh, match[1].strip("'\""))
    name, comparison, threshold = parse_threshold(text)
    chosen: BoolArray = np.asarray(_COMPARE[comparison](quality(mesh)[name], threshold))
    return chosen


def _in_region(mesh: Mesh, name: str) -> BoolArray:
    by_name = cells_of_group(mesh, name)
    if by_name is not None:
        return by_name
    regions = np.empty(0, np.int64) if mesh.regions is None else mesh.regions
    numbers = np.unique(regions)
    if name.lstrip("+-").isdigit() and int(name) in numbers:
        chosen: BoolArray = regions == int(name)
        return chosen
    known = [*map(str, numbers.tolist()), *cell_groups(mesh)]
    raise OptionError(
        f"there is no region {name}; {_listed('regions', known)}{did_you_mean(name, known)}"
    )


def _read_polygon(text: str) -> FloatArray:
    """Read pairs of numbers, "x,y x,y ...", or those in a file, a pair a line."""
    if not re.match(r"[-+.\d]", text) or not re.search(r"\d\s*,\s*[-+.\d]", text):
        text = text_of(text, "selection")
        text = re.sub(r"#.*", "", text)
    try:
        numbers = np.array([float(word) for word in re.split(r"[\s,;]+", text.strip())])
    except ValueError:
        numbers = np.empty(0)
    if numbers.size < 6 or numbers.size % 2 or not np.isfinite(numbers).all():
        raise OptionError("a polygon in `selection` needs pairs x,y of numbers, three or more")
    return numbers.reshape(-1, 2)


def _in_polygon(mesh: Mesh, polygon: npt.NDArray[Any]) -> BoolArray:
    """Mark the cells whose mean corner is in a polygon, (k, 2), by the even-odd rule."""
    if polygon.dtype.kind not in "fiu" or not np.isfinite(polygon).all():
        raise OptionError("a polygon in `selection` must be finite numbers, (k, 2)")
    corners = mesh.points[mesh.cell_vertices, :2]
    sums = np.add.reduceat(corners, mesh.cell_offsets[:-1], axis=0)
    x, y = (sums / np.diff(mesh.cell_offsets)[:, None]).T
    inside = np.zeros(mesh.n_cells, np.bool_)
    ends = polygon.astype(np.float64)
    for (ax, ay), (bx, by) in zip(ends, np.roll(ends, -1, axis=0), strict=True):
        if ay != by:
            crosses = (ay > y) != (by > y)
            inside ^= crosses & (x < ax + (y - ay) * ((bx - ax) / (by - ay)))
    return inside


# ------------------------------------------------------------------------------- vertices


def parse_vertices(text: str) -> list[int] | str:
    """Take vertex ids such as ``"3,7,12"`` as a list; a condition or a name stays."""
    return _ids(text) if _IDS.fullmatch(text) else text


def check_vertices(given: Any) -> None:
    """Refuse what can be no vertices of any mesh.

    Raises
    ------
    OptionError
        If it is neither text, nor several, nor ids, nor a mask.
    """
    if isinstance(given, str) or _are_texts(given):
        if isinstance(given, str) and not given.strip(" ,"):
            raise OptionError(f"`fixed` names no vertex: {given!r}")
        return
    array = np.asarray(given)
    if array.size and (array.dtype.kind not in "biu" or array.ndim != 1):
        raise OptionError(f"`fixed` must be vertex ids, {_OTHERWISE['fixed']}")


def select_vertices(mesh: Mesh, given: Any) -> BoolArray:
    """Mark vertices: those of an option such as `fixed`.

    Parameters
    ----------
    given
        Vertex ids; a boolean mask over the vertices; or text, or several: conditions on the
        coordinates of `Mesh.points` such as ``"x < 0 and y >= 1.5"``, names that the file has for
        point sets, physical groups, markers and cell sets, or ids, with commas between.

    Returns
    -------
    (n_vertices,) bool

    Raises
    ------
    OptionError
        If it is none of these, or names what there is not.
    """
    if isinstance(given, str):
        return _by_text(mesh, given)
    if _are_texts(given):
        chosen: BoolArray = np.logical_or.reduce([_by_text(mesh, text) for text in given])
        return chosen
    return marked(np.asarray(given), mesh.n_vertices, "vertex", "fixed")


def read_ids(path: str | Path, option: str) -> list[int]:
    """Read ids from a file, one a line or several; what follows a # does not count.

    Raises
    ------
    OptionError
        If it can't be read, or has something else.
    """
    text = re.sub(r"#.*", "", text_of(path, option))
    if text.strip() and not _IDS.fullmatch(text):
        word = next(w for w in re.split(r"[\s,]+", text) if w and not w.isdigit())
        raise OptionError(f"`{option}` takes a file of vertex ids, and '{path}' has {word!r}")
    return _ids(text)


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
        raise OptionError(f"`{option}` must be {what} ids, {_OTHERWISE[option]}")
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


def _by_text(mesh: Mesh, text: str) -> BoolArray:
    """Mark the vertices of a name, or of what stands between commas."""
    by_name = vertices_of_group(mesh, text.strip())
    if by_name is not None:
        return by_name
    chosen = np.zeros(mesh.n_vertices, np.bool_)
    for part in filter(None, (part.strip() for part in text.split(","))):
        if _IDS.fullmatch(part):
            chosen |= marked(np.array(_ids(part)), mesh.n_vertices, "vertex", "fixed")
            continue
        found = vertices_of_group(mesh, part)
        chosen |= _by_conditions(mesh, part) if found is None else found
    return chosen


def _by_conditions(mesh: Mesh, text: str) -> BoolArray:
    chosen = np.ones(mesh.n_vertices, np.bool_)
    for term in _AND.split(text):
        match = _CONDITION.fullmatch(term)
        try:
            axis, comparison, number = ("", "", "") if match is None else match.groups()
            chosen &= _COMPARE[comparison](mesh.points[:, "xyz".index(axis)], float(number))
        except (KeyError, ValueError, IndexError):
            known = vertex_groups(mesh)
            raise OptionError(
                "`fixed` takes vertex ids such as 3,7,12, conditions such as 'x < 0 and y >= 1.5', "
                f"and names; {_listed('names', known)}; got {text!r}{did_you_mean(text, known)}"
            ) from None
    return chosen


def _are_texts(given: Any) -> bool:
    return (
        isinstance(given, (list, tuple))
        and bool(given)
        and all(isinstance(text, str) for text in given)
    )


def _ids(text: str) -> list[int]:
    return [int(number) for number in re.findall(r"\d+", text)]


def _listed(what: str, known: Sequence[str]) -> str:
    if not known:
        return f"the mesh has no {what}"
    more = f" and {len(known) - MOST_LISTED} more" if len(known) > MOST_LISTED else ""
    return f"the {what} of the mesh are {', '.join(known[:MOST_LISTED])}{more}"
