"""UGRID: unstructured grids in NetCDF, as hydrodynamic models have them, of versions 0.9 and 1.0.

Where vertices move, the coordinates of the nodes change, and with them those of faces and edges
that follow from them; all other variables stay. Conventions: ugrid-conventions.github.io.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from qsmooth._types import BoolArray, IndexArray
from qsmooth.errors import MeshError
from qsmooth.io.apart import apart
from qsmooth.io.file_content import FileContent, region_tags
from qsmooth.io.in_place import InPlace
from qsmooth.io.missing import require
from qsmooth.io.netcdf import HDF5, is_netcdf, variables
from qsmooth.io.netcdf_variable import Attributes, Variable
from qsmooth.io.text import integers, runs
from qsmooth.io.ugrid_in_place import Derived, NodeCoordinates, Values, decoded
from qsmooth.io.ugrid_writing import composed

NAME = "ugrid"  # of meshio's formats that is another one, which is called aflr here
ENDINGS = (".nc",)
HOLDS = frozenset(("level", "geographic", "regions", "point_data", "cell_data"))
REPLACES = ()

# Deltares' names before there were topologies to name them.
OLD_TOPOLOGY = {
    "node_coordinates": "NetNode_x NetNode_y",
    "face_node_connectivity": "NetElemNode",
    "edge_node_connectivity": "NetLink",
}
# What NetCDF fills integers with if no fill value is named.
DEFAULT_FILLS = (-2147483647, -9223372036854775806)
# Of data with more values a node, as of many times, none is read: it stays in the file.
MOST_VALUES = 64
EAST = ("degrees_east", "degree_east", "degreese", "degreee", "degrees_e", "degree_e")
NORTH = ("degrees_north", "degree_north", "degreesn", "degreen", "degrees_n", "degree_n")
LENGTHS = ("m", "metre", "metres", "meter", "meters", "km", "ft")
# Standard names of CF for the bed, by the way they count.
LEVELS = frozenset(("altitude", "height", "sea_floor_altitude", "bed_level", "surface_altitude"))
DEPTHS = frozenset(
    (
        "depth",
        "sea_floor_depth",
        "sea_floor_depth_below_geoid",
        "sea_floor_depth_below_mean_sea_level",
        "sea_floor_depth_below_sea_level",
        "sea_floor_depth_below_sea_surface",
        "sea_floor_depth_below_reference_ellipsoid",
    )
)
X_NAMES, Y_NAMES = ("projection_x_coordinate",), ("projection_y_coordinate",)


def sniff(head: bytes) -> bool:
    """Whether a file that starts so is NetCDF."""
    return is_netcdf(head)


def write(content: FileContent) -> bytes:
    """Write a new file of UGRID 1.0, in NetCDF's classic form."""
    return composed(content)


def read(data: bytes) -> FileContent:
    """Read the two-dimensional topology; all other variables stay in the file."""
    if data[:8] == HDF5:
        require("h5py", "a NetCDF-4 file, which is HDF5,")
        content: FileContent = apart(f"{__name__}:content_of", len(data), data)
        return content
    return content_of(data)


def content_of(data: bytes) -> FileContent:
    """The mesh in these bytes; asks h5py where they are HDF5."""
    return _Reader(*variables(data)).content()


