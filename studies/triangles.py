"""The circumcircle method beside the angle-based one on random triangulations of a square.

    python studies/triangles.py               # the defaults, 20 meshes of each size
    python studies/triangles.py --readings    # and what the method's source leaves open
    python studies/triangles.py --seeds 100 160 --readings

For each size: in how many meshes the largest aspect ratio (longest over shortest edge of a cell)
is smaller after the aspect-ratio method than after the angle-based one, guarded and as published,
then medians and worst cases of both, and inverted triangles over all sweeps of the guarded ones.
"""

import argparse
import math
from collections.abc import Callable, Iterable

import numpy as np
import numpy.typing as npt

import qsmooth
from qsmooth import Mesh, examples
from qsmooth.kernels.aspect_ratio import aspect_ratio_sweep
from qsmooth.kernels.blocks import Blocks, build_blocks
from qsmooth.kernels.quad import guarded_commit
from qsmooth.kernels.stars import Moves
from qsmooth.methods.aspect_ratio import RATIO_POWER
from qsmooth.methods.driver import GOOD_SCALED_JACOBIAN

SIZES = (12, 40, 1000)
SWEEPS = 50
FloatArray = npt.NDArray[np.float64]


def largest_ratio(mesh: Mesh) -> float:
    """Largest aspect ratio of the mesh."""
    return float(qsmooth.quality(mesh).aspect_ratio.max())


def by_method(method: str, meshes: Iterable[Mesh], **options: object) -> tuple[FloatArray, int]:
    """Smooth all; return the largest ratios, and the invalid cells of all sweeps."""
    results = [qsmooth.smooth(mesh, method, **options) for mesh in meshes]  # type: ignore[arg-type]
    ratios = np.array([largest_ratio(result.mesh) for result in results])
    return ratios, sum(record.n_invalid for result in results for record in result.history)


def by_reading(
    mesh: Mesh, *, step: float, threshold: float, power: float, rule: bool, order: str
) -> float:
    """Smooth with one reading of what is open; return the largest ratio.

    `power` weights the mean, `rule` forbids the star's largest ratio to rise, and `order` is
    ``"colours"``, ``"at once"`` (all propose, then all follow) or ``"worst first"``.
    """
    stars = mesh.topology.schedule(True)
    blocks, n_movable = build_blocks(stars), stars.vertices.size
    everything = 0, stars.colour_offsets.size - 1
    tolerated = threshold if rule else math.inf
    good = max(GOOD_SCALED_JACOBIAN, float(qsmooth.quality(mesh).scaled_jacobian.min()))
    xy = mesh.xy.copy()
    moves = Moves(np.zeros(n_movable), np.zeros(n_movable))
    # Every vertex a colour of its own: then one can be asked for alone.
    alone_blocks = build_blocks(stars._replace(colour_offsets=np.arange(n_movable + 1)))

    def sweep(at: FloatArray, blocks: Blocks, colours: tuple[int, int]) -> None:
        aspect_ratio_sweep(at, blocks, colours, threshold, step, power, tolerated, good, moves)

    for _ in range(SWEEPS):
        if order == "colours":
            sweep(xy, blocks, everything)
        elif order == "at once":
            wanted = np.zeros_like(xy)
            for i, v in enumerate(stars.vertices):
                alone = xy.copy()
                sweep(alone, alone_blocks, (i, i + 1))
                wanted[v] = alone[v] - xy[v]
            guarded_commit(xy, blocks, everything, wanted[blocks.vertices], good, moves)
        else:
            of_cells = qsmooth.quality(mesh.with_points(xy)).aspect_ratio
            ratios = np.maximum.reduceat(of_cells[stars.cells], stars.offsets[:-1])
            for i in np.argsort(ratios)[::-1]:
                sweep(xy, alone_blocks, (i, i + 1))
    return largest_ratio(mesh.with_points(xy))


def wins(ours: FloatArray, theirs: FloatArray) -> str:
    """Count wins, and ties in brackets."""
    tied = np.isclose(ours, theirs, rtol=1e-9)
    won = int((~tied & (ours < theirs)).sum())
    return f"{won} ({int(tied.sum())}) of {len(ours)}"


def figures(ratios: FloatArray) -> str:
    """Median and worst."""
    return f"{np.median(ratios):.2f} | {ratios.max():.1f}"


