"""What edges sweep over when vertices move, and what cells gain and lose by it."""

from numba import prange

from qsmooth._types import FloatArray, IndexArray
from qsmooth.kernels._jit import helper, parallel_kernel


@helper()
def _area_and_moment(ax: float, ay: float, bx: float, by: float) -> tuple[float, float, float]:
    """Signed area and first moment of the triangle of the origin, a and b."""
    area = 0.5 * (ax * by - ay * bx)
    return area, area * (ax + bx) / 3.0, area * (ay + by) / 3.0


@parallel_kernel()
def cell_moments(
    xy: FloatArray, cells: tuple[IndexArray, IndexArray], centres: FloatArray, areas: FloatArray
) -> None:
    """Find the centroid and the signed area of each cell.

    Parameters
    ----------
    xy, cells
        Coordinates, (n_vertices, 2), and the CSR map from a cell to its vertices.
    centres, areas : (n_cells, 2), (n_cells,)
        Overwritten. Where the area is 0 the centroid is the mean of the corners.
    """
    cell_offsets, cell_vertices = cells
    for c in prange(len(areas)):
        first, last = cell_offsets[c], cell_offsets[c + 1]
        o = cell_vertices[first]
        area = mx = my = sx = sy = 0.0
        for k in range(first + 1, last):
            a = cell_vertices[k]
            ax, ay = xy[a, 0] - xy[o, 0], xy[a, 1] - xy[o, 1]
            sx, sy = sx + ax, sy + ay
            if k + 1 < last:
                b = cell_vertices[k + 1]
                part = _area_and_moment(ax, ay, xy[b, 0] - xy[o, 0], xy[b, 1] - xy[o, 1])
                area, mx, my = area + part[0], mx + part[1], my + part[2]
        areas[c] = area
        if area == 0.0:
            mx, my, area = sx, sy, float(last - first)
        centres[c, 0] = xy[o, 0] + mx / area
        centres[c, 1] = xy[o, 1] + my / area


@helper()
def _swept(
    here: FloatArray, there: FloatArray, cells: tuple[IndexArray, IndexArray], k: int, c: int
) -> tuple[float, float, float]:
    """Area that a side of cell c sweeps over, positive where c gains, and its first moment.

    The moment is about where the side begins.
    """
    cell_offsets, cell_vertices = cells
    a = cell_vertices[k]
    b = cell_vertices[k + 1 if k + 1 < cell_offsets[c + 1] else cell_offsets[c]]
    # Round: b, a, both where they were, then a, b where they come to.
    bx, by = here[b, 0] - here[a, 0], here[b, 1] - here[a, 1]
    cx, cy = there[a, 0] - here[a, 0], there[a, 1] - here[a, 1]
    dx, dy = there[b, 0] - here[a, 0], there[b, 1] - here[a, 1]
    one, other = _area_and_moment(cx, cy, dx, dy), _area_and_moment(dx, dy, bx, by)
    return one[0] + other[0], one[1] + other[1], one[2] + other[2]


@parallel_kernel()
def swept_shares(
    here: FloatArray,
    there: FloatArray,
    cells: tuple[IndexArray, IndexArray],
    twins: IndexArray,
    corner_cells: IndexArray,
    areas: FloatArray,
    out: FloatArray,
) -> None:
    """Find what share of the smaller of its two cells a side of each cell sweeps over at most.

    Parameters
    ----------
    here, there : (n_vertices, 2)
        Coordinates before and after.
    cells, twins, corner_cells
        As in `qsmooth.topology`.
    areas : (n_cells,)
        Areas before, positive.
    out : (n_cells,)
        Overwritten. 0 or more.
    """
    cell_offsets = cells[0]
    for c in prange(len(out)):
        most = 0.0
        for k in range(cell_offsets[c], cell_offsets[c + 1]):
            if twins[k] >= 0:
                least = min(areas[c], areas[corner_cells[twins[k]]])
                most = max(most, abs(_swept(here, there, cells, k, c)[0]) / least)
        out[c] = most


@parallel_kernel()
def exchange(
    here: FloatArray,
    there: FloatArray,
    cells: tuple[IndexArray, IndexArray],
    twins: IndexArray,
    corner_cells: IndexArray,
    centres: FloatArray,
    values: FloatArray,
    slopes: FloatArray,
    out: FloatArray,
) -> None:
    """Find what each cell gains through its inner edges as these move.

    What an edge sweeps over comes from the cell that it moves into, by its linear function. One
    cell gains, to the bit, what the other loses.

    Parameters
    ----------
    here, there, cells, twins, corner_cells
        As in `swept_shares`.
    centres, values, slopes : (n_cells, 2), (n_cells, k), (n_cells, k, 2)
        Linear functions in the cells before: values at centroids, and slopes.
    out : (n_cells, k)
        Overwritten. Sums of value times area.
    """
    cell_offsets, cell_vertices = cells
    for c in prange(len(out)):
        for j in range(values.shape[1]):
            out[c, j] = 0.0
        for k in range(cell_offsets[c], cell_offsets[c + 1]):
            if twins[k] < 0:
                continue
            # Seen from one of the two sides, whichever cell asks.
            side, sign = (k, 1.0) if k < twins[k] else (twins[k], -1.0)
            left, right = corner_cells[side], corner_cells[twins[side]]
            area, mx, my = _swept(here, there, cells, side, left)
            donor = right if area > 0.0 else left
            start = cell_vertices[side]
            mx += area * (here[start, 0] - centres[donor, 0])
            my += area * (here[start, 1] - centres[donor, 1])
            for j in range(values.shape[1]):
                through = area * values[donor, j]
                through += slopes[donor, j, 0] * mx + slopes[donor, j, 1] * my
                out[c, j] += sign * through
