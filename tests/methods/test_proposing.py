"""Star and quad: which cells propose moves, in which order, and by which step."""

import math
import re

import numpy as np
import pytest

import reference
from meshes import KINDS, grid, random_mesh
from qsmooth import Mesh, quality, smooth
from qsmooth.methods.proposing import ProposingMethod
from qsmooth.outcome import Aim
from qsmooth.registry import methods
from qsmooth.selection import select_cells, vertices_of

PROPOSING = {name: m for name, m in methods().items() if issubclass(m, ProposingMethod)}
every_proposing = pytest.mark.parametrize("known", PROPOSING.values(), ids=PROPOSING)


@pytest.fixture
def mesh():
    return random_mesh("quads", 8, seed=3, amount=0.9).mesh


# ------------------------------------------------------------------------------- options


@pytest.mark.nojit
@every_proposing
@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"rtol": -1e-9}, "rtol must be in [0, 1), got -1e-09"),
        ({"rtol": math.nan}, "rtol must be in [0, 1), got nan"),
        ({"guard": "none"}, "guard must be 'quality' or 'clearance', got 'none'"),
        ({"guard": None}, "guard must be 'quality' or 'clearance', got None"),
        ({"min_angle": 0.0}, "min_angle must be in (0, 180) degrees, got 0.0"),
        ({"min_angle": 120.0}, "max_angle must be over min_angle, which is 120 degrees, got 120"),
        ({"max_angle": 60.0}, "max_angle must be over min_angle, which is 60 degrees, got 60"),
        ({"max_angle": 180.0}, "max_angle must be in (0, 180) degrees, got 180.0"),
        ({"triangle_min_angle": 90.0},
         "triangle_max_angle must be over triangle_min_angle, which is 90 degrees, got 90"),
        ({"triangle_max_angle": 200.0}, "triangle_max_angle must be in (0, 180) degrees"),
        ({"step": 2}, "step must be in (0, 1], got 2"),
        ({"worst_fraction": 0.0}, "worst_fraction must be in (0, 1], got 0.0"),
        ({"worst_first": True}, "worst_first needs a worst_fraction below 1"),
        ({"bad_step": 0.0}, "bad_step must be in (0, 2], got 0.0"),
        ({"bad_step": 2.5}, "bad_step must be in (0, 2], got 2.5"),
        ({"bad_angle": 360.0}, "bad_angle must be in (0, 360) degrees, got 360.0"),
        ({"split_quads": "longer"},
         "split_quads must be False, True, 'shorter', 'first' or 'second', got 'longer'"),
    ],
)  # fmt: skip
def test_an_option_out_of_range_is_named_with_its_range_and_value(known, options, message):
    with pytest.raises(ValueError, match=f"^{re.escape(message)}"):
        known(**options)


@pytest.mark.nojit
@every_proposing
@pytest.mark.parametrize(
    "options",
    [
        {"rtol": 0},
        {"rtol": np.float32(0.5)},
        {"step": 1},
        {"worst_fraction": 1e-9},
        {"min_angle": 1e-9, "max_angle": 179.999},
        {"min_angle": np.float64(89), "max_angle": 90},
        {"bad_step": 2, "bad_angle": 1},
    ],
    ids=str,
)
def test_options_at_the_ends_of_their_ranges(mesh, known, options):
    assert smooth(mesh, known(**options)).after.n_invalid == 0


# ------------------------------------------------------------------------------- the worst group


@pytest.mark.nojit
@every_proposing
@pytest.mark.parametrize("fraction", [0.01, 0.2, 0.6])
def test_only_the_worst_cells_make_proposals(known, fraction):
    mesh = random_mesh("quads", 6, seed=7, amount=0.9).mesh
    result = smooth(mesh, known(worst_fraction=fraction, max_sweeps=1))
    points, cells = reference.as_complex(mesh.xy), reference.as_lists(mesh)
    worst = reference.worst_cells(points, cells, fraction)
    assert len(worst) == math.ceil(fraction * mesh.n_cells)
    touched = {v for c in worst for v in cells[c]}
    moved = np.flatnonzero((result.points != mesh.points).any(axis=1))
    assert len(moved)
    assert set(moved.tolist()) <= touched
    assert [stage.aim for stage in result.outcome.stages] == [Aim.WORST_GROUP]


def groups(points, cells, fraction):
    worst = reference.worst_cells(points, cells, fraction)
    return {"worst": worst, "rest": set(range(len(cells))) - worst, "all": None}


