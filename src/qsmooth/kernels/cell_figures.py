"""The figures of every cell that reports ask for first, all in one pass: see `metrics.quality`."""

import math

import numpy as np
from numba import prange

from qsmooth._types import FloatArray, IndexArray
from qsmooth.kernels._jit import helper, parallel_kernel
from qsmooth.kernels.blocks import LANES, lane_row
from qsmooth.kernels.cell_lanes import (
    CELLS_A_CHUNK,
    HIGH,
    LOW,
    N_PLACES,
    SHAPE,
    SURE,
    X0,
    X1,
    X2,
    X3,
    Y0,
    Y1,
    Y2,
    Y3,
    degrees_of,
    look_at_cells,
    store_lanes,
)
from qsmooth.kernels.geometry import TRIANGLE_SCALE

# Rows of what comes out; each is the metric of that name.
MIN_ANGLE, MAX_ANGLE, ASPECT_RATIO, SCALED_JACOBIAN, SHAPES, AREA = range(6)
N_FIGURES = 6
# Rows of lanes after those of `look_at_quads`.
RATIO, SINE, SIZE, DOUBT = (lane_row(k) for k in range(4, 8))
N_ROWS = 8
# Where the figures are, in their order.
ROWS = LOW, HIGH, RATIO, SINE, SHAPE, SIZE


@helper()
def _measure_quads(p: FloatArray, n: int, s: FloatArray) -> None:
    """Measure edges, sines and areas of quads in lanes."""
    for i in range(n):
        ax, ay, bx, by = p[X0 + i], p[Y0 + i], p[X1 + i], p[Y1 + i]
        cx, cy, dx, dy = p[X2 + i], p[Y2 + i], p[X3 + i], p[Y3 + i]
        abx, aby, bcx, bcy = bx - ax, by - ay, cx - bx, cy - by
        cdx, cdy, dax, day = dx - cx, dy - cy, ax - dx, ay - dy
        ab, bc = math.sqrt(abx * abx + aby * aby), math.sqrt(bcx * bcx + bcy * bcy)
        cd, da = math.sqrt(cdx * cdx + cdy * cdy), math.sqrt(dax * dax + day * day)
        a, b = dax * aby - day * abx, abx * bcy - aby * bcx
        c, d = bcx * cdy - bcy * cdx, cdx * day - cdy * dax
        shortest, longest = min(min(ab, bc), min(cd, da)), max(max(ab, bc), max(cd, da))
        a = a / (da * ab) if da * ab > 0.0 else 0.0
        b = b / (ab * bc) if ab * bc > 0.0 else 0.0
        c = c / (bc * cd) if bc * cd > 0.0 else 0.0
        d = d / (cd * da) if cd * da > 0.0 else 0.0
        lost = 0.0 * (ab + cd)  # NaN where a coordinate is, else 0
        s[RATIO + i] = (longest / shortest if shortest > 0.0 else np.inf) + lost
        s[SINE + i] = min(min(a, b), min(c, d)) + lost
        acx, acy = cx - ax, cy - ay
        s[SIZE + i] = 0.5 * ((abx * acy - aby * acx) + (acx * (dy - ay) - acy * (dx - ax)))


@helper()
def _measure_triangles(p: FloatArray, n: int, s: FloatArray) -> None:
    """Measure edges, sines and areas of triangles in lanes."""
    for i in range(n):
        ax, ay, bx, by = p[X0 + i], p[Y0 + i], p[X1 + i], p[Y1 + i]
        cx, cy = p[X2 + i], p[Y2 + i]
        abx, aby, bcx, bcy, cax, cay = bx - ax, by - ay, cx - bx, cy - by, ax - cx, ay - cy
        ab, bc = math.sqrt(abx * abx + aby * aby), math.sqrt(bcx * bcx + bcy * bcy)
        ca = math.sqrt(cax * cax + cay * cay)
        a, b, c = cax * aby - cay * abx, abx * bcy - aby * bcx, bcx * cay - bcy * cax
        s[SIZE + i] = 0.5 * a
        a = a / (ca * ab) if ca * ab > 0.0 else 0.0
        b = b / (ab * bc) if ab * bc > 0.0 else 0.0
        c = c / (bc * ca) if bc * ca > 0.0 else 0.0
        shortest, longest = min(min(ab, bc), ca), max(max(ab, bc), ca)
        lost = 0.0 * (ab + bc)
        s[RATIO + i] = (longest / shortest if shortest > 0.0 else np.inf) + lost
        s[SINE + i] = min(min(a, b), c) * TRIANGLE_SCALE + lost


