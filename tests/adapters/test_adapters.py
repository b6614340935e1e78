"""What finds the adapter of an object, and what it costs."""

import subprocess
import sys

import numpy as np
import pytest

import qsmooth.adapters
from qsmooth import Mesh
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
