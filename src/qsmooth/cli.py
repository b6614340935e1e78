"""The command line: smooth, untangle, quality, compare, info, demo.

Tables go to standard output, in colour on a terminal and as plain text elsewhere; progress,
warnings and errors go to standard error. Numba, meshio and matplotlib are loaded inside the
commands, so that ``--help`` answers at once.
"""

from __future__ import annotations

import contextlib
import json
import os
import re
import sys
import traceback
import warnings
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NoReturn, TextIO

import typer

from qsmooth import __version__
from qsmooth._words import plural
from qsmooth.errors import MeshWarning

if TYPE_CHECKING:
    from qsmooth.mesh import Mesh
    from qsmooth.metrics import Limits
    from qsmooth.smoothing import SmoothResult, SweepRecord
    from qsmooth.table import Table

PASSED, FAILED, ERROR, INTERRUPTED, BROKEN_PIPE = 0, 1, 2, 130, 141
# Lines of text, as opposed to tables, are broken here where the output is no terminal.
TEXT_WIDTH = 100

app = typer.Typer(
    name="qsmooth",
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode="rich",
    context_settings={"help_option_names": ["--help", "-h"]},
)


class _ReaderLeftError(Exception):
    """The reader of standard output left; Typer would exit with 1, which means a failed gate."""


class Surface(StrEnum):
    """What a third coordinate means."""

    auto = "auto"
    flat = "flat"


class Guard(StrEnum):
    """What every step has to keep."""

    quality = "quality"
    clearance = "clearance"
    none = "none"


class Weights(StrEnum):
    """Where the Laplacian methods move a vertex."""

    uniform = "uniform"
    area = "area"


class Diagonal(StrEnum):
    """Along which quads are cut."""

    shorter = "shorter"
    first = "first"
    second = "second"


class Objective(StrEnum):
    """What the mean stage of the optimiser improves."""

    shape = "shape"


class DemoMesh(StrEnum):
    """Meshes of the demo."""

    spiral = "spiral"
    lake = "lake"


class Metric(StrEnum):
    """Metrics that cells are ranked or coloured by."""

    min_angle = "min_angle"
    max_angle = "max_angle"
    aspect_ratio = "aspect_ratio"
    scaled_jacobian = "scaled_jacobian"
    shape = "shape"


FILES, METHOD, REPORT = "Files", "Smoothing", "Report"
OPTIMISER, ANGLES, OTHERS = "Optimiser", "Star and quad", "Other methods"

In = Annotated[Path, typer.Argument(metavar="IN", help="Mesh file to read.", show_default=False)]
OutOption = Annotated[
    Path,
    typer.Option(
        "--output",
        "-o",
        metavar="OUT",
        help="Mesh file to write; its ending tells the format.",
        show_default=False,
        rich_help_panel=FILES,
    ),
]
OverwriteOption = Annotated[
    bool,
    typer.Option(
        "--overwrite", help="Allow OUT to replace a file, IN itself too.", rich_help_panel=FILES
    ),
]
SurfaceOption = Annotated[
    Surface,
    typer.Option(
        "--surface",
        help="What z means: [b]auto[/b], the mesh lies in one plane; [b]flat[/b], z is a value on "
        "a mesh in x and y, such as depth, and is carried along.",
        rich_help_panel=FILES,
    ),
]
FormatOption = Annotated[
    str | None,
    typer.Option(
        "--format",
        metavar="NAME",
        help="Format of IN; by default its ending and content tell.",
        rich_help_panel=FILES,
    ),
]
OutputFormatOption = Annotated[
    str | None,
    typer.Option(
        "--output-format",
        metavar="NAME",
        help="Format of OUT, if its ending does not say.",
        rich_help_panel=FILES,
    ),
]
JsonOption = Annotated[
    Path | None,
    typer.Option(
        "--json",
        metavar="FILE",
        help="Also write the figures as JSON; [b]-[/b] prints them, and no table.",
        rich_help_panel=REPORT,
    ),
]


def _option(name: str, help: str, panel: str, **more: Any) -> Any:
    """Describe an option whose default the method has: not given, it is None."""
    return typer.Option(name, help=help, rich_help_panel=panel, show_default=False, **more)


def _with_default(help: str, default: str) -> str:
    return f"{help}  [dim]\\[default: {default}][/dim]"