@parallel_kernel()
def cell_figures(
    xy: FloatArray,
    cell_offsets: IndexArray,
    cell_vertices: IndexArray,
    out: FloatArray,
    doubtful: FloatArray,
) -> None:
    """Measure extreme angles, edge ratio, scaled Jacobian, shape and area of each cell.

    Parameters
    ----------
    xy : (n_vertices, 2)
        Coordinates, in any one unit.
    cell_offsets, cell_vertices : (n_cells + 1,), (n_corners,)
        CSR map from a cell to its vertices, counter-clockwise.
    out : (6, n_cells)
        Overwritten; NaN where a coordinate is NaN.
    doubtful : (n_chunks,)
        Overwritten: of each `CELLS_A_CHUNK` cells those that are not valid, or not so beyond
        rounding.

    Notes
    -----
    By rows, `MIN_ANGLE` and so on:

    - the smallest and the largest interior angle, degrees in [0, 360), measured on the left of the
      cell's boundary; 0 at a corner that has an edge of no length;
    - the longest edge over the shortest: 1 is ideal, infinite where an edge has no length;
    - the worst corner's sine, in triangles over that of 60 degrees: 1 is ideal, 0 collapsed or with
      an edge of no length, below 0 not convex (P. M. Knupp, "Algebraic mesh quality metrics", SIAM
      J. Sci. Comput. 23, 2001);
    - the worst corner's mean ratio, one over the energy of `corner_energy`: 2 det(u, w) / (|u|² +
      |w|²) with the edge vectors u, w, in a triangle 4 √3 area / (sum of squared edges); 1 is a
      square or an equilateral triangle, 0 where a corner is not positive (P. M. Knupp, "Algebraic
      mesh quality metrics for unstructured initial meshes", Finite Elements in Analysis and Design
      39, 2003; as "shape" in C. J. Stimpson et al., "The Verdict geometric quality library", Sandia
      report SAND2007-1751);
    - the signed area, positive counter-clockwise, in the square of the coordinates' unit.
    """
    n_cells = cell_offsets.size - 1
    for chunk in prange(doubtful.size):
        cells = np.empty(LANES, np.int64)
        p, s = np.empty(N_PLACES * LANES), np.empty(N_ROWS * LANES)
        for i in range(LANES):
            s[DOUBT + i] = 0.0
        start, stop = chunk * CELLS_A_CHUNK, min((chunk + 1) * CELLS_A_CHUNK, n_cells)
        for first in range(start, stop, LANES):
            last = min(first + LANES, stop)
            left = last - first
            for n_corners in (4, 3):
                n = look_at_cells(
                    xy, cell_offsets, cell_vertices, first, last, n_corners, cells, p, s
                )
                if n_corners == 4:
                    _measure_quads(p, n, s)
                else:
                    _measure_triangles(p, n, s)
                for i in range(n):
                    s[LOW + i], s[HIGH + i] = degrees_of(s[LOW + i]), degrees_of(s[HIGH + i])
                    s[DOUBT + i] += 1.0 - s[SURE + i]
                for k in range(N_FIGURES):
                    store_lanes(s, ROWS[k], cells, n, out[k])
                left -= n
                if left == 0:
                    break
        doubt = 0.0
        for i in range(LANES):
            doubt += s[DOUBT + i]
        doubtful[chunk] = doubt
