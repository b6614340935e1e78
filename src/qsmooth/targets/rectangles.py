"""What quads of layers are meant to be: rectangles of their length and area, without noise."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from qsmooth._types import FloatArray
from qsmooth.targets.algebra import step
from qsmooth.targets.sheets import NOISE_WINDOWS, Sheets

# Scatter in log lengths at which half of what the fits leave is taken for noise. Shaken layers
# have .05 to .4; layers as they are less than .014.
NOISE = 0.03
# Mean square, and weight, that count as none.
LEAST_SQUARE, LEAST_WEIGHT = 1e-8, 1e-3
# Windows and degrees of the fits that take noise away from lengths: across the sheets; along; and
# what is left, across and along again.
NOISE_FITS = (5, 2), (8, 1), (3, 0), (2, 0)
# Heights vary along a sheet as in the other layers, and across as in other stacks. From the mean
# over this window along the sheet, they are matched to the places of the layers in this window
# across; then along, and what is left, across and along, as above. Twice. Chosen among 60 ways, for
# the first layers of five meshes, shaken three times each: off by .05 in the logarithm on airfoils
# and .03 elsewhere, where the fits of lengths are off by .07 and .05.
HEIGHT_MEAN, HEIGHT_MATCH, HEIGHT_PASSES = 64, 8, 2
HEIGHT_FITS = (8, 1), (3, 0), (2, 0)
# What varies in other ways counts where it is surely no noise: means over windows along and across
# that are so many times as large as the noise in them.
WINDOWS, SURE = ((32, 2), (16, 2), (8, 2), (4, 2)), (2.5, 4.5)
# Noise over the root of what a parabola leaves of it, as links share their vertices with those
# beside them; and noise of matched heights over that of heights.
PARABOLA, MATCHED = 1.3, 0.4


def rectangles(sheets: Sheets) -> tuple[FloatArray, FloatArray]:
    """Log ratio (sides 0 and 2 over 1 and 3) and log area of each, without noise: (n,) both.

    The length of a stretched quad and its area are kept, hence its height. Where it is as long
    as high neither length is kept before the other.
    """
    height = _without_noise(sheets, sheets.height, _smooth_heights).reshape(-1, 2)
    length = _without_noise(sheets, sheets.across, _smooth_lengths).reshape(-1, 2)[:, ::-1]
    ratio = (sheets.length[:, 0] - sheets.length[:, 1]) / math.log(4.0)
    share = 0.5 + 0.5 * np.clip(ratio, -1.0, 1.0)
    p = share * length[:, 0] + (1.0 - share) * height[:, 1]
    q = share * height[:, 0] + (1.0 - share) * length[:, 1]
    return p - q, p + q


def _without_noise(
    sheets: Sheets, values: FloatArray, smoothed: Callable[[Sheets, FloatArray], FloatArray]
) -> FloatArray:
    """Take away what scatters along the sheets, and leave what varies smoothly."""
    square = _scatter(sheets, values)
    weight = square**2 / (square**2 + NOISE**4)
    if (weight < LEAST_WEIGHT).all():
        return values
    return values + weight * (smoothed(sheets, values) - values)


def _scatter(sheets: Sheets, values: FloatArray) -> FloatArray:
    """Mean square of what parabolas leave of the values along the sheets."""
    _, square = sheets.fit(values, NOISE_WINDOWS[0], 2)
    return np.asarray(np.exp(sheets.fit(np.log(square + LEAST_SQUARE), NOISE_WINDOWS[1], 0)[0]))


def _fit_across(sheets: Sheets, values: FloatArray, width: int, degree: int) -> FloatArray:
    """Fit values of links on the sheets that cross theirs."""
    return sheets.other(sheets.fit(sheets.other(values), width, degree)[0])


def _smooth_lengths(sheets: Sheets, values: FloatArray) -> FloatArray:
    """Fit log lengths across the sheets and along them."""
    first, second, third, fourth = NOISE_FITS
    across = _fit_across(sheets, values, *first)
    along, _ = sheets.fit(across, *second)
    left = _fit_across(sheets, across - along, *third)
    return np.asarray(along + sheets.fit(left, *fourth)[0])


def _smooth_heights(sheets: Sheets, values: FloatArray) -> FloatArray:
    """Fit log heights so that the layers lie where they do."""
    noise = PARABOLA * np.sqrt(_scatter(sheets, values))
    # E log(1 + z) = −½ E z², to the second order.
    unbiased = values + 0.5 * noise**2
    first, second, third = HEIGHT_FITS
    smooth, _ = sheets.fit(values, HEIGHT_MEAN, 0)
    for _ in range(HEIGHT_PASSES):
        matched = smooth + _matched(sheets, values, smooth)
        smooth, _ = sheets.fit(matched, *first)
        left = _fit_across(sheets, matched - smooth, *second)
        shared, _ = sheets.fit(left, *third)
        smooth += shared + _where_sure(left - shared, MATCHED * noise)
        for along, across in WINDOWS:
            left, _ = sheets.fit(_fit_across(sheets, unbiased - smooth, across, 0), along, 0)
            share = 2.0 / (_independent(sheets, along) + 1.0)
            share /= sheets.other(_independent(sheets, across))
            smooth += _where_sure(left, np.sqrt(share) * noise)
    return smooth


def _independent(sheets: Sheets, width: int) -> FloatArray:
    """How many values a fit of degree 0 at each link is as good as; fewer at the ends."""
    offsets, links, closed = sheets.order
    counts = np.diff(offsets)
    place = np.arange(links.size) - np.repeat(offsets[:-1], counts)
    after = np.repeat(counts, counts) - 1 - place
    ring = np.repeat(closed, counts)
    weights = (1.0 - (np.arange(width + 1) / (width + 1.0)) ** 2) ** 2
    sums, squares = np.cumsum(weights), np.cumsum(weights**2)
    left, right = (np.minimum(np.where(ring, width, n), width) for n in (place, after))
    total = sums[left] + sums[right] - 1.0
    out = np.empty(links.size)
    out[links] = total**2 / (squares[left] + squares[right] - 1.0)
    return out


def _matched(sheets: Sheets, heights: FloatArray, reference: FloatArray) -> FloatArray:
    """Log scale that takes reference heights to places of the layers; all logarithms."""
    from qsmooth.kernels.stacks import match_heights

    out = np.empty(heights.size)
    given = np.exp(sheets.other(heights)), np.exp(sheets.other(reference))
    match_heights(*sheets.order, sheets.walls, *given, HEIGHT_MATCH, out)
    return sheets.other(out)


def _where_sure(values: FloatArray, noise: FloatArray) -> FloatArray:
    """Values that are far beyond their noise; less of those that are not."""
    return values * step(np.abs(values) / np.maximum(noise, LEAST_WEIGHT), SURE)
