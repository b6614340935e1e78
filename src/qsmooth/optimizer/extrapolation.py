"""Where sweeps creep: the place that a round of them is on its way to."""

from __future__ import annotations

import numpy as np

from qsmooth._types import FloatArray, IndexArray, TableArray
from qsmooth.engine import Engine
from qsmooth.kernels.rails import FREE, Rails
from qsmooth.parts import Alone

# Added to the diagonal of the least squares problem, as a fraction of its trace.
REGULARISATION = 1e-10
# Rounds to wait at most after places were refused again and again.
MOST_WAITS = 1
# A vertex without an edge of positive length moves by no share of it that could be noted.
NO_SIZE = 0.0


class Extrapolation:
    """Notes the moves of the sweeps of a round, and works out where they lead.

    Sweeps that creep go on in much the same way: a region that has to move moves by a little less
    each time. The weights of the sweeps' results, which add up to one, that bring the moves to the
    least sum of squares give a place much nearer to the end.

    Parameters
    ----------
    vertices : (n,)
        Those that move.
    n_sweeps
        Sweeps of a round.
    engine
        Who runs the loops.
    rails
        Where the vertices may be.
    part
        Sums up what several processes have, each of its own vertices; None for all here.

    Notes
    -----
    Reduced rank extrapolation, in cycles: A. Sidi, "Vector extrapolation methods with
    applications", SIAM (2017).
    """

    def __init__(
        self,
        vertices: TableArray,
        n_sweeps: int,
        engine: Engine,
        rails: Rails = FREE,
        part: Alone | None = None,
    ) -> None:
        n = vertices.size
        self._part = part or Alone()
        # A copy: kernels are compiled once more for arrays that are read-only.
        self._vertices, self._engine, self._rails = vertices.copy(), engine, rails
        self._moves = np.empty((n_sweeps, n, 2), np.float32)
        self._last, self._size, self._inv_size = np.empty((n, 2)), np.empty(n), np.empty(n)
        self._noted, self._wait, self._waits = 0, 0, 0

    @property
    def full(self) -> bool:
        """Whether a round is noted."""
        return self._noted == len(self._moves)

    def due(self) -> bool:
        """Whether it is time to try again: after each place that was refused it is tried less."""
        if self._wait:
            self._wait -= 1
            return False
        return True

    def judge(self, taken: bool) -> None:
        """Say whether the place was taken."""
        self._waits = 0 if taken else min(2 * self._waits + 1, MOST_WAITS)
        self._wait = self._waits

    def start(self, xy: FloatArray, size: FloatArray) -> None:
        """Begin with these coordinates; `size`, (n,), is the unit of length at each vertex."""
        self._noted = 0
        self._last[:] = xy[self._vertices]
        self._size[:] = size
        self._inv_size[:] = NO_SIZE
        np.divide(1.0, size, out=self._inv_size, where=size > 0.0)

    def note(self, xy: FloatArray) -> None:
        """Note what a sweep has moved."""
        from qsmooth.kernels.extrapolation import note_moves

        args = xy, self._vertices, self._inv_size, self._last, self._moves[self._noted]
        self._engine.run(lambda _: note_moves(*args), 1)
        self._noted += 1

    def extrapolated(self, xy: FloatArray) -> FloatArray | None:
        """Work out where the noted sweeps, which led to `xy`, lead; None if they say nothing."""
        from qsmooth.kernels.extrapolation import add_moves, products

        moves = self._moves[: self._noted]
        part, n = self._part, self._part.total(np.array([moves.shape[1]]))
        largest = part.largest(float(np.abs(moves).max(initial=0.0)))
        if self._noted < 3 or not 0.0 < largest < np.inf:
            return None
        weights = _weights(part.total(products(moves, largest, int(n[0]))))
        if weights is None:
            return None
        trial = xy.copy()
        args = trial, self._vertices, self._size, moves, weights
        self._engine.run(lambda _: add_moves(*args), 1)
        if self._rails.origin.size:
            from qsmooth.kernels.confining import confine_places

            self._engine.run(lambda _: confine_places(trial, self._vertices, self._rails), 1)
        part.complete(trial)
        return trial


def _weights(sums: IndexArray) -> FloatArray | None:
    """Turn the products of the moves of m sweeps into what each move is to be added once more."""
    last = sums[-1]
    # Of the differences to the last: exact, as these are integers.
    between = last[-1] - last[:-1, None] - last[None, :-1] + sums[:-1, :-1]
    matrix, right = between.astype(float), (last[-1] - last[:-1]).astype(float)
    matrix[np.diag_indices_from(matrix)] += REGULARISATION * np.trace(matrix)
    try:
        shares = np.linalg.solve(matrix, right)
    except np.linalg.LinAlgError:
        return None
    weights = np.concatenate([[0.0], -np.cumsum(shares)])
    return weights if np.isfinite(weights).all() else None
