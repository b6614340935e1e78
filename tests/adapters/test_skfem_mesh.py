"""Meshes of scikit-fem."""

import numpy as np
import pytest

pytest.importorskip("skfem")
import skfem

from object_samples import POINTS, QUADS, all_ways_in, smoothed
from qsmooth import MeshError, as_mesh, smooth

TRIANGLES = np.concatenate([QUADS[:, [0, 1, 2]], QUADS[:, [0, 2, 3]]])
KINDS = {"quads": (skfem.MeshQuad, QUADS), "triangles": (skfem.MeshTri, TRIANGLES)}


def groups(named):
    return None if named is None else {name: ids.tolist() for name, ids in named.items()}


def same_but_for_points(new, old):
    return (
        type(new) is type(old)
        and np.array_equal(new.t, old.t)
        and groups(new.boundaries) == groups(old.boundaries)
        and groups(new.subdomains) == groups(old.subdomains)
    )


@pytest.fixture(params=KINDS)
def given(request):
    kind, cells = KINDS[request.param]
    mesh = kind(POINTS.T.copy(), cells.T.copy()).with_boundaries(
        {"inlet": lambda x: x[0] == 0.0, "bottom": lambda x: x[1] == 0.0}
    )
    mesh = mesh.with_boundaries({"loop": mesh.facets_around(np.array([0]))})
    return mesh.with_subdomains({"east": lambda x: x[0] > 2.0, "all": lambda x: x[0] > -1.0})


def test_it_comes_back_with_boundaries_and_subdomains(given):
    before = given.p.copy()
    new, points = smoothed(given)
    assert same_but_for_points(new, given)
    assert np.array_equal(new.p.T, points)
    assert np.array_equal(given.p, before)
    assert not np.shares_memory(new.boundaries["inlet"], given.boundaries["inlet"])
    assert type(new.boundaries["loop"]) is type(given.boundaries["loop"]) is not np.ndarray
    assert new.boundaries["loop"].ori.tolist() == given.boundaries["loop"].ori.tolist()
    all_ways_in(given, same_but_for_points)


def test_subdomains_keep_their_shape(given):
    mesh = as_mesh(given)
    inside = np.isin(np.arange(given.nelements), given.subdomains["east"])
    assert len(np.unique(mesh.regions)) == 2
    assert len(np.unique(mesh.regions[inside])) == 1
    between = np.flatnonzero(mesh.is_interface & ~mesh.is_boundary)
    assert between.size
    assert np.array_equal(smooth(given, "star").points[between], POINTS[between])


def test_names_fix_and_select(given):
    result = smooth(given, "star", max_sweeps=3, selection="region == east")
    assert np.array_equal(result.points[6], POINTS[6])
    assert as_mesh(given).source.point_sets["inlet"].tolist() == [0, 5, 10, 15]
    smooth(given, "star", max_sweeps=1, fixed="inlet")


def test_a_named_line_inside_keeps_its_shape():
    mesh = skfem.MeshQuad(POINTS.T.copy(), QUADS.T.copy())
    ends = np.sort(mesh.facets, axis=0).T.tolist()
    mesh = mesh.with_boundaries({"wall": np.array([ends.index([6, 7]), ends.index([7, 8])])})
    moved = (smooth(mesh, "star").points != POINTS).any(axis=1)
    assert not moved[[6, 7, 8]].any()
    assert moved[[11, 12, 13]].any()


def test_neither_boundaries_nor_subdomains():
    mesh = skfem.MeshTri(POINTS.T.copy(), TRIANGLES.T.copy())
    new, _ = smoothed(mesh)
    assert new.boundaries is None
    assert new.subdomains is None


def test_other_kinds_are_refused_by_name():
    for mesh in (skfem.MeshTri2.init_circle(1), skfem.MeshTet()):
        with pytest.raises(MeshError, match=type(mesh).__name__):
            as_mesh(mesh)
