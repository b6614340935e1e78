"""What holds for every metric, so also for one that is registered tomorrow."""

import copy
import json
import math
import pickle

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from meshes import grid, random_mesh, random_meshes, tangle
from qsmooth import Mesh, Quality, quality
from qsmooth.metrics import METRICS, Metric, find_metric, parse_metrics
from qsmooth.metrics.registry import register
from qsmooth.selection import select_cells

each_metric = pytest.mark.parametrize("metric", METRICS.values(), ids=METRICS.keys())


def equilateral(n):
    """Triangles with edges of one."""
    points = [(i + 0.5 * j, 0.75**0.5 * j) for j in range(n + 1) for i in range(n + 1)]
    ids = np.arange((n + 1) ** 2).reshape(n + 1, n + 1)
    low = np.stack([ids[:-1, :-1], ids[:-1, 1:], ids[1:, :-1]], axis=-1).reshape(-1, 3)
    high = np.stack([ids[:-1, 1:], ids[1:, 1:], ids[1:, :-1]], axis=-1).reshape(-1, 3)
    return points, [np.concatenate([low, high])]


def has_neighbour(mesh):
    return np.logical_or.reduceat(mesh.topology.twins >= 0, mesh.cell_offsets[:-1])


def is_defined(metric, mesh):
    defined = np.isin(mesh.topology.cell_sizes, metric.corners)
    return defined & has_neighbour(mesh) if metric.inner else defined


# ------------------------------------------------------------------------------- records


@pytest.mark.nojit
@each_metric
def test_a_record_says_all_there_is_to_know(metric):
    assert METRICS[metric.name] is metric
    assert metric.name.isidentifier()
    assert metric.name not in dir(Quality)
    assert metric.words
    assert metric.definition
    assert not metric.definition.endswith(".")
    assert metric.span[0] < metric.span[1]
    assert set(metric.corners) <= {3, 4}
    assert list(metric.bins) == sorted(set(metric.bins))
    for end in (metric.ideal, metric.triangle_ideal, metric.worst_colour):
        assert end is None or metric.span[0] <= end <= metric.span[1]
    assert metric.triangle_ideal is None or metric.ideal is not None
    if metric.ideal is not None and metric.worst_colour is not None:
        assert (metric.worst_colour < metric.ideal) == metric.higher_is_better
    if metric.mean == "arithmetic" and not metric.unit:
        assert np.isfinite(metric.span).all()


@pytest.mark.nojit
def test_words():
    words = {m.name: (m.worst_words, m.mean_words) for m in METRICS.values()}
    assert words["min_angle"] == ("Smallest angle", "Mean of smallest angles")
    assert words["scaled_jacobian"] == ("Smallest scaled Jacobian", "Mean of scaled Jacobians")
    assert words["min_edge"] == ("Shortest edge", "Mean of shortest edges")
    assert len({pair for both in words.values() for pair in both}) == 2 * len(METRICS)
    assert METRICS["taper"].title == "Taper"
    assert METRICS["aspect_ratio"].explanation == (
        "Aspect ratio: longest over shortest edge of a cell; ideal: 1."
    )


@pytest.mark.nojit
def test_figures_as_text():
    assert METRICS["max_angle"].text(90.0) == "90.00°"
    assert METRICS["max_angle"].text(math.nan) == "none"
    assert METRICS["distortion"].text(-math.inf) == "minus infinite"
    assert METRICS["min_edge"].text(1.25e-4) == "0.000125"


@pytest.mark.nojit
def test_a_name_is_taken_once():
    with pytest.raises(ValueError, match="there is a metric taper already"):
        register(METRICS["taper"])


@pytest.mark.nojit
def test_a_new_metric_is_one_record_and_all_else_follows(monkeypatch, tmp_path):
    from qsmooth.metrics import check_gate, registry
    from qsmooth.output.tables import worst_table

    toy = Metric(
        name="toy", measure=lambda cells: np.abs(cells.area), words="toy area", definition="area",
        higher_is_better=False, ideal=None, span=(0.0, math.inf), worst_colour=None,
        bins=(0.0, 1.0, 2.0),
    )  # fmt: skip
    monkeypatch.setitem(registry._metrics, "toy", toy)
    mesh = Mesh(*grid(3, 2))
    own = quality(mesh)
    assert own.toy is own["toy"]
    assert own.summary("toy").worst == {"toy": 1.0}
    assert "Largest toy area" in str(own.summary(["toy"]))
    assert own.worst(2, by="toy").values["toy"].tolist() == [1.0, 1.0]
    assert "Toy area" in str(worst_table(own, 1, "toy"))
    assert select_cells(mesh, "toy > 0.5").all()
    assert not check_gate(own, "toy", 0.5, below=False).passed
    pytest.importorskip("matplotlib")
    from qsmooth import plot_histograms, plot_mesh

    plot_mesh(mesh, metric="toy")
    plot_histograms(mesh, metrics="toy")


