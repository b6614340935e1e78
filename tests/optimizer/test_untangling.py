"""Untangling: what becomes valid, what cannot, and what is said of it."""

import importlib.util
import sys

import numpy as np
import pytest

from meshes import KINDS, grid, random_mesh
from promises import check, invalid_cells
from qsmooth import Mesh, Optimize, Stop, Untangle, quality, read_mesh, smooth, untangle
from qsmooth.examples import boundary_layer, random_interior, structured, tangled
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


# ------------------------------------------------------------------------------- locally


def exchange(mesh, seed):
    """Exchange two neighbouring vertices that may move, drawn at random; give these, too."""
    rng = np.random.default_rng(seed)
    v = int(rng.choice(np.flatnonzero(~mesh.is_fixed)))
    ring = mesh.ring_vertices[mesh.ring_offsets[v] : mesh.ring_offsets[v + 1]]
    w = int(rng.choice(ring[~mesh.is_fixed[ring]]))
    points = mesh.points.copy()
    points[[v, w]] = points[[w, v]]
    return mesh.with_points(points), [v, w]


def rings_from(mesh, vertices):
    """Edges from each vertex to the nearest of these."""
    rings = np.full(mesh.n_vertices, -1)
    rings[vertices] = 0
    front = list(vertices)
    while front:
        near = [
            w
            for v in front
            for w in mesh.ring_vertices[mesh.ring_offsets[v] : mesh.ring_offsets[v + 1]].tolist()
        ]
        after = [w for w in dict.fromkeys(near) if rings[w] < 0]
        rings[after] = rings[front[0]] + 1
        front = after
    return rings


def comes_back_near_by(mesh, seed):
    bad, exchanged = exchange(mesh, seed)
    result = untangle(bad)
    assert result.before.n_invalid > 0
    assert result.outcome.stop is Stop.VALID
    moved = (result.points != bad.points).any(axis=1)
    assert moved.any()
    assert rings_from(mesh, exchanged)[moved].max() <= 5
    # Heights of layers stay what they are, more or less.
    ratio = quality(result.mesh).area / quality(mesh).area
    assert 0.01 < ratio.min() <= ratio.max() < 10.0


@pytest.mark.parametrize("seed", range(10))
@pytest.mark.parametrize("kind", ["quad", "triangle", "mixed"])
def test_two_exchanged_neighbours_move_none_but_their_neighbourhood(kind, seed):
    comes_back_near_by(boundary_layer(kind=kind), seed)


@pytest.mark.parametrize("seed", range(10))
def test_two_exchanged_neighbours_in_the_mesh_of_an_airfoil(shared_meshes, seed):
    comes_back_near_by(read_mesh(shared_meshes / "naca0012_113x33.su2"), seed)


def test_tangles_far_apart_do_not_touch_each_other():
    # One is untangled in the same bits whether or not there is another, which can't be mended.
    mesh = structured(40, 40)
    at = mesh.points.reshape(41, 41, 2).copy()
    at[5:9, 5:9] = at[5:9, 5:9][::-1, ::-1]
    alone = untangle(mesh.with_points(at.reshape(-1, 2)))
    at[34:38, 34:38] = at[34:38, 34:38][::-1]
    fixed = np.zeros((41, 41), np.bool_)
    fixed[35, 36] = True
    both = untangle(Mesh(at.reshape(-1, 2), mesh.cells, fixed=fixed.ravel()), max_sweeps=60)
    assert alone.outcome.stop is Stop.VALID
    lower = slice(0, 20 * 41)
    assert np.array_equal(both.points[lower], alone.points[lower])
    moved = (alone.points != mesh.points).any(axis=1)
    assert 16 < moved.sum() < 200


def test_a_fold_that_local_sweeps_do_not_mend_moves_more_and_more():
    # A block of rows and columns turned over: its neighbourhood has to give way.
    mesh = structured(40, 40)
    at = mesh.points.reshape(41, 41, 2).copy()
    at[12:29, 12:29] = at[12:29, 12:29][::-1]
    result = untangle(mesh.with_points(at.reshape(-1, 2)))
    assert result.before.n_invalid >= 256
    assert result.outcome.stop is Stop.VALID


def test_untangling_moves_only_what_is_selected():
    mesh = tangled(20, 20, amount=1.5, seed=3)
    selection = "scaled_jacobian <= 0"
    found = check(mesh, Untangle(selection=selection, selection_rings=1))
    assert found.result.after.n_invalid < found.result.before.n_invalid
    swapped, (v, _) = exchange(structured(12, 12), 4)
    only = [int(swapped.star_cells[swapped.star_offsets[v]])]
    less = check(swapped, Untangle(selection=only)).result
    free = np.zeros(swapped.n_vertices, np.bool_)
    free[swapped.cell_vertices[swapped.cell_offsets[only[0]] :][:4]] = True
    assert np.array_equal(less.points[~free], swapped.points[~free])
    every = check(swapped, Untangle(selection=only, selection_rings=2)).result
    assert every.outcome.stop is Stop.VALID


