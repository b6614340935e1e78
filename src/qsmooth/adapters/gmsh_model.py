"""The current model of gmsh, which is moved in place."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import numpy as np

from qsmooth._types import FloatArray, IndexArray
from qsmooth.checks import require_vertices
from qsmooth.errors import MeshError
from qsmooth.io.file_content import FACES, FileContent
from qsmooth.io.gmsh import TAGS
from qsmooth.io.gmsh_types import TYPES
from qsmooth.mesh import Mesh, Surface

NAME = "a model of gmsh (gmsh, gmsh.model)"

# Dimensions of the elements that are taken; lower ones are points and lines.
DIMENSIONS = (0, 1, 2, 3)


@dataclass(frozen=True)
class Model:
    """A model by its name, and the tags of its nodes in the order of the vertices, (n,)."""

    name: str
    tags: IndexArray


def accepts(obj: object) -> bool:
    """Whether this is the library, its ``model``, or what was once made of that."""
    library = sys.modules.get("gmsh")
    return isinstance(obj, Model) or (
        library is not None and (obj is library or obj is getattr(library, "model", library))
    )


def to_mesh(obj: Any, *, surface: Surface = "auto") -> Mesh:
    """Take the triangles and quads of the current model; its lines and points are line cells.

    Vertices are in the order of the nodes' tags. Regions are the physical groups, or without such
    the entities; names are those of the physical groups.
    """
    model = _model()
    tags, points, _ = model.mesh.getNodes()
    order = np.argsort(tags)
    tags = np.asarray(tags, np.int64)[order]
    groups = {
        (dim, abs(int(entity))): tag
        for dim, tag in reversed(model.getPhysicalGroups())
        for entity in model.getEntitiesForPhysicalGroup(dim, tag)
    }
    blocks, pairs = [], []
    for dim, entity in (e for d in DIMENSIONS for e in model.getEntities(d)):
        codes, _, nodes = model.mesh.getElements(dim, entity)
        for code, ids in zip(codes, nodes, strict=True):
            kind, size = TYPES.get(int(code), ("", 0))
            if not kind:
                kind, _, _, size, _, _ = model.mesh.getElementProperties(int(code))
            cells = np.searchsorted(tags, np.asarray(ids, np.int64)).reshape(-1, size)
            blocks.append((kind, cells))
            pairs.append(np.tile([groups.get((dim, entity), 0), entity], (len(cells), 1)))
    physical = any(
        pair[0, 0] for (kind, _), pair in zip(blocks, pairs, strict=True) if kind in FACES
    )
    names = {
        name: (tag, dim)
        for dim, tag in model.getPhysicalGroups()
        if (name := model.getPhysicalName(dim, tag))
    }
    return (
        FileContent(
            np.reshape(points, (-1, 3))[order],
            blocks,
            [pair[:, 0 if physical else 1] for pair in pairs],
            names,
            cell_data={name: [pair[:, c] for pair in pairs] for c, name in enumerate(TAGS)},
        )
        .to_mesh(surface)
        .with_origin(Model(model.getCurrent(), tags))
    )


def back(mesh: Mesh, obj: Any) -> Any:
    """Put the nodes of the model where the vertices are; it is given back itself.

    That is the model that the mesh was made of, by its name, or else the current one.
    """
    made = obj if isinstance(obj, Model) else mesh.origin
    with _current(made.name if isinstance(made, Model) else None) as model:
        tags, points, _ = model.mesh.getNodes()
        order = np.argsort(tags)
        tags, points = np.asarray(tags, np.int64)[order], np.reshape(points, (-1, 3))[order]
        require_vertices(mesh.points, len(tags))
        if isinstance(made, Model) and not np.array_equal(made.tags, tags):
            raise ValueError(f"the nodes of gmsh's model {made.name!r} are not those of the mesh")
        moved = (points != mesh.points).any(axis=1)
        _place(model, dict(zip(tags[moved].tolist(), mesh.points[moved], strict=True)))
        return sys.modules["gmsh"] if obj is sys.modules["gmsh"] else model


def _place(model: Any, places: dict[int, FloatArray]) -> None:
    """Move nodes, by tag, and those parameters with them that they have on curves and surfaces."""
    for dim, entity in model.getEntities():
        tags, _, parameters = model.mesh.getNodes(dim, entity, returnParametricCoord=True)
        own = [tag for tag in map(int, tags) if tag in places]
        if not own:
            continue
        found = np.zeros((len(own), 0))
        if dim in (1, 2) and len(parameters):
            at = np.concatenate([places[tag] for tag in own])
            found = np.reshape(model.getParametrization(dim, entity, at), (-1, dim))
        for tag, parameter in zip(own, found, strict=True):
            model.mesh.setNode(tag, places[tag], parameter)


def _model() -> Any:
    """Gmsh's model, once there is one with a mesh in it."""
    gmsh = sys.modules["gmsh"]
    if not gmsh.isInitialized():
        raise MeshError("gmsh is not initialised: call gmsh.initialize(), then make or open a mesh")
    if len(gmsh.model.mesh.getNodes()[0]) == 0:
        raise MeshError(
            f"gmsh's model {gmsh.model.getCurrent()!r} has no mesh: gmsh.model.mesh.generate(2) "
            "makes one"
        )
    return gmsh.model


@contextmanager
def _current(name: str | None) -> Iterator[Any]:
    """Make the model of this name the current one for a while."""
    gmsh = sys.modules["gmsh"]
    if not gmsh.isInitialized():
        raise ValueError("gmsh is no longer initialised, and its model is gone")
    before = gmsh.model.getCurrent()
    if name is not None and name not in gmsh.model.list():
        raise ValueError(f"gmsh has no model {name!r} any more")
    try:
        if name is not None:
            gmsh.model.setCurrent(name)
        yield gmsh.model
    finally:
        gmsh.model.setCurrent(before)
