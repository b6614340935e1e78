"""What holds for any mesh, whatever the options."""

import math

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

import reference
from meshes import place, random_mesh, random_meshes, renumber, turn_cells
from qsmooth import Mesh, quality, smooth

GUARDED = ["star", "quad", "smart-laplacian"]
METHODS = [*GUARDED, "laplacian"]


@st.composite
def any_options(draw):
    """A guarded method, with any of its options anywhere in their ranges."""
    method = draw(st.sampled_from(GUARDED))
    options = {
        "max_sweeps": draw(st.integers(1, 8)),
        "rtol": draw(st.sampled_from([0.0, 1e-3])),
        "guard": draw(st.sampled_from(["quality", "clearance"])),
    }
    if method != "smart-laplacian":
        angles = st.floats(0.0, 180.0, exclude_min=True, exclude_max=True)
        for prefix in ("", "triangle_"):
            low, high = sorted((draw(angles), draw(angles)))
            if low < high and draw(st.booleans()):
                options |= {f"{prefix}min_angle": low, f"{prefix}max_angle": high}
        options["step"] = draw(st.sampled_from([1e-9, 0.1, 0.25, 0.5, 0.75, 1.0]))
        options["worst_fraction"] = draw(st.sampled_from([1.0, 1.0, 0.5, 0.01]))
    return method, options


def is_valid(mesh):
    """In exact arithmetic, and not by the package."""
    points = reference.as_complex(mesh.xy)
    return not any(reference.validity(points, cell) for cell in reference.as_lists(mesh))


@given(random_meshes(), any_options())
@settings(max_examples=150)
def test_valid_stays_valid_and_the_worst_cell_never_gets_worse(made, chosen):
    method, options = chosen
    mesh = made.mesh
    assert quality(mesh).n_invalid == 0
    result = smooth(mesh, method, threads=1, **options)
    assert all(record.n_invalid == 0 for record in result.history)
    assert is_valid(result.mesh)
    assert np.array_equal(result.points[mesh.is_fixed], mesh.points[mesh.is_fixed])
    if options["guard"] == "quality":
        before, after = (s.worst["scaled_jacobian"] for s in (result.before, result.after))
        assert after >= before


@given(random_meshes(), any_options())
def test_two_threads_give_the_bits_of_one(made, chosen):
    method, options = chosen
    one = smooth(made.mesh, method, threads=1, **options)
    two = smooth(made.mesh, method, threads=2, **options)
    assert one.points.tobytes() == two.points.tobytes()
    assert one.history == two.history


@given(random_meshes(), any_options())
def test_the_same_input_gives_the_same_bits(made, chosen):
    method, options = chosen
    once, again = (smooth(made.mesh, method, **options).points.tobytes() for _ in range(2))
    assert once == again


def at_the_edge(seed):
    """A valid mesh some of whose corners are convex by the last bits only, near 6e6."""
    rng = np.random.default_rng(seed)
    made = random_mesh("mixed", 4, seed=seed, amount=0.5, shift=(6e6, 6e6))
    points = made.points.copy()
    mesh = made.mesh
    cells = reference.as_lists(mesh)
    for v in rng.permutation(np.flatnonzero(~mesh.is_boundary))[:4]:
        # Go towards a neighbour's far side until one more bisection would break a corner.
        target = points[rng.integers(len(points))]
        low, high = 0.0, 1.0
        exact = reference.as_complex(points)
        for _ in range(60):
            share = 0.5 * (low + high)
            place = points[v] + share * (target - points[v])
            exact[v] = complex(*place)
            good = all(s > 0 for c in cells if v in c for s in reference.corner_signs(exact, c))
            low, high = (share, high) if good else (low, share)
        points[v] = points[v] + low * (target - points[v])
    return mesh.with_points(points)


@pytest.mark.parametrize("seed", range(8))
@pytest.mark.parametrize("guard", ["quality", "clearance"])
@pytest.mark.parametrize("method", GUARDED)
def test_a_mesh_valid_by_a_hair_stays_valid(method, guard, seed):
    mesh = at_the_edge(seed)
    assert is_valid(mesh)
    for step in {"smart-laplacian": [{}]}.get(method, [{"step": 0.5}, {"step": 1.0}]):
        for sweeps in (1, 3):
            result = smooth(mesh, method, guard=guard, max_sweeps=sweeps, rtol=0.0, **step)
            assert is_valid(result.mesh)


# ------------------------------------------------------------------------------- symmetries

ROUGH = st.sampled_from(["quads", "triangles", "mixed", "annulus", "L", "mixed fan"])


@given(
    ROUGH,
    st.integers(0, 2**32 - 1),
    st.sampled_from(METHODS),
    st.floats(0.0, 6.0),
    st.sampled_from([1e-12, 1.0, 3e7]),
    st.tuples(st.floats(-5.0, 5.0), st.floats(-5.0, 5.0)),
    st.booleans(),
)
def test_result_turns_scales_shifts_and_mirrors_with_the_input(
    kind, seed, method, turn, scale, shift, mirror
):
    # At random a mesh has no ties, which rounding would decide.
    made = random_mesh(kind, 5, seed=seed, amount=0.8)
    shift = (shift[0] * scale, shift[1] * scale)
    moved = place(made.points, scale=scale, turn=turn, shift=shift, mirror=mirror)
    result = smooth(made.mesh, method, max_sweeps=4, rtol=0.0)
    other = smooth((moved, made.cells), method, max_sweeps=4, rtol=0.0)
    expected = place(result.points, scale=scale, turn=turn, shift=shift, mirror=mirror)
    np.testing.assert_allclose(other.points, expected, rtol=0.0, atol=1e-9 * scale)
    assert other.after.worst == pytest.approx(result.after.worst, rel=1e-6)


