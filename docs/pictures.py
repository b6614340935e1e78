"""Draws the pictures of the documentation, with nothing but the public names of qsmooth.

python docs/pictures.py FOLDER

The documentation draws them anew at every build, and shows each with the code of its function.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from matplotlib.figure import Figure

PICTURES: dict[str, Callable[[], Figure]] = {}


def picture(draw: Callable[[], Figure]) -> Callable[[], Figure]:
    """Put a function that draws a figure into the gallery, under its own name."""
    PICTURES[draw.__name__] = draw
    return draw


@picture
def first_mesh() -> Figure:
    """The spiral before and after, cells coloured by their largest angles.

    1.9K quads, most of them slim where the arms are narrow.
    """
    from qsmooth import plot_comparison, smooth
    from qsmooth.examples import spiral

    mesh = spiral()
    return plot_comparison(mesh, smooth(mesh))


@picture
def worst_place() -> Figure:
    """The neighbourhood of the spiral's worst cell, before and after.

    The same two meshes, seen from near.
    """
    from qsmooth import plot_comparison, smooth
    from qsmooth.examples import spiral

    mesh = spiral()
    return plot_comparison(mesh, smooth(mesh), view="worst")


@picture
def histograms() -> Figure:
    """How many cells have which angles and aspect ratios, before and after.

    Of the spiral; the bars of each metric add up to all cells.
    """
    from qsmooth import plot_histograms, smooth
    from qsmooth.examples import spiral

    return plot_histograms(smooth(spiral()))


@picture
def untangled() -> Figure:
    """A grid whose vertices have been thrown about, and what `untangle` makes of it.

    Every cell is valid in the end, and none has been asked to be beautiful.
    """
    from qsmooth import plot_comparison, untangle
    from qsmooth.examples import tangled

    mesh = tangled(16, 12)
    return plot_comparison(mesh, untangle(mesh), metric="shape")


@picture
def kept_layers() -> Figure:
    """Layers over a wall keep their heights: the target that is learned from the mesh.

    Cells by aspect ratio. Thin cells at the wall are meant; the default leaves them as they are.
    """
    from qsmooth import plot_comparison, smooth
    from qsmooth.examples import boundary_layer

    mesh = boundary_layer()
    return plot_comparison(mesh, smooth(mesh), metric="aspect_ratio")


@picture
def baseline() -> Figure:
    """Laplacian smoothing around a notch: cells fold over, as nothing guards them.

    Cells by shape; 0 is a cell that is not valid. The guarded methods cannot do this.
    """
    from qsmooth import plot_comparison, smooth
    from qsmooth.examples import notch

    mesh = notch()
    return plot_comparison(mesh, smooth(mesh, "laplacian"), metric="shape")


def draw_all(folder: Path) -> list[Path]:
    """Draw every picture into `folder`, and return the files."""
    import matplotlib as mpl

    mpl.use("Agg")
    folder.mkdir(parents=True, exist_ok=True)
    paths = []
    for name, draw in PICTURES.items():
        paths.append(folder / f"{name}.png")
        draw().savefig(paths[-1], dpi=80)
    return paths


if __name__ == "__main__":
    print("\n".join(str(path) for path in draw_all(Path(sys.argv[1]))))
