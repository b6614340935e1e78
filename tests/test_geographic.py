"""Longitudes and latitudes: true angles, whatever the place on the globe; given back in degrees."""

import math

import numpy as np
import pytest

from meshes import rough_grid
from outlines import ring
from qsmooth import (
    Mesh,
    Smoother,
    compare,
    limits,
    quality,
    read_mesh,
    smooth,
    untangle,
    write_mesh,
)
from qsmooth.errors import MeshError
from qsmooth.examples import lake
from qsmooth.geographic import ECCENTRICITY, SEMI_AXIS, Projection, look_like_degrees
from qsmooth.methods.driver import stored
from qsmooth.metrics import Validity
from qsmooth.metrics.quality import Quality

PLACES = {
    "lake": (-87.0, 47.5),
    "dateline": (180.0, -17.0),
    "equator": (3.0, 0.0),
    "north": (20.0, 88.0),
    "pole": (0.0, 90.0),
    "south": (-60.0, -89.0),
    "from zero": (359.9, 52.0),
}


def ground(points):
    """Metres east and north for a degree, on the ellipsoid."""
    phi = np.radians(points[:, 1])
    w = np.sqrt(1.0 - (ECCENTRICITY * np.sin(phi)) ** 2)
    north = SEMI_AXIS * (1.0 - ECCENTRICITY**2) / w**3
    return np.radians(np.column_stack([SEMI_AXIS * np.cos(phi) / w, north]))


def about(place, extent=0.5, n=200):
    """Places about one, by way of a plane that lies there."""
    rng = np.random.default_rng(3)
    there = Projection(np.array([PLACES[place]]))
    return there.unproject(extent * 1e5 * rng.uniform(-1.0, 1.0, (n, 2)))


def in_degrees(xy, place, metres=2e5):
    return Projection(np.array([PLACES[place]])).unproject(metres * (xy - xy.mean(axis=0)))


@pytest.mark.nojit
@pytest.mark.parametrize("place", PLACES)
def test_there_and_back(place):
    points = about(place)
    back = Projection(points).unproject(Projection(points).project(points))
    off = np.abs(np.remainder(back - points + 180.0, 360.0) - 180.0)
    assert (off * ground(points)).max() < 1e-8  # metres


@pytest.mark.nojit
@pytest.mark.parametrize("place", [place for place in PLACES if place != "pole"])
def test_small_figures_keep_their_angles_and_in_the_middle_their_lengths(place):
    points = about(place)
    there = Projection(points)
    scale = ground(points)
    here = there.project(points)
    east, north = (there.project(points + step / scale) - here for step in ([1.0, 0], [0, 1.0]))
    sine = (east[:, 0] * north[:, 1] - east[:, 1] * north[:, 0]) / (
        np.hypot(*east.T) * np.hypot(*north.T)
    )
    np.testing.assert_allclose(sine, 1.0, atol=1e-9)
    np.testing.assert_allclose(np.hypot(*east.T), np.hypot(*north.T), rtol=1e-5)
    stretch = 1.0 + (np.hypot(*here.T) / (2.0 * SEMI_AXIS)) ** 2
    np.testing.assert_allclose(np.hypot(*north.T), stretch, rtol=1e-4)
    turned = there.turned(points, np.tile([1.0, 0.0], (len(points), 1)))
    np.testing.assert_allclose(turned, east / np.hypot(*east.T)[:, None], atol=2e-5)


@pytest.mark.nojit
def test_agrees_with_proj():
    pyproj = pytest.importorskip("pyproj")
    points = about("lake")
    there = Projection(points)
    utm = pyproj.Transformer.from_crs("EPSG:4326", "EPSG:32616", always_xy=True)
    triangles = np.arange(198).reshape(-1, 3)
    small = points[triangles[:, :1]] + 1e-4 * (points[triangles] - points[triangles[:, :1]])
    ours = there.project(small.reshape(-1, 2)).reshape(-1, 3, 2)
    theirs = np.column_stack(utm.transform(*small.reshape(-1, 2).T)).reshape(-1, 3, 2)
    assert np.abs(angles(ours) - angles(theirs)).max() < 1e-4


