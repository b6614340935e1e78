"""Sliding: vertices stay on their lines, in order and near them; what is a corner stays."""

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from meshes import grid
from outlines import MESHES, bay, check_slid, crossings, distance, is_on, ring, sides, turns
from promises import invalid_cells
from qsmooth import Mesh, examples, limits, read_mesh, smooth, untangle
from qsmooth.numbering import numbered
from qsmooth.registry import all_methods
from qsmooth.sliding import limits_of

every_method = pytest.mark.parametrize("known", all_methods().values(), ids=all_methods())


@every_method
@given(mesh=MESHES, tolerance=st.sampled_from([0.0, 0.01, 0.05]), share=st.none() | st.just(0.2))
@settings(max_examples=12)
def test_boundary_vertices_stay_on_it(known, mesh, tolerance, share):
    method = known(
        max_sweeps=40,
        boundary="slide",
        outline_tolerance=tolerance,
        max_move_share=share,
        threads=1,
    )
    if method.why_not(mesh):
        return
    valid = not invalid_cells(mesh).any()
    result = smooth(mesh, method)
    check_slid(mesh, result.points, tolerance)
    told = result.outcome.sliding
    assert told.deviation_share <= tolerance * (1.0 + 1e-9) + 1e-14
    moved = (result.points != mesh.points).any(axis=1) & mesh.is_boundary
    assert told.slid == moved.sum()
    assert told.may_slide >= told.slid
    assert told.boundary_vertices == mesh.is_boundary.sum()
    if method.guards and valid:
        assert not invalid_cells(result.mesh).any()
        assert not crossings(result.points, sides(mesh))
    elif method.guards:
        assert invalid_cells(result.mesh).sum() <= invalid_cells(mesh).sum()


@pytest.mark.parametrize("method", ["optimize", "star", "smart-laplacian"])
def test_what_slides_gets_better(method):
    mesh = bay(12, 0.6)
    # The worst cells may cost of the mean what sliding gains.
    options = {"worst": False} if method == "optimize" else {}
    fixed, slid = (smooth(mesh, method, boundary=how, **options) for how in ("fixed", "slide"))
    assert slid.quality_after.shape.mean() > fixed.quality_after.shape.mean() + 1e-3
    assert slid.outcome.sliding.slid > 30
    assert fixed.outcome.sliding is None


@pytest.mark.parametrize("method", ["optimize", "star"])
def test_neither_threads_nor_numbering_change_a_bit(method):
    mesh = bay(10, 0.7)
    points = smooth(mesh, method, boundary="slide", threads=1).points
    assert smooth(mesh, method, boundary="slide", threads=2).points.tobytes() == points.tobytes()
    with numbered("curve"):
        inside = smooth(mesh, method, boundary="slide").points
    assert inside.tobytes() == points.tobytes()


def test_untangling_slides_where_moving_the_others_is_not_enough():
    """All vertices are on the boundary; one above is too far to the left for a bend below."""
    lower = [(0.0, 0.0), (1.0, 0.15), (2.0, 0.0)]
    upper = [(0.0, 0.2), (0.2, 0.2), (2.0, 0.2)]
    mesh = Mesh(lower + upper, [[0, 1, 4, 3], [1, 2, 5, 4]])
    fixed = untangle(mesh)
    assert fixed.quality_after.n_invalid == 1
    assert fixed.outcome.invalid.proven == 1
    result = untangle(mesh, boundary="slide")
    assert not result.quality_after.n_invalid
    assert result.points[4, 0] > 0.6
    check_slid(mesh, result.points, 0.01)


def two_shores(gap):
    """Two parts with a narrow gap between them; their shores run side by side, with a bend."""
    x = np.array([0.0, 0.4, 0.8, 2.2, 3.0])
    shore = 0.03 * np.minimum(x, 1.6 - x)
    lower = np.stack([np.tile(x, 2), np.r_[np.full(5, -1.0), shore - gap]], axis=1)
    upper = np.stack([np.tile(x, 2), np.r_[shore, np.full(5, 1.0)]], axis=1)
    quads = np.array([[k, k + 1, k + 6, k + 5] for k in range(4)])
    return lower, upper, quads


