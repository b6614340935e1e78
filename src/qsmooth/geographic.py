"""Longitudes and latitudes: a plane about the mesh in which angles are those on the Earth.

The ellipsoid is mapped onto a sphere by the conformal latitude, and that onto a plane by the
oblique stereographic projection. Both are conformal, so that every angle of every cell is a true
one. Lengths are true at the middle of the mesh, and off by 0.15 % at 500 km from there.

Snyder, "Map Projections: A Working Manual", USGS Professional Paper 1395, 1987, pages 160 to 162:
equation 3-1 for the conformal latitude, 21-24, 21-25 and 21-27 for the projection, 21-36 to 21-38
for its inverse.
"""

from __future__ import annotations

import math

import numpy as np

from qsmooth._types import BoolArray, FloatArray
from qsmooth.errors import MeshError

# WGS 84: half the larger axis in metres, flattening.
SEMI_AXIS, FLATTENING = 6378137.0, 1 / 298.257223563
ECCENTRICITY = math.sqrt(FLATTENING * (2.0 - FLATTENING))
# The middle is rounded to this, in degrees: moves of a few vertices leave it where it is.
GRAIN = 0.01
# Nor may it be a pole, where there is no east.
MOST_NORTH = 89.99
# Cosine of the largest distance from the middle, 135°: beyond, the plane is stretched too far.
FARTHEST = -0.7
# A step of the iteration for the latitude leaves 1/150 of its error.
STEPS = 9
# Degrees east in which directions are measured.
EAST = 1e-5
# Coordinates look like degrees if they lie so many of their extents off zero.
OFF_ZERO, LARGEST_EXTENT = 2.0, 30.0
# Or, over seas, so many degrees and so much of their extent, with no bound on a whole degree and
# this many vertices: meshes in lengths mostly begin and end at round numbers.
OFF_ORIGIN, OFF_SHARE, SEA = 5.0, 0.15, 200


class Projection:
    """A conformal projection of longitudes and latitudes, about the middle of some points.

    Parameters
    ----------
    points : (n, 2) or (n, 3)
        Longitudes and latitudes in degrees; a third column is no matter.

    Raises
    ------
    MeshError
        If they are none, or lie all over the globe.
    """

    def __init__(self, points: FloatArray) -> None:
        require_degrees(points)
        longitudes = points[:, 0]
        # Longitudes stay in the turn that all are in.
        self.west = next(
            (w for w in (-180.0, 0.0) if ((longitudes >= w) & (longitudes <= w + 360.0)).all()),
            None,
        )
        space = _in_space(points)
        middle = 0.5 * (space.min(axis=0) + space.max(axis=0))
        if not np.linalg.norm(middle) > 1e-3:
            raise MeshError("the mesh goes round the globe, and has no middle to project it from")
        north = math.degrees(math.atan2(middle[2], math.hypot(middle[0], middle[1])))
        east = math.degrees(math.atan2(middle[1], middle[0]))
        self.longitude = round(east / GRAIN) * GRAIN
        self.latitude = min(max(round(north / GRAIN) * GRAIN, -MOST_NORTH), MOST_NORTH)
        phi = math.radians(self.latitude)
        self._chi = float(_conformal(np.array(phi)))
        shrink = math.cos(phi) / math.sqrt(1.0 - (ECCENTRICITY * math.sin(phi)) ** 2)
        self._diameter = 2.0 * SEMI_AXIS * shrink / math.cos(self._chi)
        if (space @ _in_space(np.array([[self.longitude, self.latitude]]))[0]).min() < FARTHEST:
            raise MeshError("the mesh goes round the globe, which no plane shows without a tear")

    def project(self, points: FloatArray) -> FloatArray:
        """Places in metres, (n, 2), of longitudes and latitudes in degrees, (n, 2) or (n, 3)."""
        east = np.radians(np.remainder(points[:, 0] - self.longitude + 180.0, 360.0) - 180.0)
        chi = _conformal(np.radians(points[:, 1]))
        sin, cos, sin_0, cos_0 = np.sin(chi), np.cos(chi), math.sin(self._chi), math.cos(self._chi)
        stretch = self._diameter / (1.0 + sin_0 * sin + cos_0 * cos * np.cos(east))
        # The same as cos_0 * sin - sin_0 * cos * cos(east), and exact near the middle.
        north = np.sin(chi - self._chi) + 2.0 * sin_0 * cos * np.sin(0.5 * east) ** 2
        return np.ascontiguousarray(
            np.column_stack([stretch * cos * np.sin(east), stretch * north])
        )

    def unproject(self, xy: FloatArray) -> FloatArray:
        """Longitudes and latitudes in degrees, (n, 2), of places in metres."""
        x, y = xy[:, 0], xy[:, 1]
        far = np.hypot(x, y)
        angle = 2.0 * np.arctan(far / self._diameter)
        share = np.sin(angle) / np.where(far > 0.0, far, 1.0)  # sin(c) / rho
        cos, sin_0, cos_0 = np.cos(angle), math.sin(self._chi), math.cos(self._chi)
        ahead, up = cos_0 * cos - y * share * sin_0, sin_0 * cos + y * share * cos_0
        chi = np.arctan2(up, np.hypot(ahead, x * share))
        longitude = self.longitude + np.degrees(np.arctan2(x * share, ahead))
        if self.west is not None:
            longitude = np.where(longitude < self.west, longitude + 360.0, longitude)
            longitude = np.where(longitude > self.west + 360.0, longitude - 360.0, longitude)
        return np.column_stack([longitude, np.degrees(_geographic(chi))])

    def unrolled(self, points: FloatArray) -> FloatArray:
        """Degrees, (n, 2), as coordinates of a plane without a jump where longitudes begin anew."""
        longitude = points[:, 0].copy()
        longitude[longitude > self.longitude + 180.0] -= 360.0
        longitude[longitude < self.longitude - 180.0] += 360.0
        return np.column_stack([longitude, points[:, 1]])

    def turned(self, points: FloatArray, vectors: FloatArray) -> FloatArray:
        """Vectors that go east and north at points, (n, 2), along the axes of the plane."""
        behind, ahead = (np.column_stack([points[:, 0] + by, points[:, 1]]) for by in (-EAST, EAST))
        step = self.project(ahead) - self.project(behind)
        cos, sin = (step / np.hypot(step[:, 0], step[:, 1])[:, None]).T
        east, north = vectors[:, 0], vectors[:, 1]
        return np.column_stack([cos * east - sin * north, sin * east + cos * north])


