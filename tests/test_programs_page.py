"""The blocks of docs/programs.md run, each where its library is there."""

import importlib
import re
import signal
from pathlib import Path

import numpy as np
import pytest

from object_samples import BED, POINTS, QUADS
from qsmooth import as_mesh, quality, smooth

PAGE = (Path(__file__).resolve().parent.parent / "docs" / "programs.md").read_text(encoding="utf-8")
BLOCKS = dict(re.findall(r"^## ([^\n]*)\n(?:(?!^## ).)*?^```python\n(.*?)^```$", PAGE, re.M | re.S))
NEEDS = {
    "meshio": ["meshio"],
    "pyvista": ["pyvista"],
    "VTK and ParaView": ["vtkmodules"],
    "gmsh": ["gmsh"],
    "scikit-fem": ["skfem"],
    "matplotlib": ["matplotlib"],
    "xugrid": ["xugrid"],
    "MeshKernel": ["meshkernel"],
    "Notebooks and data frames": ["pandas"],
}


def test_every_block_is_run():
    assert PAGE.count("```python") == len(BLOCKS)
    assert set(BLOCKS) == set(NEEDS)


def test_every_adapter_has_a_section():
    from qsmooth.adapters import adapters

    assert [a.NAME for a in adapters() if not any(h in a.NAME for h in BLOCKS)] == []


@pytest.fixture
def _interrupts():
    """Interrupts as they were: gmsh takes them over."""
    before = signal.getsignal(signal.SIGINT)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.mark.usefixtures("_interrupts")
@pytest.mark.parametrize("title", BLOCKS)
def test_block(title):
    for name in NEEDS[title]:
        pytest.importorskip(name)
    if title == "pyvista":
        pytest.importorskip("pyvista", minversion="0.48")
        importlib.import_module("qsmooth.integrations.pyvista_accessor")
    names = {
        "smooth": smooth,
        "points": POINTS.copy(),
        "points_3d": np.column_stack([POINTS, np.zeros(len(POINTS))]),
        "cells": QUADS,
        "triangles": np.concatenate([QUADS[:, :3], QUADS[:, [0, 2, 3]]]),
        "masked": np.arange(2 * len(QUADS)) == 3,
        "edge_nodes": np.stack([QUADS, np.roll(QUADS, -1, axis=1)], axis=2)
        .astype(np.int32)
        .ravel(),
        "bed": BED,
        "better": (POINTS, QUADS),
    }
    if title.startswith("Notebooks"):
        names["result"] = smooth((POINTS, QUADS), "star", max_sweeps=2)
    exec(compile(BLOCKS[title], f"programs.md, {title}", "exec"), names)
    if title not in ("gmsh", "MeshKernel"):
        assert quality(names["better"]).n_invalid == 0
        assert type(names["better"]).__module__.split(".")[0] != "qsmooth"
    if title in ("pyvista", "matplotlib", "scikit-fem", "xugrid", "meshio"):
        assert (as_mesh(names["better"]).xy != POINTS).any()
