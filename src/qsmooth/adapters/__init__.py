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

__all__ = ["adapters", "back", "to_mesh"]


class Adapter(Protocol):
    """What the module of a library has."""

    @property
    def NAME(self) -> str: ...  # noqa: N802

    def accepts(self, obj: object) -> bool:
        """Whether this is a mesh of that library; imports nothing."""
        ...

    def to_mesh(self, obj: Any, *, surface: Surface = "auto") -> Mesh:
        """Mesh of the triangles and quads; MeshError where they cannot be smoothed."""
        ...

    def back(self, mesh: Mesh, obj: Any) -> Any:
        """A copy of `obj` with the coordinates of `mesh`, which was made of it."""
        ...


@cache
def adapters() -> tuple[Adapter, ...]:
    """All adapters, by the names of their modules."""
    names = sorted(info.name for info in iter_modules(__path__))
    return tuple(cast("Adapter", import_module(f"{__name__}.{name}")) for name in names)


def to_mesh(obj: Any, *, surface: Surface = "auto", geographic: bool | None = None) -> Mesh:
    """Take a mesh, a pair ``(points, cells)`` or a mesh of another library as a `Mesh`.

    Parameters
    ----------
    surface
        What a third coordinate means, see `Mesh`; a `Mesh` has had that said already.
    geographic
        Whether x and y are longitudes and latitudes, see `Mesh`; None for what it says itself.

    Raises
    ------
    TypeError
        If there is no adapter for it.
    MeshError
        If it is no mesh that can be smoothed.
    """
    if isinstance(obj, Mesh):
        return obj.with_geographic(geographic)
    if isinstance(obj, tuple) and len(obj) == 2:
        return Mesh(*obj, surface=surface, geographic=bool(geographic))
    flat: Surface = "flat" if geographic else surface
    return _adapter(obj).to_mesh(obj, surface=flat).with_geographic(geographic)


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
    known = " or ".join(["a pair (points, cells)", *(adapter.NAME for adapter in adapters())])
    raise TypeError(f"expected a Mesh, {known}, got {type(obj).__name__}")
