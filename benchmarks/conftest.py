"""Meshes of two sizes, one that fits in cache and one that does not; Numba's cache as in tests."""

import os
import platform
from pathlib import Path

import numpy as np
import pytest

from numba_cache import key_cache

key_cache()

SHARED = Path(__file__).resolve().parent.parent.parent / "shared" / "meshes"
RATIOS = pytest.StashKey[list[str]]()


def pytest_configure(config):
    config.stash[RATIOS] = []


@pytest.fixture(scope="session")
def smoke(request) -> bool:
    """Whether the benchmarks only have to run, and not to measure."""
    return bool(request.config.getoption("benchmark_disable"))


@pytest.fixture(scope="session", params=["2K", "250K"])
def mesh(request, smoke):
    """Fits in cache; does not."""
    from meshes import rough_grid
    from qsmooth import Mesh

    return Mesh(*rough_grid(45 if request.param == "2K" or smoke else 500))


@pytest.fixture(params=["spiral_2k.off", "superior_24k.off"])
def lake(request):
    """The meshes of the paper's comparison, where the shared folder is beside the checkout."""
    from qsmooth import read_mesh

    if not SHARED.is_dir():
        pytest.skip("the folder of real meshes is not here")
    return read_mesh(SHARED / request.param)


@pytest.fixture
def note(benchmark, request):
    """Put what a figure depends on beside it."""

    def put(mesh, threads=1, **more):
        benchmark.extra_info.update(
            vertices=mesh.n_vertices, cells=mesh.n_cells, threads=threads, **more
        )

    return put


@pytest.fixture
def put_rate(benchmark):
    """Put what was done a second beside a figure, and what each vertex or cell asks for on paper.

    Bytes are those that have to come from memory or go there once the mesh is beyond the caches,
    operations those on floating-point numbers, a division or a root counted as one.
    """

    def put(what, count, *, moved, operations):
        benchmark.extra_info.update({f"bytes a {what}": moved, f"operations a {what}": operations})
        if benchmark.stats is not None:  # else it only had to run
            benchmark.extra_info[f"{what} M/s"] = round(1e-6 * count / benchmark.stats.stats.min, 2)

    return put


@pytest.fixture
def print_ratio(request):
    """Have a line printed at the end."""
    return request.config.stash[RATIOS].append


def pytest_terminal_summary(terminalreporter, config):
    lines = config.stash[RATIOS]
    if lines:
        import numba

        terminalreporter.section("ratios")
        terminalreporter.line(
            f"{platform.machine()}, {os.cpu_count()} cores, Python {platform.python_version()}, "
            f"numba {numba.__version__}, numpy {np.__version__}"
        )
        for line in lines:
            terminalreporter.line(line)
