"""``qsmooth smooth``: a better mesh, and how much better it is."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from qsmooth.cli import files, plotting, ranks, running, terminal
from qsmooth.cli.options import METHOD, named


def smooth(
    mesh_file: files.In,
    output: files.OutOption,
    method: Annotated[
        str,
        typer.Option(
            "--method",
            "-m",
            metavar="NAME",
            help="{methods}, or auto, which means {auto}; [b]qsmooth methods[/b] says what each "
            "is for.",
            rich_help_panel=METHOD,
        ),
    ] = "auto",
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
    plot: plotting.PlotOption = None,
    plot_metric: plotting.MetricOption = "max_angle",
    plot_scale: plotting.ScaleOption = plotting.Scale.linear,
    plot_log: plotting.LogOption = False,
    json_file: files.JsonOption = None,
    report_file: files.ReportOption = None,
    debug: files.DebugOption = False,
) -> None:
    """Smooth a mesh, and show its quality before and after.

    Boundary vertices stay, unless they may slide. OUT keeps everything that IN holds but the
    coordinates.
    """
    from qsmooth.io import write_mesh
    from qsmooth.output import tables

    files.refuse_unsafe(mesh_file, output, overwrite, json_file)
    others = filter(None, [json_file])
    files.refuse_clash(report_file, mesh_file, output, *others, option="--report")
    within = files.merge_within(merge, merge_tolerance)
    plot_metric = plotting.checked(plot, plot_metric, plot_scale, plot_log)
    options = options or {}
    chosen, why = running.method_with(method, options)
    mesh = files.read(mesh_file, surface, format, geographic, within)
    files.require_format(output, mesh, output_format, chosen.interpolate, with_quality)
    result = running.run_to_end(mesh, chosen, output, why, format=output_format, keep=keep_best)
    limits = running.limits_of(mesh, result, chosen)

    def save(folder: Path) -> object:
        from qsmooth.output.saving import save_figures

        return save_figures(
            mesh, result, folder, metric=plot_metric, scale=plot_scale.value, log=plot_log
        )

    facts = {
        "input": str(mesh_file),
        "output": str(output),
        "options": named(options),
        **result.to_dict(),
        "limits": limits.to_dict(),
    }
    with files.Outputs() as outputs:
        written_mesh = files.to_write(result.mesh, with_quality)
        outputs.put(
            output,
            lambda: write_mesh(output, written_mesh, format=output_format, pieces=ranks.size()),
        )
        outputs.put_report(report_file, mesh_file, [result])
        shown = not outputs.put_json(json_file, facts)
        if shown:
            terminal.write_heading(f"{mesh_file}: {tables.size_text(result.before)}")
            terminal.write_table(
                tables.change_table(result.before, result.after, width=terminal.width())
            )
            running.show_outcome(result)
            running.show_limits(limits)
        plotting.draw(outputs, plot, save)
        written = [path for path in outputs.written if path != json_file]
        if shown and written:
            terminal.write_line(f"Wrote {' and '.join(map(str, written))}")
