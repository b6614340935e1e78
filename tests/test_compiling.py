"""What is compiled, when, who hears of it, and what runs where no parallel region can."""

import json
import logging
import os
import subprocess
import sys

import numba
import numpy as np
import pytest

from qsmooth import Mesh, smooth, warmup
from qsmooth.kernels import compiling
from qsmooth.kernels._jit import helper, use_threads

compiled = pytest.mark.skipif(
    bool(os.environ.get("NUMBA_DISABLE_JIT")), reason="nothing is compiled"
)
omp = pytest.mark.skipif(not hasattr(os, "fork"), reason="there is no fork here")


def run(path, code, **environment):
    """Run a program in a process of its own; gives what it prints as JSON, and standard error."""
    path.write_text(code)
    done = subprocess.run(
        [sys.executable, path], env={**os.environ, "NUMBA_NUM_THREADS": "2", **environment},
        capture_output=True, text=True, check=False, timeout=500,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout), done.stderr


FIRST = """
import gc, json, sys, time
from numba.core import codegen
from numba.core.registry import cpu_target
from qsmooth import examples, smooth
from qsmooth.kernels._jit import Helper
from qsmooth.kernels._linking import WRAPS
from qsmooth.kernels.compiling import compiled_kernels
assembled, assemble = [], codegen.JITCodeLibrary._finalize_specific
def note(library):
    assembled.append(library.name)
    time.sleep(2.0 if len(assembled) <= 5 else 0.0)
    assemble(library)
codegen.JITCodeLibrary._finalize_specific = note
mesh, out = examples.jittered(6, 6, seed=1), {}
LIMIT = 8.0  # busy machines need some of it
for threads in (1, 2):
    options = dict(max_sweeps=6, rtol=0.0, time_limit=LIMIT, threads=threads)
    result = smooth(mesh, "laplacian", **options)
    out[threads] = [result.outcome.stop.value, result.sweeps, compiled_kernels()]
    out["within"] = result.seconds < LIMIT
out["wraps"] = [name for name in assembled if name.startswith(WRAPS)], len(assembled) > 5
modules = [sys.modules[name] for name in sys.modules if name.startswith("qsmooth.kernels.")]
values = [value for module in modules for value in vars(module).values()]
helpers = {value.__qualname__ for value in values if isinstance(value, Helper)}
out["helpers"] = sorted(helpers.intersection(assembled)), len(helpers) > 5
made_by = cpu_target.target_context.codegen()
out["left"] = made_by._library_class is codegen.JITCodeLibrary, gc.isenabled()
print(json.dumps(out))
"""


@compiled
def test_compiling_counts_in_no_limit_happens_once_and_is_told_of(tmp_path):
    found, errors = run(tmp_path / "first.py", FIRST, NUMBA_CACHE_DIR=str(tmp_path / "cache"))
    stop, sweeps, count = found["1"]
    # Nothing of this would fit into the limit together with what the compiler takes.
    assert (stop, sweeps, found["within"]) == ("max_sweeps", 6, True)
    assert count > 5
    # On two threads nothing more is compiled.
    assert found["2"] == [stop, sweeps, count]
    assert errors == "compiling, first time only\n"
    # What only kernels call is linked to these alone, and Numba is left as it was.
    assert found["wraps"] == found["helpers"] == [[], True]
    assert found["left"] == [True, True]


# A kernel of no more than it takes to see which form ran.
KERNEL = """
import json, os, sys, threading
import numpy as np
from numba import prange
from qsmooth.kernels._jit import parallel_kernel, use_threads

@parallel_kernel()
def fill(out):
    for r in range(20):
        for i in prange(out.size):
            out[i] += i

def right(n, threads):
    out = np.zeros(n)
    with use_threads(threads):
        fill(out)
    return bool((out == 20.0 * np.arange(n)).all())

def twice():
    return bool("serial" in vars(fill))
"""

FORKED = """
here = [right(1000, 1), right(1000, 2), twice()]
reader, writer = os.pipe()
if not os.fork():
    alone = np.zeros(10)
    fill(alone)
    found = [right(1000, 1), right(1000, 2), bool(alone[1] == 20.0), twice()]
    os.write(writer, json.dumps(found).encode())
    os._exit(0)
os.wait()
os.close(writer)
print(json.dumps([here, json.loads(os.read(reader, 1000) or b"null")]))
"""


@compiled
@omp
def test_a_forked_child_runs_the_serial_twin_where_openmp_would_end_it(tmp_path):
    code = KERNEL + FORKED
    found, _ = run(tmp_path / "forked.py", code, NUMBA_THREADING_LAYER="omp")
    assert found == [[True, True, False], [True, True, True, True]]


THREADS = """
sizes = (400_000, 400_001)
found = []
def work(n):
    found.extend(right(n, threads) for threads in (1, 2) for _ in range(30))
fill(np.zeros(10))
before = twice()
workers = [threading.Thread(target=work, args=(n,)) for n in sizes]
for worker in workers:
    worker.start()
for worker in workers:
    worker.join()
print(json.dumps([before, len(found), all(found)]))
"""


