"""Untangling: sweeps on a regularised energy until every cell is valid, near the tangles alone."""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property

import numpy as np

from qsmooth._types import BoolArray, FloatArray, IndexArray
from qsmooth.metrics.impossible import Impossible, impossible
from qsmooth.optimizer.ground import Ground
from qsmooth.optimizer.islands import Islands, Task
from qsmooth.optimizer.progress import ROUND, Progress
from qsmooth.outcome import Invalid
from qsmooth.topology import Topology

# Edges from an invalid cell to the farthest vertex that may move at first; doubled where that is
# not enough. Where so large a share of all that is movable would move, all of it may.
RINGS = 2
MOST_LOCAL = 0.25
# Sweeps without any progress after which untangling gives up, near tangles and on the whole mesh;
# and the most sweeps near tangles with the same rings, for each ring: a change has to come and go.
LOCAL_PATIENCE, PATIENCE = 20, 400
MOST_SWEEPS = 40
# Sweeps of the logarithmic mean that makes the local size smooth.
SIZE_RINGS = 3
# Rounds of looking for places that mend more cells, where sweeps are stuck, and rounds of these
# without gain after which it is given up.
MENDING_ROUNDS, MENDING_PATIENCE = 60, 8


def untangle(ground: Ground, xy: FloatArray, progress: Progress) -> None:
    """Sweep until every cell is valid; else leave the coordinates with the fewest invalid cells.

    A round that is over in between is noted, and what it comes to in the end. Vertices far from
    invalid cells move only where moving the near ones is not enough.

    Parameters
    ----------
    ground, progress
        What may move, and what counts the sweeps.
    xy : (n, 2)
        Changed in place.
    """
    tangle = _Tangle(ground, xy, progress)
    tangle.sweep_and_grow()
    while tangle.stuck() and tangle.mend_more():
        tangle.sweep_and_grow()
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

    def stuck(self) -> bool:
        """Whether there are such cells, and sweeps are left."""
        return bool(self.bad().size) and not self.progress.spent()

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

    def sweep_and_grow(self) -> None:
        """Sweep near the invalid cells; where they stay, farther and farther around these."""
        rings, whole = RINGS, False
        while not whole and (bad := self.bad()).size and not self.progress.spent():
            near = self.near(bad, rings)
            whole = int(near.sum()) > MOST_LOCAL * self.n_movable
            vertices, patience = (self.ground.movable, PATIENCE) if whole else (near, LOCAL_PATIENCE)
            islands = Islands(self.task, vertices, patience)
            islands.sweep(None if whole else MOST_SWEEPS * rings)
            rings *= 2

    def mend_more(self) -> bool:
        """Look for places that mend more cells, one vertex at a time; say whether there were."""
        bad = self.bad()
        fewest, best, patience = bad.size, self.xy.copy(), MENDING_PATIENCE
        lanes = self.ground.lanes_of(self.near(bad, RINGS))
        for _ in range(MENDING_ROUNDS):
            if not (patience and fewest) or self.progress.spent():
                break
            lanes.mend_more(self.xy, self.proof.closed, self.progress)
            if self.progress.sweeps % ROUND == 0:
                lanes.report(self.xy, lanes.quality(self.xy), self.progress)
            count = self.bad().size
            patience -= 1
            if count < fewest:
                fewest, patience = count, MENDING_PATIENCE
                best[:] = self.xy
        self.xy[:] = best
        lanes.report(self.xy, lanes.quality(self.xy), self.progress)
        return fewest < bad.size

    def place_doublets(self) -> None:
        """Bring the largest angle of doublets as near to 180 degrees as it goes."""
        doublets = self.proof.doublets & self.ground.movable
        if not doublets.any() or self.progress.spent():
            return
        lanes = self.ground.lanes_of(doublets)
        lanes.place_doublets(self.xy, self.progress)
        lanes.report(self.xy, lanes.quality(self.xy), self.progress)


def with_proof(invalid: Invalid | None, ground: Ground, xy: FloatArray) -> Invalid | None:
    """Say for which of the cells that stay invalid it is proven that they must."""
    if invalid is None or not invalid.after:
        return invalid
    proof = impossible(ground.topology, xy, ground.movable)
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
    logarithms[~np.isfinite(logarithms)] = finite.mean() if finite.size else 0.0
    return np.exp(logarithms)
