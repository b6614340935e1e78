"""What can be drawn: meshes, pairs of points and cells, results."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from qsmooth.adapters import as_mesh
from qsmooth.mesh import Mesh
from qsmooth.output.tables import method_title

if TYPE_CHECKING:
    from qsmooth.result import SmoothResult

Drawable: TypeAlias = "Mesh | SmoothResult | tuple[Any, Any]"


def mesh_of(mesh: Any) -> Mesh:
    """Give the mesh of what can be drawn, of a result the one after smoothing."""
    inner = getattr(mesh, "mesh", None)
    return inner if isinstance(inner, Mesh) else as_mesh(mesh)


def before_of(result: SmoothResult) -> Mesh:
    """Give the mesh that a result began with."""
    return result.mesh.with_points(result.quality_before.points)


def named_results(
    results: Mapping[str, SmoothResult] | Sequence[SmoothResult],
) -> dict[str, SmoothResult]:
    """Give results by the titles of their methods."""
    if not results:
        raise ValueError("there is no result to draw")
    if not isinstance(results, Mapping):
        named: dict[str, SmoothResult] = {}
        for result in results:
            count = sum(of.method == result.method for of in named.values())
            named[f"{result.method} ({count + 1})" if count else result.method] = result
        results = named
    return {method_title(name): result for name, result in results.items()}


def pair(before: Any, after: Any) -> tuple[Mesh, Mesh]:
    """Give the meshes before and after; a result alone stands for both."""
    if after is None:
        if not hasattr(before, "quality_before"):
            raise ValueError("after is missing: only a SmoothResult stands for both meshes")
        return before_of(before), before.mesh
    meshes = mesh_of(before), mesh_of(after)
    if not np.array_equal(meshes[0].cell_offsets, meshes[1].cell_offsets) or not np.array_equal(
        meshes[0].cell_vertices, meshes[1].cell_vertices
    ):
        raise ValueError("before and after must have the same cells")
    return meshes
