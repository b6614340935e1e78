"""What shape and size each cell is meant to have."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from qsmooth._types import BoolArray, FloatArray, IndexArray
from qsmooth.topology import Topology

# A quad stretched as much as this is none of a layer, and one stretched as much as that is.
LAYER_STRETCH = math.log(2.5), math.log(5.0)
# The same for area over the product of the mean sides: 1 for rectangles, the sine of sheared ones.
LAYER_SINE = 0.7, 0.8
# The same for the scatter of the log heights.
LAYER_SCATTER = 0.5, 0.35
LAYER_SHARE = 0.6, 0.85
REACH = 10
DECAY = 0.95
NOISE = 0.05
LEARNED = math.log(2.0), math.log(4.0)


class Targets(NamedTuple):
    corners: FloatArray
    area: FloatArray
    size_weight: FloatArray
    is_layer: BoolArray
    kind: str
    maps: FloatArray | None = None


ROOT = 1.0 / math.sqrt(3.0)


def step(x, low, high):
    t = np.clip((x - low) / (high - low), 0.0, 1.0)
    return t * t * (3.0 - 2.0 * t)


class Sheets:
    """Quads, and triangles paired to quads, with their sheets."""

    def __init__(self, topology: Topology, xy: FloatArray) -> None:
        from qsmooth.kernels.sheets import order_sheets, pair_triangles

        off, cv, twins = topology.cell_offsets, topology.cell_vertices, topology.twins
        sizes = topology.cell_sizes
        quads = np.flatnonzero(sizes == 4)
        sides = off[quads][:, None] + np.arange(4)
        first, second = quads, quads
        if quads.size < sizes.size:
            pairs = pair_triangles(xy, off, cv, twins)
            one = np.flatnonzero(pairs >= 0)
            one = one[twins[pairs[one]] > pairs[one]]
            d1 = pairs[one]
            two = topology.corner_cells[twins[d1]]
            d2 = twins[d1]

            def after(cells, d, k):
                return off[cells] + (d - off[cells] + k) % 3

            outer = np.stack([after(one, d1, 1), after(one, d1, 2), after(two, d2, 1), after(two, d2, 2)], axis=1)
            sides = np.concatenate([sides, outer])
            first, second = np.concatenate([quads, one]), np.concatenate([quads, two])
        self.n_quads, self.first, self.second, self.sides = quads.size, first, second, sides
        n = len(sides)
        quad_of, side_of = np.full(cv.size, -1), np.zeros(cv.size, np.int64)
        quad_of[sides] = np.arange(n)[:, None]
        side_of[sides] = np.arange(4)
        t = twins[sides]
        ok = (t >= 0) & (quad_of[t] >= 0)
        nb = np.where(ok, 2 * quad_of[t] + (side_of[t] + 1) % 2, -1)
        self.neighbours = np.ascontiguousarray(
            np.stack([nb[:, [1, 3]], nb[:, [0, 2]]], axis=1).reshape(-1, 2)
        )
        self.order = order_sheets(self.neighbours)
        p = xy[cv[sides]]
        l = np.linalg.norm(np.roll(p, -1, 1) - p, axis=2)
        with np.errstate(divide="ignore", invalid="ignore"):
            self.length = np.log(np.stack([l[:, 0] + l[:, 2], l[:, 1] + l[:, 3]], axis=1) / 2)
            a, b = p[:, 2] - p[:, 0], p[:, 3] - p[:, 1]
            area = 0.5 * (a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])
            sine = area / np.exp(self.length.sum(1))
        sine = np.where(np.isfinite(sine), np.clip(sine, 1e-3, 1.0), 1e-3)
        self.length = np.where(np.isfinite(self.length), self.length, -700.0)
        self.sine = sine
        self.log_area = self.length.sum(1) + np.log(sine)
        # of links: height, length along, stretch
        self.height = (self.log_area[:, None] - self.length).ravel()
        self.along = self.length.ravel()
        self.stretch = self.along - self.height
        self.across = self.along.reshape(-1, 2)[:, ::-1].ravel()

    def fit(self, values, half, degree):
        from qsmooth.kernels.sheets import fit_along

        out = np.empty(values.size), np.empty(values.size)
        fit_along(*self.order, np.ascontiguousarray(values), half, degree, *out)
        return out

    def beside(self, values, fill):
        """Values of the (up to two) links that lie beside each link in the stack: (n_links, 2)."""
        other = self.neighbours[np.arange(values.size) ^ 1]
        return np.where(other >= 0, values[other ^ 1], fill)

    def noise(self, values):
        _, r = self.fit(values, 3, 2)
        g, _ = self.fit(np.log(r + 1e-8), 8, 0)
        return np.exp(g)

    def without_noise(self, values, bias):
        noise = self.noise(values)
        weight = noise**2 / (noise**2 + NOISE**4)
        if weight.max(initial=0.0) < 1e-6:
            return values
        swap = np.arange(values.size) ^ 1
        x = self.fit(values[swap], 5, 2)[0][swap]
        f = self.fit(x, 8, 1)[0]
        r = self.fit((x - f)[swap], 3, 0)[0][swap]
        f += self.fit(r, 2, 0)[0]
        return values + weight * (f + (0.5 * noise if bias else 0.0) - values)

    def layers(self):
        s, _ = self.fit(self.stretch, 4, 0)
        sine, _ = self.fit(np.repeat(self.sine, 2), 4, 0)
        scatter = np.sqrt(self.fit(self.fit(self.height, 3, 2)[1], 6, 0)[0])
        self.regular = step(sine, *LAYER_SINE) * (1 - step(scatter, LAYER_SCATTER[1], LAYER_SCATTER[0]))
        offsets, links, _ = self.order
        counts = np.diff(offsets)
        means = np.add.reduceat(self.regular[links], offsets[:-1]) / counts
        whole = np.empty(s.size)
        whole[links] = np.repeat(step(means, *LAYER_SHARE), counts)
        own = step(s, *LAYER_STRETCH) * self.regular * whole
        a = self.beside(own, 0.0)
        ids = np.arange(own.size)
        other = self.neighbours[ids ^ 1]
        # two beside each other on the same side
        far = np.zeros((own.size, 2))
        for k in range(2):
            n = other[:, k]
            m = np.where(n >= 0, self.neighbours[n, 0], -1)
            m2 = np.where(n >= 0, self.neighbours[n, 1], -1)
            back = m == (ids ^ 1)
            nxt = np.where(back, m2, m)
            far[:, k] = np.where((n >= 0) & (nxt >= 0), np.minimum(a[:, k], own[nxt ^ 1]), 0.0)
        stack = np.maximum(np.minimum(a[:, 0], a[:, 1]), far.max(1))
        link = np.minimum(own, stack)
        layer = link.reshape(-1, 2).max(1)
        self.core = layer
        regular = self.regular.reshape(-1, 2).min(1)
        nb = self.neighbours.reshape(-1, 4)
        for _ in range(REACH):
            near = np.where(nb >= 0, layer[nb >> 1], 0.0).max(1)
            layer = np.maximum(layer, DECAY * near * regular)
        return layer


def rectangle_corners(ratio):
    out = np.zeros((len(ratio), 4, 3))
    out[:, 0::2, 0] = (1 / ratio)[:, None]
    out[:, 0::2, 2] = ratio[:, None]
    out[:, 1::2, 0] = ratio[:, None]
    out[:, 1::2, 2] = (1 / ratio)[:, None]
    return out


def ideal(topology: Topology) -> Targets:
    s = topology.cell_sizes[topology.corner_cells]
    corners = np.where((s == 4)[:, None], [[1, 0, 1.0]], [[2 * ROOT, -ROOT, 2 * ROOT]])
    n = topology.n_cells
    return Targets(corners, np.full(n, np.nan), np.zeros(n), np.zeros(n, bool), "ideal")


def learned(topology, xy, squares=False):
    t = ideal(topology)
    sh = Sheets(topology, xy)
    layer = sh.layers()
    h = sh.without_noise(sh.height, True).reshape(-1, 2)
    length = sh.without_noise(sh.across, False).reshape(-1, 2)[:, ::-1]
    raw = sh.length[:, 0] - sh.length[:, 1]
    mean, _ = sh.fit(sh.across, 7, 0)
    mean = mean.reshape(-1, 2)
    log = mean[:, 1] - mean[:, 0]
    blend = np.zeros_like(log) if squares else log * step(np.abs(log), *LEARNED)
    phi = 0.5 + 0.5 * np.clip(log / math.log(4.0), -1, 1)
    p = phi * length[:, 0] + (1 - phi) * h[:, 1]
    q = phi * h[:, 0] + (1 - phi) * length[:, 1]
    ratio = layer * (p - q) + (1 - layer) * blend
    area = p + q
    nq = sh.n_quads
    corners = t.corners.copy()
    corners[sh.sides[:nq]] = rectangle_corners(np.exp(ratio[:nq]))
    a, g, lay = t.area.copy(), t.size_weight.copy(), t.is_layer.copy()
    a[sh.first[:nq]] = np.exp(area[:nq])
    g[sh.first[:nq]] = layer[:nq]
    lay[sh.first[:nq]] = layer[:nq] > 0.5
    return Targets(corners, a, g, lay, "learned")