def test_no_edge_crosses_another_over_a_narrow_gap():
    lower, upper, quads = two_shores(1e-3)
    # What would hold angles keeps vertices at the bend.
    options = {"boundary": "slide", "outline_tolerance": 0.05, "guard": "clearance"}
    both = Mesh(np.concatenate([lower, upper]), [np.concatenate([quads, quads + 10])])
    # Alone the upper part goes to where the lower part is.
    alone = smooth(Mesh(upper, [quads]), "smart-laplacian", **options).points
    naive = both.points.copy()
    naive[10:] = alone
    assert crossings(naive, sides(both))
    result = smooth(both, "smart-laplacian", **options)
    assert not crossings(result.points, sides(both))
    assert result.outcome.sliding.slid > 0
    check_slid(both, result.points, 0.05)


def test_a_loop_without_corners_keeps_one_vertex():
    mesh = ring(24, 2, 0.4)
    result = smooth(mesh, "star", boundary="slide")
    stays = (result.points == mesh.points).all(axis=1) & mesh.is_boundary
    assert result.outcome.sliding.may_slide == mesh.is_boundary.sum() - 2
    assert stays.sum() >= 2


def test_corners_are_by_angle():
    mesh = bay(8, 0.5)
    told = [
        smooth(mesh, "star", boundary="slide", corner_angle=angle).outcome.sliding
        for angle in (0.0, 20.0, 170.0)
    ]
    straight = sum(turn == 0.0 for turn in turns(mesh).values())
    assert told[0] is None or told[0].may_slide <= straight
    assert told[1].may_slide == sum(turn <= 20.0 for turn in turns(mesh).values())
    assert told[2].may_slide == mesh.is_boundary.sum() - 1  # a loop keeps one


def test_what_is_fixed_selected_or_has_a_direction_does_not_slide():
    mesh = bay(8, 0.5)
    fixed = Mesh(mesh.points, mesh.cells, fixed=mesh.points[:, 0] < 0.5)
    directions = np.full((mesh.n_vertices, 2), np.nan)
    directions[mesh.points[:, 0] < 0.5] = (0.0, 1.0)
    for given_mesh, options in (
        (fixed, {}),
        (mesh, {"fixed": "x < 0.5"}),
        (mesh, {"directions": directions}),
    ):
        result = smooth(given_mesh, "star", boundary="slide", **options)
        left = mesh.is_boundary & (mesh.points[:, 0] < 0.5)
        assert result.points[left].tobytes() == mesh.points[left].tobytes()
        assert (result.points != mesh.points)[mesh.is_boundary & ~left].any()


