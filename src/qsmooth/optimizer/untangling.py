"""Untangling: sweeps on a regularised energy until every cell is valid, near the tangles alone."""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property

import numpy as np

from qsmooth._types import BoolArray, FloatArray, IndexArray
from qsmooth.metrics.impossible import Impossible, impossible
from qsmooth.optimizer.ground import Ground
from qsmooth.optimizer.islands import Islands, Task
from qsmooth.optimizer.progress import Progress
from qsmooth.outcome import Invalid
from qsmooth.sums import exact_mean
from qsmooth.topology import Topology

# Edges from an invalid cell to the farthest vertex that may move at first; doubled where that is
# not enough. Where a larger share than these of all that is movable would move, at first and then,
# all of it may.
RINGS = 2
MOST_LOCAL, MOST_GROWN = 0.25, 0.1
# Sweeps without any progress after which untangling gives up, near tangles and on the whole mesh;
# and the most sweeps near tangles, for each ring: the farther a change goes the longer it takes.
WAIT, PATIENCE = 20, 400
MOST_SWEEPS = 20
# Sweeps of the logarithmic mean that makes the local size smooth.
SIZE_RINGS = 3
# Rounds of looking for places that mend more cells, and rounds of these without gain after which
# it is given up: where sweeps near tangles are stuck, and where those on the whole mesh are.
LOCAL_MENDING, MENDING = (10, 3), (60, 8)


def untangle(ground: Ground, xy: FloatArray, progress: Progress) -> None:
    """Sweep until every cell is valid; else leave the coordinates with the fewest invalid cells.

    A round that is over in between is noted, and what it comes to in the end. Vertices far from
    invalid cells move only where moving the near ones is not enough, and no vertex slides where
    moving the others is.

    Parameters
    ----------
    ground, progress
        What may move, and what counts the sweeps.
    xy : (n, 2)
        Changed in place.
    """
    if ground.still.movable.any():
        _untangle(ground.still, xy, progress)
    slider = ground.slider
    if slider is None or progress.spent() or not _Tangle(ground, xy, progress).bad().size:
        return
    start = xy.copy()
    _untangle(ground, xy, progress)
    # Each tangle is left with its own best coordinates: two that lie side by side may not fit.
    if slider.meeting(xy).any() and not slider.meeting(start).any():
        xy[:] = start


def _untangle(ground: Ground, xy: FloatArray, progress: Progress) -> None:
    """Do so with all that may move on this ground."""
    tangle = _Tangle(ground, xy, progress)
    bad = tangle.sweep_and_grow()
    while bad.size and not progress.spent() and tangle.mend_more(bad):
        bad = tangle.sweep_and_grow()
    tangle.place_doublets()


class _Tangle:
    """The invalid cells of a mesh, and what can be done about them.

    Parameters
    ----------
    ground, xy, progress
        As in `untangle`.
    """

    def __init__(self, ground: Ground, xy: FloatArray, progress: Progress) -> None:
        self.ground, self.xy, self.progress = ground, xy, progress
        self.topology = ground.topology
        self.proof: Impossible = impossible(self.topology, xy, ground.movable)
        self.every_cell = np.arange(self.topology.n_cells)
        self.n_movable = int(ground.movable.sum())

    @cached_property
    def task(self) -> Task:
        """What is untangled; the local sizes are those of the mesh as it is when first wanted."""
        sizes = local_sizes(self.topology, self.xy)
        return Task(self.ground, self.progress, self.xy, self.proof.closed, sizes)

    def bad(self) -> IndexArray:
        """List the cells that are not valid and yet could be."""
        from qsmooth.kernels.tangles import bad_cells

        marked = np.empty(self.topology.n_cells, np.bool_)
        bad_cells(self.xy, *self.topology.cells, self.proof.closed, self.every_cell, marked)
        return np.flatnonzero(marked)

    def near(self, cells: IndexArray, rings: int) -> BoolArray:
        """Mark the movable vertices within so many edges of the cells, (n_vertices,)."""
        from qsmooth.kernels.tangles import grow

        marked = np.zeros(self.topology.n_vertices, np.bool_)
        offsets, vertices = self.topology.cells
        for corner in range(4):
            at = offsets[cells] + corner
            marked[vertices[at[at < offsets[cells + 1]]]] = True
        grow(marked, rings, *self.topology.rings)
        return marked & self.ground.movable

    def sweep_and_grow(self) -> IndexArray:
        """Mend or sweep near the invalid cells; where they stay, farther and farther around.

        Gives those that are left.

        Mending moves the fewest vertices, and keeps stretched cells stretched: it comes first, for
        islands that it can clear.
        """
        rings, whole, mend = RINGS, False, True
        bad = self.bad()
        while not whole and bad.size and not self.progress.spent():
            near, movable = self.near(bad, rings), self.ground.movable
            share = MOST_LOCAL if rings == RINGS else MOST_GROWN
            whole = int(near.sum()) > share * self.n_movable
            islands = Islands(self.task, movable if whole else near, PATIENCE if whole else WAIT)
            if mend and not whole:
                islands.mend_more(*LOCAL_MENDING, wholly=True)
                mend = False
            else:
                islands.sweep(None if whole else MOST_SWEEPS * rings)
                rings *= 2
            bad = self.bad()
        return bad

    def mend_more(self, bad: IndexArray) -> bool:
        """Look for places that mend more cells where no sweep does; say whether there were."""
        islands = Islands(self.task, self.near(bad, RINGS), 0)
        return islands.mend_more(*MENDING, wholly=False)

    def place_doublets(self) -> None:
        """Bring the largest angle of doublets as near to 180 degrees as it goes."""
        doublets = self.proof.doublets & self.ground.movable
        if not doublets.any() or self.progress.spent():
            return
        lanes = self.ground.lanes_of(doublets)
        lanes.place_doublets(self.xy, self.progress)
        lanes.report(self.xy, lanes.quality(self.xy), self.progress)


def with_proof(
    invalid: Invalid | None, topology: Topology, xy: FloatArray, movable: BoolArray
) -> Invalid | None:
    """Say for which of the cells that stay invalid it is proven that they must."""
    if invalid is None or not invalid.after:
        return invalid
    proof = impossible(topology, xy, movable)
    proven = int(proof.cells.sum())
    return replace(
        invalid,
        proven=proven,
        first_proven=int(np.argmax(proof.cells)) if proven else -1,
        proven_doublets=int(proof.by_doublet.sum()),
    )


def local_sizes(topology: Topology, xy: FloatArray) -> FloatArray:
    """Mean squared edge length at each vertex, (n,), made smooth over a few rings."""
    from qsmooth.kernels.untangle_sweep import mean_squared_edge, spread_logarithms

    sizes, spread = np.empty(topology.n_vertices), np.empty(topology.n_vertices)
    mean_squared_edge(xy, *topology.rings, sizes)
    with np.errstate(divide="ignore"):
        logarithms = np.log(sizes)
    for _ in range(SIZE_RINGS):
        spread_logarithms(*topology.rings, logarithms, spread)
        logarithms, spread = spread, logarithms
    finite = logarithms[np.isfinite(logarithms)]
    logarithms[~np.isfinite(logarithms)] = exact_mean(finite) if finite.size else 0.0
    return np.exp(logarithms)
