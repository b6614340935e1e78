"""Conjugate gradients with multigrid: against dense solutions, and as quick at any size."""

import numpy as np
import pytest

from qsmooth.kernels import multigrid as kernels
from qsmooth.kernels._jit import use_threads
from qsmooth.kernels.graphs import Graph
from qsmooth.optimizer.multigrid import Multigrid


def grid_graph(nx, ny):
    """Each place of a grid with those up to one row and column away: CSR, columns ascending."""
    ids = np.arange(nx * ny).reshape(ny, nx)
    rows, columns = [], []
    for dy in (-1, 0, 1):
        for dx in (-1, 0, 1):
            here = ids[max(0, -dy) : ny - max(0, dy), max(0, -dx) : nx - max(0, dx)]
            there = ids[max(0, dy) : ny + min(0, dy), max(0, dx) : nx + min(0, dx)]
            rows.append(here.ravel())
            columns.append(there.ravel())
    return csr(np.concatenate(rows), np.concatenate(columns), nx * ny)


def csr(rows, columns, n):
    order = np.lexsort((columns, rows))
    offsets = np.concatenate([[0], np.cumsum(np.bincount(rows, minlength=n))])
    return offsets, columns[order].astype(np.uint32)


def elastic(offsets, columns, seed=0):
    """Springs of any stiffness and direction between neighbours, and a weak hold: definite."""
    rng = np.random.default_rng(seed)
    n = offsets.size - 1
    rows = np.repeat(np.arange(n), np.diff(offsets))
    values = np.zeros((columns.size, 2, 2))
    at = {(i, j): k for k, (i, j) in enumerate(zip(rows.tolist(), columns.tolist(), strict=True))}
    for (i, j), k in at.items():
        if i < j:
            spring = rng.normal(size=(2, 2))
            spring = spring @ spring.T + 0.1 * np.eye(2)
            values[k] = values[at[j, i]] = -spring
            values[at[i, i]] += spring
            values[at[j, j]] += spring
    for i in range(n):
        values[at[i, i]] += 1e-3 * np.eye(2)
    return values


def dense(offsets, columns, values):
    n = offsets.size - 1
    out = np.zeros((2 * n, 2 * n))
    for i in range(n):
        for k in range(offsets[i], offsets[i + 1]):
            j = int(columns[k])
            out[2 * i : 2 * i + 2, 2 * j : 2 * j + 2] = values[k]
    return out


def filled(offsets, columns, values):
    solver = Multigrid(Graph(offsets, columns))
    solver.values[:] = values.reshape(-1, 4)
    solver.prepare()
    return solver


GRAPHS = {
    "a grid": lambda: grid_graph(13, 9),
    "a strip": lambda: grid_graph(60, 1),
    "one place": lambda: grid_graph(1, 1),
    "two parts and a lone place": lambda: parted(),
    "a hub": lambda: hub(40),
}


def parted():
    (offsets, columns), n = grid_graph(5, 4), 20
    offsets = np.concatenate([offsets, offsets[1:] + offsets[-1], [2 * offsets[-1] + 1]])
    return offsets, np.concatenate([columns, columns + n, [2 * n]]).astype(np.uint32)


def hub(n):
    """A vertex with many neighbours around it, each of which has two more."""
    around = np.arange(n)
    pairs = [(around, around), (around, (around + 1) % n), ((around + 1) % n, around)]
    pairs += [(around, np.full(n, n)), (np.full(n, n), around), ([n], [n])]
    rows, columns = (np.concatenate([pair[k] for pair in pairs]) for k in range(2))
    return csr(rows, columns, n + 1)


