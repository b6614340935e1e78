"""What sweeps over blocks of lanes could reach on paper, and what this machine can do.

Counted are a vertex's operations (sums, products, comparisons and selects), divisions and roots,
and bytes: of the tables, of its star's coordinates, each once, and of what is stored. Rows of
scratch stay in cache and are not counted, nor is that gathered loads take several cycles each: no
loop reaches the bound. Only the first try of each step is counted.
"""

import time
from typing import NamedTuple

import numba
import numpy as np

LANES, REPEATS = 64, 2000


class Work(NamedTuple):
    """Operations, divisions and bytes."""

    operations: float
    divisions: float
    bytes: float

    def __add__(self, other):
        return Work(*(a + b for a, b in zip(self, other, strict=True)))

    def times(self, count):
        return Work(*(count * a for a in self))


class Star(NamedTuple):
    """Cells around a vertex, on average; their squares are what lines and proposals go by."""

    quads: float
    triangles: float
    cells_by_lines: float


# For a quad and for a triangle of a star, as the loops in `guards` have it.
LINES = Work(70, 6, 0), Work(36, 2, 0)
TRIAL = Work(65, 4, 0), Work(47, 3, 0)
RATIO = Work(0, 0, 0), Work(36, 2, 0)
PROPOSAL = Work(54, 1, 8), Work(54, 1, 8)
SHRINKING = Work(77, 5, 0), Work(0, 0, 0)
MEAN = Work(8, 0, 0), Work(8, 0, 0)
CENTROID = Work(30, 0, 0), Work(18, 0, 0)
BISECTOR = Work(58, 4, 20), Work(58, 4, 20)
CIRCLE = Work(0, 0, 0), Work(140, 5, 0)
# Two proposals against one line; and a vertex: its step, its move, where it is stored.
CLEARANCE, MOVE = Work(10, 0, 0), Work(30, 4, 4 + 16 + 16 + 16)
# Ids of a cell's corners, and coordinates: a vertex of the star once for each two cells it is in.
GATHERED = Work(6, 0, 12 + 1.5 * 16), Work(4, 0, 8 + 16)

PASSES = {
    "star_sweep": (LINES, PROPOSAL, TRIAL),
    "quad_proposals": (LINES, PROPOSAL, SHRINKING),
    "guarded_commit": (LINES, TRIAL),
    "smart_laplacian_sweep": (MEAN, TRIAL),
    "centroid_sweep": (CENTROID,),
    "smart_centroid_sweep": (CENTROID, TRIAL),
    "angle_sweep": (BISECTOR,),
    "guarded_angle_sweep": (BISECTOR, TRIAL),
    "aspect_ratio_sweep": (LINES, CIRCLE, RATIO, RATIO, TRIAL),
}
# Proposals of a cell that are held against each line, in pairs.
PAIRS = {"star_sweep": 1.0, "quad_proposals": 2.0, "aspect_ratio_sweep": 0.5}


def star_of(stars) -> Star:
    """Describe the stars of a schedule."""
    triangles = np.add.reduceat(stars.corners[:, 1] == 0xFFFFFFFF, stars.offsets[:-1])
    cells = np.diff(stars.offsets)
    quads = cells - triangles
    by_lines = cells * (3 * quads + triangles)
    return Star(quads.mean(), triangles.mean(), by_lines.mean())


def work_of(name: str, star: Star) -> Work:
    """What a sweep has to do for a vertex."""
    total = MOVE
    for quad, triangle in (GATHERED, *PASSES[name]):
        total = total + quad.times(star.quads) + triangle.times(star.triangles)
    return total + CLEARANCE.times(PAIRS.get(name, 0.0) * star.cells_by_lines)


@numba.njit(error_model="numpy")
def _operate(a, b, repeats):
    for _ in range(repeats):
        for i in range(LANES):
            x, y = a[i], b[i]
            for _ in range(16):
                x = x * y + y
            a[i] = x


@numba.njit(error_model="numpy")
def _divide(a, b, repeats):
    for _ in range(repeats):
        for i in range(LANES):
            x, y = a[i], b[i]
            for _ in range(4):
                x = y / x
            a[i] = x


def _best(function, *arguments) -> float:
    function(*arguments)
    seconds = []
    for _ in range(9):
        start = time.perf_counter()
        function(*arguments)
        seconds.append(time.perf_counter() - start)
    return min(seconds)


def rates() -> Work:
    """Measure operations, divisions and bytes a second of one thread; no product is fused."""
    a, b = np.full(LANES, 1.5), np.full(LANES, 0.5)
    operations = 32 * LANES * REPEATS / _best(_operate, a, b, REPEATS)
    divisions = 4 * LANES * REPEATS / _best(_divide, np.full(LANES, 1.5), b, REPEATS)
    source = np.ones(4_000_000)
    target = np.empty_like(source)
    return Work(operations, divisions, 2 * source.nbytes / _best(np.copyto, target, source))


def bound(work: Work, rate: Work) -> float:
    """Vertices a second where the slowest of the three hides the others."""
    return 1.0 / max(w / r for w, r in zip(work, rate, strict=True))
