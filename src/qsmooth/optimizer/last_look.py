"""A last look at what is held: where it keeps vertices from better places."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from qsmooth._types import BoolArray, FloatArray, IndexArray
from qsmooth.optimizer.caps import FREE, HELD
from qsmooth.optimizer.lanes import Lanes
from qsmooth.outcome import Held

if TYPE_CHECKING:
    from qsmooth.kernels.newton_sweep import Wall

# A move that lowers the energy around its vertex by less than this fraction is not told of.
LEAST_LOSS = 1e-2


def kept_from_better(lanes: Lanes, xy: FloatArray, wall: Wall) -> tuple[Held, ...]:
    """Find the vertices that would move if nothing were held, and can't as it is.

    Each is tried once, all others where they are: it counts where every step of its sweep is
    refused by what is held and one would be taken if nothing were. The figure is the first, in the
    order of `HELD`, that one of its cells would break there.

    Parameters
    ----------
    lanes, xy
        The sweeps with what is held, and the coordinates, (n, 2), which meet it.
    wall
        The energy to go by.
    """
    held, nothing = lanes.caps.held, np.tile(FREE, (xy.shape[0], 1))
    trial, found = xy.copy(), []
    energy: FloatArray | None = None
    for colour in range(lanes.n_colours):
        vertices, can = lanes.try_colour(trial, colour, wall, held)
        trial[vertices] = xy[vertices]
        _, could = lanes.try_colour(trial, colour, wall, nothing)
        trial[vertices[~could | can]] = xy[vertices[~could | can]]
        stopped = vertices[could & ~can]
        if stopped.size:
            # No two of a colour share a cell: what a cell loses it loses by one of them.
            if energy is None:
                energy = _energy(lanes, xy, wall)
            loss, cells, figures = _broken(lanes, trial, wall, stopped, energy)
            found.append((loss, cells, figures))
            trial[stopped] = xy[stopped]
    if not found:
        return ()
    loss, cells, figures = (np.concatenate(parts) for parts in zip(*found, strict=True))
    said = []
    for k, name in enumerate(HELD):
        of_it = np.flatnonzero((figures == k) & (loss > LEAST_LOSS))
        if of_it.size:
            most = cells[of_it[loss[of_it] == loss[of_it].max()]]
            ids = lanes.topology.cell_ids[most]
            value, cell = lanes.caps.value(name, int(most[np.argmin(ids)])), int(ids.min())
            said.append(Held(figure=name, value=value, cell=cell, vertices=int(of_it.size)))
    return tuple(said)


def _broken(
    lanes: Lanes, trial: FloatArray, wall: Wall, vertices: IndexArray, energy: FloatArray
) -> tuple[FloatArray, IndexArray, IndexArray]:
    """Say by which fraction each energy would fall, and which cell would break which figure."""
    topology = lanes.topology
    first, last = topology.star_offsets[vertices], topology.star_offsets[vertices + 1]
    counts = last - first
    starts = np.cumsum(counts) - counts
    stars = topology.star_cells[np.repeat(first - starts, counts) + np.arange(counts.sum())]
    before = np.add.reduceat(energy[stars], starts)
    after = np.add.reduceat(_energy(lanes, trial, wall)[stars], starts)
    beyond: BoolArray = lanes.caps.beyond(trial)[stars]
    figure_of_cell = np.where(beyond.any(axis=1), beyond.argmax(axis=1), len(HELD))
    figure = np.minimum.reduceat(figure_of_cell, starts)
    is_first = figure_of_cell == np.repeat(figure, counts)
    at = np.minimum.reduceat(np.where(is_first, np.arange(stars.size), stars.size), starts)
    return 1.0 - after / before, stars[at], figure


def _energy(lanes: Lanes, xy: FloatArray, wall: Wall) -> FloatArray:
    """What each cell adds to the energy; of the wall on corners only its worst one."""
    badness, energy = lanes.energy(xy)
    energy = wall.mean_weight * energy * np.where(lanes.topology.cell_sizes == 3, 1.0, 4.0)
    return np.asarray(energy + (badness / wall.threshold) ** (2.0**wall.squarings))
