"""A spiral band of bad quads, after the example of the paper.

At its default size it is packaged, and read from there: `spiral()`, ``qsmooth demo`` and ``qsmooth
paper`` have the same mesh, to the bit, whatever this machine's sine and NumPy's random numbers are.
"""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from qsmooth._types import FloatArray, IndexArray
from qsmooth.examples.thirds import shaken, split_in_three
from qsmooth.io import read_mesh
from qsmooth.mesh import Mesh

# What `made_spiral` gives at its defaults; written by tools/make_demo_mesh.py.
DEMO_FILE = Path(__file__).parent.parent / "data" / "spiral.off"
N_QUADS, JITTER, SEED = 1900, 0.55, 440

# The band: its centre line and half its width at the angle t, which runs from START to END.
START, END = 0.35 * 2.0 * math.pi, 2.1 * 2.0 * math.pi
CENTRE, PITCH = 0.30, 0.155
HALF_WIDTH, WIDENING = 0.030, 0.024
# The band is as long as this many of its widths, and a triangle's height is this share of its base.
LENGTH_IN_WIDTHS, HEIGHT = 38.7, 0.5 * math.sqrt(3.0)


def spiral(n_quads: int = N_QUADS, *, jitter: float = JITTER, seed: int = SEED) -> Mesh:
    """Make a spiral band of bad quads, narrower towards its centre.

    The band is cut into triangles in rows along it, each triangle into three quads (corner, two
    edge midpoints, centroid), and the interior vertices are moved at random, as far as every quad
    stays strictly convex. The same arguments give the same mesh; with the defaults it is the
    packaged one, of ``qsmooth demo``.

    Parameters
    ----------
    n_quads
        About how many quads, 200 or more.
    jitter
        Vertices move by up to this share of their shortest edge; 0 leaves them in place.
    seed
        Of the random moves; the default was picked for a mesh with some very bad cells.

    Raises
    ------
    ValueError
        If `n_quads` is too small or `jitter` is negative.
    """
    if n_quads < 200:
        raise ValueError(f"n_quads must be 200 or more, got {n_quads}")
    if not (0.0 <= jitter < math.inf):
        raise ValueError(f"jitter must be 0 or more, got {jitter}")
    if (n_quads, jitter, seed) == (N_QUADS, JITTER, SEED):
        return demo_mesh()
    return made_spiral(n_quads, jitter, seed)


def made_spiral(n_quads: int = N_QUADS, jitter: float = JITTER, seed: int = SEED) -> Mesh:
    """Make the band by its formula, also where it is packaged; parameters as in `spiral`."""
    n_across = max(1, round(math.sqrt(n_quads / (6.0 * LENGTH_IN_WIDTHS * HEIGHT))))
    n_along = max(1, round(n_quads / (6.0 * n_across) - 0.5))
    points, triangles = _band(n_along, n_across)
    points, quads, movable = split_in_three(points, triangles)
    return Mesh(shaken(points, quads, movable, jitter, np.random.default_rng(seed)), quads)


def demo_mesh() -> Mesh:
    """Read the packaged spiral, the mesh of ``qsmooth demo``; `spiral` gives the same."""
    stored = read_mesh(DEMO_FILE)
    return Mesh(stored.xy, stored.cells)


def _band(n_along: int, n_across: int) -> tuple[FloatArray, IndexArray]:
    """Triangulate the band in rows along it, every other one shifted by half a triangle."""
    t = np.linspace(START, END, 2001)
    # Columns stand as far apart as the band is wide there, so that cells shrink with it.
    density = (CENTRE + PITCH * t) / (HALF_WIDTH + WIDENING * t)
    passed = np.concatenate([[0.0], np.cumsum(0.5 * (density[1:] + density[:-1]))])
    passed *= n_along / passed[-1]
    ends, middles = np.arange(n_along + 1.0), np.arange(n_along) + 0.5
    columns = [ends, np.concatenate([[0.0], middles, [float(n_along)]])]
    points, triangles = [], []
    first = 0
    for row in range(n_across + 1):
        at = np.interp(columns[row % 2], passed, t)
        radius = CENTRE + PITCH * at + (2.0 * row / n_across - 1.0) * (HALF_WIDTH + WIDENING * at)
        points.append(np.stack([radius * np.cos(at), radius * np.sin(at)], axis=1))
        if row < n_across:
            even, odd = first, first + n_along + 1
            if row % 2:
                even, odd = first + n_along + 2, first
            i = np.arange(n_along + 1)
            on_odd = np.stack([odd + i, odd + i + 1, even + i], axis=1)
            on_even = np.stack([even + i, odd + i + 1, even + i + 1], axis=1)[:-1]
            both = np.concatenate([on_odd, on_even])
            # Outwards, then on along the band, is counter-clockwise.
            triangles.append(both if row % 2 == 0 else both[:, ::-1])
        first += len(at)
    return np.concatenate(points), np.concatenate(triangles)