def angles(corners):
    ahead = np.roll(corners, -1, axis=1) - corners
    back = -np.roll(ahead, 1, axis=1)
    cross = ahead[..., 0] * back[..., 1] - ahead[..., 1] * back[..., 0]
    return np.degrees(np.arctan2(cross, (ahead * back).sum(axis=-1)))


@pytest.mark.nojit
def test_what_are_no_degrees_is_refused():
    points, (quads,) = rough_grid(4)
    with pytest.raises(
        MeshError, match=r"of 7 vertices they are not, the first is vertex 4: 4\d\d"
    ):
        Mesh(np.column_stack([points[:, 0] * 100 + 50, points[:, 1]]), quads, geographic=True)
    mesh = Mesh(points, quads, geographic=True)
    with pytest.raises(MeshError, match="within ±90"):
        mesh.with_points(points * [1.0, 89.0])
    globe = np.array([[-170, 0], [-60, 5], [5, 1], [60, 5], [170, 0], [0, 80], [0, -80.0]])
    with pytest.raises(MeshError, match="goes round the globe"):
        Projection(globe)


@pytest.mark.nojit
def test_the_flag_goes_along():
    points, (quads,) = rough_grid(4)
    mesh = Mesh(points, quads, geographic=True)
    assert mesh.with_points(points).geographic
    assert mesh.with_fixed([3]).geographic
    assert not mesh.with_geographic(False).geographic
    assert np.array_equal(mesh.with_geographic(False).xy, points)
    flat = Mesh(np.column_stack([points, points[:, 0]]), quads, geographic=True)
    assert flat.surface == "flat"
    assert quality((points, quads), geographic=True).area.mean() > 1e9  # square metres


@pytest.mark.parametrize("place", ["lake", "dateline", "pole"])
def test_a_lake_in_degrees_and_in_metres_gives_the_same_angles(place):
    metres = lake(1000)
    degrees = Mesh(in_degrees(metres.points, place), metres.cells, geographic=True)
    plane = Mesh(degrees.xy, metres.cells)
    found, wanted = smooth(degrees), smooth(plane)
    assert found.quality_after.min_angle.min() == pytest.approx(
        wanted.quality_after.min_angle.min(), abs=0.01
    )
    assert found.quality_after.max_angle.max() == pytest.approx(
        wanted.quality_after.max_angle.max(), abs=0.01
    )
    assert np.abs(found.mesh.xy - wanted.points).max() < 1e-3  # metres
    stay = degrees.is_fixed
    assert np.array_equal(found.points[stay], degrees.points[stay])
    assert limits(degrees).min_angle == pytest.approx(limits(plane).min_angle, abs=0.01)
    again = Mesh(found.points, metres.cells, geographic=True)
    assert quality(again).min_angle.min() == pytest.approx(
        found.quality_after.min_angle.min(), abs=1e-6
    )


@pytest.mark.nojit
@pytest.mark.parametrize(("place", "side"), [("lake", 1.0), ("dateline", -1.0)])
def test_cells_stay_valid_in_the_degrees_that_are_written(place, side):
    """On the map a parallel is curved: what lies between it and its chord is on the other side."""
    points = PLACES[place] + np.array([(-1.0, 0.0), (0.0, -0.01 * side), (1.0, 0.0)])
    mesh = Mesh(points, [(0, 1, 2)], geographic=True)
    there = points.copy()
    there[1, 1] = points[0, 1] + 5e-4 * side
    xy = mesh.project(there)
    assert (Quality(mesh.topology, xy).validity == Validity.VALID).all()
    assert (Quality(mesh.topology, there).validity != Validity.VALID).all()
    assert np.array_equal(stored(mesh, xy).points, points)
    np.testing.assert_allclose(stored(mesh, xy, guarded=False).points, there)
    there[1, 1] = points[0, 1] - 5e-4 * side
    np.testing.assert_allclose(stored(mesh, mesh.project(there)).points, there)


