"""What is kept as the best, stage by stage."""

import dataclasses

import numpy as np
import pytest

from meshes import random_mesh
from qsmooth import Optimize, quality
from qsmooth.engine import threads_for
from qsmooth.optimizer.best import MOST_RESIZED, Best
from qsmooth.optimizer.figures import LEAST_GAIN, Figures
from qsmooth.optimizer.lanes import Lanes
from qsmooth.optimizer.progress import Progress
from qsmooth.targets import ideal

GIVEN = Figures(
    free_jacobian=0.5,
    shape=0.8,
    plain_shape=0.8,
    n_invalid=0,
    least_shape=0.4,
    low_angle=30.0,
    resized=0.1,
    energy=1.3,
)


def best_of(*, mean_loss=0.1, enough=None, kind="ideal", given=GIVEN, keep_mean=False):
    """The best so far with figures that are said, not measured; and how to say the next."""
    mesh = random_mesh("mixed", 3, seed=1).mesh
    lanes = Lanes(mesh.topology, mesh.topology.schedule(True), threads_for(1, mesh.n_vertices))
    lanes.aim_at(ideal(mesh.topology)._replace(kind=kind))
    said = [given]

    class Said(Best):
        def measure(self, xy):
            return said[-1]

    progress = Progress(Optimize(), quality(mesh))
    best = Said(lanes, mesh.xy, progress, mean_loss=mean_loss, enough=enough, keep_mean=keep_mean)

    def offer(how, *arguments, **figures):
        """Offer other coordinates, with these figures; returns what comes of it and if kept."""
        said.append(dataclasses.replace(GIVEN, **figures))
        xy = best.xy + 1.0
        found = getattr(best, how)(xy, *arguments)
        kept = np.array_equal(best.xy, xy)
        assert kept == (best.figures is said[-1])
        return found, kept

    return best, offer


def kept(offer, how, *arguments, **figures):
    found, is_kept = offer(how, *arguments, **figures)
    assert found is is_kept or found is not True
    return is_kept


@pytest.mark.nojit
def test_figures_are_those_of_quality():
    mesh = random_mesh("mixed", 5, seed=1, amount=0.8).mesh
    lanes = Lanes(mesh.topology, mesh.topology.schedule(True), threads_for(1, mesh.n_vertices))
    lanes.aim_at(ideal(mesh.topology))
    progress = Progress(Optimize(), quality(mesh))
    own, found = quality(mesh), Best(lanes, mesh.xy, progress, mean_loss=0.1, enough=None).figures
    assert found.shape == pytest.approx(own.shape.mean(), rel=1e-12)
    assert found.plain_shape == pytest.approx(own.shape.mean(), rel=1e-12)
    assert found.least_shape == pytest.approx(own.shape.min(), rel=1e-12)
    assert found.low_angle == pytest.approx(np.percentile(own.min_angle, 1.0), rel=1e-12)
    high = lanes.look(mesh.xy).high_angle(99.0)
    assert high == pytest.approx(np.percentile(own.max_angle, 99.0), rel=1e-12)
    assert found.free_jacobian >= own.scaled_jacobian.min() * (1.0 - 1e-12)
    assert (found.n_invalid, found.resized) == (0, 0.0)


# ------------------------------------------------------------------------------- the worst corner


@pytest.mark.nojit
def test_a_better_worst_corner_is_kept_while_the_mean_affords_it():
    _, offer = best_of()
    assert kept(offer, "offer", free_jacobian=0.6, shape=0.73)
    best, offer = best_of()
    assert not kept(offer, "offer", free_jacobian=0.6, shape=0.71)
    assert best.forbidden.scaled_jacobian == 0.6
    # The best mean that was seen counts, kept or not.
    assert not kept(offer, "offer", free_jacobian=0.4, shape=0.85)
    assert not kept(offer, "offer", free_jacobian=0.6, shape=0.76)
    assert kept(offer, "offer", free_jacobian=0.6, shape=0.77)


@pytest.mark.nojit
def test_what_a_mesh_came_with_may_be_kept_unless_more_loss_is_allowed():
    for loss, least in ((0.0, 0.8), (0.1, 0.8), (0.28, 0.64)):
        for more, expected in ((1e-9, True), (-1e-9, False)):
            _, offer = best_of(mean_loss=loss, keep_mean=True)
            assert kept(offer, "offer", free_jacobian=0.6, shape=least + more) is expected


@pytest.mark.nojit
def test_what_has_become_too_dear_gives_way():
    _, offer = best_of()
    assert kept(offer, "offer", free_jacobian=0.6, shape=0.73)
    assert kept(offer, "offer", free_jacobian=0.5, shape=0.83)


@pytest.mark.nojit
def test_sizes_are_limited_from_when_it_is_said():
    for more, expected in [(0.9, True), (1.1, False)]:
        best, offer = best_of()
        best.limit_sizes()
        resized = GIVEN.resized + more * MOST_RESIZED
        assert kept(offer, "offer", free_jacobian=0.6, resized=resized) is expected
    _, offer = best_of()
    assert kept(offer, "offer", free_jacobian=0.6, resized=9.0)


@pytest.mark.nojit
def test_by_the_mean_only_the_mean_counts():
    best, _ = best_of()
    found = dataclasses.replace(GIVEN, free_jacobian=0.4, shape=0.81)
    best.measure = lambda xy: found
    best.offer(best.xy + 1.0, by_mean=True)
    assert best.figures is found


