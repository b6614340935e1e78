"""Conjugate gradients with multigrid, for block matrices whose pattern stays: linear in its size."""

from __future__ import annotations

import numpy as np

from qsmooth._types import FloatArray, IndexArray, MoveArray, TableArray

# Blocks on the diagonal grow by this fraction of their trace where they are inverted.
SHIFT = 1e-6
# Rows of products of this length have places that need more than 16 bits.
LONG = 1 << 16


class _Level:
    """A matrix, and how it is made coarser.

    Parameters
    ----------
    offsets, columns
        CSR map of the matrix: symmetric, columns ascending, the diagonal among them.

    Attributes
    ----------
    values : (n_blocks, 4)
        The blocks, row by row.
    """

    def __init__(self, offsets: IndexArray, columns: TableArray) -> None:
        n = offsets.size - 1
        self.offsets, self.columns = offsets, columns
        rows = np.repeat(np.arange(n, dtype=np.uint32), np.diff(offsets))
        self.diagonal = np.flatnonzero(rows == columns)
        self.values = np.empty((columns.size, 4), np.float32)
        self.inverse = np.empty((n, 3), np.float32)
        self.right, self.x, self.before = (np.zeros((n, 2), np.float32) for _ in range(3))

    @property
    def size(self) -> int:
        """Block rows."""
        return self.offsets.size - 1

    def coarsened(self) -> _Level | None:
        """Set up the next level; None where no two rows have to do with each other any more."""
        from qsmooth.kernels import aggregation

        own = self.offsets, self.columns
        label = np.empty(self.size, np.int64)
        n = aggregation.aggregate(*own, label)
        if n == self.size:
            return None
        self.part = aggregation.interpolation(*own, label)
        self.row = aggregation.transposed(*self.part, n)
        maps = *own, *self.part[:2], *self.row[:2]
        *half, offsets, columns = aggregation.product_pattern(*maps)
        coarse = _Level(offsets, aggregation.sorted_rows(offsets, columns))
        self.half = tuple(half)
        self._find_places(maps, coarse)
        return coarse

    def _find_places(self, maps: tuple[IndexArray, ...], coarse: _Level) -> None:
        """Note where each product that the coarse matrix is the sum of is added."""
        from qsmooth.kernels.aggregation import product_places

        offsets, _, part_offsets, _, row_offsets, rows = maps
        lengths = np.diff(offsets)[rows], np.diff(part_offsets)[self.half[1]]
        to = coarse.offsets, coarse.columns
        places = []
        self.starts = np.empty((coarse.size, 2), np.int64)
        for k, (count, groups) in enumerate(zip(lengths, (row_offsets, self.half[0]), strict=True)):
            ends = np.concatenate([[0], np.cumsum(count)])
            self.starts[:, k] = ends[groups[:-1]]
            longest = np.diff((self.half[0], to[0])[k]).max()
            places.append(np.empty(ends[-1], np.uint16 if longest < LONG else np.uint32))
        self.half_places, self.to_places = places
        product_places(*maps, self.half, to, *places)

    def prepare(self, coarse: _Level | None) -> None:
        """Invert the diagonal, and work out the values of the coarse matrix."""
        from qsmooth.kernels.multigrid import invert_diagonal, multiply_out

        invert_diagonal(self.diagonal, self.values, SHIFT, self.inverse)
        if coarse is not None:
            part = self.part[0], self.part[2]
            multiply_out(
                self.offsets, self.values, part, self.row, self.half, self.starts,
                self.half_places, self.to_places, coarse.offsets, coarse.values,
            )  # fmt: skip

    def sweep_down(self, right: MoveArray, coarse: _Level) -> None:
        """Sweep from 0, and hand what remains to the coarse level."""
        from qsmooth.kernels.multigrid import combine, remaining, sweep_forward

        rows = self.offsets, self.columns, self.diagonal, self.values
        sweep_forward(*rows, self.inverse, right, self.x)
        remaining(*rows, self.x, self.before)
        combine(*self.row, self.before, coarse.right)

    def sweep_up(self, right: MoveArray, coarse: _Level) -> None:
        """Take what the coarse level has found, and sweep back."""
        from qsmooth.kernels.multigrid import add_parts, sweep_backward

        add_parts(*self.part, coarse.x, self.x, self.before)
        rows = self.offsets, self.columns, self.values
        sweep_backward(*rows, self.inverse, right, self.before, self.x)

    def solve(self, right: MoveArray) -> None:
        """Solve for each row by itself."""
        from qsmooth.kernels.multigrid import sweep_forward

        rows = self.offsets, self.columns, self.diagonal, self.values
        sweep_forward(*rows, self.inverse, right, self.x)


class Multigrid:
    """Solves systems of 2 by 2 blocks, symmetric and not negative, to a loose residual.

    Parameters
    ----------
    offsets, columns
        CSR map of the matrix: symmetric, columns ascending, the diagonal among them. Neighbours
        should have numbers near each other.

    Attributes
    ----------
    values : (n_blocks, 4)
        The blocks, row by row; to be filled in before `prepare`.
    """

    def __init__(self, offsets: IndexArray, columns: TableArray) -> None:
        self._levels = [_Level(offsets, columns)]
        while (coarse := self._levels[-1].coarsened()) is not None:
            self._levels.append(coarse)
        self.values = self._levels[0].values

    def prepare(self) -> None:
        """Work out what depends on the values, on every level."""
        for level, coarse in zip(self._levels, [*self._levels[1:], None], strict=True):
            level.prepare(coarse)

    def solve(self, right: FloatArray, tolerance: float, most: int) -> FloatArray:
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

        Notes
        -----
        S. G. Nash, A. Sofer, "Assessing a search direction within a truncated-Newton method",
        Oper. Res. Lett. 9 (1990).
        """
        from qsmooth.kernels.multigrid import MOST_CHUNKS, go_along, multiply, scalar_product, turn

        finest, products = self._levels[0], np.empty(MOST_CHUNKS)
        x, residual, image = np.zeros_like(right), right.copy(), np.empty_like(right)
        rounded, direction = right.astype(np.float32), np.zeros_like(right)
        before, fallen = 0.0, 0.0
        for self.iterations in range(1, most + 1):
            downhill = self._cycle(rounded)
            scalar_product(residual, downhill, products)
            slope = float(products.sum())
            turn(slope / before if before else 0.0, downhill, direction)
            multiply(finest.offsets, finest.columns, finest.values, direction, image, products)
            bend, before = float(products.sum()), slope
            if not (slope > 0.0 and bend > 0.0):
                break
            go_along(slope / bend, direction, image, x, residual, rounded)
            last = slope * slope / bend
            fallen += last
            if self.iterations * last <= tolerance * fallen:
                break
        return x

    def _cycle(self, right: MoveArray) -> MoveArray:
        """Go down the levels and up again, once: an approximate solution."""
        levels = self._levels
        rights = [right, *(level.right for level in levels[1:])]
        for k, level in enumerate(levels[:-1]):
            level.sweep_down(rights[k], levels[k + 1])
        levels[-1].solve(rights[-1])
        for k in reversed(range(len(levels) - 1)):
            levels[k].sweep_up(rights[k], levels[k + 1])
        return levels[0].x
