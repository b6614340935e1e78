"""What the mesh means to be, all of it put together."""

from __future__ import annotations

import numpy as np

from qsmooth._types import FloatArray, IndexArray
from qsmooth.targets.algebra import rectangle_corners, step
from qsmooth.targets.base import Targets, beside_others, ideal, ideal_corners
from qsmooth.targets.rectangles import rectangles
from qsmooth.targets.sheets import Sheets
from qsmooth.targets.sizes import unit_of
from qsmooth.targets.triangles import fill_triangles
from qsmooth.topology import Topology

# A cell has the shape of a layer's to the full when it is half of the layer.
LAYER_SHAPE = 0.0, 0.5
# Sizes of layers' cells count so much more beside others, whose shape else costs their height: 1.05
# times of it at the trailing edge of an airfoil, and 1.04 with this.
BORDER_WEIGHT = 3.0

# Ratios of fewer of the cells than this are none: they could not make the mean so much better.
LEAST_RATIOS = 0.01
# Quads whose corners are written together: all at once take as much memory as the targets.
CHUNK = 2**16


def learned(topology: Topology, xy: FloatArray) -> Targets:
    """Find out what the mesh means to be, all of it; see the head of this module.

    Parameters
    ----------
    xy : (n_vertices, 2)
        A valid mesh; what is invalid is taken for isotropic.
    """
    return candidates(topology, xy)[1]


def candidates(
    topology: Topology, xy: FloatArray, mended: FloatArray | None = None
) -> tuple[Targets, Targets]:
    """Find out what the mesh means to be, in two ways.

    They differ in the quads that are of no layer. A stretched one may be meant, as over a bump, or
    be distorted; which, the mean stage tells: go on from the result with the larger mean shape to
    squares.

    Parameters
    ----------
    xy : (n_vertices, 2)
        The mesh; what is invalid is taken for isotropic.
    mended : (n_vertices, 2)
        The same without invalid cells, where there are so many that `xy` says little: ratios are
        learned from this, and layers and gradings are those that are there in both, as they are in
        `xy`. Tangles and what untangling leaves may look like layers, and mean nothing.

    Returns
    -------
    squares, ratios
        With squares there, and with learned ratios of sides; the same object where no ratio is
        learned, or of hardly a cell. Where there is no layer, stretched triangle or grading the
        first is `ideal`.
    """
    unit = unit_of(xy)
    xy = xy / unit
    sheets = Sheets(topology, xy)
    layer, mended_sheets = sheets.layers(), sheets
    stays = np.ones(topology.n_cells, np.bool_)
    if mended is not None:
        stays = candidates(topology, mended)[0].size_weight > 0.0
        layer *= stays[sheets.first] & stays[sheets.second]
        mended_sheets = Sheets(topology, mended / unit_of(mended))
    log_ratio, log_area = rectangles(sheets) if layer.any() else (np.zeros(layer.size),) * 2
    ratios = mended_sheets.learned_ratios()
    n_quads = sheets.n_quads
    quads, places = sheets.first[:n_quads], sheets.sides[:n_quads]
    plain = ideal(topology)
    area, corners = np.zeros(topology.n_cells), plain.corners
    weight, is_layer = plain.size_weight, plain.is_layer
    area[quads], weight[quads] = log_area[:n_quads], layer[:n_quads]
    fill_triangles(topology, xy, sheets, layer, log_ratio, log_area, corners, area, weight)
    if not stays.all():
        changed = np.repeat(~stays, topology.cell_sizes)
        corners[changed] = ideal_corners(topology)[changed]
        weight[~stays] = 0.0
    for cells in (sheets.first, sheets.second):
        is_layer[cells] = layer > 0.5
    weight[beside_others(topology, is_layer)] *= BORDER_WEIGHT
    share = step(layer[:n_quads], LAYER_SHAPE)
    stretched = int(np.count_nonzero(ratios[:n_quads] * (1.0 - share)))
    sizes = np.where(weight > 0.0, np.exp(area) * unit**2, np.nan)
    own = share * log_ratio[:n_quads]
    with_ratios = None
    if stretched >= max(LEAST_RATIOS * topology.n_cells, 1):
        with_ratios = corners.copy()
        _put_rectangles(with_ratios, places, own + (1.0 - share) * ratios[:n_quads])
    # Where there is no layer the quads are squares already.
    is_plain = not weight.any()
    if not is_plain:
        _put_rectangles(corners, places, own)
    squares = Targets(corners, sizes, weight, is_layer, "ideal" if is_plain else "squares")
    if with_ratios is None:
        return squares, squares
    return squares, squares._replace(corners=with_ratios, kind="ratios")


def _put_rectangles(corners: FloatArray, places: IndexArray, log_ratio: FloatArray) -> None:
    """Let quads at these places, (m, 4), be rectangles, in place; a few at a time."""
    for first in range(0, log_ratio.size, CHUNK):
        some = slice(first, first + CHUNK)
        corners[places[some]] = rectangle_corners(log_ratio[some])