def test_interfaces_slide_along_themselves():
    n = 10
    regions = (np.arange(n * n) % n >= n // 2).astype(int)
    mesh = bay(n, 0.5, regions=regions)
    line = np.flatnonzero(mesh.is_interface)
    for method in ("optimize", "smart-laplacian"):
        result = smooth(mesh, method, interfaces="slide")
        told = result.outcome.sliding
        assert (told.may_slide, told.interface_vertices) == (0, n - 1 - corners_on(mesh, line))
        assert told.interface_slid > 0
        assert result.points[mesh.is_boundary].tobytes() == mesh.points[mesh.is_boundary].tobytes()
        old = list(pairwise(line))
        for v in line:
            near = min(old, key=lambda e: distance(result.points[v], *mesh.xy[list(e)])[0])
            assert is_on(result.points[v], *mesh.xy[list(near)])


def corners_on(mesh, line):
    u, w = mesh.xy[line[1:-1]] - mesh.xy[line[:-2]], mesh.xy[line[2:]] - mesh.xy[line[1:-1]]
    cross = u[:, 0] * w[:, 1] - u[:, 1] * w[:, 0]
    return int((np.abs(np.degrees(np.arctan2(cross, (u * w).sum(axis=1)))) > 20.0).sum())


def test_ends_of_line_cells_stay(tmp_path):
    n = 8
    mesh = bay(n, 0.5, height=0.0)
    rows = [f"{i + 1} {x:.17g} {y:.17g} 0" for i, (x, y) in enumerate(mesh.points.tolist())]
    walls = [(i, i + 1, 7 if i < 3 else 8) for i in range(n)]
    cells = [f"{k + 1} 1 2 {tag} 1 {a + 1} {b + 1}" for k, (a, b, tag) in enumerate(walls)]
    cells += [
        f"{n + k + 1} 3 2 1 1 {' '.join(str(v + 1) for v in quad)}"
        for k, quad in enumerate(mesh.cells[0].tolist())
    ]
    text = [
        "$MeshFormat",
        "2.2 0 8",
        "$EndMeshFormat",
        "$Nodes",
        str(len(rows)),
        *rows,
        "$EndNodes",
    ]
    text += ["$Elements", str(len(cells)), *cells, "$EndElements", ""]
    path = tmp_path / "walls.msh"
    path.write_text("\n".join(text))
    points = smooth(read_mesh(path), "star", boundary="slide").points[:, :2]
    moved = (points != mesh.points).any(axis=1)
    assert not moved[3]
    assert moved[[1, 2, 4, 5]].all()


# ------------------------------------------------------------------------------- curves


def circle(k, radius):
    angle = np.linspace(0.0, 2.0 * math.pi, k + 1)
    places = radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    places[-1] = places[0]
    return places


@pytest.mark.parametrize("method", ["optimize", "star"])
@pytest.mark.parametrize("how", ["polylines", "reversed", "function"])
def test_a_curve_takes_the_place_of_the_outline(method, how):
    mesh = ring(24, 3, 0.5, seed=1)
    curve = [circle(500, 1.0), circle(700, 2.0)]
    if how == "reversed":
        curve = [one[::-1] for one in curve]
    elif how == "function":

        def curve(places):
            radius = np.hypot(*places.T)
            return places / radius[:, None] * np.where(radius < 1.5, 1.0, 2.0)[:, None]

    # By a little beside the curve.
    points = mesh.points * np.where(mesh.is_boundary, 1.001, 1.0)[:, None]
    mesh = mesh.with_points(points)
    result = smooth(mesh, method, boundary="slide", curve=curve)
    told = result.outcome.sliding
    assert (told.beside, told.slid, told.on_curve) == (0, told.may_slide, True)
    assert "off the curve by at most" in result.reason
    slid = (result.points != mesh.points).any(axis=1) & mesh.is_boundary
    radius = np.hypot(*result.points[slid].T)
    off = np.minimum(np.abs(radius - 1.0), np.abs(radius - 2.0))
    assert off.max() < 1e-4
    assert not result.quality_after.n_invalid


def test_a_curve_far_away_leaves_the_outline_as_it_is():
    mesh = bay(8, 0.4)
    far = smooth(mesh, "star", boundary="slide", curve=circle(50, 30.0))
    own = smooth(mesh, "star", boundary="slide")
    assert far.points.tobytes() == own.points.tobytes()
    assert not far.outcome.sliding.on_curve
    assert far.outcome.sliding.curves_unused == 1
    assert "no line of the mesh follows the curve" in far.reason
    assert "follow" not in own.reason


def test_a_curve_that_nothing_follows_beside_one_that_something_does():
    mesh = ring(24, 3, 0.4)
    curves = [circle(500, 1.0), circle(50, 30.0)]
    result = smooth(mesh, "star", boundary="slide", curve=curves)
    told = result.outcome.sliding
    assert (told.curves_unused, told.along_curve, told.may_slide) == (1, 23, 46)
    assert "1 curve given, but followed by no line of the mesh; 23 of 46" in result.reason


@pytest.mark.parametrize(
    ("options", "counts", "why"),
    [
        ({"boundary": "slide", "directions": (1.0, 0.0)}, (32, 32), "32 are fixed, outside"),
        ({"boundary": "slide", "corner_angle": 0.0}, (32, 0), "32 are corners"),
        ({"boundary": "slide", "fixed": "y < 0.02", "corner_angle": 0.0}, (32, 9), "9 are fixed"),
        ({"interfaces": "slide"}, (0, 0), "there is no line to slide along"),
    ],
)
@pytest.mark.parametrize("max_sweeps", [0, 5])
def test_it_is_told_why_nothing_may_slide(options, counts, why, max_sweeps):
    points, (quads,) = grid(8, 8)
    x, y = points.T / 8.0
    # All along the boundary it turns.
    mesh = Mesh(np.stack([x + 0.05 * y * (1.0 - y), y + 0.05 * x * (1.0 - x)], axis=1), [quads])
    result = smooth(mesh, "star", max_sweeps=max_sweeps, **options)
    told = result.outcome.sliding
    assert (told.may_slide, told.slid, told.interface_vertices) == (0, 0, 0)
    assert (told.line_vertices, told.kept_vertices) == counts
    assert "no vertex may slide" in result.reason
    assert why in result.reason


# ------------------------------------------------------------------------------- functions


def onto_circles(places):
    radius = np.hypot(*places.T)
    return places / radius[:, None] * np.where(radius < 1.5, 1.0, 2.0)[:, None]


def off_circles(points):
    radius = np.hypot(*points.T)
    return np.minimum(np.abs(radius - 1.0), np.abs(radius / 2.0 - 1.0))


@every_method
def test_vertices_come_to_lie_on_what_a_function_gives(known):
    mesh = ring(24, 3, 0.5, seed=1)
    method = known(boundary="slide", curve=onto_circles, threads=1)
    if method.why_not(mesh):
        return
    result = smooth(mesh, method)
    told = result.outcome.sliding
    assert (told.beside, told.off_curve) == (0, 0.0)
    assert off_circles(result.points[mesh.is_boundary]).max() < 1e-12
    if not method.untangles or known.listed:  # a valid mesh is left as it is by untangling
        assert told.slid > 40
    assert not result.quality_after.n_invalid


def test_a_function_is_followed_to_the_bit_by_what_has_slid():
    """To places of a lattice along the curve, that no polyline through others has."""
    answers = set()

    def stepped(places):
        angle = np.round(np.arctan2(places[:, 1], places[:, 0]) * 4096.0) / 4096.0
        radius = np.where(np.hypot(*places.T) < 1.5, 1.0, 2.0)
        found = radius[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
        answers.update(map(tuple, found.tolist()))
        return found

    mesh = ring(24, 3, 0.5, seed=1)
    result = smooth(mesh, boundary="slide", curve=stepped)
    moved = (result.points != mesh.points).any(axis=1) & mesh.is_boundary
    assert moved.sum() > 40
    assert result.outcome.sliding.beside == 0
    assert all(tuple(place) in answers for place in result.points[moved].tolist())


def test_a_function_in_a_tilted_plane():
    flat = ring(24, 3, 0.5, seed=1)
    axes = np.linalg.qr(np.random.default_rng(0).normal(size=(3, 3)))[0][:2]
    mesh = Mesh(flat.points @ axes, flat.cells)
    middle = -mesh.plane.axes @ mesh.plane.origin
    result = smooth(
        mesh, "star", boundary="slide", curve=lambda at: middle + onto_circles(at - middle)
    )
    assert result.outcome.sliding.beside == 0
    radius = np.hypot(*(result.mesh.xy - middle).T)[mesh.is_boundary]
    assert np.minimum(np.abs(radius - 1.0), np.abs(radius - 2.0)).max() < 1e-12


@pytest.mark.parametrize("method", ["optimize", "star"])
def test_neither_threads_nor_numbering_change_a_bit_along_a_function(method):
    mesh, options = ring(24, 3, 0.5, seed=1), {"boundary": "slide", "curve": onto_circles}
    points = smooth(mesh, method, threads=1, **options).points
    assert smooth(mesh, method, threads=2, **options).points.tobytes() == points.tobytes()
    with numbered("curve"):
        assert smooth(mesh, method, **options).points.tobytes() == points.tobytes()


@pytest.mark.parametrize("method", ["optimize", "star"])
def test_what_can_not_be_brought_onto_a_function_is_told(method):
    """Below, the curve is farther in than the cells there are high."""
    points, (quads,) = grid(8, 8)
    x, y = points.T / 8.0
    y = np.where(y == 0.125, 0.02, y)
    mesh = Mesh(np.stack([x, y], axis=1), [quads], fixed=(y > 0.0) & (y < 1.0))

    def risen(places):
        below = (places[:, 1] < 0.05) & (places[:, 0] > 0.0) & (places[:, 0] < 1.0)
        return np.where(below[:, None], [[0.0, 0.05]], 0.0) + np.stack(
            [places[:, 0], np.where(below, 0.0, places[:, 1])], axis=1
        )

    result = smooth(mesh, method, boundary="slide", curve=risen, corner_angle=60.0)
    told = result.outcome.sliding
    assert told.beside == 7
    assert told.off_curve == pytest.approx(0.05)
    assert "7 vertices could not be brought onto the curve, up to 0.05 away" in result.reason
    assert not result.quality_after.n_invalid


@pytest.mark.parametrize("method", ["optimize", "star"])
def test_reach_holds_along_a_function(method):
    mesh, reach = ring(24, 3, 0.5, seed=1), 0.05
    mesh = mesh.with_points(mesh.points * np.where(mesh.is_boundary, 1.001, 1.0)[:, None])
    result = smooth(mesh, method, boundary="slide", curve=onto_circles, max_move=reach)
    assert (np.linalg.norm(result.points - mesh.points, axis=1) <= reach).all()
    assert result.outcome.sliding.slid > 40


def broken(answer, first=1):
    """A function that goes wrong from some call on."""
    calls = []

    def curve(places):
        calls.append(len(places))
        return answer(places) if len(calls) >= first else onto_circles(places)

    return curve


def raising(places):
    raise KeyError("no spline")


def partly_nan(places):
    found = onto_circles(places)
    found[3:5, 0] = math.nan
    return found


@pytest.mark.parametrize("first", [1, 2])
@pytest.mark.parametrize(
    ("answer", "message"),
    [
        (raising, r"asked to project \d+ places, an array \(\d+, 2\), and raised KeyError"),
        (partly_nan, r"must give finite places: 2 of \d+ are not, the first for \("),
        (lambda places: places[:-1], r"must give places \(\d+, 2\) for as many, got \(\d+, 2\)"),
        (lambda places: None, "must give places .* got"),
        (lambda places: "nowhere", r"must give an array of places \(\d+, 2\).*got str"),
    ],
)
def test_functions_that_go_wrong_are_told_of(answer, message, first):
    with pytest.raises(ValueError, match=message):
        smooth(ring(24, 2, 0.4), "star", boundary="slide", curve=broken(answer, first))


def test_curves_are_read_from_files(tmp_path):
    from qsmooth.curves import read_curve

    path = tmp_path / "coast.xy"
    path.write_text("# a coast\n0 0\n# of two parts\n1, 2 # the first\n \n3 4\n5 6\n7 8\n")
    assert [one.tolist() for one in read_curve(str(path))] == [
        [[0, 0], [1, 2]],
        [[3, 4], [5, 6], [7, 8]],
    ]
    for text in ("1 2 3\n4 5 6", "a b\nc d", "1 2", "1 2\n3 nan", ""):
        path.write_text(text)
        with pytest.raises(ValueError, match=r"lines x y .*'.*coast\.xy' is none"):
            read_curve(str(path))
    with pytest.raises(ValueError, match=r"cannot read '.*none': No such file"):
        read_curve(str(tmp_path / "none"))


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"curve": [[0.0, 0.0], [1.0, 1.0]]}, "needs"),
        ({"boundary": "slide", "curve": [[0.0, 0.0]]}, "places"),
        ({"boundary": "slide", "curve": 3.0}, "places"),
        ({"boundary": "slide", "curve": [[0.0, math.nan], [1.0, 1.0]]}, "places"),
        ({"boundary": "slide", "curve": "coast"}, "cannot read 'coast'"),
        ({"interfaces": "slide", "keep_interfaces": False}, "one of the two"),
        ({"boundary": "slip"}, "slide"),
    ],
)
def test_what_does_not_go_together_is_told(options, message):
    with pytest.raises(ValueError, match=message):
        smooth(bay(4, 0.2), "star", **options)