def require_degrees(points: FloatArray) -> None:
    """Refuse what are no longitudes and latitudes.

    Raises
    ------
    MeshError
        With the number of offenders and the first of them.
    """
    bad = no_degrees(points)
    if bad.any():
        vertex = int(np.argmax(bad))
        raise MeshError(
            "geographic coordinates are longitudes within ±360 and latitudes within ±90; of "
            f"{int(bad.sum())} vertices they are not, the first is vertex {vertex}: "
            f"{points[vertex, 0]:g}, {points[vertex, 1]:g}"
        )


def no_degrees(points: FloatArray) -> BoolArray:
    """Mark points that are no longitude and latitude."""
    bad: BoolArray = ~((np.abs(points[:, 0]) <= 360.0) & (np.abs(points[:, 1]) <= 90.0))
    return bad


def look_like_degrees(points: FloatArray) -> bool:
    """Whether coordinates may be degrees: those of a lake, a coast or a sea, away from zero."""
    if no_degrees(points).any():
        return False
    low, high = points[:, :2].min(axis=0), points[:, :2].max(axis=0)
    extent = float((high - low).max())
    nearest = np.minimum(np.abs(low), np.abs(high))
    off = (low * high > 0.0) & (nearest >= OFF_ZERO * extent)
    near = 0.0 < extent <= LARGEST_EXTENT and off.any() and nearest.max() >= 1.0
    return bool(near or _look_like_a_sea(points, low, high))


def _look_like_a_sea(points: FloatArray, low: FloatArray, high: FloatArray) -> bool:
    """Whether coordinates may be degrees of a sea, which may be near to zero for its size."""
    nearest = np.where(low * high > 0.0, np.minimum(np.abs(low), np.abs(high)), 0.0)
    off = (nearest >= OFF_ORIGIN) & (nearest >= OFF_SHARE * (high - low))
    whole = np.concatenate((low, high)) % 1.0 == 0.0
    large = (high - low >= OFF_ORIGIN).all() and high[0] - low[0] < 180.0
    return bool(len(points) >= SEA and off.any() and large and not whole.any())


def _in_space(points: FloatArray) -> FloatArray:
    """Unit vectors, (n, 3)."""
    east, north = np.radians(points[:, 0]), np.radians(points[:, 1])
    level = np.cos(north)
    return np.column_stack([level * np.cos(east), level * np.sin(east), np.sin(north)])


def _conformal(phi: FloatArray) -> FloatArray:
    """Conformal latitude, radians."""
    sin = np.sin(phi)
    isometric = np.arcsinh(np.tan(phi)) - ECCENTRICITY * np.arctanh(ECCENTRICITY * sin)
    chi: FloatArray = np.arctan(np.sinh(isometric))
    return chi


def _geographic(chi: FloatArray) -> FloatArray:
    """Latitude of a conformal latitude, radians."""
    isometric, phi = np.arcsinh(np.tan(chi)), chi
    for _ in range(STEPS):
        stretch = ECCENTRICITY * np.arctanh(ECCENTRICITY * np.sin(phi))
        phi = np.arctan(np.sinh(isometric + stretch))
    return phi
