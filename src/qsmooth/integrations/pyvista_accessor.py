"""``dataset.qsmooth``, which pyvista finds by the entry point ``pyvista.accessors``."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pyvista

from qsmooth.adapters.vtk_dataset import face_cells
from qsmooth.mesh import Surface
from qsmooth.methods.base import Method
from qsmooth.metrics import parse_metrics, quality
from qsmooth.smoothing import smooth, untangle

__all__ = ["Accessor"]


class Accessor:
    """Smoothing as filters: each gives a new dataset of the same class, to go on with.

    What is told of the work besides is for `qsmooth.smooth(dataset)`, which takes datasets too.

    Examples
    --------
    >>> grid.qsmooth.smooth().plot(show_edges=True)
    >>> grid.qsmooth.smooth("star", step=0.3).qsmooth.quality("skew").plot(scalars="skew")
    """

    def __init__(self, dataset: Any) -> None:
        self._dataset = dataset

    def smooth(
        self, method: str | Method = "auto", *, surface: Surface = "auto", **options: Any
    ) -> Any:
        """Give a copy that is smoothed; see `qsmooth.smooth` for methods and options.

        Parameters
        ----------
        surface
            What the third coordinate means, see `qsmooth.Mesh`.
        """
        return smooth(self._dataset, method, surface=surface, **options).back()

    def untangle(self, *, surface: Surface = "auto", **options: Any) -> Any:
        """Give a copy that is valid, or nearer to it; see `qsmooth.untangle`."""
        return untangle(self._dataset, surface=surface, **options).back()

    def quality(
        self,
        metrics: str | Sequence[str] | None = None,
        *,
        surface: Surface = "auto",
        geographic: bool | None = None,
    ) -> Any:
        """Give a copy with an array for each metric at its cells, and ``validity``.

        They are NaN, and -1, at cells that are neither triangles nor quads.

        Parameters
        ----------
        metrics
            Names, in a sequence or with commas between, or ``"all"``; by default the short list.
        surface, geographic
            As of `smooth`.
        """
        found = quality(self._dataset, surface=surface, geographic=geographic)
        new = self._dataset.copy(deep=True)
        cells = face_cells(new)
        for name in parse_metrics(metrics):
            values = np.full(new.n_cells, np.nan)
            values[cells] = found[name]
            new.cell_data[name] = values
        classes = np.full(new.n_cells, -1)
        classes[cells] = found.validity
        new.cell_data["validity"] = classes
        return new


for _kind in (pyvista.PolyData, pyvista.UnstructuredGrid, pyvista.StructuredGrid):
    pyvista.register_dataset_accessor("qsmooth", _kind)(Accessor)
