"""The order that vertices and cells have in memory while a mesh is smoothed.

Where neighbours lie far apart, sweeps wait for memory: a million quads in random numbering take
three to four times as long. Such a mesh is smoothed in another order, and results are given back in
the caller's. They do not depend on it: colours, stars and rings go by the caller's ids, and what
decides by maxima and by sums that are the same in any order.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from functools import cached_property
from typing import Any, Literal, TypeVar, cast

import numpy as np
import numpy.typing as npt

from qsmooth._types import BoolArray, FloatArray, IndexArray
from qsmooth.checks import read_only
from qsmooth.mesh import Mesh
from qsmooth.metrics import Quality, quality
from qsmooth.metrics.quality import FIGURES
from qsmooth.topology import Topology

# A mesh is scattered where more than this share of the steps from one corner of a cell to the next,
# and on to the next cell, leads further than the first level of a cache holds, or than this many
# rows of a grid.
SCATTERED, FAR, FAR_ROWS = 0.1, 4096, 4
# So many runs of so many steps are looked at.
RUNS, RUN = 16, 1024

# Metrics that are measured in the caller's order in any case.
ON_EDGES = ("orthogonality", "non_orthogonality", "skewness")

A = TypeVar("A", bound=npt.NDArray[Any])
How = Literal["measured", "kept", "curve"]
_how: list[How] = ["measured"]


@contextmanager
def numbered(how: How) -> Iterator[None]:
    """Keep the caller's numbering in this block, or leave it in any case; for tests."""
    _how.append(how)
    try:
        yield
    finally:
        _how.pop()


class Inside:
    """A mesh as it lies in memory while it is smoothed.

    Parameters
    ----------
    mesh
        As the caller has it.
    like
        Take the order of its vertices; else that is chosen.
    kept
        Keep the caller's order: another one does not pay for a look or two.

    Attributes
    ----------
    mesh
        As the caller has it.
    topology
        Its cells in the order inside.
    """

    def __init__(self, mesh: Mesh, like: Inside | None = None, *, kept: bool = False) -> None:
        self.mesh, self.topology = mesh, mesh.topology
        if kept:
            return
        if like is not None:
            if like.topology.is_renumbered:
                self.topology = mesh.topology.renumbered(like.topology.vertex_ids)
        elif _how[-1] == "curve" or (_how[-1] == "measured" and is_scattered(mesh.topology)):
            self.topology = mesh.topology.along_curve(mesh.xy)

    def at_vertices(self, values: A) -> A:
        """Put what the caller has at vertices, (n_vertices, ...), into the order inside; a copy."""
        if not self.topology.is_renumbered:
            return values.copy()
        return cast("A", np.take(values, self.topology.vertex_ids, axis=0))

    def chosen_vertices(self, chosen: BoolArray | None) -> BoolArray | None:
        """Put the caller's marks of vertices, (n_vertices,), into the order inside."""
        return _taken(chosen, self.topology.vertex_ids)

    def chosen_cells(self, chosen: BoolArray | None) -> BoolArray | None:
        """Put the caller's marks of cells, (n_cells,), into the order inside."""
        return _taken(chosen, self.topology.cell_ids)

    def back(self, values: A) -> A:
        """Put what there is at vertices inside into the caller's order; a copy."""
        if not self.topology.is_renumbered:
            return values.copy()
        out: A = np.empty_like(values)
        out[self.topology.vertex_ids] = values
        return out

    def quality(self, mesh: Mesh) -> Quality:
        """Measure a placement of the mesh, in the caller's order."""
        if not self.topology.is_renumbered:
            return quality(mesh)
        inner = Quality(self.topology, self.at_vertices(mesh.xy))
        return _InCallersOrder(self, inner, mesh.xy, mesh.points)

    def quality_at(self, xy: FloatArray) -> Quality:
        """Measure coordinates that are in the order inside; in the caller's order."""
        inner = Quality(self.topology, xy)
        if not self.topology.is_renumbered:
            return inner
        outer = self.back(xy)
        return _InCallersOrder(self, inner, outer, outer)

    @cached_property
    def cell_places(self) -> IndexArray:
        """Where the caller's cells are inside, (n_cells,)."""
        places = np.empty(self.topology.n_cells, np.int64)
        places[self.topology.cell_ids] = np.arange(places.size)
        return places

    @cached_property
    def corner_places(self) -> IndexArray:
        """Where the corners inside are in the caller's `Topology.cell_vertices`, (n_corners,)."""
        first = self.mesh.cell_offsets[self.topology.cell_ids] - self.topology.cell_offsets[:-1]
        return np.repeat(first, self.topology.cell_sizes) + np.arange(
            self.topology.cell_vertices.size
        )


class _InCallersOrder(Quality):
    """Metrics that are measured in the order inside, and given in the caller's."""

    def __init__(self, inside: Inside, inner: Quality, xy: FloatArray, points: FloatArray) -> None:
        super().__init__(inside.mesh.topology, xy, points)
        self._inner, self._places = inner, inside.cell_places

    def __getitem__(self, name: str) -> FloatArray:
        # What inner edges have may differ in the last bit where it is seen from the other cell.
        if name not in self._values and name not in ON_EDGES:
            self._values[name] = read_only(self._inner[name][self._places])
        return super().__getitem__(name)

    def _measure(self) -> None:
        for name in FIGURES:
            self._figures[name] = read_only(self._inner.figure(name)[self._places])
        self._doubtful = self._inner._doubtful

    def _glance(self) -> None:
        self._inner._glance()
        self._figures.setdefault("shape", read_only(self._inner.figure("shape")[self._places]))
        self._extremes = self._inner._extremes
        self._doubtful = self._inner._doubtful

    @cached_property
    def validity(self) -> IndexArray:
        return read_only(self._inner.validity[self._places])


def is_scattered(topology: Topology) -> bool:
    """Whether corners that follow each other lie far apart in memory, too often."""
    steps, far = topology.cell_vertices, max(FAR, FAR_ROWS * int(topology.n_vertices**0.5))
    stride = max(1, steps.size // (RUNS * RUN))
    starts = range(0, steps.size, RUN * stride)
    jumps = [np.abs(np.diff(steps[start : start + RUN])) > far for start in starts]
    return sum(int(run.sum()) for run in jumps) > SCATTERED * sum(run.size for run in jumps)


def _taken(chosen: BoolArray | None, ids: IndexArray) -> BoolArray | None:
    return None if chosen is None else chosen[ids]
