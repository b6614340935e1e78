"""Figures of the commands: their options, and drawing after the tables."""

from __future__ import annotations

from collections.abc import Callable
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from qsmooth.cli import files, terminal
from qsmooth.cli.options import REPORT


class Scale(StrEnum):
    """How colours go with figures."""

    linear = "linear"
    quantiles = "quantiles"


PlotOption = Annotated[
    Path | None,
    typer.Option(
        "--plot",
        metavar="FOLDER",
        help="Also write figures into this folder, as PNG and SVG; of 20 000 cells and more as PNG "
        "alone.",
        rich_help_panel=REPORT,
    ),
]
MetricOption = Annotated[
    str,
    typer.Option(
        "--plot-metric",
        metavar="METRIC",
        help="What figures are coloured by: {metrics}.",
        rich_help_panel=REPORT,
    ),
]
ScaleOption = Annotated[
    Scale,
    typer.Option(
        "--plot-scale",
        metavar=f"[{'|'.join(Scale)}]",
        help="How: [b]linear[/b], from the best to the worst there is; [b]quantiles[/b], each "
        "colour for a tenth of the cells, which shows what is alike.",
        rich_help_panel=REPORT,
    ),
]

LogOption = Annotated[
    bool,
    typer.Option(
        "--plot-log",
        help="Give histograms a logarithmic axis, which shows the few bad cells of many.",
        rich_help_panel=REPORT,
    ),
]


def checked(plot: Path | None, metric: str, scale: Scale, log: bool = False) -> str:
    """Refuse a folder or a metric that is none before the work; gives the metric's name."""
    from qsmooth.metrics import find_metric

    name = find_metric(metric.replace("-", "_"), "--plot-metric").name
    if plot is None:
        for option, given in (
            ("--plot-metric", name != "max_angle"),
            ("--plot-scale", scale is not Scale.linear),
            ("--plot-log", log),
        ):
            if given:
                raise ValueError(f"{option} is of figures, and none is drawn: add --plot FOLDER")
        return name
    from qsmooth.output.drawing import require_matplotlib

    if plot.exists() and not plot.is_dir():
        raise ValueError(f"'{plot}' is a file; --plot takes a folder")
    require_matplotlib()
    return name


def draw(outputs: files.Outputs, plot: Path | None, save: Callable[[Path], object]) -> None:
    """Draw into a folder, if one is wanted, and say meanwhile that this goes on."""
    if plot is not None:
        with terminal.status("drawing"):
            outputs.put(plot, lambda: save(plot))