def test_constraints_are_in_metres_and_directions_go_east():
    points, (quads,) = rough_grid(6)
    points = in_degrees(points, "lake", 1e4)
    mesh = Mesh(points, quads, geographic=True)
    result = smooth(mesh, "star", max_move=100.0)
    moves = (result.points - points) * ground(points)
    assert 99.0 < np.hypot(*moves.T).max() < 100.2
    east = smooth(mesh, "star", directions=(1.0, 0.0))
    moves = (east.points - points) * ground(points)
    assert np.abs(moves[:, 0]).max() > 100.0
    assert np.abs(moves[:, 1]).max() < 1e-3 * np.abs(moves[:, 0]).max()


def test_every_way_in_takes_pairs_in_degrees():
    points, (quads,) = rough_grid(6)
    pair = in_degrees(points, "lake"), quads
    mesh = Mesh(*pair, geographic=True)
    wanted = smooth(mesh, "star").points
    assert np.array_equal(smooth(pair, "star", geographic=True).points, wanted)
    results, _ = compare(pair, ["star"], geographic=True)
    assert np.array_equal(results["star"].points, wanted)
    assert np.array_equal(Smoother(pair, "star", geographic=True)(pair[0]).points, wanted)
    assert untangle(pair, geographic=True).mesh.geographic
    assert limits(pair, geographic=True).min_angle == limits(mesh).min_angle


def test_steps_of_a_session_are_in_degrees():
    points, (quads,) = rough_grid(8)
    degrees = in_degrees(points, "lake")
    mesh = Mesh(degrees, quads, geographic=True)
    moving = degrees.copy()
    record = Smoother(mesh, "optimize").step(moving)
    assert record.valid
    stay = mesh.is_fixed
    assert np.array_equal(moving[stay], degrees[stay])
    assert 1e-6 < np.abs(moving - degrees).max() < 1.0
    assert quality(mesh.with_points(moving)).min_angle.min() > quality(mesh).min_angle.min()


def test_steps_slide_along_a_curve_in_degrees_whose_ends_the_host_moves():
    flat = ring(20, 2, 0.6)
    body = flat.is_boundary & (np.hypot(*flat.points.T) < 1.5)
    corner, size = np.array([10.0, 50.0]), np.array([0.01 / math.cos(math.radians(50.0)), 0.01])

    def onto(places):
        there = (places - corner) / size
        radius = np.hypot(*there.T)
        return corner + size * there / radius[:, None] * np.where(radius < 1.5, 1, 2)[:, None]

    angle = np.linspace(0.0, 2.0 * math.pi, 500)
    circle = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    circle[-1] = circle[0]
    c, s = math.cos(0.05), math.sin(0.05)
    turn = np.array([[c, s], [-s, c]])
    for curve in ([corner + size * circle, corner + 2.0 * size * circle], onto):
        points = corner + size * flat.points
        mesh = Mesh(points, flat.cells, geographic=True)
        smoother = Smoother(mesh, "star", boundary="slide", curve=curve)
        slid = 0
        for _ in range(3):
            points[body] = corner + size * ((points[body] - corner) / size @ turn)
            before = points.copy()
            assert smoother.step(points).valid
            slid += (points != before).any(axis=1)[body].sum()
        assert slid > 30
        radius = np.hypot(*((points - corner) / size).T)[mesh.is_boundary]
        assert np.abs(radius - np.where(radius < 1.5, 1.0, 2.0)).max() < 1e-4


def test_steps_keep_cells_valid_in_degrees():
    """On the map a parallel is curved, and there is room between it and its chord."""
    points = np.array([(-1.0, 50.0), (1.0, 50.0), (0.9, 49.9999), (0.0, 48.0)])
    mesh = Mesh(points, [(0, 2, 1), (0, 3, 2), (3, 1, 2)], geographic=True)
    smoother = Smoother(mesh, "star", directions=(-0.9 * math.cos(math.radians(50.0)), 0.0031))
    smoother.step(points)
    assert points[2, 1] < 50.0
    assert np.array_equal(points, mesh.points)