def compare(name: str, meshes: dict[int, list[Mesh]]) -> dict[int, FloatArray]:
    """Print the table of the defaults; return the guarded angle-based ratios."""
    print(f"\n## {name}\n")
    print("| faces | wins (ties) | over unguarded | aspect-ratio: median | worst ", end="")
    print("| angle: median | worst | unguarded: median | worst | before: median | worst ", end="")
    print("| inverted (both guarded) | inverted unguarded |\n|" + " --- |" * 13)
    reference = {}
    for size, some in meshes.items():
        ours, our_bad = by_method("aspect-ratio", some)
        angle, angle_bad = by_method("angle", some)
        published, published_bad = by_method("angle", some, guard="none")
        before = np.array([largest_ratio(mesh) for mesh in some])
        reference[size] = angle
        print(
            f"| {size} | {wins(ours, angle)} | {wins(ours, published)} | {figures(ours)} "
            f"| {figures(angle)} | {figures(published)} | {figures(before)} "
            f"| {our_bad + angle_bad} | {published_bad} |",
            flush=True,
        )
    return reference


def readings(meshes: dict[int, list[Mesh]], reference: dict[int, FloatArray]) -> None:
    """Print what each choice that the source leaves open does, the others at their defaults."""
    print("\n## Readings: wins (ties) over guarded angle-based, median, worst\n")
    print("| reading | " + " | ".join(f"{size} faces" for size in meshes) + " |")
    print("| --- |" + " --- |" * len(meshes))
    default = {
        "step": 0.2, "threshold": 1.2, "power": RATIO_POWER, "rule": True, "order": "colours"
    }  # fmt: skip
    tries: dict[str, dict[str, object]] = {"default": {}}
    tries |= {f"step {step}": {"step": step} for step in (0.05, 0.1, 0.15, 0.3, 0.5, 1.0)}
    tries |= {f"edge ratio {t}": {"threshold": t} for t in (1.0, 1.1, 1.35, 1.5, 2.0)}
    tries |= {f"mean of power {power:g}": {"power": power} for power in (0.0, 2.0, 8.0)}
    tries |= {"no rule on the largest ratio": {"rule": False}}
    tries |= {
        "plain mean, no rule, step 0.5": {"power": 0.0, "rule": False, "step": 0.5},
        "plain mean, no rule, step 0.25, no threshold": {
            "power": 0.0, "rule": False, "step": 0.25, "threshold": 1.0
        },
        "all at once": {"order": "at once"},
        "worst first": {"order": "worst first"},
    }  # fmt: skip
    run: Callable[..., float] = by_reading
    for name, options in tries.items():
        cells = []
        for size, some in meshes.items():
            if "order" in options and size > 100:
                some = some[:5]  # slow, in Python
            ours = np.array([run(mesh, **(default | options)) for mesh in some])
            cells.append(
                f"{wins(ours, reference[size][: len(ours)])}, {np.median(ours):.2f}, "
                f"{ours.max():.1f}"
            )
        print(f"| {name} | " + " | ".join(cells) + " |", flush=True)


def hull(n_faces: int, seed: int) -> Mesh:
    """Triangulate random points alone, so that the boundary is ragged and its slivers stay."""
    from scipy.spatial import Delaunay

    rng = np.random.default_rng([n_faces, seed, 1])
    while True:
        for n in range(n_faces // 2, n_faces + 9):
            points = rng.random((n, 2))
            triangles = Delaunay(points).simplices
            if len(triangles) == n_faces:
                return Mesh(points, triangles)


def main() -> None:
    """Run what the command line says."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", nargs=2, type=int, default=(0, 20))
    parser.add_argument("--readings", action="store_true")
    parser.add_argument("--hull", action="store_true", help="also without the square (scipy)")
    arguments = parser.parse_args()
    seeds = range(*arguments.seeds)
    meshes = {size: [examples.random_triangles(size, seed=s) for s in seeds] for size in SIZES}
    reference = compare("Squares with random points inside", meshes)
    if arguments.hull:
        compare("Random points alone", {size: [hull(size, s) for s in seeds] for size in SIZES[:2]})
    if arguments.readings:
        readings(meshes, reference)


if __name__ == "__main__":
    main()
