"""A small mesh, of which each library makes its own, and what is asked of all of them."""

import numpy as np

from qsmooth import as_mesh, compare, limits, quality, smooth, transfer, untangle

# Four by three squares, the middle vertices moved; the last row of triangles.
X, Y = (a.ravel().astype(float) for a in np.meshgrid(np.arange(5), np.arange(4)))
X[[6, 7, 8]] += [0.3, -0.25, 0.2]
Y[[6, 7, 8, 11]] += [0.25, 0.3, -0.2, 0.3]
POINTS = np.stack([X, Y], axis=1)
CORNERS = np.array([5 * j + i for j in range(3) for i in range(4)])
QUADS = np.stack([CORNERS, CORNERS + 1, CORNERS + 6, CORNERS + 5], axis=1)
TRIANGLES = np.concatenate([QUADS[8:, [0, 1, 2]], QUADS[8:, [0, 2, 3]]])
BED = POINTS @ [0.5, 2.0] + 3.0


def smoothed(obj, **options):
    """What comes back of an object, and the coordinates that it is to have."""
    result = smooth(obj, "star", max_sweeps=3, **options)
    assert result.after.n_invalid == 0
    assert np.abs(result.points - as_mesh(obj).points).max() > 0.05
    return result.back(), result.points


def all_ways_in(obj, same):
    """Everything that takes a mesh takes the object."""
    mesh = as_mesh(obj)
    assert quality(obj).extreme_angles == quality(mesh).extreme_angles
    assert limits(obj) == limits(mesh)
    assert same(untangle(obj).back(), obj)
    results, _ = compare(obj, ["laplacian"], max_sweeps=1)
    assert type(results["laplacian"].back()) is type(obj)
    values = np.arange(mesh.n_vertices, dtype=float)
    assert np.array_equal(transfer(obj, obj, values), values)
