"""The last look at what is held: what it keeps from better places is told, and true."""

import numpy as np
import pytest

import promises
from qsmooth import Optimize, quality, smooth
from qsmooth.examples import bump, structured
from qsmooth.optimizer.caps import HOLDABLE


@pytest.mark.nojit
def test_where_nothing_is_held_back_nothing_is_told():
    assert smooth(structured(4, 4), "optimize", max_sweeps=40).outcome.held == ()


def test_where_what_is_held_lets_nothing_move_that_is_told():
    # Rings around a point, unevenly apart: every quad has the largest angle of all, and any vertex
    # that moved by itself would make one larger. Whole rings cannot move either: one vertex stays.
    n, radii = 24, np.array([0.1, 0.2, 0.3, 0.9, 1.0])
    turn = 2.0 * np.pi * np.arange(n) / n
    circle = np.stack([np.cos(turn), np.sin(turn)], axis=1)
    points = np.concatenate([[[0.0, 0.0]], *(r * circle for r in radii)])
    at, after = np.arange(n), np.roll(np.arange(n), -1)
    fan = np.stack([np.zeros(n, int), 1 + at, 1 + after], axis=1)
    quads = [
        np.stack(
            [1 + k * n + at, 1 + (k + 1) * n + at, 1 + (k + 1) * n + after, 1 + k * n + after], 1
        )
        for k in range(len(radii) - 1)
    ]
    stay = 1 + n * np.arange(len(radii))
    result = smooth((points, [fan, np.concatenate(quads)]), target="ideal", fixed=stay)
    assert result.outcome.unchanged
    assert [held.figure for held in result.outcome.held] == ["max_angle"]
    assert "keeps" in result.reason


def test_what_is_held_back_is_told_with_the_cell_that_would_get_worse():
    mesh = bump(60, height=0.8, width=0.1)
    seen = promises.check(mesh, Optimize(hold="aspect_ratio")).result
    by_figure = {held.figure: held for held in seen.outcome.held}
    held = by_figure["aspect_ratio"]
    assert held.value == pytest.approx(quality(mesh).aspect_ratio.max(), rel=1e-9)
    assert quality(seen.mesh).aspect_ratio[held.cell] > 0.9 * held.value
    assert held.vertices >= 1
    assert f"the largest aspect ratio, held at {held.value:.3g}, keeps " in seen.reason
    assert f"at cell {held.cell}" in seen.reason


# Here caps on the way of the mean: the slopes of the bump shear its cells.
TOLD = [((), ["min_angle"]), ("aspect_ratio", ["min_angle", "max_angle", "aspect_ratio"])]


@pytest.mark.parametrize(("hold", "told"), TOLD)
def test_a_vertex_that_is_told_of_would_gain_and_break_what_is_held(hold, told):
    mesh = bump(20)
    result = smooth(mesh, Optimize(target="ideal", hold=hold, worst=False))
    after, old = result.mesh, quality(result.mesh)
    assert [held.figure for held in result.outcome.held] == told
    for held in result.outcome.held:
        largest = held.figure in ("aspect_ratio", "max_angle")
        worst = (np.max if largest else np.min)(quality(mesh)[held.figure])
        assert held.value == pytest.approx(worst, rel=1e-9)
        # Some vertex of the cell has a place near by where its cells are better on the whole, and
        # this one is worse than may be.
        gains = [0.0]
        for v in after.cells[0][held.cell]:
            star = after.star_cells[slice(*after.star_offsets[v : v + 2])]
            for angle in np.linspace(0.0, 2.0 * np.pi, 0 if after.is_fixed[v] else 60):
                points = after.points.copy()
                step = 0.1 * old.min_edge[star].min()
                points[v] += step * np.cos(angle), step * np.sin(angle)
                new = quality(after.with_points(points))
                figure = new[held.figure][held.cell]
                if (figure > held.value if largest else figure < held.value) and not new.n_invalid:
                    energies = (1.0 / own.shape[star] for own in (old, new))
                    gains.append(-np.diff([energy.sum() for energy in energies])[0])
        assert max(gains) > 0.0


@pytest.mark.parametrize("hold", [(), HOLDABLE])
def test_what_is_told_is_the_same_on_two_threads(hold):
    promises.bits_are_the_same(bump(20), Optimize(hold=hold, target="ideal", worst=False))


def test_a_limit_of_the_caller_is_told_instead_of_what_is_held():
    mesh = bump(20, height=0.8, width=0.1)
    assert smooth(mesh, "optimize", hold="aspect_ratio", max_sweeps=20).outcome.held == ()
