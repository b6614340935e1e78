"""``dataset.qsmooth`` of pyvista."""

import importlib
import tomllib
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("pyvista", minversion="0.48")
import pyvista

from object_samples import POINTS, QUADS
from qsmooth import Star, quality, smooth

ROOT = Path(__file__).resolve().parents[2]
SPACE = np.column_stack([POINTS, np.zeros(len(POINTS))])


@pytest.fixture(autouse=True, scope="module")
def accessor():
    """As pyvista does it, by the entry point, which is there only where qsmooth is installed."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    module = importlib.import_module(project["entry-points"]["pyvista.accessors"]["qsmooth"])
    assert {r.name for r in pyvista.registered_accessors()} >= {"qsmooth"}
    return module


@pytest.fixture
def grid():
    mesh = pyvista.UnstructuredGrid({3: np.array([[0, 1]]), 9: QUADS}, SPACE.copy())
    mesh["bed"] = POINTS[:, 0]
    return mesh


def test_smooth_gives_a_dataset_of_the_same_class(grid):
    new = grid.qsmooth.smooth("star", max_sweeps=3, interpolate="bed")
    result = smooth(grid, "star", max_sweeps=3, interpolate="bed")
    assert type(new) is pyvista.UnstructuredGrid
    assert np.array_equal(new.points, result.points)
    assert new == result.back()
    assert grid.qsmooth.smooth(Star(max_sweeps=3, interpolate="bed")) == new
    poly = grid.extract_surface(algorithm=None)
    assert type(poly.qsmooth.smooth("laplacian", max_sweeps=1)) is pyvista.PolyData


def test_untangle(grid):
    grid.points[6] = 2.7, 2.2, 0.0
    assert quality(grid).n_invalid
    assert quality(grid.qsmooth.untangle()).n_invalid == 0


def test_quality_is_an_array_at_cells_in_the_order_of_the_dataset(grid):
    new = grid.qsmooth.quality("taper,skew")
    types = new.celltypes
    assert np.isnan(new["taper"][types == 3]).all()
    assert new["validity"][types == 3].tolist() == [-1]
    assert np.array_equal(new["taper"][types == 9], quality(grid).taper)
    assert (new["validity"][types == 9] == 0).all()
    assert "taper" not in grid.cell_data
    assert set(grid.qsmooth.quality().cell_data) >= {"min_angle", "max_angle"}


def test_degrees(grid):
    grid.points[:, :2] = 0.1 * POINTS + [10.0, 54.0]
    new = grid.qsmooth.quality("min_angle", geographic=True)
    kept = new["min_angle"][new.celltypes == 9]
    assert np.array_equal(kept, quality(grid, geographic=True).min_angle)
    assert not np.array_equal(kept, quality(grid).min_angle)
    assert quality(grid.qsmooth.smooth("star", geographic=True)).n_invalid == 0


def test_third_coordinate_as_a_value(grid):
    grid.points[:, 2] = POINTS[:, 0] ** 2
    new = grid.qsmooth.smooth("star", max_sweeps=1, surface="flat", carry="keep")
    assert np.array_equal(new.points[:, 2], POINTS[:, 0] ** 2)
    assert not np.isnan(grid.qsmooth.quality(surface="flat")["min_angle"][1:]).any()
