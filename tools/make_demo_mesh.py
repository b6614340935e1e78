"""Make the packaged mesh of ``qsmooth demo``: a spiral band of about 1.9K bad quads.

    python tools/make_demo_mesh.py              # writes src/qsmooth/data/spiral.off
    python tools/make_demo_mesh.py other.off    # or elsewhere

It is what the formula of `qsmooth.examples.spiral` gives, to the last bit; the script checks that
every quad is valid.
"""

import sys
from pathlib import Path

from qsmooth.examples.spirals import DEMO_FILE, made_spiral
from qsmooth.metrics import quality


def main() -> None:
    """Make the mesh, check it, write it and say how bad it is."""
    path = Path(sys.argv[1]) if len(sys.argv) > 1 else DEMO_FILE
    mesh = made_spiral()
    (quads,) = mesh.cells
    measured = quality(mesh)
    if measured.n_invalid:
        raise SystemExit(f"{measured.n_invalid} quads are not valid")
    lines = ["OFF", f"{mesh.n_vertices} {len(quads)} 0"]
    lines += [f"{x!r} {y!r} 0" for x, y in mesh.points.tolist()]
    lines += [" ".join(map(str, (4, *quad))) for quad in quads.tolist()]
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(("\n".join(lines) + "\n").encode("ascii"))
    print(path)
    print(
        f"{mesh.n_vertices} vertices, {len(quads)} quads; "
        f"angles {measured.min_angle.min():.2f} to {measured.max_angle.max():.2f} degrees; "
        f"aspect ratio {measured.aspect_ratio.mean():.2f} in the mean, "
        f"{measured.aspect_ratio.max():.2f} at most"
    )


if __name__ == "__main__":
    main()
