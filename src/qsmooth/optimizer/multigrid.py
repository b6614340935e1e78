"""Conjugate gradients with multigrid, for block matrices whose pattern stays: linear in cost."""

from __future__ import annotations

import numpy as np

from qsmooth._types import FloatArray, IndexArray, SingleArray, TableArray
from qsmooth.kernels.graphs import Graph, Shares

# Blocks on the diagonal grow by this fraction of their trace where they are inverted.
SHIFT = 1e-6
# Rows of products of this length have places that need more than 16 bits.
LONG = 1 << 16


class _Level:
    """A matrix, and how it is made coarser.

    Parameters
    ----------
    graph
        Its rows: symmetric, columns ascending, the diagonal among them.

    Attributes
    ----------
    values : (n_blocks, 4)
        The blocks, row by row.
    """

    def __init__(self, graph: Graph) -> None:
        n = graph.offsets.size - 1
        self.size, self.graph = n, graph
        rows = np.repeat(np.arange(n, dtype=np.uint32), np.diff(graph.offsets))
        self.diagonal = np.flatnonzero(rows == graph.columns)
        self.values = np.empty((rows.size, 4), np.float32)
        self.inverse = np.empty((n, 3), np.float32)
        self.right, self.x, self.before = (np.zeros((n, 2), np.float32) for _ in range(3))

    def coarsened(self) -> _Level | None:
        """Set up the next level; None where no two rows have to do with each other any more."""
        from qsmooth.kernels import aggregation

        label = np.empty(self.size, np.int64)
        n = aggregation.aggregate(*self.graph, label)
        if n == self.size:
            return None
        self.part = aggregation.interpolation(*self.graph, label)
        self.row = aggregation.transposed(self.part, n)
        self.half, to = aggregation.product_graphs(self.graph, self.part, self.row)
        coarse = _Level(Graph(to.offsets, aggregation.sorted_rows(*to)))
        self._find_places(coarse)
        return coarse

    def _find_places(self, coarse: _Level) -> None:
        """Note where each product that the coarse matrix is the sum of is added."""
        from qsmooth.kernels.aggregation import product_places

        first, self.half_places = _places(self.row, self.graph, self.half)
        then, self.to_places = _places(self.half, self.part, coarse.graph)
        self.starts = np.stack([first, then], axis=1)
        product_places(
            self.graph, self.part, self.row, self.half, coarse.graph, self.half_places,
            self.to_places,
        )  # fmt: skip

    def prepare(self, coarse: _Level | None) -> None:
        """Invert the diagonal, and work out the values of the coarse matrix."""
        from qsmooth.kernels.multigrid import invert_diagonal, multiply_out

        invert_diagonal(self.diagonal, self.values, SHIFT, self.inverse)
        if coarse is not None:
            multiply_out(
                self.graph.offsets, self.values, self.part, self.row, self.half, self.starts,
                self.half_places, self.to_places, coarse.graph.offsets, coarse.values,
            )  # fmt: skip

    def sweep_down(self, right: SingleArray, coarse: _Level) -> None:
        """Sweep from 0, and hand what remains to the coarse level."""
        from qsmooth.kernels.multigrid import combine, remaining, sweep_forward

        rows = *self.graph, self.diagonal, self.values
        sweep_forward(*rows, self.inverse, right, self.x)
        remaining(*rows, self.x, self.before)
        combine(*self.row, self.before, coarse.right)

    def sweep_up(self, right: SingleArray, coarse: _Level) -> None:
        """Take what the coarse level has found, and sweep back."""
        from qsmooth.kernels.multigrid import add_parts, sweep_backward

        add_parts(*self.part, coarse.x, self.x, self.before)
        sweep_backward(*self.graph, self.values, self.inverse, right, self.before, self.x)

    def solve(self, right: SingleArray) -> None:
        """Solve for each row by itself."""
        from qsmooth.kernels.multigrid import sweep_forward

        rows = *self.graph, self.diagonal, self.values
        sweep_forward(*rows, self.inverse, right, self.x)


def _places(
    left: Graph | Shares, right: Graph | Shares, product: Graph
) -> tuple[IndexArray, TableArray]:
    """Count the products of two matrices: where those of each row begin, and room for places."""
    ends = np.concatenate([[0], np.cumsum(np.diff(right.offsets)[left.columns])])
    is_short = np.diff(product.offsets).max() < LONG
    return ends[left.offsets[:-1]], np.empty(ends[-1], np.uint16 if is_short else np.uint32)


class Multigrid:
    """Solves systems of 2 by 2 blocks, symmetric and not negative, to a loose residual.

    Parameters
    ----------
    graph
        The rows of the matrix: symmetric, columns ascending, the diagonal among them. Neighbours
        should have numbers near each other.

    Attributes
    ----------
    values : (n_blocks, 4)
        The blocks, row by row; to be filled in before `prepare`.
    """

    def __init__(self, graph: Graph) -> None:
        self._levels = [_Level(graph)]
        while (coarse := self._levels[-1].coarsened()) is not None:
            self._levels.append(coarse)
        self.values = self._levels[0].values

    def prepare(self) -> None:
        """Work out what depends on the values, on every level."""
        for level, coarse in zip(self._levels, [*self._levels[1:], None], strict=True):
            level.prepare(coarse)

    def solve(
        self,
        right: FloatArray,
        tolerance: float,
        most: int,
        values: FloatArray | SingleArray | None = None,
    ) -> FloatArray:
        """Find roughly the least of ½ xᵀ A x − right · x, (n, 2).

        It is a direction downhill, however early it ends.

        Parameters
        ----------
        right : (n, 2)
            The right-hand side.
        tolerance
            It ends where as many iterations as there were, each like the last one, would bring
            this down by less than this fraction of what they have. A residual would say nothing
            where cells differ in size: it is largest where they are small.
        most
            Iterations at most.
        values : (n_blocks, 4), optional
            The blocks in double precision, where those that were prepared are too coarse.

        Notes
        -----
        S. G. Nash, A. Sofer, "Assessing a search direction within a truncated-Newton method",
        Oper. Res. Lett. 9 (1990).
        """
        from qsmooth.kernels.multigrid import MOST_CHUNKS, go_along, multiply, scalar_product, turn

        finest, products = self._levels[0], np.empty(MOST_CHUNKS)
        values = finest.values if values is None else values
        x, residual, image = np.zeros_like(right), right.copy(), np.empty_like(right)
        with np.errstate(over="ignore"):
            rounded, direction = right.astype(np.float32), np.zeros_like(right)
        before, fallen = 0.0, 0.0
        for self.iterations in range(1, most + 1):
            downhill = self._cycle(rounded)
            scalar_product(residual, downhill, products)
            slope = float(products.sum())
            turn(slope / before if before else 0.0, downhill, direction)
            multiply(*finest.graph, values, direction, image, products)
            bend, before = float(products.sum()), slope
            if not (slope > 0.0 and bend > 0.0):
                break
            go_along(slope / bend, direction, image, x, residual, rounded)
            last = slope * slope / bend
            fallen += last
            if self.iterations * last <= tolerance * fallen:
                break
        return x

    def _cycle(self, right: SingleArray) -> SingleArray:
        """Go down the levels and up again, once: an approximate solution."""
        levels = self._levels
        rights = [right, *(level.right for level in levels[1:])]
        for k, level in enumerate(levels[:-1]):
            level.sweep_down(rights[k], levels[k + 1])
        levels[-1].solve(rights[-1])
        for k in reversed(range(len(levels) - 1)):
            levels[k].sweep_up(rights[k], levels[k + 1])
        return levels[0].x
