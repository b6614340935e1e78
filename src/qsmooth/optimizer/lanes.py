"""The movable vertices of a mesh in blocks of lanes, and the optimiser's sweeps over them."""

from __future__ import annotations

from collections.abc import Collection
from typing import TYPE_CHECKING

import numpy as np

from qsmooth._types import BoolArray, FloatArray
from qsmooth.engine import Engine
from qsmooth.kernels.stars import Moves, Rings, Stars
from qsmooth.metrics import Quality, Validity
from qsmooth.optimizer.progress import Progress
from qsmooth.targets import Targets, beside_others, ideal
from qsmooth.topology import Topology

if TYPE_CHECKING:
    from qsmooth.kernels.newton_sweep import Wall

# What can be held besides the angles and the scaled Jacobian: its worst in the mesh.
HOLDABLE = ("aspect_ratio", "shape", "min_edge")
# What holds nothing, and how far beyond the worst a trial may be for rounding.
FREE = (2.0, -2.0, -2.0, 1e300, 1e300, 0.0)
SLACK = 1e-11
# Of cosines: rounding, and what makes the angle worse by that fraction at the most.
ROUNDING = 4e-16
# The wall on a cell's shape is 1 high at this multiple of its shape energy, or at this energy.
SLIMMER, LEAST_SLIM = 1.2, 1.5
# While the worst cells are seen to, sizes count this much more in layers: else their heights drift.
LAYER_WEIGHT = 3.0
# And this much where layers border on other cells, whose worst angles would be paid with the height
# of the layer: at the trailing edge of an airfoil 1.9 times of it, and now 1.3. In triangles of
# layers too: their smallest angle is their height over their length.
BORDER_WEIGHT = 100.0
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
        from qsmooth.kernels.blocks import build_blocks, row_corners

        self.topology, self.stars, self._engine = topology, stars, engine
        self.movable = np.zeros(topology.n_vertices, np.bool_)
        self.movable[stars.vertices] = True
        self._blocks = build_blocks(stars)
        self._n_colours = self._blocks.colour_blocks.size - 1
        self._rings = Rings(*topology.rings)
        n_movable = self._blocks.vertices.size
        self._moves = Moves(np.zeros(n_movable), np.zeros(n_movable))
        self._shortest = np.empty(n_movable)
        self.held = np.tile(FREE, (topology.n_vertices, 1))
        self._corners = row_corners(self._blocks, *topology.cells)
        self.aim_at(ideal(topology))
        self._badness, self._shape = np.empty(topology.n_cells), np.empty(topology.n_cells)

    def quality(self, xy: FloatArray) -> Quality:
        """Measure the mesh at these coordinates."""
        return Quality(self.topology, xy)

    def hold(self, xy: FloatArray, also: Collection[str] = ()) -> None:
        """From now on let nothing get worse than the worst of it at these coordinates.

        The smallest and largest angle and the smallest scaled Jacobian are held always, and those
        of `HOLDABLE` that are listed. Where only the boundary connects regions of a mesh, each has
        its own worst.
        """
        from qsmooth.kernels.cell_energy import corner_extremes

        extremes = np.empty((self.topology.n_cells, 3))
        corner_extremes(xy, *self.topology.cells, self.movable, extremes)
        now = self.quality(xy)
        self.held[:] = FREE
        most, least = extremes[:, 0].max(), extremes[:, 1].min()
        self.held[:, 0] = most + SLACK * (1.0 - most**2) + ROUNDING
        self.held[:, 1] = least - SLACK * (1.0 - least**2) - ROUNDING
        self.held[:, 2] = extremes[:, 2].min() * (1.0 - SLACK)
        if "aspect_ratio" in also:
            self.held[:, 3] = float(now.aspect_ratio.max()) ** 2 * (1.0 + SLACK)
        if "shape" in also:
            self.held[:, 4] = 1.0 / float(now.shape.min()) * (1.0 + SLACK)
        if "min_edge" in also:
            self.held[:, 5] = 0.5 * float(now["min_edge"].min()) ** 2 * (1.0 - SLACK)

    def forbidden(self, xy: FloatArray) -> BoolArray:
        """Mark the cells that are invalid at these coordinates, or worse than what is held."""
        from qsmooth.kernels.cell_energy import corner_extremes

        topology, now = self.topology, self.quality(xy)
        extremes = np.empty((topology.n_cells, 3))
        corner_extremes(xy, *topology.cells, self.movable, extremes)
        first = topology.cell_offsets[:-1]
        held = self.held[topology.cell_vertices[first]].T
        bad = extremes[:, 0] > held[0]
        bad |= (extremes[:, 1] < held[1]) | (extremes[:, 2] < held[2])
        if (held[3] < FREE[3]).any():
            bad |= now.aspect_ratio**2 > held[3]
        if (held[4] < FREE[4]).any():
            bad |= now.shape * held[4] < 1.0
        if (held[5] > FREE[5]).any():
            bad |= 0.5 * now["min_edge"] ** 2 < held[5]
        bad |= now.validity != Validity.VALID
        movable = np.logical_or.reduceat(self.movable[topology.cell_vertices], first)
        return np.asarray(bad & movable)

    def newton(self, xy: FloatArray, wall: Wall, progress: Progress) -> None:
        """Sweep a round downhill on the mean shape and the wall."""
        from qsmooth.kernels.newton_sweep import newton_sweep

        lengths = self._moves.lengths
        for _ in range(progress.next_round()):
            self._engine.run(
                lambda colours: newton_sweep(
                    xy, self._blocks, colours, RELAXATION, wall, self.held, self._rows, lengths
                ),
                self._n_colours,
            )
            progress.sweeps += 1

    def aim_at(self, targets: Targets) -> None:
        """Ask each cell for this shape and size from now on; takes walls on shape down."""
        from qsmooth.kernels.blocks import Rows

        self.targets = targets
        cells = self._blocks.cells
        counts = targets.size_weight > 0.0
        area = np.where(counts, targets.area, 0.0)
        inv_area = np.divide(1.0, area, out=np.zeros_like(area), where=counts)
        self.sizes = np.stack([inv_area, targets.size_weight], axis=1)
        corners = targets.corners[self._corners]
        self._rows = Rows(
            m11=corners[:, 0].copy(),
            m12=corners[:, 1].copy(),
            m22=corners[:, 2].copy(),
            area=area[cells],
            inv_area=inv_area[cells],
            size_weight=targets.size_weight[cells],
            slim=np.zeros(cells.size),
        )

    def wall_off(self, xy: FloatArray) -> None:
        """Put a wall on each cell's shape, a little beyond what it is now."""
        slim = 1.0 / np.maximum(SLIMMER * self.worst_shape(xy), LEAST_SLIM)
        topology, is_layer, cells = self.topology, self.targets.is_layer, self._blocks.cells
        at_stake = beside_others(topology, is_layer) | (topology.cell_sizes == 3)
        weight = np.where(at_stake, BORDER_WEIGHT, LAYER_WEIGHT)
        weight = np.where(is_layer, weight, 1.0) * self.targets.size_weight
        self._rows = self._rows._replace(slim=slim[cells], size_weight=weight[cells])

    def worst_shape(self, xy: FloatArray) -> FloatArray:
        """Largest shape energy of each cell's corners towards their targets, (n_cells,)."""
        from qsmooth.kernels.cell_energy import worst_shape

        shape = np.empty(self.topology.n_cells)
        worst_shape(xy, *self.topology.cells, self.targets.corners, shape)
        return shape

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
        from qsmooth.kernels.cell_energy import cell_energy

        cells, corners = self.topology.cells, self.targets.corners
        cell_energy(xy, *cells, self.movable, corners, self.sizes, self._badness, self._shape)
        return self._badness, self._shape
