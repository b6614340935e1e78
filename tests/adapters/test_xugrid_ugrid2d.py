"""Grids of xugrid."""

import numpy as np
import pytest

pytest.importorskip("xugrid")
import xarray
import xugrid

from object_samples import BED, POINTS, QUADS, TRIANGLES, all_ways_in, smoothed
from qsmooth import MeshError, as_mesh

FACES = np.concatenate([np.pad(TRIANGLES, ((0, 0), (0, 1)), constant_values=-1), QUADS[:8]])


@pytest.fixture
def given():
    return xugrid.Ugrid2d(*POINTS.T, -1, FACES, name="lake")


def connectivity(grid):
    names = {f"{grid.name}_node_x", f"{grid.name}_node_y"}
    return grid.to_dataset().drop_vars(names)


def same_but_for_points(new, old):
    return type(new) is type(old) and connectivity(new).identical(connectivity(old))


def test_it_comes_back(given):
    before = given.copy()
    new, points = smoothed(given)
    assert same_but_for_points(new, given)
    assert np.array_equal(new.node_coordinates, points)
    assert given.equals(before)
    assert (new.name, new.fill_value, new.is_projected) == ("lake", -1, True)
    assert as_mesh(given).cells[0].tolist() == TRIANGLES.tolist()
    all_ways_in(given, same_but_for_points)


def test_fill_value_start_index_and_reference_system():
    faces = np.where(FACES < 0, -999, FACES + 1)
    given = xugrid.Ugrid2d(
        *POINTS.T, -999, faces, start_index=1, is_projected=False, crs="EPSG:4326"
    )
    new, points = smoothed(given)
    assert (new.fill_value, new.start_index) == (-999, 1)
    assert not new.is_projected
    assert new.crs == given.crs
    assert np.array_equal(new.face_node_connectivity, FACES)
    assert np.array_equal(new.node_coordinates, points)


def test_names_attributes_and_derived_coordinates_of_a_file():
    names = {"node_coordinates": "lon lat", "face_coordinates": "mid_x mid_y"}
    dataset = xarray.Dataset(
        {
            "bottom": ((), 0, {
                "cf_role": "mesh_topology", "topology_dimension": 2, "long_name": "the lake",
                "face_node_connectivity": "cells", **names}),
            "cells": (("cell", "corner"), FACES, {"_FillValue": -1, "start_index": 0}),
            "depth": ("node", BED, {"units": "m"}),
        },
        {
            "lon": ("node", POINTS[:, 0], {
                "standard_name": "projection_x_coordinate", "comment": "east"}),
            "lat": ("node", POINTS[:, 1], {"standard_name": "projection_y_coordinate"}),
            "mid_x": ("cell", np.zeros(len(FACES)), {
                    "standard_name": "projection_x_coordinate"}),
            "mid_y": ("cell", np.zeros(len(FACES)), {
                    "standard_name": "projection_y_coordinate"}),
        },
    )  # fmt: skip
    given = xugrid.UgridDataset(dataset)
    new, points = smoothed(given.ugrid.grid)
    again = new.to_dataset(given.obj)
    assert again["lon"].values.tolist() == points[:, 0].tolist()
    assert again["lon"].attrs["comment"] == "east"
    assert again["bottom"].attrs["long_name"] == "the lake"
    assert again["depth"].variable.identical(given.obj["depth"].variable)
    assert again["mid_x"].values == pytest.approx(new.face_x)
    assert new.face_x[:4] == pytest.approx([points[f[f >= 0], 0].mean() for f in FACES[:4]])


def test_polygons_are_refused():
    faces = np.array([[0, 1, 2, 7, 5]])
    with pytest.raises(MeshError, match="1 of type polygon5"):
        as_mesh(xugrid.Ugrid2d(*POINTS.T, -1, faces))
