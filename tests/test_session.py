"""A session: the same mesh smoothed again and again, at points that a simulation moves."""

import gc
import pickle
import threading
import tracemalloc

import numpy as np
import pytest

from qsmooth import Mesh, MeshError, Optimize, Smoother, Star, quality, smooth
from qsmooth.examples import around_body, boundary_layer, jittered, tangled
from qsmooth.numbering import numbered
from qsmooth.registry import all_methods, methods

STEPPING = [name for name in methods() if name != "aspect-ratio"]


def body():
    mesh = around_body(16)
    return mesh, mesh.is_boundary & (np.abs(mesh.points).max(axis=1) < 0.5)


def turned(points, moving, degrees):
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    points = points.copy()
    points[moving] = points[moving] @ np.array([[c, s], [-s, c]])
    return points


def turn(smoother, mesh, moving, n=20, degrees=1.5):
    """Turn the body step by step; gives the last points and the records."""
    points, records = mesh.points.copy(), []
    for k in range(1, n + 1):
        points[moving] = turned(mesh.points, moving, degrees * k)[moving]
        records.append(smoother.step(points))
    return points, records


def test_what_words_and_files_mean_is_found_once(tmp_path):
    mesh, path = jittered(10, 10, seed=3), tmp_path / "ids.txt"
    fixed, worst = mesh.points[:, 0] < 0.5, quality(mesh).max_angle > 100.0
    path.write_text("60\n")
    words = {"fixed": "x < 0.5", "fixed_file": path, "selection": "max_angle > 100"}
    smoother = Smoother(mesh, "star", max_sweeps=3, **words)
    path.unlink()
    fixed[60] = True
    same = smooth(mesh, "star", max_sweeps=3, fixed=fixed, selection=worst)
    assert smoother(mesh.points).points.tobytes() == same.points.tobytes()
    assert not np.array_equal(same.points, mesh.points)
    aside = mesh.points @ np.array([[0.5, 0.0], [0.0, 1.0]])
    marks = smooth((aside, mesh.cells), "star", max_sweeps=3, fixed=fixed, selection=worst)
    for again in (smoother, pickle.loads(pickle.dumps(smoother))):
        assert again(aside).points.tobytes() == marks.points.tobytes()
    assert smoother.method.given()["fixed"] == "x < 0.5"
    with pytest.raises(ValueError, match="the mesh has no names"):
        Smoother(mesh, fixed="inlet")
    with pytest.raises(ValueError, match="directions"):
        Smoother(mesh, directions=np.ones((3, 2)))


@pytest.mark.parametrize("name", ["optimize", "star", "untangle", "laplacian"])
def test_a_call_is_smooth_to_the_bit(name):
    method = all_methods()[name](max_sweeps=30)
    mesh, moving = body()
    smoother = Smoother(mesh, method)
    for degrees in (0.0, 4.0):
        points = turned(mesh.points, moving, degrees)
        alone = smooth(mesh.with_points(points), method)
        told = smoother(points)
        assert told.points.tobytes() == alone.points.tobytes()
        assert told.outcome == alone.outcome


@pytest.mark.parametrize("make", [boundary_layer, lambda: tangled(8, 8, seed=1)])
def test_a_call_on_a_mesh_that_says_what_it_means(make):
    mesh = make()
    told, alone = Smoother(mesh, max_sweeps=40)(mesh.points), smooth(mesh, max_sweeps=40)
    assert told.points.tobytes() == alone.points.tobytes()


def test_what_cells_are_meant_to_be_is_read_once():
    mesh = boundary_layer(12, 8)
    smoother = Smoother(mesh, max_sweeps=30)
    flat = mesh.points * (1.0, 3.0)  # layers three times as high
    assert smoother(flat).outcome.target.kind == smooth(mesh, max_sweeps=30).outcome.target.kind
    assert smoother(flat).points.tobytes() != smooth(mesh.with_points(flat)).points.tobytes()


@pytest.mark.parametrize("name", STEPPING)
def test_steps_of_every_method(name):
    mesh, moving = body()
    points, records = turn(Smoother(mesh, name), mesh, moving)
    still = mesh.is_boundary
    wanted = turned(mesh.points, moving, 30.0)
    assert np.array_equal(points[still], wanted[still])
    assert any(record.sweeps for record in records)
    found = quality(mesh.with_points(points))
    assert records[-1].valid == (found.n_invalid == 0)
    assert records[-1].scaled_jacobian == pytest.approx(found.scaled_jacobian.min(), rel=1e-12)
    if methods()[name].guarded:
        assert all(record.valid for record in records)
        assert not (points[~still] == mesh.points[~still]).all()


