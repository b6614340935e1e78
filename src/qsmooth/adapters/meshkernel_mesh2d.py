"""Meshes of MeshKernel."""

from __future__ import annotations

import copy
import sys
from typing import TYPE_CHECKING

import numpy as np

from qsmooth._types import FloatArray, IndexArray
from qsmooth.checks import require_vertices
from qsmooth.errors import MeshError
from qsmooth.io.file_content import FileContent
from qsmooth.io.vtk_cells import POLYGON, blocks_of
from qsmooth.mesh import Mesh, Surface

if TYPE_CHECKING:
    from meshkernel import Mesh2d

NAME = "a Mesh2d of MeshKernel"


def accepts(obj: object) -> bool:
    """Whether this is a mesh in two dimensions."""
    return isinstance(obj, getattr(sys.modules.get("meshkernel"), "Mesh2d", ()))


def to_mesh(obj: Mesh2d, *, surface: Surface = "auto") -> Mesh:
    """Take the faces; edges that no face has are line cells."""
    if len(obj.nodes_per_face) == 0:
        raise MeshError("the Mesh2d has no faces: take the one that MeshKernel.mesh2d_get() gives")
    offsets, vertices = _faces(obj)
    blocks, _ = blocks_of(offsets, vertices, np.full(len(offsets) - 1, POLYGON))
    edges = np.sort(obj.edge_nodes.reshape(-1, 2).astype(np.int64), axis=1)
    after = np.append(vertices[1:], vertices[:1])
    after[offsets[1:] - 1] = vertices[offsets[:-1]]
    n = len(obj.node_x)
    of_faces = np.minimum(vertices, after) * n + np.maximum(vertices, after)
    alone = edges[~np.isin(edges[:, 0] * n + edges[:, 1], of_faces)]
    if len(alone):
        blocks.append(("line", alone))
    return FileContent(np.stack([obj.node_x, obj.node_y], axis=1), blocks).to_mesh(surface)


def back(mesh: Mesh, obj: Mesh2d) -> Mesh2d:
    """A copy whose middles of edges and faces, where it has these, are at the new places."""
    require_vertices(mesh.points, len(obj.node_x))
    new: Mesh2d = copy.deepcopy(obj)
    new.node_x, new.node_y = mesh.points.T.copy()
    if len(obj.edge_x):
        new.edge_x, new.edge_y = mesh.points[obj.edge_nodes].reshape(-1, 2, 2).mean(axis=1).T.copy()
    if len(obj.face_x):
        new.face_x, new.face_y = _centres(mesh.points, *_faces(obj)).T.copy()
    return new


def _faces(obj: Mesh2d) -> tuple[IndexArray, IndexArray]:
    counts = obj.nodes_per_face.astype(np.int64)
    return np.append(0, np.cumsum(counts)), obj.face_nodes.astype(np.int64)


def _centres(points: FloatArray, offsets: IndexArray, vertices: IndexArray) -> FloatArray:
    """Centres of mass of polygons, (n, 2), the mean of the corners where there is no area."""
    counts = np.diff(offsets)
    means = np.add.reduceat(points[vertices], offsets[:-1]) / counts[:, None]
    at = points[vertices] - np.repeat(means, counts, axis=0)
    after = np.append(np.arange(1, len(at)), 0)
    after[offsets[1:] - 1] = offsets[:-1]
    cross = at[:, 0] * at[after, 1] - at[:, 1] * at[after, 0]
    twice = np.add.reduceat(cross, offsets[:-1])
    moment = np.add.reduceat((at + at[after]) * cross[:, None], offsets[:-1])
    scale = np.where(twice == 0.0, 1.0, 3.0 * twice)
    return means + moment / scale[:, None]
