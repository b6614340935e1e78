"""What lanes ask of cells while the worst are seen to: walls, where they stand, what counts."""

import math

import numpy as np
import pytest

import reference
import reference_optimizer as slow
from meshes import grid, random_mesh
from qsmooth import Constraints, Mesh, Optimize, examples, quality
from qsmooth.engine import threads_for
from qsmooth.kernels.newton_sweep import Wall
from qsmooth.optimizer.lanes import LEAST_CAP, LEAST_SLIM, SLIMMER, Lanes
from qsmooth.optimizer.progress import ROUND, Progress
from qsmooth.targets import candidates, ideal, initial

NO_WALL = Wall(1.0, math.inf, 1)
KINDS = ["quads", "triangles", "mixed"]


def lanes_of(mesh, targets=None):
    """Lanes with nothing held."""
    lanes = Lanes(mesh.topology, mesh.topology.schedule(True), threads_for(1, mesh.n_vertices))
    lanes.aim_at(ideal(mesh.topology) if targets is None else targets)
    return lanes


def one_round(lanes, mesh, wall):
    """Coordinates after a round of sweeps, and the vertices in their order."""
    xy = mesh.xy.copy()
    lanes.newton(xy, wall, Progress(Optimize(), quality(mesh)))
    return xy, lanes._blocks.vertices.tolist()


def of_cells(lanes, rows):
    """What the rows of the blocks have for each cell; all rows of a cell have the same."""
    found = np.full(lanes.topology.n_cells, np.nan)
    found[lanes._blocks.cells] = rows
    assert np.array_equal(found[lanes._blocks.cells], rows)
    return found[~np.isnan(found)], ~np.isnan(found)


def ideals_of(mesh):
    """What is asked of each cell where that is the ideal."""
    return {frozenset(cell): slow.asked_of(cell, None) for cell in reference.as_lists(mesh)}


def plain_round(mesh, order, wall, asked):
    points, energy = reference.as_complex(mesh.xy), (wall.mean_weight, wall.threshold)
    for _ in range(ROUND):
        points = slow.newton_sweep(
            points, reference.as_lists(mesh), order, *energy, wall.squarings, asked=asked
        )
    return [(z.real, z.imag) for z in points]


# ------------------------------------------------------------------------------- walls on shape


def test_walls_stand_a_little_beyond_each_cells_shape():
    mesh = random_mesh("mixed", 5, seed=1, amount=0.9).mesh
    lanes = lanes_of(mesh)
    assert not lanes._rows.slim.any()
    lanes.wall_off(mesh.xy)
    slim, seen = of_cells(lanes, lanes._rows.slim)
    shape = 1.0 / quality(mesh).shape[seen]
    assert 1.0 / slim == pytest.approx(np.maximum(SLIMMER * shape, LEAST_SLIM), rel=1e-12)
    assert (SLIMMER * shape > LEAST_SLIM).any()
    assert (SLIMMER * shape < LEAST_SLIM).any()


def test_looser_walls_stand_farther_and_none_beyond_the_most():
    mesh = random_mesh("mixed", 5, seed=1, amount=0.9).mesh
    lanes = lanes_of(mesh)
    lanes.wall_off(mesh.xy)
    near, _ = of_cells(lanes, lanes._rows.slim)
    lanes.wall_off(mesh.xy, looser=2.0)
    looser, _ = of_cells(lanes, lanes._rows.slim)
    assert looser == pytest.approx(0.5 * near, rel=1e-12)
    lanes.wall_off(mesh.xy, looser=2.0, most=0.8)
    most, _ = of_cells(lanes, lanes._rows.slim)
    cap = 0.8 * (1.0 / quality(mesh).shape).max()
    assert 1.0 / most == pytest.approx(np.minimum(1.0 / looser, cap), rel=1e-12)
    assert (1.0 / looser > cap).any()
    assert (1.0 / looser < cap).any()


