"""``qsmooth demo``: every method on a mesh of bad quads, without any file."""

from __future__ import annotations

import os
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any

import typer

from qsmooth.cli import compare, files, terminal


class DemoMesh(StrEnum):
    """Meshes of the demo."""

    spiral = "spiral"
    lake = "lake"


def demo(
    output: Annotated[
        Path,
        typer.Option("--output", "-o", metavar="FOLDER", help="Where to put meshes and figures."),
    ] = Path("qsmooth-demo"),
    mesh_name: Annotated[
        DemoMesh,
        typer.Option(
            "--mesh",
            metavar="[spiral|lake]",
            help="[b]spiral[/b], 1.9K quads; [b]lake[/b], 24K quads with islands, takes longer.",
        ),
    ] = DemoMesh.spiral,
    options: dict[str, Any] | None = None,
    debug: files.DebugOption = False,
) -> None:
    """Smooth a mesh of bad quads with each method; needs no file.

    Prints the comparison; writes the mesh, the optimised mesh, and figures.
    """
    from qsmooth.examples import demo_mesh, lake
    from qsmooth.io import write_mesh
    from qsmooth.registry import choose

    if output.exists() and not output.is_dir():
        raise ValueError(f"'{output}' is a file; --output takes a folder")
    name = mesh_name.value
    chosen = compare.with_options(compare.method_names("all"), options or {})
    with terminal.status(f"making the {name}"):
        mesh = demo_mesh() if mesh_name is DemoMesh.spiral else lake()
    results, skipped = compare.run_all(mesh, chosen)
    compare.show(name.capitalize(), results, skipped)
    output.mkdir(parents=True, exist_ok=True)
    usual, _ = choose({})
    best = next(result for result in results if result.method == usual)
    given, smoothed = output / f"{name}.off", output / f"{name}-{usual}.off"
    write_mesh(given, mesh)
    write_mesh(smoothed, best.mesh)
    terminal.write_line(f"Wrote the mesh, {given}, and what method {usual} made of it, {smoothed}")
    try:
        from qsmooth.output.saving import save_figures

        with terminal.status("drawing"):
            paths = save_figures(mesh, best, output)
    except ImportError as error:
        terminal.say(f"warning: no figures: {error}")
    else:
        terminal.write_line(f"Wrote {len(paths)} figures, as PNG and SVG, into {output}{os.sep}")
        terminal.write_line(f"Look first at {output / 'comparison-whole.png'}")
