"""A new UGRID file from any mesh."""

from __future__ import annotations

import re
from typing import Any

import numpy as np
import numpy.typing as npt

from qsmooth._types import IndexArray
from qsmooth.io.file_content import FACES, FileContent
from qsmooth.io.netcdf_classic import Classic, Stored, compose
from qsmooth.io.netcdf_variable import Attributes

MESH = "mesh2d"
NODE, FACE, EDGE = f"{MESH}_nNodes", f"{MESH}_nFaces", f"{MESH}_nEdges"
MOST_NODES, TWO = f"{MESH}_nMax_face_nodes", "Two"
FILL = -1


def composed(content: FileContent) -> bytes:
    """The bytes of a file in NetCDF's classic form, with 64-bit offsets where it needs them."""
    faces = [(kind, cells) for kind, cells in content.blocks if kind in FACES]
    n_faces, width = sum(len(c) for _, c in faces), max(c.shape[1] for _, c in faces)
    rows = np.full((n_faces, width), FILL, ">i4")
    first = 0
    for _, cells in faces:
        rows[first : first + len(cells), : cells.shape[1]] = _anticlockwise(cells, content)
        first += len(cells)
    edges = _edges([cells for _, cells in faces])
    dims = {NODE: len(content.points), FACE: n_faces, MOST_NODES: width}
    dims |= {EDGE: len(edges), TWO: 2}
    found: dict[str, Stored] = {MESH: Stored((), _topology(), np.array(0, ">i4"))}
    for k, axis in enumerate("xy"):
        values = content.points[:, k].astype(">f8")
        found[f"{MESH}_node_{axis}"] = Stored(
            (NODE,), _axis(axis, bool(content.geographic)), values
        )
    found[f"{MESH}_face_nodes"] = Stored(
        (FACE, MOST_NODES), {**_indices("face"), "_FillValue": np.array([FILL], ">i4")}, rows
    )
    found[f"{MESH}_edge_nodes"] = Stored((EDGE, TWO), _indices("edge"), edges.astype(">i4"))
    if content.plain_points.shape[1] == 3:
        about = {**_about("node"), "standard_name": "altitude"}
        found[f"{MESH}_node_z"] = Stored((NODE,), about, content.z("height").astype(">f8"))
    for name, values in content.point_data.items():
        _put(found, dims, name, np.asarray(values), NODE, "node")
    of_faces = [b for b, (kind, _) in enumerate(content.blocks) if kind in FACES]
    cell_data = dict(content.cell_data)
    if content.tags is not None and "region" not in cell_data:
        cell_data["region"] = content.tags
    for name, parts in cell_data.items():
        values = np.concatenate([np.asarray(parts[b]) for b in of_faces])
        _put(found, dims, name, values, FACE, "face")
    attributes = {"Conventions": "CF-1.8 UGRID-1.0", "source": "qsmooth"}
    return compose(Classic(1, dims, attributes, found))


def _put(
    found: dict[str, Stored],
    dims: dict[str, int],
    name: str,
    values: npt.NDArray[Any],
    dim: str,
    location: str,
) -> None:
    """Add data of nodes or faces."""
    stored = _storable(values)
    if stored is None:
        return
    about = _about(location) | ({"long_name": name} if _plain(name) != name else {})
    names = [dim]
    for length in stored.shape[1:]:
        dims[f"n{length}"] = length
        names.append(f"n{length}")
    name = _plain(name)
    while name in found:
        name += "_"
    found[name] = Stored(tuple(names), about, stored)


def _plain(name: str) -> str:
    """A name as NetCDF has them: it begins with a letter, and has no slash or space."""
    name = re.sub(r"[^\w.@+:-]", "_", name) or "data"
    return name if name[0].isalpha() or name[0] == "_" else f"_{name}"


def _storable(values: npt.NDArray[Any]) -> npt.NDArray[Any] | None:
    """Numbers of a type that the classic form has; None for what are no numbers."""
    kind, size = values.dtype.kind, values.dtype.itemsize
    if kind == "f":
        return values.astype(">f4" if size <= 4 else ">f8")
    if kind not in "iub":
        return None
    if size == 1 and kind != "u":
        return values.astype(">i1")
    fits = not values.size or (values.min() >= -(2**31) and values.max() < 2**31)
    return values.astype(">i4" if fits else ">f8")


def _anticlockwise(cells: IndexArray, content: FileContent) -> IndexArray:
    """Cells from the same first node on, all anticlockwise, as the conventions ask."""
    x, y = content.points[cells][:, :, 0], content.points[cells][:, :, 1]
    x, y = x - x[:, :1], y - y[:, :1]
    areas = (x * np.roll(y, -1, axis=1) - y * np.roll(x, -1, axis=1)).sum(axis=1)
    return np.where(areas[:, None] < 0.0, np.roll(cells[:, ::-1], 1, axis=1), cells)


def _edges(blocks: list[IndexArray]) -> IndexArray:
    """Edges of all cells, each once, (n_edges, 2)."""
    pairs = [np.stack([cells, np.roll(cells, -1, axis=1)], axis=2) for cells in blocks]
    every = np.sort(np.concatenate([p.reshape(-1, 2) for p in pairs]), axis=1)
    keys = np.unique(every[:, 0] * (every.max() + 1) + every[:, 1])
    return np.column_stack(np.divmod(keys, every.max() + 1))


def _topology() -> Attributes:
    return {
        "cf_role": "mesh_topology",
        "long_name": "Topology data of 2D mesh",
        "topology_dimension": np.array([2], ">i4"),
        "node_coordinates": f"{MESH}_node_x {MESH}_node_y",
        "node_dimension": NODE,
        "face_node_connectivity": f"{MESH}_face_nodes",
        "face_dimension": FACE,
        "max_face_nodes_dimension": MOST_NODES,
        "edge_node_connectivity": f"{MESH}_edge_nodes",
        "edge_dimension": EDGE,
    }


def _axis(axis: str, geographic: bool) -> Attributes:
    standard = f"projection_{axis}_coordinate"
    if geographic:
        standard = "longitude" if axis == "x" else "latitude"
    units = {"units": "degrees_east" if axis == "x" else "degrees_north"} if geographic else {}
    return {**_about("node"), "standard_name": standard, **units}


def _indices(what: str) -> Attributes:
    return {"cf_role": f"{what}_node_connectivity", "start_index": np.array([0], ">i4")}


def _about(location: str) -> Attributes:
    return {"mesh": MESH, "location": location}