def test_no_wall_stands_where_even_the_best_cells_are():
    mesh = examples.structured(4, 4)
    lanes = lanes_of(mesh)
    lanes.wall_off(mesh.xy, most=0.5)
    assert 1.0 / lanes._rows.slim == pytest.approx(np.full(lanes._rows.slim.size, LEAST_CAP))


def test_walls_of_layers_get_no_looser_and_their_sizes_count_more():
    mesh = examples.boundary_layer()
    targets = candidates(mesh.topology, mesh.xy)[1]
    targets = targets._replace(is_layer=np.arange(mesh.n_cells) < mesh.n_cells // 2)
    lanes = lanes_of(mesh, targets)
    lanes.wall_off(mesh.xy)
    near, seen = of_cells(lanes, lanes._rows.slim)
    lanes.wall_off(mesh.xy, looser=2.0)
    looser, _ = of_cells(lanes, lanes._rows.slim)
    assert looser == pytest.approx(near * np.where(targets.is_layer[seen], 1.0, 0.5), rel=1e-12)
    weight, _ = of_cells(lanes, lanes._rows.size_weight)
    heavier = weight > targets.size_weight[seen]
    assert np.array_equal(heavier, targets.is_layer[seen] & (targets.size_weight[seen] > 0.0))


# ------------------------------------------------------------------------------- rows


def test_rows_are_there_from_when_a_sweep_reads_them():
    mesh = random_mesh("mixed", 5, seed=1).mesh
    lanes = lanes_of(mesh)
    assert [values.size for values in lanes.rows_for(NO_WALL)[1:]] == [0] * 8
    rows, n = lanes.rows_for(Wall(1.0, 1.5, 3)), lanes._blocks.cells.size
    assert [values.size for values in rows[1:]] == [0] * 6 + [n, n]
    assert (rows.near == 1.0).all()
    assert not rows.slim.any()
    lanes.weigh_good(mesh.xy)
    assert [values.size for values in lanes.rows_for(NO_WALL)[1:]] == [n] * 3 + [0] * 5
    one = np.ones(mesh.n_cells)
    lanes.aim_at(ideal(mesh.topology)._replace(area=one, size_weight=one))
    assert [values.size for values in lanes.rows_for(NO_WALL)[4:]] == [n] * 3 + [0] * 2


def test_sweeps_in_a_mapped_plane_have_all_rows():
    mesh = random_mesh("mixed", 4, seed=1).mesh
    maps = np.tile([1.0, 0.0, 1.0], (mesh.n_cells, 1))
    lanes = lanes_of(mesh, ideal(mesh.topology)._replace(maps=maps))
    assert {values.size for values in lanes.rows_for(NO_WALL)[1:]} == {lanes._blocks.cells.size}


# ------------------------------------------------------------------------------- walls on corners


@pytest.mark.parametrize("rings", [0, 1, 3])
def test_near_is_one_over_the_worst_badness_of_so_many_rings(rings):
    mesh = random_mesh("mixed", 6, seed=3, amount=0.9).mesh
    lanes = lanes_of(mesh)
    lanes.measure_near(mesh.xy, rings)
    near, seen = of_cells(lanes, lanes._rows.near)
    badness = np.maximum(lanes.energy(mesh.xy)[0], 1.0)
    worst = np.array(slow.worst_around(badness.tolist(), reference.as_lists(mesh), rings))
    assert near == pytest.approx(1.0 / worst[seen], rel=1e-12)
    assert (near <= 1.0).all()


def test_what_is_lost_and_what_cannot_change_is_as_good_as_can_be():
    mesh = random_mesh("mixed", 4, seed=3, amount=0.9).mesh
    points = mesh.points.copy()
    inside = int(np.flatnonzero(~mesh.is_boundary)[0])
    points[inside] += 10.0  # beyond all its cells
    mesh = mesh.with_points(points)
    lanes = lanes_of(mesh)
    lanes.measure_near(mesh.xy, 0)
    near, seen = of_cells(lanes, lanes._rows.near)
    infinite = np.isinf(lanes.energy(mesh.xy)[0][seen])
    assert infinite.any()
    assert (near[infinite] == 1.0).all()
    lanes.caps.hold(mesh.xy)
    lanes.measure_near(mesh.xy, 0)
    assert (of_cells(lanes, lanes._rows.near)[0][lanes.caps.lost[seen]] == 1.0).all()


@pytest.mark.parametrize("kind", KINDS)
def test_sweeps_push_by_the_worst_of_each_neighbourhood(kind):
    mesh, wall = random_mesh(kind, 4, seed=5, amount=0.7).mesh, Wall(1.0, 0.9, 4)
    lanes = lanes_of(mesh)
    lanes.measure_near(mesh.xy, 1)
    near, seen = of_cells(lanes, lanes._rows.near)
    asked = ideals_of(mesh)
    for c, value in zip(np.flatnonzero(seen), near, strict=True):
        asked[frozenset(reference.as_lists(mesh)[c])].near = value
    xy, order = one_round(lanes, mesh, wall)
    np.testing.assert_allclose(xy, plain_round(mesh, order, wall, asked), rtol=0, atol=1e-8)


def test_aiming_again_takes_all_walls_down():
    mesh = random_mesh("mixed", 4, seed=3, amount=0.9).mesh
    lanes = lanes_of(mesh)
    plain, _ = one_round(lanes, mesh, Wall(1.0, 1.5, 3))
    lanes.wall_off(mesh.xy)
    lanes.measure_near(mesh.xy, 1)
    lanes.weigh_good(mesh.xy)
    walled, _ = one_round(lanes, mesh, Wall(1.0, 1.5, 3))
    assert not np.array_equal(walled, plain)
    lanes.aim_at(ideal(mesh.topology))
    assert one_round(lanes, mesh, Wall(1.0, 1.5, 3))[0].tobytes() == plain.tobytes()


# ------------------------------------------------------------------------------- good cells


@pytest.mark.parametrize("power", [1, 2])
@pytest.mark.parametrize("kind", KINDS)
def test_good_cells_are_weighed_and_walls_stay_where_they_are(kind, power):
    mesh, wall = random_mesh(kind, 4, seed=5, amount=0.7).mesh, Wall(2.0, 1.5, 3)
    lanes = lanes_of(mesh)
    lanes.wall_off(mesh.xy)
    shape, asked = lanes.worst_shape(mesh.xy), ideals_of(mesh)
    for cell, f in zip(reference.as_lists(mesh), shape, strict=True):
        own = asked[frozenset(cell)]
        own.targets = {v: np.array(m) / f**power for v, m in own.targets.items()}
        own.slim = f**power / max(SLIMMER * f, LEAST_SLIM)
    lanes.weigh_good(mesh.xy, power)
    xy, order = one_round(lanes, mesh, wall)
    np.testing.assert_allclose(xy, plain_round(mesh, order, wall, asked), rtol=0, atol=1e-8)


@pytest.mark.parametrize("target", [ideal, initial])
def test_weighing_is_of_good_towards_what_is_meant(target):
    # Triangles have one shape each: what they are weighed by has the gradient of the mean shape.
    mesh = random_mesh("triangles", 4, seed=2, amount=0.8).mesh
    targets = ideal(mesh.topology) if target is ideal else initial(mesh.topology, mesh.xy)
    lanes = lanes_of(mesh, targets)
    f = lanes.worst_shape(mesh.xy)
    lanes.weigh_good(mesh.xy)
    first = targets.corners[lanes._row_corners]
    weight = lanes._rows.m11 / first[:, 0]
    assert weight == pytest.approx((f**-2)[lanes._blocks.cells], rel=1e-12)
    rng, h = np.random.default_rng(0), 1e-6
    step = h * rng.normal(size=mesh.xy.shape) * ~mesh.is_fixed[:, None]
    ends = [lanes.worst_shape(mesh.xy + sign * step) for sign in (1.0, -1.0)]
    of_mean = (1.0 / ends[0] - 1.0 / ends[1]).sum()
    of_energy = (f**-2 * (ends[0] - ends[1])).sum()
    assert of_energy == pytest.approx(-of_mean, rel=1e-6)


def test_the_mean_shape_gains_where_weighed_where_the_energy_has_settled():
    mesh = examples.random_triangles(300, seed=4)
    lanes, progress = lanes_of(mesh), Progress(Optimize(), quality(mesh))
    xy = mesh.xy.copy()
    for _ in range(30):
        lanes.newton(xy, NO_WALL, progress)
    settled = quality(mesh.with_points(xy)).shape.mean()
    for _ in range(5):
        lanes.weigh_good(xy)
        lanes.newton(xy, NO_WALL, progress)
    assert quality(mesh.with_points(xy)).shape.mean() > settled + 1e-4


def test_cells_that_stay_invalid_are_no_trouble():
    mesh = random_mesh("mixed", 5, seed=1, amount=0.7).mesh
    points = mesh.points.copy()
    a, b = mesh.cells[0][0][:2]
    points[a] = points[b]
    mesh = mesh.with_points(points)
    lanes = lanes_of(mesh)
    lanes.caps.hold(mesh.xy)
    lanes.wall_off(mesh.xy)
    lanes.weigh_good(mesh.xy)
    lanes.measure_near(mesh.xy, 2)
    assert np.isinf(lanes.worst_shape(mesh.xy)).any()
    for values in lanes._rows[1:]:
        assert np.isfinite(values).all()


# ------------------------------------------------------------------------------- constraints


def shape_energy(mesh, x, y):
    """Sum of (|u|² + |w|²) / 2 det(u, w) over the corners, with the middle vertex there."""
    points, total = mesh.xy.copy(), 0.0
    points[4] = x, y
    for cell in reference.as_lists(mesh):
        for v, b, d in reference.corners(cell):
            (ux, uy), (wx, wy) = points[b] - points[v], points[d] - points[v]
            det = ux * wy - uy * wx
            total += 0.5 * (ux * ux + uy * uy + wx * wx + wy * wy) / det if det > 0.0 else np.inf
    return total


@pytest.mark.parametrize("untangling", [False, True])
@pytest.mark.parametrize("constraint", ["line", "disc"])
def test_newtons_steps_lead_to_the_least_energy_on_a_line_and_on_a_circle(constraint, untangling):
    points, cells = grid(2, 2)
    points = np.column_stack([4.0 * points[:, 0], points[:, 1]])
    points[4] = 5.0, 1.4
    mesh = Mesh(points, cells)
    if constraint == "line":
        along = np.linspace(-0.8, 0.5, 200_001)
        x, y = 5.0 + 0.6 * along, 1.4 + 0.8 * along
        allowed = Constraints(directions=(3, 4))
    else:
        angle = np.linspace(0.0, 2.0 * np.pi, 200_001)
        x, y = 5.0 + 0.3 * np.cos(angle), 1.4 + 0.3 * np.sin(angle)
        allowed = Constraints(max_move=0.3)
    energies = [shape_energy(mesh, *place) for place in zip(x[::1000], y[::1000], strict=True)]
    near = 1000 * int(np.argmin(energies))
    fine = range(max(0, near - 1000), min(x.size, near + 1001), 10)
    best = min(fine, key=lambda k: shape_energy(mesh, x[k], y[k]))
    rails = allowed.freedom(mesh).rails()
    lanes = Lanes(mesh.topology, mesh.topology.schedule(True), threads_for(1, 1), rails)
    lanes.aim_at(ideal(mesh.topology))
    xy = mesh.xy.copy()
    for _ in range(3):
        if untangling:
            for _ in range(ROUND):
                lanes.untangle(xy, np.ones(mesh.n_vertices), 1e-9)
        else:
            lanes.newton(xy, NO_WALL, Progress(Optimize(), quality(mesh)))
    assert xy[4] == pytest.approx((x[best], y[best]), abs=1e-3)
    assert shape_energy(mesh, *xy[4]) <= min(energies)