# Smoothing
SweepsOption = Annotated[
    int | None,
    _option(
        "--sweeps",
        _with_default("Sweeps at most, 0 or more.", "5000 for optimize, 50 for others"),
        METHOD,
    ),
]
SelectionOption = Annotated[
    str | None,
    _option(
        "--selection",
        "Cells whose vertices may move, by ids, as in [b]3,7,12[/b], or by a threshold on a "
        "metric, as in [b]'max_angle > 150'[/b].",
        METHOD,
        metavar="CELLS",
    ),
]
SelectionRingsOption = Annotated[
    int | None,
    _option(
        "--selection-rings",
        _with_default("How often the selection grows by the cells that touch it.", "0"),
        METHOD,
    ),
]
KeepInterfacesOption = Annotated[
    bool | None,
    _option(
        "--keep-interfaces/--no-keep-interfaces",
        _with_default(
            "Whether vertices on lines between regions, and on line cells, stay.",
            "keep-interfaces",
        ),
        METHOD,
    ),
]
ThreadsOption = Annotated[
    int | None,
    _option(
        "--threads",
        _with_default("Threads; the result does not depend on it.", "by size"),
        METHOD,
    ),
]
# Optimiser
TimeLimitOption = Annotated[
    float | None,
    _option(
        "--time-limit",
        "Seconds after which it stops with the best so far.",
        OPTIMISER,
        metavar="SECONDS",
    ),
]
TargetQualityOption = Annotated[
    float | None,
    _option(
        "--target-quality",
        "Smallest scaled Jacobian, up to 1, at which it may stop.",
        OPTIMISER,
    ),
]
WorstOption = Annotated[
    bool | None,
    _option(
        "--worst/--no-worst",
        _with_default("Whether to see to the worst cells too, or only to the mean.", "worst"),
        OPTIMISER,
    ),
]
MeanLossOption = Annotated[
    float | None,
    _option(
        "--mean-loss",
        _with_default(
            "Share of the best mean shape that the worst cells may cost, below 1.", "0.1"
        ),
        OPTIMISER,
    ),
]
ObjectiveOption = Annotated[
    Objective | None,
    _option(
        "--objective",
        _with_default("What the mean is of: shape is the mean ratio to the ideal cell.", "shape"),
        OPTIMISER,
    ),
]
# Star and quad
MaxAngleOption = Annotated[
    float | None,
    _option(
        "--max-angle",
        _with_default("Corners of quads with a larger angle are mended, degrees.", "120"),
        ANGLES,
    ),
]
MinAngleOption = Annotated[
    float | None,
    _option(
        "--min-angle",
        _with_default("Corners of quads with a smaller angle are mended, degrees.", "60"),
        ANGLES,
    ),
]
TriangleMaxAngleOption = Annotated[
    float | None,
    _option("--triangle-max-angle", _with_default("The same in triangles.", "90"), ANGLES),
]
TriangleMinAngleOption = Annotated[
    float | None,
    _option("--triangle-min-angle", _with_default("The same in triangles.", "45"), ANGLES),
]
WorstFractionOption = Annotated[
    float | None,
    _option(
        "--worst-fraction",
        _with_default(
            "Share of the cells that make proposals in a sweep, those with the largest angles.",
            "1",
        ),
        ANGLES,
    ),
]
WorstFirstOption = Annotated[
    bool | None,
    _option(
        "--worst-first",
        "Smooth that share first, then the rest, then all.",
        ANGLES,
    ),
]
BadAngleOption = Annotated[
    float | None,
    _option(
        "--bad-angle",
        _with_default("Cells with a larger angle move by --bad-step, degrees.", "180"),
        ANGLES,
    ),
]
BadStepOption = Annotated[
    float | None,
    _option(
        "--bad-step",
        _with_default("Their share of each proposed move, up to 2.", "as --step"),
        ANGLES,
    ),
]
# Other methods, and options of several
StepOption = Annotated[
    float | None,
    _option(
        "--step",
        _with_default(
            "Share of each proposed move that is made, up to 1. Of star, quad, aspect-ratio and "
            "angle.",
            "0.25; aspect-ratio 0.2, angle 1",
        ),
        OTHERS,
    ),
]
RtolOption = Annotated[
    float | None,
    _option(
        "--rtol",
        _with_default(
            "A vertex rests when it moves less than this share of its shortest edge; stop when all "
            "rest or quality no longer improves. 0 makes all sweeps. Not of optimize.",
            "0.001",
        ),
        OTHERS,
    ),
]
GuardOption = Annotated[
    Guard | None,
    _option(
        "--guard",
        _with_default(
            "What every move keeps: [b]clearance[/b], that valid cells stay valid; [b]quality[/b], "
            "also that the worst cell does not get worse; [b]none[/b], of angle only, nothing.",
            "quality",
        ),
        OTHERS,
    ),
]
SplitQuadsOption = Annotated[
    Diagonal | None,
    _option(
        "--split-quads",
        "Cut each quad in two triangles along this diagonal and smooth these. Not of optimize.",
        OTHERS,
    ),
]
MaxEdgeRatioOption = Annotated[
    float | None,
    _option(
        "--max-edge-ratio",
        _with_default(
            "Of aspect-ratio: two edges are left alone whose ratio is no larger, 1 or more.", "1.2"
        ),
        OTHERS,
    ),
]
WeightsOption = Annotated[
    Weights | None,
    _option(
        "--weights",
        _with_default(
            "Of the Laplacian methods: [b]uniform[/b], to the mean of the neighbours; [b]area[/b], "
            "to the centroid of the cells around.",
            "uniform",
        ),
        OTHERS,
    ),
]
DebugOption = Annotated[
    bool, typer.Option("--debug", help="Show a traceback on errors (or set QSMOOTH_DEBUG=1).")
]


def main(arguments: Sequence[str] | None = None) -> NoReturn:
    """Run the command line and leave the interpreter with its exit code."""
    arguments = list(sys.argv[1:] if arguments is None else arguments)
    sys.exit(run(arguments))


