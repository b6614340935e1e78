"""The plane of a mesh whose points have a third coordinate."""

from __future__ import annotations

import numpy as np

from qsmooth._types import BoolArray, FloatArray
from qsmooth.checks import read_only
from qsmooth.errors import MeshError

# Points may leave their common plane by this fraction of the mesh's diameter.
PLANE_TOLERANCE = 1e-9
# Rounding beyond this fraction of the diameter is no excuse.
MOST_ROUNDING = 1e-5
# Points may leave it by the rounding of boundary coordinates with at most so many digits.
FEW_DIGITS = 9


class Plane:
    """A plane in space: an origin and two unit axes, (2, 3).

    Points may leave it by `tolerance`: a small fraction of the diameter, or more where the
    coordinates are rounded. That is told by those on the boundary, which no smoothing moves.
    """

    def __init__(
        self, origin: FloatArray, axes: FloatArray, diameter: float, boundary: FloatArray
    ) -> None:
        self.origin, self.axes, self.diameter = origin, axes, diameter
        self.normal = np.cross(axes[0], axes[1])
        self.tolerance = PLANE_TOLERANCE * diameter
        if np.abs((boundary - origin) @ self.normal).max(initial=0.0) > self.tolerance:
            rounding = min(_rounding(boundary), MOST_ROUNDING * diameter)
            self.tolerance = max(self.tolerance, rounding)

    def xy(self, points: FloatArray) -> FloatArray:
        """Coordinates of points in the plane's own axes, (n, 2)."""
        return np.ascontiguousarray((points - self.origin) @ self.axes.T)

    def displacement(self, xy: FloatArray) -> FloatArray:
        """Turn displacements along the axes, (n, 2), into ones in space, (n, 3)."""
        in_space: FloatArray = xy @ self.axes
        return in_space

    def require(self, points: FloatArray) -> None:
        """Raise a `MeshError` where points leave the plane."""
        off = np.abs((points - self.origin) @ self.normal)
        if off.max() > self.tolerance:
            raise MeshError(
                "the points do not lie in one plane: they leave it by up to "
                f"{off.max():.3g}, in a mesh {self.diameter:.3g} across; if z is a value on a flat "
                "mesh (a depth, say), use surface='flat' (--surface flat)"
            )


def find_plane(points: FloatArray, used: BoolArray, is_boundary: BoolArray) -> Plane | None:
    """Find the plane of the used points, (n, 3); None where it is that of x and y.

    Raises
    ------
    MeshError
        If they lie in no plane.
    """
    corners = points[used]
    if is_level(corners):
        return None
    low, high = corners.min(axis=0), corners.max(axis=0)
    diameter = float(np.linalg.norm(high - low))
    # The mean lies in the plane; the middle of the bounding box need not.
    origin = corners.mean(axis=0)
    # The triangular factor of all the points spans the same plane; its SVD is 3 by 3.
    factor = np.linalg.qr(corners - origin, mode="r")
    axes = np.linalg.svd(factor)[2]
    normal = np.cross(axes[0], axes[1])
    # Look at the plane from the side that its largest component faces.
    if normal[np.argmax(np.abs(normal))] < 0.0:
        axes[1] = -axes[1]
    plane = Plane(origin, axes[:2], diameter, points[is_boundary])
    plane.require(corners)
    return plane


def is_level(corners: FloatArray) -> bool:
    """Whether z is constant."""
    spans = np.ptp(corners, axis=0)
    return bool(spans[2] <= PLANE_TOLERANCE * np.linalg.norm(spans))


def coordinates(points: FloatArray, plane: Plane | None) -> FloatArray:
    """Coordinates in the plane of the mesh, (n, 2), read-only: x and y where there is no plane."""
    if plane is None:
        return read_only(np.ascontiguousarray(points[:, :2]))
    return read_only(plane.xy(points))


def _rounding(corners: FloatArray) -> float:
    """How far coordinates may be off for having been rounded to float32, or to a few digits."""
    sizes = np.abs(corners[corners != 0.0])
    largest = float(sizes.max())
    if np.array_equal(corners.astype(np.float32), corners):
        return largest * float(np.finfo(np.float32).eps)
    exponents = np.floor(np.log10(sizes))
    for digits in range(1, FEW_DIGITS + 1):
        unit = np.maximum(10.0 ** (exponents + 1 - digits), np.finfo(np.float64).tiny)
        if (np.abs(np.round(sizes / unit) * unit - sizes) <= 1e-15 * sizes).all():
            return float(unit.max())
    return 0.0
