"""What each method makes of several meshes with its defaults: tables of `docs/comparison.md`.

    python studies/methods.py [FILE ...]           # print the tables of all methods
    python studies/methods.py [FILE ...] --write   # store the figures, and write the page's part
    python studies/methods.py --stored             # write the page's part from what is stored

prints, for generated meshes and the given files, the smallest and largest angle, the mean shape
and the count of cells that are not valid; then the largest aspect ratio and the uniformity. Of the
files the page shows Lake Superior alone, `superior_24k`; without it what is stored of it stays.
"""

from __future__ import annotations

import argparse
import json
import runpy
import textwrap
from collections.abc import Callable
from pathlib import Path
from typing import Any

from qsmooth import Mesh, Summary, compare, quality, read_mesh, smooth
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

ROOT = Path(__file__).resolve().parent.parent
RESULTS = ROOT / "studies" / "results" / "methods.json"
PAGE = ROOT / "docs" / "comparison.md"
# The parts of the page that are written here lie between such lines.
START, END = "<!-- studies/methods.py: {} -->", "<!-- the end of {} -->"

MESHES = {
    "spiral": spiral,
    "lake": lake,
    "notch": notch,
    "boundary_layer": boundary_layer,
    "tangled": lambda: tangled(40, 40),
    "random_triangles": random_triangles,
    "simple_case": lambda: simple_case(12),
}
TITLES = {
    "spiral": "`spiral()`, 1.9K quads",
    "lake": "`lake()`, 24K quads",
    "superior_24k": "Lake Superior, 24K quads",
    "notch": "`notch()`, 1.6K quads",
    "boundary_layer": "`boundary_layer()`, 1.4K quads",
    "tangled": "`tangled(40, 40)`, 1.6K quads",
    "random_triangles": "`random_triangles()`, 1K triangles",
    "simple_case": "`simple_case(12)`, 12 triangles",
}
SHOWN = ("laplacian", "star", "quad", "optimize")
# Meshes and ways of `examples/hold_and_target.py`.
HOLD_TITLES = {"bump": "`bump(60, height=0.8, width=0.1)`", "layer": "`boundary_layer()`"}

Figures = dict[str, float]
# By mesh and then by method, "before" among these.
Columns = dict[str, dict[str, Figures]]


def figures(summary: Summary) -> Figures:
    """What is shown of coordinates."""
    names = "min_angle", "max_angle", "aspect_ratio"
    means = {name: summary.mean[name] for name in ("shape", "size_jump")}
    return {name: summary.worst[name] for name in names} | means | {"invalid": summary.n_invalid}


def measured(paths: list[str]) -> Columns:
    """Smooth all meshes with all methods that can do something with their cells."""
    makers: dict[str, Callable[[], Mesh]] = {**MESHES}
    makers |= {Path(path).stem: lambda path=path: read_mesh(path) for path in paths}
    out = {}
    for name, make in makers.items():
        mesh = make()
        results, _ = compare(mesh)
        out[name] = {"before": figures(quality(mesh).summary())}
        out[name] |= {method: figures(result.after) for method, result in results.items()}
    return out


def measured_beside() -> dict[str, Any]:
    """What else the page tells: what holding costs, and what the targets of a layer are worth."""
    held = smooth(notch(), hold=["aspect_ratio", "shape"])
    example = runpy.run_path(str(ROOT / "examples" / "hold_and_target.py"))
    rows = []
    for name, (mesh, ways) in example["RUNS"].items():
        wall = example["at_wall"](mesh)
        rows.append({"mesh": name, "options": None, **figures(quality(mesh).summary())})
        for options in ways.values():
            result = smooth(mesh, **options)
            heights = example["at_wall"](result.mesh) / wall
            rows.append(
                {"mesh": name, "options": options, "heights": heights, **figures(result.after)}
            )
    return {
        "held_notch": figures(held.after),
        "layer_towards_target": smooth(boundary_layer()).outcome.target.after,
        "hold_and_target": rows,
    }


