"""Meshes of scikit-fem."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING, Any

import numpy as np

from qsmooth._types import IndexArray
from qsmooth.checks import require_vertices
from qsmooth.errors import MeshError
from qsmooth.io.file_content import FileContent
from qsmooth.mesh import Mesh, Surface

if TYPE_CHECKING:
    import skfem

NAME = "a MeshTri or MeshQuad of scikit-fem"

KINDS = {"MeshTri1": "triangle", "MeshQuad1": "quad"}


def accepts(obj: object) -> bool:
    """Whether this is a mesh of scikit-fem, of whatever kind."""
    return isinstance(obj, getattr(sys.modules.get("skfem.mesh"), "Mesh", ()))


def to_mesh(obj: skfem.Mesh, *, surface: Surface = "auto") -> Mesh:
    """Take the cells; a region is what belongs to the same subdomains.

    The facets of boundaries are line cells, so that those inside the mesh keep their shape. Names
    of boundaries are those of point sets, names of subdomains those of cell sets.
    """
    kind = KINDS.get(type(obj).__name__)
    if kind is None:
        raise MeshError(
            f"only first-order triangles and quads can be smoothed, MeshTri1 and MeshQuad1; "
            f"this is a {type(obj).__name__}"
        )
    blocks = [(kind, np.array(obj.t.T, np.int64))]
    subdomains = _by_name(obj.subdomains)
    boundaries = {name: _facets(obj, ids) for name, ids in _by_name(obj.boundaries).items()}
    if boundaries:
        blocks.append(("line", np.unique(np.concatenate([*boundaries.values()]), axis=0)))
    none = np.zeros(0, np.int64)
    empty = [none] * (len(blocks) - 1)
    return FileContent(
        np.array(obj.p.T, np.float64, order="C"),
        blocks,
        _regions(blocks, subdomains),
        point_sets={name: np.unique(facets) for name, facets in boundaries.items()},
        cell_sets={name: [cells, *empty] for name, cells in subdomains.items()},
    ).to_mesh(surface)


def back(mesh: Mesh, obj: skfem.Mesh) -> skfem.Mesh:
    """A copy with the same boundaries and subdomains."""
    import dataclasses

    require_vertices(mesh.points, obj.p.shape[1])
    return dataclasses.replace(
        obj,
        doflocs=np.ascontiguousarray(mesh.points.T),
        t=obj.t.copy(),
        _boundaries=_copied(obj.boundaries),
        _subdomains=_copied(obj.subdomains),
    )


def _by_name(groups: dict[str, Any] | None) -> dict[str, IndexArray]:
    return {name: np.array(ids, np.int64) for name, ids in (groups or {}).items()}


def _copied(groups: dict[str, Any] | None) -> dict[str, Any] | None:
    return None if groups is None else {name: ids.copy() for name, ids in groups.items()}


def _facets(obj: skfem.Mesh, ids: IndexArray) -> IndexArray:
    ends: IndexArray = np.sort(obj.facets[:, ids].T.astype(np.int64), axis=1)
    return ends


def _regions(
    blocks: list[tuple[str, IndexArray]], subdomains: dict[str, IndexArray]
) -> list[IndexArray] | None:
    """A number for each cell by the subdomains that it is in; 0 for lines."""
    if not subdomains:
        return None
    inside = np.zeros((len(blocks[0][1]), len(subdomains)), np.bool_)
    for column, cells in enumerate(subdomains.values()):
        inside[cells, column] = True
    regions = np.unique(inside, axis=0, return_inverse=True)[1].reshape(-1)
    return [regions.astype(np.int64), *(np.zeros(len(lines), np.int64) for _, lines in blocks[1:])]