def run(arguments: Sequence[str]) -> int:
    """Run the command line; every error becomes one line on standard error and a code.

    Returns
    -------
    int
        0 success, 1 a quality gate failed or cells stay invalid, 2 an error, 130 interrupted.
    """
    debug = "--debug" in arguments or os.environ.get("QSMOOTH_DEBUG", "0") not in ("", "0")
    with warnings.catch_warnings():
        warnings.simplefilter("always", MeshWarning)
        show = warnings.showwarning

        def show_in_one_line(
            message: Warning | str, category: type[Warning], *where: Any, **more: Any
        ) -> None:
            if issubclass(category, MeshWarning):
                _say(f"warning: {message}")
            else:
                show(message, category, *where, **more)

        warnings.showwarning = show_in_one_line
        try:
            code = app(args=list(arguments), prog_name="qsmooth", standalone_mode=False)
            sys.stdout.flush()
        except KeyboardInterrupt:
            code = INTERRUPTED
        except typer.Abort:
            code = INTERRUPTED
        except (_ReaderLeftError, BrokenPipeError):
            # Whoever read the output has left; nothing more can be said to him.
            with contextlib.suppress(OSError, ValueError):
                os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
            return BROKEN_PIPE
        except Exception as error:
            if debug:
                traceback.print_exc()
            _say(f"error: {_in_words(error)}")
            return ERROR
    if code == INTERRUPTED:
        _say("interrupted")
    return int(code or PASSED)


def _version(wanted: bool) -> None:
    if wanted:
        _print(f"qsmooth {__version__}")
        raise typer.Exit


@app.callback(invoke_without_command=True)
def _root(
    context: typer.Context,
    version: Annotated[
        bool,
        typer.Option("--version", callback=_version, is_eager=True, help="Show the version."),
    ] = False,
    debug: DebugOption = False,
) -> None:
    """Make 2D quadrilateral, triangle and mixed meshes better by moving their vertices.

    Start with [b]qsmooth demo[/b], which needs no file.
    """
    if context.invoked_subcommand is None:
        text = context.get_help()
        if text:
            _print(text)


@app.command()
def smooth(
    mesh_file: In,
    output: OutOption,
    method: Annotated[
        str,
        typer.Option(
            "--method",
            "-m",
            help="optimize, star, quad, aspect-ratio (of triangles), angle, smart-laplacian, "
            "laplacian (unguarded: may break cells), or auto, which means optimize.",
            rich_help_panel=METHOD,
        ),
    ] = "auto",
    sweeps: SweepsOption = None,
    selection: SelectionOption = None,
    selection_rings: SelectionRingsOption = None,
    keep_interfaces: KeepInterfacesOption = None,
    threads: ThreadsOption = None,
    time_limit: TimeLimitOption = None,
    target_quality: TargetQualityOption = None,
    worst: WorstOption = None,
    mean_loss: MeanLossOption = None,
    objective: ObjectiveOption = None,
    max_angle: MaxAngleOption = None,
    min_angle: MinAngleOption = None,
    triangle_max_angle: TriangleMaxAngleOption = None,
    triangle_min_angle: TriangleMinAngleOption = None,
    worst_fraction: WorstFractionOption = None,
    worst_first: WorstFirstOption = None,
    bad_angle: BadAngleOption = None,
    bad_step: BadStepOption = None,
    step: StepOption = None,
    rtol: RtolOption = None,
    guard: GuardOption = None,
    split_quads: SplitQuadsOption = None,
    max_edge_ratio: MaxEdgeRatioOption = None,
    weights: WeightsOption = None,
    overwrite: OverwriteOption = False,
    surface: SurfaceOption = Surface.auto,
    format: FormatOption = None,
    output_format: OutputFormatOption = None,
    plot: Annotated[
        Path | None,
        typer.Option(
            metavar="FOLDER",
            help="Also write figures, as PNG and SVG, into this folder.",
            rich_help_panel=REPORT,
        ),
    ] = None,
    plot_metric: Annotated[
        Metric, typer.Option(help="What figures are coloured by.", rich_help_panel=REPORT)
    ] = Metric.max_angle,
    json_file: JsonOption = None,
    debug: DebugOption = False,
) -> None:
    """Smooth a mesh, and show its quality before and after.

    Boundary vertices stay. OUT keeps everything that IN holds but the coordinates.
    """
    from qsmooth.output import tables as report

    _refuse_unsafe(mesh_file, output, overwrite, json_file)
    if plot is not None:
        from qsmooth.output.drawing import require_matplotlib

        if plot.exists() and not plot.is_dir():
            raise ValueError(f"'{plot}' is a file; --plot takes a folder")
        require_matplotlib()
    options = _given(
        max_sweeps=sweeps, selection=_cells(selection), selection_rings=selection_rings,
        keep_interfaces=keep_interfaces, threads=threads, time_limit=time_limit,
        target_quality=target_quality, worst=worst, mean_loss=mean_loss, objective=objective,
        max_angle=max_angle, min_angle=min_angle, triangle_max_angle=triangle_max_angle,
        triangle_min_angle=triangle_min_angle, worst_fraction=worst_fraction,
        worst_first=worst_first, bad_angle=bad_angle, bad_step=bad_step, step=step, rtol=rtol,
        guard=guard, split_quads=split_quads, max_edge_ratio=max_edge_ratio, weights=weights,
    )  # fmt: skip
    mesh = _read(mesh_file, surface, format)
    _require_format(output, mesh, output_format)
    result = _smooth(mesh, method, options)
    bounds = _bounds(result, options)
    from qsmooth.io import write_mesh

    write_mesh(output, result.mesh, format=output_format)
    written = [output]
    if plot is not None:
        from qsmooth.output.figures import save_figures

        save_figures(mesh, result, plot, metric=plot_metric.value)
        written.append(plot)
    facts = {
        "input": str(mesh_file),
        "output": str(output),
        "options": _named(options),
        **_result_facts(result, bounds),
        "before": result.before.to_dict(),
    }
    if _write_json(json_file, facts):
        return
    _heading(f"{mesh_file}: {report.size_text(result.before)}")
    _table(report.change_table(result.before, result.after))
    _show_outcome(result, bounds)
    _text(f"Wrote {' and '.join(map(str, written))}")


