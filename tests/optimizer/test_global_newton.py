"""Newton steps on the whole mesh: downhill, repeatable, and taken where sweeps would creep."""

import numpy as np
import pytest

from meshes import renumber
from promises import check, invalid_cells
from qsmooth import Constraints, Mesh, Optimize, quality, smooth
from qsmooth.engine import threads_for
from qsmooth.examples import distorted, structured
from qsmooth.kernels._jit import use_threads
from qsmooth.kernels.multigrid import CHUNK
from qsmooth.kernels.rails import FREE
from qsmooth.numbering import Inside, numbered
from qsmooth.optimizer import global_newton
from qsmooth.optimizer.global_newton import GlobalNewton
from qsmooth.optimizer.lanes import Lanes
from qsmooth.outcome import Aim
from qsmooth.targets import ideal, with_sizes


def asked(mesh):
    """Ideal targets, of any size."""
    return ideal(mesh.topology).corners, np.zeros((mesh.n_cells, 2)), np.empty((0, 3))


def lanes_of(mesh):
    lanes = Lanes(mesh.topology, mesh.topology.schedule(True), threads_for(1, mesh.n_vertices))
    lanes.aim_at(ideal(mesh.topology))
    lanes.caps.hold(mesh.xy)
    return lanes


def solver_of(lanes, rails=FREE):
    targets = lanes.targets.corners, lanes.sizes, lanes.maps
    return GlobalNewton(lanes.topology, lanes.stars, *targets, lanes.caps, rails)


def solver(mesh):
    return solver_of(lanes_of(mesh))


def warped(n=24, kind="quad"):
    """A valid grid in which a whole region has to move."""
    mesh = structured(n, n, kind=kind)
    x, y = mesh.points.T
    low = 0.5 * np.exp(-(((x - 0.5) / 0.15) ** 2))
    return mesh.with_points(np.stack([x, y + low * (1.0 - y)], axis=1))


def energy(mesh, xy):
    from qsmooth.kernels.cell_energy import cell_energy

    worst, total = np.empty((2, mesh.n_cells))
    movable = np.zeros(mesh.n_vertices, np.bool_)
    movable[mesh.topology.schedule(True).vertices] = True
    cell_energy(xy, *mesh.topology.cells, movable, *asked(mesh), worst, total)
    return float((total * np.where(np.diff(mesh.cell_offsets) == 3, 1.0, 4.0)).sum())


@pytest.mark.parametrize("kind", ["quad", "triangle"])
@pytest.mark.parametrize(
    ("constraints", "first", "second"),
    # What two steps gain at least; a step that is confined but not meant for it gains less.
    [(Constraints(directions=(0, 1)), 0.12, 0.025), (Constraints(max_move=0.02), 0.05, 0.02)],
    ids=["directions", "reach"],
)
def test_steps_are_those_of_what_vertices_may_do(kind, constraints, first, second):
    mesh = warped(kind=kind)
    rails = constraints.freedom(mesh).rails()
    steps, xy = solver_of(lanes_of(mesh), rails), mesh.xy.copy()
    assert steps.step(xy) > first
    assert steps.step(xy) > second
    assert not invalid_cells(mesh.with_points(xy)).any()
    moves = xy - mesh.xy
    assert (np.linalg.norm(moves, axis=1) <= rails.reach).all()
    if constraints.directions is not None:
        assert not moves[:, 0].any()


@pytest.mark.parametrize("kind", ["quad", "triangle", "mixed"])
def test_steps_on_the_whole_mesh_go_downhill_and_keep_it_valid(kind):
    mesh = warped(kind=kind)
    steps = solver(mesh)
    xy = mesh.xy.copy()
    gains = []
    for _ in range(4):
        before = energy(mesh, xy)
        gains.append(steps.step(xy))
        after = energy(mesh, xy)
        assert after <= before
        assert gains[-1] == pytest.approx(1.0 - after / before, abs=1e-12)
        assert not invalid_cells(mesh.with_points(xy)).any()
    assert gains[0] > 0.01
    assert xy[mesh.is_fixed].tobytes() == mesh.xy[mesh.is_fixed].tobytes()


