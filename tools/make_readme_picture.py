"""Makes `docs/before-after.png`, the picture of the README: a mesh before and after `smooth`.

python tools/make_readme_picture.py

A part of the lake of `qsmooth.examples` is drawn, so that cells can be told apart, each cell in the
colour of its shape: dark where it is bad.
"""

import io
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure
from PIL import Image

from qsmooth import Mesh, quality, smooth
from qsmooth.examples import lake

TARGET = Path(__file__).resolve().parent.parent / "docs" / "before-after.png"
# Lower left corner and size of the part that is drawn, as fractions of the lake's extent.
CORNER, SIZE = (0.475, 0.59), 0.12
# The file is small with few colours: they go to cells in steps of a tenth.
STEPS, COLOURS = 10, 64


def draw(axes, mesh: Mesh, title: str):
    """Draw the cells in view; return the collection, which the colour bar belongs to."""
    measured = quality(mesh)
    cells = mesh.cell_vertices.reshape(-1, 4)
    faces = PolyCollection(
        mesh.xy[cells],
        array=measured.shape,
        cmap=mpl.colormaps["viridis"].resampled(STEPS),
        clim=(0.0, 1.0),
        edgecolor="#303030",
        linewidth=0.4,
    )
    axes.add_collection(faces)
    low, high = mesh.xy.min(axis=0), mesh.xy.max(axis=0)
    size = SIZE * (high - low).max()
    left, bottom = low + np.array(CORNER) * (high - low)
    axes.set(xlim=(left, left + size), ylim=(bottom, bottom + size), aspect="equal")
    axes.set(xticks=[], yticks=[])
    angles = f"{measured.min_angle.min():.1f}° to {measured.max_angle.max():.1f}°"
    shape = measured.shape.mean()
    axes.set_title(f"{title}: angles {angles}, mean shape {shape:.2f}", fontsize=9)
    return faces


def main() -> None:
    """Smooth, draw, save."""
    mesh = lake()
    result = smooth(mesh)
    figure = Figure(figsize=(9.0, 4.4), layout="constrained")
    left, right = figure.subplots(1, 2)
    draw(left, mesh, "Before")
    faces = draw(right, result.mesh, "After")
    figure.colorbar(faces, ax=[left, right], label="shape of a cell, 1 is a square", fraction=0.03)
    drawn = io.BytesIO()
    figure.savefig(drawn, dpi=110)
    Image.open(drawn).convert("RGB").quantize(COLOURS).save(TARGET, optimize=True)
    print(f"{TARGET}: {TARGET.stat().st_size / 1000:.0f} kB; {result.reason}")


if __name__ == "__main__":
    main()
