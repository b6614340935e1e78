"""Grids of xugrid."""

from __future__ import annotations

import copy
import sys
from typing import TYPE_CHECKING, Any

import numpy as np

from qsmooth.checks import require_vertices
from qsmooth.io.file_content import FileContent
from qsmooth.io.vtk_cells import POLYGON, blocks_of
from qsmooth.mesh import Mesh, Surface

if TYPE_CHECKING:
    import xugrid

NAME = "a Ugrid2d of xugrid"

FILL = -1  # in the faces, whatever the grid's own fill value is


def accepts(obj: object) -> bool:
    """Whether this is a grid in two dimensions."""
    return isinstance(obj, getattr(sys.modules.get("xugrid"), "Ugrid2d", ()))


def to_mesh(obj: xugrid.Ugrid2d, *, surface: Surface = "auto") -> Mesh:
    """Take the faces, triangles and quads in any order."""
    faces = np.asarray(obj.face_node_connectivity)
    there = faces != FILL
    offsets = np.append(0, np.cumsum(there.sum(axis=1)))
    types = np.full(len(faces), POLYGON)
    blocks, _ = blocks_of(offsets, faces[there].astype(np.int64), types)
    points = np.array(obj.node_coordinates, np.float64)
    return FileContent(points, blocks, geographic=bool(obj.is_geographic)).to_mesh(surface)


def back(mesh: Mesh, obj: xugrid.Ugrid2d) -> xugrid.Ugrid2d:
    """A grid with the same names, attributes and reference system.

    Coordinates of edges and faces, where the grid has them, are those of the new places.
    """
    require_vertices(mesh.points, obj.n_node)
    new = copy.copy(obj)
    new.node_x, new.node_y = mesh.points.T.copy()
    given = new.to_dataset()  # the one way to all that belongs to it
    moved = type(obj).from_dataset(_with_attrs(new.assign_node_coords(given), given), obj.name)
    placed = moved.to_dataset()
    for facet in ("edge", "face"):
        names = moved.attrs.get(f"{facet}_coordinates", "").split()
        if any(name in given for name in names):
            placed = getattr(moved, f"assign_{facet}_coords")(placed)
    final = type(obj).from_dataset(_with_attrs(placed, given), obj.name)
    final.fill_value = obj.fill_value
    return final


def _with_attrs(dataset: Any, given: Any) -> Any:
    """Give coordinates back those attributes that they had before they were assigned."""
    for name in dataset.coords:
        if name in given:
            dataset[name].attrs |= given[name].attrs
    return dataset
