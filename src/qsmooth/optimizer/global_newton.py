"""Newton steps on all vertices at once, where local sweeps would creep."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import numpy as np

from qsmooth._types import FloatArray
from qsmooth.kernels.stars import Stars
from qsmooth.optimizer.caps import Caps
from qsmooth.sums import exact_sum
from qsmooth.topology import Topology

if TYPE_CHECKING:
    from scipy.sparse import bsr_matrix

# Up to so many movable vertices a sparse LU is quicker than conjugate gradients with multigrid,
# whose cost grows with the count alone (24K vertices .4 s against .6 s, 250K 16 s against 6 s).
DIRECT_UP_TO = 50_000
# The diagonal grows by this fraction, so that a semi-definite matrix can be factorised.
SHIFT = 1e-8
# Conjugate gradients stop at this residual: the step need not be better than its linear model.
TOLERANCE = 1e-2
MOST_ITERATIONS = 100
# A step that does not lower the energy is halved this often.
HALVINGS = 12
# Vertices of cells that a step would make worse than what is held are put back so often before the
# step is halved; those in so many rings around take less of it than they would.
PUT_BACK = 6
GRADED_RINGS = 8


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
    """

    def __init__(
        self,
        topology: Topology,
        stars: Stars,
        corners: FloatArray,
        sizes: FloatArray,
        maps: FloatArray,
        caps: Caps,
    ) -> None:
        from qsmooth.kernels.shape_hessian import block_pattern

        self.topology, self._targets = topology, (corners, sizes, maps)
        self._forbidden = caps.forbidden
        self.vertices = stars.vertices.astype(np.int64)
        if caps.lost.any():
            lost = topology.cell_vertices[np.repeat(caps.lost, topology.cell_sizes)]
            self.vertices = np.setdiff1d(self.vertices, lost)
        # In the caller's order, as are the cells that are summed up: solutions depend on it.
        self.vertices = self.vertices[np.argsort(topology.vertex_ids[self.vertices])]
        self._cells = np.argsort(topology.cell_ids)
        self.unknown = np.full(topology.n_vertices, -1, np.int64)
        self.unknown[self.vertices] = np.arange(self.vertices.size)
        self.offsets, self.columns = block_pattern(
            self.unknown, self.vertices.size, *topology.cells, topology.star_offsets,
            topology.star_cells, self.vertices,
        )  # fmt: skip
        self._values = np.empty((self.columns.size, 2, 2))
        self._gradient = np.empty((self.vertices.size, 2))

    def step(self, xy: FloatArray) -> float:
        """Take one step downhill on the mean shape, in place.

        Vertices of cells that would be forbidden stay, and those around them, until none is.

        Returns
        -------
        float
            The fraction by which the energy fell; 0 where no step was found.
        """
        from qsmooth.kernels.shape_hessian import assemble

        if not self.vertices.size:
            return 0.0
        assemble(
            xy, *self.topology.cells, self._cells, self.unknown, self.offsets, self.columns,
            *self._targets, self._gradient, self._values,
        )  # fmt: skip
        size = 2 * self.vertices.size
        from scipy.sparse import bsr_matrix

        matrix = bsr_matrix((self._values, self.columns, self.offsets), shape=(size, size))
        with _one_thread():
            direction = _solve(matrix, -self._gradient.ravel()).reshape(-1, 2)
        if not np.isfinite(direction).all():
            return 0.0
        before = self.energy(xy)
        trial = xy.copy()
        for k in range(HALVINGS):
            if not self._allowed(xy, 0.5**k * direction, trial):
                continue
            after = self.energy(trial)
            if after < before:
                xy[:] = trial
                return 1.0 - after / before
        return 0.0

    def _allowed(self, xy: FloatArray, direction: FloatArray, trial: FloatArray) -> bool:
        """Fill in the step, with vertices of forbidden cells put back; whether that was enough."""
        offsets, vertices = self.topology.cells
        counts = np.diff(offsets)
        share = np.ones(self.topology.n_vertices)
        for _ in range(PUT_BACK):
            trial[self.vertices] = xy[self.vertices] + share[self.vertices, None] * direction
            cells = self._forbidden(trial)
            if not cells.any():
                return True
            share[vertices[np.repeat(cells, counts)]] = 0.0
            # Those around them less and less, or the cells between would be drawn out.
            for _ in range(GRADED_RINGS):
                least = np.minimum.reduceat(share[vertices], offsets[:-1]) + 1.0 / GRADED_RINGS
                np.minimum.at(share, vertices, np.repeat(least, counts))
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


def _solve(matrix: bsr_matrix, right: FloatArray) -> FloatArray:
    """Solve a symmetric, positive semi-definite system of 2 by 2 blocks."""
    import scipy.sparse
    import scipy.sparse.linalg

    diagonal = matrix.diagonal()
    if diagonal.size <= 2 * DIRECT_UP_TO:
        shifted = matrix.tocsc() + scipy.sparse.diags(SHIFT * diagonal, format="csc")
        factors = scipy.sparse.linalg.splu(
            shifted,
            permc_spec="MMD_AT_PLUS_A",
            diag_pivot_thresh=0.0,
            options={"SymmetricMode": True},
        )
        solution: FloatArray = factors.solve(right)
        return solution
    import pyamg

    # What stiff regions can hardly resist: moving as a whole, along x or y.
    translations = np.tile(np.eye(2), (diagonal.size // 2, 1))
    with _fixed_random():
        levels = pyamg.smoothed_aggregation_solver(matrix, B=translations, max_coarse=500)
        solved: FloatArray = levels.solve(right, tol=TOLERANCE, maxiter=MOST_ITERATIONS, accel="cg")
    return solved


@contextmanager
def _one_thread() -> Iterator[None]:
    """Hold the linear algebra libraries to one thread: sums then have one order everywhere."""
    from threadpoolctl import threadpool_limits

    with threadpool_limits(limits=1):
        yield


@contextmanager
def _fixed_random() -> Iterator[None]:
    """Let pyamg's estimates of eigenvalues start from the same vectors each time."""
    state: Any = np.random.get_state()  # noqa: NPY002 (pyamg draws from the global generator)
    np.random.seed(0)  # noqa: NPY002
    try:
        yield
    finally:
        np.random.set_state(state)  # noqa: NPY002
