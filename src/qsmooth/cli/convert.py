"""``qsmooth convert``: the same mesh in another format, and what that could not keep."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from qsmooth._words import plural
from qsmooth.cli import files, terminal


def convert(
    mesh_file: files.In,
    output: Annotated[
        Path,
        typer.Argument(
            metavar="OUT",
            help="Mesh file to write; its ending tells the format.",
            show_default=False,
        ),
    ],
    overwrite: files.OverwriteOption = False,
    merge: files.MergeOption = False,
    merge_tolerance: files.MergeToleranceOption = None,
    surface: files.SurfaceOption = files.Surface.auto,
    geographic: files.GeographicOption = None,
    format: files.FormatOption = None,
    output_format: files.OutputFormatOption = None,
    with_quality: files.WithQualityOption = False,
    pieces: Annotated[
        int,
        typer.Option(
            "--pieces",
            metavar="N",
            min=1,
            help="Into how many files a .pvtu file divides a mesh that comes from another format.",
        ),
    ] = 1,
    json_file: files.JsonOption = None,
    debug: files.DebugOption = False,
) -> None:
    """Write a mesh in another format, and say what that can not keep.

    No vertex moves. Within one format, and without --merge, OUT is a copy.
    """
    from qsmooth.io import format_of, write_and_tell

    files.refuse_unsafe(mesh_file, output, overwrite, json_file)
    within = files.merge_within(merge, merge_tolerance)
    mesh = files.read(mesh_file, surface, format, geographic, within)
    files.require_format(output, mesh, output_format, with_quality=with_quality)
    before = str(getattr(mesh.source, "format", ""))
    after = format_of(output, mesh, format=output_format)
    lost: list[str] = []
    with files.Outputs() as outputs:
        written_mesh = files.to_write(mesh, with_quality)
        outputs.put(
            output,
            lambda: lost.extend(
                write_and_tell(output, written_mesh, format=output_format, pieces=pieces)
            ),
        )
        if not outputs.written:
            return
        facts = {
            "input": str(mesh_file),
            "output": str(output),
            "format": before,
            "output_format": after,
            "n_vertices": mesh.n_vertices,
            "n_cells": mesh.n_cells,
            "lost": lost,
        }
        if outputs.put_json(json_file, facts):
            return
        size = f"{plural(mesh.n_vertices, 'vertex', 'vertices')}, {plural(mesh.n_cells, 'cell')}"
        terminal.write_line(f"Wrote {output}, {size}, {before} to {after}")
        terminal.write_line(f"Lost: {'; '.join(lost)}" if lost else "Nothing was lost.")
