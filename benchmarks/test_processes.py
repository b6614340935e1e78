"""First calls with an empty cache, and whole processes with a full one."""

import os
import subprocess
import sys

import pytest

FIRST = "from qsmooth import examples, smooth; smooth(examples.demo_mesh(), {!r}, max_sweeps=20)"
COMPILED = "; from qsmooth.kernels.compiling import compiled_kernels; print(compiled_kernels())"


def run(*arguments, **environment):
    done = subprocess.run(
        [sys.executable, *arguments], env={**os.environ, **environment}, capture_output=True,
        text=True, check=True,
    )  # fmt: skip
    return done.stdout


@pytest.mark.benchmark(group="first call, empty cache")
@pytest.mark.parametrize("method", ["star", "optimize"])
def test_first_call(benchmark, tmp_path, smoke, method):
    # Where nothing is measured nothing has to compile.
    cache = {} if smoke else {"NUMBA_CACHE_DIR": str(tmp_path)}
    code = FIRST.format(method) + COMPILED
    count = benchmark.pedantic(run, args=("-c", code), kwargs=cache, rounds=1)
    benchmark.extra_info.update(kernels=int(count))


@pytest.mark.benchmark(group="whole process, full cache")
@pytest.mark.parametrize("method", ["star", "optimize"])
def test_smooth_from_the_shell(benchmark, tmp_path, lake, method):
    from qsmooth import write_mesh

    given, out = tmp_path / "given.off", tmp_path / "out.vtu"
    write_mesh(given, lake)
    arguments = ("-m", "qsmooth", "smooth", given, "-o", out, "--overwrite", "-m", method)
    benchmark.pedantic(run, args=arguments, rounds=2, warmup_rounds=1)
