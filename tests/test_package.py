"""The package as such: what importing it loads, its public names, and Numba's cache."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

import qsmooth

HEAVY = "numba", "llvmlite", "meshio", "matplotlib", "numpy", "scipy", "typer", "rich", "vtkmodules"


def run(code, **environment):
    """Run Python code in a fresh process; gives what it prints."""
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", code],
        env={**os.environ, **environment},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.mark.nojit
def test_import_loads_nothing_heavy():
    code = "import sys, qsmooth, json; print(json.dumps(sorted(sys.modules)))"
    loaded = set(json.loads(run(code)))
    assert "qsmooth" in loaded
    assert not loaded & set(HEAVY)


@pytest.mark.nojit
def test_classes_load_no_compiler():
    code = (
        "import sys, qsmooth, json\n"
        "qsmooth.Mesh, qsmooth.MeshError, qsmooth.Quality, qsmooth.smooth\n"
        "qsmooth.Optimize(mean_loss=0.2), qsmooth.Star(step=0.3), qsmooth.Stop, qsmooth.Outcome\n"
        "from qsmooth.registry import methods; methods()\n"
        "print(json.dumps(sorted(sys.modules)))"
    )
    assert not set(json.loads(run(code))) & {"numba", "meshio", "matplotlib"}


@pytest.mark.nojit
def test_reading_and_measuring_load_no_plotting():
    code = (
        "import sys, qsmooth, json\n"
        "mesh = qsmooth.Mesh([(0, 0), (1, 0), (1, 1), (0, 1)], [(0, 1, 2, 3)])\n"
        "qsmooth.quality(mesh).summary()\n"
        "print(json.dumps(sorted(sys.modules)))"
    )
    loaded = set(json.loads(run(code, NUMBA_DISABLE_JIT="1")))
    assert not loaded & {"meshio", "matplotlib", "typer"}


@pytest.mark.nojit
def test_public_names_are_there_and_documented():
    for name in qsmooth.__all__:
        value = getattr(qsmooth, name)
        assert name == "__version__" or value.__doc__, name
        assert name in dir(qsmooth)
    with pytest.raises(AttributeError, match=r"qsmooth.* attribute '?smoothen"):
        qsmooth.smoothen  # noqa: B018


@pytest.mark.nojit
def test_smooth_and_quality_are_functions_after_their_modules_are_loaded():
    code = (
        "import qsmooth, qsmooth.smoothing, qsmooth.metrics\n"
        "assert callable(qsmooth.smooth) and callable(qsmooth.quality)\n"
        "from qsmooth import smooth, quality\n"
        "assert callable(smooth) and callable(quality)"
    )
    run(code)


# Runs a method on one thread and on two, and says how the caches of its kernels were used.
CACHE = """
import json
from qsmooth import Mesh, smooth
from qsmooth.kernels import glance, star
points = [(0, 0), (1, 0), (2, 0), (0, 1), (1.3, 1.2), (2, 1), (0, 2), (1, 2), (2, 2)]
mesh = Mesh(points, [(0, 1, 4, 3), (1, 2, 5, 4), (4, 5, 8, 7), (3, 4, 7, 6)])
out = {
    f"points {n}": smooth(mesh, "star", threads=n, max_sweeps=3).points.tobytes().hex()
    for n in (1, 2)
}
for name, kernel in {"star": star.star_sweep, "glance": glance.glance}.items():
    stats = kernel.parallel.stats
    out[name] = [sum(stats.cache_hits.values()), sum(stats.cache_misses.values())]
    out[f"{name} twice"] = "serial" in vars(kernel)
print(json.dumps(out))
"""


@pytest.mark.skipif(bool(os.environ.get("NUMBA_DISABLE_JIT")), reason="nothing is compiled")
def test_a_second_process_compiles_nothing(tmp_path):
    first = json.loads(run(CACHE, NUMBA_CACHE_DIR=str(tmp_path), NUMBA_NUM_THREADS="2"))
    assert any(Path(tmp_path).rglob("*.nbc"))
    again = json.loads(run(CACHE, NUMBA_CACHE_DIR=str(tmp_path), NUMBA_NUM_THREADS="2"))
    assert first["points 1"] == first["points 2"] == again["points 1"] == again["points 2"]
    for kernel in ("star", "glance"):
        hits, misses = first[kernel]
        assert hits == 0
        assert misses > 0
        assert again[kernel] == [misses, 0]
        assert not first[f"{kernel} twice"]


# Every method with options of every kind of number, on meshes of every kind; then the kernels that
# were compiled for more than one set of types.
TYPES = """
import importlib, json, pkgutil
import numpy as np
import qsmooth
from qsmooth import Mesh, examples, quality, smooth
from qsmooth.registry import all_methods
flat = examples.jittered(6, 6, kind="mixed", seed=1)
points, cells = flat.points, flat.cells
space = np.column_stack([0.8 * points[:, 0], points[:, 1], 0.6 * points[:, 0]])
meshes = [
    flat,
    Mesh(space, cells),
    Mesh(points, [b[:, ::-1] for b in cells], fixed=[9], regions=np.arange(flat.n_cells) % 2),
    Mesh(np.asfortranarray(points).astype(np.float32), [block.astype(np.int32) for block in cells]),
    examples.tangled(6, 6, kind="mixed", seed=1),
]
for known in all_methods().values():
    for number in (int, np.float32):
        options = {"max_sweeps": np.int32(12)}
        for name, spec in known.specs().items():
            wanted = {**options}
            if spec.kind == "number" and spec.unit != "seconds" and 1 in spec.interval:
                wanted[name] = number(1)
            if spec.kind == "choice":
                wanted[name] = spec.choices[-1]
            try:
                known(**wanted)
                options = wanted
            except ValueError:
                pass
        for mesh in meshes:
            smooth(mesh, known(**options, threads=1))
        smooth(flat, known(**options, threads=2))
        smooth(flat, known(max_sweeps=12, threads=1, selection=[0, 1]))
kernels, twice = set(), {}
for module in pkgutil.iter_modules(qsmooth.kernels.__path__, "qsmooth.kernels."):
    for name, thing in vars(importlib.import_module(module.name)).items():
        for form in ("parallel", ""):
            kernel = getattr(thing, form, None) if form else thing
            if not getattr(kernel, "targetoptions", {}).get("nogil"):
                continue  # a helper, which kernels compile into themselves
            kernels.add(f"{name} {form}")
            types = {str(signature) for signature in kernel.signatures}
            if len(types) > 1:
                twice[f"{name} {form}"] = sorted(types)
print(json.dumps([len(kernels), twice]))
"""


@pytest.mark.skipif(bool(os.environ.get("NUMBA_DISABLE_JIT")), reason="nothing is compiled")
def test_no_kernel_is_compiled_for_other_types_than_those_that_ship():
    n_kernels, twice = json.loads(run(TYPES, NUMBA_NUM_THREADS="2"))
    assert n_kernels > 30
    assert twice == {}