@app.command()
def untangle(
    mesh_file: In,
    output: OutOption,
    sweeps: Annotated[
        int | None,
        _option("--sweeps", _with_default("Sweeps at most, 0 or more.", "20000"), METHOD),
    ] = None,
    time_limit: Annotated[
        float | None,
        _option(
            "--time-limit",
            "Seconds after which it stops with the best so far.",
            METHOD,
            metavar="SECONDS",
        ),
    ] = None,
    keep_interfaces: KeepInterfacesOption = None,
    threads: ThreadsOption = None,
    overwrite: OverwriteOption = False,
    surface: SurfaceOption = Surface.auto,
    format: FormatOption = None,
    output_format: OutputFormatOption = None,
    json_file: JsonOption = None,
    debug: DebugOption = False,
) -> None:
    """Make a mesh valid by moving its vertices, and stop there.

    Exit code 0 where every cell is valid, 1 where some stay invalid; OUT then has the best that was
    found. Smoothing with method optimize does this first, by itself.
    """
    from qsmooth.output import tables as report

    _refuse_unsafe(mesh_file, output, overwrite, json_file)
    options = _given(
        max_sweeps=sweeps, time_limit=time_limit, keep_interfaces=keep_interfaces, threads=threads
    )
    mesh = _read(mesh_file, surface, format)
    _require_format(output, mesh, output_format)
    result = _untangle(mesh, options)
    from qsmooth.io import write_mesh

    write_mesh(output, result.mesh, format=output_format)
    n_invalid = result.after.n_invalid
    facts = {
        "input": str(mesh_file),
        "output": str(output),
        "options": _named(options),
        **_result_facts(result),
        "valid": n_invalid == 0,
        "before": result.before.to_dict(),
    }
    failed = f"FAILED: {plural(n_invalid, 'cell')} of {result.after.n_cells} not valid"
    if not _write_json(json_file, facts):
        _heading(f"{mesh_file}: {report.size_text(result.before)}")
        _table(report.change_table(result.before, result.after))
        _show_outcome(result)
        if n_invalid:
            _text(failed)
            _text(f"Wrote the best that was found, {output}")
        else:
            _text(f"Wrote {output}")
    elif n_invalid:
        _say(failed.replace("FAILED", "failed"))
    if n_invalid:
        raise typer.Exit(FAILED)


