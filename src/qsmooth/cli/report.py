"""``qsmooth report``: a page to look at, of a mesh before and after."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from qsmooth.cli import compare, files, running, terminal
from qsmooth.cli.options import METHOD, REPORT, spell

if TYPE_CHECKING:
    from qsmooth.mesh import Mesh
    from qsmooth.output.report import State


def report(
    mesh_file: Annotated[
        Path, typer.Argument(metavar="BEFORE", help="Mesh file to read.", show_default=False)
    ],
    after: Annotated[
        Path | None,
        typer.Argument(
            metavar="[AFTER]",
            help="Mesh file with the same cells, to put beside it.",
            show_default=False,
        ),
    ] = None,
    output: Annotated[
        Path, typer.Option("--output", "-o", metavar="FILE", help="Where to write the page.")
    ] = Path("report.html"),
    methods: Annotated[
        str | None,
        typer.Option(
            metavar="NAMES",
            help="Methods to run, separated by commas, all, or none, out of {methods}.  "
            "[dim]\\[default: {auto}, or none where there is AFTER][/dim]",
            rich_help_panel=METHOD,
            show_default=False,
        ),
    ] = None,
    options: dict[str, Any] | None = None,
    metrics: Annotated[
        str | None,
        typer.Option(
            metavar="NAMES",
            help="Metrics that cells can be coloured by, separated by commas, or all, out of "
            "{metrics}.  [dim]\\[default: {short}][/dim]",
            rich_help_panel=REPORT,
            show_default=False,
        ),
    ] = None,
    merge: files.MergeOption = False,
    merge_tolerance: files.MergeToleranceOption = None,
    surface: files.SurfaceOption = files.Surface.auto,
    geographic: files.GeographicOption = None,
    format: files.FormatOption = None,
    debug: files.DebugOption = False,
) -> None:
    """Write a report to look at: one HTML file that needs no network.

    Before and after side by side, the worst cells and what holds each, histograms, convergence,
    all methods in a table. Of BEFORE alone what methods make of it; BEFORE and AFTER are compared.
    """
    from qsmooth.metrics import parse_metrics
    from qsmooth.output.report import of_mesh, write_report
    from qsmooth.output.report.states import beside

    files.refuse_clash(output, mesh_file, *filter(None, [after]), option="--output")
    within = files.merge_within(merge, merge_tolerance)
    shown = parse_metrics(metrics, "--metrics")
    names = _method_names(methods, after)
    if options and not names:
        raise ValueError(f"{spell(next(iter(options)))} is of methods, and none is to run")
    chosen = compare.with_options(names, options or {})
    mesh = files.read(mesh_file, surface, format, geographic, within)
    before = of_mesh("before", str(mesh_file), mesh)
    others: list[State] = []
    if after is not None:
        other = files.read(after, surface, format, mesh.geographic, within)
        others.append(beside(before, "after", str(after), other))
    states, notes = _run(mesh, chosen, before)
    states[1:1] = others
    with files.Outputs() as outputs:
        title = mesh_file.name if after is None else f"{mesh_file.name}, {after.name}"
        with terminal.status("writing the report"):
            outputs.put(
                output,
                lambda: write_report(
                    states, output, title=title, metrics=shown, notes=notes, spell=spell
                ),
            )
        if outputs.written:
            size = output.stat().st_size / 1e6
            terminal.write_line(f"Wrote {output}, {size:.1f} MB; open it in a browser")


def _method_names(text: str | None, after: Path | None) -> list[str]:
    from qsmooth.registry import choose

    if text is None:
        return [choose({})[0]] if after is None else []
    return [] if text.strip() in ("", "none") else compare.method_names(text)


def _run(mesh: Mesh, chosen: list[Any], before: State) -> tuple[list[State], list[str]]:
    """Run the methods; gives the states, what they started from first, and what was skipped."""
    from qsmooth.output.report import states_of

    if not chosen:
        return [before], []
    if len(chosen) == 1:
        return states_of([running.run(mesh, chosen[0])]), []
    results, skipped = compare.run_all(mesh, chosen)
    return states_of(results), files.skipped_notes(skipped)
