"""Meshes of meshio."""

from __future__ import annotations

import copy
import sys
from typing import TYPE_CHECKING

import numpy as np

from qsmooth.io.file_content import FileContent, of_mesh
from qsmooth.io.via_meshio import content_of, meshio_of
from qsmooth.mesh import Mesh, MeshLike, Surface, plain_mesh

if TYPE_CHECKING:
    import meshio

NAME = "a meshio.Mesh"


def accepts(obj: object) -> bool:
    """Whether this is a mesh of meshio."""
    return isinstance(obj, getattr(sys.modules.get("meshio"), "Mesh", ()))


def to_mesh(obj: meshio.Mesh, *, surface: Surface = "auto") -> Mesh:
    """See `from_meshio`."""
    return from_meshio(obj, surface=surface)


def back(mesh: Mesh, obj: meshio.Mesh) -> meshio.Mesh:
    """A copy of `obj` with the coordinates of `mesh`, and the point data that was interpolated.

    They are float64, also where those of `obj` were float32: rounded, a valid cell may be invalid.
    """
    if mesh.points.shape != obj.points.shape:
        raise ValueError(f"points of shape {mesh.points.shape} for a mesh of {obj.points.shape}")
    new = copy.deepcopy(obj)
    new.points = np.array(mesh.points)
    if isinstance(mesh.source, FileContent):
        new.point_data |= {name: mesh.source.point_data[name] for name in mesh.source.changed}
    return new


def from_meshio(mesh: meshio.Mesh, *, surface: Surface = "auto") -> Mesh:
    """Take the triangles and quads of a mesh of meshio; everything else is carried along.

    Parameters
    ----------
    surface
        What a third coordinate means, see `Mesh`.

    Raises
    ------
    MeshError
        If it is no mesh that can be smoothed.
    """
    return content_of(mesh).to_mesh(surface).with_origin(mesh)


def to_meshio(mesh: MeshLike) -> meshio.Mesh:
    """Make a mesh for meshio, with everything its file or its meshio mesh held.

    Raises
    ------
    TypeError
        If it is a mesh of another library: `as_mesh` takes these.
    """
    return meshio_of(of_mesh(plain_mesh(mesh)))
