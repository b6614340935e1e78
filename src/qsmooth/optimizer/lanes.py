"""The movable vertices of a mesh in blocks of lanes, and the optimiser's sweeps over them."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from qsmooth._types import BoolArray, FloatArray
from qsmooth.engine import Engine
from qsmooth.kernels.stars import Moves, Rings, Stars
from qsmooth.metrics import Quality
from qsmooth.optimizer.progress import Progress
from qsmooth.topology import Topology

if TYPE_CHECKING:
    from qsmooth.kernels.newton_sweep import Wall

# Multiple of the Newton step that is tried first: neighbours follow the same way in their turn.
RELAXATION = 1.7


class Lanes:
    """Sweeps over the movable vertices, and measures that only what can move counts in.

    Parameters
    ----------
    topology, stars
        Of the mesh, and of the vertices that may move.
    engine
        Who runs the sweeps.
    """

    def __init__(self, topology: Topology, stars: Stars, engine: Engine) -> None:
        from qsmooth.kernels.blocks import build_blocks

        self.topology, self.stars, self._engine = topology, stars, engine
        self.movable = np.zeros(topology.n_vertices, np.bool_)
        self.movable[stars.vertices] = True
        self._blocks = build_blocks(stars)
        self._n_colours = self._blocks.colour_blocks.size - 1
        self._rings = Rings(*topology.rings)
        n_movable = self._blocks.vertices.size
        self._moves = Moves(np.zeros(n_movable), np.zeros(n_movable))
        self._shortest = np.empty(n_movable)
        self.held = np.tile([2.0, -2.0, -2.0], (topology.n_vertices, 1))
        self.slims = np.zeros(self._blocks.cells.size)
        self._badness, self._shape = np.empty(topology.n_cells), np.empty(topology.n_cells)

    def quality(self, xy: FloatArray) -> Quality:
        """Measure the mesh at these coordinates."""
        return Quality(self.topology, xy)

    def hold(self, xy: FloatArray) -> None:
        """From now on let no corner get worse than the worst one at these coordinates."""
        from qsmooth.kernels.newton_sweep import corner_extremes

        extremes = np.empty((self.topology.n_cells, 3))
        corner_extremes(xy, *self.topology.cells, self.movable, extremes)
        slack = 1e-11
        self.held[:, 0] = extremes[:, 0].max() + slack
        self.held[:, 1] = extremes[:, 1].min() - slack
        self.held[:, 2] = extremes[:, 2].min() * (1.0 - slack)

    def newton(self, xy: FloatArray, wall: Wall, progress: Progress) -> None:
        """Sweep a round downhill on the mean shape and the wall."""
        from qsmooth.kernels.newton_sweep import newton_sweep

        lengths = self._moves.lengths
        for _ in range(progress.next_round()):
            self._engine.run(
                lambda colours: newton_sweep(
                    xy, self._blocks, colours, RELAXATION, wall, self.held, self.slims, lengths
                ),
                self._n_colours,
            )
            progress.sweeps += 1

    def wall_off(self, xy: FloatArray) -> None:
        """Put a wall on each cell's shape, a little beyond what it is now."""
        shape = self.quality(xy).shape
        slims = np.minimum(shape / 1.2, 1.0 / 1.5)
        self.slims[:] = slims[self._blocks.cells]

    def untangle(self, xy: FloatArray, sizes: FloatArray, epsilon: float) -> None:
        """Sweep once downhill on the regularised energy; sizes are squared lengths, (n,)."""
        from qsmooth.kernels.untangle_sweep import untangle_sweep

        lengths = self._moves.lengths
        self._engine.run(
            lambda colours: untangle_sweep(
                xy, self._blocks, colours, RELAXATION, sizes, epsilon, lengths
            ),
            self._n_colours,
        )

    def mend_more(self, xy: FloatArray, closed: BoolArray, progress: Progress) -> None:
        """Move each vertex to where more of its cells are good; closed corners don't count."""
        from qsmooth.kernels.tangles import mend_more

        topology, lengths = self.topology, self._moves.lengths
        stars = topology.star_offsets, topology.star_cells, topology.star_corners
        listed = self._blocks.vertices.astype(np.int64)
        self._engine.run(
            lambda _: mend_more(xy, (*stars, *topology.cells), closed, listed, lengths), 1
        )
        progress.sweeps += 1

    def place_doublets(self, xy: FloatArray, progress: Progress) -> None:
        """Put each vertex, all of them doublets, where the largest angle at it is least."""
        from qsmooth.kernels.impossible import place_doublets

        topology, lengths = self.topology, self._moves.lengths
        stars = topology.star_offsets, topology.star_cells, topology.star_corners
        listed = self._blocks.vertices.astype(np.int64)
        self._engine.run(lambda _: place_doublets(xy, listed, *stars, *topology.cells, lengths), 1)
        progress.sweeps += 1

    def report(self, xy: FloatArray, now: Quality, progress: Progress) -> None:
        """Note the last sweep in the history."""
        from qsmooth.kernels.untangle_sweep import shortest_edges

        lengths, shares = self._moves
        shortest_edges(xy, *self._rings, self._blocks.vertices, self._shortest)
        shares[:] = 0.0
        np.divide(lengths, self._shortest, out=shares, where=lengths > 0.0)
        progress.note(now, self._moves)

    def energy(self, xy: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Largest badness and mean shape energy of each cell, overwritten by the next call."""
        from qsmooth.kernels.newton_sweep import cell_energy

        cell_energy(xy, *self.topology.cells, self.movable, self._badness, self._shape)
        return self._badness, self._shape
