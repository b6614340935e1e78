"""How good the angles of a connectivity can get: by hand, against the slow version, and that no
mesh beats it.
"""

import json
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import reference
import reference_optimizer as slow
from meshes import KINDS, annulus, fan, grid, random_mesh, random_meshes
from qsmooth import Mesh, limits, quality, read_mesh, smooth


def angles_and_vertices(mesh, **options):
    found = limits(mesh, **options)
    return (found.min_angle, found.max_angle), (found.min_angle_vertex, found.max_angle_vertex)


def wheel(n):
    """Triangles round vertex 0."""
    rim = [(math.cos(2 * math.pi * k / n), math.sin(2 * math.pi * k / n)) for k in range(n)]
    return Mesh([(0.0, 0.0), *rim], [(0, 1 + k, 1 + (k + 1) % n) for k in range(n)])


# ------------------------------------------------------------------------------- by hand


@pytest.mark.nojit
def test_a_structured_grid_can_have_right_angles_only():
    angles, vertices = angles_and_vertices(Mesh(*grid(4, 3)))
    assert angles == (90.0, 90.0)
    assert vertices == (-1, -1)


@pytest.mark.nojit
@pytest.mark.parametrize("jitter", [0.0, 0.8])
def test_moving_interior_vertices_changes_no_limit(jitter):
    mesh = random_mesh("quads", 5, seed=1, amount=jitter).mesh
    angles, _ = angles_and_vertices(mesh)
    assert angles == pytest.approx((90.0, 90.0))


@pytest.mark.nojit
@pytest.mark.parametrize("valence", [7, 9, 12])
def test_a_hub_of_many_triangles_sets_the_smallest_angle(valence):
    hub = wheel(valence)
    angles, vertices = angles_and_vertices(hub)
    # The rim is fixed: at each of its vertices two cells share 180° − 360°/d.
    rim = 90.0 - 180.0 / valence
    assert angles == pytest.approx((360.0 / valence, max(60.0, rim)))
    assert vertices[0] == 0
    assert vertices[1] >= 1


@pytest.mark.nojit
def test_a_hub_of_five_triangles_sets_the_largest_angle():
    hub = wheel(5)
    angles, (_, at_largest) = angles_and_vertices(hub)
    assert angles == pytest.approx((54.0, 72.0))
    assert at_largest == 0


@pytest.mark.nojit
@pytest.mark.parametrize("valence", [3, 5, 6])
def test_a_hub_of_quads_sets_one_of_both(valence):
    angles, vertices = angles_and_vertices(Mesh(*fan(valence, "quad")))
    at_hub = 360.0 / valence
    assert angles[0] <= min(at_hub, 90.0) + 1e-12
    assert angles[1] >= max(at_hub, 90.0) - 1e-12
    assert (vertices[0] == 0) if valence > 4 else (vertices[1] == 0 or angles[1] > at_hub)


@pytest.mark.nojit
def test_a_fan_at_the_boundary_shares_its_angle():
    # Three triangles in the right angle at the origin.
    rim = [(math.cos(t), math.sin(t)) for t in np.linspace(0.0, 0.5 * math.pi, 4)]
    mesh = Mesh([(0.0, 0.0), *rim], [(0, 1, 2), (0, 2, 3), (0, 3, 4)])
    angles, vertices = angles_and_vertices(mesh)
    # Every vertex is fixed, so each corner is a run of its own.
    assert angles == pytest.approx((30.0, 75.0))
    assert vertices[0] == 0


def two_by_one(corner):
    """Two squares side by side and one above each: the vertex between them is inside."""
    points, cells = grid(2, 2)
    points[0] = corner
    return Mesh(points, cells)


@pytest.mark.nojit
def test_a_corner_of_one_cell_is_given():
    # The corner at (−2, −2) has atan(3/2) − atan(2/3) for one cell alone; the free vertex, four
    # cells, sets less.
    angles, (at_smallest, _) = angles_and_vertices(two_by_one((-2.0, -2.0)))
    expected = math.degrees(math.atan2(3.0, 2.0) - math.atan2(2.0, 3.0))
    assert angles[0] == pytest.approx(expected)
    assert at_smallest == 0


