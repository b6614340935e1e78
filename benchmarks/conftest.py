"""Meshes in cache and beyond, what tables show of each figure; Numba's cache as in tests."""

import os
import platform
from functools import cache
from pathlib import Path

import numpy as np
import pytest

import sweep_bounds
from apart import free_memory
from numba_cache import key_cache

key_cache()

SHARED = Path(__file__).resolve().parent.parent.parent / "shared" / "meshes"
RATIOS = pytest.StashKey[list[str]]()
# Squares a side; the first fits in cache, the second does not, the rest are for --full.
SIDES = {"2K": 45, "250K": 500, "1M": 1000, "10M": 3163}
SHORT = ("2K", "250K")
# What a benchmark may need of memory for a quad: the optimiser's tables and some copies.
BYTES_A_QUAD = 2500
# With the defaults of pytest-benchmark, five rounds and a second each, it takes thrice as long.
LESS = {"benchmark_max_time": 0.1, "benchmark_min_rounds": 3, "benchmark_warmup_iterations": 1}
# Parameters that say what is measured; the rest say on what.
WHAT = ("sweep", "metric", "metrics", "name", "method", "part")
COLUMNS = ["min", "median", "rounds"]


def pytest_addoption(parser):
    parser.addoption(
        "--full", action="store_true", help="benchmarks of all sizes, to ten million quads"
    )


def pytest_configure(config):
    config.stash[RATIOS] = []
    given = {word.partition("=")[0] for word in config.invocation_params.args}
    for name, value in {**LESS, "benchmark_columns": COLUMNS}.items():
        if f"--{name.replace('_', '-')}" not in given:
            setattr(config.option, name, value)


def pytest_generate_tests(metafunc):
    if "mesh" in metafunc.fixturenames:
        sizes = tuple(SIDES) if metafunc.config.getoption("full") else SHORT
        metafunc.parametrize("mesh", sizes, indirect=True, scope="session")


def pytest_collection_modifyitems(config, items):
    """Leave out small meshes on several threads, which the package keeps on one."""
    small = [item for item in items if _is_small_on_threads(item)]
    config.hook.pytest_deselected(items=small)
    items[:] = [item for item in items if item not in small]


def _is_small_on_threads(item):
    params = item.callspec.params if hasattr(item, "callspec") else {}
    return params.get("mesh") == "2K" and params.get("threads", 1) > 1


@pytest.fixture(autouse=True)
def group(request, benchmark):
    """Have a table for each kernel, method or metric."""
    call = getattr(request.node, "callspec", None)
    for word in WHAT if call else ():
        if (value := call.params.get(word)) is not None:
            name = getattr(value, "__name__", getattr(value, "name", value))
            benchmark.group = f"{benchmark.group}: {name}"


@pytest.fixture(scope="session")
def smoke(request) -> bool:
    """Whether the benchmarks only have to run, and not to measure."""
    return bool(request.config.getoption("benchmark_disable"))


@pytest.fixture(scope="session")
def large(request, smoke) -> int:
    """Squares a side of a large mesh: a million of them with --full, else a quarter of that."""
    return SIDES["2K" if smoke else "1M" if request.config.getoption("full") else "250K"]


@pytest.fixture(scope="session")
def mesh(request, smoke):
    """Rough squares, of each size."""
    from meshes import rough_grid
    from qsmooth import Mesh

    side = SIDES["2K" if smoke else request.param]
    if side**2 * BYTES_A_QUAD > free_memory():
        pytest.skip(f"{request.param} quads need {side**2 * BYTES_A_QUAD / 1e9:.0f} GB")
    return Mesh(*rough_grid(side))


@pytest.fixture(scope="session")
def triangles(mesh):
    """Two triangles in place of each quad."""
    from qsmooth.split import split_quads

    return split_quads(mesh)


@pytest.fixture(scope="session", params=["generated", "superior_24k.off"])
def lake(request, smoke):
    """Lakes of 24K quads: Lake Superior where the folder of real meshes is beside the checkout."""
    from qsmooth import examples, read_mesh

    if request.param == "generated":
        return examples.lake(1000 if smoke else 24_000)
    if not SHARED.is_dir():
        pytest.skip("the folder of real meshes is not here")
    return read_mesh(SHARED / request.param)


@pytest.fixture
def note(benchmark):
    """Put what a figure depends on beside it, and of what tables show how many a second.

    That are the mesh's cells, or what `rate` names, a number and a word; None where the time is of
    several things.
    """

    def put(mesh, threads=1, *, rate="cells", **more):
        count, what = (mesh.n_cells, "cells") if rate == "cells" else rate or (None, None)
        benchmark.extra_info.update(
            vertices=mesh.n_vertices, cells=mesh.n_cells, threads=threads, count=count, of=what,
            **more,
        )  # fmt: skip

    return put


@cache
def _rates():
    return sweep_bounds.rates()


@pytest.fixture
def put_bound(benchmark, smoke):
    """Put the work on paper beside a figure: what one vertex or cell asks for, and how many of them
    a second this machine could do on so many threads.
    """

    def put(work, threads=1):
        if not smoke:
            on_paper = {f"{key} on paper": round(value) for key, value in work._asdict().items()}
            benchmark.extra_info.update(on_paper)
            benchmark.extra_info["bound"] = threads * sweep_bounds.bound(work, _rates())

    return put


def _rate(info, stats):
    """What a second does, and what share of the bound that is."""
    if not info.get("count"):
        return ""
    rate = info["count"] / stats["min"]
    share = f", {rate / info['bound']:.0%} of the bound" if "bound" in info else ""
    return f"  {1e-6 * rate:.3g} M {info['of']}/s{share}"


@pytest.hookimpl(wrapper=True)
def pytest_benchmark_group_stats():
    """Show rates in the table, where it has the names."""
    groups = yield
    for _, benchmarks in groups:
        width = max(len(each["name"]) for each in benchmarks)
        for each in benchmarks:
            each["name"] = each["name"].ljust(width) + _rate(each["extra_info"], each)
    return groups


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
