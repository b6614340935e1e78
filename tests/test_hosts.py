"""Hosts that behave badly: no cache, no home, forks, pools, few cores, handlers of their own."""

import json
import os
import shutil
import subprocess
import sys
from importlib import metadata
from importlib.util import find_spec
from pathlib import Path

import pytest

import qsmooth

pytestmark = [
    pytest.mark.skipif(bool(os.environ.get("NUMBA_DISABLE_JIT")), reason="nothing is compiled"),
    pytest.mark.skipif(not hasattr(os, "fork"), reason="there is no fork here"),
]
SQUARE = "OFF\n4 1 0\n0 0 0\n1 0 0\n1 1 0\n0 1 0\n4 0 1 2 3\n"
LONGEST = 500.0  # seconds: nothing takes so long unless it hangs


def folder_of_tbb() -> str:
    """Where the package tbb has its library, which Numba does not look for there; or nothing."""
    try:
        files = metadata.files("tbb") or []
    except metadata.PackageNotFoundError:
        return ""
    found = [file.locate() for file in files if file.name == "libtbb.so.12"]
    return str(Path(str(found[0])).resolve().parent) if found else ""


def environment(layer="", **more):
    """The variables of a child: on two threads, of this threading layer."""
    if layer == "tbb" and not folder_of_tbb():
        pytest.skip("the package tbb is not installed")
    chosen = {"NUMBA_THREADING_LAYER": layer} if layer else {}
    if layer == "tbb":
        chosen["LD_LIBRARY_PATH"] = folder_of_tbb()
    return {**os.environ, "NUMBA_NUM_THREADS": "2", **chosen, **more}


def run(folder, code, *arguments, env=None):
    """Run a program in a process of its own; gives what it prints as JSON, and standard error."""
    path = folder / "program.py"
    path.write_text(code)
    done = subprocess.run(
        [sys.executable, path, *arguments], env=env or environment(), cwd=folder,
        capture_output=True, text=True, check=False, timeout=LONGEST,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout), done.stderr


