"""Meshes of odd shapes, and how long each method takes for them.

    python benchmarks/shapes.py                # at a tenth and a third of the size, and whole
    python benchmarks/shapes.py --share 0.01

A star of 10,000 cells around one vertex, a strip of a million quads, 10,000 parts of four quads,
one cell. Seconds of processor time, on one thread, after a small one. What grows faster than the
mesh shows in the table.
"""

import argparse
import time
from collections.abc import Callable

import numpy as np

from qsmooth import Mesh, limits, quality
from qsmooth.inspection import inspect
from qsmooth.registry import all_methods

SHARES = (0.01, 0.1, 0.3, 1.0)


def fan(n_cells: int, kind: str = "triangle") -> Mesh:
    """Cells around one vertex, which is not in the middle."""
    k, step = np.arange(n_cells), 1 if kind == "triangle" else 2
    n_rim = step * n_cells
    angles = 2.0 * np.pi * np.arange(n_rim) / n_rim
    points = np.vstack([[0.3, 0.2], np.column_stack([np.cos(angles), np.sin(angles)])])
    rim = [1 + (step * k + i) % n_rim for i in range(step + 1)]
    return Mesh(points, [np.column_stack([0 * k, *rim])])


def strip(n_cells: int) -> Mesh:
    """Two rows of quads, whose vertices between have been moved."""
    m = n_cells // 2 + 1
    x, k = np.arange(m, dtype=np.float64), np.arange(m - 1)
    points = np.vstack([np.column_stack([x, np.full(m, y)]) for y in (0.0, 1.0, 2.0)])
    points[m + 1 : 2 * m - 1] += np.random.default_rng(0).uniform(-0.2, 0.2, (m - 2, 2))
    rows = [np.column_stack([k, k + 1, k + 1 + m, k + m]) + r * m for r in (0, 1)]
    return Mesh(points, [np.vstack(rows)])


def parts(n_parts: int) -> Mesh:
    """Squares of four quads that share nothing, each with its middle moved."""
    square = np.array([(i, j) for j in range(3) for i in range(3)], dtype=np.float64)
    square[4] = (1.3, 1.2)
    cells = np.array([(0, 1, 4, 3), (1, 2, 5, 4), (4, 5, 8, 7), (3, 4, 7, 6)])
    k, side = np.arange(n_parts), int(np.ceil(np.sqrt(n_parts)))
    places = 4.0 * np.column_stack([k % side, k // side])
    points = (square + places[:, None]).reshape(-1, 2)
    return Mesh(points, [(cells + 9 * k[:, None, None]).reshape(-1, 4)])


def one_cell(_: int = 1) -> Mesh:
    """One square: nothing may move."""
    return Mesh([(0, 0), (1, 0), (1, 1), (0, 1)], [(0, 1, 2, 3)])


SHAPES: dict[str, tuple[Callable[[int], Mesh], int]] = {
    "star of triangles": (fan, 10_000),
    "star of quads": (lambda n: fan(n, "quad"), 10_000),
    "strip": (strip, 1_000_000),
    "parts": (parts, 10_000),
    "one cell": (one_cell, 1),
}


def seconds(call: Callable[[], object]) -> float:
    """Processor time of a call."""
    started = time.process_time()
    call()
    return time.process_time() - started


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--share", type=float, action="append", help="Shares of the whole size.")
    parser.add_argument("--shape", choices=SHAPES, action="append")
    given = parser.parse_args()
    ready = {name: method(threads=1) for name, method in all_methods().items()}
    for shape in given.shape or SHAPES:
        make, size = SHAPES[shape]
        shares = given.share or SHARES
        for share in shares if size > 1 else shares[:1]:
            mesh = make(max(int(share * size), 1))
            taken = {"quality": seconds(lambda mesh=mesh: quality(mesh).summary())}
            taken["limits"] = seconds(lambda mesh=mesh: limits(mesh))
            taken["inspect"] = seconds(lambda mesh=mesh: inspect(mesh))
            for name, method in ready.items():
                if not method.why_not(mesh):
                    taken[name] = seconds(lambda method=method, mesh=mesh: method.run(mesh))
            row = ", ".join(f"{what} {value:.2f}" for what, value in taken.items())
            print(f"{shape}, {mesh.n_cells} cells: {row}", flush=True)


if __name__ == "__main__":
    main()
