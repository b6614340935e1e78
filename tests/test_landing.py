"""What a function that is a curve answers in the end: who goes there, and who stays."""

import numpy as np
import pytest

from meshes import grid
from outlines import bay
from qsmooth import Mesh, Star
from qsmooth.landing import land
from qsmooth.numbering import Inside
from qsmooth.sliding import slider_of

# Far from the ends of segments, of which there are 32 to an edge of 1/6; shorter than one.
ALONG, STEP = 0.001, 0.002


def slider_along(mesh, **options):
    """What slides along a function that answers with what it is asked, till `answer` is set."""
    answer = []

    def curve(places):
        return answer[0](places) if answer else places

    free = Star(curve=curve, **options).freedom(mesh)
    return slider_of(free, mesh, Inside(mesh)), answer


def landed(slider, xy, chosen=None):
    n_cells = slider.topology.n_cells
    land(slider, xy, lambda trial: np.zeros(n_cells, np.bool_), chosen)
    return xy


def two_squares(gap):
    """Two squares one above the other, with a gap between; and the top of the lower one."""
    points, (quads,) = grid(6, 6)
    upper = points / 6.0 + (0.0, 1.0 + gap)
    mesh = Mesh(np.concatenate([points / 6.0, upper]), [np.vstack([quads, quads + len(points)])])
    on_top = (mesh.points[:, 1] == 1.0) & (np.arange(mesh.n_vertices) < len(points))
    inner = on_top & (mesh.points[:, 0] > 0.0) & (mesh.points[:, 0] < 1.0)
    return mesh, inner


def risen(by):
    def answer(places):
        up = (np.abs(places[:, 1] - 1.0) < 1e-9) & (places[:, 0] > 0.0) & (places[:, 0] < 1.0)
        return places + np.where(up[:, None], [[0.0, by]], 0.0)

    return answer


@pytest.mark.parametrize(
    ("gap", "by", "goes"),
    [(0.5, STEP, True), (0.5 * STEP, STEP, False), (-0.25 * STEP, 0.5 * STEP, True)],
    ids=["free", "would meet another side", "meets it already"],
)
def test_no_side_comes_to_meet_another(gap, by, goes):
    mesh, inner = two_squares(gap)
    slider, answer = slider_along(mesh, boundary="slide")
    xy = mesh.xy.copy()
    xy[inner, 0] += ALONG
    answer.append(risen(by))
    assert ((landed(slider, xy)[inner, 1] > 1.0) == goes).all()


def test_only_the_chosen_go():
    mesh, inner = two_squares(0.5)
    slider, answer = slider_along(mesh, boundary="slide")
    xy = mesh.xy.copy()
    xy[inner, 0] += ALONG
    answer.append(risen(STEP))
    chosen = inner & (mesh.points[:, 0] < 0.5)
    assert np.array_equal(landed(slider, xy, chosen)[:, 1] == 1.0 + STEP, chosen)


def test_nobody_goes_past_the_next_or_beyond_the_segment():
    regions = (np.arange(36) % 6 >= 3).astype(int)
    mesh = bay(6, 0.0, height=0.0, regions=regions)
    slider, answer = slider_along(mesh, interfaces="slide")
    line = np.flatnonzero(mesh.xy[:, 0] == 0.5)
    a, b, c = line[np.argsort(mesh.xy[line, 1])][2:5]
    start = mesh.xy.copy()
    # Two in one segment.
    start[a, 1], start[b, 1] = 0.5 + ALONG, 0.5 + ALONG + STEP
    start[c, 1] += ALONG

    def swap(places):
        found = places.copy()
        at = np.argsort(places[:, 1])
        first, second = at[np.isin(places[at, 1], start[[a, b], 1])]
        found[[first, second]] = places[[second, first]]
        return found

    answer.append(swap)
    assert np.array_equal(landed(slider, start.copy()), start)
    answer[0] = lambda places: places + np.array([0.0, 0.5 * STEP])
    went = landed(slider, start.copy())
    assert np.allclose(went[[a, b, c], 1], start[[a, b, c], 1] + 0.5 * STEP, atol=1e-15)
    answer[0] = lambda places: places + np.array([0.0, 0.0052])  # nearly a segment on
    assert np.array_equal(landed(slider, start.copy())[c], start[c])
    answer[0] = lambda places: places + np.array([0.006, 0.0])  # as far aside as no segment is long
    assert np.array_equal(landed(slider, start.copy()), start)