@app.command()
def quality(
    mesh_file: In,
    worst: Annotated[
        int, typer.Option(help="How many of the worst cells to list.", rich_help_panel=REPORT)
    ] = 20,
    worst_by: Annotated[
        Metric, typer.Option(help="Metric that ranks them.", rich_help_panel=REPORT)
    ] = Metric.scaled_jacobian,
    fail_below: Annotated[
        list[str] | None,
        typer.Option(
            metavar="METRIC=VALUE",
            help="Fail if a cell has less, as in [b]min_angle=20[/b]; may be repeated.",
            rich_help_panel="Gate: exit code 0 where all checks pass, 1 where one fails",
        ),
    ] = None,
    fail_above: Annotated[
        list[str] | None,
        typer.Option(
            metavar="METRIC=VALUE",
            help="Fail if a cell has more, as in [b]aspect_ratio=10[/b]; may be repeated.",
            rich_help_panel="Gate: exit code 0 where all checks pass, 1 where one fails",
        ),
    ] = None,
    fail_invalid: Annotated[
        bool,
        typer.Option(
            "--fail-invalid",
            help="Fail if a cell is not valid: collapsed, concave, crossed or inverted.",
            rich_help_panel="Gate: exit code 0 where all checks pass, 1 where one fails",
        ),
    ] = False,
    surface: SurfaceOption = Surface.auto,
    format: FormatOption = None,
    json_file: JsonOption = None,
    debug: DebugOption = False,
) -> None:
    """Measure a mesh: extremes, means, histograms, the worst cells, and checks for a pipeline.

    Metrics are min_angle, max_angle (degrees), aspect_ratio, scaled_jacobian and shape.
    """
    from qsmooth import metrics
    from qsmooth.output import tables as report

    if worst < 0:
        raise ValueError(f"--worst must be 0 or more, got {worst}")
    gates = [(*metrics.parse_gate(text, "--fail-below"), True) for text in fail_below or ()]
    gates += [(*metrics.parse_gate(text, "--fail-above"), False) for text in fail_above or ()]
    _refuse_clash(json_file, mesh_file)
    mesh = _read(mesh_file, surface, format)
    measured = metrics.quality(mesh)
    summary, bounds = measured.summary(), metrics.limits(mesh)
    checks = [
        metrics.check_gate(measured, name, threshold, below=below)
        for name, threshold, below in gates
    ]
    if fail_invalid:
        checks.append(metrics.check_validity(measured))
    passed = all(check.passed for check in checks)
    facts = {
        "input": str(mesh_file),
        **summary.to_dict(),
        "limits": bounds.to_dict(),
        "worst_cells": [
            {**cell, "state": metrics.Validity(int(measured.validity[cell["cell"]])).name.lower()}
            for cell in measured.worst(worst, worst_by.value).to_dict()
        ],
        "checks": [check.to_dict() for check in checks],
        "passed": passed,
    }
    if not _write_json(json_file, facts):
        _heading(f"{mesh_file}: {report.size_text(summary)}")
        _table(report.summary_table(summary))
        _show_limits(bounds)
        if worst:
            _table(report.worst_table(measured, worst, worst_by.value))
        for check in checks:
            _text(("passed: " if check.passed else "FAILED: ") + check.text)
    elif not passed and json_file == Path("-"):
        for check in checks:
            if not check.passed:
                _say(f"failed: {check.text}")
    if not passed:
        raise typer.Exit(FAILED)


@app.command()
def compare(
    mesh_file: In,
    methods: Annotated[
        str,
        typer.Option(
            metavar="NAMES",
            help=_with_default(
                "Methods, separated by commas, out of optimize, star, quad, aspect-ratio, angle, "
                "smart-laplacian, laplacian.",
                "all",
            ),
            rich_help_panel=METHOD,
            show_default=False,
        ),
    ] = "all",
    sweeps: SweepsOption = None,
    selection: SelectionOption = None,
    selection_rings: SelectionRingsOption = None,
    keep_interfaces: KeepInterfacesOption = None,
    threads: ThreadsOption = None,
    time_limit: TimeLimitOption = None,
    target_quality: TargetQualityOption = None,
    worst: WorstOption = None,
    mean_loss: MeanLossOption = None,
    objective: ObjectiveOption = None,
    max_angle: MaxAngleOption = None,
    min_angle: MinAngleOption = None,
    triangle_max_angle: TriangleMaxAngleOption = None,
    triangle_min_angle: TriangleMinAngleOption = None,
    worst_fraction: WorstFractionOption = None,
    worst_first: WorstFirstOption = None,
    bad_angle: BadAngleOption = None,
    bad_step: BadStepOption = None,
    step: StepOption = None,
    rtol: RtolOption = None,
    guard: GuardOption = None,
    split_quads: SplitQuadsOption = None,
    max_edge_ratio: MaxEdgeRatioOption = None,
    weights: WeightsOption = None,
    surface: SurfaceOption = Surface.auto,
    format: FormatOption = None,
    json_file: JsonOption = None,
    debug: DebugOption = False,
) -> None:
    """Smooth a mesh with several methods, and put the results side by side.

    Nothing is written. An option goes to the methods that have it.
    """
    _refuse_clash(json_file, mesh_file)
    names = _method_names(methods)
    options = _given(
        max_sweeps=sweeps, selection=_cells(selection), selection_rings=selection_rings,
        keep_interfaces=keep_interfaces, threads=threads, time_limit=time_limit,
        target_quality=target_quality, worst=worst, mean_loss=mean_loss, objective=objective,
        max_angle=max_angle, min_angle=min_angle, triangle_max_angle=triangle_max_angle,
        triangle_min_angle=triangle_min_angle, worst_fraction=worst_fraction,
        worst_first=worst_first, bad_angle=bad_angle, bad_step=bad_step, step=step, rtol=rtol,
        guard=guard, split_quads=split_quads, max_edge_ratio=max_edge_ratio, weights=weights,
    )  # fmt: skip
    for option in options:
        if not any(option in _own_options(name, options) for name in names):
            has_no = "knows no guard none" if option == "guard" else f"has no option {option}"
            raise ValueError(_in_options(f"method {', '.join(names)} {has_no}"))
    mesh = _read(mesh_file, surface, format)
    results, skipped = _compare(mesh, names, options)
    facts = {
        "input": str(mesh_file),
        "options": _named(options),
        "original": results[0].before.to_dict(),
        "methods": [_result_facts(result, _bounds(result, options)) for result in results],
        "skipped": skipped,
    }
    if not _write_json(json_file, facts):
        _show_comparison(str(mesh_file), results, skipped, options)


