"""Newton steps on all vertices at once, where local sweeps would creep."""

from __future__ import annotations

import math

import numpy as np

from qsmooth._types import FloatArray, SingleArray
from qsmooth.kernels.graphs import Graph
from qsmooth.kernels.rails import FREE, Rails
from qsmooth.kernels.stars import Stars
from qsmooth.optimizer.caps import Caps
from qsmooth.optimizer.multigrid import Multigrid
from qsmooth.sums import exact_sum
from qsmooth.topology import Topology

# The solver stops where so small a share of what the step promises is left: it need not be better
# than its linear model, and what is left is what sweeps see to.
TOLERANCE, MOST_ITERATIONS = 1e-1, 30
# Where what is held leaves no room for such a step, one to the last digits may fit: it keeps what
# the symmetry of a mesh keeps. Systems up to this size are solved so then, in double precision.
EXACT, MOST_EXACT_ITERATIONS, MOST_EXACT = 1e-26, 300, 1 << 15
# Shares of a step that are tried one after the other.
SHARES = (1.0, 0.5, 0.25, 0.06, 0.015, 4e-3, 1e-3)
# Vertices of cells that a step would make worse than what is held are put back so often before a
# smaller share is tried, unless there are then more such cells than there were, by this factor;
# those in so many rings around take less of it than they would.
PUT_BACK, MORE = 6, 1.2
TAPERED_RINGS = 8


