"""What cells are meant to be, read from a mesh once, for many calls on the same cells."""

from __future__ import annotations

from dataclasses import replace

from qsmooth.engine import threads_for
from qsmooth.mesh import Mesh
from qsmooth.numbering import Inside
from qsmooth.optimizer.ground import Ground, Meant
from qsmooth.optimizer.method import FEW_INVALID, Optimize
from qsmooth.optimizer.progress import Progress
from qsmooth.optimizer.untangling import untangle
from qsmooth.targets import Targets


def meant_by(method: Optimize, mesh: Mesh) -> Meant:
    """Read from a mesh what its cells are meant to be, as `Optimize.run` does.

    A mesh of which too much is invalid is untangled for that.
    """
    inside = Inside(mesh)
    before = inside.quality(mesh)
    given = inside.at_vertices(mesh.xy)
    mended, freedom = given, method.freedom(mesh)
    if before.n_invalid > FEW_INVALID * mesh.n_cells and freedom.n_movable:
        mended, engine = given.copy(), threads_for(method.threads, freedom.n_movable)
        ground = Ground(inside, freedom.inside(inside), engine)
        with engine.running():
            untangle(ground, mended, Progress(replace(method, callback=None), before))
    return method.read(inside, given, mended)


def reading_of(method: Optimize, mesh: Mesh, meant: Meant) -> Targets:
    """Find out which of several readings a run on the mesh settles for."""
    plain, *others = meant.readings
    if others:
        trial = replace(method, worst=False, callback=None, time_limit=None)
        target = trial.run(mesh, meant=meant).outcome.target
        for reading in others:
            if target is not None and reading.kind == target.kind:
                return reading
    return plain
