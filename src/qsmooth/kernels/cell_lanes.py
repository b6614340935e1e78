"""Cells in lanes: the corners of a block's cells of one kind, and what a corner of each says.

Scratch is rows of lanes in one flat array, as in `lanes`. A mixed block is gone through once for
its quads and once for its triangles, so that order and mixture of the cells cost next to nothing.
"""

import math

import numpy as np

from qsmooth._types import FloatArray, IndexArray
from qsmooth.kernels._jit import helper, kernel, lane_helper
from qsmooth.kernels.blocks import LANES, lane_row
from qsmooth.kernels.corner_energy import INV_ROOT3
from qsmooth.kernels.geometry import certainly_left

# Cells that share one piece of scratch memory: the grain of the parallel loops.
CELLS_A_CHUNK = 16 * LANES
# Rows of coordinates, of up to four corners.
X0, Y0, X1, Y1, X2, Y2, X3, Y3 = (lane_row(k) for k in range(8))
N_PLACES = 8
# Rows of what `look_at_quads` and `look_at_triangles` find.
LOW, HIGH, SHAPE, SURE = (lane_row(k) for k in range(4))
# Coefficients of the arctangent, of FreeBSD's msun (s_atan.c): under one unit in the last place
# between −7/16 and 7/16.
ATAN = (
    3.33333333333329318027e-01, -1.99999999998764832476e-01, 1.42857142725034663711e-01,
    -1.11111104054623557880e-01, 9.09088713343650656196e-02, -7.69187620504482999495e-02,
    6.66107313738753120669e-02, -5.83357013379057348645e-02, 4.97687799461593236017e-02,
    -3.65315727442169155270e-02, 1.62858201153657823623e-02,
)  # fmt: skip
# Where the diamond measure has 22.5° and 67.5°: between these, what 45° leaves is near nothing.
LOW_EIGHTH = 1.0 - math.sqrt(0.5)
HIGH_EIGHTH = math.sqrt(0.5)
DEGREES = 180.0 / math.pi


