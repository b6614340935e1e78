"""Steps of a session that slide vertices along their lines, and find z anew where vertices go."""

import gc
import math
import pickle
import tracemalloc

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from outlines import MESHES, bay, check_slid, crossings, distance, is_on, ring, sides
from promises import invalid_cells
from qsmooth import Mesh, Optimize, Smoother, Star, Untangle, quality, transfer
from qsmooth.examples import jittered
from qsmooth.numbering import numbered
from qsmooth.optimizer.step_slides import layout_of
from qsmooth.registry import all_methods

every_method = pytest.mark.parametrize("known", all_methods().values(), ids=all_methods())


def steps(smoother, points, n=3):
    """Take so many steps; gives the last record."""
    for _ in range(n):
        record = smoother.step(points)
    return record


@every_method
@given(mesh=MESHES, tolerance=st.sampled_from([0.0, 0.01, 0.05]), share=st.none() | st.just(0.2))
@settings(max_examples=8)
def test_boundary_vertices_stay_on_it(known, mesh, tolerance, share):
    method = known(boundary="slide", outline_tolerance=tolerance, max_move_share=share, threads=1)
    if method.why_not(mesh):
        return
    points, smoother = mesh.points.copy(), Smoother(mesh, method)
    valid = not invalid_cells(mesh).any()
    # The outline is the one that the host gave, however often it gives back what it has got.
    for _ in range(3):
        record = smoother.step(points)
        check_slid(mesh, points, tolerance)
        if method.guards and valid:
            assert record.valid
            assert not invalid_cells(mesh.with_points(points)).any()
            assert not crossings(points, sides(mesh))


@pytest.mark.parametrize("method", ["optimize", "star", "smart-laplacian", "laplacian"])
def test_what_slides_gets_better(method):
    mesh = bay(12, 0.6)
    shapes = []
    for how in ("fixed", "slide"):
        points = mesh.points.copy()
        steps(Smoother(mesh, method, boundary=how), points, 10)
        shapes.append(quality(mesh.with_points(points)).mean_shape)
        moved = (points != mesh.points).any(axis=1)[mesh.is_boundary]
        assert moved.sum() > 30 if how == "slide" else not moved.any()
    assert shapes[1] > shapes[0] + 1e-3


def body_in_ring(seed=0):
    """A ring, the vertices of its body, and those of its outer boundary."""
    mesh = ring(30, 3, 0.6, seed=seed)
    inner = mesh.is_boundary & (np.hypot(*mesh.points.T) < 1.5)
    return mesh, inner, mesh.is_boundary & ~inner


@pytest.mark.parametrize("method", ["optimize", "star"])
@given(
    seed=st.integers(0, 99),
    angle=st.floats(-4.0, 4.0),
    way=st.tuples(st.floats(0.005, 0.02), st.floats(-0.02, 0.02)),
    places=st.booleans(),
)
@settings(max_examples=5)
def test_a_body_moves_and_its_boundary_slides(method, seed, angle, way, places):
    """The host moves what there is, or puts the body where it has it itself."""
    mesh, body, _ = body_in_ring(seed)
    points, smoother = mesh.points.copy(), Smoother(mesh, method, boundary="slide", threads=1)
    c, s = np.cos(np.radians(angle)), np.sin(np.radians(angle))
    turn, place = np.array([[c, s], [-s, c]]), mesh.points[body]
    slid = 0
    for _ in range(4):
        place = (place if places else points[body]) @ turn + way
        points[body] = place
        given_points = points.copy()
        assert smoother.step(points).valid
        # The body's outline is that of this call, the other one was given before the first.
        before = mesh.points.copy()
        before[body] = given_points[body]
        check_slid(mesh.with_points(before), points, 0.01)
        assert not crossings(points, sides(mesh))
        slid += (points != given_points).any(axis=1)[body].sum()
    assert slid > 20


