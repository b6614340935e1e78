"""What goes with each vertex: unit vectors along which it may move, its shortest edge, its ring."""

from __future__ import annotations

import re
from typing import Any

import numpy as np
import numpy.typing as npt

from qsmooth._types import BoolArray, FloatArray
from qsmooth._words import did_you_mean
from qsmooth.io.groups import point_data
from qsmooth.mesh import Mesh
from qsmooth.options import OptionError
from qsmooth.selection import vertices_of

_NUMBERS = re.compile(r"\s*([-+.\deE]+)\s*,\s*([-+.\deE]+)\s*")


def parse_directions(given: Any) -> Any:
    """Take directions: a name stays, all else becomes unit vectors, (n, 2), or a pair for all.

    Raises
    ------
    OptionError
        If they are none of these, or one has no length.
    """
    if isinstance(given, str):
        match = _NUMBERS.fullmatch(given)
        if match is None:
            return given
        given = [_number(word) for word in match.groups()]
    try:
        array = np.array(given, np.float64)
    except (TypeError, ValueError):
        array = np.empty(())
    if array.shape == (2,):
        return tuple(unit_vectors(array[None, :])[0].tolist())
    if array.ndim != 2 or array.shape[1] != 2:
        got = f"numbers of the shape {array.shape}" if array.ndim else repr(given)
        raise OptionError(
            "`directions` must be one vector, or numbers of the shape (n_vertices, 2), or the name "
            f"of point data; got {got}"
        )
    return unit_vectors(array)


def directions_of(mesh: Mesh, directions: Any) -> FloatArray:
    """Give the directions of each vertex, (n_vertices, 2), in the coordinates of `Mesh.xy`.

    Parameters
    ----------
    directions
        As `parse_directions` leaves them.

    Raises
    ------
    OptionError
        If they are not as many as the vertices, or the mesh's file has none of that name.
    """
    if isinstance(directions, str):
        return _turned(mesh, unit_vectors(_of_file(mesh, directions)))
    array = np.asarray(directions)
    if array.ndim == 1:
        return _turned(mesh, np.tile(array, (mesh.n_vertices, 1)))
    if len(array) != mesh.n_vertices:
        raise OptionError(
            f"`directions` must have the shape ({mesh.n_vertices}, 2), got {array.shape}"
        )
    return _turned(mesh, array)


def _turned(mesh: Mesh, vectors: FloatArray) -> FloatArray:
    """Vectors that go east and north, as they lie on the map of a mesh in degrees."""
    if mesh.projection is None:
        return vectors
    return mesh.projection.turned(mesh.points, vectors)


def unit_vectors(vectors: npt.NDArray[np.float64]) -> FloatArray:
    """Give vectors, (n, 2), the length 1; rows of NaN stay.

    Raises
    ------
    OptionError
        If one has no length, or is neither finite nor NaN twice.
    """
    largest = np.abs(vectors).max(axis=1, initial=0.0)
    free = np.isnan(vectors).all(axis=1)
    bad = ~free & ~(np.isfinite(largest) & (largest > 0.0))
    if bad.any():
        v = int(np.argmax(bad))
        raise OptionError(
            f"{int(bad.sum())} of the `directions` are no vectors with a length, nor NaN twice, "
            f"the first is that of vertex {v}: {vectors[v].tolist()}"
        )
    # By the largest first, as squares would overflow, or vanish.
    scaled: FloatArray = vectors / largest[:, None]
    return scaled / np.hypot(scaled[:, 0], scaled[:, 1])[:, None]


def shortest_edges(mesh: Mesh) -> FloatArray:
    """Measure the shortest edge of each vertex, (n_vertices,); infinite for one without edges."""
    from qsmooth.kernels.untangle_sweep import shortest_edges

    out = np.empty(mesh.n_vertices)
    everyone = np.arange(mesh.n_vertices, dtype=np.uint32)
    shortest_edges(mesh.xy.copy(), *mesh.topology.rings, everyone, out)
    return out


def transition(mesh: Mesh, cells: BoolArray, rings: int) -> tuple[BoolArray, FloatArray]:
    """Let what may move fall off around selected cells, ring by ring.

    Parameters
    ----------
    cells : (n_cells,)
        The selected ones.

    Returns
    -------
    grown : (n_cells,)
        These and the cells of so many rings around.
    shares : (n_vertices,)
        How far each vertex may come, as a share of its shortest edge: infinite in the selection,
        (rings + 1 - k) / (rings + 1) in ring k, 0 beyond.
    """
    shares = np.where(vertices_of(mesh, cells), np.inf, 0.0)
    for ring in range(1, rings + 1):
        cells = np.logical_or.reduceat((shares > 0.0)[mesh.cell_vertices], mesh.cell_offsets[:-1])
        shares[vertices_of(mesh, cells) & (shares == 0.0)] = (rings + 1 - ring) / (rings + 1)
        if cells.all():
            break
    return cells, shares


def _of_file(mesh: Mesh, name: str) -> FloatArray:
    known = point_data(mesh)
    if name not in known:
        had = f"those are {', '.join(known)}" if known else "of which the mesh has none"
        raise OptionError(
            "`directions` takes a vector such as 1,0 or the name of point data with two or three "
            f"components, {had}; got {name!r}{did_you_mean(name, known)}"
        )
    vectors = known[name]
    if mesh.plane is None:
        return np.ascontiguousarray(vectors[:, :2])
    in_space = np.pad(vectors, ((0, 0), (0, 3 - vectors.shape[1])))
    return np.ascontiguousarray(in_space @ mesh.plane.axes.T)


def _number(word: str) -> float:
    try:
        return float(word)
    except ValueError:
        raise OptionError(
            f"`directions` takes a vector such as 1,0; {word!r} is no number"
        ) from None