class _Reader:
    """The variables of a file, and those that make the mesh."""

    def __init__(self, found: dict[str, Variable], attributes: Attributes) -> None:
        self.found, self.attributes = found, attributes
        self.notes: list[str] = []
        self.used: set[str] = set()
        self.topology = self._topology()

    def content(self) -> FileContent:
        x, y, *z = self._coordinates("node_coordinates", 3)
        if len(x.shape) != 1 or x.shape != y.shape:
            raise MeshError(
                f"node coordinates {x.name} and {y.name} are of shapes {x.shape}, {y.shape}"
            )
        for one in (x, y):
            if {"scale_factor", "add_offset"} & one.attributes.keys() or one.dtype.kind != "f":
                raise MeshError(f"{one.name} is packed, or of type {one.dtype}, and cannot move")
        points = np.column_stack([one.values().astype(np.float64) for one in (x, y)])
        rows = self._variable("face_node_connectivity")
        corners, counts, face_dim = self._faces(rows, len(points))
        blocks, ends = [], []
        for first, last in runs(counts):
            n = int(counts[first])
            kind = {3: "triangle", 4: "quad"}.get(n, f"polygon{n}")
            blocks.append((kind, corners[first:last, :n]))
            ends.append(last)
        derived = tuple(self._derived(corners, counts, len(points)))
        node_data = dict(self._data(x.dims[0], len(points), {x.name, y.name}))
        for one in z:
            node_data.setdefault(one.name, one)
        face_data = dict(self._data(face_dim, len(counts), set()))
        cell_data = {
            name: np.split(decoded(one, one.values()), ends[:-1]) for name, one in face_data.items()
        }
        data_slots: dict[str, InPlace] = {
            name: Values(name, one.dims.index(x.dims[0]))
            for name, one in node_data.items()
            if one.dtype.kind == "f"
        }
        others = self.found.keys() - self.used - node_data.keys() - face_data.keys()
        return FileContent(
            points,
            blocks,
            region_tags(cell_data, blocks),
            point_data={
                name: np.moveaxis(decoded(one, one.values()), one.dims.index(x.dims[0]), 0)
                for name, one in node_data.items()
            },
            cell_data=cell_data,
            extras=_listed(sorted(others)),
            notes=tuple(self.notes),
            geographic=self._in_degrees(x),
            level=_level(node_data.values()),
            slots=NodeCoordinates((x.name, y.name), derived),
            data_slots=data_slots,
        )

    def _in_degrees(self, x: Variable) -> bool | None:
        """Whether coordinates are degrees; None where neither units nor names tell."""
        if _is_longitude(x) or _integer(self.attributes, "Spherical", 0) == 1:
            return True
        lengths = x.text("units").lower() in LENGTHS or x.text("standard_name") in X_NAMES
        return False if lengths else None

    def _topology(self) -> Attributes:
        """Attributes of the topology with faces; those of Deltares' old files are implied."""
        meshes = [
            one
            for one in self.found.values()
            if "mesh_topology" in (one.text("cf_role"), one.text("standard_name"))
        ]
        flat = [
            one
            for one in meshes
            if one.text("face_node_connectivity")
            and _integer(one.attributes, "topology_dimension", 2) == 2
        ]
        if len(flat) > 1:
            names = ", ".join(one.name for one in flat[1:])
            self.notes.append(f"the mesh is {flat[0].name}; {names} stays as it is")
        if flat:
            self.used.add(flat[0].name)
            return flat[0].attributes
        if OLD_TOPOLOGY["face_node_connectivity"] in self.found:
            return dict(OLD_TOPOLOGY)
        if "connect1" in self.found or "coordx" in self.found:
            raise MeshError("this is an Exodus file: say so with format='exodus'")
        what = f"{meshes[0].name} has none" if meshes else "no mesh_topology is in it"
        raise MeshError(f"the file has no UGRID mesh of faces: {what}")

    def _variable(self, role: str) -> Variable:
        name = str(self.topology.get(role, "")).strip("\0 ")
        if name not in self.found:
            raise MeshError(f"{role} {name!r} is not in the file")
        self.used.add(name)
        return self.found[name]

    def _coordinates(self, role: str, most: int = 2) -> list[Variable]:
        """Variables of x and y, and of z where it is named, too."""
        names = str(self.topology.get(role, "")).strip("\0 ").split()
        there = [self.found[name] for name in names if name in self.found]
        if len(there) < 2 or len(there) != len(names) or len(there) > most:
            raise MeshError(f"{role} {' '.join(names)!r} are not x and y, or not in the file")
        if _is_y(there[0]) and _is_x(there[1]):
            there[:2] = there[1::-1]
        self.used.update(one.name for one in there[:2])
        return there

    def _faces(self, one: Variable, n_nodes: int) -> tuple[IndexArray, IndexArray, str]:
        """Nodes of each face from 0 on, how many there are, and the faces' dimension."""
        if len(one.shape) != 2 or not all(one.shape):
            raise MeshError(f"{one.name} is of shape {one.shape}, not (faces, nodes)")
        rows, dims = one.values(), one.dims
        face_dim = str(self.topology.get("face_dimension", "")).strip("\0 ")
        if face_dim == dims[1] and dims[0] != dims[1]:
            rows, dims = np.ascontiguousarray(rows.T), dims[::-1]
        ids, filled = self._ids(one, rows)
        ids, filled = self._from_zero(one, ids, filled, n_nodes)
        counts = (~filled).sum(axis=1)
        places = np.arange(rows.shape[1])
        wrong = (filled != (places >= counts[:, None])).any(axis=1) | (counts < 3)
        if wrong.any():
            face = int(np.argmax(wrong))
            raise MeshError(
                f"{int(wrong.sum())} faces have fewer than 3 nodes, or a gap among them, "
                f"the first is face {face}: {rows[face].tolist()[:9]}"
            )
        return ids, counts, dims[0]

    def _ids(self, one: Variable, rows: npt.NDArray[Any]) -> tuple[IndexArray, BoolArray]:
        """Node ids as integers, and where there is none."""
        fills = [one.attributes[n] for n in ("_FillValue", "missing_value") if n in one.attributes]
        numbers = [float(np.ravel(fill)[0]) for fill in fills if not isinstance(fill, str)]
        filled = np.isin(rows, [*numbers, *(DEFAULT_FILLS if rows.dtype.kind == "i" else ())])
        if rows.dtype.kind == "f":
            filled |= np.isnan(rows) | (np.abs(rows) > 9e36)  # that, too, is a default
            return integers(np.where(filled, -1.0, rows), one.name), filled
        return np.where(filled, -1, rows.astype(np.int64)), filled

    def _from_zero(
        self, one: Variable, ids: IndexArray, filled: BoolArray, n_nodes: int, told: bool = True
    ) -> tuple[IndexArray, BoolArray]:
        """Count from 0, whatever is declared; what lies below the first node stands for none."""
        declared = _integer(one.attributes, "start_index", 0)
        below = ids < 0
        real = ids[~(filled | below)]
        low, high = (int(real.min()), int(real.max())) if real.size else (0, 0)
        start = declared
        if "start_index" not in one.attributes:
            start = 1 if high == n_nodes else 0
        elif low < declared and high < n_nodes:
            start = 0
        elif declared == 0 and low >= 1 and high == n_nodes:
            start = 1
        if start != declared and told:
            says = declared if "start_index" in one.attributes else "none"
            self.notes.append(f"{one.name}: start_index {says} declared, nodes count from {start}")
        filled = filled | (ids < start)
        return np.where(filled, -1, ids - start), filled

    def _data(self, dim: str, n: int, without: set[str]) -> Iterator[tuple[str, Variable]]:
        """Numbers that belong to the places of a dimension."""
        for name, one in self.found.items():
            rest = math.prod(one.shape) // max(n, 1)
            packed = {"scale_factor", "add_offset"} & one.attributes.keys()
            if (
                one.dims.count(dim) == 1
                and one.shape[one.dims.index(dim)] == n
                and one.dtype.kind in "fiu"
                and 0 < rest <= MOST_VALUES
                and not packed
                and not one.text("cf_role")
                and name not in without | self.used
            ):
                yield name, one

    def _derived(self, corners: IndexArray, counts: IndexArray, n_nodes: int) -> Iterator[Derived]:
        """Coordinates of faces and edges, with the nodes of each."""
        yield from self._derived_of("face_coordinates", corners, counts)
        edges = self.found.get(str(self.topology.get("edge_node_connectivity", "")).strip("\0 "))
        if edges is None:
            yield from self._derived_of("edge_coordinates", None, None)
        elif len(edges.shape) == 2 and edges.shape[1] == 2:
            self.used.add(edges.name)
            ids, filled = self._ids(edges, edges.values())
            ids, filled = self._from_zero(edges, ids, filled, n_nodes, told=False)
            if ids.max(initial=-1) < n_nodes:
                yield from self._derived_of("edge_coordinates", ids, (~filled).sum(axis=1))

    def _derived_of(
        self, role: str, ids: IndexArray | None, counts: IndexArray | None
    ) -> Iterator[Derived]:
        try:
            x, y = self._coordinates(role)
        except MeshError:
            return  # they may be named and not there
        if ids is None or counts is None:
            ids, counts = np.zeros((*x.shape[:1], 1), np.int64), np.zeros(x.shape[:1], np.int64)
        if x.shape == y.shape == counts.shape and x.dtype.kind == y.dtype.kind == "f":
            bounds = [one.text("bounds") for one in (x, y)]
            there = [self.found.get(name) for name in bounds]
            fit = all(one is not None and one.shape == ids.shape for one in there)
            self.used.update(bounds)
            yield Derived((x.name, y.name), tuple(bounds) if fit else (), ids, counts)