def collapsed(seed):
    """A mesh some of whose vertices, on the boundary too, are elsewhere: at another's place."""
    rng = np.random.default_rng(seed)
    mesh = random_mesh(sorted(KINDS)[seed % len(KINDS)], 5, seed=seed, amount=0.6).mesh
    points = mesh.points.copy()
    for v in rng.permutation(mesh.n_vertices)[:4]:
        points[v] = points[rng.integers(mesh.n_vertices)]
    return mesh.with_points(points)


@pytest.mark.parametrize("seed", range(36))
def test_never_more_invalid_cells_than_other_methods_leave(seed):
    mesh = collapsed(seed)
    result = check(mesh, Untangle()).result
    for other in ("star", "quad"):
        assert result.after.n_invalid <= smooth(mesh, other).after.n_invalid


@pytest.mark.parametrize("seed", [3, 12, 21])
def test_what_is_mended_one_vertex_at_a_time_has_the_same_bits_on_two_threads(seed):
    mesh = collapsed(seed)
    one, two = (untangle(mesh, threads=threads) for threads in (1, 2))
    assert one.before.n_invalid > one.after.n_invalid
    assert one.points.tobytes() == two.points.tobytes()


# ------------------------------------------------------------------------------- the impossible


def with_doublet(x, y, n=3):
    """Squares of which the middle one is cut in two by a vertex that only its halves share."""
    points, (quads,) = grid(n, n)
    a, b, c, d = quads[len(quads) // 2]
    v = len(points)
    cells = [*np.delete(quads, len(quads) // 2, axis=0), (a, b, c, v), (a, v, c, d)]
    return Mesh([*points, (x, y)], [np.array(cells)])


@pytest.mark.nojit
@pytest.mark.parametrize("place", [(1.3, 1.7), (1.9, 1.9), (1.45, 1.55)])
def test_a_doublet_costs_no_search_and_gets_as_good_as_it_can(place):
    mesh = with_doublet(*place)
    result = check(mesh, Untangle()).result
    assert result.after.n_invalid == 1
    assert result.sweeps <= 1
    assert 180.0 < result.after.worst["max_angle"] < 180.001
    invalid = result.outcome.invalid
    assert (invalid.after, invalid.proven, invalid.proven_doublets) == (1, 1, 1)
    assert invalid.first == invalid.first_proven
    assert "as an interior vertex has no other cell than two" in result.reason
    assert "no way was found" not in result.reason


def test_around_a_doublet_the_rest_is_untangled():
    mesh = with_doublet(3.3, 3.7, 7)
    points = mesh.points.copy()
    points[[27, 28]] = points[[28, 27]]
    for method in (Untangle(), Optimize()):
        result = check(mesh.with_points(points), method).result
        assert result.before.n_invalid > 2
        assert result.outcome.invalid.after == result.outcome.invalid.proven == 1
        assert result.after.worst["max_angle"] < 180.001


def test_hopeless_cells_cost_no_sweeps_and_stop_no_others():
    # Two boundary vertices at one place: their cell is lost, and must not count as a tangle.
    mesh = structured(12, 12)
    points = mesh.points.copy()
    points[3] = points[4]
    points[[84, 85]] = points[[85, 84]]
    result = check(mesh.with_points(points), Untangle()).result
    invalid = result.outcome.invalid
    assert (invalid.after, invalid.proven, invalid.first_proven) == (1, 1, 3)
    assert result.sweeps < 30
    assert "as what is fixed keeps a corner from being convex" in result.reason


@pytest.mark.nojit
@pytest.mark.parametrize("known", [Untangle, Optimize])
def test_where_nothing_moves_what_is_invalid_is_proven_too(known):
    points, cells = grid(1, 1)
    points[0] = 0.8, 0.8
    result = check(Mesh(points, cells), known()).result
    assert result.outcome.invalid == Invalid(before=1, after=1, first=0, proven=1, first_proven=0)


@pytest.mark.nojit
def test_what_is_fixed_and_not_valid_is_proven_and_has_not_converged():
    # A dart of four fixed vertices: its inner corner is over 180 degrees for good.
    result = untangle(Mesh([(0, 0), (2, 0), (0.5, 0.5), (0, 2)], [(0, 1, 2, 3)]))
    assert result.outcome.stop is Stop.STUCK
    assert not result.converged
    assert (result.outcome.invalid.proven, result.outcome.invalid.first_proven) == (1, 0)