def test_the_body_turns_and_cells_stay_good():
    mesh, moving = body()
    _, records = turn(Smoother(mesh), mesh, moving, n=60, degrees=0.5)
    assert min(record.scaled_jacobian for record in records) > 0.75
    assert not any(record.untangled for record in records)


def test_vertices_follow_a_body_that_goes_on():
    mesh = around_body(40)
    moving = mesh.is_boundary & (np.abs(mesh.points).max(axis=1) < 0.5)
    following = low_of_steps(mesh, moving, forget=False)
    forgetful = low_of_steps(mesh, moving, forget=True)
    assert following[0] > 0.8
    assert following[1] == 0
    # Sweeps alone fall behind, and the cells beside the body fold over.
    assert forgetful[0] < 0.5
    assert forgetful[1] > 0


def low_of_steps(mesh, moving, forget):
    """Sweep once after each turn; the smallest scaled Jacobian, and how often it was tangled."""
    smoother, points, records = Smoother(mesh), mesh.points.copy(), []
    for k in range(1, 16):
        points[moving] = turned(mesh.points, moving, 1.5 * k)[moving]
        smoother = Smoother(mesh) if forget else smoother
        records.append(smoother.step(points, max_sweeps=1))
    return min(r.scaled_jacobian for r in records), sum(r.untangled for r in records)


def test_when_the_body_stands_still_the_mesh_comes_to_rest():
    mesh, moving = body()
    smoother = Smoother(mesh)
    points, _ = turn(smoother, mesh, moving, n=6, degrees=3.0)
    for _ in range(100):
        if smoother.step(points).rests:
            break
    at_rest = points.copy()
    assert smoother.step(points).sweeps == 0
    assert np.array_equal(points, at_rest)


def test_what_follows_makes_no_corner_worse():
    mesh, moving = body()
    smoother, points = Smoother(mesh), mesh.points.copy()
    for k in range(1, 15):
        points[moving] = turned(mesh.points, moving, 2.5 * k)[moving]
        given = quality(mesh.with_points(points))
        record = smoother.step(points)
        now = quality(mesh.with_points(points))
        assert record.valid
        if given.n_invalid == 0:
            assert now.min_angle.min() >= given.min_angle.min() - 1e-9
            assert now.max_angle.max() <= given.max_angle.max() + 1e-9


def test_what_rests_is_not_visited():
    mesh, moving = body()
    smoother = Smoother(mesh)
    points, _ = turn(smoother, mesh, moving, n=3)
    for _ in range(60):
        record = smoother.step(points)
        if record.rests:
            break
    assert record.rests
    before = points.tobytes()
    record = smoother.step(points)
    assert (record.sweeps, points.tobytes()) == (0, before)


def test_only_what_is_near_a_change_is_visited():
    mesh = Mesh(*_strip(200))
    smoother, points = Smoother(mesh, "star"), mesh.points.copy()
    while not smoother.step(points).rests:
        pass
    middle = int(np.argmin(np.hypot(points[:, 0] - 100.0, points[:, 1] - 2.0)))
    points[middle] += (0.3, 0.2)
    before = points.copy()
    record = smoother.step(points, max_sweeps=1)
    assert record.sweeps == 1
    moved = (points != before).any(axis=1)
    assert moved.any()
    assert np.abs(points[moved, 0] - 100.0).max() < 90.0


def _strip(n):
    x, y = np.meshgrid(np.arange(n + 1.0), np.arange(5.0))
    first = (np.arange(4)[:, None] * (n + 1) + np.arange(n)).ravel()
    cells = np.stack([first, first + 1, first + n + 2, first + n + 1], axis=1)
    return np.stack([x.ravel(), y.ravel()], axis=1), cells


@pytest.mark.parametrize("name", ["optimize", "star"])
def test_what_the_host_tangles_is_untangled(name):
    mesh, moving = body()
    points = turned(mesh.points, moving, 35.0)  # the cells beside the body fold over
    assert quality(mesh.with_points(points)).n_invalid > 0
    record = Smoother(mesh, name).step(points)
    assert record.untangled
    assert record.valid
    assert quality(mesh.with_points(points)).n_invalid == 0


def test_nothing_gets_worse_than_the_worst():
    mesh = jittered(12, 12, seed=3)
    points = mesh.points.copy()
    Smoother(mesh).step(points)
    before, after = quality(mesh).summary().worst, quality(mesh.with_points(points)).summary().worst
    assert after["min_angle"] >= before["min_angle"]
    assert after["max_angle"] <= before["max_angle"]
    assert after["scaled_jacobian"] >= before["scaled_jacobian"]