@pytest.mark.nojit
def test_a_pinched_vertex_has_one_fan_at_a_time():
    # Three triangles in a right angle meet a square at one vertex: 30° and 90°, not 180° over 4.
    rim = [(math.cos(t), math.sin(t)) for t in np.linspace(0.0, 0.5 * math.pi, 4)]
    points = [(0.0, 0.0), *rim, (-1.0, 0.0), (-1.0, -1.0), (0.0, -1.0)]
    mesh = Mesh(points, [[(0, 1, 2), (0, 2, 3), (0, 3, 4)], [(0, 5, 6, 7)]])
    angles, vertices = angles_and_vertices(mesh)
    assert angles == pytest.approx((30.0, 90.0))
    assert vertices == (0, -1)


@pytest.mark.nojit
def test_fixed_neighbours_split_the_fan_of_a_fixed_vertex():
    # Far from the boundary a vertex with the edge to its right and the one above fixed, the latter
    # leaning: one cell has the angle between the two, the other three share the rest.
    points, cells = grid(6, 6)
    centre, right, above = 24, 25, 31
    points[above] = 3.0 + math.tan(math.radians(30.0)), 4.0
    fixed = np.zeros(49, np.bool_)
    fixed[[centre, right, above]] = True
    angles, vertices = angles_and_vertices(Mesh(points, cells, fixed=fixed))
    assert angles == pytest.approx((60.0, 100.0))
    assert vertices == (centre, centre)
    # One of the three free, and nothing is given any more.
    for free in (centre, right, above):
        fixed[[centre, right, above]] = True
        fixed[free] = False
        assert angles_and_vertices(Mesh(points, cells, fixed=fixed))[0] == pytest.approx((90, 90))


@pytest.mark.nojit
def test_sums_of_cells_set_the_limit_by_no_vertex():
    # Six equilateral triangles, and beside a square: 60° by any triangle, 90° by any quad.
    assert angles_and_vertices(wheel(6))[0] == pytest.approx((60.0, 60.0))
    h = 0.75**0.5
    both = Mesh([(0, 0), (1, 0), (1, 1), (0, 1), (0.5, 1 + h)], [[(0, 1, 2, 3)], [(3, 2, 4)]])
    assert angles_and_vertices(both)[0] == pytest.approx((60.0, 90.0))


@pytest.mark.nojit
def test_interfaces_stay_or_not():
    # Two regions of two squares each. While the vertex between them stays, every corner is given.
    points, cells = grid(2, 2)
    points[4] = 1.0, 1.5
    mesh = Mesh(points, cells, regions=[0, 0, 1, 1])
    found = limits(mesh)
    assert (found.min_angle, found.max_angle) == pytest.approx(
        (found.reached_min_angle, found.reached_max_angle)
    )
    assert found.min_angle == pytest.approx(math.degrees(math.atan2(1.0, 0.5)))
    assert angles_and_vertices(mesh, keep_interfaces=False)[0] == (90.0, 90.0)


@pytest.mark.nojit
def test_an_edge_of_no_length_bounds_nothing():
    # The boundary edge 0-1 has no length: neither has a direction for a bound.
    points, cells = grid(3, 3)
    points[1] = points[0]
    found = limits(Mesh(points, cells))
    assert 0.0 < found.min_angle <= 90.0
    assert 90.0 <= found.max_angle < 180.0
    assert found.min_angle_vertex not in (0, 1)
    assert found.max_angle_vertex not in (0, 1)


@pytest.mark.filterwarnings("ignore::qsmooth.MeshWarning")
def test_the_collapsed_cell_of_a_real_mesh_makes_no_nonsense(shared_meshes):
    found = limits(read_mesh(shared_meshes / "hughes_6k.obj"))
    assert found.max_angle <= 180.0


