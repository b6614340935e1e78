"""What counts as keeping the clearance: by hand."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import reference
from meshes import KINDS, grid, random_mesh
from qsmooth import Mesh
from qsmooth.kernels import guards
from qsmooth.kernels.quad import guarded_commit
from qsmooth.kernels.stars import Moves

pytestmark = pytest.mark.nojit


@pytest.mark.parametrize(
    ("longest", "largest", "expected"),
    [
        (2.0, 3.0, 2e-12),
        (1e-6, 6e6, 2.0**-26),  # 16 times the 2^-30 between numbers near 6e6
        (1.0, 4096.0, 2.0**-36),
        (0.0, 1.0, 2.0**-48),
    ],
)
def test_tolerated_loss(longest, largest, expected):
    assert guards.tolerated_loss(longest, largest) == pytest.approx(expected, rel=1e-12)
    assert guards.tolerated_loss(2.0**40 * longest, 2.0**40 * largest) == pytest.approx(
        2.0**40 * expected, rel=1e-12
    )


@given(st.floats(1e-30, 1e30))
def test_tolerated_loss_of_a_point_is_16_spacings(largest):
    assert guards.tolerated_loss(0.0, largest) == 16.0 * math.ulp(largest)


def commit(mesh, step):
    xy, moves = mesh.xy.copy(), Moves(*np.empty((2, 1)))
    guarded_commit(xy, mesh.topology.schedule(True), (0, 1), np.array([step]), math.nan, moves)
    return xy[4] - mesh.xy[4]


@pytest.mark.parametrize(("shift", "tau"), [(0.0, 1e-12), (6e6, 2.0**-26)])
def test_clearance_may_fall_by_the_tolerated_loss_and_no_more(shift, tau):
    # The centre of four squares goes straight at the nearest guard line, a diagonal.
    points, cells = grid(2, 2)
    mesh = Mesh(points + shift, cells)
    assert (commit(mesh, np.array([-0.9, -0.9]) * tau / math.sqrt(2)) < 0.0).all()
    # An eighth of 8.8 τ is over τ: not even the third halving is short enough.
    assert not commit(mesh, np.array([-8.8, -8.8]) * tau / math.sqrt(2)).any()
    # The same the other way: clearance from the opposite diagonal falls.
    assert not commit(mesh, np.array([8.8, 8.8]) * tau / math.sqrt(2)).any()


@pytest.mark.parametrize("kind", sorted(KINDS))
def test_lines_and_clearance_are_those_of_the_reference(kind):
    mesh = random_mesh(kind, 5, seed=8, amount=1.0, turned=0.5, shift=(-3.0, 100.0)).mesh
    schedule = mesh.topology.schedule(True)
    points, cells = reference.as_complex(mesh.xy), reference.as_lists(mesh)
    lines = np.empty((3 * schedule.largest, 3))
    for i, v in enumerate(schedule.vertices.tolist()):
        centre = guards.centre_of(schedule.vertices, schedule.offsets, i)
        n, longest, shortest, largest = guards.guard_lines(mesh.xy, schedule.corners, centre, lines)
        expected = reference.guard_lines(points, v, cells)
        assert n == len(expected)
        found = guards.clearance(lines, n)
        assert found == pytest.approx(reference.clearance(expected, points[v]), abs=1e-12)
        assert guards.tolerated_loss(longest, largest) == pytest.approx(
            reference.tolerance(points, v, cells)
        )
        edges = [abs(points[w] - points[v]) for w in reference.rings(cells, mesh.n_vertices)[v]]
        assert (shortest, longest) == pytest.approx((min(edges), max(edges)))


def test_a_line_of_no_length_is_left_out():
    points, cells = grid(2, 2)
    points[5] = points[2]  # the lower right square loses a side
    mesh = Mesh(points, cells)
    schedule = mesh.topology.schedule(True)
    lines = np.empty((12, 3))
    centre = guards.centre_of(schedule.vertices, schedule.offsets, 0)
    n, *_ = guards.guard_lines(mesh.xy, schedule.corners, centre, lines)
    assert (
        n
        == 11
        == len(reference.guard_lines(reference.as_complex(points), 4, reference.as_lists(mesh)))
    )
