"""What belongs to places travels with them: z of a flat mesh, and point data that is named."""

import json
from dataclasses import replace

import meshio
import numpy as np
import pytest

from meshes import grid, rough_grid, tangle
from qsmooth import Mesh, Star, compare, from_meshio, quality, smooth, to_meshio, transfer, untangle
from qsmooth.adapters.meshio_mesh import back
from qsmooth.examples import lake
from qsmooth.options import OptionError

FEW = {"max_sweeps": 5}


def bed(xy):
    return 12.0 - 0.3 * xy[:, 0] + 0.7 * xy[:, 1]


def flat(points, cells, z=None):
    z = bed(points) if z is None else z
    return Mesh(np.column_stack([points, z]), cells, surface="flat")


@pytest.fixture
def mesh():
    return flat(*rough_grid(5))


@pytest.mark.parametrize("method", ["star", "laplacian", "optimize"])
def test_a_linear_sea_bed_stays_exact(mesh, method):
    result = smooth(mesh, method, **FEW)
    assert not result.outcome.unchanged
    np.testing.assert_allclose(result.points[:, 2], bed(result.points), rtol=1e-14)
    kept = smooth(mesh, method, carry="keep", **FEW)
    assert np.array_equal(kept.points[:, 2], mesh.points[:, 2])
    assert np.array_equal(kept.mesh.xy, result.mesh.xy)
    error = np.abs(kept.points[:, 2] - bed(kept.points))
    for outcome in (result.outcome, kept.outcome):
        (record,) = outcome.carried
        assert (record.name, record.interpolated) == ("z", outcome is result.outcome)
        assert record.vertices == (result.mesh.xy != mesh.xy).any(axis=1).sum()
        assert record.largest == pytest.approx(error.max(), rel=1e-12)
        moved = (kept.mesh.xy != mesh.xy).any(axis=1)
        assert record.rms == pytest.approx(np.sqrt((error[moved] ** 2).mean()), rel=1e-12)


def test_what_a_callback_raises_has_the_depth_too(mesh):
    def callback(record):
        raise RuntimeError

    with pytest.raises(RuntimeError) as error:
        smooth(mesh, "star", callback=callback)
    result = error.value.result
    assert (result.points != mesh.points).any()
    np.testing.assert_allclose(result.points[:, 2], bed(result.points), rtol=1e-14)


def test_a_linear_sea_bed_of_a_lake():
    given = lake(1000)
    mesh = flat(given.points, given.cells)
    result = smooth(mesh, "star", max_sweeps=20)
    error = np.abs(result.points[:, 2] - bed(result.points)).max()
    assert error < 1e-13 * np.abs(result.points[:, 2]).max()
    assert result.outcome.carried[0].largest > 1e6 * error


def test_vertices_that_rest_keep_their_depth(mesh):
    rng = np.random.default_rng(0)
    rough = flat(mesh.xy, mesh.cells, rng.normal(size=mesh.n_vertices))
    result = smooth(rough, "star", selection=[12], **FEW)
    rests = (result.mesh.xy == rough.xy).all(axis=1)
    assert 0 < rests.sum() < mesh.n_vertices
    assert np.array_equal(result.points[rests], rough.points[rests])
    assert np.array_equal(result.points[:, 2], transfer(rough, result.mesh, rough.points[:, 2]))


def test_the_outcome_says_it_in_words(mesh):
    result = smooth(mesh, "star", **FEW)
    record = result.outcome.carried[0]
    words = f"z was interpolated in the input mesh, which changed it by up to {record.largest:.3g}"
    assert words in result.reason
    assert json.loads(json.dumps(result.to_dict()))["outcome"]["carried"][0]["name"] == "z"
    kept = smooth(mesh, "star", carry="keep", **FEW).reason
    assert "carried along unchanged and is wrong by up to" in kept
    assert "carry='interpolate' mends that" in kept
    level = smooth(flat(mesh.xy, mesh.cells, np.full(mesh.n_vertices, 0.1)), "star", **FEW)
    assert (level.points[:, 2] == 0.1).all()
    assert "interpolated" not in level.reason


def test_nothing_is_carried_where_nothing_moves(mesh):
    assert smooth(mesh, "star", max_sweeps=0).outcome.carried == ()
    assert smooth(Mesh(mesh.xy, mesh.cells), "star", **FEW).outcome.carried == ()