def shore(bend):
    """A square whose upper side turns half-way, its vertices shaken; and these."""
    mesh = bay(8, 0.0, height=0.0)
    top, points = np.flatnonzero(mesh.points[:, 1] == 1.0), mesh.points.copy()
    points[:, 1] *= 1.0 + bend * (0.5 - np.abs(points[:, 0] - 0.5))
    x = points[top, 0]
    x = np.where((x == 0.5) & (bend > 0.0), x, x + 0.3 * np.sin(3.0 * np.pi * x) / 8.0)
    points[top] = np.stack([x, 1.0 + bend * (0.5 - np.abs(x - 0.5))], axis=1)
    return mesh.with_points(points), top


@pytest.mark.parametrize("made_of", [0.0, 0.5])
def test_what_is_a_corner_is_so_in_each_call(made_of):
    smoother = Smoother(shore(made_of)[0], "star", boundary="slide")
    for bend, slide in ((0.0, 7), (0.5, 6), (0.0, 7)):
        mesh, top = shore(bend)
        points = mesh.points.copy()
        assert smoother.step(points).valid
        moved = (points != mesh.points).any(axis=1)[top]
        assert moved.sum() == slide
        assert moved[4] == (bend == 0.0)
        check_slid(mesh, points, 0.01)


def test_what_slides_comes_to_rest():
    mesh = bay(10, 0.6)
    points, smoother = mesh.points.copy(), Smoother(mesh, boundary="slide")
    for _ in range(100):
        if smoother.step(points).rests:
            break
    at_rest = points.copy()
    assert smoother.step(points).sweeps == 0
    assert np.array_equal(points, at_rest)
    check_slid(mesh, points, 0.01)
    # One vertex of the shore is moved: what is around it wakes, and slides.
    top = np.flatnonzero(points[:, 1] == points[:, 1].max())[0]
    points[top] += (0.03, 0.0)
    assert smoother.step(points).sweeps > 0


