"""A gate in a pipeline: let a mesh through if it is good enough, mend it if not, else fail.

    python examples/quality_gate.py [FOLDER] && run_the_solver

Three meshes are checked: one passes, one is mended, and one can't be, as its boundary has corners
that no placement of the vertices opens. Writes `gate.json`; the exit code is the number refused.
"""

import json
import sys
import tempfile
from pathlib import Path

from qsmooth import Mesh, limits, quality, smooth, write_mesh
from qsmooth.examples import jittered, notch, tangled

# What the solver needs of every cell, in degrees.
SMALLEST_ANGLE, LARGEST_ANGLE = 25.0, 160.0


def good(mesh: Mesh) -> bool:
    """Whether every cell is valid and all angles are within the bounds."""
    measured = quality(mesh)
    return bool(
        measured.n_invalid == 0
        and measured.min_angle.min() >= SMALLEST_ANGLE
        and measured.max_angle.max() <= LARGEST_ANGLE
    )


def gate(mesh: Mesh) -> tuple[str, Mesh]:
    """Pass, mend or refuse a mesh; in words, with the mesh to go on with."""
    if good(mesh):
        return "passed", mesh
    # What can't be had is known before anything is smoothed: the mesh needs other cells there.
    best = limits(mesh)
    if best.min_angle < SMALLEST_ANGLE:
        at = best.min_angle_vertex
        return f"refused: no more than {best.min_angle:.1f}° can be had at vertex {at}", mesh
    if best.max_angle > LARGEST_ANGLE:
        at = best.max_angle_vertex
        return f"refused: no less than {best.max_angle:.1f}° can be had at vertex {at}", mesh
    result = smooth(mesh)
    if good(result.mesh):
        return "mended", result.mesh
    return f"refused: {result.reason}", mesh


def main(folder: Path) -> int:
    """Check three meshes; the number that did not get through."""
    meshes = {
        "fine": jittered(12, 12, amount=0.2),
        "folded": tangled(12, 12, seed=1),
        "notched": notch(20),
    }
    report = {}
    for name, mesh in meshes.items():
        verdict, mesh = gate(mesh)
        summary = quality(mesh).summary()
        report[name] = {"verdict": verdict, **summary.to_dict()}
        print(f"{name}: {verdict}; smallest angle {summary.worst['min_angle']:.1f}°")
        if not verdict.startswith("refused"):
            write_mesh(folder / f"{name}.off", mesh)
    (folder / "gate.json").write_text(json.dumps(report, indent=1), encoding="utf-8")
    return sum(entry["verdict"].startswith("refused") for entry in report.values())


if __name__ == "__main__":
    raise SystemExit(
        main(Path(sys.argv[1] if len(sys.argv) > 1 else tempfile.mkdtemp(prefix="qsmooth-")))
    )