@pytest.mark.nojit
def test_reached_is_what_quality_measures_and_words_and_json_say_both():
    mesh = random_mesh("triangle fan", 6, seed=4, amount=0.9).mesh
    found, own = limits(mesh), quality(mesh)
    assert found.reached_min_angle == own.min_angle.min()
    assert found.reached_max_angle == own.max_angle.max()
    lines = str(found).splitlines()
    assert len(lines) == 2
    assert f"{found.reached_min_angle:.2f}°" in lines[0]
    assert f"{found.min_angle:.2f}°" in lines[0]
    assert f"vertex {found.min_angle_vertex}" in lines[0]
    assert f"{found.max_angle:.2f}°" in lines[1]
    plain = found.to_dict()
    assert json.loads(json.dumps(plain)) == plain
    assert limits((mesh.points, _cells(mesh))) == found


def _cells(mesh):
    cells = reference.as_lists(mesh)
    return [b for n in (4, 3) if (b := [cell for cell in cells if len(cell) == n])]


@pytest.mark.nojit
def test_the_angle_sum_of_a_cell_is_named_as_such():
    assert "mean angle of a cell" in str(limits(Mesh(*grid(3, 3))))


# ------------------------------------------------------------------------------- of any mesh


def movable(mesh):
    free = np.zeros(mesh.n_vertices, np.bool_)
    free[mesh.topology.schedule(True).vertices] = True
    return free


@pytest.mark.nojit
@pytest.mark.parametrize("kind", KINDS)
def test_limits_agree_with_the_slow_version(kind):
    for seed in range(3):
        made = random_mesh(kind, 3, seed=seed, amount=0.8)
        fixed = np.random.default_rng(seed).random(len(made.points)) < 0.4
        mesh = Mesh(made.points, made.cells, fixed=fixed)
        found = limits(mesh)
        low, high, at_low, at_high = slow.angle_limits(
            reference.as_complex(mesh.xy), reference.as_lists(mesh), movable(mesh)
        )
        assert found.min_angle == pytest.approx(low, abs=1e-7)
        assert found.max_angle == pytest.approx(high, abs=1e-7)
        # Of several that set the same any may be named.
        for own, slow_own, value in (
            (found.min_angle_vertex, at_low, low),
            (found.max_angle_vertex, at_high, high),
        ):
            if own >= 0 and slow_own >= 0:
                shares = slow.angle_shares(
                    reference.as_complex(mesh.xy), own, reference.as_lists(mesh), movable(mesh)
                )
                assert min(abs(share - value) for share in shares) < 1e-7


@given(random_meshes(), st.integers(0, 2**32 - 1), st.sampled_from([0.0, 0.2, 0.6, 1.0]))
@settings(max_examples=200)
def test_no_valid_mesh_beats_its_limits(made, seed, share):
    fixed = np.random.default_rng(seed).random(len(made.points)) < share
    found = limits(Mesh(made.points, made.cells, fixed=fixed))
    assert found.reached_min_angle <= found.min_angle + 1e-7
    assert found.reached_max_angle >= found.max_angle - 1e-7


@given(random_meshes(), st.integers(0, 2**32 - 1))
def test_no_result_beats_the_limits_of_its_input(made, seed):
    fixed = np.random.default_rng(seed).random(len(made.points)) < 0.2
    mesh = Mesh(made.points, made.cells, fixed=fixed)
    result = smooth(mesh, "optimize", max_sweeps=60, threads=1)
    before, after = limits(mesh), limits(result.mesh)
    assert after.min_angle == pytest.approx(before.min_angle, abs=1e-7)
    assert after.max_angle == pytest.approx(before.max_angle, abs=1e-7)
    assert after.reached_min_angle <= before.min_angle + 1e-7
    assert after.reached_max_angle >= before.max_angle - 1e-7


@pytest.mark.nojit
def test_limits_of_an_annulus():
    # Twelve quads around: at the inner rim two cells share 360° − 150°, outside 150°.
    found = limits(Mesh(*annulus(12, 3)))
    assert found.max_angle == pytest.approx(105.0)
    assert found.min_angle == pytest.approx(75.0)
