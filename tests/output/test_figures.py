import sys

import numpy as np
import pytest

from meshes import random_mesh
from qsmooth import Mesh, quality, smooth
from qsmooth.examples import spiral
from qsmooth.metrics import METRICS
from qsmooth.output import displacement, drawing, figures, saving
from qsmooth.output.charts import plot_convergence, plot_histograms
from qsmooth.output.displacement import plot_displacement
from qsmooth.output.figures import VIEWS, plot_comparison, plot_mesh, plot_methods
from qsmooth.output.saving import save_figures
from qsmooth.output.scales import UNDEFINED_COLOUR

pytest.importorskip("matplotlib")
from matplotlib.colors import to_rgba

pytestmark = pytest.mark.nojit

TILT = np.array([[1.0, 0.0, 0.5], [0.0, 1.0, 0.25]])


@pytest.fixture(autouse=True)
def coarse(monkeypatch):
    """Fewer pixels, for speed."""
    monkeypatch.setattr(drawing, "DPI", 40)


@pytest.fixture(scope="module")
def mesh():
    return spiral(400, seed=1)


@pytest.fixture(scope="module")
def result(mesh):
    return smooth(mesh, max_sweeps=3)


def texts(figure):
    from matplotlib.text import Text

    return " | ".join(text.get_text() for text in figure.findobj(Text))


def polygons(axes):
    from matplotlib.collections import PolyCollection

    return [c for c in axes.collections if isinstance(c, PolyCollection)]


def test_mesh_with_worst_cells_outlined(mesh):
    figure = plot_mesh(mesh, metric="scaled_jacobian", worst=7)
    axes = figure.axes[0]
    assert axes.get_aspect() == 1.0
    cells, outlined = polygons(axes)
    assert len(cells.get_paths()) == mesh.n_cells
    assert len(outlined.get_paths()) == 7
    worst = quality(mesh).worst(7).cells
    drawn = np.array([path.vertices[:4] for path in outlined.get_paths()])
    assert np.array_equal(drawn, mesh.xy[mesh.cells[0][worst]])
    assert "Outlined: the 7 worst cells" in texts(figure)
    assert "Cells by scaled Jacobian" in texts(figure)


@pytest.mark.parametrize("metric", METRICS.values(), ids=METRICS.keys())
def test_every_metric_is_drawn(metric):
    mixed = random_mesh("mixed", 4, seed=2, amount=0.8).mesh
    figure = plot_mesh(mixed, metric=metric.name, worst=3)
    words = texts(figure)
    assert f"Cells by {metric.words}" in words
    assert ("more is better" if metric.higher_is_better else "less is better") in words
    values = quality(mixed)[metric.name]
    assert metric.text(metric.worst_of(values)) in words
    grey = to_rgba(UNDEFINED_COLOUR)
    # Triangles are drawn first, then quads.
    order = np.argsort(mixed.topology.cell_sizes, kind="stable")
    faces = np.concatenate([c.get_facecolor() for c in polygons(figure.axes[0])[:2]])
    assert ((faces == grey).all(axis=1) == np.isnan(values[order])).all()
    assert ("Grey: not defined" in words) == np.isnan(values).any()


@pytest.mark.parametrize("metric", [m for m in METRICS.values() if m.bins], ids=lambda m: m.name)
def test_every_metric_with_bins_has_a_histogram(metric):
    mixed = random_mesh("mixed", 4, seed=2, amount=0.8).mesh
    figure = plot_histograms(mixed, metrics=metric.name)
    (axes,) = figure.axes
    assert metric.title in axes.get_xlabel()
    assert sum(bar.get_height() for bar in axes.patches) == pytest.approx(100.0)


def test_metrics_without_bins_have_no_histogram(mesh):
    with pytest.raises(ValueError, match="none of the metrics has a histogram"):
        plot_histograms(mesh, metrics=["shape"])


@pytest.mark.parametrize("corners", [[(1, 1)] * 4, [(0, 0), (1, 0), (1, 1), (0, 1)]])
def test_a_scale_from_the_mesh_when_all_cells_are_alike(corners):
    figure = plot_mesh((corners, [[0, 1, 2, 3]]), metric="min_edge")
    low, high = figure.axes[1].get_ylim()
    assert low < quality((corners, [[0, 1, 2, 3]])).min_edge[0] < high


def test_a_small_mesh_is_not_all_outlined():
    figure = plot_mesh(([(0, 0), (1, 0), (1, 1), (0, 1)], [[0, 1, 2, 3]]))
    assert "the 1 worst cell." in texts(figure)


@pytest.mark.parametrize("view", VIEWS)
@pytest.mark.parametrize("metric", ["max_angle", "aspect_ratio"])
def test_comparison(mesh, result, view, metric):
    figure = plot_comparison(mesh, result, view=view, metric=metric)
    words = texts(figure)
    assert "Before" in words
    assert "After (Optimise, 3 sweeps)" in words
    panels = figure.axes[:2]
    assert all(axes.get_aspect() == 1.0 for axes in panels)
    if view != "overlay":
        assert panels[0].get_xlim() == panels[1].get_xlim()
    if view in ("worst", "narrow", "good"):
        assert 60 < len(polygons(panels[0])[0].get_paths()) < 300