# ------------------------------------------------------------------------------- limits


def test_limits_stay_proofs():
    """A corner's angle stays given, and a straight boundary's is half a turn, shared."""
    mesh = bay(6, 0.5, height=0.0)
    result = smooth(mesh, boundary="slide", target="ideal")
    told = result.outcome.limits
    assert told.min_angle == pytest.approx(90.0, abs=1e-6)
    assert told.max_angle == pytest.approx(90.0, abs=1e-6)
    assert told.reached_max_angle < limits(mesh).reached_max_angle


def sheared(n):
    """A parallelogram with corners of 53° and 127°."""
    points, (quads,) = grid(n, n)
    x, y = points.T / n
    return Mesh(np.stack([x + 0.8 * y, 0.6 * y], axis=1), [quads])


def test_a_sharp_corner_between_sliding_vertices_bounds_the_angle():
    told = smooth(sheared(6), boundary="slide", target="ideal").outcome.limits
    corner = math.degrees(math.atan2(0.6, 0.8))
    assert told.min_angle == pytest.approx(corner, abs=1e-6)
    assert told.min_angle_vertex in (0, 48)
    assert "fixed boundary vertices" in str(told)


@pytest.mark.parametrize("name", ["star", "smart-laplacian", "untangle"])
def test_limits_of_any_method_know_what_slides(name):
    mesh = sheared(6)
    method = all_methods()[name](boundary="slide", max_sweeps=20)
    freedom, result = method.freedom(mesh), method.run(mesh)
    told, corner = limits_of(freedom, mesh, result.mesh), math.degrees(math.atan2(0.6, 0.8))
    assert told.min_angle == pytest.approx(corner, abs=1e-6)
    assert told.max_angle == pytest.approx(180.0 - corner, abs=1e-6)
    assert "fixed boundary vertices" in str(told)
    # Were the vertices beside the corners to go anywhere, they could have any angle.
    anywhere = limits(result.mesh, movable=freedom.movable)
    assert (anywhere.min_angle, anywhere.max_angle) == (90.0, 90.0)