def test_interfaces_slide():
    n = 10
    regions = (np.arange(n * n) % n >= n // 2).astype(int)
    mesh = bay(n, 0.5, regions=regions)
    line = np.flatnonzero(mesh.is_interface)
    for method in ("optimize", "smart-laplacian"):
        points = mesh.points.copy()
        steps(Smoother(mesh, method, interfaces="slide"), points)
        moved = (points != mesh.points).any(axis=1)
        assert not moved[mesh.is_boundary].any()
        assert moved[line].any()
        for v in line[moved[line]]:
            assert any(is_on(points[v], *mesh.xy[[a, a + n + 1]]) for a in line[:-1])


def test_what_is_fixed_does_not_slide_and_moves_are_no_longer_than_allowed():
    mesh = bay(8, 0.5)
    left = mesh.is_boundary & (mesh.points[:, 0] < 0.5)
    points = mesh.points.copy()
    steps(Smoother(mesh, "star", boundary="slide", fixed="x < 0.5"), points)
    moved = (points != mesh.points).any(axis=1)
    assert not moved[left].any()
    assert moved[mesh.is_boundary & ~left].any()
    points, smoother = mesh.points.copy(), Smoother(mesh, boundary="slide", max_move=0.004)
    for _ in range(3):
        before = points.copy()
        smoother.step(points)
        lengths = np.hypot(*(points - before).T)
        assert 0.0 < lengths[mesh.is_boundary].max() <= lengths.max() <= 0.004


def test_quads_cut_in_two():
    mesh = bay(8, 0.5)
    points = mesh.points.copy()
    options = {"split_quads": True, "boundary": "slide"}
    record = steps(Smoother(mesh, "aspect-ratio", **options), points)
    assert record.valid
    assert (points != mesh.points).any(axis=1)[mesh.is_boundary].sum() > 10
    check_slid(mesh, points, 0.01)


def test_untangling_slides_where_moving_the_others_is_not_enough():
    lower = [(0.0, 0.0), (1.0, 0.15), (2.0, 0.0)]
    upper = [(0.0, 0.2), (0.2, 0.2), (2.0, 0.2)]
    mesh = Mesh(lower + upper, [[0, 1, 4, 3], [1, 2, 5, 4]])
    for known in (Untangle, Optimize, Star):
        points = mesh.points.copy()
        record = Smoother(mesh, known()).step(points)
        assert record.untangled
        assert not record.valid
        record = Smoother(mesh, known(boundary="slide")).step(points)
        assert record.valid
        check_slid(mesh, points, 0.01)


def test_sweeps_go_on_from_where_untangling_has_slid_vertices_to():
    lower = [(0.0, 0.0), (1.0, 0.15), (2.0, 0.0)]
    upper = [(0.0, 0.2), (0.2, 0.2), (2.0, 0.2)]
    mesh = Mesh(lower + upper, [[0, 1, 4, 3], [1, 2, 5, 4]])
    points, again = mesh.points.copy(), mesh.points.copy()
    options = {"boundary": "slide", "fixed": [1]}
    assert Smoother(mesh, "star", **options).step(points).untangled
    Smoother(mesh, Untangle(**options)).step(again)
    # The line is straight: it is the same, laid through where the vertex is now.
    assert not Smoother(mesh, "star", **options).step(again).untangled
    assert np.abs(points - again).max() < 1e-12


def test_corners_of_a_step_are_by_the_angle_that_is_asked_for():
    mesh, top = shore(0.5)
    for angle, slide in ((40.0, 6), (60.0, 7)):
        points = mesh.points.copy()
        Smoother(shore(0.0)[0], "star", boundary="slide", corner_angle=angle).step(points)
        assert (points != mesh.points).any(axis=1)[top].sum() >= slide
        assert (points[top[4]] != mesh.points[top[4]]).any() == (angle > 54.0)


def test_neither_threads_nor_numbering_change_a_bit():
    mesh = bay(10, 0.7)
    found = []
    for threads, how in ((1, "kept"), (2, "kept"), (1, "curve")):
        with numbered(how):
            points = mesh.points.copy()
            fresh = Mesh(mesh.points, mesh.cells)
            Smoother(fresh, "star", boundary="slide", threads=threads).step(points, max_sweeps=1)
            found.append(points.tobytes())
    assert found[0] == found[1] == found[2]


def test_a_pickled_one_slides_along_the_same_outline():
    mesh = bay(10, 0.6)
    points, smoother = mesh.points.copy(), Smoother(mesh, boundary="slide")
    steps(smoother, points, 2)
    again, other = pickle.loads(pickle.dumps(smoother)), points.copy()
    for _ in range(3):
        assert again.step(other) == smoother.step(points)
        assert other.tobytes() == points.tobytes()
    check_slid(mesh, points, 0.01)


def test_in_a_tilted_plane():
    flat = bay(10, 0.6)
    turn = np.linalg.qr(np.random.default_rng(1).normal(size=(3, 3)))[0]
    space = np.column_stack([flat.points, np.zeros(flat.n_vertices)]) @ turn.T + (3.0, -2.0, 7.0)
    mesh = Mesh(space, flat.cells)
    points, smoother = mesh.points.copy(), Smoother(mesh, boundary="slide")
    flat_points = flat.points.copy()
    record = steps(smoother, points, 4)
    steps(Smoother(flat, boundary="slide"), flat_points, 4)
    assert record.valid
    assert (points != mesh.points).any(axis=1)[mesh.is_boundary].sum() > 30
    back = (points - (3.0, -2.0, 7.0)) @ turn
    assert np.abs(back[:, :2] - flat_points).max() < 1e-3
    assert np.abs(back[:, 2]).max() < 1e-12


def test_in_a_tilted_plane_the_outline_stays_however_often_it_is_untangled():
    """As they are rounded in space, vertices are beside the lines that they came along."""
    flat = bay(8, 0.6)
    turn = np.linalg.qr(np.random.default_rng(1).normal(size=(3, 3)))[0]
    mesh = Mesh(np.column_stack([flat.points, np.zeros(flat.n_vertices)]) @ turn.T, flat.cells)
    points, smoother = mesh.points.copy(), Smoother(mesh, "star", boundary="slide")
    inside, rng, untangled = np.flatnonzero(~flat.is_boundary), np.random.default_rng(3), 0
    for _ in range(12):
        points[rng.choice(inside)] += turn[:, :2] @ rng.uniform(-0.4, 0.4, 2)
        untangled += smoother.step(points).untangled
    assert untangled > 8
    back = (points @ turn)[:, :2]
    assert (np.abs(back - flat.points) > 1e-3).any(axis=1)[flat.is_boundary].sum() > 20
    for v in np.flatnonzero(flat.is_boundary):
        off = min(distance(back[v], *flat.xy[list(side)])[0] for side in sides(flat))
        assert off < 1e-14


# ------------------------------------------------------------------------------- curves


def circle(k, radius):
    angle = np.linspace(0.0, 2.0 * math.pi, k + 1)
    places = radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    places[-1] = places[0]
    return places


def onto_circles(places):
    radius = np.hypot(*places.T)
    return places / radius[:, None] * np.where(radius < 1.5, 1.0, 2.0)[:, None]


@pytest.mark.parametrize("method", ["optimize", "star"])
@pytest.mark.parametrize("curve", [[circle(500, 1.0), circle(700, 2.0)], onto_circles])
def test_along_a_curve(method, curve):
    mesh, body, outer = body_in_ring()
    points, smoother = mesh.points.copy(), Smoother(mesh, method, boundary="slide", curve=curve)
    c, s = np.cos(0.05), np.sin(0.05)
    for _ in range(12):
        # The body turns, with the vertex of its boundary that stays.
        points[body] = points[body] @ np.array([[c, s], [-s, c]])
        assert smoother.step(points).valid
    radius = np.hypot(*points.T)
    assert np.abs(radius[body] - 1.0).max() < 1e-4
    assert np.abs(radius[outer] - 2.0).max() < 1e-4
    assert (points != mesh.points).any(axis=1)[outer].sum() == outer.sum() - 1


def test_a_curve_beside_one_shore_alone():
    mesh = bay(10, 0.5)
    x = np.linspace(0.0, 1.0, 300)
    coast = np.stack([x, 1.0 + 0.1 * np.sin(2.0 * np.pi * x)], axis=1)
    points, smoother = mesh.points.copy(), Smoother(mesh, boundary="slide", curve=coast)
    steps(smoother, points, 5)
    moved = (points != mesh.points).any(axis=1)
    top = np.isclose(mesh.points[:, 1], 1.0 + 0.1 * np.sin(2.0 * np.pi * mesh.points[:, 0]))
    assert moved[top].sum() > 5
    off = points[top, 1] - 1.0 - 0.1 * np.sin(2.0 * np.pi * points[top, 0])
    assert np.abs(off).max() < 1e-5
    assert moved[(points == 0.0).any(axis=1)].sum() > 10
    again = pickle.loads(pickle.dumps(smoother))
    # The end of the coast is moved on along it: what is left of it is another stretch.
    corner = int(np.flatnonzero((points == (1.0, 1.0)).all(axis=1))[0])
    points[corner] = (0.99, 1.0 + 0.1 * np.sin(2.0 * np.pi * 0.99))
    other = points.copy()
    assert smoother.step(points).valid
    off = points[top, 1] - 1.0 - 0.1 * np.sin(2.0 * np.pi * points[top, 0])
    assert np.abs(off).max() < 1e-5
    assert again.step(other).valid
    assert other.tobytes() == points.tobytes()


def on_coast(x):
    return np.stack([x, 1.0 + 0.1 * np.sin(2.0 * np.pi * x)], axis=1)


def test_chains_on_a_curve_beside_others_are_where_their_vertices_are():
    mesh = bay(10, 0.5)
    method = Star(boundary="slide", curve=on_coast(np.linspace(0.0, 1.0, 300)), fixed="x < 0.3")
    freedom, own = layout_of(method.resolved(mesh), mesh)
    chains = freedom.chains
    assert own.any()
    assert not own.all()
    way = chains.nodes[chains.segments + 1] - chains.nodes[chains.segments]
    places = chains.nodes[chains.segments] + chains.fractions[:, None] * way
    assert np.abs(places - mesh.xy[chains.vertices]).max() < 1e-4
    sliding = chains.sliding(mesh.n_vertices)
    assert freedom.movable[sliding].all()
    assert not (sliding & (mesh.xy[:, 0] < 0.3)).any()


@pytest.mark.parametrize("by", [-0.02, 0.02])
def test_what_the_host_moves_along_a_curve_goes_on_from_there(by):
    mesh, coast = bay(10, 0.5), on_coast(np.linspace(0.0, 1.0, 300))
    points = mesh.points.copy()
    smoother = Smoother(mesh, "star", boundary="slide", curve=coast, max_move=0.004)
    smoother.step(points)
    moved = (points != mesh.points).any(axis=1) & mesh.is_boundary
    v = next(v for v in np.flatnonzero(moved) if 0.35 < points[v, 0] < 0.65 and points[v, 1] > 0.9)
    points[v] = on_coast(points[v, :1] + by)
    before = points[v].copy()
    assert smoother.step(points).valid
    assert 0.0 < np.linalg.norm(points[v] - before) <= 0.004
    assert any(is_on(points[v], *coast[k : k + 2]) for k in range(len(coast) - 1))


def test_a_function_is_asked_again_only_where_the_host_has_moved_ends():
    calls, (mesh, body, _) = [], body_in_ring()

    def curve(places):
        calls.append(len(places))
        return onto_circles(places)

    points, smoother = mesh.points.copy(), Smoother(mesh, "star", boundary="slide", curve=curve)
    smoother.step(points)
    points[body] = points[body] @ np.array([[0.99875, 0.04998], [-0.04998, 0.99875]])
    known = len(calls)
    smoother.step(points)
    assert len(calls) == known + 2
    for _ in range(3):
        points[~mesh.is_boundary] += 1e-4
        assert smoother.step(points).sweeps
    assert len(calls) == known + 2


def test_what_the_host_takes_from_its_curve_slides_along_the_outline():
    mesh = bay(10, 0.4, height=0.0)
    top = np.flatnonzero(mesh.points[:, 1] == 1.0)
    x = np.linspace(0.0, 1.0, 300)
    points = mesh.points.copy()
    smoother = Smoother(mesh, "star", boundary="slide", curve=np.stack([x, 0.0 * x + 1.0], axis=1))
    smoother.step(points)
    points[:, 1] *= 0.7  # farther from the curve than its edges are long
    smoother.step(points)
    order = top[np.argsort(points[top, 0])]
    points[order[3:8], 1] += 0.01
    line = points[order].copy()
    for _ in range(3):
        assert smoother.step(points).valid
    for v in order:
        assert any(is_on(points[v], *line[k : k + 2]) for k in range(10))


# ------------------------------------------------------------------------------- z


def with_bed(mesh, bed):
    points = np.column_stack([mesh.points, bed(*mesh.points.T)])
    return Mesh(points, mesh.cells, surface="flat")


def linear(x, y):
    return 3.0 * x - 2.0 * y + 5.0


@pytest.mark.parametrize("boundary", ["fixed", "slide"])
@pytest.mark.parametrize("method", ["optimize", "laplacian"])
def test_a_linear_bed_stays_exact(method, boundary):
    mesh = with_bed(bay(10, 0.7), linear)
    points, smoother = mesh.points.copy(), Smoother(mesh, method, boundary=boundary)
    for _ in range(10):
        smoother.step(points)
        assert np.abs(points[:, 2] - linear(*points[:, :2].T)).max() < 1e-13
    moved = (points[:, :2] != mesh.points[:, :2]).any(axis=1)
    assert points[~moved].tobytes() == mesh.points[~moved].tobytes()
    assert moved[mesh.is_boundary].any() == (boundary == "slide")


def test_a_linear_bed_stays_exact_around_a_body():
    """The host says what z is where it puts the body; elsewhere it follows from there."""
    flat, body, _ = body_in_ring()
    mesh = with_bed(flat, linear)
    points, smoother = mesh.points.copy(), Smoother(mesh, boundary="slide")
    for _ in range(8):
        points[body, 0] += 0.02
        points[body, 2] = linear(*points[body, :2].T)
        assert smoother.step(points).valid
        assert np.abs(points[:, 2] - linear(*points[:, :2].T)).max() < 1e-13


def test_z_is_that_of_the_points_of_the_call():
    flat = jittered(8, 8, seed=9, kind="mixed")
    mesh = with_bed(flat, lambda x, y: 0.0 * x)
    smoother = Smoother(mesh)
    for bed in (lambda x, y: x * y, lambda x, y: np.sin(5.0 * x) + y**2):
        points = with_bed(flat, bed).points.copy()
        points[0, 2] = np.nan  # of a corner: known there it need not be
        out = np.empty_like(points)
        smoother.step(points, out)
        wanted = transfer((flat.points, flat.cells), (out[:, :2], flat.cells), points[:, 2])
        assert np.allclose(out[:, 2], wanted, rtol=1e-13, atol=1e-13, equal_nan=True)
        assert not np.array_equal(out[1:, 2], points[1:, 2])


def test_beyond_the_boundary_z_goes_on():
    flat, _, outer = body_in_ring()
    mesh, curve = with_bed(flat, linear), [circle(500, 1.0), circle(700, 2.0)]
    points = mesh.points.copy()
    Smoother(mesh, "star", boundary="slide", curve=curve).step(points)
    beyond = outer & (np.hypot(*points[:, :2].T) > 1.998)
    assert (points != mesh.points).any(axis=1)[beyond].sum() > 5
    assert np.abs(points[:, 2] - linear(*points[:, :2].T)).max() < 1e-13
    # Clamped to the boundary it would be this.
    wanted = transfer((flat.points, flat.cells), (points[:, :2], flat.cells), mesh.points[:, 2])
    assert np.abs(points[:, 2] - wanted).max() > 1e-4


def test_z_where_the_mesh_is_folded():
    """No walk leads through cells that are folded: then all cells are looked through."""
    flat = jittered(8, 8, seed=2)
    points = with_bed(flat, linear).points.copy()
    points[40] = points[20] + (0.01, 0.02, 0.07)  # over other cells
    points[0, 2] = np.nan  # known there it need not be
    given_points = points.copy()
    assert Smoother(with_bed(flat, linear)).step(points).untangled
    before, after = ((p[:, :2], flat.cells) for p in (given_points, points))
    wanted = transfer(before, after, given_points[:, 2])
    assert np.allclose(points[:, 2], wanted, rtol=1e-12, atol=1e-12, equal_nan=True)


def test_z_is_kept_where_that_is_asked_for():
    flat = jittered(6, 6, seed=9)
    z = np.arange(flat.n_vertices, dtype=float)
    mesh = Mesh(np.column_stack([flat.points, z]), flat.cells, surface="flat")
    points = mesh.points.copy()
    Smoother(mesh, carry="keep").step(points)
    assert np.array_equal(points[:, 2], z)
    assert not np.array_equal(points, mesh.points)


def test_no_step_asks_for_memory_that_grows_with_the_mesh():
    # What calls of compiled kernels keep for themselves comes and goes: the least of some.
    tries = [[memory_of_steps(n) for n in (20, 100)] for _ in range(3)]
    (small, low), (large, high) = np.min(tries, axis=0)
    assert high - low < 40_000  # an array of places would be 150 KB more
    assert large - small < 20_000


def memory_of_steps(n):
    """Memory of arrays after some steps, and the most that there was, beyond what was before."""
    mesh = with_bed(bay(n, 0.3), linear)
    top = np.flatnonzero(mesh.is_boundary & (mesh.points[:, 1] > 0.85))
    points, smoother = mesh.points.copy(), Smoother(mesh, boundary="slide", threads=1)
    steps(smoother, points, 2)
    gc.collect()
    tracemalloc.start()
    for k in range(10):
        points[top, 1] += 1e-4 * (-1) ** k
        assert smoother.step(points).sweeps > 0
    most = tracemalloc.get_traced_memory()[1]
    arrays = tracemalloc.DomainFilter(True, np.lib.tracemalloc_domain)
    kept = tracemalloc.take_snapshot().filter_traces([arrays])
    tracemalloc.stop()
    return sum(trace.size for trace in kept.traces), most
