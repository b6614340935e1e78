"""Sums of products of moves, and moves by weighted sums, against NumPy."""

import numpy as np
import pytest

from qsmooth.kernels._jit import use_threads
from qsmooth.kernels.extrapolation import add_moves, note_moves, products

pytestmark = pytest.mark.nojit


def moves_of(n_sweeps, n, seed=0):
    return np.random.default_rng(seed).normal(size=(n_sweeps, n, 2)).astype(np.float32)


def test_moves_are_noted_in_units_of_length_and_what_is_last_follows():
    rng = np.random.default_rng(1)
    xy, last = rng.normal(size=(9, 2)), rng.normal(size=(4, 2))
    vertices, inv_size = np.array([7, 0, 3, 8], np.uint32), np.array([1.0, 0.0, 4.0, 0.5])
    moves, before = np.full((4, 2), np.nan, np.float32), last.copy()
    note_moves(xy, vertices, inv_size, last, moves)
    assert moves == pytest.approx((xy[vertices] - before) * inv_size[:, None], rel=1e-6)
    assert np.array_equal(last, xy[vertices])


@pytest.mark.parametrize("scale", [1.0, 1e-12, 1e9])
def test_products_are_those_of_numpy_in_one_unit(scale):
    moves = moves_of(5, 70) * np.float32(scale)
    sums = products(moves, float(np.abs(moves).max()), moves.shape[1])
    flat = moves.reshape(5, -1).astype(float)
    expected = flat @ flat.T
    assert sums / sums[0, 0] == pytest.approx(expected / expected[0, 0], abs=1e-12)


def test_products_do_not_depend_on_order():
    moves = moves_of(4, 501, seed=2)
    largest, n = float(np.abs(moves).max()), moves.shape[1]
    shuffled = np.ascontiguousarray(moves[:, np.random.default_rng(3).permutation(501)])
    assert np.array_equal(products(moves, largest, n), products(shuffled, largest, n))


def test_the_largest_sum_fits():
    moves = np.ones((3, 1000, 2), np.float32)
    sums = products(moves, 1.0, moves.shape[1])
    assert (sums > 0).all()
    assert sums.max() < 2**62


@pytest.mark.parametrize("threads", [1, 2])
def test_weighted_moves_are_added(threads):
    rng = np.random.default_rng(4)
    xy, moves, weights = rng.normal(size=(9, 2)), moves_of(3, 4), rng.normal(size=3)
    vertices, size = np.array([7, 0, 3, 8], np.uint32), np.array([1.0, 0.0, 4.0, 0.5])
    expected = xy.copy()
    expected[vertices] += size[:, None] * np.tensordot(weights, moves.astype(float), axes=1)
    with use_threads(threads):
        add_moves(xy, vertices, size, moves, weights)
    assert xy == pytest.approx(expected, rel=1e-12)