# ------------------------------------------------------------------------------- texts

REMARKS = """\
- **`laplacian`** is the fastest and does well where the boundary is convex or smooth: on Lake
  Superior it makes no invalid cell, and the tangled square it takes apart. Where the boundary is
  concave, or cells are meant to be thin, it inverts cells: {notch[laplacian][invalid]:.0f} on the
  notch, {boundary_layer[laplacian][invalid]:.0f} in the boundary layer. The guarded methods make
  none anywhere.

- **`optimize`**: no other method of the table has a better smallest angle anywhere, nor a better
  largest one but for `laplacian` on the simple case, by {over:.0f}°. Nothing that is held gets
  worse in any region, and cells do not get slim for it: the largest aspect ratio of Lake Superior
  goes from {superior_24k[before][aspect_ratio]:.1f} to
  {superior_24k[optimize][aspect_ratio]:.1f}, where `laplacian` has
  {superior_24k[laplacian][aspect_ratio]:.1f} and `star` {superior_24k[star][aspect_ratio]:.1f}. On
  the notch it goes from {notch[before][aspect_ratio]:.0f} to {notch[optimize][aspect_ratio]:.0f},
  for a smallest angle of {notch[before][min_angle]:.1f}° to {notch[optimize][min_angle]:.1f}°; the
  outcome says so, and `hold="aspect_ratio,shape"` keeps it at {held_notch[aspect_ratio]:.0f}, with
  {held_notch[min_angle]:.1f}°. The boundary layer is left a boundary layer, at a mean shape of
  {boundary_layer[optimize][shape]:.2f}: {layer_towards_target:.2f} towards what it is meant to be.
  `smart-laplacian` has {boundary_layer[smart-laplacian][shape]:.2f} there, as it lets the layers
  go.

- **`star` and `quad`** keep what is valid, but take longer than `smart-laplacian` and on most of
  these meshes gain less. On a boundary layer they are of no use: neighbours get less alike (size
  ratio {boundary_layer[before][size_jump]:.2f} to {boundary_layer[star][size_jump]:.2f} and
  {boundary_layer[quad][size_jump]:.2f}). Nor does it hold by our measure that their cells are more
  uniform than those of Laplacian smoothing: the spiral gets {spiral[star][size_jump]:.2f} and
  {spiral[quad][size_jump]:.2f} against {spiral[laplacian][size_jump]:.2f}, the lake
  {lake[star][size_jump]:.2f} and {lake[quad][size_jump]:.2f} against
  {lake[laplacian][size_jump]:.2f}. On random triangles it does,
  {random_triangles[star][size_jump]:.2f} against {random_triangles[laplacian][size_jump]:.2f}. They
  do not untangle.

- **`angle`** is not stable on quads: the largest aspect ratio of the lake goes from
  {lake[before][aspect_ratio]:.0f} to {lake[angle][aspect_ratio]:.0f}.

- **`aspect-ratio`** evens out edges and not angles. Of the random triangles it brings the largest
  aspect ratio from {random_triangles[before][aspect_ratio]:.0f} to
  {random_triangles[aspect-ratio][aspect_ratio]:.1f}, the best of all, but the smallest angle to
  {random_triangles[aspect-ratio][min_angle]:.1f}° only. On the 12 triangles of the simple case its
  largest angle, {simple_case[aspect-ratio][max_angle]:.1f}°, is the worst of all."""


def angles_text(found: Figures) -> str:
    """Smallest and largest angle, mean shape, and cells that are not valid."""
    text = f"{found['min_angle']:.1f}° {found['max_angle']:.1f}° {found['shape']:.2f}"
    return f"{text}, **{found['invalid']:.0f} invalid**" if found["invalid"] else text


def sizes_text(found: Figures) -> str:
    """Largest aspect ratio, and mean size ratio of neighbours."""
    return f"{found['aspect_ratio']:.5g}, {found['size_jump']:.2f}"


