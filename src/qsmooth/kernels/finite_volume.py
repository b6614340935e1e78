"""What solvers on cell centres ask of a mesh: how each inner edge lies to its two cells.

Each cell gets the worst of its inner edges, and NaN only where it has none. What has no direction,
such as an edge of no length, counts as the worst that can be, and so does a coordinate that is NaN.
Centres are kept as seen from the cell's first vertex: far from the origin, as in map coordinates,
differences of coordinates are exact and coordinates of centres are not.
"""

import math

import numpy as np
from numba import prange

from qsmooth._types import FloatArray, IndexArray
from qsmooth.kernels._jit import helper, parallel_kernel
from qsmooth.kernels.geometry import distance

HALF_TURN = 180.0
# Centres nearer to each other than this share of their edge have no direction to speak of: files
# often keep no more than six or seven figures.
COINCIDENT = 1e-6
# OpenFOAM relates skewness to this share of the distance of the centres where the edge is shorter.
# (primitiveMeshTools::faceSkewness)
LEAST_SHARE = 0.2


@parallel_kernel()
def centroids(
    xy: FloatArray, cell_offsets: IndexArray, cell_vertices: IndexArray, out: FloatArray
) -> None:
    """Find the centre of gravity of each cell.

    Parameters
    ----------
    xy : (n_vertices, 2)
        Coordinates, in any one unit.
    cell_offsets, cell_vertices : (n_cells + 1,), (n_corners,)
        CSR map from a cell to its vertices, counter-clockwise.
    out : (n_cells, 2)
        Overwritten. As seen from the cell's first vertex; NaN where the area is not positive.
    """
    for c in prange(len(out)):
        first, last = cell_offsets[c], cell_offsets[c + 1]
        a = cell_vertices[first]
        area, x, y = 0.0, 0.0, 0.0
        for k in range(first + 1, last - 1):
            b, d = cell_vertices[k], cell_vertices[k + 1]
            ux, uy = xy[b, 0] - xy[a, 0], xy[b, 1] - xy[a, 1]
            wx, wy = xy[d, 0] - xy[a, 0], xy[d, 1] - xy[a, 1]
            part = ux * wy - uy * wx
            area += part
            x += part * (ux + wx)
            y += part * (uy + wy)
        out[c, 0] = x / (3.0 * area) if area > 0.0 else np.nan
        out[c, 1] = y / (3.0 * area) if area > 0.0 else np.nan


@helper()
def _leave_cell(
    xy: FloatArray, cell_vertices: IndexArray, first: int, px: float, py: float
) -> tuple[float, float]:
    """Where the way from a triangle's middle to a point leaves it; the point where it does not."""
    a = cell_vertices[first]
    b, d = cell_vertices[first + 1], cell_vertices[first + 2]
    mx = (xy[b, 0] - xy[a, 0] + xy[d, 0] - xy[a, 0]) / 3.0
    my = (xy[b, 1] - xy[a, 1] + xy[d, 1] - xy[a, 1]) / 3.0
    share = 1.0
    for i in range(3):
        v = cell_vertices[first + i]
        w = cell_vertices[first + (i + 1) % 3]
        ex, ey = xy[w, 0] - xy[v, 0], xy[w, 1] - xy[v, 1]
        vx, vy = xy[v, 0] - xy[a, 0], xy[v, 1] - xy[a, 1]
        inside = ex * (my - vy) - ey * (mx - vx)
        beyond = ex * (py - vy) - ey * (px - vx)
        if beyond < 0.0:
            share = min(share, inside / (inside - beyond))
    return mx + share * (px - mx), my + share * (py - my)


