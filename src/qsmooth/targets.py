"""What shape and size each cell is meant to have.

The optimiser lowers, at every corner with edge vectors u and w,

    f(L u, L w) + ½ γ (τ − 1/τ)²,    τ = det(u, w) / (the cell's target area),

f being the energy of `kernels.corner_energy` to the corner's target. `Targets` holds the
coefficients of f, the map L, the areas and γ, all of them frozen: none depends on the coordinates
while vertices move.

``"auto"`` learns them from the mesh, by one idea: *what varies smoothly is meant, what varies at
random is not.* Three things are asked of every cell, and answered by weights from 0 to 1 that are
smooth in the coordinates, as nothing may hang on a last digit.

* Is it of a layer? Layers are sheets of quads (`kernels.sheets`), or of triangles that pair to
  quads, which are stretched along the sheet and nearly rectangular, whose heights scatter little,
  that lie at least three deep, and on sheets that are nearly rectangular from end to end. A
  distorted mesh has such quads too, but no such sheets. The regular grid that a layer grows out
  into belongs to it. Such a cell is to have right angles, and its own length and area, hence
  height; less what is noise in these.
* If not, is it stretched, as its neighbours are? Quads: their sides are averaged along the
  sheets. Triangles: their metrics are averaged with those around.
* Is the area of a triangle part of a smooth grading?

Everything else is to be a square or an equilateral triangle of any size.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple, TypeAlias

import numpy as np
import numpy.typing as npt

from qsmooth._types import BoolArray, FloatArray, IndexArray
from qsmooth.mesh import Mesh
from qsmooth.topology import Topology

Metric: TypeAlias = "npt.ArrayLike | Callable[[FloatArray], npt.ArrayLike]"
Range: TypeAlias = tuple[float, float]

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
# A cell has the shape of a layer's to the full when it is half of the layer.
LAYER_SHAPE = 0.0, 0.5
# Half the windows of the fits along sheets, in links: for these figures, and for scatter.
LAYER_WINDOW, SCATTER_WINDOW = 4, 6

# Scatter in log lengths at which half of what the fits leave is taken for noise. Shaken layers
# have .05 to .4; layers as they are less than .014.
NOISE = 0.05
# Scatter is what a parabola over 2 · 3 + 1 links leaves, averaged in logarithms over 2 · 8 + 1: a
# kink, as at a leading edge, is large in a few links, noise in all.
NOISE_WINDOWS = 3, 8
# Mean square, and weight, that count as none.
LEAST_SQUARE, LEAST_WEIGHT = 1e-8, 1e-3
# Windows and degrees of the fits that take noise away: across the sheets, as the layers share
# their vertices' noise with opposite signs; along; and what is left, across and along again.
# The best of 27 for the heights of the first layers of five shaken meshes.
NOISE_FITS = (5, 2), (8, 1), (3, 0), (2, 0)

# Learned ratios of quads: squares up to the first, the average ratio from the second.
LEARNED_RATIO = math.log(2.0), math.log(4.0)
LEARNED_WINDOW = 7

# Averages of triangles' metrics, over so many rings, that are stretched as much mean it.
TRIANGLE_STRETCH, TRIANGLE_RINGS = (math.log(4.0), math.log(8.0)), 4
TRIANGLE_SCATTER = 0.6, 0.3
# Log areas are averaged over so many rings; noise is what differs from that, averaged over some
# more, and trend how far the averages vary in the whole mesh. Trend over noise: random triangles
# .7, meshes meant to be uniform .5 to 1.6, graded ones 3 to 100, tri_adapt 17 and shaken 3.2.
AREA_RINGS, NOISE_RINGS = 3, 6
AREA_TREND = 2.0, 4.0
# Added to the noise, so that a mesh of equal cells has no trend.
LEAST_NOISE = 0.01

_ROOT3 = math.sqrt(3.0)
SQUARE = np.array([1.0, 0.0, 1.0])
EQUILATERAL = np.array([2.0 / _ROOT3, -1.0 / _ROOT3, 2.0 / _ROOT3])


class Targets(NamedTuple):
    """The shape and size that each cell is meant to have; lengths in the mesh's own unit.

    Attributes
    ----------
    corners : (n_corners, 3)
        m11, m12, m22 of `corner_energy.Target` at each position of `topology.cell_vertices`, with
        u the edge to the cell's next vertex, w that to its previous one; m11 m22 − m12² = 1.
    area : (n_cells,)
        Target of det(u, w) at each corner: length times height of a quad, *twice* the area of a
        triangle. NaN where `size_weight` is 0.
    size_weight : (n_cells,)
        The weight γ of the size term, 0 or more.
    is_layer : (n_cells,)
        Cells of layers: the larger part of what is asked of them is to stay as they are.
    kind
        What the targets are, for reports.
    maps : (n_cells, 3) or None
        l11, l12, l22 of a symmetric L with determinant one, which edges are mapped by before f is
        taken; None where all are the identity. The size term takes the edges as they are.
    """

    corners: FloatArray
    area: FloatArray
    size_weight: FloatArray
    is_layer: BoolArray
    kind: str
    maps: FloatArray | None = None


# -------------------------------------------------------------------------- what the caller asks


def ideal(topology: Topology) -> Targets:
    """Ask for squares and equilateral triangles of any size."""
    n = topology.n_cells
    return Targets(
        corners=_ideal_corners(topology),
        area=np.full(n, np.nan),
        size_weight=np.zeros(n),
        is_layer=np.zeros(n, np.bool_),
        kind="ideal",
    )


def initial(topology: Topology, xy: FloatArray) -> Targets:
    """Ask each cell for its own size, ratio and direction, quads with right angles.

    A quad's are those of the parallelogram of its bimedians: their lengths, and the rotation that
    comes nearest to their directions (the orthogonal factor of the polar decomposition).

    Parameters
    ----------
    xy : (n_vertices, 2)
        A valid mesh; a cell without area counts as ideal, of any size.
    """
    n = topology.n_cells
    area, weight, maps = np.full(n, np.nan), np.zeros(n), np.tile(SQUARE, (n, 1))
    for size, cells, places in _blocks(topology):
        p = xy[topology.cell_vertices[places]]
        if size == 4:
            u, w = p[:, 1] + p[:, 2] - p[:, 0] - p[:, 3], p[:, 2] + p[:, 3] - p[:, 0] - p[:, 1]
            u, w = 0.5 * u, 0.5 * w
        else:  # what maps the square's sides to these maps the equilateral triangle to the cell
            u, w = p[:, 1] - p[:, 0], (2.0 * p[:, 2] - p[:, 0] - p[:, 1]) / _ROOT3
        det = u[:, 0] * w[:, 1] - u[:, 1] * w[:, 0]
        good = det > 0.0
        u, w, det = u[good], w[good], det[good]
        if size == 4:
            u, w = _squared(u, w)
        # M = (A Aᵀ)⁻¹ with A = (u, w).
        xx, xy_, yy = (_sums(u, w, i, j) for i, j in ((0, 0), (0, 1), (1, 1)))
        maps[cells[good]] = _unit_root(np.stack([yy, -xy_, xx], axis=1))
        area[cells[good]] = det if size == 4 else 0.5 * _ROOT3 * det
        weight[cells[good]] = 1.0
    return Targets(_ideal_corners(topology), area, weight, np.zeros(n, np.bool_), "initial", maps)


def from_ratios(mesh: Mesh, ratios: npt.ArrayLike) -> Targets:
    """Ask each quad for a rectangle of a given ratio, of any size.

    Parameters
    ----------
    ratios : (n_cells,)
        Length of sides 0 (from the cell's first vertex to its second) and 2 over that of sides 1
        and 3, cells and vertices in the caller's order.

    Raises
    ------
    ValueError
        If the mesh has triangles, or if that is no array of positive numbers, one a cell.
    """
    topology = mesh.topology
    if (topology.cell_sizes == 3).any():
        raise ValueError("target: ratios of sides are for meshes of quads only")
    array = _numbers(ratios, "ratios")
    if array.shape != (topology.n_cells,):
        raise ValueError(
            f"target: ratios must have the shape ({topology.n_cells},), got {array.shape}"
        )
    if not (np.isfinite(array) & (array > 0.0)).all():
        bad = int(np.argmin(np.isfinite(array) & (array > 0.0)))
        raise ValueError(f"target: ratios must be positive, got {array[bad]} for cell {bad}")
    # A turned cell keeps its first corner: the caller's side 0 is its side 3.
    ratio = np.where(topology.turned, 1.0 / array, array)
    corners = _rectangle_corners(np.log(ratio)).reshape(-1, 3)
    return ideal(topology)._replace(corners=corners, kind="ratios")


def from_metric(mesh: Mesh, metric: Metric, xy: FloatArray | None = None) -> Targets:
    """Ask for cells of size one in a metric: eᵀ M e = 1 for an edge e that is as long as is meant.

    Parameters
    ----------
    metric
        Symmetric, positive definite tensors M in 1/length², (n_vertices, 2, 2), in the axes of
        `mesh.xy`, which are averaged over the corners of each cell in logarithms; or a function of
        places, (k, 2) → (k, 2, 2), called with the middles of the cells.
    xy : (n_vertices, 2), optional
        Where the vertices are now, for a function: once they have moved it is to be asked again.

    Raises
    ------
    ValueError
        If there is not one such tensor for each.
    """
    topology = mesh.topology
    xy = mesh.xy if xy is None else xy
    count = topology.cell_sizes[:, None]
    if callable(metric):
        middles = np.add.reduceat(xy[topology.cell_vertices], topology.cell_offsets[:-1]) / count
        tensors = _checked_tensors(metric(middles), topology.n_cells, "cell", "cells")
    else:
        at_vertices = _checked_tensors(metric, topology.n_vertices, "vertex", "vertices")
        logs = _of_eigenvalues(at_vertices, np.log)[topology.cell_vertices]
        means = np.add.reduceat(logs, topology.cell_offsets[:-1]) / count
        tensors = _of_eigenvalues(means, np.exp)
    det = tensors[:, 0] * tensors[:, 2] - tensors[:, 1] ** 2
    shape = np.where(topology.cell_sizes == 3, 0.5 * _ROOT3, 1.0)
    n = topology.n_cells
    return Targets(
        corners=_ideal_corners(topology),
        area=shape / np.sqrt(det),
        size_weight=np.ones(n),
        is_layer=np.zeros(n, np.bool_),
        kind="metric",
        maps=_unit_root(tensors),
    )


def with_sizes(targets: Targets, topology: Topology, xy: FloatArray, weight: float) -> Targets:
    """Ask for a size of every cell: that of the targets, else its own, averaged as gradings are.

    Parameters
    ----------
    xy : (n_vertices, 2)
        A valid mesh; the area of a cell without any counts as the mean of all.
    weight
        Weight of the size term; layers keep theirs where that is larger.
    """
    sized = targets.size_weight > 0.0
    area = targets.area
    if not sized.all():
        unit = _unit(xy)
        own = _without_area_noise(topology, _log_areas(topology, xy / unit))[0]
        area = np.where(sized, area, np.exp(own) * unit**2)
    heavier = np.where(targets.is_layer, np.maximum(targets.size_weight, weight), weight)
    return targets._replace(area=area, size_weight=heavier)


def _unit(xy: FloatArray) -> float:
    """Give a power of two near the size of the mesh: in it logarithms do not depend on the unit."""
    size = float(np.ptp(xy, axis=0).max(initial=0.0))
    return math.ldexp(1.0, math.frexp(size)[1]) if size > 0.0 else 1.0


def without_sizes(targets: Targets) -> Targets:
    """Ask for no size, but of layers."""
    return targets._replace(size_weight=np.where(targets.is_layer, targets.size_weight, 0.0))


def _log_areas(topology: Topology, xy: FloatArray) -> FloatArray:
    """Log of what a cell's corners have for determinants, in the mean: (n_cells,)."""
    area = np.zeros(topology.n_cells)
    for size, cells, places in _blocks(topology):
        p = xy[topology.cell_vertices[places]]
        u, w = (p[:, 2] - p[:, 0], p[:, 3] - p[:, 1]) if size == 4 else (
            p[:, 1] - p[:, 0], p[:, 2] - p[:, 0]
        )  # fmt: skip
        det = u[:, 0] * w[:, 1] - u[:, 1] * w[:, 0]
        area[cells] = 0.5 * det if size == 4 else det
    good = area > 0.0
    mean = float(area[good].mean()) if good.any() else 1.0
    return np.log(np.where(good, area, mean))


# ------------------------------------------------------------------------- what the mesh asks for


def learned(topology: Topology, xy: FloatArray) -> Targets:
    """Find out what the mesh means to be, all of it; see the head of this module.

    Parameters
    ----------
    xy : (n_vertices, 2)
        A valid mesh; what is invalid is taken for isotropic.
    """
    return candidates(topology, xy)[1]


def candidates(topology: Topology, xy: FloatArray) -> tuple[Targets, Targets]:
    """Find out what the mesh means to be, in two ways.

    They differ in the quads that are of no layer. A stretched one may be meant, as over a bump, or
    be distorted; which, the mean stage tells: go on from the result with the larger mean shape to
    squares.

    Parameters
    ----------
    xy : (n_vertices, 2)
        A valid mesh; what is invalid is taken for isotropic.

    Returns
    -------
    squares, ratios
        With squares there, and with learned ratios of sides; the same object where no ratio is
        learned. Where there is no layer, stretched triangle or grading the first is `ideal`.
    """
    unit = _unit(xy)
    xy = xy / unit
    sheets = Sheets(topology, xy)
    layer = sheets.layers()
    log_ratio, log_area = sheets.rectangles() if layer.any() else (np.zeros(layer.size),) * 2
    ratios = sheets.learned_ratios()
    n_quads = sheets.n_quads
    quads, places = sheets.first[:n_quads], sheets.sides[:n_quads]
    plain = ideal(topology)
    area, weight, is_layer = np.zeros(topology.n_cells), plain.size_weight, plain.is_layer
    corners = plain.corners
    area[quads], weight[quads] = log_area[:n_quads], layer[:n_quads]
    _triangle_targets(topology, xy, sheets, layer, log_ratio, log_area, corners, area, weight)
    for cells in (sheets.first, sheets.second):
        is_layer[cells] = layer > 0.5
    found = []
    share = _step(layer[:n_quads], LAYER_SHAPE)
    for other in (np.zeros(n_quads), ratios[:n_quads]):
        both = share * log_ratio[:n_quads] + (1.0 - share) * other
        with_quads = corners.copy()
        with_quads[places] = _rectangle_corners(both)
        found.append(with_quads)
    sizes = np.where(weight > 0.0, np.exp(area) * unit**2, np.nan)
    is_plain = not weight.any() and np.array_equal(found[0], plain.corners)
    squares = Targets(found[0], sizes, weight, is_layer, "ideal" if is_plain else "squares")
    if not (ratios[:n_quads] * (1.0 - share)).any():
        return squares, squares
    return squares, squares._replace(corners=found[1], kind="ratios")


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
        own = _step(stretch, LAYER_STRETCH)
        if not own.any():
            return np.zeros(len(self.sides))
        sine, _ = self.fit(np.repeat(self.sine, 2), LAYER_WINDOW, 0)
        _, square = self.fit(self.height, NOISE_WINDOWS[0], 2)
        scatter = np.sqrt(self.fit(square, SCATTER_WINDOW, 0)[0])
        regular = _step(sine, LAYER_SINE) * _step(scatter, LAYER_SCATTER)
        own *= regular * _step(self._sheet_means(regular), LAYER_SHARE)
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
        height = self._without_noise(self.height, logarithm_of_mean=True).reshape(-1, 2)
        length = self._without_noise(self.across).reshape(-1, 2)[:, ::-1]
        ratio = (self.length[:, 0] - self.length[:, 1]) / math.log(4.0)
        share = 0.5 + 0.5 * np.clip(ratio, -1.0, 1.0)
        p = share * length[:, 0] + (1.0 - share) * height[:, 1]
        q = share * height[:, 0] + (1.0 - share) * length[:, 1]
        return p - q, p + q

    def _without_noise(self, values: FloatArray, logarithm_of_mean: bool = False) -> FloatArray:
        """Take away what scatters along the sheets, and leave what varies smoothly."""
        _, square = self.fit(values, NOISE_WINDOWS[0], 2)
        square = np.exp(self.fit(np.log(square + LEAST_SQUARE), NOISE_WINDOWS[1], 0)[0])
        weight = square**2 / (square**2 + NOISE**4)
        if (weight < LEAST_WEIGHT).all():
            return values
        first, second, third, fourth = NOISE_FITS
        across = self._other(self.fit(self._other(values), *first)[0])
        along, _ = self.fit(across, *second)
        left = self._other(self.fit(self._other(across - along), *third)[0])
        smooth = along + self.fit(left, *fourth)[0]
        if logarithm_of_mean:  # E log(1 + z) = −½ E z²: to the second order
            smooth += 0.5 * square
        return values + weight * (smooth - values)

    def learned_ratios(self) -> FloatArray:
        """Log ratio of sides 0 and 2 over 1 and 3, averaged along the sheets, 0 if small: (n,)."""
        mean = self.fit(self.across, LEARNED_WINDOW, 0)[0].reshape(-1, 2)
        log = mean[:, 1] - mean[:, 0]
        return np.asarray(log * _step(np.abs(log), LEARNED_RATIO))


def _triangle_targets(
    topology: Topology,
    xy: FloatArray,
    sheets: Sheets,
    layer: FloatArray,
    log_ratio: FloatArray,
    log_area: FloatArray,
    corners: FloatArray,
    area: FloatArray,
    weight: FloatArray,
) -> None:
    """Fill in corners, log areas and weights of the triangles, in place."""
    triangles = np.flatnonzero(topology.cell_sizes == 3)
    if not triangles.size:
        return
    first = topology.cell_offsets[triangles]
    p = xy[topology.cell_vertices[first[:, None] + np.arange(3)]]
    u, w = p[:, 1] - p[:, 0], p[:, 2] - p[:, 0]
    det = u[:, 0] * w[:, 1] - u[:, 1] * w[:, 0]
    good = det > 0.0
    in_plane = np.zeros((topology.n_cells, 3))
    in_plane[triangles, :2] = _log_in_plane(u, w, np.where(good, det, 1.0)) * good[:, None]
    in_plane[:, 2] = _dots(in_plane, in_plane)
    mean = _over_rings(topology, in_plane, TRIANGLE_RINGS)[triangles]
    stretch = np.hypot(mean[:, 0], mean[:, 1])
    scatter = np.sqrt(np.maximum(mean[:, 2] - stretch**2, 0.0))
    meant = _step(stretch, TRIANGLE_STRETCH) * good
    meant *= _step(scatter / np.maximum(stretch, TRIANGLE_STRETCH[0]), TRIANGLE_SCATTER)
    log_shape = np.zeros((triangles.size, 2))
    rows = np.flatnonzero(meant)
    u, w = u[rows], w[rows]
    own = np.stack([_dots(w, w), -_dots(u, w), _dots(u, u)], axis=1) / det[rows, None]
    log_shape[rows] = meant[rows, None] * _log_from_equilateral(own)

    graded, log_det = _grading(topology, xy)
    log_det, own_weight = log_det[triangles], np.maximum(graded[triangles], meant) * good
    # Pairs that are of a layer: halves of rectangles.
    place = np.full(topology.n_cells, -1)
    place[triangles] = np.arange(triangles.size)
    pairs = np.arange(sheets.n_quads, len(sheets.sides))
    pairs = pairs[layer[pairs] > 0.0]
    for cells, side in ((sheets.first, 0), (sheets.second, 2)):
        rows = place[cells[pairs]]
        half = _half_rectangle(log_ratio[pairs], sheets.sides[pairs, side] - first[rows])
        share = layer[pairs]
        log_shape[rows] += share[:, None] * (_log_from_equilateral(half) - log_shape[rows])
        log_det[rows] += share * (log_area[pairs] - log_det[rows])
        own_weight[rows] = np.maximum(own_weight[rows], share)
    rows = np.flatnonzero(log_shape.any(axis=1))
    own = _corners_of_triangle(_from_log(log_shape[rows]))
    corners[first[rows, None] + np.arange(3)] = own
    area[triangles], weight[triangles] = log_det, own_weight


def _grading(topology: Topology, xy: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Weight of the areas as part of a smooth grading, and their logs without noise: (n_cells,).

    The areas are those of a corner: twice a triangle's. Quads count as neighbours only.
    """
    n = topology.n_cells
    area = np.empty(n)
    for _, cells, places in _blocks(topology):
        p = xy[topology.cell_vertices[places]]
        d, e = p[:, 2] - p[:, 0], p[:, -1] - p[:, 1]
        area[cells] = np.abs(d[:, 0] * e[:, 1] - d[:, 1] * e[:, 0])
    logs = np.log(np.maximum(area, 1e-60 * area.max()))
    cleaned, smooth, noise = _without_area_noise(topology, logs)
    trend = float(smooth[topology.cell_sizes == 3].std())
    return _step(trend / (noise + LEAST_NOISE), AREA_TREND), cleaned


def _without_area_noise(
    topology: Topology, logs: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Log areas without noise; what is smooth in them, less their mean; and the noise."""
    centred = logs - logs.mean()
    smooth = _over_rings(topology, centred[:, None], AREA_RINGS)[:, 0]
    noise = np.sqrt(_over_rings(topology, ((centred - smooth) ** 2)[:, None], NOISE_RINGS)[:, 0])
    share = noise**4 / (noise**4 + NOISE**4)
    return logs + share * (smooth - centred), smooth, noise


def _over_rings(topology: Topology, values: FloatArray, rings: int) -> FloatArray:
    """Average over neighbours, so often; (n_cells, k)."""
    from qsmooth.kernels.sheets import mean_with_neighbours

    old, new = values.copy(), np.empty_like(values)
    for _ in range(rings):
        mean_with_neighbours(topology.cell_offsets, topology.twins, topology.corner_cells, old, new)
        old, new = new, old
    return old


# ---------------------------------------------------------------------------------- small algebra


def _step(x: FloatArray, limits: Range) -> FloatArray:
    """Smooth step from 0 at the first limit to 1 at the second, which may be the smaller."""
    t = np.clip((x - limits[0]) / (limits[1] - limits[0]), 0.0, 1.0)
    return np.asarray(t * t * (3.0 - 2.0 * t))


def _dots(u: FloatArray, w: FloatArray) -> FloatArray:
    return np.asarray(u[:, 0] * w[:, 0] + u[:, 1] * w[:, 1])


def _sums(u: FloatArray, w: FloatArray, i: int, j: int) -> FloatArray:
    """Entry i, j of A Aᵀ with A = (u, w)."""
    return np.asarray(u[:, i] * u[:, j] + w[:, i] * w[:, j])


def _blocks(topology: Topology) -> list[tuple[int, IndexArray, IndexArray]]:
    """Triangles and quads: 3 or 4, the cells, (m,), and their corners' positions, (m, 3 or 4)."""
    out = []
    for size in (3, 4):
        cells = np.flatnonzero(topology.cell_sizes == size)
        if cells.size:
            out.append((size, cells, topology.cell_offsets[cells][:, None] + np.arange(size)))
    return out


def _ideal_corners(topology: Topology) -> FloatArray:
    is_triangle = topology.cell_sizes[topology.corner_cells] == 3
    return np.where(is_triangle[:, None], EQUILATERAL, SQUARE)


def _rectangle_corners(log_ratio: FloatArray) -> FloatArray:
    """Coefficients at the four corners of rectangles, log |side 0| / |side 1| given: (m, 4, 3)."""
    out = np.zeros((log_ratio.size, 4, 3))
    ratio, inverse = np.exp(log_ratio), np.exp(-log_ratio)
    out[:, 0::2, 0] = out[:, 1::2, 2] = inverse[:, None]
    out[:, 1::2, 0] = out[:, 0::2, 2] = ratio[:, None]
    return out


def _half_rectangle(log_ratio: FloatArray, position: IndexArray) -> FloatArray:
    """Coefficients at the first corner of a triangle that is half a rectangle: (m, 3).

    Its legs are sides `position` and `position` + 1, (m,), and the former is as many times as long
    as the latter.
    """
    ratio, inverse = np.exp(log_ratio), np.exp(-log_ratio)
    zero, both = np.zeros(log_ratio.size), ratio + inverse
    # At the corner that the first leg starts from, at the right angle, and at the last.
    by_corner = np.stack(
        [
            np.stack([both, -ratio, ratio], axis=1),
            np.stack([ratio, zero, inverse], axis=1),
            np.stack([inverse, -inverse, both], axis=1),
        ]
    )
    return np.asarray(by_corner[-position % 3, np.arange(log_ratio.size)])


def _corners_of_triangle(m: FloatArray) -> FloatArray:
    """Coefficients at all corners from those at the first: (m, 3) → (m, 3, 3).

    The numerator of f is the same at each: with edges a + b + c = 0, u = a and w = −c at the first
    corner, u = b and w = −a at the second.
    """
    out = np.empty((len(m), 3, 3))
    out[:, 0] = m
    for k in (1, 2):
        m11, m12, m22 = out[:, k - 1].T
        # u = −w', w = u' − w' with u', w' the edges at the next corner.
        out[:, k] = np.stack([m22, -m12 - m22, m11 + 2.0 * m12 + m22], axis=1)
    return out


def _log_from_equilateral(m: FloatArray) -> FloatArray:
    """Logarithm of E^−½ M E^−½, E the equilateral triangle's: half its xx − yy, and its xy."""
    return _unit_log(*_between(_INVERSE_ROOT, m[:, 0], m[:, 1], m[:, 2]))


def _from_log(log: FloatArray) -> FloatArray:
    """Coefficients M of such a logarithm: (m, 2) → (m, 3)."""
    size = np.hypot(log[:, 0], log[:, 1])
    cosh = np.cosh(size)
    factor = np.where(size > 0.0, np.sinh(size) / np.where(size > 0.0, size, 1.0), 1.0)
    half = factor * log[:, 0]
    return np.stack(_between(_ROOT, cosh + half, factor * log[:, 1], cosh - half), axis=1)


def _between(
    r: tuple[float, float, float], xx: FloatArray, xy: FloatArray, yy: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Entries xx, xy, yy of R N R, R and N symmetric and given by theirs."""
    a, b, c = r
    return (
        a * a * xx + 2.0 * a * b * xy + b * b * yy,
        a * b * xx + (a * c + b * b) * xy + b * c * yy,
        b * b * xx + 2.0 * b * c * xy + c * c * yy,
    )


def _unit_log(xx: FloatArray, xy: FloatArray, yy: FloatArray) -> FloatArray:
    """Logarithm of symmetric matrices with determinant one: half its xx − yy, and its xy."""
    half = 0.5 * (xx - yy)
    sinh = np.hypot(half, xy)
    factor = np.where(sinh > 0.0, np.arcsinh(sinh) / np.where(sinh > 0.0, sinh, 1.0), 1.0)
    return np.stack([factor * half, factor * xy], axis=1)


def _log_in_plane(u: FloatArray, w: FloatArray, det: FloatArray) -> FloatArray:
    """Logarithm of the metric in which a triangle is equilateral, scaled to determinant one."""
    v = (2.0 * w - u) / _ROOT3
    xx, xy, yy = (_sums(u, v, i, j) for i, j in ((1, 1), (0, 1), (0, 0)))
    scale = 2.0 / _ROOT3 * det
    return _unit_log(xx / scale, -xy / scale, yy / scale)


def _squared(u: FloatArray, w: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Turn vectors to right angles by as much each: lengths in proportion, the same area."""
    lengths = np.hypot(u[:, 0], u[:, 1]), np.hypot(w[:, 0], w[:, 1])
    a, b = u / lengths[0][:, None], w / lengths[1][:, None]
    # The middle of a and of b turned back by a right angle.
    d = a + np.stack([b[:, 1], -b[:, 0]], axis=1)
    d /= np.hypot(d[:, 0], d[:, 1])[:, None]
    sine = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
    p, q = (np.sqrt(sine) * length for length in lengths)
    return p[:, None] * d, q[:, None] * np.stack([-d[:, 1], d[:, 0]], axis=1)


def _unit_root(m: FloatArray) -> FloatArray:
    """Square root, scaled to determinant one, of symmetric matrices: xx, xy, yy, (m, 3)."""
    root_det = np.sqrt(m[:, 0] * m[:, 2] - m[:, 1] ** 2)
    n = m / root_det[:, None]
    # Cayley and Hamilton: (N + 1)² = (tr N + 2) N where det N = 1.
    n += SQUARE
    return np.asarray(n / np.sqrt(n[:, 0] + n[:, 2])[:, None])


def _of_eigenvalues(m: FloatArray, function: Callable[[FloatArray], FloatArray]) -> FloatArray:
    """Apply a function to the eigenvalues of symmetric matrices: xx, xy, yy, (m, 3)."""
    middle, half = 0.5 * (m[:, 0] + m[:, 2]), 0.5 * (m[:, 0] - m[:, 2])
    radius = np.hypot(half, m[:, 1])
    high, low = function(middle + radius), function(middle - radius)
    mean = 0.5 * (high + low)
    factor = np.where(radius > 0.0, 0.5 * (high - low) / np.where(radius > 0.0, radius, 1.0), 0.0)
    return np.stack([mean + factor * half, factor * m[:, 1], mean - factor * half], axis=1)


def _numbers(values: npt.ArrayLike, what: str) -> FloatArray:
    try:
        return np.array(values, np.float64)
    except (TypeError, ValueError) as error:
        raise ValueError(f"target: {what} must be numbers: {error}") from None


def _checked_tensors(values: npt.ArrayLike, n: int, one: str, many: str) -> FloatArray:
    """Take tensors, (n, 2, 2), as xx, xy, yy, (n, 3); ValueError where they are no metrics."""
    m = _numbers(values, "metric tensors")
    if m.shape != (n, 2, 2):
        raise ValueError(
            f"target: there must be one metric tensor for each of {n} {many}, ({n}, 2, 2), "
            f"got {m.shape}"
        )
    sizes = np.abs(m).max(axis=(1, 2))
    with np.errstate(invalid="ignore", over="ignore"):
        symmetric = np.abs(m[:, 0, 1] - m[:, 1, 0]) <= 1e-9 * sizes
        definite = (m[:, 0, 0] > 0.0) & (m[:, 0, 0] * m[:, 1, 1] > m[:, 0, 1] * m[:, 1, 0])
    good = np.isfinite(sizes) & symmetric & definite
    if not good.all():
        raise ValueError(
            "target: metric tensors must be symmetric and positive definite, that of "
            f"{one} {int(np.argmin(good))} is not"
        )
    return np.stack([m[:, 0, 0], 0.5 * (m[:, 0, 1] + m[:, 1, 0]), m[:, 1, 1]], axis=1)


# Entries xx, xy, yy of E^½ and E^−½, E being EQUILATERAL; the determinant is one.
_ROOT = tuple(_unit_root(EQUILATERAL[None])[0].tolist())
_INVERSE_ROOT = (_ROOT[2], -_ROOT[1], _ROOT[0])
