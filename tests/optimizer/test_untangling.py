"""Untangling: what becomes valid, what cannot, and what is said of it."""

import importlib.util
import sys

import numpy as np
import pytest

from meshes import grid, random_mesh
from promises import check, invalid_cells
from qsmooth import Mesh, Optimize, Stop, Untangle, quality, read_mesh, smooth, untangle
from qsmooth.examples import random_interior, tangled
from qsmooth.outcome import Invalid


@pytest.mark.nojit
def test_a_vertex_outside_its_star_comes_back():
    points, cells = grid(2, 2)
    points[4] = 2.7, 0.1
    result = untangle((points, cells), threads=1)
    assert (result.before.n_invalid, result.after.n_invalid) == (2, 0)
    assert result.converged
    assert result.outcome.stop is Stop.VALID
    assert result.outcome.invalid == Invalid(before=2, after=0)
    assert result.reason.startswith("untangled 2 cells in ")
    assert result.method == "untangle"


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("kind", ["quad", "triangle", "mixed"])
def test_random_interiors_and_tangled_squares_become_valid(kind, seed):
    for mesh in (
        random_interior(40, 40, seed=seed, kind=kind),
        tangled(30, 30, amount=1.5, seed=seed, kind=kind),
    ):
        result = untangle(mesh)
        assert result.before.n_invalid > 0.3 * mesh.n_cells
        assert result.after.n_invalid == 0
        assert result.converged
        assert not invalid_cells(result.mesh).any()


@pytest.fixture(scope="session")
def hard_cases(shared):
    """The makers of the hard cases, which need numpy and scipy."""
    folder = shared / "peers"
    if not (folder / "meshes.py").is_file():
        pytest.skip("the hard cases are not here")
    own = sys.modules.pop("meshes", None)
    sys.path.insert(0, str(folder))
    try:
        spec = importlib.util.spec_from_file_location("hard_cases", folder / "meshes.py")
        module = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(module)
    finally:
        sys.path.remove(str(folder))
        if own is not None:
            sys.modules["meshes"] = own
    return module


@pytest.mark.parametrize("case", ["tangled-2k", "tangledx-2k", "notcht-2k", "fold-2k"])
def test_the_hard_cases_become_valid(hard_cases, case):
    points, cells = hard_cases.make(case)
    result = untangle((points, cells))
    assert result.before.n_invalid > 0
    assert result.after.n_invalid == 0
    better = smooth((points, cells), "optimize")
    assert better.after.n_invalid == 0
    assert better.after.worst["scaled_jacobian"] > result.after.worst["scaled_jacobian"]


TANGLED_FILES = [
    "mesquite_tangled_quad.vtk",
    "mesquite_hole_tanglap.vtk",
    "mesquite_inverted_hole.vtk",
    "mesquite_shest_grid32.vtk",
    "mesquite_tri58_tangled.vtk",
]


@pytest.mark.filterwarnings("ignore::qsmooth.MeshWarning")
@pytest.mark.parametrize("file", TANGLED_FILES)
def test_tangled_files_become_valid(shared_meshes, file):
    mesh = read_mesh(shared_meshes / file)
    for method in (Untangle(), Optimize()):
        result = check(mesh, method).result
        assert result.before.n_invalid > 0
        assert result.after.n_invalid == 0
        assert not invalid_cells(result.mesh).any()
        rests = mesh.is_fixed
        assert result.points[rests].tobytes() == mesh.points[rests].tobytes()


@pytest.mark.filterwarnings("ignore::qsmooth.MeshWarning")
@pytest.mark.parametrize("known", [Untangle, Optimize])
def test_a_collapsed_cell_of_fixed_vertices_is_named(shared_meshes, known):
    mesh = read_mesh(shared_meshes / "hughes_6k.obj")
    result = check(mesh, known()).result
    assert result.outcome.invalid == Invalid(
        before=1, after=1, first=4902, proven=1, first_proven=4902
    )
    assert "1 of 1 invalid cell stays invalid, the first is cell 4902" in result.reason
    assert "for 1 of them nothing can help" in result.reason
    # With nothing to untangle the one is stuck where it was; the other makes the rest better.
    assert result.outcome.unchanged == (known is Untangle)
    assert (result.outcome.stop is Stop.STUCK) == (known is Untangle)


