"""Models of gmsh."""

import pickle

import numpy as np
import pytest

pytest.importorskip("gmsh")
import gmsh

from object_samples import POINTS, QUADS, TRIANGLES
from qsmooth import MeshError, as_mesh, quality, smooth

TAGS = np.arange(20)[::-1] * 3 + 7  # of the vertices; gmsh's need be neither dense nor in order


@pytest.fixture
def session():
    gmsh.initialize(interruptible=False)
    gmsh.option.setNumber("General.Terminal", 0)
    yield
    gmsh.finalize()


@pytest.fixture
def discrete(session):
    gmsh.model.add("lake")
    gmsh.model.addDiscreteEntity(1, 4)
    gmsh.model.addDiscreteEntity(2, 1, [4])
    gmsh.model.addDiscreteEntity(2, 2)
    space = np.column_stack([POINTS, np.zeros(20)])
    gmsh.model.mesh.addNodes(2, 1, TAGS, space.ravel())
    gmsh.model.mesh.addElementsByType(4, 1, [], TAGS[[0, 1, 1, 2]])
    gmsh.model.mesh.addElementsByType(1, 3, [101, 102], TAGS[QUADS[:2]].ravel())
    gmsh.model.mesh.addElementsByType(2, 3, [], TAGS[QUADS[2:8]].ravel())
    gmsh.model.mesh.addElementsByType(2, 2, [], TAGS[TRIANGLES].ravel())
    gmsh.model.addPhysicalGroup(2, [1], 11, "sand")
    gmsh.model.addPhysicalGroup(2, [2], 12, "mud")
    gmsh.model.addPhysicalGroup(1, [4], 13, "shore")


def state():
    """All that a model has but the places of its nodes."""
    elements = [
        [np.concatenate(x).tolist() if i else x.tolist() for i, x in enumerate(found)]
        for entity in gmsh.model.getEntities(2)
        for found in [gmsh.model.mesh.getElements(*entity)]
    ]
    return elements, gmsh.model.getPhysicalGroups(), sorted(gmsh.model.mesh.getNodes()[0].tolist())


def places():
    tags, points, _ = gmsh.model.mesh.getNodes()
    return points.reshape(-1, 3)[np.argsort(tags)]


@pytest.mark.parametrize("model", [gmsh, gmsh.model], ids=["gmsh", "gmsh.model"])
def test_nodes_move_and_all_else_stays(discrete, model):
    before, start = state(), places()
    mesh = as_mesh(model)
    assert np.array_equal(places(), start)
    assert np.array_equal(mesh.points[:, :2], POINTS[::-1])
    assert mesh.regions.tolist() == [11] * 2 + [12] * 14
    assert len(mesh.topology.lines) == 2
    result = smooth(model, "star", max_sweeps=3, fixed="shore")
    assert np.array_equal(places(), start)
    assert result.back() is gmsh.model
    assert result.back(gmsh) is gmsh
    assert np.array_equal(places(), result.points)
    assert np.abs(places() - start).max() > 0.05
    assert state() == before
    assert quality(model).n_invalid == 0


def test_the_model_is_the_one_that_was_smoothed(discrete):
    result = smooth(gmsh, "star", max_sweeps=3)
    gmsh.model.add("other")
    result.back()
    assert gmsh.model.getCurrent() == "other"
    gmsh.model.setCurrent("lake")
    assert np.array_equal(places(), result.points)
    again = pickle.loads(pickle.dumps(result))
    assert again.back() is again.mesh
    assert again.back(gmsh.model) is gmsh.model
    gmsh.model.mesh.addNodes(2, 1, [1], [9.0, 9.0, 0.0])
    with pytest.raises(ValueError, match="20 vertices for a mesh that has 21"):
        result.back()
    gmsh.model.remove()
    with pytest.raises(ValueError, match="no model 'lake' any more"):
        result.back()


def test_parameters_on_surfaces_follow(session):
    gmsh.model.add("plate")
    plate = gmsh.model.occ.addDisk(0, 0, 0, 2, 1)
    gmsh.model.occ.synchronize()
    gmsh.option.setNumber("Mesh.MeshSizeMax", 0.8)
    gmsh.model.mesh.generate(2)
    before = places()
    smooth(gmsh, "laplacian", max_sweeps=5).back()
    assert (places() != before).any()
    tags, points, parameters = gmsh.model.mesh.getNodes(2, plate, returnParametricCoord=True)
    assert gmsh.model.getValue(2, plate, parameters) == pytest.approx(points, abs=1e-12)
    assert len(tags)


def test_without_a_mesh():
    with pytest.raises(MeshError, match=r"not initialised: call gmsh\.initialize"):
        as_mesh(gmsh)
    gmsh.initialize(interruptible=False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        gmsh.model.add("empty")
        with pytest.raises(MeshError, match="model 'empty' has no mesh"):
            as_mesh(gmsh.model)
    finally:
        gmsh.finalize()


def test_second_order_and_solids_are_refused_by_name(session):
    gmsh.model.occ.addBox(0, 0, 0, 1, 1, 1)
    gmsh.model.occ.synchronize()
    gmsh.option.setNumber("Mesh.MeshSizeMax", 1.0)
    gmsh.model.mesh.generate(3)
    with pytest.raises(MeshError, match="tetra"):
        as_mesh(gmsh)
    gmsh.clear()
    gmsh.model.occ.addRectangle(0, 0, 0, 1, 1)
    gmsh.model.occ.synchronize()
    gmsh.model.mesh.generate(2)
    gmsh.model.mesh.setOrder(2)
    with pytest.raises(MeshError, match="triangle6"):
        as_mesh(gmsh)
