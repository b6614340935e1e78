"""Sheets of quads: which of them are layers, and what their cells are meant to be."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from qsmooth._types import BoolArray, FloatArray, IndexArray
from qsmooth.targets.algebra import step
from qsmooth.topology import Topology

# The constants of "auto"; a pair is where a weight begins to rise and where it is one. They lie in
# gaps that were measured on 60 meshes, as they are and with every vertex moved by up to .35 of its
# shortest edge: `studies/targets.py` prints the figures that they part.
#
# Length of a quad over its height, averaged along the sheet, in a layer. In front of a bump or
# notch regular quads are stretched by up to 5.7.
LAYER_STRETCH = math.log(5.0), math.log(10.0)
# Area over the product of the mean sides, the sine of a parallelogram: layers .83 and more where
# they are shaken, .77 for shaken ones that are sheared to 58° besides; notches .25 to .8.
LAYER_SINE = 0.7, 0.8
# Scatter of the log heights along the sheet: shaken layers up to .4, distorted grids .3 to .6.
LAYER_SCATTER = 0.5, 0.35
# Share of a whole sheet that is regular by the last two: layers .97 and more, all but two links.
LAYER_SHARE = 0.8, 0.95
# The weight of a layer is passed on to regular quads beside it, so often, and times this each time.
LAYER_REACH, LAYER_DECAY = 10, 0.95
# Half the windows of the fits along sheets, in links: for these figures, and for scatter.
LAYER_WINDOW, SCATTER_WINDOW = 4, 6

# Scatter in log lengths at which half of what the fits leave is taken for noise. Shaken layers
# have .05 to .4; layers as they are less than .014.
NOISE = 0.03
# Scatter is what a parabola over 2 · 3 + 1 links leaves, averaged in logarithms over 2 · 8 + 1: a
# kink, as at a leading edge, is large in a few links, noise in all.
NOISE_WINDOWS = 3, 8
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
WINDOWS, SURE = ((32, 2), (16, 2), (8, 2), (4, 2)), (2.0, 4.0)
# Noise over the root of what a parabola leaves of it, as links share their vertices with those
# beside them; and noise of matched heights over that of heights.
PARABOLA, MATCHED = 1.3, 0.4

# Learned ratios of quads: squares up to the first, the average ratio from the second.
LEARNED_RATIO = math.log(2.0), math.log(4.0)
LEARNED_WINDOW = 7


class Sheets:
    """Quads, and pairs of triangles taken for quads, with their sheets.

    Attributes
    ----------
    n_quads
        How many there are that are cells; pairs follow.
    first, second : (n,)
        The cells of each; twice the same where it is one.
    sides : (n, 4)
        Its sides in turn, as positions in `topology.cell_vertices`.
    neighbours : (2 n, 2)
        The links before and after each on its sheet, or -1.
    length : (n, 2)
        Log of the mean length of its sides 0 and 2, and 1 and 3.
    sine : (n,)
        Area over the product of these lengths: 1 for rectangles.
    along, height, across : (2 n,)
        Of links, in logarithms: the length along the sheet, the height (area over length), and the
        mean length of the sides that are crossed.
    """

    def __init__(self, topology: Topology, xy: FloatArray) -> None:
        from qsmooth.kernels.sheets import order_sheets

        self._find_quads(topology, xy)
        n, twins = len(self.sides), topology.twins
        quad_of, side_of = np.full(twins.size, -1), np.zeros(twins.size, np.int64)
        quad_of[self.sides] = np.arange(n)[:, None]
        side_of[self.sides] = np.arange(4)
        twin = twins[self.sides]
        joined = (twin >= 0) & (quad_of[twin] >= 0)
        links = np.where(joined, 2 * quad_of[twin] + (side_of[twin] + 1) % 2, -1)
        self.neighbours = links[:, [1, 3, 0, 2]].reshape(-1, 2)
        self._order = order_sheets(self.neighbours)
        self._walls = self._ends(links, twin < 0)

        p = xy[topology.cell_vertices[self.sides]]
        edges = np.roll(p, -1, axis=1) - p
        sides = np.hypot(edges[..., 0], edges[..., 1])
        lengths = 0.5 * (sides[:, :2] + sides[:, 2:])
        # No length: as good as none, but one that logarithms can be averaged of.
        lengths = np.maximum(lengths, 1e-30 * lengths.max(initial=1e-300))
        d, e = p[:, 2] - p[:, 0], p[:, 3] - p[:, 1]
        area = 0.5 * (d[:, 0] * e[:, 1] - d[:, 1] * e[:, 0])
        self.sine = np.clip(area / (lengths[:, 0] * lengths[:, 1]), 1e-3, 1.0)
        self.length = np.log(lengths)
        self.along = self.length.ravel()
        self.across = self.length[:, ::-1].ravel()
        self.height = self.across + np.repeat(np.log(self.sine), 2)

    def _ends(self, links: IndexArray, is_wall: BoolArray) -> BoolArray:
        """Whether the first and last side that each sheet crosses are on the boundary."""
        # A link is crossed through sides 1 and 3, or 0 and 2, as in `neighbours`.
        is_end = np.logical_and(is_wall, np.less(links, 0))
        ends = np.stack([is_end[:, 1] | is_end[:, 3], is_end[:, 0] | is_end[:, 2]], axis=1).ravel()
        offsets, order, closed = self._order
        at_ends = np.stack([ends[order[offsets[:-1]]], ends[order[offsets[1:] - 1]]], axis=1)
        return np.asarray(at_ends & ~closed[:, None])

    def _find_quads(self, topology: Topology, xy: FloatArray) -> None:
        from qsmooth.kernels.sheets import pair_triangles

        offsets, sizes = topology.cell_offsets, topology.cell_sizes
        quads = np.flatnonzero(sizes == 4)
        self.n_quads, self.first, self.second = quads.size, quads, quads
        self.sides = offsets[quads][:, None] + np.arange(4)
        if quads.size == sizes.size:
            return
        pairs = pair_triangles(xy, *topology.cells, topology.twins)
        one = np.flatnonzero(pairs >= 0)
        one = one[topology.twins[pairs[one]] > pairs[one]]
        shared = pairs[one], topology.twins[pairs[one]]
        two = topology.corner_cells[shared[1]]
        # The two sides after the shared one, of the one triangle and then of the other.
        outer = [
            offsets[cells] + (side - offsets[cells] + k) % 3
            for cells, side in zip((one, two), shared, strict=True)
            for k in (1, 2)
        ]
        self.sides = np.concatenate([self.sides, np.stack(outer, axis=1)])
        self.first, self.second = np.concatenate([quads, one]), np.concatenate([quads, two])

    def fit(self, values: FloatArray, width: int, degree: int) -> tuple[FloatArray, FloatArray]:
        """Fit along the sheets; values of links and what is left of them, as `fit_along`."""
        from qsmooth.kernels.sheets import fit_along

        out = np.empty(values.size), np.empty(values.size)
        fit_along(*self._order, np.ascontiguousarray(values), width, degree, *out)
        return out

    def _other(self, values: FloatArray) -> FloatArray:
        """What the other link of the same quad has."""
        return values.reshape(-1, 2)[:, ::-1].ravel()

    def layers(self) -> FloatArray:
        """Weight of each quad as one of a layer, (n,), 0 to 1."""
        stretch, _ = self.fit(self.along - self.height, LAYER_WINDOW, 0)
        own = step(stretch, LAYER_STRETCH)
        if not own.any():
            return np.zeros(len(self.sides))
        sine, _ = self.fit(np.repeat(self.sine, 2), LAYER_WINDOW, 0)
        _, square = self.fit(self.height, NOISE_WINDOWS[0], 2)
        scatter = np.sqrt(self.fit(square, SCATTER_WINDOW, 0)[0])
        regular = step(sine, LAYER_SINE) * step(scatter, LAYER_SCATTER)
        own *= regular * step(self._sheet_means(regular), LAYER_SHARE)
        weight = np.minimum(own, self._stacked(own)).reshape(-1, 2).max(axis=1)
        # A quad that is regular on both of its sheets, beside a layer, is a part of it. Triangles
        # are not: two equilateral ones make a regular quad too, wherever they are.
        share = LAYER_DECAY * regular.reshape(-1, 2).min(axis=1)
        share[self.n_quads :] = 0.0
        beside = self.neighbours.reshape(-1, 4)
        inside, quads = beside >= 0, beside >> 1
        for _ in range(LAYER_REACH if weight.any() else 0):
            near = np.where(inside, weight[quads], 0.0).max(axis=1)
            np.maximum(weight, share * near, out=weight)
        return np.asarray(weight)

    def _sheet_means(self, values: FloatArray) -> FloatArray:
        """Mean of its whole sheet at each link."""
        offsets, links, _ = self._order
        counts = np.diff(offsets)
        means = np.empty(values.size)
        means[links] = np.repeat(np.add.reduceat(values[links], offsets[:-1]) / counts, counts)
        return means

    def _stacked(self, own: FloatArray) -> FloatArray:
        """Smallest weight of the other two in a stack of three, in the best such stack."""
        # Layers lie beside each other along the other sheet of the quad.
        ids = np.arange(own.size)
        beside = self.neighbours[ids ^ 1]
        near = np.where(beside >= 0, own[beside ^ 1], 0.0)
        best: FloatArray = near.min(axis=1)
        for k in (0, 1):
            link = beside[:, k]
            ends = self.neighbours[link]
            second = np.where(ends[:, 0] == (ids ^ 1), ends[:, 1], ends[:, 0])
            there = (link >= 0) & (second >= 0)
            pair = np.minimum(near[:, k], np.where(there, own[second ^ 1], 0.0))
            best = np.maximum(best, pair)
        return best

    def rectangles(self) -> tuple[FloatArray, FloatArray]:
        """Log ratio (sides 0 and 2 over 1 and 3) and log area of each, without noise: (n,) both.

        The length of a stretched quad and its area are kept, hence its height. Where it is as long
        as high neither length is kept before the other.
        """
        height = self._without_noise(self.height, self._smooth_heights).reshape(-1, 2)
        length = self._without_noise(self.across, self._smooth_lengths).reshape(-1, 2)[:, ::-1]
        ratio = (self.length[:, 0] - self.length[:, 1]) / math.log(4.0)
        share = 0.5 + 0.5 * np.clip(ratio, -1.0, 1.0)
        p = share * length[:, 0] + (1.0 - share) * height[:, 1]
        q = share * height[:, 0] + (1.0 - share) * length[:, 1]
        return p - q, p + q

    def _without_noise(
        self, values: FloatArray, smoothed: Callable[[FloatArray], FloatArray]
    ) -> FloatArray:
        """Take away what scatters along the sheets, and leave what varies smoothly."""
        square = self._scatter(values)
        weight = square**2 / (square**2 + NOISE**4)
        if (weight < LEAST_WEIGHT).all():
            return values
        return values + weight * (smoothed(values) - values)

    def _scatter(self, values: FloatArray) -> FloatArray:
        """Mean square of what parabolas leave of the values along the sheets."""
        _, square = self.fit(values, NOISE_WINDOWS[0], 2)
        return np.asarray(np.exp(self.fit(np.log(square + LEAST_SQUARE), NOISE_WINDOWS[1], 0)[0]))

    def _fit_across(self, values: FloatArray, width: int, degree: int) -> FloatArray:
        """Fit values of links on the sheets that cross theirs."""
        return self._other(self.fit(self._other(values), width, degree)[0])

    def _smooth_lengths(self, values: FloatArray) -> FloatArray:
        """Fit log lengths across the sheets and along them."""
        first, second, third, fourth = NOISE_FITS
        across = self._fit_across(values, *first)
        along, _ = self.fit(across, *second)
        left = self._fit_across(across - along, *third)
        return np.asarray(along + self.fit(left, *fourth)[0])

    def _smooth_heights(self, values: FloatArray) -> FloatArray:
        """Fit log heights so that the layers lie where they do."""
        noise = PARABOLA * np.sqrt(self._scatter(values))
        # E log(1 + z) = −½ E z², to the second order.
        unbiased = values + 0.5 * noise**2
        first, second, third = HEIGHT_FITS
        smooth, _ = self.fit(values, HEIGHT_MEAN, 0)
        for _ in range(HEIGHT_PASSES):
            matched = smooth + self._matched(values, smooth)
            smooth, _ = self.fit(matched, *first)
            left = self._fit_across(matched - smooth, *second)
            shared, _ = self.fit(left, *third)
            smooth += shared + _where_sure(left - shared, MATCHED * noise)
            for along, across in WINDOWS:
                left, _ = self.fit(self._fit_across(unbiased - smooth, across, 0), along, 0)
                share = 2.0 / (_independent(along) + 1.0) / _independent(across)
                smooth += _where_sure(left, math.sqrt(share) * noise)
        return smooth

    def _matched(self, heights: FloatArray, reference: FloatArray) -> FloatArray:
        """Log scale that takes reference heights to places of the layers; all logarithms."""
        from qsmooth.kernels.stacks import match_heights

        out = np.empty(heights.size)
        given = np.exp(self._other(heights)), np.exp(self._other(reference))
        match_heights(*self._order, self._walls, *given, HEIGHT_MATCH, out)
        return self._other(out)

    def learned_ratios(self) -> FloatArray:
        """Log ratio of sides 0 and 2 over 1 and 3, averaged along the sheets, 0 if small: (n,)."""
        mean = self.fit(self.across, LEARNED_WINDOW, 0)[0].reshape(-1, 2)
        log = mean[:, 1] - mean[:, 0]
        return np.asarray(log * step(np.abs(log), LEARNED_RATIO))


def _independent(width: int) -> float:
    """How many values the weights of a fit of degree 0 are as good as."""
    t = np.arange(-width, width + 1) / (width + 1.0)
    weights = (1.0 - t * t) ** 2
    return float(weights.sum() ** 2 / (weights**2).sum())


def _where_sure(values: FloatArray, noise: FloatArray) -> FloatArray:
    """Values that are far beyond their noise; less of those that are not."""
    return values * step(np.abs(values) / np.maximum(noise, LEAST_WEIGHT), SURE)