@app.command()
def info(
    mesh_file: In,
    ids: Annotated[
        int, typer.Option(help="How many ids of each finding to show.", rich_help_panel=REPORT)
    ] = 10,
    surface: SurfaceOption = Surface.auto,
    format: FormatOption = None,
    json_file: JsonOption = None,
    debug: DebugOption = False,
) -> None:
    """Say what a mesh consists of, and what is odd about it.

    Cells, boundary loops, orientation, regions; orphan and coincident vertices, edges without
    length, hanging nodes, pinched vertices, parts, cells that are not valid.
    """
    from qsmooth.inspection import inspect
    from qsmooth.output.tables import inspection_table

    if ids < 0:
        raise ValueError(f"--ids must be 0 or more, got {ids}")
    _refuse_clash(json_file, mesh_file)
    facts = inspect(_read(mesh_file, surface, format))
    if not _write_json(json_file, {"input": str(mesh_file), **facts.to_dict(ids)}):
        _heading(str(mesh_file))
        _table(inspection_table(facts, ids))


@app.command()
def demo(
    output: Annotated[
        Path,
        typer.Option("--output", "-o", metavar="FOLDER", help="Where to put meshes and figures."),
    ] = Path("qsmooth-demo"),
    mesh_name: Annotated[
        DemoMesh,
        typer.Option(
            "--mesh",
            help="[b]spiral[/b], 1.9K quads; [b]lake[/b], 24K quads with islands, takes longer.",
        ),
    ] = DemoMesh.spiral,
    sweeps: SweepsOption = None,
    debug: DebugOption = False,
) -> None:
    """Smooth a mesh of bad quads with each method; needs no file.

    Prints the comparison; writes the mesh, the optimised mesh, and figures.
    """
    from qsmooth.examples import demo_mesh, lake
    from qsmooth.io import write_mesh

    if output.exists() and not output.is_dir():
        raise ValueError(f"'{output}' is a file; --output takes a folder")
    name = mesh_name.value
    with _status(f"making the {name}"):
        mesh = demo_mesh() if mesh_name is DemoMesh.spiral else lake()
    options = _given(max_sweeps=sweeps)
    results, skipped = _compare(mesh, _method_names("all"), options)
    _show_comparison(name.capitalize(), results, skipped, options)
    output.mkdir(parents=True, exist_ok=True)
    chosen = next(result for result in results if result.method == "optimize")
    given, smoothed = output / f"{name}.off", output / f"{name}-{chosen.method}.off"
    write_mesh(given, mesh)
    write_mesh(smoothed, chosen.mesh)
    _text(f"Wrote the mesh, {given}, and what method {chosen.method} made of it, {smoothed}")
    try:
        from qsmooth.output.figures import save_figures

        with _status("drawing"):
            paths = save_figures(mesh, chosen, output)
    except ImportError as error:
        _say(f"warning: no figures: {error}")
    else:
        _text(f"Wrote {len(paths)} figures, as PNG and SVG, into {output}{os.sep}")
        _text(f"Look first at {output / 'comparison-whole.png'}")


def _refuse_unsafe(mesh_file: Path, output: Path, overwrite: bool, json_file: Path | None) -> None:
    """Refuse outputs that would destroy a file, before any work is done."""
    if output.is_dir():
        raise ValueError(f"'{output}' is a folder; OUT must be a file")
    if not output.parent.is_dir():
        raise ValueError(f"cannot write '{output}': there is no folder '{output.parent}'")
    if output.exists() and not overwrite:
        if _same_file(output, mesh_file):
            raise ValueError(f"OUT is the input, '{mesh_file}'; --overwrite allows that")
        raise ValueError(f"'{output}' exists; --overwrite replaces it")
    _refuse_clash(json_file, mesh_file, output)


def _refuse_clash(json_file: Path | None, *others: Path) -> None:
    if json_file is None or json_file == Path("-"):
        return
    for other in others:
        if _same_file(json_file, other):
            raise ValueError(f"--json would write over the mesh file '{other}'")
    if json_file.is_dir() or not json_file.parent.is_dir():
        raise ValueError(f"cannot write '{json_file}': it is a folder, or its folder is not there")


def _same_file(one: Path, other: Path) -> bool:
    if one.exists() and other.exists():
        return one.samefile(other)
    return os.path.realpath(one) == os.path.realpath(other)


def _given(**options: Any) -> dict[str, Any]:
    """Leave out the options that were not given."""
    return {
        name: value.value if isinstance(value, StrEnum) else value
        for name, value in options.items()
        if value is not None
    }


def _named(options: dict[str, Any]) -> dict[str, Any]:
    """Name options as the command line does."""
    return {"sweeps" if name == "max_sweeps" else name: v for name, v in options.items()}


def _cells(text: str | None) -> list[int] | str | None:
    """Take a selection apart: cell ids, or a threshold, which stays a text."""
    if text is None:
        return None
    if re.fullmatch(r"[\d\s,]*\d[\d\s,]*", text):
        return [int(number) for number in re.split(r"[\s,]+", text.strip(" ,"))]
    from qsmooth.selection import parse_threshold

    try:
        parse_threshold(text)
    except ValueError as error:
        raise ValueError(
            f"--selection takes cell ids such as 3,7,12 or a threshold; {error}"
        ) from None
    return text