def test_worst_view_shows_the_worst_cell(mesh, result):
    figure = plot_comparison(mesh, result, view="worst")
    (low_x, high_x), (low_y, high_y) = figure.axes[0].get_xlim(), figure.axes[0].get_ylim()
    x, y = mesh.xy[mesh.cells[0][quality(mesh).worst(1).cells[0]]].mean(axis=0)
    assert low_x < x < high_x
    assert low_y < y < high_y


def test_comparison_takes_pairs(mesh, result):
    figure = plot_comparison((mesh.points, mesh.cells), result.mesh, title="Mine")
    assert "Mine" in texts(figure)


def test_histograms_of_one_and_of_two(mesh, result):
    figure = plot_histograms(result)
    assert len(figure.axes) == 3
    heights = [bar.get_height() for bar in figure.axes[1].patches]
    before, after = result.before.histograms["max_angle"], result.after.histograms["max_angle"]
    assert heights == pytest.approx([*before.percent, *after.percent])
    assert "Cells not valid: 0 before, 0 after." in texts(figure)
    one = plot_histograms(mesh)
    assert len(one.axes[1].patches) == len(before.percent)
    assert "Cells not valid: 0." in texts(one)
    pair = plot_histograms(result.before, result.after)
    assert [bar.get_height() for bar in pair.axes[1].patches] == pytest.approx(heights)


def test_tilted_plane(mesh):
    tilted = Mesh(mesh.points @ TILT, mesh.cells)
    figure = plot_comparison(tilted, smooth(tilted, max_sweeps=1), view="whole")
    drawn = np.array([path.vertices[:4] for path in polygons(figure.axes[0])[0].get_paths()])
    assert np.array_equal(drawn, tilted.xy[tilted.cells[0]])


ODD = {
    "concave": ([(0, 0), (2, 0), (0.5, 0.5), (0, 2)], [[0, 1, 2, 3]]),
    "crossed": ([(0, 0), (1, 1), (1, 0), (0, 1)], [[0, 1, 2, 3]]),
    "collapsed to a point": ([(1, 1)] * 4, [[0, 1, 2, 3]]),
    "collapsed to a line": ([(0, 0), (1, 0), (2, 0), (3, 0)], [[0, 1, 2, 3]]),
    "triangle": ([(0, 0), (1, 0), (0, 1)], [[0, 1, 2]]),
    "far away": ([(1e8, 1e8), (1e8 + 1, 1e8), (1e8 + 1, 1e8 + 1), (1e8, 1e8 + 1)], [[0, 1, 2, 3]]),
}


@pytest.mark.parametrize("pair", ODD.values(), ids=ODD.keys())
def test_odd_meshes_are_drawn(pair, tmp_path):
    for view in VIEWS:
        plot_comparison(pair, pair, view=view)
    plot_comparison(pair, pair, view="worst", path=tmp_path / "worst.png")
    plot_histograms(pair)
    plot_mesh(pair, metric="aspect_ratio", path=tmp_path / "mesh.svg")
    assert len(list(tmp_path.iterdir())) == 2


def test_all_figures_are_saved(mesh, result, tmp_path):
    paths = save_figures(mesh, result, tmp_path / "deep" / "figures")
    assert len(paths) == 22
    assert {path.suffix for path in paths} == {".png", ".svg"}
    for path in paths:
        head = path.read_bytes()[:5]
        assert head == (b"\x89PNG\r" if path.suffix == ".png" else b"<?xml")


def test_large_meshes_are_saved_as_images_once(mesh, result, tmp_path, monkeypatch):
    monkeypatch.setattr(saving, "IMAGE_CELLS", mesh.n_cells)
    names = {path.name for path in save_figures(mesh, result, tmp_path)}
    views = {f"comparison-{view}.png" for view in VIEWS if view != "overlay"}
    assert names == {"histograms.png", "convergence.png", "displacement.png"} | views


def test_ratios_over_decades_have_logarithmic_colours():
    x = np.append(0.0, np.cumsum(10.0 ** np.arange(5)))
    strip = Mesh(
        np.concatenate([np.column_stack([x, 0.0 * x]), np.column_stack([x, 0.0 * x + 1.0])]),
        [[k, k + 1, k + 7, k + 6] for k in range(5)],
    )
    figure = plot_mesh(strip, metric="aspect_ratio")
    assert figure.axes[1].get_yscale() == "log"
    faces = polygons(figure.axes[0])[0].get_facecolor()
    assert len(np.unique(faces, axis=0)) == 5
    assert plot_mesh(strip).axes[1].get_yscale() == "linear"


