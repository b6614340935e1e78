"""Datasets of VTK, and of pyvista, which are the same with more methods."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from qsmooth._types import IndexArray
from qsmooth.checks import require_vertices
from qsmooth.errors import MeshError
from qsmooth.io.file_content import FACES, FileContent, region_tags
from qsmooth.io.vtk_cells import blocks_of, structured
from qsmooth.mesh import Mesh, Surface

if TYPE_CHECKING:
    from vtkmodules.vtkCommonDataModel import vtkPointSet

NAME = "a PolyData, UnstructuredGrid or StructuredGrid of pyvista or VTK"

CLASSES = "vtkPolyData", "vtkUnstructuredGrid", "vtkStructuredGrid"
# The cells of a PolyData, in its order, as types of VTK that have any count of vertices.
POLY_DATA = {"GetVerts": 2, "GetLines": 4, "GetPolys": 7, "GetStrips": 6}

# Offsets, vertices and types of cells.
Cells = tuple[IndexArray, IndexArray, IndexArray]


def accepts(obj: object) -> bool:
    """Whether this is a dataset of cells on points."""
    library = sys.modules.get("vtkmodules.vtkCommonDataModel")
    return isinstance(obj, tuple(getattr(library, name, ()) for name in CLASSES))


def to_mesh(obj: vtkPointSet, *, surface: Surface = "auto") -> Mesh:
    """Take the triangles and quads; lines, points, and numbers at points and cells go along.

    Integers at cells that are called as regions are, `qsmooth.io.file_content.REGION_NAMES`, are
    regions.
    """
    if obj.GetPoints() is None:
        raise MeshError(f"the {type(obj).__name__} has no points")
    blocks, sources = blocks_of(*_cells(obj))
    cell_data = {
        name: [values[source] for source in sources]
        for name, values in _arrays(obj.GetCellData()).items()
    }
    return FileContent(
        np.array(_numpy(obj.GetPoints().GetData()), np.float64),
        blocks,
        region_tags(cell_data, blocks),
        point_data=_arrays(obj.GetPointData()),
        cell_data=cell_data,
        field_data=_arrays(obj.GetFieldData()),
    ).to_mesh(surface)


def back(mesh: Mesh, obj: vtkPointSet) -> vtkPointSet:
    """A deep copy of the same class at the coordinates of `mesh`, which are float64.

    So they are where those of `obj` were float32, too: rounded, a valid cell may be invalid.
    """
    from vtkmodules.util.numpy_support import numpy_to_vtk
    from vtkmodules.vtkCommonCore import VTK_DOUBLE, vtkPoints

    require_vertices(mesh.points, obj.GetNumberOfPoints())
    new: vtkPointSet = _copy(obj)
    points = vtkPoints()
    points.SetData(numpy_to_vtk(mesh.points, deep=True, array_type=VTK_DOUBLE))
    new.SetPoints(points)
    if isinstance(mesh.source, FileContent):
        for name in mesh.source.changed:
            array = new.GetPointData().GetArray(name)
            _numpy(array)[...] = mesh.source.point_data[name]
            array.Modified()
    return new


def face_cells(obj: vtkPointSet) -> IndexArray:
    """Which cell of the dataset each cell of its mesh is, (n_cells,)."""
    blocks, sources = blocks_of(*_cells(obj))
    return np.concatenate(
        [s for (kind, _), s in zip(blocks, sources, strict=True) if kind in FACES]
    )


def _copy(obj: Any) -> Any:
    pyvista = sys.modules.get("pyvista")
    if pyvista is not None and isinstance(obj, pyvista.DataSet):
        return obj.copy(deep=True)
    new = obj.NewInstance()
    new.DeepCopy(obj)
    return new


def _cells(obj: Any) -> Cells:
    """All cells of a dataset, in its order."""
    if obj.IsA("vtkStructuredGrid"):
        if obj.HasAnyBlankCells() or obj.HasAnyBlankPoints():
            raise MeshError("a StructuredGrid with blank cells: cast it to an UnstructuredGrid")
        dimensions = [0, 0, 0]
        obj.GetDimensions(dimensions)
        return structured(dimensions)
    if obj.IsA("vtkUnstructuredGrid"):
        types = obj.GetCellTypes if _types_by_newer_name() else obj.GetCellTypesArray
        return *_connectivity(obj.GetCells()), _integers(types())
    parts = []
    for name, code in POLY_DATA.items():
        offsets, vertices = _connectivity(getattr(obj, name)())
        parts.append((offsets, vertices, np.full(len(offsets) - 1, code)))
    starts = np.cumsum([0, *(len(vertices) for _, vertices, _ in parts)])
    ends = [offsets[1:] + start for (offsets, _, _), start in zip(parts, starts, strict=False)]
    return (
        np.concatenate([[0], *ends]),
        np.concatenate([vertices for _, vertices, _ in parts]),
        np.concatenate([types for _, _, types in parts]),
    )


def _types_by_newer_name() -> bool:
    """Whether it gives the types of its cells by their newer name, which took a list before 9.6."""
    from vtkmodules.vtkCommonCore import vtkVersion

    version = vtkVersion.GetVTKMajorVersion(), vtkVersion.GetVTKMinorVersion()
    return bool(version >= (9, 6))


def _connectivity(cells: Any) -> tuple[IndexArray, IndexArray]:
    if cells is None or cells.GetNumberOfCells() == 0:
        return np.zeros(1, np.int64), np.zeros(0, np.int64)
    return _integers(cells.GetOffsetsArray()), _integers(cells.GetConnectivityArray())


def _arrays(data: Any) -> dict[str, npt.NDArray[Any]]:
    """Copies of the arrays of numbers, by name; others stay in the dataset alone."""
    arrays = [data.GetAbstractArray(i) for i in range(data.GetNumberOfArrays())]
    return {
        array.GetName(): np.array(_numpy(array))
        for array in arrays
        if array.GetName() and array.IsA("vtkDataArray") and not array.IsA("vtkBitArray")
    }


def _integers(array: Any) -> IndexArray:
    return np.array(_numpy(array), np.int64)


def _numpy(array: Any) -> npt.NDArray[Any]:
    from vtkmodules.util.numpy_support import vtk_to_numpy

    values: npt.NDArray[Any] = vtk_to_numpy(array)
    return values
