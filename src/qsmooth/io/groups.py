"""What a file calls its vertices and cells: point sets, cell sets, tags with a name, point data."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from qsmooth._types import BoolArray, FloatArray, IndexArray
from qsmooth.io.file_content import FileContent

if TYPE_CHECKING:
    from qsmooth.mesh import Mesh

DIMENSIONS = {"vertex": 0, "line": 1, "triangle": 2, "quad": 2}


def vertex_groups(mesh: Mesh) -> list[str]:
    """Names that the mesh's file has for vertices, or for cells of any kind on them."""
    content = _content(mesh)
    if content is None:
        return []
    return list(dict.fromkeys([*content.point_sets, *content.names, *content.cell_sets]))


def cell_groups(mesh: Mesh) -> list[str]:
    """Names that the mesh's file has for triangles and quads."""
    content = _content(mesh)
    if content is None:
        return []
    faces = [name for name, (_, dimension) in content.names.items() if dimension == 2]
    return list(dict.fromkeys([*faces, *content.cell_sets]))


def vertices_of_group(mesh: Mesh, name: str) -> BoolArray | None:
    """Mark the vertices of a name, (n_vertices,), or those of its cells; None if there is none.

    Capitals count only where the name is another without.
    """
    content, known = _content(mesh), _known(name, vertex_groups(mesh))
    if content is None or known is None:
        return None
    marked = np.zeros(mesh.n_vertices, np.bool_)
    if known in content.point_sets:
        marked[np.asarray(content.point_sets[known])] = True
    for (_, cells), chosen in zip(content.blocks, _chosen(content, known), strict=True):
        marked[cells[chosen]] = True
    return marked


def cells_of_group(mesh: Mesh, name: str) -> BoolArray | None:
    """Mark the triangles and quads of a name, (n_cells,); None if there is none."""
    content, known = _content(mesh), _known(name, cell_groups(mesh))
    if content is None or known is None:
        return None
    chosen = _chosen(content, known)
    return np.concatenate([chosen[b] for b in content.faces])


def point_data(mesh: Mesh) -> dict[str, FloatArray]:
    """Give the vectors that the mesh's file has at its points, (n_vertices, 2 or 3), by name."""
    content = _content(mesh)
    found: dict[str, Any] = {} if content is None else content.point_data
    arrays = {name: np.asarray(values) for name, values in found.items()}
    return {
        name: array.astype(np.float64)
        for name, array in arrays.items()
        if array.ndim == 2 and array.shape[1] in (2, 3) and array.dtype.kind in "fiu"
    }


def _content(mesh: Mesh) -> FileContent | None:
    return mesh.source if isinstance(mesh.source, FileContent) else None


def _known(name: str, names: list[str]) -> str | None:
    if name in names:
        return name
    alike = [each for each in names if each.lower() == name.lower()]
    return alike[0] if len(alike) == 1 else None


def _chosen(content: FileContent, name: str) -> list[BoolArray]:
    """Mark the cells of a name, for each block."""
    chosen = [np.zeros(len(cells), np.bool_) for _, cells in content.blocks]
    for marked, members in zip(chosen, content.cell_sets.get(name, []), strict=False):
        marked[np.asarray(members)] = True
    if name in content.names:
        tag, dimension = content.names[name]
        for b, tags in enumerate(_tags(content)):
            if DIMENSIONS.get(content.blocks[b][0]) == dimension:
                chosen[b] |= tags == tag
    return chosen


def _tags(content: FileContent) -> list[IndexArray]:
    """What names stand for: in Gmsh's files physical tags, also where regions are other ones."""
    return content.cell_data.get("gmsh:physical") or content.tags or []
