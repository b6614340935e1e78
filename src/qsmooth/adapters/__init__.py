"""Meshes of other libraries, in memory: to a `Mesh` and back.

An adapter is a module of this package with four names: ``NAME`` (of what it takes, for people),
``accepts`` (is an object such a mesh), ``to_mesh`` and ``back``. Nothing lists them. They are
imported when something turns up that is neither a `Mesh` nor a pair, and must import their library
inside functions only: ``accepts`` looks whether it is loaded, as else there are no objects of it.
"""

from __future__ import annotations

from functools import cache
from importlib import import_module
from pkgutil import iter_modules
from typing import Any, Protocol, cast

from qsmooth.mesh import Mesh, Surface

__all__ = ["adapters", "as_mesh", "back"]

# What is often given in place of a mesh, and how to get at the mesh that it has.
HINTS = {
    "str": "read_mesh reads files",
    "PosixPath": "read_mesh reads files",
    "WindowsPath": "read_mesh reads files",
    "list": "a pair is a tuple",
    "SmoothResult": "its mesh is result.mesh",
    "ImageData": "cast_to_structured_grid() makes one",
    "RectilinearGrid": "cast_to_structured_grid() makes one",
    "MultiBlock": "combine() makes one",
    "UgridDataset": "its grid is ugrid.grid",
    "UgridDataArray": "its grid is ugrid.grid",
    "MeshKernel": "its mesh is mesh2d_get()",
}


class Adapter(Protocol):
    """What the module of a library has."""

    @property
    def NAME(self) -> str: ...  # noqa: N802

    def accepts(self, obj: object) -> bool:
        """Whether this is a mesh of that library; imports nothing."""
        ...

    def to_mesh(self, obj: Any, *, surface: Surface = "auto") -> Mesh:
        """Mesh of the triangles and quads; MeshError where they cannot be smoothed.

        What gives a mesh its form again later is its `origin`: `obj`, if nothing else is set here.
        """
        ...

    def back(self, mesh: Mesh, obj: Any) -> Any:
        """A copy of `obj` with the coordinates of `mesh`, which was made of it.

        With them goes the point data that was interpolated, as listed in `FileContent.changed`.
        """
        ...


@cache
def adapters() -> tuple[Adapter, ...]:
    """All adapters, by the names of their modules."""
    names = sorted(info.name for info in iter_modules(__path__))
    return tuple(cast("Adapter", import_module(f"{__name__}.{name}")) for name in names)


def as_mesh(obj: Any, *, surface: Surface = "auto", geographic: bool | None = None) -> Mesh:
    """Take a mesh of whatever library as a `Mesh`, with the data and the names that it carries.

    Whatever takes a mesh takes all of these, too; this is for what is said here.

    Parameters
    ----------
    obj
        A `Mesh`; a pair ``(points, cells)`` of arrays; a ``PolyData``, ``UnstructuredGrid`` or flat
        ``StructuredGrid`` of pyvista or VTK; ``gmsh`` or ``gmsh.model``, which is the current
        model; a ``MeshTri`` or ``MeshQuad`` of scikit-fem; a ``Triangulation`` of matplotlib; a
        ``Ugrid2d`` of xugrid; a ``Mesh2d`` of MeshKernel; a ``Mesh`` of meshio. It is not changed.
    surface
        What a third coordinate means, see `Mesh`: ``"flat"`` for a depth, say; ``"auto"`` leaves a
        `Mesh` as it is.
    geographic
        Whether x and y are longitudes and latitudes, see `Mesh`; None for what it says itself.

    Raises
    ------
    TypeError
        If it is none of these.
    MeshError
        If it is no mesh that can be smoothed.

    Examples
    --------
    >>> mesh = as_mesh(pyvista.read("bed.vtp"), surface="flat")
    >>> result = smooth(mesh)
    >>> result.back().plot()  # a PolyData again
    """
    if isinstance(obj, Mesh):
        return obj.taken_as(surface, geographic)
    if isinstance(obj, tuple) and len(obj) == 2:
        return Mesh(*obj, surface=surface, geographic=bool(geographic)).with_origin(obj)
    flat: Surface = "flat" if geographic else surface
    mesh = _adapter(obj).to_mesh(obj, surface=flat).with_geographic(geographic)
    return mesh if mesh.origin is not None else mesh.with_origin(obj)


def back(mesh: Mesh, obj: Any) -> Any:
    """Give `mesh`, which was made of `obj` and then moved, the form that `obj` has.

    Raises
    ------
    TypeError
        If there is no adapter for it.
    ValueError
        If the mesh has other vertices than `obj`.
    """
    if isinstance(obj, Mesh):
        return mesh
    if isinstance(obj, tuple) and len(obj) == 2:
        return mesh.points, obj[1]
    return _adapter(obj).back(mesh, obj)


def _adapter(obj: object) -> Adapter:
    for adapter in adapters():
        if adapter.accepts(obj):
            return adapter
    known = ", ".join(adapter.NAME for adapter in adapters())
    given = type(obj).__name__
    hint = f": {HINTS[given]}" if given in HINTS else ""
    raise TypeError(f"expected a Mesh, a pair (points, cells) or {known}; got {given}{hint}")