def test_long_words_beside_the_bar_go_on_in_a_second_line(mesh):
    figure = plot_mesh(mesh, metric="aspect_ratio", scale="quantiles")
    label = figure.axes[1].yaxis.label
    box = label.get_window_extent(figure.canvas.get_renderer())
    assert box.y0 > 0.0
    assert box.y1 < figure.bbox.height
    assert box.x1 < figure.bbox.width


def test_cells_seen_in_part_are_labelled_inside(mesh):
    whole = figures.whole_window(mesh)
    figure = drawing.new_figure(4.0, 4.0)
    axes = figure.add_subplot()
    half = np.array([mesh.xy[mesh.cell_vertices[:4]].mean(axis=0) * 1.0, whole[1]])
    half[0, 0] += 1e-9 * np.ptp(whole[:, 0])
    drawing.label_cells(axes, mesh, np.array([0]), half, str)
    (label,) = axes.texts
    assert (np.asarray(label.xy) >= half[0]).all()
    drawing.label_cells(axes, mesh, np.arange(0, mesh.n_cells, 50), whole, str)
    for text in axes.texts[1:]:
        share = (text.xy[0] - whole[0, 0]) / np.ptp(whole[:, 0])
        assert abs(text.get_position()[0] - share) < 0.31


def test_the_same_figure_is_the_same_file(mesh, tmp_path):
    for name in ("one.svg", "two.svg"):
        plot_mesh(mesh, path=tmp_path / name)
    assert (tmp_path / "one.svg").read_bytes() == (tmp_path / "two.svg").read_bytes()


def test_no_global_state(mesh):
    plot_mesh(mesh)
    pyplot = sys.modules.get("matplotlib.pyplot")
    assert pyplot is None or not pyplot.get_fignums()


def test_options_are_checked(mesh, result):
    with pytest.raises(ValueError, match="metric must be one of"):
        plot_mesh(mesh, metric="beauty")
    with pytest.raises(ValueError, match="worst must be 0 or more"):
        plot_mesh(mesh, worst=-1)
    with pytest.raises(ValueError, match="view must be one of"):
        plot_comparison(mesh, result, view="side")
    with pytest.raises(ValueError, match="the same cells"):
        plot_comparison(mesh, spiral(200))


def test_missing_matplotlib_says_what_to_install(mesh, monkeypatch):
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    monkeypatch.setitem(sys.modules, "matplotlib.figure", None)
    with pytest.raises(ImportError, match=r"pip install 'qsmooth\[plot\]'"):
        figures.plot_mesh(mesh)


def test_cells_left_are_named_with_their_figures(mesh, result):
    figure = plot_comparison(result, view="left")
    worst = int(quality(result.mesh).worst(1, "max_angle").cells[0])
    assert f"{worst}: {quality(result.mesh).max_angle[worst]:.2f}°" in texts(figure)


def test_linear_colours_spread_over_what_is_there(mesh):
    angles = quality(mesh).max_angle
    low, high = plot_mesh(mesh).axes[1].get_ylim()
    assert (low, high) == pytest.approx((angles.min(), angles.max()))


def test_quantiles_share_the_cells_out(mesh):
    figure = plot_mesh(mesh, scale="quantiles")
    faces = polygons(figure.axes[0])[0].get_facecolor()
    counts = np.unique(faces, axis=0, return_counts=True)[1]
    assert len(counts) == 12
    assert sorted(counts)[-9] == pytest.approx(0.1 * mesh.n_cells, abs=2)
    with pytest.raises(ValueError, match="scale must be one of"):
        plot_mesh(mesh, scale="log")


def test_large_meshes_have_a_map_of_moves_for_two_nets(mesh, result, monkeypatch):
    monkeypatch.setattr(displacement, "OVERLAY_CELLS", 100)
    figure = plot_comparison(result, view="overlay")
    assert "How far a vertex moved" in texts(figure)
    assert "moved, by" in texts(plot_displacement(result))


def test_methods_and_convergence(mesh, result):
    words = texts(plot_methods([result, result]))
    assert "Before" in words
    assert words.count("optimize (2)") + words.count("Optimize (2)") == 1
    figure = plot_convergence(result)
    assert len(figure.axes[0].lines[0].get_ydata()) == 1 + len(result.history)


def test_every_plot_takes_panels_of_the_caller(mesh, result):
    from matplotlib.figure import Figure

    for draw, n in (
        (lambda ax: plot_mesh(mesh, ax=ax[0]), 1),
        (lambda ax: plot_displacement(result, ax=ax[0]), 1),
        (lambda ax: plot_comparison(result, ax=ax), 2),
        (lambda ax: plot_methods([result], ax=ax), 2),
        (lambda ax: plot_histograms(result, log=True, ax=ax), 3),
        (lambda ax: plot_convergence(result, ax=ax), 4),
    ):
        own = Figure()
        assert draw(own.subplots(1, n, squeeze=False)[0]) is own
    with pytest.raises(ValueError, match="ax must be 2 panels"):
        plot_comparison(result, ax=own.axes)


def test_cells_that_are_not_valid_are_told():
    figure = plot_mesh(ODD["crossed"])
    assert "Nearly black: not valid" in texts(figure)