def test_figures_are_those_of_the_new_places(mesh):
    result = smooth(mesh, "star", **FEW)
    assert result.after == quality(result.mesh).summary()
    worst = result.quality_after.worst(1)
    assert worst.centres[0, 2] == pytest.approx(bed(worst.centres)[0], rel=1e-12)


def test_all_ways_in_see_to_it(mesh):
    results, _ = compare(mesh, ["star", "laplacian"], **FEW)
    assert all(result.outcome.carried for result in results.values())
    points = tangle(*rough_grid(4), np.random.default_rng(1), 0.7)
    tangled = flat(points, grid(4, 4)[1])
    assert untangle(tangled).outcome.carried[0].interpolated


def test_depth_of_a_mesh_that_was_folded_lies_between_its_own():
    points = tangle(*grid(6, 6), np.random.default_rng(1), 0.8)
    tangled = flat(points, grid(6, 6)[1])
    z, was = untangle(tangled).points[:, 2], tangled.points[:, 2]
    assert was.min() <= z.min() <= z.max() <= was.max()


@pytest.fixture
def with_data(mesh):
    x = mesh.xy
    data = {"bed": bed(x), "flow": np.stack([bed(x), x[:, 0], x[:, 1]], axis=1), "same": bed(x)}
    data["single"] = bed(x).astype(np.float32)
    data["id"] = np.arange(len(x))
    return from_meshio(meshio.Mesh(x, [("quad", mesh.cells[0])], point_data=data)), data


def test_point_data_is_interpolated_where_it_is_named(with_data):
    mesh, data = with_data
    result = smooth(mesh, "star", interpolate=["bed", "flow", "single"], **FEW)
    xy, found = result.mesh.xy, to_meshio(result.mesh).point_data
    np.testing.assert_allclose(found["bed"], bed(xy), rtol=1e-14)
    np.testing.assert_allclose(found["flow"], np.column_stack([bed(xy), xy]), atol=1e-13)
    np.testing.assert_allclose(found["single"], bed(xy), rtol=1e-6)
    assert found["single"].dtype == np.float32
    for name in ("same", "id"):
        assert np.array_equal(found[name], data[name])
    assert np.array_equal(to_meshio(mesh).point_data["bed"], data["bed"])  # the input's own
    assert [record.name for record in result.outcome.carried] == ["bed", "flow", "single"]


def test_a_mesh_of_meshio_gets_it_back(with_data):
    mesh, data = with_data
    given = to_meshio(mesh)
    result = smooth(given, "star", interpolate="bed", **FEW)
    got = back(result.mesh, given)
    np.testing.assert_allclose(got.point_data["bed"], bed(got.points), rtol=1e-14)
    assert np.array_equal(got.point_data["same"], data["same"])
    assert np.array_equal(given.point_data["bed"], data["bed"])


def test_a_second_smoothing_goes_on_from_the_first(with_data):
    mesh, _ = with_data
    once = smooth(mesh, "star", max_sweeps=2, interpolate="bed").mesh
    twice = smooth(once, "star", max_sweeps=2, interpolate="bed").mesh
    np.testing.assert_allclose(to_meshio(twice).point_data["bed"], bed(twice.xy), rtol=1e-14)


def test_names_are_a_text_or_a_list():
    assert Star(interpolate=" a,b ,a,").interpolate == ("a", "b")
    assert Star(interpolate=["a", "b"]) == Star(interpolate=("a", "b"))
    assert replace(Star(interpolate="a"), threads=1).interpolate == ("a",)
    for wrong in (3, [3]):
        with pytest.raises(OptionError, match="interpolate takes names of point data, got"):
            Star(interpolate=wrong)


@pytest.mark.parametrize(
    ("name", "words"),
    [("bad", "no 'bad' in it; did you mean 'bed'"), ("id", "floats, 'id' is int64")],
)
def test_what_is_refused(with_data, name, words):
    with pytest.raises(OptionError, match=words):
        smooth(with_data[0], "star", interpolate=name)


def test_arrays_have_no_point_data(mesh):
    with pytest.raises(OptionError, match="no 'bed' in it, it has none"):
        smooth(mesh, "star", interpolate="bed")