@compiled
@pytest.mark.parametrize("layer", ["omp", "workqueue"])
def test_python_threads_may_run_kernels_side_by_side(tmp_path, layer):
    # Under workqueue Numba ends a process with two parallel regions at a time.
    found, _ = run(tmp_path / "threads.py", KERNEL + THREADS, NUMBA_THREADING_LAYER=layer)
    assert found == [False, 120, True]


# What the default method and its like use beyond the warm-up's meshes would show up here.
WARM = """
import json, sys
from qsmooth import examples, limits, quality, smooth, warmup

def kernels():
    found = set()
    for name, module in list(sys.modules.items()):
        if name.startswith("qsmooth.kernels."):
            for what, thing in vars(module).items():
                thing = getattr(thing, "parallel", thing)
                if getattr(thing, "targetoptions", {}).get("nogil"):
                    found |= {f"{what} {signature}" for signature in thing.signatures}
    return found

methods = ["optimize", "star", "aspect-ratio"]
warmup(methods)
before = kernels()
tangle, notch = examples.random_interior(9, 9, kind="mixed"), examples.notch(10)
for mesh in (tangle, notch, examples.spiral(300)):
    result = smooth(mesh)
    quality(result.mesh).summary(), limits(result.mesh)
smooth(notch, "star")
smooth(tangle, "aspect-ratio", split_quads=True)
print(json.dumps([len(before), sorted(kernels() - before), warmup("star")]))
"""


@compiled
def test_warmup_compiles_all_that_is_used(tmp_path):
    (count, more, again), _ = run(tmp_path / "warm.py", WARM)
    assert count > 30
    assert more == []
    assert again == 0


ALSO = """
methods = ["optimize", "smart-laplacian"]
warmup(methods, session=True, slide=True, interpolate=True)
before = kernels()
body = examples.around_body(15)
points, inner = body.points.copy(), abs(body.points).max(axis=1) < 0.5
inner &= body.is_boundary
for method in methods:
    smoother = Smoother(body, method)
    for turn in np.radians([0, 3, 6, 9, 12, 12, 90, 95]):
        ways = [[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]]
        points[inner] = body.points[inner] @ np.array(ways)
        smoother.step(points)
tangle, notch = examples.random_interior(9, 9, kind="mixed"), examples.notch(10)
for mesh in (tangle, notch):
    depths = np.column_stack([mesh.points, mesh.points[:, 0]])
    for method in methods:
        smooth(mesh, method, boundary="slide")
        smooth(Mesh(depths, mesh.cells, surface="flat"), method)
print(json.dumps([len(before), sorted(kernels() - before)]))
"""


@compiled
def test_warmup_compiles_what_sessions_sliding_and_depths_use(tmp_path):
    start = WARM[: WARM.index("methods =")]
    more = "import numpy as np\nfrom qsmooth import Mesh, Smoother\n"
    (count, late), _ = run(tmp_path / "also.py", start + more + ALSO)
    assert count > 50
    assert late == []


@pytest.mark.nojit
def test_warmup_takes_names_of_methods():
    assert warmup([]) == 0
    with pytest.raises(ValueError, match=r"must be one of .*star.*; got 'stars'; did you mean"):
        warmup("stars")


@pytest.mark.nojit
def test_the_clock_leaves_out_what_compiles_and_nested_kernels_count_once(monkeypatch, caplog):
    # A clock of its own knows nothing of what has been compiled before.
    monkeypatch.setattr(compiling, "_compiling", compiling._Compiling())
    now = [100.0]
    monkeypatch.setattr(compiling.time, "perf_counter", lambda: now[0])
    started, count = compiling.clock(), compiling.compiled_kernels()
    now[0] += 1.0
    compiling.begin(of_ours=False)  # somebody else's
    compiling.end()
    with caplog.at_level(logging.WARNING, "qsmooth"):
        for _ in range(2):
            compiling.begin(of_ours=True)
            now[0] += 3.0
            compiling.begin(of_ours=True)
            compiling.begin(of_ours=False)
            now[0] += 2.0
            for _ in range(3):
                compiling.end()
            now[0] += 0.5
    assert compiling.clock() - started == 2.0
    assert compiling.compiled_kernels() - count == 2
    assert caplog.messages.count(compiling.MESSAGE) == 1


@compiled
def test_helpers_can_be_called_from_python_and_from_kernels():
    @helper()
    def twice(x):
        return 2.0 * x

    @helper()
    def four_times(x):
        return twice(twice(x))

    assert four_times(1.5) == 6.0
    assert numba.njit(lambda x: four_times(x))(0.5) == 2.0


def test_the_callers_count_of_threads_stays_his_own():
    mine = numba.get_num_threads()
    mesh = Mesh([(0, 0), (1, 0), (2, 0), (0, 1), (1.3, 1.2), (2, 1), (0, 2), (1, 2), (2, 2)],
                [(0, 1, 4, 3), (1, 2, 5, 4), (4, 5, 8, 7), (3, 4, 7, 6)])  # fmt: skip
    with use_threads(2):
        one = smooth(mesh, "laplacian", threads=1).points
        assert numba.get_num_threads() == 2
    assert numba.get_num_threads() == mine
    assert np.array_equal(one, smooth(mesh, "laplacian", threads=2).points)
