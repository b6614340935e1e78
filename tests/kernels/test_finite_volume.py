"""How inner edges lie to their cells: by hand, against slow versions and against MeshKernel."""

import math

import numpy as np
import pytest

from meshes import KINDS, random_mesh
from qsmooth import Mesh, quality


def slow_centroid(corners):
    x, y = corners.T
    x2, y2 = np.roll(x, -1), np.roll(y, -1)
    cross = x * y2 - x2 * y
    return np.array([((x + x2) * cross).sum(), ((y + y2) * cross).sum()]) / (3.0 * cross.sum())


def slow_circumcentre(corners):
    ends = np.roll(corners, -1, axis=0)
    along = (ends - corners) / np.linalg.norm(ends - corners, axis=1)[:, None]
    centre = np.linalg.lstsq(along, (along * 0.5 * (ends + corners)).sum(axis=1))[0]
    if len(corners) == 4:
        return centre
    middle = corners.mean(axis=0)
    shares = []
    for a, b in zip(corners, ends, strict=True):
        normal = np.array([b[1] - a[1], a[0] - b[0]])
        if normal @ (centre - a) > 0.0:
            shares.append(normal @ (a - middle) / (normal @ (centre - middle)))
    return middle + min([1.0, *shares]) * (centre - middle)


def cosine(a, b, one, other):
    e, d = b - a, other - one
    return abs(e @ d) / math.sqrt((e @ e) * (d @ d))


def degrees_off(a, b, one, other):
    normal, d = np.array([b[1] - a[1], a[0] - b[0]]), other - one
    return math.degrees(
        math.acos(np.clip(normal @ d / math.sqrt(normal @ normal * (d @ d)), -1, 1))
    )


def openfoam_skewness(a, b, one, other):
    """primitiveMeshTools::faceSkewness, of the edge as a face of a layer of any thickness."""
    normal, d, middle = np.array([b[1] - a[1], a[0] - b[0]]), other - one, 0.5 * (a + b)
    out = middle - one
    skew = out - (normal @ out) / (normal @ d) * d
    size = math.sqrt(skew @ skew)
    if size == 0.0:
        return 0.0
    reach = 0.2 * math.sqrt(d @ d)
    for end in (a, b):
        reach = max(reach, abs(skew @ (end - middle)) / size)
    return size / reach


SLOW = {
    "orthogonality": (slow_circumcentre, cosine),
    "non_orthogonality": (slow_centroid, degrees_off),
    "skewness": (slow_centroid, openfoam_skewness),
}


def slow_worst(mesh, name):
    centre, measure = SLOW[name]
    cells = np.split(mesh.cell_vertices, mesh.cell_offsets[1:-1])
    centres = [centre(mesh.xy[cell]) for cell in cells]
    sides = {}
    for c, cell in enumerate(cells):
        for a, b in zip(cell, np.roll(cell, -1), strict=True):
            sides[int(a), int(b)] = c
    worst = np.full(len(cells), np.nan)
    for (a, b), c in sides.items():
        n = sides.get((b, a))
        if n is not None:
            value = measure(mesh.xy[a], mesh.xy[b], centres[c], centres[n])
            worst[c] = np.fmax(worst[c], value)
    return worst


@pytest.mark.nojit
@pytest.mark.parametrize("name", SLOW)
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("seed", range(2))
def test_as_the_slow_version(name, kind, seed):
    mesh = random_mesh(kind, 4, seed=seed, amount=0.9, turned=0.5).mesh
    tolerance = 1e-5 if name == "non_orthogonality" else 1e-8  # the slow one's arccos
    np.testing.assert_allclose(
        quality(mesh)[name], slow_worst(mesh, name), rtol=1e-8, atol=tolerance
    )


def two_quads(shift):
    """A unit square, and beside it one whose far side is `shift` higher."""
    points = [(0, 0), (1, 0), (1, 1), (0, 1), (2, shift), (2, 1 + shift)]
    return Mesh(points, [(0, 1, 2, 3), (1, 4, 5, 2)])


@pytest.mark.nojit
def test_a_sheared_neighbour_by_hand():
    own = quality(two_quads(0.4))
    # Centroids at (0.5, 0.5) and (1.5, 0.7): the line crosses the edge at y = 0.6.
    assert own.non_orthogonality == pytest.approx([math.degrees(math.atan(0.2))] * 2)
    assert own.skewness == pytest.approx([0.2, 0.2])


@pytest.mark.nojit
def test_a_short_edge_is_skew_by_the_distance_of_the_centres():
    points = [(0, 0), (10, 0), (10, 1), (0, 1), (20, 2), (20, 3)]
    own = quality(Mesh(points, [(0, 1, 2, 3), (1, 4, 5, 2)]))
    assert own.skewness == pytest.approx([0.5 / (0.2 * math.hypot(10.0, 1.0))] * 2)


@pytest.mark.nojit
def test_a_cyclic_trapezium_has_its_circumcentre():
    # All bisectors meet at the origin.
    turn = np.radians([200.0, 340.0, 20.0, 160.0])
    points = np.stack([np.cos(turn), np.sin(turn)], axis=1)
    beside = np.concatenate([points, [(2.0, points[1, 1]), (2.0, points[2, 1])]])
    own = quality(Mesh(beside, [(0, 1, 2, 3), (1, 4, 5, 2)]))
    assert own.orthogonality == pytest.approx([0.0, 0.0], abs=1e-12)


@pytest.mark.nojit
def test_circumcentres_at_one_place_count_as_the_worst():
    # Two halves of a square: both circumcentres are in the middle of the cut.
    own = quality(([(0, 0), (1, 0), (1, 1), (0, 1)], [(0, 1, 2), (0, 2, 3)]))
    assert own.orthogonality.tolist() == [1.0, 1.0]


@pytest.mark.nojit
def test_far_from_the_origin_nothing_is_lost():
    mesh = random_mesh("mixed", 4, seed=1, amount=0.8).mesh
    near = Mesh(np.round(mesh.points * 2.0**20) / 2.0**20, mesh.cells)
    far = near.with_points(near.points + 2.0**22)
    for name in SLOW:
        np.testing.assert_allclose(quality(far)[name], quality(near)[name], rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("seed", range(4))
def test_triangles_agree_with_meshkernel(seed):
    meshkernel = pytest.importorskip("meshkernel")
    # Its smallest distances are absolute: a mesh of some size.
    mesh = random_mesh("triangles", 6, seed=seed, amount=0.8, scale=100.0).mesh
    tails = mesh.cell_vertices
    heads = np.roll(tails.reshape(-1, 3), -1, axis=1).ravel()
    edges = np.unique(np.sort(np.stack([tails, heads], axis=1), axis=1), axis=0)
    x, y = (np.ascontiguousarray(mesh.xy[:, i]) for i in (0, 1))
    kernel = meshkernel.MeshKernel()
    kernel.mesh2d_set(meshkernel.Mesh2d(x, y, edges.astype(np.int32).ravel()))
    their_edges = kernel.mesh2d_get().edge_nodes.reshape(-1, 2)
    theirs = dict(
        zip(
            map(tuple, np.sort(their_edges, axis=1).tolist()),
            kernel.mesh2d_get_orthogonality().values.tolist(),
            strict=True,
        )
    )
    sides = np.sort(np.stack([tails, heads], axis=1), axis=1).tolist()
    values = np.array([theirs[tuple(side)] for side in sides]).reshape(-1, 3)
    expected = np.max(np.where(values == -999.0, -1.0, values), axis=1)
    np.testing.assert_allclose(quality(mesh).orthogonality, expected, atol=1e-9)