@pytest.mark.parametrize("wrong", [math.nan, math.inf, 95.0, 1e200])
def test_a_step_to_what_are_no_degrees_changes_nothing(wrong):
    points, (quads,) = rough_grid(4)
    mesh = Mesh(points, quads, geographic=True)
    smoother, again = Smoother(mesh, "star"), points.copy()
    bad = points.copy()
    bad[7, 1] = wrong
    given = bad.copy()
    with pytest.raises(MeshError, match="vertex 7"):
        smoother.step(bad)
    assert np.array_equal(bad, given, equal_nan=True)
    smoother.step(points)
    Smoother(mesh, "star").step(again)
    assert np.array_equal(points, again)


@pytest.mark.nojit
@pytest.mark.parametrize(
    ("low", "high", "looks"),
    [
        ((-92, 46), (-84, 49), True),
        ((14.1, 48.9), (14.2, 49.0), True),
        ((0, 0), (1, 1), False),
        ((-1, -1), (1, 1), False),
        ((500, 40), (501, 41), False),
        ((-170, -80), (170, 80), False),
    ],
)
def test_what_looks_like_degrees(low, high, looks):
    assert look_like_degrees(np.array([low, high], float)) is looks


@pytest.mark.nojit
@pytest.mark.parametrize(
    ("low", "high", "looks"),
    [
        ((-97.85, 7.99), (-60.04, 45.75), True),  # western Atlantic
        ((-12.1, 47.9), (12.9, 62.3), True),  # North Sea
        ((-15.04, -12.79), (10.19, 11.2), False),
        ((10, 20), (60, 70), False),
        ((0, 0), (25.3, 4.1), False),
    ],
)
def test_what_looks_like_a_sea_in_degrees(low, high, looks):
    points = np.linspace(low, high, 500)
    assert look_like_degrees(points) is looks


def test_files_say_so_or_callers(tmp_path):
    points, (quads,) = rough_grid(4)
    points = in_degrees(points, "lake")
    write_mesh(tmp_path / "a.nc", Mesh(points, quads, geographic=True))
    assert read_mesh(tmp_path / "a.nc").geographic
    assert not read_mesh(tmp_path / "a.nc", geographic=False).geographic
    write_mesh(tmp_path / "a.off", Mesh(points, quads))
    assert not read_mesh(tmp_path / "a.off").geographic
    mesh = read_mesh(tmp_path / "a.off", geographic=True)
    result = smooth(mesh, "star")
    write_mesh(tmp_path / "b.off", result.mesh)
    assert np.array_equal(read_mesh(tmp_path / "b.off").points, result.points)
    assert math.isclose(result.quality_after.min_angle.min(), quality(result.mesh).min_angle.min())


def test_a_real_shore_in_degrees(shared_meshes):
    rows = (shared_meshes / "superior_lonlat.poly").read_text().splitlines()
    table = [list(map(float, row.split())) for row in rows if row and row[0] != "#"]
    shore = np.array([row[1:3] for row in table[1 : 1 + int(table[0][0])] if row[3] == 1])
    metres = Projection(shore).project(shore)
    # A ring of quads inside the shore, and one more towards its middle.
    rings = [metres + share * (metres.mean(axis=0) - metres) for share in (0.0, 0.2, 0.3, 0.6)]
    n = len(shore)
    quads = [
        (k * n + i, k * n + (i + 1) % n, (k + 1) * n + (i + 1) % n, (k + 1) * n + i)
        for k in range(3)
        for i in range(n)
    ]
    degrees = np.concatenate([shore, *(Projection(shore).unproject(ring) for ring in rings[1:])])
    mesh = Mesh(degrees, quads, geographic=True)
    plane = Mesh(mesh.xy, quads)
    found, wanted = smooth(mesh, "star", max_sweeps=30), smooth(plane, "star", max_sweeps=30)
    assert found.quality_after.min_angle.min() == pytest.approx(
        wanted.quality_after.min_angle.min(), abs=0.01
    )
    assert found.quality_after.max_angle.max() == pytest.approx(
        wanted.quality_after.max_angle.max(), abs=0.01
    )