def _require_format(path: Path, mesh: Mesh, name: str | None) -> None:
    """Refuse a format that can't be written before the work, and not after it."""
    from qsmooth.io import format_of

    format_of(path, mesh, format=name)


def _read(path: Path, surface: Surface, format: str | None) -> Mesh:
    from qsmooth.io import read_mesh

    with _status(f"reading {path}"):
        return read_mesh(path, surface=surface.value, format=format)


def _method_names(text: str) -> list[str]:
    from qsmooth.smoothing import METHODS

    if text == "all":
        return list(METHODS)
    names = list(dict.fromkeys(name.strip() for name in text.split(",") if name.strip()))
    unknown = [name for name in names if name not in METHODS]
    if unknown or not names:
        raise ValueError(
            f"--methods takes names out of {', '.join(METHODS)}, got {', '.join(unknown) or 'none'}"
        )
    return names


def _smooth(mesh: Mesh, method: str, options: dict[str, Any]) -> SmoothResult:
    from qsmooth import smoothing

    sweeping = method not in ("auto", "optimize") or "split_quads" in options
    total = options.get("max_sweeps", smoothing.SWEEPS) if sweeping else None
    try:
        with _progress(method, total) as callback:
            return smoothing.smooth(mesh, method, callback=callback, **options)
    except ValueError as error:
        raise ValueError(_in_options(str(error))) from error


def _untangle(mesh: Mesh, options: dict[str, Any]) -> SmoothResult:
    from qsmooth import smoothing

    try:
        with _progress("untangle", None) as callback:
            return smoothing.untangle(mesh, callback=callback, **options)
    except ValueError as error:
        raise ValueError(_in_options(str(error))) from error


def _own_options(method: str, options: dict[str, Any]) -> dict[str, Any]:
    """Keep those options that a method has."""
    from qsmooth.smoothing import METHODS

    return {
        name: value
        for name, value in options.items()
        if name in METHODS[method].options
        and (name != "guard" or value != "none" or method == "angle")
    }


def _compare(
    mesh: Mesh, names: Sequence[str], options: dict[str, Any]
) -> tuple[list[SmoothResult], dict[str, str]]:
    """Smooth with each method; also why methods were skipped, by name."""
    from qsmooth.smoothing import why_not

    results, skipped = [], {}
    for name in names:
        own = _own_options(name, options)
        reason = "" if "split_quads" in own else why_not(mesh, name)
        if reason and len(names) > 1:
            skipped[name] = _in_options(reason)
            continue
        if options.get("max_sweeps") != 0:
            # A sweep beforehand: the first call compiles, which is not the method's time.
            _smooth(mesh, name, {**own, "max_sweeps": 1})
        results.append(_smooth(mesh, name, own))
    return results, skipped


def _show_comparison(
    name: str,
    results: Sequence[SmoothResult],
    skipped: dict[str, str],
    options: dict[str, Any],
) -> None:
    from qsmooth.output import tables as report
    from qsmooth.smoothing import METHODS

    before = results[0].before
    _heading(f"{name}: {report.size_text(before)}")
    for table in report.comparison_tables(before, results, width=_width()):
        _table(table)
    for result in results:
        _show_outcome(result, _bounds(result, options) if result.method == "optimize" else None)
    for method, reason in skipped.items():
        _text(f"{METHODS[method].title}: skipped; {reason}.")


def _bounds(result: SmoothResult, options: dict[str, Any]) -> Limits:
    """Limits of the result's angles, by the options that it was made with."""
    from qsmooth.metrics import limits

    return limits(result.mesh, keep_interfaces=options.get("keep_interfaces", True))


def _show_outcome(result: SmoothResult, bounds: Limits | None = None) -> None:
    """Say what was done and why it stopped; the limits have lines of their own."""
    from qsmooth.output import tables as report
    from qsmooth.table import time_text

    reason = result.reason
    if bounds is not None:
        reason = reason.removesuffix("; " + "; ".join(str(bounds).splitlines()))
    sweeps = plural(result.sweeps, "sweep")
    _text(
        f"{report.method_title(result.method)}: {sweeps} in {time_text(result.seconds)}; "
        f"{_in_options(reason)}."
    )
    if bounds is not None:
        _show_limits(bounds)


def _show_limits(bounds: Limits) -> None:
    for line in str(bounds).splitlines():
        _text(f"  {line[0].upper()}{line[1:]}.")


def _result_facts(result: SmoothResult, bounds: Limits | None = None) -> dict[str, Any]:
    facts = {
        "method": result.method,
        "sweeps": result.sweeps,
        "converged": result.converged,
        "reason": result.reason,
        "seconds": result.seconds,
        "after": result.after.to_dict(),
        "history": [asdict(record) for record in result.history],
    }
    return facts if bounds is None else {**facts, "limits": bounds.to_dict()}


def _write_json(path: Path | None, facts: dict[str, Any]) -> bool:
    """Write facts as JSON; True if that went to standard output in place of the tables."""
    from qsmooth._json import finite

    if path is None:
        return False
    text = json.dumps(finite(facts), indent=2, allow_nan=False)
    if path == Path("-"):
        _print(text)
        return True
    path.write_text(text + "\n", encoding="utf-8")
    return False


