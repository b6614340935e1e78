"""Places on an outline: exactly on it, in order; what an edge leaves out, and what it meets."""

from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from qsmooth.kernels import outline as kernels
from qsmooth.kernels.outline import Outline, Sides

COORDINATES = st.floats(-1e6, 1e6, allow_subnormal=False)
PLACES = st.tuples(COORDINATES, COORDINATES)


def outline_of(nodes, segments, fractions):
    """One chain, all of whose vertices but the ends slide."""
    n = len(segments)
    return Outline(
        nodes=np.array(nodes, float),
        vertices=np.arange(n),
        segments=np.array(segments, np.int64),
        fractions=np.array(fractions, float),
        off=np.zeros(n, np.bool_),
        sides=np.full(n, -1),
        entries=np.arange(1, n - 1),
        free=np.ones(n - 2, np.bool_),
        tolerance=0.01,
    )


@pytest.mark.nojit
@given(PLACES, PLACES, st.floats(0.0, 1.0, exclude_max=True))
def test_places_are_rounded_once(a, b, fraction):
    nodes = np.array([a, b])
    found = kernels.place_at(nodes, 0, fraction)
    for k in range(2):
        exact = Fraction(a[k]) + Fraction(fraction) * (Fraction(b[k]) - Fraction(a[k]))
        error = abs(Fraction(found[k]) - exact)
        assert error <= Fraction(0.5000001) * Fraction(float(np.spacing(abs(found[k])))) + Fraction(
            2.0**-1070
        )
    assert kernels.place_at(nodes, 0, 0.0) == a


@pytest.mark.nojit
@given(st.lists(st.floats(0.01, 3.0), min_size=2, max_size=8), st.data())
def test_a_way_along_the_outline(lengths, data):
    nodes = np.stack([np.cumsum([0.0, *lengths]), np.zeros(len(lengths) + 1)], axis=1)
    last = len(lengths) - 1
    k = data.draw(st.integers(0, last))
    f = data.draw(st.floats(0.0, 1.0, exclude_max=True))
    way = data.draw(st.floats(-20.0, 20.0))
    segment, fraction = kernels.advance(nodes, k, f, way, 0, last)
    assert 0 <= segment <= last
    assert 0.0 <= fraction <= 1.0
    assert fraction < 1.0 or segment == last
    here, there = kernels.place_at(nodes, k, f)[0], kernels.place_at(nodes, segment, fraction)[0]
    expected = min(max(here + way, 0.0), nodes[-1, 0])
    assert there == pytest.approx(expected, abs=1e-12)


@pytest.mark.nojit
def test_a_way_over_segments_without_length():
    nodes = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 0.0], [1.0, 0.0], [3.0, 0.0]])
    assert kernels.advance(nodes, 0, 0.5, 1.5, 0, 3) == (3, 0.5)
    assert kernels.advance(nodes, 3, 0.5, -1.5, 0, 3) == (0, 0.5)


@pytest.mark.nojit
@given(st.integers(0, 2**32 - 1), st.sampled_from([1.0, 1e-3, 1e6]))
def test_vertices_are_found_again(seed, unit):
    rng = np.random.default_rng(seed)
    n = rng.integers(3, 9)
    nodes = unit * np.cumsum(rng.uniform([0.1, -1.0], [1.0, 1.0], (n, 2)), axis=0)
    way = np.sort(rng.uniform(0.0, n - 1.0, 6))
    way[2] = np.floor(way[2])  # at a node
    way = np.sort(way)
    segments, fractions = way.astype(int), way % 1.0
    xy = np.array([kernels.place_at(nodes, k, f) for k, f in zip(segments, fractions, strict=True)])
    xy = np.concatenate([nodes[:1], xy, nodes[-1:]])
    lost = outline_of(nodes, [0, *[0] * 6, n - 2], [0.0, *[0.0] * 6, 1.0])
    kernels.locate(xy, lost, np.array([[0, 7]]))
    assert not lost.off.any()
    assert lost.segments[1:-1] + lost.fractions[1:-1] == pytest.approx(way, abs=1e-9)
    beside = xy + np.array([0.0, 0.01 * unit])
    kernels.locate(beside, lost, np.array([[0, 7]]))
    assert lost.off[1:-1].all()
    # With a slack they count as on it, near where they were.
    near = lost._replace(slack=0.125)
    kernels.locate(beside, near, np.array([[0, 7]]))
    assert not near.off.any()


