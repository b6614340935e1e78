"""Stacks of layers: heights that add up to where the layers lie.

Where vertices are off by chance, heights of neighbouring layers are off by the same with opposite
signs: one gains what the other loses. The places of the layers over the wall are off by no more
than one vertex is, however many lie below, and the wall is where it is. So heights are better told
from places than by averaging.
"""

import math

import numpy as np

from qsmooth._types import BoolArray, FloatArray, IndexArray
from qsmooth.kernels._jit import kernel

# Steps of Gauss and Newton, what one changes a logarithm by at most, and all of them together.
STEPS, LARGEST_STEP, LARGEST = 3, 0.5, 0.7
# What the place of a wall is off by, times what another is.
WALL_NOISE = 1e-2


@kernel()
def match_heights(
    offsets: IndexArray,
    links: IndexArray,
    closed: BoolArray,
    walls: BoolArray,
    heights: FloatArray,
    reference: FloatArray,
    width: int,
    log_scale: FloatArray,
) -> None:
    """Scale reference heights, link by link, so that places of layers are met as well as can be.

    Around each link the heights are those of the reference times exp(a + b t), t being the distance
    over `width` + 1, and the lowest place of the window is off by c. Places have an error in
    proportion to the lesser height beside them. The weights are those of `fit_along` over that
    error squared; a is what is asked for.

    Parameters
    ----------
    offsets, links, closed
        As `order_sheets` gives them; the sheets are crossed layer by layer.
    walls : (n_sheets, 2)
        Whether the first and the last place on a sheet are where they are meant to be.
    heights, reference : (n_links,)
        Positive, in any one unit.
    width
        Half the width of the window in links.
    log_scale : (n_links,)
        Overwritten: a.
    """
    for s in range(closed.size):
        first, n = offsets[s], offsets[s + 1] - offsets[s]
        ring = closed[s]
        start_error = WALL_NOISE if walls[s, 0] else 1.0
        end_error = WALL_NOISE if walls[s, 1] else 1.0
        line, model = np.empty(n), np.empty(n)
        for i in range(n):
            line[i], model[i] = heights[links[first + i]], reference[links[first + i]]
        half = min(width, (n - 1) // 2) if ring else width
        square = 1.0 / (half + 1.0)
        # At each place of a window: what a and b change it by, what it is off by, and its weight.
        table = np.empty((2 * half + 2, 4))
        for i in range(n):
            low, high = i - half, i + half
            if not ring:
                low, high = max(low, 0), min(high, n - 1)
            unit = 1.0 / model[i]
            a = b = 0.0
            for _ in range(STEPS):
                place = slope = left = below = 0.0
                if low > 0 or ring:
                    below = unit * model[(low - 1) % n] * math.exp(a + b * (low - 1 - i) * square)
                s0 = sa = sb = sr = 0.0
                for k in range(low, high + 2):  # places: k lies below link k
                    above = below
                    if k < n or ring:
                        above = unit * model[k % n] * math.exp(a + b * (k - i) * square)
                    error = min(below, above) if below > 0.0 else above
                    if not ring:
                        error *= start_error if k == 0 else end_error if k == n else 1.0
                    t = (k - 0.5 - i) * square
                    weight = ((1.0 - t * t) / error) ** 2
                    row = table[k - low]
                    row[0], row[1], row[2], row[3] = place, slope, left, weight
                    s0 += weight
                    sa += weight * place
                    sb += weight * slope
                    sr += weight * left
                    if k <= high:
                        place += above
                        slope += above * (k - i) * square
                        left += unit * line[k % n] - above
                    below = above
                # c takes the means away. What is left is small where the weights are large.
                aa = ab = bb = ra = rb = 0.0
                for k in range(high + 2 - low):
                    p, q, r = table[k, 0] - sa / s0, table[k, 1] - sb / s0, table[k, 2] - sr / s0
                    weight = table[k, 3]
                    aa += weight * p * p
                    ab += weight * p * q
                    bb += weight * q * q
                    ra += weight * p * r
                    rb += weight * q * r
                det = aa * bb - ab * ab
                if high == low:
                    det, bb, rb = aa, 1.0, 0.0
                if not det > 0.0:
                    break
                da, db = (bb * ra - ab * rb) / det, (aa * rb - ab * ra) / det
                shrink = min(1.0, LARGEST_STEP / max(abs(da), abs(db), LARGEST_STEP))
                a, b = a + shrink * da, b + shrink * db
            log_scale[links[first + i]] = min(max(a, -LARGEST), LARGEST)
