"""``qsmooth smooth``: a better mesh, and how much better it is."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from qsmooth.cli import files, running, terminal
from qsmooth.cli.options import METHOD, REPORT, named


def smooth(
    mesh_file: files.In,
    output: files.OutOption,
    method: Annotated[
        str,
        typer.Option(
            "--method",
            "-m",
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
    plot: Annotated[
        Path | None,
        typer.Option(
            metavar="FOLDER",
            help="Also write figures, as PNG and SVG, into this folder.",
            rich_help_panel=REPORT,
        ),
    ] = None,
    plot_metric: Annotated[
        str,
        typer.Option(
            metavar="METRIC",
            help="What figures are coloured by: {metrics}.",
            rich_help_panel=REPORT,
        ),
    ] = "max_angle",
    json_file: files.JsonOption = None,
    report_file: files.ReportOption = None,
    debug: files.DebugOption = False,
) -> None:
    """Smooth a mesh, and show its quality before and after.

    Boundary vertices stay, unless they may slide. OUT keeps everything that IN holds but the
    coordinates.
    """
    from qsmooth.io import write_mesh
    from qsmooth.metrics import find_metric
    from qsmooth.output import tables

    files.refuse_unsafe(mesh_file, output, overwrite, json_file)
    others = filter(None, [json_file])
    files.refuse_clash(report_file, mesh_file, output, *others, option="--report")
    within = files.merge_within(merge, merge_tolerance)
    plot_metric = find_metric(plot_metric.replace("-", "_"), "--plot-metric").name
    if plot is not None:
        from qsmooth.output.drawing import require_matplotlib

        if plot.exists() and not plot.is_dir():
            raise ValueError(f"'{plot}' is a file; --plot takes a folder")
        require_matplotlib()
    options = options or {}
    chosen, why = running.method_with(method, options)
    mesh = files.read(mesh_file, surface, format, geographic, within)
    files.require_format(output, mesh, output_format, chosen.interpolate)
    result = running.run_to_end(mesh, chosen, output, why, format=output_format, keep=keep_best)
    limits = running.limits_of(mesh, result, chosen)
    facts = {
        "input": str(mesh_file),
        "output": str(output),
        "options": named(options),
        **result.to_dict(),
        "limits": limits.to_dict(),
    }
    with files.Outputs() as outputs:
        outputs.put(output, lambda: write_mesh(output, result.mesh, format=output_format))
        if plot is not None:
            from qsmooth.output.figures import save_figures

            outputs.put(plot, lambda: save_figures(mesh, result, plot, metric=plot_metric))
        outputs.put_report(report_file, mesh_file, [result])
        written = outputs.written[:]
        if outputs.put_json(json_file, facts):
            return
        terminal.write_heading(f"{mesh_file}: {tables.size_text(result.before)}")
        terminal.write_table(tables.change_table(result.before, result.after))
        running.show_outcome(result)
        running.show_limits(limits)
        if written:
            terminal.write_line(f"Wrote {' and '.join(map(str, written))}")