@pytest.mark.nojit
def test_what_an_edge_leaves_out():
    nodes = np.array([[0.0, 0.0], [1.0, 0.1], [2.0, -0.2], [3.0, 0.0]])
    assert kernels.deviation(nodes, 0, 0.0, 0.0, 0, 1.0, 0.1)[0] == 0.0
    squares, length = kernels.deviation(nodes, 0, 0.0, 0.0, 2, 3.0, 0.0)
    assert squares == pytest.approx(0.04)
    assert length == pytest.approx(9.0)
    # Beyond the end of the edge its end is what is near.
    assert kernels.deviation(nodes, 0, 0.0, 0.0, 1, 0.5, 0.0)[0] == pytest.approx(0.26)
    out = np.empty((4, 2))
    xy = np.array([[0.0, 0.0], [0.5, 0.05], [2.5, -0.1], [3.0, 0.0]])
    kernels.deviations(xy, outline_of(nodes, [0, 0, 2, 2], [0.0, 0.5, 0.5, 1.0]), out)
    assert out[[0, 2], 0] == pytest.approx([0.0, 0.0], abs=1e-15)
    assert out[1, 1] == pytest.approx(out[1, 0] / np.hypot(2.0, 0.15))


def sides_of(xy, ends):
    leaves = 1 << max(0, len(ends) - 1).bit_length()
    sides = Sides(np.array(ends), np.empty((2 * leaves, 4)))
    kernels.fit_boxes(xy, sides)
    return sides


def meet(p, q, r, s):
    """Whether two segments have a common point, in fractions."""
    p, q, r, s = ([Fraction(x) for x in point] for point in (p, q, r, s))

    def turn(a, b, c):
        return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])

    for k in range(2):
        if max(p[k], q[k]) < min(r[k], s[k]) or max(r[k], s[k]) < min(p[k], q[k]):
            return False
    return turn(p, q, r) * turn(p, q, s) <= 0 and turn(r, s, p) * turn(r, s, q) <= 0


@pytest.mark.nojit
@given(st.integers(0, 2**32 - 1), st.integers(1, 13))
def test_what_an_edge_meets(seed, n):
    """Also after vertices have moved; on a coarse lattice, where much meets by touching."""
    rng = np.random.default_rng(seed)
    xy = rng.integers(0, 12, (2 * n + 2, 2)).astype(float)
    ends = [(2 * i, 2 * i + 1) for i in range(n)]
    sides = sides_of(xy, ends)
    for moved in range(3):
        if moved:
            side = int(rng.integers(n))
            xy[2 * side] = rng.integers(0, 12, 2)
            kernels.refit(xy, *sides, side)
        u, v = 2 * n, 2 * n + 1
        x, y = rng.integers(0, 12, 2).astype(float)
        expected = any(meet(xy[u], (x, y), xy[a], xy[b]) for a, b in ends)
        assert kernels.meets_side(xy, *sides, v, x, y, u) == expected
        # Sides of its own vertices do not count.
        own = any(meet(xy[0], (x, y), xy[a], xy[b]) for a, b in ends[1:])
        assert kernels.meets_side(xy, *sides, v, x, y, 0) == own
    crossed = [
        any(meet(*xy[list(one)], *xy[list(other)]) for other in ends if other != one)
        for one in ends
    ]
    found = np.empty(n, np.bool_)
    kernels.meeting_sides(xy, sides, found)
    assert found.tolist() == crossed
