"""A mesh whose file shows the quality of its cells."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from qsmooth.adapters import as_mesh
from qsmooth.io.file_content import of_mesh
from qsmooth.mesh import Mesh
from qsmooth.metrics import METRICS, quality


def with_quality(mesh: Any) -> Mesh:
    """Give a mesh the metrics of its cells as cell data, for `write_mesh`.

    Parameters
    ----------
    mesh
        A `Mesh`, a pair ``(points, cells)`` or what `as_mesh` takes.

    Returns
    -------
    Mesh
        The same mesh. Formats that hold cell data, as .vtu and .vtk, write every metric of
        `qsmooth.metrics.METRICS` by its name, NaN where one is not defined, on line and point
        cells too; and ``validity``, a number of `Validity`, -1 for these. Data of the same names
        that the mesh had are replaced. A file of its own format is written anew.
    """
    given: Mesh = as_mesh(mesh)
    measured, content = quality(given), of_mesh(given)
    arrays: dict[str, Any] = {name: measured[name] for name in METRICS}
    arrays["validity"] = measured.validity
    cell_data = dict(content.cell_data)
    for name, values in arrays.items():
        whole = values.dtype.kind == "i"
        parts = [
            np.full(len(cells), -1) if whole else np.full(len(cells), np.nan)
            for _, cells in content.blocks
        ]
        first = 0
        for b in content.faces:
            last = first + len(parts[b])
            parts[b] = np.array(values[first:last])
            first = last
        cell_data[name] = parts
    return given.with_source(replace(content, cell_data=cell_data), content.lines[0])