@pytest.mark.parametrize("method", ["star", "quad"])
@pytest.mark.parametrize("kind", ["quads", "triangles", "mixed"])
def test_the_worst_group_goes_first_then_the_rest_then_all(kind, method):
    mesh = random_mesh(kind, 6, seed=4, amount=0.9).mesh
    points, cells = reference.as_complex(mesh.xy), reference.as_lists(mesh)
    order = mesh.topology.schedule(True).vertices.tolist()
    good = max(0.5, min(reference.scaled_jacobian(points, cell) for cell in cells))
    sweep = reference.star_sweep if method == "star" else reference.quad_sweep
    for group in ("worst", "rest", "all", "all"):
        active = groups(points, cells, 0.25)[group]
        points = sweep(points, cells, order, reference.Options(good=good, active=active, step=0.25))
    result = smooth(mesh, method, worst_fraction=0.25, worst_first=True, max_sweeps=4, rtol=0.0)
    assert [(stage.aim, stage.sweeps) for stage in result.outcome.stages] == [
        (Aim.WORST_GROUP, 1),
        (Aim.REST, 1),
        (Aim.ALL_CELLS, 2),
    ]
    expected = [(z.real, z.imag) for z in points]
    np.testing.assert_allclose(result.mesh.xy, expected, rtol=0, atol=1e-10)


@every_proposing
def test_each_group_ends_when_it_rests(mesh, known):
    result = smooth(mesh, known(worst_fraction=0.1, worst_first=True, max_sweeps=3000))
    assert result.converged
    assert all(stage.sweeps < 1000 for stage in result.outcome.stages)


@pytest.mark.parametrize("rings", [0, 1])
def test_the_worst_group_of_a_selection_is_among_the_selected(mesh, rings):
    marked = select_cells(mesh, "max_angle > 140", rings)
    chosen = set(np.flatnonzero(marked).tolist())
    points, cells = reference.as_complex(mesh.xy), reference.as_lists(mesh)
    ranked = sorted(chosen, key=lambda c: -max(reference.angles(points, cells[c])))
    active = set(ranked[: math.ceil(0.3 * len(ranked))])
    order = mesh.topology.schedule(True, vertices_of(mesh, marked)).vertices.tolist()
    options = reference.Options(good=0.5, active=active, step=0.25)
    expected = [(z.real, z.imag) for z in reference.star_sweep(points, cells, order, options)]
    result = smooth(
        mesh, "star", selection="max_angle > 140", selection_rings=rings, worst_fraction=0.3,
        max_sweeps=1,
    )  # fmt: skip
    np.testing.assert_allclose(result.mesh.xy, expected, rtol=0, atol=1e-12)


# ------------------------------------------------------------------------------- larger steps


@pytest.mark.nojit
@every_proposing
def test_bad_cells_move_by_their_own_step(known):
    # Two squares by two with the centre off: every cell is past 1° and none past 359°.
    points, cells = grid(2, 2)
    points[4] = (1.0, 1.25)
    mesh = Mesh(points, cells)
    at = {
        angle: smooth(mesh, known(step=0.25, bad_step=0.75, bad_angle=angle, max_sweeps=1)).points[
            4
        ]
        for angle in (1.0, 359.0)
    }
    for angle, step in ((1.0, 0.75), (359.0, 0.25)):
        plain = smooth(mesh, known(step=step, max_sweeps=1)).points[4]
        assert at[angle] == pytest.approx(plain, abs=1e-14)
    assert at[1.0] != pytest.approx(at[359.0])


@every_proposing
@pytest.mark.parametrize("kind", sorted(KINDS))
def test_larger_steps_keep_the_worst_cell(kind, known):
    mesh = random_mesh(kind, 6, seed=9, amount=1.0).mesh
    result = smooth(mesh, known(bad_angle=110.0, bad_step=2.0, rtol=0.0, max_sweeps=15))
    assert not result.history["n_invalid"].any()
    assert result.after.worst["scaled_jacobian"] >= result.before.worst["scaled_jacobian"]


# ------------------------------------------------------------------------------- the paper's claims


@pytest.mark.filterwarnings("ignore::qsmooth.MeshWarning")
@pytest.mark.parametrize("file", ["spiral_2k.off", "superior_24k.off"])
def test_fifty_sweeps_make_no_figure_worse_and_quad_the_smaller_largest_angle(shared_meshes, file):
    from qsmooth import read_mesh

    mesh = read_mesh(shared_meshes / file)
    assert quality(mesh).n_invalid == 0
    results = {m: smooth(mesh, m, max_sweeps=50, rtol=0.0) for m in ("star", "quad")}
    for result in results.values():
        assert result.sweeps == 50
        assert not result.history["n_invalid"].any()
        for before, after in (
            (result.before.worst, result.after.worst),
            (result.before.mean, result.after.mean),
        ):
            assert after["max_angle"] <= before["max_angle"]
            assert after["min_angle"] >= before["min_angle"]
            assert after["aspect_ratio"] <= before["aspect_ratio"]
    largest = {m: r.after.worst["max_angle"] for m, r in results.items()}
    assert largest["quad"] <= largest["star"]