@pytest.mark.nojit
@pytest.mark.parametrize("rows", [1, 8192, 8193, 100_000, 10_000_000])
def test_rows_are_cut_into_chunks_by_their_number_alone(rows):
    n_chunks = -(-rows // kernels.chunk_rows(rows))
    assert n_chunks == min(kernels.MOST_CHUNKS, -(-rows // kernels.CHUNK))


@pytest.mark.parametrize("graph", GRAPHS)
@pytest.mark.parametrize("tolerance", [1e-1, 1e-4])
def test_it_finds_all_but_a_share_of_the_least_value(graph, tolerance):
    offsets, columns = GRAPHS[graph]()
    values = elastic(offsets, columns)
    right = np.random.default_rng(1).normal(size=(offsets.size - 1, 2))
    solver = filled(offsets, columns, values)
    x = solver.solve(right, tolerance, 100).ravel()
    matrix = dense(offsets, columns, values)
    found = right.ravel() @ x - 0.5 * x @ matrix @ x
    most = 0.5 * right.ravel() @ np.linalg.solve(matrix, right.ravel())
    assert (1.0 - tolerance) * most <= found <= (1.0 + 1e-4) * most
    assert solver.iterations < 40


def test_the_coarse_matrix_is_that_of_coarse_displacements():
    offsets, columns = GRAPHS["two parts and a lone place"]()
    values = elastic(offsets, columns)
    fine, coarse, *_ = filled(offsets, columns, values)._levels
    at, parts, shares = fine.part
    p = np.zeros((fine.size, coarse.size))
    for i in range(fine.size):
        p[i, parts[at[i] : at[i + 1]]] = shares[at[i] : at[i + 1]]
    assert p.sum(axis=1) == pytest.approx(1.0, rel=1e-6)
    assert np.array_equal(fine.row.offsets, np.concatenate([[0], np.cumsum((p > 0.0).sum(axis=0))]))
    wide = np.kron(p, np.eye(2))
    expected = wide.T @ dense(offsets, columns, values) @ wide
    found = dense(*coarse.graph, coarse.values.reshape(-1, 2, 2))
    assert found == pytest.approx(expected, abs=1e-5 * np.abs(expected).max())
    starts, columns = coarse.graph
    for i in range(coarse.size):
        row = columns[starts[i] : starts[i + 1]]
        assert (np.diff(row.astype(int)) > 0).all()


def test_an_iteration_more_or_two_is_all_that_a_larger_grid_costs():
    counts = []
    for n in (12, 48, 96):
        offsets, columns = grid_graph(n, n)
        solver = filled(offsets, columns, elastic(offsets, columns))
        right = np.ones((n * n, 2))  # all to one side: what local sweeps take longest for
        solver.solve(right, 1e-2, 100)
        counts.append(solver.iterations)
    assert counts[-1] <= counts[0] + 4
    assert max(counts) < 20


def test_levels_take_little_more_than_the_finest():
    solver = Multigrid(Graph(*grid_graph(60, 60)))
    blocks = [level.graph.columns.size for level in solver._levels]
    assert sum(blocks) < 1.2 * blocks[0]
    assert solver._levels[-1].size == 1


@pytest.mark.parametrize("most", [1, 2, 3])
def test_it_goes_downhill_however_early_it_ends(most):
    offsets, columns = GRAPHS["a grid"]()
    values = elastic(offsets, columns)
    right = np.random.default_rng(2).normal(size=(offsets.size - 1, 2))
    x = filled(offsets, columns, values).solve(right, 1e-12, most).ravel()
    assert x @ right.ravel() > 0.0
    assert 0.5 * x @ dense(offsets, columns, values) @ x < right.ravel() @ x


def test_what_nothing_holds_stays():
    offsets, columns = GRAPHS["two parts and a lone place"]()
    values = elastic(offsets, columns)
    values[-1] = 0.0
    right = np.ones((offsets.size - 1, 2))
    x = filled(offsets, columns, values).solve(right, 1e-3, 50)
    assert np.isfinite(x).all()
    assert (x[-1] == 0.0).all()
    assert filled(offsets, columns, values).solve(0.0 * right, 1e-3, 50) == pytest.approx(0.0)


def test_the_same_bits_on_two_threads(monkeypatch):
    offsets, columns = grid_graph(110, 110)
    assert offsets.size > kernels.CHUNK + 1
    values = elastic(offsets, columns)
    right = np.random.default_rng(3).normal(size=(offsets.size - 1, 2))
    ends = []
    for threads in (1, 2):
        with use_threads(threads):
            solver = filled(offsets, columns, values)
            ends.append(solver.solve(right, 1e-3, 50).tobytes())
    assert ends[0] == ends[1]
    assert solver.iterations < 25  # chunks that are swept by themselves cost little