@parallel_kernel()
def circumcentres(
    xy: FloatArray, cell_offsets: IndexArray, cell_vertices: IndexArray, out: FloatArray
) -> None:
    """Find the point nearest to the perpendicular bisectors of each cell's edges.

    Parameters
    ----------
    xy, cell_offsets, cell_vertices
        As in `centroids`.
    out : (n_cells, 2)
        Overwritten. As seen from the cell's first vertex; NaN where the area is not positive or
        an edge has no length.

    Notes
    -----
    In the sense of least squares of the distances. In a triangle that is the circumcentre; in an
    obtuse one it is outside, and its place is taken by the point where the way to it from the mean
    of the corners leaves the triangle, as in Deltares' MeshKernel.
    """
    for c in prange(len(out)):
        first, last = cell_offsets[c], cell_offsets[c + 1]
        a = cell_vertices[first]
        xx, x_y, yy, fx, fy, area, shortest = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, np.inf
        for k in range(first, last):
            v = cell_vertices[k]
            w = cell_vertices[k + 1] if k + 1 < last else a
            vx, vy = xy[v, 0] - xy[a, 0], xy[v, 1] - xy[a, 1]
            wx, wy = xy[w, 0] - xy[a, 0], xy[w, 1] - xy[a, 1]
            length = distance(xy[v, 0], xy[v, 1], xy[w, 0], xy[w, 1])
            area += vx * wy - vy * wx
            shortest = min(shortest, length)
            if not length > 0.0:
                continue
            tx, ty = (wx - vx) / length, (wy - vy) / length
            at = 0.5 * (tx * (vx + wx) + ty * (vy + wy))
            xx += tx * tx
            x_y += tx * ty
            yy += ty * ty
            fx += tx * at
            fy += ty * at
        det = xx * yy - x_y * x_y
        x, y = np.nan, np.nan
        if area > 0.0 and shortest > 0.0 and det > 0.0:
            x, y = (yy * fx - x_y * fy) / det, (xx * fy - x_y * fx) / det
            if last - first == 3:
                x, y = _leave_cell(xy, cell_vertices, first, x, y)
        out[c, 0] = x
        out[c, 1] = y


@helper()
def _inner_edge(
    xy: FloatArray,
    centres: FloatArray,
    cell_offsets: IndexArray,
    cell_vertices: IndexArray,
    corner_cells: IndexArray,
    twins: IndexArray,
    k: int,
) -> tuple[float, float, float, float, float, float]:
    """Edge vector of side `k`, the way from its cell's centre to the neighbour's, and to its tail.

    The edge as the cell that is numbered first runs along it: both cells then compute the same.
    """
    k = min(k, twins[k])
    c, n = corner_cells[k], corner_cells[twins[k]]
    v = cell_vertices[k]
    w = cell_vertices[k + 1 if k + 1 < cell_offsets[c + 1] else cell_offsets[c]]
    a, b = cell_vertices[cell_offsets[c]], cell_vertices[cell_offsets[n]]
    return (
        xy[w, 0] - xy[v, 0],
        xy[w, 1] - xy[v, 1],
        xy[b, 0] - xy[a, 0] + (centres[n, 0] - centres[c, 0]),
        xy[b, 1] - xy[a, 1] + (centres[n, 1] - centres[c, 1]),
        xy[v, 0] - xy[a, 0] - centres[c, 0],
        xy[v, 1] - xy[a, 1] - centres[c, 1],
    )


@parallel_kernel()
def orthogonality(
    xy: FloatArray,
    centres: FloatArray,
    cell_offsets: IndexArray,
    cell_vertices: IndexArray,
    corner_cells: IndexArray,
    twins: IndexArray,
    out: FloatArray,
) -> None:
    """Measure the cosine, without its sign, of an edge with the line of its cells' circumcentres.

    Parameters
    ----------
    xy, cell_offsets, cell_vertices
        As in `centroids`.
    centres : (n_cells, 2)
        By `circumcentres`.
    corner_cells, twins : (n_corners,)
        The cell of each corner position; the same edge's position in the neighbour, or -1.
    out : (n_cells,)
        Overwritten. From 0, perpendicular, to 1; 1 too where two centres are at one place or a
        cell has none, NaN without inner edges.
    """
    for c in prange(out.size):
        worst = np.nan
        for k in range(cell_offsets[c], cell_offsets[c + 1]):
            if twins[k] < 0:
                continue
            ex, ey, dx, dy, _, _ = _inner_edge(
                xy, centres, cell_offsets, cell_vertices, corner_cells, twins, k
            )
            length, way = math.sqrt(ex * ex + ey * ey), math.sqrt(dx * dx + dy * dy)
            cosine = 1.0
            if way > COINCIDENT * length and length > 0.0:
                cosine = min(1.0, abs(ex * dx + ey * dy) / length / way)
            worst = cosine if math.isnan(worst) else max(worst, cosine)
        out[c] = worst


