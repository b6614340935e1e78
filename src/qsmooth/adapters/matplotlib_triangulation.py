"""Triangulations of matplotlib."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING

import numpy as np

from qsmooth.checks import require_vertices
from qsmooth.io.file_content import FileContent
from qsmooth.mesh import Mesh, Surface

if TYPE_CHECKING:
    from matplotlib.tri import Triangulation

NAME = "a Triangulation of matplotlib"


def accepts(obj: object) -> bool:
    """Whether this is a triangulation."""
    return isinstance(obj, getattr(sys.modules.get("matplotlib.tri"), "Triangulation", ()))


def to_mesh(obj: Triangulation, *, surface: Surface = "auto") -> Mesh:
    """Take the triangles that are not masked; those that are have no part in the mesh."""
    kept = slice(None) if obj.mask is None else ~obj.mask
    triangles = np.array(obj.triangles[kept], np.int64)
    return FileContent(np.stack([obj.x, obj.y], axis=1), [("triangle", triangles)]).to_mesh(surface)


def back(mesh: Mesh, obj: Triangulation) -> Triangulation:
    """A triangulation with the same triangles and mask."""
    from matplotlib.tri import Triangulation

    require_vertices(mesh.points, len(obj.x))
    mask = None if obj.mask is None else obj.mask.copy()
    x, y = mesh.points.T.copy()
    return Triangulation(x, y, obj.triangles.copy(), mask)
