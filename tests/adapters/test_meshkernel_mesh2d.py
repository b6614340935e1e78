"""Meshes of MeshKernel."""

import numpy as np
import pytest

pytest.importorskip("meshkernel")
from meshkernel import Mesh2d, MeshKernel

from object_samples import POINTS, QUADS, TRIANGLES, all_ways_in, smoothed
from qsmooth import MeshError, as_mesh
from qsmooth.adapters import back

CENTRES = "edge_x", "edge_y", "face_x", "face_y"


def edges(*blocks):
    ends = [np.stack([b.ravel(), np.roll(b, -1, axis=1).ravel()], axis=1) for b in blocks]
    return np.unique(np.sort(np.concatenate(ends), axis=1), axis=0).astype(np.int32).ravel()


@pytest.fixture
def kernel():
    kernel = MeshKernel()
    kernel.mesh2d_set(Mesh2d(*POINTS.T.copy(), edges(QUADS[:8], TRIANGLES)))
    return kernel


def same_but_for_points(new, old):
    own = {k for k, v in vars(old).items() if isinstance(v, np.ndarray)} - {
        "node_x", "node_y", *CENTRES,
    }  # fmt: skip
    return type(new) is type(old) and all(
        np.array_equal(getattr(new, name), getattr(old, name)) for name in own
    )


def test_it_comes_back(kernel):
    given = kernel.mesh2d_get()
    assert sorted(as_mesh(given).topology.cell_sizes) == [3] * 8 + [4] * 8
    before = {name: getattr(given, name).copy() for name in ("node_x", *CENTRES)}
    new, points = smoothed(given)
    assert same_but_for_points(new, given)
    assert np.array_equal(np.stack([new.node_x, new.node_y], axis=1), points)
    assert all(np.array_equal(getattr(given, name), old) for name, old in before.items())
    all_ways_in(given, same_but_for_points)


def test_centres_are_those_that_meshkernel_finds(kernel):
    given = kernel.mesh2d_get()
    new, _ = smoothed(given)
    kernel.mesh2d_set(new)
    theirs = kernel.mesh2d_get()
    assert np.array_equal(new.face_nodes, theirs.face_nodes)
    for name in CENTRES:
        assert getattr(new, name) == pytest.approx(getattr(theirs, name), abs=1e-12)
        assert getattr(new, name) != pytest.approx(getattr(given, name), abs=1e-3)


def test_an_edge_without_a_face_is_a_line(kernel):
    given = kernel.mesh2d_get()
    given.edge_nodes = np.append(given.edge_nodes, np.int32([13, 6]))
    mesh = as_mesh(given)
    assert mesh.topology.lines.tolist() == [[6, 13]]
    assert mesh.is_interface[[6, 13]].all()


def test_without_faces_and_of_another_mesh():
    bare = Mesh2d(*POINTS.T.copy(), edges(QUADS))
    with pytest.raises(MeshError, match="no faces"):
        as_mesh(bare)
    with pytest.raises(ValueError, match="3 vertices for a mesh that has 20"):
        back(as_mesh((POINTS[[0, 1, 6]], [(0, 1, 2)])), bare)
