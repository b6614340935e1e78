"""Where sweeps creep: a linear creep is seen through, no cell breaks, what is refused stays."""

import numpy as np
import pytest

from qsmooth import Optimize, examples, quality, smooth, untangle
from qsmooth.engine import threads_for
from qsmooth.kernels.newton_sweep import Wall
from qsmooth.optimizer.extrapolation import MOST_WAITS, Extrapolation
from qsmooth.optimizer.lanes import Lanes
from qsmooth.optimizer.progress import ROUND, Progress
from qsmooth.targets import ideal

N = 40


@pytest.mark.nojit
def test_where_a_linear_creep_ends_is_found():
    # Moves that shrink by factors of their own, a few of them: as many sweeps show all of it.
    rng = np.random.default_rng(0)
    end, modes = rng.normal(size=(N, 2)), rng.normal(size=(3, N, 2))
    factors = np.array([0.95, 0.9, 0.5])
    ahead = Extrapolation(np.arange(N, dtype=np.uint32), ROUND, threads_for(1, N))
    at = [end + np.tensordot(factors**k, modes, axes=1) for k in range(ROUND + 1)]
    ahead.start(at[0], np.full(N, 2.0))
    for xy in at[1:]:
        ahead.note(xy)
    assert ahead.full
    found = ahead.extrapolated(at[-1])
    assert np.abs(found - end).max() < 0.01 * np.abs(at[-1] - end).max()


@pytest.mark.nojit
@pytest.mark.parametrize("n_sweeps", [0, 2, ROUND])
def test_sweeps_that_move_nothing_or_are_few_say_nothing(n_sweeps):
    xy = np.random.default_rng(1).normal(size=(N, 2))
    ahead = Extrapolation(np.arange(N, dtype=np.uint32), ROUND, threads_for(1, N))
    ahead.start(xy, np.ones(N))
    for k in range(n_sweeps):
        ahead.note(xy + (0.1 * k if n_sweeps < ROUND else 0.0))
    assert ahead.extrapolated(xy) is None


@pytest.mark.nojit
def test_after_a_refusal_it_is_tried_less_often():
    ahead = Extrapolation(np.arange(N, dtype=np.uint32), ROUND, threads_for(1, N))
    assert ahead.due()
    ahead.judge(False)
    assert [ahead.due() for _ in range(MOST_WAITS + 1)] == [False] * MOST_WAITS + [True]
    ahead.judge(True)
    assert ahead.due()


def lanes_of(mesh):
    lanes = Lanes(mesh.topology, mesh.topology.schedule(True), threads_for(1, mesh.n_vertices))
    lanes.aim_at(ideal(mesh.topology))
    lanes.caps.hold(mesh.xy)
    return lanes


def creeping():
    """A block whose upper edge is pressed in: its inside has far to go."""
    mesh = examples.bump(48, height=0.5, width=0.15)
    return mesh, lanes_of(mesh)


def energy_after(rounds, extrapolate):
    mesh, lanes = creeping()
    xy, progress = mesh.xy.copy(), Progress(Optimize(), quality(mesh))
    for _ in range(rounds):
        lanes.newton(xy, Wall(1.0, np.inf, 1), progress, extrapolate=extrapolate)
        assert not lanes.caps.forbidden(xy).any()
    return float(lanes.energy(xy)[1].sum()), progress.sweeps


def test_a_creeping_mesh_gets_farther_in_as_many_sweeps():
    start = energy_after(0, False)[0]
    end = energy_after(60, False)[0]
    plain, sweeps = energy_after(6, False)
    ahead, same = energy_after(6, True)
    assert sweeps == same
    assert ahead - end < 0.5 * (plain - end) < 0.5 * (start - end)


def test_a_place_with_forbidden_cells_or_more_energy_is_not_gone_to():
    mesh, lanes = creeping()
    wall, xy = Wall(1.0, np.inf, 1), mesh.xy.copy()
    lanes.newton(xy, wall, Progress(Optimize(), quality(mesh)))
    now = xy.copy()
    assert not lanes._go(xy, mesh.xy.copy(), wall)  # back up
    assert not lanes._go(xy, None, wall)
    assert np.array_equal(xy, now)
    # One vertex far beyond its cells is put back, and all others go.
    better = xy.copy()
    lanes.newton(better, wall, Progress(Optimize(), quality(mesh)))
    inside = np.flatnonzero(~mesh.is_fixed)
    far = better.copy()
    far[inside[0]] += 5.0
    assert lanes._go(xy, far, wall)
    assert not lanes.caps.forbidden(xy).any()
    assert np.array_equal(xy[inside[0]], now[inside[0]])
    assert np.array_equal(xy[inside[-1]], better[inside[-1]])


def test_a_cell_that_stays_invalid_does_not_count_where_sweeps_lead():
    mesh, _ = creeping()
    points = mesh.points.copy()
    points[3] = points[4]
    mesh = mesh.with_points(points)
    lanes = lanes_of(mesh)
    assert lanes.caps.lost.sum() == 1
    wall, xy, progress = Wall(1.0, np.inf, 1), mesh.xy.copy(), Progress(Optimize(), quality(mesh))
    better = xy.copy()
    lanes.newton(better, wall, progress)
    assert lanes._go(xy, better.copy(), wall)
    assert np.array_equal(xy, better)
    assert not lanes._go(xy, mesh.xy.copy(), wall)


def test_after_a_refusal_nothing_is_measured_again():
    mesh, lanes = creeping()
    wall, xy = Wall(1.0, np.inf, 1), mesh.xy.copy()
    lanes.newton(xy, wall, Progress(Optimize(), quality(mesh)))
    look = lanes.look(xy)
    assert not lanes._go(xy, mesh.xy.copy(), wall)
    assert lanes.look(xy) is look


def test_tangles_that_creep_take_fewer_sweeps(monkeypatch):
    mesh = examples.random_interior(150, 150, seed=1)
    sweeps = untangle(mesh).sweeps
    monkeypatch.setattr(Extrapolation, "extrapolated", lambda *_: None)
    assert sweeps < 0.8 * untangle(mesh).sweeps


@pytest.mark.parametrize("threads", [1, 2])
def test_bits_do_not_depend_on_threads(threads):
    mesh = examples.random_interior(30, 30, seed=3)
    one = smooth(mesh, threads=1, max_sweeps=200)
    assert smooth(mesh, threads=threads, max_sweeps=200).points.tobytes() == one.points.tobytes()
