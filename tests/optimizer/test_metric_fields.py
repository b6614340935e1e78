"""Meshes that follow a metric, or their own directions; what does not fit is named."""

import math

import numpy as np
import pytest

from qsmooth import quality, smooth
from qsmooth.examples import jittered, random_triangles, structured


def layer(places):
    """Flat cells about the line through the middle, four times as long as high there."""
    high = 1.0 / (1.0 + 3.0 * np.exp(-(((places[:, 1] - 0.5) / 0.2) ** 2)))
    out = np.zeros((len(places), 2, 2))
    out[:, 0, 0], out[:, 1, 1] = 12.0**2, (12.0 / high) ** 2
    return out


@pytest.mark.parametrize("kind", ["quad", "triangle", "mixed"])
@pytest.mark.parametrize("given", ["function", "tensors"])
def test_cells_follow_a_metric(kind, given):
    mesh = structured(12, 24, kind=kind)
    result = smooth(mesh, target=layer if given == "function" else layer(mesh.points))
    told = result.outcome.target
    assert told.kind == "metric"
    assert told.after > told.before + (0.002 if kind == "quad" else 0.03)
    after = quality(result.mesh)
    assert after.n_invalid == 0
    # Not the angles of the input: those of the metric.
    assert after.aspect_ratio.max() > 1.3 * quality(mesh).aspect_ratio.max()
    assert "towards the metric" in result.reason


def test_a_metric_that_has_no_direction_asks_for_squares():
    mesh = jittered(12, 12, seed=3)
    plain = smooth(mesh, target="ideal", worst=False)
    tensors = np.tile(144.0 * np.eye(2), (mesh.n_vertices, 1, 1))
    for size in ({"objective": "shape"}, {}):
        result = smooth(mesh, target=tensors, **size)
        assert np.abs(result.mesh.points - plain.mesh.points).max() < 1e-3


def test_what_is_listed_is_held_towards_a_metric_too():
    mesh = jittered(12, 12, seed=3)
    result = smooth(mesh, target=layer, hold=("min_edge", "aspect_ratio"))
    before, after = quality(mesh), quality(result.mesh)
    assert after["min_edge"].min() >= before["min_edge"].min() * (1.0 - 1e-9)
    assert after.aspect_ratio.max() <= before.aspect_ratio.max() * (1.0 + 1e-9)


@pytest.mark.parametrize("turn", [0.0, 0.5])
def test_turned_rectangles_keep_their_direction(turn):
    mesh = jittered(16, 16, seed=3, amount=0.2)
    axes = np.array([[math.cos(turn), -math.sin(turn)], [math.sin(turn), math.cos(turn)]])
    mesh = mesh.with_points(mesh.points * (1.0, 0.25) @ axes.T)
    result = smooth(mesh, target="initial")
    told, after = result.outcome.target, quality(result.mesh)
    # Each has its own size and ratio, which do not fit each other: these are not all to be had.
    assert told.after > told.before + 0.08
    assert after.min_angle.min() > 85.0
    assert 3.5 < np.median(after.aspect_ratio) < 4.7


def test_the_same_bits_on_two_threads():
    mesh = structured(12, 24, kind="mixed")
    one, two = (smooth(mesh, target=layer, threads=k, max_sweeps=40).mesh.points for k in (1, 2))
    assert one.tobytes() == two.tobytes()


@pytest.mark.parametrize(
    ("target", "said"),
    [
        (np.ones((3, 2, 2)), r"must be one for each of 9 vertices, \(9, 2, 2\), got \(3, "),
        (np.tile([[1.0, 0.5], [0.0, 1.0]], (9, 1, 1)), "must be symmetric, that of vertex 0"),
        (np.tile([[1.0, 2.0], [2.0, 1.0]], (9, 1, 1)), "positive definite, that of vertex 0"),
        (np.full((9, 2, 2), np.nan), "that of vertex 0 is not"),
        (lambda places: np.full((len(places), 2, 2), np.nan), "that of cell 0 is not"),
        (lambda places: None, "of the function must be one for each of 4 cells"),
        (lambda places: "round", "of the function must be real numbers"),
        (lambda places: np.ones(len(places)), r"\(4, 2, 2\), got \(4,\)"),
    ],
)
def test_bad_metrics_are_named(target, said):
    with pytest.raises(ValueError, match=said):
        smooth(structured(2, 2), target=target)


def test_ratios_are_for_quads():
    with pytest.raises(ValueError, match="for meshes of quads only"):
        smooth(random_triangles(20), target=[1.0])