@pytest.mark.nojit
@pytest.mark.parametrize("known", [Untangle, Optimize])
def test_an_inverted_quad_of_fixed_vertices_is_proven_hopeless(known):
    # A grid whose boundary folds a cell at the lower left over: 0 lies within cell (1, 1).
    points, cells = grid(3, 3)
    points[0] = 0.9, 0.9
    fixed = np.zeros(16, np.bool_)
    fixed[5] = True
    mesh = Mesh(points, cells, fixed=fixed)
    before = quality(mesh)
    result = check(mesh, known(max_sweeps=50)).result
    assert before.n_invalid == 1
    assert result.outcome.invalid == Invalid(before=1, after=1, first=0, proven=1, first_proven=0)


@pytest.mark.nojit
def test_a_reflex_corner_within_one_cell_is_proven_hopeless_and_the_rest_is_untangled():
    # The domain's corner at 0 goes in so far that its only cell has over 180 degrees there.
    points, cells = grid(3, 3)
    points[0] = 0.6, 0.6
    points[10] = 0.2, 2.8
    mesh = Mesh(points, cells)
    assert quality(mesh).n_invalid > 1
    result = untangle(mesh, threads=1, max_sweeps=600)
    assert result.outcome.stop is Stop.STUCK
    assert not result.converged
    assert result.outcome.invalid == Invalid(
        before=result.before.n_invalid, after=1, first=0, proven=1, first_proven=0
    )
    assert "no way was found" not in result.reason


@pytest.mark.nojit
def test_what_is_not_proven_is_not_called_so():
    # One free vertex and no place for it: each of its cells asks for a side of the square.
    points = [(0.0, 0.0), (1.0, 0.0), (0.45, 0.5), (1.0, 1.0), (0.0, 1.0), (0.55, 0.5), (0.5, 0.5)]
    mesh = Mesh(points, [(6, 0, 1), (6, 1, 2), (6, 2, 3), (6, 3, 4), (6, 4, 5), (6, 5, 0)])
    result = untangle(mesh, threads=1, max_sweeps=30)
    assert 0 < result.after.n_invalid <= result.before.n_invalid
    assert (result.outcome.invalid.proven, result.outcome.invalid.first_proven) == (0, -1)
    assert "no way was found, which does not prove that there is none" in result.reason
    assert "nothing can help" not in result.reason


@pytest.mark.nojit
def test_untangling_a_valid_mesh_changes_nothing():
    mesh = random_mesh("mixed", 4, seed=1, amount=0.9).mesh
    result = untangle(mesh, threads=1)
    assert result.points.tobytes() == mesh.points.tobytes()
    assert (result.sweeps, result.converged, result.history) == (0, True, ())
    assert result.outcome.stop is Stop.VALID
    assert result.outcome.unchanged
    assert result.outcome.invalid is None
    assert result.reason == "the mesh is valid: there was nothing to untangle"


@pytest.mark.nojit
def test_untangling_stops_where_it_is_told_and_never_with_more_invalid_cells():
    mesh = random_interior(6, 6, seed=1)
    none = untangle(mesh, max_sweeps=0, threads=1)
    assert np.array_equal(none.points, mesh.points)
    assert none.outcome.stop is Stop.MAX_SWEEPS
    one = untangle(mesh, max_sweeps=1, threads=1)
    assert one.sweeps <= 1
    assert one.after.n_invalid <= one.before.n_invalid
    short = untangle(mesh, time_limit=1e-9, threads=1)
    assert short.outcome.stop is Stop.TIME_LIMIT


@pytest.mark.parametrize("seed", range(4))
def test_two_threads_untangle_to_the_bits_of_one(seed):
    mesh = tangled(20, 20, amount=2.0, seed=seed, kind="mixed")
    one, two = (untangle(mesh, threads=threads, max_sweeps=12) for threads in (1, 2))
    assert one.before.n_invalid > one.after.n_invalid
    assert one.points.tobytes() == two.points.tobytes()


@pytest.mark.nojit
def test_what_is_fixed_and_not_valid_is_proven_and_has_not_converged():
    # A dart of four fixed vertices: its inner corner is over 180 degrees for good.
    result = untangle(Mesh([(0, 0), (2, 0), (0.5, 0.5), (0, 2)], [(0, 1, 2, 3)]))
    assert result.outcome.stop is Stop.STUCK
    assert not result.converged
    assert (result.outcome.invalid.proven, result.outcome.invalid.first_proven) == (1, 0)
