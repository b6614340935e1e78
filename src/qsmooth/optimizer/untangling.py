"""Untangling: sweeps on a regularised energy until every cell is valid."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from qsmooth._types import BoolArray, FloatArray
from qsmooth.optimizer.lanes import Lanes
from qsmooth.optimizer.progress import ROUND, Progress
from qsmooth.outcome import Invalid
from qsmooth.topology import Topology

# Sweeps without any progress after which untangling gives up.
PATIENCE = 400
# Sweeps of the logarithmic mean that makes the local size smooth.
SIZE_RINGS = 3
# Square of the regularisation at a valid corner: it is lowered by the factor, down to the least,
# each time that no more is gained.
FLOOR, FLOOR_FACTOR, LEAST_FLOOR = 1e-4, 0.01, 1e-9
# The square grows by this times that of the smallest determinant, where that is negative.
PER_DETERMINANT = 0.04
# The smallest determinant has grown when it did by this fraction of itself.
LEAST_PROGRESS = 1e-3


def untangle(lanes: Lanes, xy: FloatArray, progress: Progress) -> None:
    """Sweep until every cell is valid; else leave the coordinates with the fewest invalid cells.

    A round that is over in between is noted, and what it comes to in the end.

    Parameters
    ----------
    lanes, progress
        The sweeps, and what counts them.
    xy : (n, 2)
        Changed in place.
    """
    from qsmooth.kernels.untangle_sweep import smallest_determinant

    cells = lanes.topology.cells
    sizes = local_sizes(lanes.topology, xy)
    smallest = np.empty(lanes.topology.n_cells)
    best_count, best_xy = lanes.quality(xy).n_invalid, xy.copy()
    n_hopeless, n_before = (
        int(hopeless_cells(lanes.topology, xy, lanes.movable).sum()),
        progress.sweeps,
    )
    floor, least, patience = FLOOR, -np.inf, PATIENCE
    while best_count > n_hopeless and not progress.spent():
        smallest_determinant(xy, *cells, sizes, smallest)
        worst = float(smallest.min())
        if worst > least + LEAST_PROGRESS * abs(least):
            least, patience = worst, PATIENCE
        elif patience == 0 and floor > LEAST_FLOOR:
            floor, least, patience = FLOOR_FACTOR * floor, worst, PATIENCE
        elif patience == 0:
            break
        patience -= 1
        epsilon = float(np.sqrt(floor + PER_DETERMINANT * min(0.0, worst) ** 2))
        lanes.untangle(xy, sizes, epsilon)
        progress.sweeps += 1
        if progress.sweeps % ROUND == 0:
            lanes.report(xy, lanes.quality(xy), progress)
        if worst > 0.0 or progress.sweeps % ROUND == 0 or (smallest <= 0.0).sum() < best_count:
            count = lanes.quality(xy).n_invalid
            if count < best_count:
                best_count, best_xy[:] = count, xy
    xy[:] = best_xy
    if progress.sweeps > n_before:
        lanes.report(xy, lanes.quality(xy), progress)


def with_proof(
    invalid: Invalid | None, topology: Topology, xy: FloatArray, movable: BoolArray
) -> Invalid | None:
    """Say for which of the cells that stay invalid it is proven that they must.

    `movable`, (n_vertices,), marks the vertices that could move.
    """
    if invalid is None or not invalid.after:
        return invalid
    hopeless = hopeless_cells(topology, xy, movable)
    proven = int(hopeless.sum())
    return replace(invalid, proven=proven, first_proven=int(np.argmax(hopeless)) if proven else -1)


def hopeless_cells(topology: Topology, xy: FloatArray, movable: BoolArray) -> BoolArray:
    """Mark the cells that no move can make valid, (n_cells,)."""
    from qsmooth.kernels import untangle_sweep as kernels

    hopeless = np.empty(topology.n_cells, np.bool_)
    kernels.hopeless_cells(xy, *topology.cells, movable, hopeless)
    return hopeless


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
