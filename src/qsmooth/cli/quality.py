"""``qsmooth quality``: figures of a mesh, its worst cells, and gates for a pipeline."""

from __future__ import annotations

import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from qsmooth.cli import files, plotting, running, terminal
from qsmooth.cli.options import REPORT

if TYPE_CHECKING:
    from qsmooth.metrics import Check, Quality

GATE = "Gate: exit code 0 where all checks pass, 1 where one fails"


def quality(
    mesh_file: files.In,
    metrics: Annotated[
        str | None,
        typer.Option(
            metavar="NAMES",
            help="Metrics to show, separated by commas, or all, out of {metrics}.  "
            "[dim]\\[default: {short}][/dim]",
            rich_help_panel=REPORT,
            show_default=False,
        ),
    ] = None,
    worst: Annotated[
        int,
        typer.Option(
            metavar="N", help="How many of the worst cells to list.", rich_help_panel=REPORT
        ),
    ] = 20,
    worst_by: Annotated[
        str,
        typer.Option(
            metavar="METRIC", help="Metric that ranks them, any of these.", rich_help_panel=REPORT
        ),
    ] = "scaled_jacobian",
    fail_below: Annotated[
        list[str] | None,
        typer.Option(
            metavar="METRIC=VALUE",
            help="Fail if a cell has less, as in [b]min_angle=20[/b]; may be repeated.",
            rich_help_panel=GATE,
        ),
    ] = None,
    fail_above: Annotated[
        list[str] | None,
        typer.Option(
            metavar="METRIC=VALUE",
            help="Fail if a cell has more, as in [b]aspect_ratio=10[/b]; may be repeated.",
            rich_help_panel=GATE,
        ),
    ] = None,
    fail_invalid: Annotated[
        bool,
        typer.Option(
            "--fail-invalid",
            help="Fail if a cell is not valid: collapsed, concave, crossed or inverted.",
            rich_help_panel=GATE,
        ),
    ] = False,
    github: Annotated[
        bool,
        typer.Option(
            "--github",
            help="Also print an annotation of GitHub's workflows for each check that fails.",
            rich_help_panel=GATE,
        ),
    ] = False,
    junit: Annotated[
        Path | None,
        typer.Option(
            "--junit",
            metavar="FILE",
            help="Also write the checks as JUnit XML, a test case each.",
            rich_help_panel=GATE,
        ),
    ] = None,
    merge: files.MergeOption = False,
    merge_tolerance: files.MergeToleranceOption = None,
    surface: files.SurfaceOption = files.Surface.auto,
    geographic: files.GeographicOption = None,
    format: files.FormatOption = None,
    plot: plotting.PlotOption = None,
    plot_metric: plotting.MetricOption = "max_angle",
    plot_scale: plotting.ScaleOption = plotting.Scale.linear,
    plot_log: plotting.LogOption = False,
    json_file: files.JsonOption = None,
    debug: files.DebugOption = False,
) -> None:
    """Measure a mesh: extremes, means, histograms, the worst cells, and checks for a pipeline."""
    from qsmooth.cli import checks as machine
    from qsmooth.io.files import replace_bytes
    from qsmooth.metrics import find_metric, limits, parse_gate, parse_metrics
    from qsmooth.metrics import quality as measure
    from qsmooth.output import tables

    if worst < 0:
        raise ValueError(f"--worst must be 0 or more, got {worst}")
    by = find_metric(worst_by.replace("-", "_"), "--worst-by").name
    shown = parse_metrics(metrics, "--metrics")
    gates = [(*parse_gate(text, "--fail-below"), True) for text in fail_below or ()]
    gates += [(*parse_gate(text, "--fail-above"), False) for text in fail_above or ()]
    plot_metric = plotting.checked(plot, plot_metric, plot_scale, plot_log)
    files.refuse_clash(json_file, mesh_file)
    files.refuse_clash(junit, mesh_file, *filter(None, [json_file]), option="--junit")
    started = time.perf_counter()
    within = files.merge_within(merge, merge_tolerance)
    mesh = files.read(mesh_file, surface, format, geographic, within)
    measured = measure(mesh)
    summary, bounds = measured.summary(shown), limits(mesh)
    checks = _checks(measured, gates, fail_invalid)
    passed = all(check.passed for check in checks)
    facts = {
        "input": str(mesh_file),
        **summary.to_dict(),
        "limits": bounds.to_dict(),
        "worst_cells": _worst_cells(measured, worst, by, shown),
        "checks": [check.to_dict() for check in checks],
        "passed": passed,
    }

    def save(folder: Path) -> object:
        from qsmooth.output.saving import save_quality_figures

        return save_quality_figures(
            mesh, folder, metric=plot_metric, scale=plot_scale.value, log=plot_log
        )

    with files.Outputs() as outputs:
        if junit is not None:
            report = machine.junit(mesh_file, checks, time.perf_counter() - started)
            outputs.put(junit, lambda: replace_bytes(junit, report))
        if not outputs.put_json(json_file, facts):
            terminal.write_heading(f"{mesh_file}: {tables.size_text(summary)}")
            terminal.write_table(tables.summary_table(summary))
            running.show_limits(bounds)
            if worst:
                listed = tables.worst_table(measured, worst, by, shown)
                for part in listed.narrowed(terminal.width()):
                    terminal.write_table(part)
            for check in checks:
                terminal.write_line(("passed: " if check.passed else "FAILED: ") + check.text)
        elif json_file == Path("-"):
            for check in checks:
                if not check.passed:
                    terminal.say(f"failed: {check.text}")
        plotting.draw(outputs, plot, save)
        if plot in outputs.written and json_file != Path("-"):
            terminal.write_line(f"Wrote {plot}")
        for line in machine.workflow_commands(mesh_file, checks) if github else ():
            terminal.write_command(line, aside=json_file == Path("-"))
        if not passed:
            raise typer.Exit(terminal.FAILED)


def _checks(
    measured: Quality, gates: list[tuple[str, float, bool]], fail_invalid: bool
) -> list[Check]:
    from qsmooth.metrics import check_gate, check_validity

    checks = [check_gate(measured, name, value, below=below) for name, value, below in gates]
    return [*checks, check_validity(measured)] if fail_invalid else checks


def _worst_cells(
    measured: Quality, k: int, by: str, metrics: tuple[str, ...]
) -> list[dict[str, Any]]:
    """List the worst cells for JSON, each with its class."""
    from qsmooth.metrics import Validity

    return [
        {**cell, "state": Validity(int(measured.validity[cell["cell"]])).name.lower()}
        for cell in measured.worst(k, by, metrics).to_dict()
    ]