@settings(deadline=None, max_examples=20)
@given(height=st.floats(0.0, 0.3), seed=st.integers(0, 99))
@pytest.mark.parametrize("name", ["optimize", "star"])
def test_no_slide_beats_the_limits(name, height, seed):
    mesh = bay(5, 0.5, height, seed)
    method = all_methods()[name](boundary="slide", max_sweeps=30, threads=1)
    freedom, result = method.freedom(mesh), method.run(mesh)
    for known in (mesh, result.mesh):
        told = limits_of(freedom, mesh, known)
        assert told.min_angle >= result.quality_after.min_angle.min() - 1e-9
        assert told.max_angle <= result.quality_after.max_angle.max() + 1e-9


def test_a_real_shore(shared_meshes):
    mesh = read_mesh(shared_meshes / "superior_hohq_1505.obj", surface="flat")
    fixed, slid = (smooth(mesh, boundary=how, max_sweeps=200) for how in ("fixed", "slide"))
    told = slid.outcome.sliding
    assert told.slid > 0
    assert told.deviation_share <= 0.01 * (1.0 + 1e-9)
    assert slid.quality_after.shape.mean() > fixed.quality_after.shape.mean()
    assert slid.quality_after.min_angle.min() >= fixed.quality_before.min_angle.min() - 1e-9
    check_slid(Mesh(mesh.points[:, :2], mesh.cells), slid.points[:, :2], 0.01)


