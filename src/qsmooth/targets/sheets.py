"""Sheets of quads: which of them are layers, and what their cells are meant to be."""

from __future__ import annotations

import math

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

# Scatter is what a parabola over 2 · 3 + 1 links leaves, averaged in logarithms over 2 · 8 + 1: a
# kink, as at a leading edge, is large in a few links, noise in all.
NOISE_WINDOWS = 3, 8

# Log lengths of a pair of triangles, and of what follows on its sheet, differ by less.
PAIR_CHANGE = math.log(4.0)

# Learned ratios of quads: squares up to the first, the average ratio from the second.
LEARNED_RATIO = math.log(2.0), math.log(4.0)
LEARNED_WINDOW = 7

# So many quads are measured at once: what that takes lies in cache.
CHUNK = 2**14


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
    order
        The links sheet by sheet, as `kernels.sheets.order_sheets` lists them.
    walls : (n_sheets, 2)
        Whether the first and the last side that a sheet crosses are on the boundary.
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
        self._measure(topology, xy)
        links = self._links(topology)
        self.neighbours = links[:, [1, 3, 0, 2]].reshape(-1, 2)
        self.order = order_sheets(self.neighbours)
        self.walls = self._ends(links, topology.twins[self.sides] < 0)

    def _measure(self, topology: Topology, xy: FloatArray) -> None:
        """Measure lengths, sines and heights."""
        n = len(self.sides)
        lengths, area = np.empty((n, 2)), np.empty(n)
        for start in range(0, n, CHUNK):
            rows = slice(start, start + CHUNK)
            p = xy[topology.cell_vertices[self.sides[rows]]]
            edges = np.empty_like(p)
            np.subtract(p[:, 1:], p[:, :-1], out=edges[:, :-1])
            np.subtract(p[:, 0], p[:, 3], out=edges[:, 3])
            sides = np.hypot(edges[..., 0], edges[..., 1])
            lengths[rows] = 0.5 * (sides[:, :2] + sides[:, 2:])
            d, e = p[:, 2] - p[:, 0], p[:, 3] - p[:, 1]
            area[rows] = 0.5 * (d[:, 0] * e[:, 1] - d[:, 1] * e[:, 0])
        # No length: as good as none, but one that logarithms can be averaged of.
        np.maximum(lengths, 1e-30 * (float(lengths.max(initial=0.0)) or 1.0), out=lengths)
        self.sine = np.clip(area / (lengths[:, 0] * lengths[:, 1]), 1e-3, 1.0)
        self.length = np.log(lengths, out=lengths)
        self.along = self.length.ravel()
        self.across = self.length[:, ::-1].ravel()
        self.height = self.across + np.repeat(np.log(self.sine), 2)

    def _links(self, topology: Topology) -> IndexArray:
        """Links across each side, (n, 4), or -1."""
        n, twins = len(self.sides), topology.twins
        quad_of, side_of = np.full(twins.size, -1), np.zeros(twins.size, np.int8)
        quad_of[self.sides] = np.arange(n)[:, None]
        side_of[self.sides] = np.arange(4)
        twin = twins[self.sides]
        joined = (twin >= 0) & (quad_of[twin] >= 0)
        links = 2 * quad_of[twin]
        links += (side_of[twin] + 1) % 2
        if n > self.n_quads:
            own = 2 * np.arange(n)[:, None] + (np.arange(4) + 1) % 2
            # What is paired need not go on: beyond the end of a layer triangles are a thousand
            # times as short.
            guessed = np.maximum(own, links) >= 2 * self.n_quads
            joined &= ~guessed | (np.abs(self.along[own] - self.along[links]) < PAIR_CHANGE)
        links[~joined] = -1
        return np.asarray(links)

    def _ends(self, links: IndexArray, is_wall: BoolArray) -> BoolArray:
        """Whether the first and last side that each sheet crosses are on the boundary."""
        # A link is crossed through sides 1 and 3, or 0 and 2, as in `neighbours`.
        is_end = np.logical_and(is_wall, np.less(links, 0))
        ends = np.stack([is_end[:, 1] | is_end[:, 3], is_end[:, 0] | is_end[:, 2]], axis=1).ravel()
        offsets, order, closed = self.order
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
        fit_along(*self.order, np.ascontiguousarray(values), width, degree, *out)
        return out

    def other(self, values: FloatArray) -> FloatArray:
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
        offsets, links, _ = self.order
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

    def learned_ratios(self) -> FloatArray:
        """Log ratio of sides 0 and 2 over 1 and 3, averaged along the sheets, 0 if small: (n,)."""
        mean = self.fit(self.across, LEARNED_WINDOW, 0)[0].reshape(-1, 2)
        log = mean[:, 1] - mean[:, 0]
        return np.asarray(log * step(np.abs(log), LEARNED_RATIO))
