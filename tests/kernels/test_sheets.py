"""Sheets: their order, fits along them, pairs of triangles, means over neighbours."""

import numpy as np
import pytest

from qsmooth import Mesh, examples
from qsmooth.kernels._jit import use_threads
from qsmooth.kernels.sheets import (
    fit_along,
    group_sizes,
    mean_with_neighbours,
    order_sheets,
    pair_triangles,
)

LINE = np.array([[-1, 2], [3, -1], [0, 3], [2, 1]])  # 0 2 3 1
RING = np.array([[1, 2], [2, 0], [0, 1]])


@pytest.mark.nojit
def test_links_come_in_the_order_of_their_sheet():
    apart = np.where(RING >= 0, RING + 4, -1)
    offsets, links, closed = order_sheets(np.concatenate([LINE, apart, [[-1, -1]]]))
    assert offsets.tolist() == [0, 4, 5, 8]
    assert links[:5].tolist() == [0, 2, 3, 1, 7]
    assert sorted(links[5:].tolist()) == [4, 5, 6]
    assert closed.tolist() == [False, False, True]


def fitted(values, width, degree, closed=False):
    n = len(values)
    fit, residual = np.empty(n), np.empty(n)
    sheet = np.array([0, n]), np.arange(n), np.array([closed])
    fit_along(*sheet, np.array(values, float), width, degree, fit, residual)
    return fit, residual


@pytest.mark.nojit
@pytest.mark.parametrize("degree", [0, 1, 2])
def test_polynomials_are_kept_to_the_very_ends(degree):
    t = np.arange(12.0)
    values = 3.0 - 0.7 * t**degree
    fit, residual = fitted(values, 4, degree)
    assert fit == pytest.approx(values, rel=1e-10)
    assert residual == pytest.approx(np.zeros(12), abs=1e-12)


@pytest.mark.nojit
@pytest.mark.parametrize("closed", [False, True])
@pytest.mark.parametrize("degree", [0, 1, 2])
def test_agrees_with_least_squares(degree, closed):
    rng = np.random.default_rng(degree)
    n, width = 11, 3
    values = rng.normal(size=n)
    fit, residual = fitted(values, width, degree, closed)
    for i in range(n):
        js = [j for j in range(i - width, i + width + 1) if closed or 0 <= j < n]
        t = (np.array(js) - i) / (width + 1)
        weights = (1 - t**2) ** 2
        y = values[np.array(js) % n]
        polynomial = np.polynomial.Polynomial.fit(
            t, y, degree, w=np.sqrt(weights), domain=[-1, 1], window=[-1, 1]
        )
        left = (weights * (y - polynomial(t)) ** 2).sum() / weights.sum()
        assert fit[i] == pytest.approx(polynomial(0.0), abs=1e-12)
        assert residual[i] == pytest.approx(left * len(js) / (len(js) - degree - 1), abs=1e-12)


@pytest.mark.nojit
@pytest.mark.parametrize("n", [1, 2, 3])
@pytest.mark.parametrize("closed", [False, True])
def test_short_sheets_have_a_fit_too(n, closed):
    fit, residual = fitted(np.arange(float(n)), 5, 2, closed)
    assert np.isfinite(fit).all()
    assert np.isfinite(residual).all()
    if not closed:
        assert fit == pytest.approx(np.arange(n))


def test_two_threads_fit_to_the_bits_of_one():
    rng = np.random.default_rng(0)
    offsets = np.arange(0, 601, 20)
    links, closed = rng.permutation(600), rng.random(30) < 0.5
    values, results = rng.normal(size=600), []
    for threads in (1, 2):
        out = np.empty(600), np.empty(600)
        with use_threads(threads):
            fit_along(offsets, links, closed, values, 4, 2, *out)
        results.append((out[0].tobytes(), out[1].tobytes()))
    assert results[0] == results[1]


@pytest.mark.nojit
def test_halves_of_rectangles_pair_along_their_diagonals():
    mesh = examples.structured(3, 2, kind="mixed")
    top = mesh.topology
    pairs = pair_triangles(mesh.xy, *top.cells, top.twins)
    triangles = top.cell_sizes == 3
    assert (pairs[~triangles] == -1).all()
    partner = top.corner_cells[top.twins[pairs[triangles]]]
    assert partner.tolist() == [1, 0, 3, 2][: partner.size]


@pytest.mark.nojit
def test_triangles_pair_only_to_convex_quads():
    mesh = Mesh([(0, 0), (2, 0), (3, 0.5), (3, -3)], [(0, 1, 2), (0, 3, 1)])
    top = mesh.topology
    assert pair_triangles(mesh.xy, *top.cells, top.twins).tolist() == [-1, -1]


@pytest.mark.nojit
@pytest.mark.parametrize("cut", [0, 1])
@pytest.mark.parametrize("outward", [1.0, -1.0])
def test_halves_of_layers_round_a_bend_pair_along_their_diagonals(cut, outward):
    """Outside a bend sides are longer than diagonals."""
    radii, angles = 10.0 + outward * 1e-3 * np.cumsum(1.2 ** np.arange(6)), np.arange(9) * 0.2
    points = radii[:, None, None] * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    first = (np.arange(5)[:, None] * 9 + np.arange(8)).ravel()
    quads = np.stack([first, first + 1, first + 10, first + 9], axis=1)
    halves = np.roll(quads, -cut, axis=1)
    cells = np.stack([halves[:, [0, 1, 2]], halves[:, [0, 2, 3]]], axis=1).reshape(-1, 3)
    mesh = Mesh(points.reshape(-1, 2), cells)
    top = mesh.topology
    pairs = pair_triangles(mesh.xy, *top.cells, top.twins)
    partner = top.corner_cells[top.twins[pairs]]
    assert partner.tolist() == (np.arange(80) ^ 1).tolist()


@pytest.mark.nojit
def test_means_are_with_the_cells_across_the_sides():
    top = examples.structured(3, 1).topology
    means = np.empty((3, 1))
    values = np.array([[1.0], [2.0], [6.0]])
    mean_with_neighbours(top.cell_offsets, top.twins, top.corner_cells, values, means)
    assert means[:, 0] == pytest.approx([1.5, 3.0, 4.0])


@pytest.mark.nojit
def test_groups_are_cells_that_hang_together_across_sides():
    topology = examples.structured(4, 3).topology
    marked = np.array([1, 1, 0, 1, 0, 1, 0, 1, 1, 0, 0, 0], np.bool_)
    given = marked.copy()
    sides = topology.cell_offsets, topology.twins, topology.corner_cells
    sizes = group_sizes(*sides, marked)
    # Cells 0, 1 and 5; 3 and 7; and 8, which touches 5 at a corner only.
    assert sizes.tolist() == [3, 3, 0, 2, 0, 3, 0, 2, 1, 0, 0, 0]
    assert np.array_equal(marked, given)
