"""Memory over thousands of calls in one process: ``python benchmarks/soak.py --calls 10000``.

Each call makes a mesh of its own, smooths, measures, writes and reads it. What one call leaves
behind shows as growth from the first tenth of the calls to the last.
"""

import argparse
import contextlib
import gc
import resource
import tempfile
from pathlib import Path

from qsmooth import examples, limits, quality, read_mesh, smooth, write_mesh

METHODS = ("laplacian", "star")


def call_once(number: int, folder: Path, methods: tuple[str, ...] = METHODS) -> None:
    """Do what a program does again and again, each time with another mesh."""
    mesh = examples.jittered(5 + number % 5, 6, kind="mixed", seed=number)
    result = smooth(mesh, methods[number % len(methods)], max_sweeps=3, threads=1)
    quality(result.mesh).summary()
    limits(result.mesh)
    path = folder / ("a.vtu", "a.off")[number % 2]
    write_mesh(path, result.mesh)
    read_mesh(path)
    with contextlib.suppress(ValueError):
        smooth(mesh, "laplacian", max_sweeps=-1)


def held() -> tuple[int, int]:
    """Bytes in memory now, and objects that Python knows of."""
    gc.collect()
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * resource.getpagesize(), len(gc.get_objects())


def grown(calls: int, methods: tuple[str, ...] = METHODS) -> tuple[int, int]:
    """Bytes and objects that came on top between the first tenth of so many calls and the last."""
    with tempfile.TemporaryDirectory() as name:
        for number in range(calls):
            call_once(number, Path(name), methods)
            if number + 1 == max(calls // 10, 1):
                before = held()
        after = held()
    return after[0] - before[0], after[1] - before[1]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--calls", type=int, default=10_000)
    parser.add_argument("--methods", default=",".join(METHODS))
    given = parser.parse_args()
    size, objects = grown(given.calls, tuple(given.methods.split(",")))
    print(f"{given.calls} calls: {size / 1e6:+.1f} MB, {objects:+d} objects")


if __name__ == "__main__":
    main()
