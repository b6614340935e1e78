"""Say what must not get worse, and what cells are meant to be; see what each costs.

    python examples/hold_and_target.py [FOLDER]

Angles and the scaled Jacobian are always held. A grid over a steep bump gets its best angles by
thinner cells; `hold` forbids that. A boundary layer is taken for one by itself; `target="ideal"`
asks it for squares instead. Writes a mesh for each.
"""

import sys
import tempfile
from pathlib import Path

import numpy as np

from qsmooth import quality, smooth, write_mesh
from qsmooth.examples import boundary_layer, bump

COLUMNS = 60
RUNS = {
    "bump": (
        bump(COLUMNS, height=0.8, width=0.1),
        {"as it comes": {}, "held": {"hold": ["aspect_ratio", "shape"]}},
    ),
    "layer": (
        boundary_layer(COLUMNS),
        {"as it comes": {}, "squares": {"target": "ideal"}},
    ),
}


def at_wall(mesh):
    """Median area of the cells at the wall, the first of the mesh: their sides there are fixed."""
    return float(np.median(quality(mesh).area[:COLUMNS]))


def main(folder: Path) -> None:
    """Smooth each mesh in each way; print figures, and what the outcome says of the price."""
    for name, (mesh, ways) in RUNS.items():
        for way, options in ways.items():
            result = smooth(mesh, **options)
            worst, outcome = result.after.worst, result.outcome
            print(
                f"{name}, {way}: angles {worst['min_angle']:.1f}° to {worst['max_angle']:.1f}°, "
                f"largest aspect ratio {worst['aspect_ratio']:.1f}, "
                f"heights at the wall x {at_wall(result.mesh) / at_wall(mesh):.2f}"
            )
            for trade in outcome.trades:
                print(f"  given up: {trade.figure} {trade.before:.4g} -> {trade.after:.4g}")
            for held in outcome.held:
                print(
                    f"  {held.figure}, held at {held.value:.4g}, stopped {held.vertices} vertices"
                )
            stem = f"{name}-{way.replace(' ', '-')}"
            write_mesh(folder / f"{stem}.vtk", result.mesh)


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else tempfile.mkdtemp(prefix="qsmooth-")))