@parallel_kernel()
def non_orthogonality(
    xy: FloatArray,
    centres: FloatArray,
    cell_offsets: IndexArray,
    cell_vertices: IndexArray,
    corner_cells: IndexArray,
    twins: IndexArray,
    out: FloatArray,
) -> None:
    """Measure the angle between an edge's normal and the line of its cells' centroids.

    Parameters
    ----------
    xy, cell_offsets, cell_vertices, corner_cells, twins
        As in `orthogonality`.
    centres : (n_cells, 2)
        By `centroids`.
    out : (n_cells,)
        Overwritten. Degrees from 0 to 180; 180 where one of the two cells has no positive area or
        the edge no length, NaN without inner edges.

    Notes
    -----
    As OpenFOAM's checkMesh measures non-orthogonality (primitiveMeshTools::faceOrthogonality).
    """
    for c in prange(out.size):
        worst = np.nan
        for k in range(cell_offsets[c], cell_offsets[c + 1]):
            if twins[k] < 0:
                continue
            ex, ey, dx, dy, _, _ = _inner_edge(
                xy, centres, cell_offsets, cell_vertices, corner_cells, twins, k
            )
            # Cells run counter-clockwise: (ey, -ex) points out of the cell, to the neighbour.
            along, across = ey * dx - ex * dy, ex * dx + ey * dy
            angle = HALF_TURN
            if abs(along) + abs(across) > 0.0:
                angle = math.degrees(math.atan2(abs(across), along))
            worst = angle if math.isnan(worst) else max(worst, angle)
        out[c] = worst


@parallel_kernel()
def skewness(
    xy: FloatArray,
    centres: FloatArray,
    cell_offsets: IndexArray,
    cell_vertices: IndexArray,
    corner_cells: IndexArray,
    twins: IndexArray,
    out: FloatArray,
) -> None:
    """Measure how far from an edge's middle the line of its cells' centroids crosses it.

    Parameters
    ----------
    xy, cell_offsets, cell_vertices, corner_cells, twins, centres
        As in `non_orthogonality`.
    out : (n_cells,)
        Overwritten. 0, through the middle, or more: 1 is at an end of the edge. Infinite where one
        of the two cells has no positive area, the edge no length, or the line does not cross its
        own; NaN without inner edges.

    Notes
    -----
    As OpenFOAM's checkMesh measures skewness (primitiveMeshTools::faceSkewness): the distance over
    half the edge, or over a fifth of that of the centroids where this is more.
    """
    for c in prange(out.size):
        worst = np.nan
        for k in range(cell_offsets[c], cell_offsets[c + 1]):
            if twins[k] < 0:
                continue
            ex, ey, dx, dy, px, py = _inner_edge(
                xy, centres, cell_offsets, cell_vertices, corner_cells, twins, k
            )
            along = ey * dx - ex * dy
            length = math.sqrt(ex * ex + ey * ey)
            skew = np.inf
            if abs(along) > 0.0 and length > 0.0:
                mx, my = px + 0.5 * ex, py + 0.5 * ey
                share = (ey * mx - ex * my) / along
                sx, sy = mx - share * dx, my - share * dy
                way = math.sqrt(dx * dx + dy * dy)
                skew = math.sqrt(sx * sx + sy * sy) / max(0.5 * length, LEAST_SHARE * way)
            worst = skew if math.isnan(worst) else max(worst, skew)
        out[c] = worst
