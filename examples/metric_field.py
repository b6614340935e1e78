"""Let cells follow a shock: thin across it, long along it, as a metric asks for at every place.

    python examples/metric_field.py [FOLDER]

A bow shock crosses a unit square from bottom to top. The bottom and the top are spaced as the
metric asks; inside, straight lines between them miss the shock. Quads and triangles are made to
follow it. Writes `shock-quads.vtk` and `shock-triangles.vtk`.
"""

import sys
import tempfile
from pathlib import Path

import numpy as np

from qsmooth import Mesh, quality, smooth, write_mesh

COLUMNS, ROWS = 40, 24
# Half the width of the shock, how far it bulges, and how much longer cells are than wide there.
WIDTH, BULGE, ASPECT = 0.005, 0.1, 50.0
# Lengths along the shock, and of cells far away from it: together they make up the square.
LENGTH = (1.0 + (ASPECT - 1.0) * np.pi * WIDTH) / COLUMNS


def widths(places):
    """How wide cells are meant to be, and the direction across the shock."""
    x, y = places.T
    distance = x - 0.5 - BULGE * np.sin(np.pi * y)
    near = 1.0 / np.cosh(np.clip(distance / WIDTH, -100.0, 100.0))
    across = np.stack([np.ones_like(y), -BULGE * np.pi * np.cos(np.pi * y)], axis=1)
    across /= np.linalg.norm(across, axis=1)[:, None]
    return LENGTH / (1.0 + (ASPECT - 1.0) * near), across


def metric(places):
    """Tensors M, (k, 2, 2): an edge e has the length that is meant where e M e = 1."""
    width, across = widths(places)
    along = np.stack([-across[:, 1], across[:, 0]], axis=1)
    thin = across[:, :, None] * across[:, None, :] / width[:, None, None] ** 2
    return thin + along[:, :, None] * along[:, None, :] / LENGTH**2


def square(kind):
    """A grid of straight lines, with its bottom and its top spaced as the metric asks."""
    fine = np.linspace(0.0, 1.0, 100_001)
    width, _ = widths(np.stack([fine, np.zeros_like(fine)], axis=1))
    count = np.concatenate([[0.0], np.cumsum(0.5 * (1.0 / width[1:] + 1.0 / width[:-1]))])
    x = np.interp(np.linspace(0.0, count[-1], COLUMNS + 1), count, fine)
    xx, yy = np.meshgrid(x, np.linspace(0.0, 1.0, ROWS + 1))
    v = np.arange(xx.size).reshape(xx.shape)
    a, b, c, d = (ids.ravel() for ids in (v[:-1, :-1], v[:-1, 1:], v[1:, 1:], v[1:, :-1]))
    cells = np.stack([a, b, c, d], axis=1)
    if kind == "triangles":
        cells = np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])
    return Mesh(np.stack([xx.ravel(), yy.ravel()], axis=1), cells)


def at_shock(mesh):
    """Median over the cells on the shock: aspect ratio, and width over what is meant.

    The width of a cell is that of its shadow on the direction across the shock.
    """
    cells = mesh.cells[0] if isinstance(mesh.cells, list) else mesh.cells
    corners = mesh.points[np.asarray(cells)]
    width, across = widths(corners.mean(axis=1))
    on = width < 2.0 * LENGTH / ASPECT
    shadows = np.ptp(np.einsum("cid,cd->ci", corners, across), axis=1)
    aspects = quality(mesh).aspect_ratio
    return int(on.sum()), float(np.median(aspects[on])), float(np.median((shadows / width)[on]))


def main(folder: Path) -> None:
    """Make a mesh of quads and one of triangles follow the shock, and tell how well they do."""
    for kind in ("quads", "triangles"):
        mesh = square(kind)
        result = smooth(mesh, target=metric)
        target = result.outcome.target
        print(f"{kind}: quality towards the metric {target.before:.3f} -> {target.after:.3f}")
        for name, some in (("before", mesh), ("after", result.mesh)):
            count, aspect, width = at_shock(some)
            print(
                f"  {name}: {count} cells on the shock, aspect ratio {aspect:.0f}, "
                f"width {width:.2f} of what is meant"
            )
        write_mesh(folder / f"shock-{kind}.vtk", result.mesh)


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else tempfile.mkdtemp(prefix="qsmooth-")))