def test_a_step_has_the_same_bits_twice_and_on_two_threads():
    mesh = warped(100)  # of several chunks of rows
    assert (~mesh.is_fixed).sum() > CHUNK
    ends = []
    for threads in (1, 2):
        xy = mesh.xy.copy()
        with use_threads(threads):
            solver(mesh).step(xy)
        ends.append(xy.tobytes())
    assert ends[0] == ends[1]


def test_a_step_has_the_same_bits_in_any_order_inside():
    mesh, ends = warped(), []
    mesh = Mesh(*renumber(mesh.points, mesh.cells, np.random.default_rng(0))[:2])
    for how in ("kept", "curve"):
        with numbered(how):
            inside = Inside(mesh)
        lanes = Lanes(inside.topology, inside.topology.schedule(True), threads_for(1, 1))
        lanes.aim_at(ideal(inside.topology))
        xy = inside.at_vertices(mesh.xy)
        assert solver_of(lanes).step(xy) > 0.0
        ends.append(inside.back(xy).tobytes())
    assert ends[0] == ends[1]


@pytest.mark.parametrize("sized", [False, True])
@pytest.mark.parametrize("unit", [2.0**-70, 2.0**70])
def test_a_step_is_the_same_in_any_unit(unit, sized):
    mesh, ends = warped(), []
    for scale in (1.0, unit):
        scaled = mesh.with_points(scale * mesh.points)
        lanes, xy = lanes_of(scaled), scaled.xy.copy()
        if sized:
            lanes.aim_at(with_sizes(ideal(mesh.topology), mesh.topology, xy, 1.0))
            assert lanes.sizes[:, 1].all()
        assert solver_of(lanes).step(xy) > 0.0
        ends.append(xy / scale)
    assert ends[0].tobytes() == ends[1].tobytes()


def test_a_step_goes_where_a_solution_to_the_last_digit_does(monkeypatch):
    mesh = warped()
    ends = []
    for tolerance in (global_newton.TOLERANCE, 1e-5):
        monkeypatch.setattr(global_newton, "TOLERANCE", tolerance)
        xy = mesh.xy.copy()
        solver(mesh).step(xy)
        ends.append(xy - mesh.xy)
    assert np.linalg.norm(ends[0] - ends[1]) < 0.1 * np.linalg.norm(ends[1])


def test_the_energy_may_rise_as_far_as_is_said(monkeypatch):
    mesh = warped()
    xy = mesh.xy.copy()
    for _ in range(4):
        solver(mesh).step(xy)
    mesh, rises = mesh.with_points(xy), []
    right = GlobalNewton._direction
    twice = lambda self, xy, **how: 2.5 * right(self, xy, **how)  # noqa: E731
    monkeypatch.setattr(GlobalNewton, "_direction", twice)
    for rise in (0.0, 10.0):
        xy = mesh.xy.copy()
        gain = solver(mesh).step(xy, rise)
        after = energy(mesh, xy) / energy(mesh, mesh.xy)
        assert gain == pytest.approx(1.0 - after, abs=1e-12)
        rises.append(after - 1.0)
        assert not invalid_cells(mesh.with_points(xy)).any()
    assert rises[0] < 0.0 < rises[1] <= 10.0


@pytest.mark.parametrize("hold", [(), ("aspect_ratio", "shape", "min_edge")])
def test_a_step_leaves_nothing_beyond_what_is_held(hold):
    mesh = distorted(24, 3)
    lanes = lanes_of(mesh)
    lanes.caps.hold(mesh.xy, hold)
    assert not lanes.caps.forbidden(mesh.xy).any()
    xy = mesh.xy.copy()
    steps = solver_of(lanes)
    assert steps.step(xy) > 0.0
    assert not lanes.caps.forbidden(xy).any()


