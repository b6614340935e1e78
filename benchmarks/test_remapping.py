"""Values taken over to new places: squares that are moved back from where they were shaken to."""

import numpy as np
import pytest

from meshes import grid
from qsmooth import transfer
from qsmooth.kernels._jit import use_threads
from qsmooth.remapping import _by_bins, _moments, _slopes, at_vertices

pytestmark = pytest.mark.benchmark(group="remapping")


def straightened(mesh):
    """The same squares without their roughness."""
    side = round(mesh.n_cells**0.5)
    return mesh.with_points(grid(side, side)[0])


@pytest.mark.parametrize("threads", [1, 2])
def test_walks_from_old_stars(benchmark, mesh, note, threads):
    new, vertices = straightened(mesh), np.arange(mesh.n_vertices)
    note(mesh, threads, rate=(mesh.n_vertices, "vertices"))

    def walk():
        return at_vertices(mesh, new.xy, vertices, threads)

    assert (walk().cells >= 0).all()
    benchmark(walk)


@pytest.mark.parametrize("part", ["by bins", "slopes"])
def test_part(benchmark, mesh, note, part):
    new = straightened(mesh)
    note(mesh, rate=(mesh.n_vertices, "vertices") if part == "by bins" else "cells")
    centres, values = _moments(mesh, mesh.xy)[0], np.ones((mesh.n_cells, 1))

    def run():
        if part == "by bins":
            return _by_bins(mesh, new.xy, mesh.xy)
        with use_threads(1):
            return _slopes(mesh, centres, values)

    run()
    benchmark(run)


@pytest.mark.parametrize("part", ["vertices", "cells", "conserving"])
def test_transfer(benchmark, mesh, note, part):
    new, at = straightened(mesh), "vertices" if part == "vertices" else "cells"
    values = np.ones((mesh.n_vertices if at == "vertices" else mesh.n_cells, 2))
    note(mesh)

    def run():
        return transfer(mesh, new, values, at, part == "conserving")

    run()
    benchmark(run)
