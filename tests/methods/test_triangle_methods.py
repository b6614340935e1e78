"""Methods for triangles: what they refuse, quads cut in two, and the study's claim."""

import numpy as np
import pytest

from meshes import grid, random_mesh
from qsmooth import Mesh, Stop, examples, smooth
from qsmooth.methods.driver import SweepingMethod
from qsmooth.registry import methods
from qsmooth.selection import select_cells, vertices_of

SWEEPING = {name: m for name, m in methods().items() if issubclass(m, SweepingMethod)}


@pytest.mark.nojit
def test_by_aspect_ratio_has_nothing_to_do_with_quads_alone():
    message = (
        "method 'aspect-ratio' is for triangles and there is none; "
        "split_quads='shorter' cuts the quads in two"
    )
    with pytest.raises(ValueError, match=f"^{message}$"):
        smooth(grid(3, 3), "aspect-ratio")
    result = smooth(grid(3, 3), "aspect-ratio", split_quads=True)
    assert result.outcome.cut.quads == 9
    with pytest.raises(ValueError, match=r"max_edge_ratio must be 1 or more, got 0\.5"):
        smooth(grid(3, 3), "aspect-ratio", max_edge_ratio=0.5)


@pytest.mark.nojit
@pytest.mark.parametrize("how", [True, "shorter", "first", "second"])
@pytest.mark.parametrize("known", SWEEPING.values(), ids=SWEEPING)
def test_quads_that_are_cut_are_told(known, how):
    mesh = random_mesh("mixed", 5, seed=2, amount=0.8).mesh
    result = smooth(mesh, known(split_quads=how, max_sweeps=3))
    cut = result.outcome.cut
    assert cut.quads == (np.diff(mesh.cell_offsets) == 4).sum()
    assert cut.diagonal == ("shorter" if how is True else how)
    assert f"{cut.quads} quads were smoothed as two triangles each" in result.reason
    assert all(np.array_equal(a, b) for a, b in zip(result.mesh.cells, mesh.cells, strict=True))
    assert smooth(mesh, known(split_quads=False, max_sweeps=3)).outcome.cut is None
    triangles = random_mesh("triangles", 4, seed=2).mesh
    assert smooth(triangles, known(split_quads=how, max_sweeps=1)).outcome.cut is None


@pytest.mark.nojit
def test_a_selection_of_quads_that_are_cut():
    mesh = random_mesh("quads", 8, seed=3, amount=0.9).mesh
    chosen = vertices_of(mesh, select_cells(mesh, "max_angle > 150"))
    result = smooth(mesh, "angle", selection="max_angle > 150", split_quads=True, max_sweeps=4)
    moved = (result.points != mesh.points).any(axis=1)
    assert moved.any()
    assert not moved[~chosen].any()


@pytest.mark.nojit
def test_angle_without_a_guard_is_not_guarded_and_says_so():
    mesh = random_mesh("quads", 6, seed=1, amount=0.9).mesh
    assert not methods()["angle"](guard="none").guards
    result = smooth(mesh, "angle", guard="none", max_sweeps=50, rtol=0.0)
    assert not result.outcome.guarded
    assert result.outcome.stop is Stop.MAX_SWEEPS
    assert result.after.n_invalid > 0
    assert f"angle is unguarded: it made {result.after.n_invalid} cell" in result.reason


@pytest.fixture(scope="module")
def random_triangulations():
    return {n: [examples.random_triangles(n, seed=s) for s in range(20)] for n in (12, 40, 1000)}


@pytest.mark.parametrize("n_faces", [12, 40, 1000])
def test_by_aspect_ratio_wins_two_of_three_over_angle_based(random_triangulations, n_faces):
    meshes = random_triangulations[n_faces]
    ratios = {}
    for method in ("aspect-ratio", "angle"):
        results = [smooth(mesh, method) for mesh in meshes]
        assert not any(r.history["n_invalid"].any() for r in results)
        ratios[method] = np.array([r.after.worst["aspect_ratio"] for r in results])
    ours, theirs = ratios.values()
    assert (ours < theirs).sum() >= 14
    assert np.median(ours) < np.median(theirs)


@pytest.mark.parametrize("kind", ["quads", "mixed", "triangles"])
@pytest.mark.parametrize("known", methods().values(), ids=methods())
def test_fixed_vertices_interfaces_and_orphans_stay_and_others_move(known, kind):
    made = random_mesh(kind, 8, seed=2, amount=0.8)
    points = np.concatenate([made.points, [(0.5, 0.5), (40.0, 3.0)]])
    middle = made.points[:, 0].mean()
    regions = np.concatenate([made.points[b, 0].mean(axis=1) < middle for b in made.cells])
    mesh = Mesh(points, made.cells, regions=regions, fixed=[20, 30])
    assert (mesh.is_interface & ~mesh.is_boundary).any()
    more = [{"split_quads": True}] if "split_quads" in known.specs() else []
    for options in ({}, *more):
        if not known(**options).why_not(mesh):
            kept, freed = (
                smooth(mesh, known(max_sweeps=3, keep_interfaces=keep, **options)).points
                for keep in (True, False)
            )
            rests = mesh.is_fixed | mesh.is_interface
            assert kept[rests].tobytes() == mesh.points[rests].tobytes()
            assert (kept != mesh.points).any()
            assert freed[mesh.is_fixed].tobytes() == mesh.points[mesh.is_fixed].tobytes()
            assert (freed[mesh.is_interface] != mesh.points[mesh.is_interface]).any()