@given(random_meshes(), st.sampled_from(METHODS), st.integers(-40, 40))
def test_scaling_by_a_power_of_two_scales_the_bits(made, method, power):
    factor = 2.0**power
    result = smooth(made.mesh, method, max_sweeps=4, rtol=0.0)
    other = smooth((made.points * factor, made.cells), method, max_sweeps=4, rtol=0.0)
    assert np.array_equal(other.points, result.points * factor)


@given(random_meshes(), st.sampled_from(METHODS), st.integers(0, 2**32 - 1))
def test_the_callers_orientation_and_first_corners_do_not_matter(made, method, seed):
    cells = turn_cells(made.cells, np.random.default_rng(seed))
    result = smooth(made.mesh, method, max_sweeps=1, rtol=0.0)
    other = smooth((made.points, cells), method, max_sweeps=1, rtol=0.0)
    # Where all cells were turned round at once the corners are gone through the other way.
    assert other.after.n_invalid == result.after.n_invalid
    assume(made.amount > 0.0 and "fan" not in made.kind)
    size = np.ptp(made.points, axis=0).max()
    slack = 64 * np.spacing(np.abs(made.points).max())
    np.testing.assert_allclose(other.points, result.points, rtol=0.0, atol=1e-9 * size + slack)


@given(ROUGH, st.integers(0, 2**32 - 1), st.sampled_from(GUARDED))
@settings(max_examples=60)
def test_renumbering_keeps_validity_and_the_quality_reached(kind, seed, method):
    # The order of the updates is another, so the bits are not the same.
    made = random_mesh(kind, 7, seed=seed, amount=0.8)
    points, cells, new_of = renumber(made.points, made.cells, np.random.default_rng(seed))
    result = smooth(made.mesh, method, max_sweeps=60, rtol=0.0)
    other = smooth((points, cells), method, max_sweeps=60, rtol=0.0)
    assert other.after.n_invalid == 0
    fixed = made.mesh.is_fixed
    assert np.array_equal(other.points[new_of][fixed], result.points[fixed])
    assert other.after.worst["scaled_jacobian"] >= other.before.worst["scaled_jacobian"]
    assert other.after.mean["shape"] == pytest.approx(result.after.mean["shape"], abs=0.02)
    assert other.after.mean["max_angle"] == pytest.approx(result.after.mean["max_angle"], abs=5.0)
    for name in ("min_angle", "max_angle"):
        gained = abs(result.after.worst[name] - result.before.worst[name])
        slack = 6.0 + 0.35 * gained
        assert abs(other.after.worst[name] - result.after.worst[name]) <= slack


def test_plain_laplacian_does_not_depend_on_the_numbering():
    made = random_mesh("mixed", 7, seed=5, amount=0.8)
    points, cells, new_of = renumber(made.points, made.cells, np.random.default_rng(1))
    result = smooth(made.mesh, "laplacian", max_sweeps=20, rtol=0.0)
    other = smooth((points, cells), "laplacian", max_sweeps=20, rtol=0.0)
    np.testing.assert_allclose(other.points[new_of], result.points, atol=1e-12)


@given(random_meshes(sizes=st.integers(2, 5)), st.sampled_from(METHODS))
@settings(max_examples=25)
def test_flat_and_in_space_end_alike(made, method):
    assume(made.shift == (0.0, 0.0) and made.amount > 0.0)
    angle = 0.7
    lift = np.column_stack(
        [
            math.cos(angle) * made.points[:, 0],
            made.points[:, 1],
            math.sin(angle) * made.points[:, 0],
        ]
    )
    result = smooth((lift, made.cells), method, max_sweeps=6, rtol=0.0)
    flat = smooth(made.mesh, method, max_sweeps=6, rtol=0.0)
    if method != "laplacian":
        assert result.after.n_invalid == 0
        before, after = (s.worst["scaled_jacobian"] for s in (result.before, result.after))
        assert after >= before - 1e-12
    assert result.after.mean["shape"] == pytest.approx(flat.after.mean["shape"], abs=1e-3)
    rests = made.mesh.is_fixed
    assert np.array_equal(result.points[rests], lift[rests])


@given(random_meshes(), st.integers(0, 2**32 - 1))
@settings(max_examples=25)
def test_fixed_vertices_stay_to_the_bit(made, seed):
    fixed = np.random.default_rng(seed).random(len(made.points)) < 0.3
    mesh = Mesh(made.points, made.cells, fixed=fixed)
    for method in METHODS:
        result = smooth(mesh, method, max_sweeps=3, rtol=0.0)
        assert np.array_equal(result.points[fixed], made.points[fixed])
