"""Keep a mesh good that lies distributed on the ranks of an MPI simulation, while a body turns.

    mpiexec -n 4 python examples/distributed_body.py [FOLDER]

Each rank has the cells of a sector around the body, as a domain decomposition might, knows its own
vertices by their global numbers, and moves those of the body that it has. `Smoother` takes the
ranks' partition as it is. The coordinates have the same bits for any number of ranks; the first
rank shows some of the 50 steps, and writes the last mesh as VTK.
"""

import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from mpi4py import MPI

from qsmooth import DistributedMesh, Smoother, write_mesh
from qsmooth.examples import around_body

comm = MPI.COMM_WORLD
steps, turn = 50, np.radians(22.5)

# A solver has this from its own set-up: here each rank takes a sector of a mesh that all can make.
mesh = around_body(45)
quads = mesh.cells[0]
middles = mesh.points[quads].mean(axis=1)
sector = np.floor((np.arctan2(middles[:, 1], middles[:, 0]) / (2 * np.pi) + 0.5) * comm.size)
cell_ids = np.flatnonzero(np.minimum(sector, comm.size - 1) == comm.rank)
vertex_ids, local = np.unique(quads[cell_ids], return_inverse=True)
cells, home = local.reshape(-1, 4), mesh.points[vertex_ids]
body = mesh.is_boundary[vertex_ids] & (np.abs(home).max(axis=1) < 0.5)

part = DistributedMesh(home, cells, vertex_ids, cell_ids, comm)
smoother = Smoother(part)  # with `comm`, as the part has it
points = home.copy()  # of this rank; steps overwrite it
smoother.step(points)

if comm.rank == 0:
    print(f"{comm.size} ranks; this one has {len(cells)} of {len(quads)} cells")
    print(" step   angle   smallest scaled Jacobian   valid")
records, started = [], time.perf_counter()
for step in range(1, steps + 1):
    angle = turn * step / steps
    cos, sin = np.cos(angle), np.sin(angle)
    points[body] = home[body] @ np.array([[cos, sin], [-sin, cos]])
    records.append(smoother.step(points))
    if step % 10 == 0 and comm.rank == 0:
        print(
            f"{step:5d}  {np.degrees(angle):5.1f}°   {records[-1].scaled_jacobian:24.3f}   "
            f"{'yes' if records[-1].valid else 'no':>5}"
        )
seconds = time.perf_counter() - started

result = smoother(points)  # to the end, with a report; on each rank its own points
if comm.rank == 0:
    worst = min(record.scaled_jacobian for record in records)
    print(
        f"{steps} steps: {1e3 * seconds / steps:.1f} ms a step, "
        f"valid in all of them: {all(record.valid for record in records)}, "
        f"smallest scaled Jacobian {worst:.3f}"
    )
    folder = Path(sys.argv[1] if len(sys.argv) > 1 else tempfile.mkdtemp(prefix="qsmooth-"))
    write_mesh(folder / "body.vtk", result.whole.mesh)
    print(
        f"{folder / 'body.vtk'}: {result.after.validity['valid']} of {len(quads)} cells are valid"
    )
