"""``qsmooth untangle``: a valid mesh, or the nearest to one that was found."""

from __future__ import annotations

from typing import Any

import typer

from qsmooth._words import plural
from qsmooth.cli import files, ranks, running, terminal
from qsmooth.cli.options import named


def untangle(
    mesh_file: files.In,
    output: files.OutOption,
    options: dict[str, Any] | None = None,
    overwrite: files.OverwriteOption = False,
    keep_best: files.KeepBestOption = False,
    merge: files.MergeOption = False,
    merge_tolerance: files.MergeToleranceOption = None,
    surface: files.SurfaceOption = files.Surface.auto,
    geographic: files.GeographicOption = None,
    format: files.FormatOption = None,
    output_format: files.OutputFormatOption = None,
    with_quality: files.WithQualityOption = False,
    json_file: files.JsonOption = None,
    debug: files.DebugOption = False,
) -> None:
    """Make a mesh valid by moving its vertices, and stop there.

    Exit code 0 where every cell is valid, 1 where some stay invalid; OUT then has the best that was
    found. Smoothing with method optimize does this first, by itself.
    """
    from qsmooth.io import write_mesh
    from qsmooth.output import tables
    from qsmooth.registry import all_methods

    files.refuse_unsafe(mesh_file, output, overwrite, json_file)
    within = files.merge_within(merge, merge_tolerance)
    options = options or {}
    method = all_methods()["untangle"].of(options)
    mesh = files.read(mesh_file, surface, format, geographic, within)
    files.require_format(output, mesh, output_format, method.interpolate, with_quality)
    result = running.run_to_end(mesh, method, output, format=output_format, keep=keep_best)
    n_invalid = result.after.n_invalid
    facts = {
        "input": str(mesh_file),
        "output": str(output),
        "options": named(options),
        **result.to_dict(),
        "valid": n_invalid == 0,
    }
    failed = f"FAILED: {plural(n_invalid, 'cell')} of {result.after.n_cells} not valid"
    with files.Outputs() as outputs:
        written_mesh = files.to_write(result.mesh, with_quality)
        outputs.put(
            output,
            lambda: write_mesh(output, written_mesh, format=output_format, pieces=ranks.size()),
        )
        written = output in outputs.written
        if not outputs.put_json(json_file, facts):
            terminal.write_heading(f"{mesh_file}: {tables.size_text(result.before)}")
            terminal.write_table(
                tables.change_table(result.before, result.after, width=terminal.width())
            )
            running.show_outcome(result)
            if n_invalid:
                terminal.write_line(failed)
            if written:
                what = "the best that was found, " if n_invalid else ""
                terminal.write_line(f"Wrote {what}{output}")
        elif n_invalid:
            terminal.say(failed.replace("FAILED", "failed"))
        if n_invalid:
            raise typer.Exit(terminal.FAILED)