def _integer(attributes: Attributes, name: str, default: int) -> int:
    value = attributes.get(name, default)
    try:
        return int(np.ravel(value)[0])
    except (ValueError, TypeError, OverflowError, IndexError):
        return default


def _is_longitude(one: Variable) -> bool:
    return one.text("units").lower() in EAST or one.text("standard_name") == "longitude"


def _level(found: Iterable[Variable]) -> tuple[str, Literal["height", "depth"]] | None:
    """Name of the bed at the nodes, and how it counts; None where there is not exactly one."""
    beds = [
        one
        for one in found
        if len(one.shape) == 1
        and one.dtype.kind == "f"
        and (
            one.text("standard_name") in LEVELS | DEPTHS
            or one.name.lower().endswith(("node_z", "netnode_z"))
        )
    ]
    if len(beds) != 1:
        return None
    down = beds[0].text("positive").lower() or (
        "down" if beds[0].text("standard_name") in DEPTHS else "up"
    )
    return beds[0].name, "depth" if down == "down" else "height"


def _is_x(one: Variable) -> bool:
    return _is_longitude(one) or one.text("standard_name") in X_NAMES or one.text("axis") == "X"


def _is_y(one: Variable) -> bool:
    north = one.text("units").lower() in NORTH or one.text("standard_name") == "latitude"
    return north or one.text("standard_name") in Y_NAMES or one.text("axis") == "Y"


def _listed(names: list[str], most: int = 5) -> tuple[str, ...]:
    """Name some of the variables that only this file can hold."""
    if not names:
        return ()
    more = f" and {len(names) - most} more" if len(names) > most else ""
    return (f"variables {', '.join(names[:most])}{more}",)