@pytest.mark.parametrize(
    "options", [{"hold": "aspect_ratio"}, {"target": "initial"}, {"worst": False}]
)
def test_options_of_the_optimiser(options):
    mesh = jittered(12, 12, seed=4)
    points = mesh.points.copy()
    before = quality(mesh)
    assert Smoother(mesh, **options).step(points).valid
    after = quality(mesh.with_points(points))
    assert not np.array_equal(points, mesh.points)
    if "hold" in options:
        assert after.aspect_ratio.max() <= before.aspect_ratio.max() * (1.0 + 1e-9)


def test_steps_reach_what_sweeps_reach():
    mesh = jittered(12, 12, seed=5)
    points, smoother = mesh.points.copy(), Smoother(mesh)
    for _ in range(200):
        if smoother.step(points).rests:
            break
    assert quality(mesh.with_points(points)).mean_shape > 0.99


def test_in_any_numbering_and_on_any_threads_the_bits_are_the_same():
    mesh, moving = body()
    plain, _ = turn(Smoother(mesh, threads=1), mesh, moving, n=4)
    with numbered("curve"):
        curved, _ = turn(Smoother(Mesh(mesh.points, mesh.cells), threads=1), mesh, moving, n=4)
    threads, _ = turn(Smoother(mesh, threads=2), mesh, moving, n=4)
    assert plain.tobytes() == threads.tobytes()
    # Blocks are other ones there, and so is what is visited: good to what rests.
    assert np.abs(plain - curved).max() < 1e-2


def test_constraints_hold_from_each_call_on():
    mesh = jittered(10, 10, seed=6)
    points, smoother = mesh.points.copy(), Smoother(mesh, max_move=0.004)
    for _ in range(3):
        before = points.copy()
        smoother.step(points)
        lengths = np.hypot(*(points - before).T)
        assert 0.0 < lengths.max() <= 0.004
    assert np.hypot(*(points - mesh.points).T).max() > 0.004
    free = Smoother(mesh, fixed=[60], max_move_share=0.1)
    points = mesh.points.copy()
    free.step(points)
    assert np.array_equal(points[60], mesh.points[60])
    assert not np.array_equal(points, mesh.points)


def test_quads_cut_in_two():
    mesh = jittered(8, 8, seed=7)
    points = mesh.points.copy()
    smoother = Smoother(mesh, "aspect-ratio", split_quads=True)
    for sweeps in (3, 0):
        record = smoother.step(points, max_sweeps=sweeps)
        found = quality(mesh.with_points(points))
        assert record.valid == (found.n_invalid == 0)
        assert record.scaled_jacobian == pytest.approx(found.scaled_jacobian.min(), rel=1e-12)
        assert not np.array_equal(points, mesh.points)
        points[40] += (0.03, 0.02)
    points[40] += (0.3, 0.0)  # over its neighbour
    assert smoother.step(points).untangled


def test_what_the_host_folds_where_quads_are_cut_in_two_is_seen_before_a_sweep():
    mesh = jittered(8, 8, seed=7)
    points, smoother = mesh.points.copy(), Smoother(mesh, "aspect-ratio", split_quads=True)
    assert smoother.step(points, max_sweeps=0).valid
    points[40] += (0.3, 0.0)
    assert smoother.step(points).untangled


def test_points_in_a_tilted_plane():
    flat = jittered(10, 10, seed=8)
    turn_to = np.linalg.qr(np.random.default_rng(1).normal(size=(3, 3)))[0]
    space = np.column_stack([flat.points, np.zeros(flat.n_vertices)]) @ turn_to.T + (3.0, -2.0, 7.0)
    mesh = Mesh(space, flat.cells)
    points, smoother = mesh.points.copy(), Smoother(mesh)
    for _ in range(60):
        record = smoother.step(points)
        if record.rests:
            break
    assert record.rests
    assert record.valid
    moved = mesh.with_points(points)  # in the plane, or it would be refused
    assert np.array_equal(points[mesh.is_boundary], mesh.points[mesh.is_boundary])
    assert quality(moved).mean_shape > 0.99
    points[50] += 0.1 * turn_to[:, 2]
    with pytest.raises(MeshError, match="one plane"):
        smoother.step(points)


def test_a_pickled_one_goes_on_where_it_was():
    mesh, moving = body()
    smoother = Smoother(mesh)
    points, _ = turn(smoother, mesh, moving, n=3)
    again = pickle.loads(pickle.dumps(smoother))
    next_points = turned(mesh.points, moving, 6.0)
    points[moving] = next_points[moving]
    other = points.copy()
    assert again.step(other) == smoother.step(points)
    assert other.tobytes() == points.tobytes()
    assert again(points).points.tobytes() == smoother(points).points.tobytes()
    assert not again.mesh.points.flags.writeable
    assert not again.mesh.topology.cell_vertices.flags.writeable