# ------------------------------------------------------------------------------- names


@pytest.mark.nojit
def test_names_are_parsed():
    short = ("min_angle", "max_angle", "aspect_ratio", "scaled_jacobian", "shape", "size_jump")
    assert parse_metrics(None) == short
    assert parse_metrics("all") == tuple(METRICS)
    assert parse_metrics(" taper, min-angle,taper,") == ("taper", "min_angle")
    assert parse_metrics(["oddy"]) == ("oddy",)
    with pytest.raises(ValueError, match=r"got 'tapr'; did you mean 'taper'\?"):
        parse_metrics("oddy, tapr")
    with pytest.raises(ValueError, match="metrics must name at least one of min_angle"):
        parse_metrics(" , ")
    with pytest.raises(ValueError, match=r"--worst-by must be one of .*; got 'beauty'$"):
        find_metric("beauty", "--worst-by")


@pytest.mark.nojit
def test_quality_has_every_metric_by_name_and_in_brackets():
    own = quality(grid(3, 2))
    for name in METRICS:
        assert own[name] is getattr(own, name)
        assert own[name].shape == (6,)
        assert name in dir(own)
    with pytest.raises(KeyError, match=r"did you mean 'taper'\?"):
        own["tapr"]
    with pytest.raises(AttributeError, match=r"no attribute 'tapr'.*did you mean 'taper'\?"):
        own.tapr  # noqa: B018
    assert not hasattr(own, "_nothing")
    assert copy.copy(own).taper.shape == (6,)
    again = pickle.loads(pickle.dumps(quality(grid(3, 2)).summary()))
    assert again == own.summary()


@pytest.mark.nojit
def test_each_is_measured_once_and_only_when_asked_for():
    own = quality(grid(3, 2))
    own.summary()
    assert set(own._values) == set(parse_metrics(None))
    assert own["shape"] is own.shape


# ------------------------------------------------------------------------------- figures


@pytest.mark.nojit
@each_metric
@pytest.mark.parametrize("corners", [3, 4])
def test_the_ideal_is_attained_by_ideal_cells(metric, corners):
    mesh = Mesh(*(equilateral(3) if corners == 3 else grid(3, 3)))
    values = quality(mesh)[metric.name]
    if corners not in metric.corners:
        assert np.isnan(values).all()
        return
    ideal = 1.0 if metric.ideal is None else metric.ideal_of(mesh.topology.cell_sizes)
    np.testing.assert_allclose(values, ideal, atol=1e-12 if metric.unit != "°" else 1e-9)


@pytest.mark.nojit
@each_metric
@pytest.mark.parametrize("kind", ["quads", "triangles", "mixed", "mixed fan", "graded"])
@pytest.mark.parametrize("amount", [0.0, 1.0])
def test_figures_are_in_their_span_and_nan_only_where_not_defined(metric, kind, amount):
    made = random_mesh(kind, 4, seed=7, amount=0.9)
    points = tangle(made.points, made.cells, np.random.default_rng(7), amount)
    mesh = Mesh(points, made.cells)
    values = quality(mesh)[metric.name]
    defined = is_defined(metric, mesh)
    np.testing.assert_array_equal(np.isnan(values), ~defined)
    assert metric.partial or defined.all()
    low, high = metric.span
    assert (values[defined] >= low - 1e-9).all()
    assert (values[defined] <= high + 1e-9).all()
    if metric.ideal is not None and not metric.blind:
        best = metric.ideal_of(mesh.topology.cell_sizes)
        valid = defined & (quality(mesh).validity == 0)
        gain = values[valid] - best if metric.higher_is_better else best - values[valid]
        assert (gain <= 1e-9).all()


LONELY = {
    "square": ([(0, 0), (1, 0), (1, 1), (0, 1)], [[0, 1, 2, 3]]),
    "triangle": ([(0, 0), (1, 0), (0, 1)], [[0, 1, 2]]),
}


@pytest.mark.nojit
@each_metric
@pytest.mark.parametrize("pair", LONELY.values(), ids=LONELY.keys())
def test_a_cell_without_neighbours(metric, pair):
    mesh = Mesh(*pair)
    summary = quality(mesh).summary([metric.name])
    defined = is_defined(metric, mesh).any()
    for figure in (summary.worst, summary.mean):
        assert math.isnan(figure[metric.name]) != defined
    if not defined:
        assert f"{metric.worst_words}" in str(summary)
        assert summary.to_dict()["worst"][metric.name] is None
        assert len(quality(mesh).worst(5, metric.name).cells) == 0