class GlobalNewton:
    """Projected Newton steps on the shape energy of a mesh.

    The matrix couples the movable vertices of each cell; its pattern never changes, so each step
    only fills in the values.

    Parameters
    ----------
    topology, stars
        Of the mesh, and of the vertices that may move.
    corners, sizes, maps
        Targets, as in `cell_energy.cell_energy`.
    caps
        What is held. Vertices of cells that it calls lost stay where they are.
    rails
        Where the vertices may be.
    """

    def __init__(
        self,
        topology: Topology,
        stars: Stars,
        corners: FloatArray,
        sizes: FloatArray,
        maps: FloatArray,
        caps: Caps,
        rails: Rails = FREE,
    ) -> None:
        from qsmooth.kernels.aggregation import UNNUMBERED, breadth_first
        from qsmooth.kernels.shape_hessian import block_pattern

        self.topology, self._targets = topology, (corners, sizes, maps)
        self._forbidden, self._rails = caps.forbidden, rails
        moving = stars.vertices.astype(np.int64)
        if caps.lost.any():
            lost = topology.cell_vertices[np.repeat(caps.lost, topology.cell_sizes)]
            moving = np.setdiff1d(moving, lost)
        # From the caller's order, as are stars: solutions depend on it.
        moving = moving[np.argsort(topology.vertex_ids[moving])]
        self.unknown = np.full(topology.n_vertices, -1, np.int64)
        self.unknown[moving] = UNNUMBERED
        self.vertices, cells = np.empty_like(moving), np.empty(topology.n_cells, np.int64)
        stars_of = topology.star_offsets, topology.star_cells
        n_cells = breadth_first(
            moving, *stars_of, *topology.cells, self.unknown, self.vertices, cells
        )
        self._cells = cells[:n_cells]
        pattern = self.unknown, moving.size, *topology.cells, *stars_of, self.vertices
        self._graph = Graph(*block_pattern(*pattern))
        self._solver = Multigrid(self._graph)
        self._gradient = np.empty((moving.size, 2))

    def step(self, xy: FloatArray, rise: float = 0.0) -> float:
        """Take one step downhill on the mean shape, in place.

        Vertices of cells that would be forbidden stay, and those around them, until none is.

        Parameters
        ----------
        rise
            By so large a fraction the energy may rise, for sweeps to bring it down again.

        Returns
        -------
        float
            The fraction by which the energy fell; 0 where no step was found.
        """
        if not self.vertices.size:
            return 0.0
        gain = self._go_along(self._direction(xy), xy, rise)
        if gain == 0.0 and self.vertices.size <= MOST_EXACT:
            gain = self._go_along(self._direction(xy, exact=True), xy, rise)
        return gain

    def _go_along(self, direction: FloatArray, xy: FloatArray, rise: float) -> float:
        """Take the largest share of a step that is allowed and goes downhill, in place."""
        if not np.isfinite(direction).all():
            return 0.0
        before = self.energy(xy)
        trial = xy.copy()
        for share in SHARES:
            if not self._allowed(xy, share * direction, trial):
                continue
            after = self.energy(trial)
            if after < before * (1.0 + rise):
                xy[:] = trial
                return 1.0 - after / before
        return 0.0

    def _direction(self, xy: FloatArray, *, exact: bool = False) -> FloatArray:
        """Solve for the step, roughly or to the last digits, (n_unknown, 2)."""
        from qsmooth.kernels.shape_hessian import assemble

        # The energy is the same in any unit; single precision is not.
        unit = math.ldexp(1.0, math.frexp(float(np.ptp(xy, axis=0).max()))[1])
        corners, sizes, maps = self._targets
        values: FloatArray | SingleArray = self._solver.values
        if exact:
            values = np.empty(values.shape)
        assemble(
            xy / unit, *self.topology.cells, self._cells, self.unknown, *self._graph, corners,
            sizes * (unit**2, 1.0), maps, self._gradient, values.reshape(-1, 2, 2),
        )  # fmt: skip
        tangents = self._on_rails(xy, unit, values)
        if exact:
            self._solver.values[:] = values
        self._solver.prepare()
        end = (EXACT, MOST_EXACT_ITERATIONS) if exact else (TOLERANCE, MOST_ITERATIONS)
        steps = self._solver.solve(-self._gradient, *end, values) * unit
        if tangents is not None:
            along = (steps * tangents).sum(axis=1, keepdims=True) * tangents
            steps = np.where(tangents.any(axis=1, keepdims=True), along, steps)
        return steps

    def _on_rails(
        self, xy: FloatArray, unit: float, values: FloatArray | SingleArray
    ) -> FloatArray | None:
        """Leave the system only the tangents of vertices that may move along one, (n_unknown, 2).

        None where all may move anywhere.
        """
        from qsmooth.kernels.confining import project_system

        if not self._rails.origin.size:
            return None
        tangents, blocks = np.empty_like(self._gradient), values.reshape(-1, 2, 2)
        project_system(
            xy, self.vertices, *self._graph, self._rails, unit, self._gradient, blocks, tangents
        )
        return tangents

    def _allowed(self, xy: FloatArray, direction: FloatArray, trial: FloatArray) -> bool:
        """Fill in the step, with vertices of forbidden cells put back; whether that was enough."""
        from qsmooth.kernels.confining import confine_places
        from qsmooth.kernels.taper import taper

        topology, at = self.topology, self.vertices
        share, most = np.ones(topology.n_vertices), math.inf
        for _ in range(PUT_BACK):
            trial[at] = xy[at] + share[at, None] * direction
            if self._rails.origin.size:
                confine_places(trial, at.astype(np.uint32), self._rails)
            cells = self._forbidden(trial)
            count = int(cells.sum())
            if count == 0:
                return True
            if count > most:
                return False
            most = min(most, MORE * count)
            # Those around them less and less, or the cells between would be drawn out.
            stars = topology.star_offsets, topology.star_cells
            taper(cells, TAPERED_RINGS, *topology.cells, *stars, share)
        return False

    def energy(self, xy: FloatArray) -> float:
        """Sum of the energies of all corners that can change."""
        from qsmooth.kernels.cell_energy import cell_energy

        topology = self.topology
        worst, total = np.empty(topology.n_cells), np.empty(topology.n_cells)
        movable = self.unknown >= 0
        cell_energy(xy, *topology.cells, movable, *self._targets, worst, total)
        total *= np.where(topology.cell_sizes == 3, 1.0, 4.0)
        return exact_sum(total)
