"""What belongs to places travels with them: z of a flat mesh, and the point data of its file."""

from __future__ import annotations

import copy
import dataclasses
from collections.abc import Iterable
from dataclasses import replace
from typing import Any, Literal, TypeAlias

import numpy as np
import numpy.typing as npt

from qsmooth._types import BoolArray, FloatArray
from qsmooth._words import did_you_mean
from qsmooth.io.file_content import FileContent
from qsmooth.mesh import Mesh
from qsmooth.options import OptionError
from qsmooth.outcome import Carried
from qsmooth.remapping import Located, at_vertices
from qsmooth.result import SmoothResult

Carry: TypeAlias = Literal["interpolate", "keep"]


def parse_names(given: str | Iterable[str]) -> tuple[str, ...]:
    """Take names of point data: one, several with commas between, or an iterable of names.

    Raises
    ------
    OptionError
        If they are no names.
    """
    names = given.split(",") if isinstance(given, str) else given
    try:
        found = tuple(dict.fromkeys(name.strip() for name in names))
    except (TypeError, AttributeError):
        raise OptionError(f"`interpolate` takes names of point data, got {given!r}") from None
    return tuple(name for name in found if name)


def require_data(mesh: Mesh, names: Iterable[str]) -> tuple[str, ...]:
    """Give names of point data, those that are several with commas between taken apart.

    What the mesh calls so is one name, commas or not. Refused are names that the mesh has not, and
    those of data that can't be interpolated.

    Raises
    ------
    OptionError
        Naming the first that it is.
    """
    data = _point_data(mesh)
    apart = [(name,) if name in data else parse_names(name) for name in names]
    found = tuple(dict.fromkeys(name for some in apart for name in some))
    for name in found:
        if name not in data:
            known = f"; there is {', '.join(data)}" if data else ", it has none"
            raise OptionError(
                f"`interpolate` takes point data of the mesh, there is no {name!r} in it"
                f"{did_you_mean(name, data)}{known}"
            )
        values = np.asarray(data[name])
        if values.dtype.kind != "f":
            raise OptionError(
                f"`interpolate` takes point data of floats, {name!r} is {values.dtype}"
            )
    return found


def carried(
    mesh: Mesh, result: SmoothResult, carry: Carry, names: Iterable[str], threads: int | None
) -> SmoothResult:
    """Give the result of smoothing the values that belong to its places.

    Parameters
    ----------
    mesh
        What was smoothed.
    carry
        What becomes of z of a flat mesh, and of point data that the file's format says belongs to
        places. What these are off by is told in either case.
    names
        Other point data to interpolate; `require_data` has been asked.
    """
    moved: BoolArray = (result.mesh.xy != mesh.xy).any(axis=1)
    flat = mesh.surface == "flat" and mesh.points.shape[1] == 3
    names = tuple(names)
    fields = _fields(mesh, names)
    if not moved.any() or not (flat or names or fields):
        return result
    vertices = np.flatnonzero(moved)
    located = at_vertices(mesh, result.mesh.xy[vertices], vertices, threads)
    records, points, source = [], None, result.mesh.source
    if flat:
        z = mesh.points[:, 2]
        fresh, record = _interpolated("z", z, located, vertices)
        records.append(replace(record, interpolated=carry == "interpolate"))
        if carry == "interpolate":
            points = result.mesh.points.copy()
            points[:, 2] = fresh
    if (names or fields) and isinstance(source, FileContent):
        data = dict(source.point_data)
        changed = set(names) if carry == "keep" else {*names, *fields}
        for name in (*names, *fields):
            fresh, record = _interpolated(name, data[name], located, vertices)
            records.append(replace(record, interpolated=name in changed))
            if name in changed:
                data[name] = fresh
        source = dataclasses.replace(source, point_data=data, changed=source.changed | changed)
    final = result.mesh.with_values(points, source)
    after = copy.copy(result.quality_after)
    after.points = final.points
    return replace(
        result,
        mesh=final,
        outcome=replace(result.outcome, carried=tuple(records)),
        quality_after=after,
    )


class Depths:
    """z of a flat mesh in steps of a session: interpolated where vertices have moved.

    Parameters
    ----------
    mesh
        Says which vertices the cells have.
    """

    def __init__(self, mesh: Mesh) -> None:
        self._mesh, n = mesh, mesh.n_vertices
        self._given, self._fresh, self._lost = np.empty(n), np.empty(n), np.empty(n, np.int64)

    def carry(self, points: FloatArray, xy: FloatArray, places: FloatArray) -> FloatArray:
        """Find z where vertices have come to.

        Parameters
        ----------
        points, xy : (n_vertices, 3), (n_vertices, 2)
            Where they were; z there is what is interpolated.
        places : (n_vertices, 2)
            Where they are.

        Returns
        -------
        (n_vertices,)
            Overwritten by the next call. Vertices that have not moved keep theirs to the bit;
            beyond the boundary z goes on as in the cell there.
        """
        from qsmooth.kernels.carrying import carry_values

        topology, fresh = self._mesh.topology, self._fresh
        np.copyto(self._given, points[:, 2])
        n_lost = carry_values(
            xy, topology.cells, (topology.star_offsets, topology.star_cells), topology.twins,
            topology.corner_cells, topology.is_boundary, places, self._given, fresh, self._lost,
        )  # fmt: skip
        if n_lost:
            # Far beyond the boundary, or where the mesh was folded: among all cells.
            lost = self._lost[:n_lost]
            there = points.copy()
            there[:, 2] = 0.0  # at some vertices it may be no number
            located = at_vertices(self._mesh.with_points(there), places[lost], lost, 1)
            fresh[lost] = located.onto(self._given[:, None], lost)[lost, 0]
        return fresh


def _fields(mesh: Mesh, named: Iterable[str]) -> list[str]:
    """Names of point data that is interpolated without being named."""
    source, asked = mesh.source, set(named)
    fields = source.fields if isinstance(source, FileContent) else ()
    return [name for name in fields if name not in asked]


def _point_data(mesh: Mesh) -> dict[str, Any]:
    return mesh.source.point_data if isinstance(mesh.source, FileContent) else {}


def _interpolated(
    name: str, values: npt.ArrayLike, located: Located, vertices: npt.NDArray[np.int64]
) -> tuple[FloatArray, Carried]:
    """Values at all vertices, of the type that they had, and what came of it."""
    given = np.asarray(values)
    table = np.array(given, np.float64, order="C").reshape(len(given), -1)
    fresh = located.onto(table, vertices)
    change = np.abs(fresh[vertices] - table[vertices])
    change = change[np.isfinite(change)]
    largest = float(change.max(initial=0.0))
    # Scaled, so that squares neither overflow nor vanish.
    rms = largest * float(np.sqrt(np.mean((change / largest) ** 2))) if largest else 0.0
    record = Carried(name=name, interpolated=True, vertices=len(vertices), largest=largest, rms=rms)
    return fresh.astype(given.dtype).reshape(given.shape), record