def test_a_read_only_installation_without_a_home_works_and_warns_once(tmp_path):
    installed, here = tmp_path / "site" / "qsmooth", tmp_path / "here"
    shutil.copytree(
        Path(qsmooth.__file__).parent, installed, ignore=shutil.ignore_patterns("__pycache__")
    )
    for folder in [installed, *(path for path in installed.rglob("*") if path.is_dir())]:
        (folder / "__pycache__").touch()  # nobody can make a folder there, root neither
    here.mkdir()
    (here / "a.off").write_text(SQUARE)
    # Without a home and an entry for the user the folder of caches is no absolute path either.
    env = environment(PYTHONPATH=str(tmp_path / "site"), XDG_CACHE_HOME="~/.cache")
    del env["NUMBA_CACHE_DIR"]
    env.pop("HOME", None)
    done = subprocess.run(
        [sys.executable, "-m", "qsmooth", "info", "a.off"], env=env, cwd=here,
        capture_output=True, text=True, check=False, timeout=LONGEST,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert "Quads                      1\n" in done.stdout
    assert done.stderr.count("\n") == 1
    assert "NUMBA_CACHE_DIR" in done.stderr
    assert [path.name for path in here.iterdir()] == ["a.off"]


CACHE = """
import json, os, resource, shutil, sys
import numpy as np
from qsmooth.kernels._jit import kernel

@kernel()
def twice(values, out):
    for i in range(values.size):
        out[i] = 2 * values[i]

def right(dtype):
    out = np.zeros(3)
    twice(np.arange(3, dtype=dtype), out)
    return out.tolist() == [0, 2, 4]

what, cache = sys.argv[1], os.environ["NUMBA_CACHE_DIR"]
found = [right(np.float64)]
if what == "lost":
    shutil.rmtree(cache)
elif what == "gone":
    shutil.rmtree(cache)
    open(cache, "w").close()
elif what == "full":
    resource.setrlimit(resource.RLIMIT_FSIZE, (10, 10))
found += [right(np.int64), right(np.int32)]
print(json.dumps([found, sum(twice.stats.cache_misses.values())]))
"""


@pytest.mark.parametrize(("what", "lines"), [("kept", 0), ("lost", 0), ("gone", 1), ("full", 1)])
def test_a_cache_lost_or_full_while_running_is_done_without(tmp_path, what, lines):
    env = environment(NUMBA_CACHE_DIR=str(tmp_path / "cache"))
    (right, count), errors = run(tmp_path, CACHE, what, env=env)
    assert (right, count) == ([True, True, True], 3)
    told = [line for line in errors.splitlines() if "NUMBA_CACHE_DIR" in line]
    assert len(told) == lines


def test_a_damaged_cache_is_written_anew(tmp_path):
    env = environment(NUMBA_CACHE_DIR=str(tmp_path / "cache"))
    counts = []
    for damage in (b"", b"not a pickle", b"", b""):
        if damage:
            for path in (tmp_path / "cache").rglob("*.nb?"):
                path.write_bytes(damage)
        (right, count), errors = run(tmp_path, CACHE, "kept", env=env)
        assert all(right)
        assert "NUMBA_CACHE_DIR" not in errors
        counts.append(count)
    assert counts == [3, 3, 0, 0]


LOCKED = """
import json, os, signal, threading, time
import numpy as np
from numba.core.compiler_lock import global_compiler_lock
from qsmooth.kernels._jit import kernel

@kernel()
def one(out):
    out[0] = 1.0

def compile_for_a_while():
    with global_compiler_lock:
        compiling.set()
        time.sleep(1.0)

compiling = threading.Event()
thread = threading.Thread(target=compile_for_a_while)
thread.start()
compiling.wait()
child = os.fork()
if not child:
    signal.alarm(60)
    out = np.zeros(1)
    one(out)
    os._exit(int(out[0] != 1.0))
_, status = os.waitpid(child, 0)
thread.join()
one(np.zeros(1))
print(json.dumps(status))
"""


def test_a_child_that_was_forked_while_another_thread_compiled_can_compile(tmp_path):
    assert run(tmp_path, LOCKED)[0] == 0


POOLS = """
import json, multiprocessing, sys
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from qsmooth import examples, smooth

def task(threads):
    mesh = examples.jittered(12, 12, seed=1)
    return smooth(mesh, "laplacian", max_sweeps=5, threads=threads)

def of_pool(pool, counts):
    with pool:
        return list(pool.map(task, counts))

def main(how, counts=(1, 2, 1, 2)):
    here = [task(1), task(2)]
    if how in ("fork", "spawn", "forkserver"):
        context = multiprocessing.get_context(how)
        there = of_pool(ProcessPoolExecutor(2, mp_context=context), counts)
    elif how == "threads":
        there = of_pool(ThreadPoolExecutor(4), 8 * counts)
    elif how == "joblib":
        import joblib
        there = joblib.Parallel(n_jobs=2)(joblib.delayed(task)(n) for n in counts)
    else:
        import dask
        there = dask.compute(*(dask.delayed(task)(n) for n in counts), scheduler=how[5:])
    return len({result.points.tobytes() for result in [*here, *there]})

if __name__ == "__main__":
    print(json.dumps(main(sys.argv[1])))
"""


@pytest.mark.parametrize("how", ["fork", "spawn", "forkserver", "joblib", "dask processes"])
def test_workers_smooth_after_threads_have_run(tmp_path, how):
    if find_spec(how.split()[0]) is None and how[0] in "jd":
        pytest.skip(f"{how} is not installed")
    assert run(tmp_path, POOLS, how)[0] == 1


@pytest.mark.parametrize("layer", ["omp", "workqueue", "tbb"])
def test_forked_workers_with_every_threading_layer(tmp_path, layer):
    assert run(tmp_path, POOLS, "fork", env=environment(layer))[0] == 1


@pytest.mark.parametrize("layer", ["omp", "workqueue", "tbb"])
def test_python_threads_with_every_threading_layer(tmp_path, layer):
    assert run(tmp_path, POOLS, "threads", env=environment(layer))[0] == 1


def test_threads_of_dask(tmp_path):
    pytest.importorskip("dask")
    assert run(tmp_path, POOLS, "dask threads")[0] == 1


CORES = """
import json, os, sys
when = sys.argv[1]
one = {min(os.sched_getaffinity(0))}
if when == "before":
    os.sched_setaffinity(0, one)
from qsmooth import examples, smooth
from qsmooth.engine import PARALLEL_FROM, threads_for
from qsmooth.kernels._jit import available_threads
mesh = examples.jittered(12, 12, seed=1)
found = [smooth(mesh, "laplacian", max_sweeps=5).points.tobytes().hex()]
if when == "after":
    os.sched_setaffinity(0, one)
most = available_threads()
found += [smooth(mesh, "laplacian", max_sweeps=5, threads=n).points.tobytes().hex()
          for n in (None, 1, most)]
print(json.dumps([len(set(found)), most, threads_for(None, PARALLEL_FROM).count]))
"""


@pytest.mark.skipif(not hasattr(os, "sched_setaffinity"), reason="cores cannot be chosen here")
@pytest.mark.parametrize(("when", "threads"), [("before", ""), ("after", "2"), ("never", "1")])
def test_fewer_cores_than_the_machine_has(tmp_path, when, threads):
    env = environment()
    del env["NUMBA_NUM_THREADS"]
    if threads:
        env["NUMBA_NUM_THREADS"] = threads
    found, _ = run(tmp_path, CORES, when, env=env)
    assert found == [1, int(threads or 1), 1]


# All that a process has for itself, before and after everything has been called once.
STATE = """
import decimal, faulthandler, gc, io, json, locale, logging, os, random, signal, sys, threading
import warnings
import numba, numpy as np

def state():
    handlers = {n: str(signal.getsignal(n)) for n in signal.valid_signals()}
    return {
        "errors": np.geterr(), "errcall": str(np.geterrcall()), "print": str(np.get_printoptions()),
        "numpy random": str(np.random.get_state()), "random": random.getstate()[1][:5],
        "warnings": [str(one) for one in warnings.filters], "show": str(warnings.showwarning),
        "locale": locale.setlocale(locale.LC_ALL), "decimal": str(decimal.getcontext()),
        "numba threads": numba.get_num_threads(), "chunk": numba.get_parallel_chunksize(),
        "python threads": threading.active_count(), "trace": [sys.gettrace(), sys.getprofile()],
        "recursion": sys.getrecursionlimit(), "gc": [gc.isenabled(), gc.get_threshold()],
        "folder": os.getcwd(), "files": sorted(os.listdir()), "environment": dict(os.environ),
        "umask": [os.umask(0o22), os.umask(0o22)][1], "signals": handlers,
        "hooks": [str(sys.excepthook), str(threading.excepthook), str(sys.stdout)],
        "logging": [str(logging.root.handlers), logging.root.level, logging.root.manager.disable],
        "our logger": str(vars(logging.getLogger("qsmooth"))["handlers"]),
        "affinity": sorted(os.sched_getaffinity(0)), "faulthandler": faulthandler.is_enabled(),
        "path": sys.path[:], "switch": sys.getswitchinterval(),
    }

locale.setlocale(locale.LC_ALL, "")
np.seterr(all="raise")
np.random.seed(3)
random.seed(3)
signal.signal(signal.SIGTERM, lambda *_: None)
signal.signal(signal.SIGINT, lambda *_: None)
warnings.simplefilter("error")
numba.set_num_threads(1)
before = state()
from qsmooth import compare, examples, limits, quality, read_mesh, smooth, untangle, write_mesh
from qsmooth.inspection import inspect
mesh = examples.jittered(8, 8, kind="mixed", seed=1)
for method in ("laplacian", "star", "optimize"):
    for threads in (None, 1, 2):
        result = smooth(mesh, method, max_sweeps=20, threads=threads)
result.before, result.after, str(result.reason), result.to_dict()
untangle(examples.tangled(8, 8, seed=1))
quality(mesh).summary(), limits(mesh), inspect(mesh)
for name in ("a.off", "a.vtu", "a.bdf"):
    write_mesh(name, examples.structured(4, 4))
    read_mesh(name)
    os.remove(name)
for call, *wrong in ((smooth, mesh, "stars"), (read_mesh, "no.off"), (write_mesh, "a.x", mesh)):
    try:
        call(*wrong)
    except ValueError:
        pass
after = state()
print(json.dumps([what for what in before if before[what] != after[what]]))
"""


def test_nothing_of_the_process_is_changed_and_nothing_is_said(tmp_path):
    changed, errors = run(tmp_path, STATE)
    assert changed == []
    assert errors in ("", "compiling, first time only\n")
