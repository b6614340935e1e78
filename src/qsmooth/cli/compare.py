"""``qsmooth compare``: what several methods make of a mesh, side by side."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from qsmooth._words import did_you_mean
from qsmooth.cli import files, plotting, running, terminal
from qsmooth.cli.options import METHOD, REPORT, named, spell
from qsmooth.options import spelled

if TYPE_CHECKING:
    from qsmooth.mesh import Mesh
    from qsmooth.methods.base import Method
    from qsmooth.result import SmoothResult


def compare(
    mesh_file: files.In,
    methods: Annotated[
        str,
        typer.Option(
            metavar="NAMES",
            help="Methods, separated by commas, or all, out of {methods}.",
            rich_help_panel=METHOD,
        ),
    ] = "all",
    options: dict[str, Any] | None = None,
    merge: files.MergeOption = False,
    merge_tolerance: files.MergeToleranceOption = None,
    surface: files.SurfaceOption = files.Surface.auto,
    geographic: files.GeographicOption = None,
    format: files.FormatOption = None,
    histograms: Annotated[
        bool,
        typer.Option("--histograms", help="Also show the histograms.", rich_help_panel=REPORT),
    ] = False,
    plot: plotting.PlotOption = None,
    plot_metric: plotting.MetricOption = "max_angle",
    plot_scale: plotting.ScaleOption = plotting.Scale.linear,
    json_file: files.JsonOption = None,
    report_file: files.ReportOption = None,
    debug: files.DebugOption = False,
) -> None:
    """Smooth a mesh with several methods, and put the results side by side.

    No mesh is written. An option goes to the methods that have it.
    """
    plot_metric = plotting.checked(plot, plot_metric, plot_scale)
    files.refuse_clash(json_file, mesh_file)
    others = filter(None, [json_file])
    files.refuse_clash(report_file, mesh_file, *others, option="--report")
    within = files.merge_within(merge, merge_tolerance)
    options = options or {}
    chosen = with_options(method_names(methods), options)
    mesh = files.read(mesh_file, surface, format, geographic, within)
    results, skipped = run_all(mesh, chosen)
    facts = {
        "input": str(mesh_file),
        "options": named(options),
        "original": results[0].before.to_dict(),
        "methods": [
            {
                **{key: fact for key, fact in result.to_dict().items() if key != "before"},
                "limits": running.limits_of(mesh, result, method).to_dict(),
            }
            for method in chosen
            for result in results
            if method.name == result.method
        ],
        "skipped": skipped,
    }

    def save(folder: Path) -> object:
        from qsmooth.output.saving import save_method_figures

        return save_method_figures(results, folder, metric=plot_metric, scale=plot_scale.value)

    with files.Outputs() as outputs:
        outputs.put_report(report_file, mesh_file, results, skipped)
        shown = not outputs.put_json(json_file, facts)
        if shown:
            show(str(mesh_file), results, skipped, histograms)
        plotting.draw(outputs, plot, save)
        written = [path for path in outputs.written if path != json_file]
        if shown and written:
            terminal.write_line(f"Wrote {' and '.join(map(str, written))}")


def method_names(text: str) -> list[str]:
    """Take the names of methods apart, separated by commas."""
    from qsmooth.registry import methods

    known = methods()
    if text == "all":
        return list(known)
    names = list(dict.fromkeys(name.strip() for name in text.split(",") if name.strip()))
    unknown = [name for name in names if name not in known]
    if unknown or not names:
        raise ValueError(
            f"--methods takes names out of {', '.join(known)}, got "
            f"{', '.join(unknown) or 'none'}{did_you_mean(unknown[0], known) if unknown else ''}"
        )
    return names


def with_options(names: Sequence[str], options: Mapping[str, Any]) -> list[Method]:
    """Make methods, each with those of the options that it takes."""
    from qsmooth.registry import method_class
    from qsmooth.smoothing import configured

    for option in options:
        if not any(option in method_class(name).specs() for name in names):
            raise ValueError(f"method {', '.join(names)} has no option {spell(option)}")
    return configured(names, options)


def run_all(mesh: Mesh, chosen: Sequence[Method]) -> tuple[list[SmoothResult], dict[str, str]]:
    """Smooth with each method; also why methods were skipped, by name."""
    results: list[SmoothResult] = []
    skipped: dict[str, str] = {}
    for method in chosen:
        reason = method.why_not(mesh)
        if reason and len(chosen) > 1:
            skipped[method.name] = spelled(reason, spell)
    running_ones = [method for method in chosen if method.name not in skipped]
    for k, method in enumerate(running_ones, start=1):
        part = f"{k} of {len(running_ones)}"
        if method.max_sweeps > 0:
            # A sweep beforehand: the first call compiles, which is not the method's time.
            with terminal.status(f"{method.name} ({part}), a first sweep"):
                replace(method, max_sweeps=1).smooth(mesh)
        results.append(running.run(mesh, method, part=part))
    return results, skipped


def show(
    name: str,
    results: Sequence[SmoothResult],
    skipped: Mapping[str, str],
    histograms: bool = False,
) -> None:
    """Print what the methods made of a mesh."""
    from qsmooth.output import tables

    before = results[0].before
    terminal.write_heading(f"{name}: {tables.size_text(before)}")
    width = terminal.width()
    for table in tables.comparison_tables(before, results, width=width, histograms=histograms):
        terminal.write_table(table)
    for result in results:
        running.show_outcome(result)
        if result.outcome.limits is not None:
            running.show_limits(result.outcome.limits)
    for method, reason in skipped.items():
        terminal.write_line(f"{tables.method_title(method)}: skipped; {reason}.")
    terminal.write_line(tables.verdict(before, results, list(skipped)))