def test_one_thread_at_a_time():
    mesh = jittered(6, 6)
    entered, leave, errors = threading.Event(), threading.Event(), []

    def wait(record):
        entered.set()
        leave.wait(60.0)
        return True

    smoother = Smoother(mesh, "star", callback=wait)
    other = threading.Thread(target=smoother, args=(mesh.points,))
    other.start()
    entered.wait(60.0)
    for call in (smoother, lambda points: smoother.step(points.copy())):
        with pytest.raises(RuntimeError, match="make one for each thread") as error:
            call(mesh.points)
        errors.append(error)
    leave.set()
    other.join()
    assert len(errors) == 2
    assert smoother.step(mesh.points.copy()).valid


def test_wrong_points():
    mesh, moving = body()
    smoother = Smoother(mesh)
    points, _ = turn(smoother, mesh, moving, n=2)
    before = points.copy()
    bad = points.copy()
    bad[7, 1] = np.nan
    with pytest.raises(MeshError, match="1 vertex is not finite, the first is vertex 7"):
        smoother.step(bad)
    with pytest.raises(MeshError, match="vertex 7"):
        smoother(bad)
    bad[7, 1] = 1e80
    with pytest.raises(MeshError, match="first is vertex 7"):
        smoother.step(bad)
    for shape in ((3, 2), (mesh.n_vertices, 3)):
        with pytest.raises(MeshError, match="must have the shape"):
            smoother.step(np.zeros(shape))
    with pytest.raises(TypeError, match="float64"):
        smoother.step(points.astype(np.float32))
    with pytest.raises(TypeError, match="float64"):
        smoother.step(points.tolist())
    with pytest.raises(TypeError, match="float64"):
        smoother.step(mesh.points)
    with pytest.raises(ValueError, match="max_sweeps must be 0 or more"):
        smoother.step(points, max_sweeps=-1)
    assert np.array_equal(points, before)
    assert smoother.step(points).valid


def test_wrong_methods():
    mesh = jittered(4, 4)
    with pytest.raises(TypeError, match="no option"):
        Smoother(mesh, "star", hold="shape")
    with pytest.raises(ValueError, match="method must be one of"):
        Smoother(mesh, "nonsense")
    assert Smoother(mesh, Star(step=0.3)).method == Star(step=0.3)
    assert isinstance(Smoother(mesh).method, Optimize)


@pytest.mark.parametrize("name", ["optimize", "star"])
def test_no_step_asks_for_memory_that_grows_with_the_mesh(name):
    small, large = (memory_of_steps(name, n) for n in (30, 120))
    # An array of places would be 200 KB more; the rest is what calls of kernels take.
    assert large[1] - small[1] < 20_000
    assert large[0] - small[0] < 20_000


def memory_of_steps(name, n):
    """Memory after some steps, and the most that there was, beyond what there was before."""
    mesh = around_body(n)
    moving = mesh.is_boundary & (np.abs(mesh.points).max(axis=1) < 0.5)
    smoother = Smoother(mesh, name, threads=1)
    points, _ = turn(smoother, mesh, moving, n=3, degrees=0.2)
    places = [turned(mesh.points, moving, 0.6 + 0.2 * k)[moving] for k in range(10)]
    gc.collect()
    tracemalloc.start()
    for place in places:
        points[moving] = place
        assert smoother.step(points).sweeps > 0
    used = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    return used


def test_many_calls_leave_nothing_behind():
    mesh, moving = body()
    smoother = Smoother(mesh, threads=1)
    points, _ = turn(smoother, mesh, moving, n=2)
    places = [turned(mesh.points, moving, angle)[moving] for angle in (0.0, 2.0)]

    def call(times):
        for k in range(times):
            points[moving] = places[k % 2]
            smoother.step(points)
            if k % 50 == 0:
                smoother(points)

    call(100)
    gc.collect()
    tracemalloc.start()
    call(100)
    gc.collect()
    before = tracemalloc.get_traced_memory()[0]
    call(1000)
    gc.collect()
    after = tracemalloc.get_traced_memory()[0]
    tracemalloc.stop()
    assert after - before < 200_000  # a result is 20 KB, and 20 were made


def test_a_mesh_without_a_vertex_that_may_move():
    mesh = Mesh([(0, 0), (1, 0), (1, 1), (0, 1)], [(0, 1, 2, 3)])
    points = mesh.points.copy()
    record = Smoother(mesh).step(points)
    assert (record.valid, record.sweeps, record.rests) == (True, 0, True)
    assert np.array_equal(points, mesh.points)