def table(heads: list[str], rows: list[list[str]]) -> str:
    """Lines of a table in Markdown."""
    lines = [heads, ["---"] * len(heads), *rows]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines).replace("|  |", "| |")


def methods_text(found: dict[str, Any]) -> str:
    """What the page has on the methods: their table, and what there is to see in it."""
    by_mesh = found["meshes"]
    rows = [
        [title, *(angles_text(by_mesh[name][method]) for method in ("before", *SHOWN))]
        for name, title in TITLES.items()
    ]
    heads = ["Mesh", "before", *(f"`{method}`" for method in SHOWN)]
    simple = by_mesh["simple_case"]
    over = simple["optimize"]["max_angle"] - simple["laplacian"]["max_angle"]
    remarks = REMARKS.format(**by_mesh, **found, over=over)
    lines = [
        textwrap.fill(" ".join(each.split()), 106, subsequent_indent="  ", break_on_hyphens=False)
        for each in remarks.split("\n\n")
    ]
    return "\n".join([table(heads, rows), "", *lines])


def hold_text(found: dict[str, Any]) -> str:
    """The page's table of what to hold and what to aim at."""
    rows = []
    for row in found["hold_and_target"]:
        what = f"{HOLD_TITLES[row['mesh']]}, input"
        if row["options"] is not None:
            given = ", ".join(f"{key}={json.dumps(row['options'][key])}" for key in row["options"])
            what = f"`{given}`" if given else "default"
        heights = row.get("heights")
        rows.append(
            [
                what,
                f"{row['min_angle']:.1f}° {row['max_angle']:.1f}°",
                f"{row['aspect_ratio']:.{0 if row['aspect_ratio'] > 100.0 else 1}f}",
                "" if heights is None else f"× {heights:.{0 if heights > 100.0 else 2}f}",
            ]
        )
    heads = ["Mesh, options", "angles", "largest aspect ratio", "heights at the wall, median"]
    return table(heads, rows)


# ------------------------------------------------------------------------------- what is written


def stored() -> dict[str, Any]:
    """Figures of the runs that the page shows."""
    found: dict[str, Any] = json.loads(RESULTS.read_text(encoding="utf-8"))
    return found


def with_parts(text: str, found: dict[str, Any]) -> str:
    """The page with other figures."""
    for name, part in (("methods", methods_text(found)), ("hold", hold_text(found))):
        start, end = START.format(name), END.format(name)
        before, _, rest = text.partition(start)
        _, _, after = rest.partition(end)
        text = f"{before}{start}\n{part}\n{end}{after}"
    return text


def print_tables(columns: Columns) -> None:
    """Print what all methods make of all meshes."""
    heads = ["before", *methods()]
    for title, text in (
        ("Smallest and largest angle, mean shape", angles_text),
        ("Largest aspect ratio, size ratio of neighbours", sizes_text),
    ):
        rows = [
            [TITLES.get(name, name), *(text(by[h]) if h in by else "–" for h in heads)]
            for name, by in columns.items()
        ]
        print(f"{title}\n\n{table(['Mesh', *heads], rows)}\n")


def main() -> None:
    """Smooth all meshes with all methods, unless figures are stored; print or write."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("files", nargs="*")
    parser.add_argument("--write", action="store_true", help="store the figures, write the page")
    parser.add_argument("--stored", action="store_true", help="write the page, run nothing")
    options = parser.parse_args()
    if not options.stored:
        columns = measured(options.files)
        print_tables(columns)
        if options.write:
            old = stored()["meshes"] if RESULTS.exists() else {}
            kept = {name: (old | columns)[name] for name in TITLES}
            found = {"meshes": kept, **measured_beside()}
            RESULTS.parent.mkdir(exist_ok=True)
            RESULTS.write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")
    if options.write or options.stored:
        page = with_parts(PAGE.read_text(encoding="utf-8"), stored())
        PAGE.write_text(page, encoding="utf-8")


if __name__ == "__main__":
    main()
