"""What each method makes of several meshes with its defaults: the table of the README.

    python studies/methods.py [FILE ...]

prints, for generated meshes and the given files, the smallest and largest angle, the mean shape
and the count of cells that are not valid; then the largest aspect ratio and the uniformity.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path

from qsmooth import Mesh, Summary, compare, quality, read_mesh
from qsmooth.examples import (
    boundary_layer,
    lake,
    notch,
    random_triangles,
    simple_case,
    spiral,
    tangled,
)
from qsmooth.registry import methods

MESHES = {
    "`spiral()`, 1.9K quads": spiral,
    "`lake()`, 24K quads": lake,
    "`notch()`, 1.6K quads": notch,
    "`boundary_layer()`, 1.4K quads": boundary_layer,
    "`tangled(40, 40)`, 1.6K quads": lambda: tangled(40, 40),
    "`random_triangles()`, 1K triangles": random_triangles,
    "`simple_case(12)`, 12 triangles": lambda: simple_case(12),
}


def angles_text(summary: Summary) -> str:
    """Smallest and largest angle, mean shape, and cells that are not valid."""
    worst = summary.worst
    text = f"{worst['min_angle']:.1f}° {worst['max_angle']:.1f}° {summary.mean['shape']:.2f}"
    return f"{text}, **{summary.n_invalid} invalid**" if summary.n_invalid else text


def sizes_text(summary: Summary) -> str:
    """Largest aspect ratio, and mean size ratio of neighbours."""
    return f"{summary.worst['aspect_ratio']:.5g}, {summary.mean['size_jump']:.2f}"


def print_table(
    title: str, columns: dict[str, dict[str, Summary]], text: Callable[[Summary], str]
) -> None:
    """Print one figure of all meshes and methods as a table in Markdown."""
    heads = ["before", *methods()]
    print(f"{title}\n")
    print(f"| Mesh | {' | '.join(heads)} |\n|{' --- |' * (len(heads) + 1)}")
    for name, summaries in columns.items():
        cells = [text(summaries[head]) if head in summaries else "–" for head in heads]
        print(f"| {name} | {' | '.join(cells)} |")
    print()


def main(paths: list[str]) -> None:
    """Smooth all meshes with all methods."""
    meshes: dict[str, Mesh] = {name: make() for name, make in MESHES.items()}
    meshes |= {Path(path).stem: read_mesh(path) for path in paths}
    columns = {}
    for name, mesh in meshes.items():
        columns[name] = {"before": quality(mesh).summary()}
        results, _ = compare(mesh)
        columns[name] |= {method: result.after for method, result in results.items()}
    print_table("Smallest and largest angle, mean shape", columns, angles_text)
    print_table("Largest aspect ratio, size ratio of neighbours", columns, sizes_text)


if __name__ == "__main__":
    main(sys.argv[1:])