# ------------------------------------------------------------------------------- high angles


def test_high_angles_are_eased_where_vertices_slide(monkeypatch):
    from qsmooth.optimizer import stages

    mesh = examples.lake(2000)
    eased = smooth(mesh, boundary="slide").quality_after
    monkeypatch.setattr(stages, "_ease", lambda *_: None)
    plain = smooth(mesh, boundary="slide").quality_after
    assert eased.high_angle(99.0) < plain.high_angle(99.0) - 2.0
    assert eased.max_angle.max() <= plain.max_angle.max() + 1e-9
    assert eased.shape.mean() >= 0.995 * plain.shape.mean()
    assert eased.shape.min() >= plain.shape.min() - 1e-9


def test_what_sliding_is_to_bring_to_a_lake(shared_meshes):
    mesh = read_mesh(shared_meshes / "superior_24k.off", surface="flat")
    result = smooth(mesh, boundary="slide")
    after = result.quality_after
    assert after.min_angle.min() >= 15.55 - 0.005
    assert after.max_angle.max() <= 153.9
    assert np.percentile(after.max_angle, 99.0) <= 125.8
    assert after.aspect_ratio.max() <= 6.9
    assert after.shape.mean() >= 0.8283
    assert result.outcome.sliding.deviation_share <= 0.01 * (1.0 + 1e-9)