def test_cells_worse_than_what_is_held_are_forbidden():
    mesh = distorted(24, 3)
    lanes = lanes_of(mesh)
    rng = np.random.default_rng(0)
    trial, moved = mesh.xy.copy(), lanes.stars.vertices
    trial[moved] += rng.normal(size=(moved.size, 2)) * quality(mesh).min_edge.min()
    assert lanes.caps.forbidden(trial).any()


def test_vertices_of_cells_that_nothing_can_mend_stay_and_keep_no_other():
    mesh = warped()
    points = mesh.points.copy()
    points[3] = points[4]
    mesh = mesh.with_points(points)
    lanes = lanes_of(mesh)
    assert lanes.caps.lost.sum() == 1
    steps = solver(mesh)
    xy = mesh.xy.copy()
    assert steps.step(xy) > 0.0
    moved = (xy != mesh.xy).any(axis=1)
    (lost,) = np.flatnonzero(lanes.caps.lost)
    assert not moved[mesh.cell_vertices[slice(*mesh.cell_offsets[lost : lost + 2])]].any()
    assert moved.sum() > 0.8 * lanes.movable.sum()
    assert not lanes.caps.forbidden(xy).any()
    assert quality(mesh.with_points(xy)).n_invalid == 1


def test_few_steps_do_what_sweeps_take_hundreds_for():
    mesh = warped(40)
    xy = mesh.xy.copy()
    steps = solver(mesh)
    for _ in range(8):
        steps.step(xy)
    assert steps.step(xy) < 1e-3
    swept = smooth(mesh, "optimize", worst=False, max_sweeps=50)
    assert energy(mesh, xy) < energy(mesh, swept.mesh.xy)


def test_rings_whose_every_cell_is_at_a_cap_move_together():
    """Only steps that are as symmetric as the mesh, to the slack of the caps, keep all angles."""
    n, sectors = 6, 24
    grid = structured(n, sectors)
    across, along = grid.points.T
    radius, angle = 1.0 + 2.0 * across**2, 2.0 * np.pi * along
    points = radius[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    cells = np.arange(points.shape[0])[grid.cells[0]]
    first, last = np.flatnonzero(along == 0.0), np.flatnonzero(along == 1.0)
    cells[np.isin(cells, last)] = first[np.searchsorted(last, cells[np.isin(cells, last)])]
    kept = np.unique(cells)
    mesh = Mesh(points[kept], np.searchsorted(kept, cells))
    result = smooth(mesh, "optimize", target="ideal")
    assert result.after.worst["max_angle"] <= result.before.worst["max_angle"] * (1.0 + 1e-10)
    assert result.after.mean["shape"] > result.before.mean["shape"] + 0.02
    assert sum(stage.steps for stage in result.outcome.stages) > 0


def test_a_step_at_the_optimum_changes_nothing():
    mesh = structured(6, 6)
    xy = mesh.xy.copy()
    assert solver(mesh).step(xy) == pytest.approx(0.0, abs=1e-12)
    assert xy == pytest.approx(mesh.xy, abs=1e-12)


def test_where_sweeps_would_creep_it_takes_steps_on_the_whole_mesh(monkeypatch):
    # All interior columns pressed to the left: a change has to cross the whole mesh. By default
    # they are kept, as the layers that they look like.
    mesh = structured(60, 60)
    x, y = mesh.points.T
    inside = ~mesh.is_boundary[:, None]
    mesh = mesh.with_points(np.where(inside, np.stack([x**4, y], axis=1), mesh.points))
    result = smooth(mesh, "optimize", target="ideal")
    (mean, *_) = result.outcome.stages
    assert mean.aim is Aim.MEAN_SHAPE
    assert mean.steps > 0
    assert f"and {mean.steps} Newton steps on the whole mesh" in result.reason
    assert result.after.worst["min_angle"] > 89.0
    check(mesh, Optimize())
    mean = smooth(mesh, "optimize", worst=False, max_sweeps=200, target="ideal")
    monkeypatch.setattr(GlobalNewton, "step", lambda self, xy, rise: 0.0)
    creeping = smooth(mesh, "optimize", worst=False, max_sweeps=200, target="ideal")
    assert mean.after.mean["shape"] > creeping.after.mean["shape"] + 0.01
