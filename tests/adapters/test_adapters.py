"""What finds the adapter of an object, and what it costs."""

import pickle
import subprocess
import sys

import meshio
import numpy as np
import pytest

import qsmooth.adapters
from object_samples import POINTS, QUADS, X
from qsmooth import (
    Mesh,
    MeshError,
    Smoother,
    compare,
    from_meshio,
    limits,
    quality,
    smooth,
    to_meshio,
    untangle,
    write_mesh,
)
from qsmooth.adapters import adapters, as_mesh, back

LIBRARIES = {
    "meshio",
    "vtkmodules",
    "pyvista",
    "gmsh",
    "skfem",
    "matplotlib",
    "xugrid",
    "meshkernel",
}
PAIR = [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)], [(0, 1, 2, 3)]

TOY = """
import sys
NAME = "a toy"
def accepts(obj):
    return isinstance(obj, dict) and "toy" in obj
def to_mesh(obj, *, surface="auto"):
    from qsmooth import Mesh
    return Mesh(obj["toy"], obj["cells"], surface=surface)
def back(mesh, obj):
    return {**obj, "toy": mesh.points}
"""


@pytest.fixture
def toy(tmp_path, monkeypatch):
    """An adapter more, found as it lies in the package's path."""
    (tmp_path / "toy.py").write_text(TOY)
    monkeypatch.setattr(qsmooth.adapters, "__path__", [*qsmooth.adapters.__path__, str(tmp_path)])
    adapters.cache_clear()
    yield
    adapters.cache_clear()
    sys.modules.pop("qsmooth.adapters.toy", None)


def test_a_mesh_and_a_pair_need_no_adapter():
    mesh = as_mesh(PAIR)
    assert as_mesh(mesh) is mesh
    assert back(mesh, mesh) is mesh
    points, cells = back(mesh, PAIR)
    assert points is mesh.points
    assert cells is PAIR[1]
    bent = np.column_stack([PAIR[0], [0.0, 0.0, 0.0, 1.0]])
    assert as_mesh((bent, PAIR[1]), surface="flat").points[3, 2] == 1.0


def test_every_adapter_has_what_one_needs():
    for adapter in adapters():
        assert adapter.NAME.startswith("a ")
        assert not adapter.accepts(object())
        assert callable(adapter.to_mesh)
        assert callable(adapter.back)


@pytest.mark.parametrize("thing", ["text", 3, None, {}, [1, 2], (1, 2, 3)])
def test_anything_else_is_named(thing):
    with pytest.raises(TypeError, match=rf"expected a Mesh, .*; got {type(thing).__name__}"):
        as_mesh(thing)


@pytest.mark.parametrize(
    ("thing", "hint"), [("lake.msh", "read_mesh reads files"), ([*PAIR], "a pair is a tuple")]
)
def test_what_is_often_mistaken_for_a_mesh_is_told_how_to_become_one(thing, hint):
    with pytest.raises(TypeError, match=rf"; got {type(thing).__name__}: {hint}$"):
        smooth(thing)


def test_a_result_is_told_from_its_mesh():
    with pytest.raises(TypeError, match=r"; got SmoothResult: its mesh is result\.mesh$"):
        limits(smooth(PAIR, "laplacian", max_sweeps=0))


def test_everything_that_takes_a_mesh_takes_what_z_means():
    bent = np.column_stack([POINTS, X**2]), QUADS
    mesh = as_mesh(bent, surface="flat")
    with pytest.raises(MeshError, match="use surface='flat'"):
        quality(bent)
    same = {"surface": "flat"}
    assert np.array_equal(quality(bent, **same).min_angle, quality(mesh).min_angle)
    assert limits(bent, **same) == limits(mesh)
    for made in (
        smooth(bent, "laplacian", max_sweeps=2, **same),
        untangle(bent, **same),
        compare(bent, ["laplacian"], max_sweeps=2, **same)[0]["laplacian"],
        Smoother(bent, "laplacian", max_sweeps=2, **same)(bent[0]),
    ):
        assert made.mesh.surface == "flat"
        assert made.after.n_invalid == 0
    assert (made.points[:, 2] != bent[0][:, 2]).any()


def test_a_mesh_may_be_taken_in_another_way():
    tilted = np.column_stack([POINTS, X])
    mesh = Mesh(tilted, QUADS, regions=np.arange(len(QUADS)), fixed=[6])
    flat = as_mesh(mesh, surface="flat")
    assert (mesh.plane is not None, flat.plane, flat.surface) == (True, None, "flat")
    assert np.array_equal(flat.regions, mesh.regions)
    assert flat.is_fixed[6]
    assert as_mesh(flat) is flat
    assert as_mesh(mesh) is mesh
    level = Mesh(POINTS, QUADS)
    assert as_mesh(level, surface="flat") is level
    with pytest.raises(ValueError, match="surface must be 'auto' or 'flat'"):
        as_mesh(level, surface="round")


def test_a_module_is_all_that_an_adapter_takes(toy):
    given = {"toy": PAIR[0], "cells": PAIR[1], "colour": "red"}
    mesh = as_mesh(given)
    assert isinstance(mesh, Mesh)
    assert back(mesh, given)["colour"] == "red"
    with pytest.raises(TypeError, match=r"cells\) or .*a meshio\.Mesh, .*a toy, .*; got int"):
        as_mesh(3)


def test_no_library_is_imported_to_know_its_objects():
    code = (
        "import sys\n"
        "from qsmooth.adapters import as_mesh\n"
        f"as_mesh({PAIR!r})\n"
        "assert 'qsmooth.adapters.meshio_mesh' not in sys.modules\n"
        "try:\n    as_mesh('text')\nexcept TypeError:\n    pass\n"
        "assert 'qsmooth.adapters.meshio_mesh' in sys.modules\n"
        f"print({LIBRARIES} & set(sys.modules))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "set()"


def test_a_result_goes_back_to_what_came_in():
    points, cells = smooth(PAIR, "laplacian", max_sweeps=1).back()
    assert points.tolist() == [list(place) for place in PAIR[0]]
    assert cells is PAIR[1]
    mesh = Mesh(*PAIR)
    assert smooth(mesh, "laplacian", max_sweeps=1).back() is mesh
    given = meshio.Mesh(np.array(PAIR[0]), [("quad", np.array(PAIR[1]))])
    for taken in (given, from_meshio(given), as_mesh(given)):
        new = smooth(taken, "laplacian", max_sweeps=1).back()
        assert type(new) is meshio.Mesh
        assert new is not given


def test_a_pickled_result_is_told_what_it_was():
    given = meshio.Mesh(np.array(PAIR[0]), [("quad", np.array(PAIR[1]))])
    result = pickle.loads(pickle.dumps(smooth(given, "laplacian", max_sweeps=1)))
    assert result.back() is result.mesh
    assert type(result.back(given)) is meshio.Mesh


def test_writing_says_how_an_object_becomes_a_mesh(tmp_path):
    given = meshio.Mesh(np.array(PAIR[0]), [("quad", np.array(PAIR[1]))])
    with pytest.raises(TypeError, match=r"as_mesh\(\) takes meshes of other libraries"):
        write_mesh(tmp_path / "out.vtu", given)
    with pytest.raises(TypeError, match=r"as_mesh\(\) takes meshes of other libraries"):
        to_meshio(given)
    assert len(to_meshio(PAIR).points) == 4
    write_mesh(tmp_path / "out.vtu", as_mesh(given))
