"""Run by several ranks: what is wrong on one of them is told on all. Prints JSON."""

import json
import sys
import traceback
from pathlib import Path

import numpy as np
from mpi4py import MPI

sys.path.insert(0, str(Path(__file__).parent.parent))

from mesh_parts import blocks_of_rows, part_of

from qsmooth import DistributedMesh, Smoother, smooth
from qsmooth.examples import distorted

comm = MPI.COMM_WORLD
last = comm.size - 1
mesh = distorted(8)
part = part_of(mesh, blocks_of_rows(mesh, comm.size), comm)


def on_last(value, other):
    """One value on the last rank, another one on all others."""
    return value if comm.rank == last else other


def with_nan():
    points = part.points.copy()
    if comm.rank == last:
        points[0, 0] = np.nan
    return part.with_points(points)


def elsewhere():
    """A vertex that two ranks have is at another place on the last."""
    points = part.points.copy()
    if comm.rank == last:
        points[0, 0] += 0.5
    return smooth(part.with_points(points), "star")


def without_a_cell():
    cells = part.cells[0][1:] if comm.rank == last else part.cells[0]
    ids = part.cell_ids[-len(cells) :]
    return smooth(DistributedMesh(part.points, cells, part.vertex_ids, ids, comm), "star")


def without_a_vertex():
    ids = part.vertex_ids + (part.vertex_ids > 70)
    return smooth(DistributedMesh(part.points, part.cells, ids, part.cell_ids, comm), "star")


def other_cells():
    cells = np.roll(part.cells[0], comm.rank, axis=1)
    ids = np.arange(len(cells))
    return smooth(DistributedMesh(part.points, cells, part.vertex_ids, ids, comm), "star")


def of_other_dimension():
    points = on_last(np.column_stack([part.points, part.points[:, 0]]), part.points)
    return smooth(DistributedMesh(points, part.cells, part.vertex_ids, part.cell_ids, comm), "star")


def folded_twice():
    """The whole is no mesh: three cells at an edge."""
    cells, ids = part.cells, part.cell_ids
    if comm.rank == last:
        cells, ids = [*cells, np.array([[4, 5, 6]])], np.append(ids, mesh.n_cells)
    return smooth(DistributedMesh(part.points, cells, part.vertex_ids, ids, comm), "star")


def raising(record):
    raise KeyError("from the callback")


def target(places):
    return np.broadcast_to(np.eye(2) * 100.0, (len(places), 2, 2)).copy()


def step_of_another_shape():
    smoother = Smoother(part, "star")
    return smoother.step(on_last(part.points[:-1], part.points).copy())


CASES = {
    "nan": with_nan,
    "elsewhere": elsewhere,
    "no cell": without_a_cell,
    "no vertex": without_a_vertex,
    "other cells": other_cells,
    "dimension": of_other_dimension,
    "no mesh": folded_twice,
    "option": lambda: smooth(mesh, "star", step=on_last(0.25, 3.0), comm=comm),
    "method": lambda: smooth(mesh, on_last("star", "stir"), comm=comm),
    "not a mesh": lambda: smooth(on_last(mesh, "file.msh"), comm=comm),
    "fixed": lambda: smooth(mesh, "star", fixed=[10**6], comm=comm),
    "function": lambda: smooth(mesh, comm=comm, **({"target": target} if comm.rank == 0 else {})),
    "callback": lambda: smooth(mesh, "star", callback=raising, comm=comm),
    "step": step_of_another_shape,
    "after all that": lambda: smooth(part, "star"),
}

if __name__ == "__main__":
    found = {}
    try:
        for name, case in CASES.items():
            try:
                case()
            except Exception as error:
                text = f"{type(error).__name__}: {error}"
            else:
                text = ""
            found[name] = comm.allgather(text)
    except BaseException:
        traceback.print_exc()
        sys.stderr.flush()
        comm.Abort(3)
    if comm.rank == 0:
        print(json.dumps(found))