# A cell beside a good square, (0, 0) to (1, 1) with the edge from (1, 0) to (1, 1) in common.
BROKEN = {
    "turned square": [(1, 0), (0.0, 0.0), (0.0, 1.0), (1, 1)],
    "flat": [(1, 0), (1, 0.2), (1, 0.7), (1, 1)],
    "line back and forth": [(1, 0), (1, 1), (1, 0), (1, 1)],
    "turned triangle": [(1, 0), (1 - 0.75**0.5, 0.5), (1, 1)],
    "flat triangle": [(1, 0), (1, 0.5), (1, 1)],
    "triangle in a point": [(1, 0), (1, 0), (1, 0)],
    "square in a point": [(1, 0), (1, 0), (1, 0), (1, 0)],
}


def with_broken(corners):
    """A square, a broken cell beside it and a square far off, so that orientation is known."""
    points = [(0, 0), (1, 0), (1, 1), (0, 1), *corners[1:-1]]
    broken = [1, *range(4, 4 + len(corners) - 2), 2]
    points[2] = corners[-1] if corners[-1] == (1, 0) else points[2]
    big = len(points)
    points += [(-9, 0), (-9, -9), (0, -9)]
    blocks = [[(0, 1, 2, 3), (0, big, big + 1, big + 2)], [broken]]
    if len(corners) == 4:
        blocks = [[(0, 1, 2, 3), broken, (0, big, big + 1, big + 2)]]
    return Mesh(points, blocks), 1 if len(corners) == 4 else 2


@pytest.mark.nojit
@each_metric
@pytest.mark.parametrize("corners", BROKEN.values(), ids=BROKEN.keys())
def test_a_broken_cell_has_a_figure_where_the_metric_is_defined(metric, corners):
    mesh, cell = with_broken(corners)
    own = quality(mesh)
    assert own.area[cell] <= 0.0
    assert math.isnan(own[metric.name][cell]) == (len(corners) not in metric.corners)


SEEING = [metric for metric in METRICS.values() if not metric.blind]


@pytest.mark.nojit
@pytest.mark.parametrize("metric", SEEING, ids=lambda metric: metric.name)
@pytest.mark.parametrize("corners", BROKEN.values(), ids=BROKEN.keys())
def test_a_broken_cell_does_not_look_good(metric, corners):
    mesh, cell = with_broken(corners)
    own = quality(mesh)
    value = own[metric.name][cell]
    if len(corners) in metric.corners:
        # An inner edge's figure is that of both its cells.
        worst = metric.worst_of(own[metric.name])
        assert value == worst or metric.higher_is_better == (value < worst)
        best = metric.ideal_of(np.array([len(corners)]))
        gap = best - value if metric.higher_is_better else value - best
        assert gap > 0.1
        # The old ones tell bad from worse by the sign of a corner.
        assert metric.short or value in metric.span


@pytest.mark.nojit
@each_metric
def test_a_lost_coordinate_is_the_worst(metric):
    made = random_mesh("mixed", 4, seed=3, amount=0.5)
    mesh = made.mesh
    inner = int(np.flatnonzero(~mesh.is_boundary)[0])
    xy = mesh.xy.copy()
    xy[inner] = np.nan
    lost = np.zeros(mesh.n_cells, bool)
    lost[mesh.star_cells[mesh.star_offsets[inner] : mesh.star_offsets[inner + 1]]] = True
    lost &= is_defined(metric, mesh)
    assert lost.any()
    values = Quality(mesh.topology, xy)[metric.name]
    k = int(lost.sum())
    ranked = metric.worst_cells(values, mesh.n_cells)
    beyond = values[ranked[:k]]
    assert np.array_equal(np.sort(values[lost]), np.sort(beyond), equal_nan=True)
    threshold = np.nanmean(values[np.isfinite(values)])
    assert metric.fails(values, threshold, below=metric.higher_is_better)[lost].all()
    worst = metric.worst_of(values)
    assert math.isnan(worst) or worst in metric.span


@pytest.mark.nojit
@given(random_meshes(), st.booleans())
@settings(max_examples=25)
def test_summaries_of_all_metrics_are_fit_for_json(made, tangled):
    points = made.points
    if tangled:
        points = tangle(points, made.cells, np.random.default_rng(made.seed), made.scale)
    own = quality((points, made.cells))
    summary = own.summary("all")
    assert tuple(summary.worst) == tuple(summary.mean) == tuple(METRICS)
    plain = summary.to_dict()
    assert json.loads(json.dumps(plain, allow_nan=False)) == plain
    for name, histogram in summary.histograms.items():
        assert sum(histogram.counts) == METRICS[name].defined(own[name]).size
    assert str(summary)
    subset = own.summary("taper, size_jump")
    assert set(subset.worst) == {"taper", "size_jump"}
    assert {k: summary.mean[k] for k in subset.mean} == pytest.approx(subset.mean, nan_ok=True)