@pytest.mark.nojit
def test_towards_a_metric_only_the_energy_counts():
    _, offer = best_of(kind="metric")
    assert not kept(offer, "offer", free_jacobian=0.9, shape=0.9, energy=1.4)
    assert kept(offer, "offer", free_jacobian=0.1, shape=0.1, energy=1.2)


@pytest.mark.nojit
def test_nothing_to_gain_is_no_move():
    best, offer = best_of()
    start = best.xy.copy()
    assert kept(offer, "offer", shape=0.8 + 0.9 * LEAST_GAIN)
    best.settle()
    assert np.array_equal(best.xy, start)
    assert best.figures is GIVEN
    assert kept(offer, "offer", shape=0.8 + 1.1 * LEAST_GAIN)
    best.settle()
    assert not np.array_equal(best.xy, start)


@pytest.mark.nojit
@pytest.mark.parametrize("figures", [{"low_angle": 31.0}, {"least_shape": 0.42}])
def test_low_angles_and_the_worst_shape_are_gains_too(figures):
    best, offer = best_of()
    start = best.xy.copy()
    assert kept(offer, "offer_overall", 0.0, 0.0, **figures)
    best.settle()
    assert not np.array_equal(best.xy, start)


# ------------------------------------------------------------------------------- looser walls


@pytest.mark.nojit
@pytest.mark.parametrize(
    ("jacobian", "least", "expected"),
    [(0.6, 0.35, True), (0.6, 0.33, False), (0.5, 0.4, False), (0.49, 0.5, True)],
)
def test_it_pays_where_the_worst_corner_gains_more_than_the_worst_shape_loses(
    jacobian, least, expected
):
    best, _ = best_of()
    mark = best.mark()
    start = best.xy.copy()
    best.xy[:] += 1.0
    best.figures = dataclasses.replace(GIVEN, free_jacobian=jacobian, least_shape=least)
    assert best.pays_since(mark) is expected
    best.back_to(mark)
    assert np.array_equal(best.xy, start)
    assert best.figures is GIVEN


@pytest.mark.nojit
def test_fewer_invalid_cells_always_pay():
    best, _ = best_of(given=dataclasses.replace(GIVEN, n_invalid=3, free_jacobian=0.0))
    mark = best.mark()
    best.figures = dataclasses.replace(best.figures, n_invalid=2, least_shape=0.0)
    assert best.pays_since(mark)


# ------------------------------------------------------------------------------- overall, relaxed


@pytest.mark.nojit
def test_overall_low_angles_and_the_worst_shape_count_beside_the_mean():
    floor = 0.79
    for figures, expected in [
        ({"low_angle": 31.0}, True),
        ({"least_shape": 0.41}, True),
        ({"low_angle": 29.0}, False),
        ({"low_angle": 28.0, "least_shape": 0.9}, False),  # too low
        ({"low_angle": 29.0, "least_shape": 0.9}, True),
        ({"low_angle": 33.0, "shape": 0.795}, True),
        ({"low_angle": 33.0, "shape": 0.785}, False),  # below the floor
        ({"low_angle": 30.1, "shape": 0.795}, False),  # not worth it
        ({"low_angle": 31.0, "free_jacobian": 0.1}, True),  # what is held sees to that
    ]:
        _, offer = best_of()
        found, is_kept = offer("offer_overall", floor, 28.5, **figures)
        assert found is is_kept is expected


@pytest.mark.nojit
def test_relaxed_the_mean_gains_and_the_rest_may_lose_a_little():
    for figures, expected in [
        ({"shape": 0.81}, True),
        ({"shape": 0.80}, False),
        ({"shape": 0.81, "low_angle": 29.2}, True),
        ({"shape": 0.81, "low_angle": 29.0}, False),
        ({"shape": 0.81, "least_shape": 0.37}, False),
    ]:
        _, offer = best_of()
        found, is_kept = offer("offer_relaxed", 29.1, 0.38, **figures)
        assert found is is_kept is expected


@pytest.mark.nojit
def test_eased_high_angles_count_too(monkeypatch):
    for room, figures, expected in [
        (1.0, {"shape": 0.81}, True),
        (1.0, {"shape": 0.80}, False),
        (1.02, {"shape": 0.795}, True),
        (1.02, {"shape": 0.785}, False),  # below the floor
        (1.001, {"shape": 0.795}, False),  # not worth it
        (0.98, {"shape": 0.81}, False),
        (1.02, {"low_angle": 28.0}, False),  # too low
    ]:
        best, offer = best_of()
        start = best.xy.copy()

        def counted(self, xy, start=start, room=room):
            return 1.0 if np.array_equal(xy, start) else room

        monkeypatch.setattr(Best, "_room", counted)
        found, is_kept = offer("offer_eased", 0.79, 28.5, **figures)
        assert found is is_kept is expected


@pytest.mark.nojit
@pytest.mark.parametrize("how", ["offer_overall", "offer_relaxed"])
def test_neither_resizes_cells_beyond_the_limit(how):
    best, offer = best_of()
    best.limit_sizes()
    too_much = GIVEN.resized + 1.1 * MOST_RESIZED
    assert not offer(how, 0.0, 0.0, shape=0.82, low_angle=33.0, resized=too_much)[1]
    assert offer(how, 0.0, 0.0, shape=0.82, low_angle=33.0)[1]