def _console(stream: TextIO) -> Any:
    from rich.console import Console

    return Console(file=stream, highlight=False)


def _is_terminal(stream: TextIO) -> bool:
    try:
        return stream.isatty()
    except (AttributeError, ValueError):
        return False


def _width() -> int | None:
    """Characters in a line of the terminal; None where the output is none."""
    return int(_console(sys.stdout).width) if _is_terminal(sys.stdout) else None


def _print(text: str) -> None:
    from qsmooth.table import plain

    try:
        sys.stdout.write(plain(text, sys.stdout.encoding) + "\n")
    except BrokenPipeError as error:
        raise _ReaderLeftError from error


def _table(table: Table) -> None:
    if _is_terminal(sys.stdout):
        from rich.measure import Measurement

        console = _console(sys.stdout)
        options = console.options.update(max_width=10_000)
        if table.left or Measurement.get(console, options, table).minimum <= console.width:
            console.print(table)
            return
    _print(f"{table}\n")  # the terminal breaks lines, where rich would cut them


def _heading(text: str) -> None:
    if _is_terminal(sys.stdout):
        from rich.text import Text

        _console(sys.stdout).print(Text(text, style="bold"))
    else:
        _print(f"{text}\n")


def _text(text: str) -> None:
    if _is_terminal(sys.stdout):
        from rich.text import Text

        _console(sys.stdout).print(Text(text))
    else:
        _print(text)


def _say(text: str) -> None:
    """Print one line on standard error."""
    line = "qsmooth: " + " ".join(str(text).split())
    encoding = getattr(sys.stderr, "encoding", None) or "utf-8"
    with contextlib.suppress(OSError, ValueError):
        sys.stderr.write(line.encode(encoding, "replace").decode(encoding) + "\n")
        sys.stderr.flush()


@contextlib.contextmanager
def _status(text: str) -> Iterator[None]:
    """Say on a terminal what is going on."""
    if not _is_terminal(sys.stderr):
        yield
        return
    with _console(sys.stderr).status(text):
        yield


@contextlib.contextmanager
def _progress(method: str, total: int | None) -> Iterator[Callable[[SweepRecord], None] | None]:
    """Show on a terminal a bar of the sweeps; gives what `smooth` calls after each.

    Without a total, as the optimiser has none, the bar pulses; its records are of rounds of sweeps.
    """
    if not _is_terminal(sys.stderr):
        yield None
        return
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    from qsmooth.optimization import ROUND

    columns = (
        TextColumn("{task.fields[method]}"),
        BarColumn(),
        TextColumn("{task.fields[done]}"),
        TimeElapsedColumn(),
        TextColumn("{task.fields[state]}"),
    )
    with Progress(*columns, console=_console(sys.stderr), transient=True) as progress:
        task = progress.add_task("", total=total, method=method, done="", state="")
        done = 0

        def callback(record: SweepRecord) -> None:
            nonlocal done
            state = f"angles {record.min_angle:.1f}° to {record.max_angle:.1f}°"
            if record.n_invalid:
                state += f", {record.n_invalid} cells not valid"
            done += ROUND if total is None else 1
            text = f"about {done} sweeps" if total is None else f"{done} of {total} sweeps"
            progress.update(task, completed=done, done=text, state=state)

        yield callback


def _in_options(message: str) -> str:
    """Name options in a message of the library as they are named here."""
    for name, option in _OPTIONS.items():
        message = re.sub(rf"(?<![\w-]){name}\b", option, message)
    return message


# `step` and the like are words of other messages too: only the library's phrases are meant.
_WORDS = "rtol", "guard", "step", "threads", "method", "weights", "objective", "selection", "worst"
_OPTIONS = {
    "split_quads=True": "--split-quads shorter",
    "max_sweeps=": "--sweeps ",
    "max_sweeps": "--sweeps",
    **{
        name: "--" + name.replace("_", "-")
        for name in (
            "triangle_max_angle",
            "triangle_min_angle",
            "max_angle",
            "min_angle",
            "worst_fraction",
            "worst_first",
            "bad_angle",
            "bad_step",
            "max_edge_ratio",
            "split_quads",
            "selection_rings",
            "target_quality",
            "time_limit",
            "mean_loss",
            "keep_interfaces",
        )
    },
    **{f"{name}(?= must)": f"--{name}" for name in _WORDS},
    **{f"option {name}": f"option --{name}" for name in _WORDS},
    "cell ids in selection": "cell ids in --selection",
    "cell id in selection": "cell id in --selection",
}


def _in_words(error: Exception) -> str:
    """Say in one line what went wrong."""
    if hasattr(error, "format_message"):  # what Typer makes of a wrong command line
        return str(error.format_message())
    if isinstance(error, (ImportError, ValueError)):
        return str(error)
    if isinstance(error, OSError) and error.strerror:
        return f"{error.strerror}: '{error.filename}'" if error.filename else error.strerror
    if isinstance(error, MemoryError):
        return "there is not enough memory for this mesh"
    return f"{type(error).__name__}: {error}; --debug shows where"