def n_chunks(n_cells: int) -> int:
    """Count the chunks of so many cells."""
    return -(-n_cells // CELLS_A_CHUNK)


@helper()
def gather_cells(
    xy: FloatArray,
    cell_offsets: IndexArray,
    cell_vertices: IndexArray,
    first: int,
    last: int,
    n_corners: int,
    cells: IndexArray,
    p: FloatArray,
) -> int:
    """Fetch the corners of those cells from `first` to before `last` that have so many.

    Parameters
    ----------
    cells : (LANES,)
        Scratch, overwritten: the cell in each lane.
    p
        Scratch, overwritten: two rows for each corner, x and y.

    Returns
    -------
    n
        Lanes that are taken.
    """
    n = 0
    for c in range(first, last):
        k = np.uint64(cell_offsets[c])
        if cell_offsets[c + 1] - cell_offsets[c] == n_corners:
            cells[n] = c
            at = np.uint64(n)
            for i in range(n_corners):
                v = np.uint64(cell_vertices[k + np.uint64(i)])
                row = at + np.uint64(i) * X1
                p[row], p[row + Y0] = xy[v, 0], xy[v, 1]
            n += 1
    return n


@helper()
def store_lanes(s: FloatArray, row: int, cells: IndexArray, n: int, out: FloatArray) -> None:
    """Write a row of lanes to the cells' places."""
    first = np.uint64(cells[0])
    if cells[n - 1] - cells[0] == n - 1:  # without gaps, as in a block of one kind
        for i in range(n):
            out[first + np.uint64(i)] = s[row + np.uint64(i)]
    else:
        for i in range(n):
            out[cells[i]] = s[row + np.uint64(i)]


@lane_helper()
def diamond_angle(det: float, dot: float) -> float:
    """Stand-in for a corner's angle that grows with it, from 0 to just under 4 in a full turn.

    By selects alone, as loops over lanes ask for.
    """
    total = abs(det) + abs(dot)
    left, ahead = det >= 0.0, dot >= 0.0
    part = abs(det) if left == ahead else abs(dot)
    quarter = (0.0 if ahead else 1.0) if left else (3.0 if ahead else 2.0)
    # At an edge of no length there is no angle.
    diamond = quarter + part / (total if total != 0.0 else 1.0)
    # A turn short of a full one by less than rounding is none.
    return diamond if diamond != 4.0 else 0.0


@lane_helper()
def corner_figures(
    ax: float, ay: float, bx: float, by: float, dx: float, dy: float
) -> tuple[float, float, float, float]:
    """Look at the corner a between its next vertex b and its previous vertex d.

    Returns
    -------
    diamond
        Its angle as `diamond_angle` gives it.
    det, half
        The determinant of its edges, and half the sum of their squares.
    sure
        1 where it is positive beyond any rounding error, else 0.
    """
    ux, uy, wx, wy = bx - ax, by - ay, dx - ax, dy - ay
    det, dot = ux * wy - uy * wx, ux * wx + uy * wy
    half = 0.5 * (ux * ux + uy * uy) + 0.5 * (wx * wx + wy * wy)
    diamond = diamond_angle(det, dot)
    return diamond, det, half, 1.0 if certainly_left(bx, by, dx, dy, ax, ay) else 0.0


@helper()
def look_at_quads(p: FloatArray, n: int, s: FloatArray) -> None:
    """Find what is asked of every cell.

    Parameters
    ----------
    p
        Corners, as by `gather_cells`.
    s
        Scratch, overwritten: the rows `LOW` and `HIGH`, extreme angles in the diamond measure;
        `SHAPE`, the worst corner's mean ratio, 0 where a corner is not positive; `SURE`, 1 where
        all corners are positive beyond any rounding error, else 0.
    """
    for i in range(n):
        ax, ay, bx, by = p[X0 + i], p[Y0 + i], p[X1 + i], p[Y1 + i]
        cx, cy, dx, dy = p[X2 + i], p[Y2 + i], p[X3 + i], p[Y3 + i]
        a, a_det, a_half, a_sure = corner_figures(ax, ay, bx, by, dx, dy)
        b, b_det, b_half, b_sure = corner_figures(bx, by, cx, cy, ax, ay)
        c, c_det, c_half, c_sure = corner_figures(cx, cy, dx, dy, bx, by)
        d, d_det, d_half, d_sure = corner_figures(dx, dy, ax, ay, cx, cy)
        a_det = a_det / a_half if a_half > 0.0 else 0.0
        b_det = b_det / b_half if b_half > 0.0 else 0.0
        c_det = c_det / c_half if c_half > 0.0 else 0.0
        d_det = d_det / d_half if d_half > 0.0 else 0.0
        lost = 0.0 * (a_half + c_half)  # NaN where a coordinate is, else 0
        s[LOW + i] = min(min(a, b), min(c, d)) + lost
        s[HIGH + i] = max(max(a, b), max(c, d)) + lost
        s[SHAPE + i] = max(min(min(a_det, b_det), min(c_det, d_det)), 0.0) + lost
        s[SURE + i] = a_sure * b_sure * c_sure * d_sure


@helper()
def look_at_triangles(p: FloatArray, n: int, s: FloatArray) -> None:
    """Do as `look_at_quads`; the shape of a triangle is the same at each corner."""
    for i in range(n):
        ax, ay, bx, by = p[X0 + i], p[Y0 + i], p[X1 + i], p[Y1 + i]
        cx, cy = p[X2 + i], p[Y2 + i]
        a, det, half, a_sure = corner_figures(ax, ay, bx, by, cx, cy)
        b, _, _, b_sure = corner_figures(bx, by, cx, cy, ax, ay)
        c, _, _, c_sure = corner_figures(cx, cy, ax, ay, bx, by)
        ex, ey = (cx - ax) - (bx - ax), (cy - ay) - (by - ay)
        half = INV_ROOT3 * (half + 0.5 * (ex * ex + ey * ey))
        lost = 0.0 * half
        s[LOW + i], s[HIGH + i] = min(min(a, b), c) + lost, max(max(a, b), c) + lost
        s[SHAPE + i] = max(det / half if half > 0.0 else 0.0, 0.0) + lost
        s[SURE + i] = a_sure * b_sure * c_sure


@helper()
def look_at_cells(
    xy: FloatArray,
    cell_offsets: IndexArray,
    cell_vertices: IndexArray,
    first: int,
    last: int,
    n_corners: int,
    cells: IndexArray,
    p: FloatArray,
    s: FloatArray,
) -> int:
    """Look at those of some cells that have so many corners; how many there are.

    Parameters are those of `gather_cells`, and the scratch of `look_at_quads`.
    """
    n = gather_cells(xy, cell_offsets, cell_vertices, first, last, n_corners, cells, p)
    if n_corners == 4:
        look_at_quads(p, n, s)
    else:
        look_at_triangles(p, n, s)
    return n


@lane_helper()
def degrees_of(diamond: float) -> float:
    """Angle in degrees, in [0, 360), of what `diamond_angle` gives; to two units or so."""
    quarter = np.floor(diamond)
    part = diamond - quarter
    rest = 1.0 - part
    low, middle = part < 0.5, (part > LOW_EIGHTH) & (part < HIGH_EIGHTH)
    edge = (part if low else -rest) / (rest if low else part)
    x = part - rest if middle else edge
    start = 45.0 if middle else (0.0 if low else 90.0)
    z = x * x
    w = z * z
    a = ATAN
    odd = z * (a[0] + w * (a[2] + w * (a[4] + w * (a[6] + w * (a[8] + w * a[10])))))
    even = w * (a[1] + w * (a[3] + w * (a[5] + w * (a[7] + w * a[9]))))
    return float((90.0 * quarter + start) + DEGREES * (x - x * (odd + even)))


@kernel()
def in_degrees(angles: FloatArray) -> None:
    """Turn what `diamond_angle` gives into degrees, in place."""
    for k in range(angles.size):
        angles[k] = degrees_of(angles[k])
