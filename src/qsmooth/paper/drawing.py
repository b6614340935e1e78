"""Figures 13 and 16 to 22, and one of angles by sweep. Needs matplotlib."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from qsmooth.metrics import METRICS, Summary, quality
from qsmooth.output.drawing import new_figure, save
from qsmooth.output.figures import plot_mesh
from qsmooth.paper.runs import COLUMNS, GIVEN, KNOWN, METHODS, PAPER_GUARD, PAPER_STEP, SWEEPS, Runs

if TYPE_CHECKING:
    from matplotlib.figure import Figure

TITLES = {
    GIVEN: "As given",
    "laplacian": "Laplacian",
    "star": "By star",
    "quad": "By quad",
}
WAYS = {"laplacian": "by Laplacian means", "star": "by star", "quad": "by quad"}
# Colours that stay apart for all kinds of colour blindness, with patterns for print.
COLOURS = {GIVEN: "#999999", "laplacian": "#E69F00", "star": "#0072B2", "quad": "#D55E00"}
HATCHES = {GIVEN: "", "laplacian": "////", "star": "", "quad": "...."}
SHOWN = ("max_angle", "min_angle", "aspect_ratio")
BY_SWEEP = "by-sweep"
ENDINGS = ("png", "svg")


@dataclass(frozen=True)
class PaperFigure:
    """A figure of the paper's results, as we fill its number.

    Attributes
    ----------
    number
        The paper's.
    mesh, method
        What it shows; a method of "" stands for histograms of all.
    """

    number: int
    mesh: str
    method: str

    @property
    def name(self) -> str:
        """Its file, without ending."""
        return f"figure-{self.number}"

    @property
    def title(self) -> str:
        """What it shows, in words."""
        if not self.method:
            return f"The {self.mesh}: histograms, as given and after each method"
        if self.method == GIVEN:
            return f"The {self.mesh} as given"
        return f"The {self.mesh} after smoothing {WAYS[self.method]}"

    @property
    def commands(self) -> list[str]:
        """Lines of the shell that make it: alone, and by plain commands from the page's folder."""
        lines = [f"qsmooth paper -o paper --figure {self.number}"]
        if self.method == GIVEN:
            lines.append(f"qsmooth quality {self.mesh}.off")
        elif self.method:
            lines.append(
                f"qsmooth smooth {self.mesh}.off -o {self.mesh}-{self.method}.off --method "
                f"{self.method} --sweeps {SWEEPS} --rtol 0 --plot {self.mesh}-{self.method}"
            )
        else:
            lines.append(
                f"qsmooth compare {self.mesh}.off --methods {','.join(METHODS)} "
                f"--sweeps {SWEEPS} --rtol 0"
            )
        return lines


FIGURES = (
    PaperFigure(13, "spiral", GIVEN),
    PaperFigure(16, "spiral", "laplacian"),
    PaperFigure(17, "spiral", "star"),
    PaperFigure(18, "spiral", "quad"),
    PaperFigure(19, "spiral", ""),
    PaperFigure(20, "lake", GIVEN),
    PaperFigure(21, "lake", "star"),
    PaperFigure(22, "lake", "quad"),
)


def draw(figure: PaperFigure, runs: Runs) -> Figure:
    """Draw one of the paper's figures."""
    if figure.method:
        return plot_mesh(runs.stage(figure.mesh, figure.method), title=figure.title)
    return _histograms(figure, runs)


def save_both(figure: Figure, folder: Path, name: str) -> list[Path]:
    """Save a figure as PNG and SVG."""
    paths = [folder / f"{name}.{ending}" for ending in ENDINGS]
    for path in paths:
        save(figure, path)
    return paths


def draw_by_sweep(runs: Runs) -> Figure:
    """Draw the spiral's extreme angles by sweep, ours and with the paper's choices."""
    figure = new_figure(11.0, 4.4)
    for n, column in enumerate(("max_angle", "min_angle")):
        axes = figure.add_subplot(1, 2, n + 1)
        for method in ("star", "quad"):
            colour = COLOURS[method]
            for result, style, how in (
                (runs.results["spiral", method], "-", "our defaults"),
                (runs.plain[method], "--", f"step {PAPER_STEP:g}, {PAPER_GUARD} guard"),
            ):
                values = result.history[column]
                label = f"{TITLES[method]}, {how}"
                axes.plot(np.arange(1, len(values) + 1), values, style, color=colour, label=label)
            theirs = KNOWN["spiral", method][COLUMNS.index(column)]
            axes.plot(
                [len(runs.plain[method].history)],
                [np.nan if theirs is None else theirs],
                "D",
                color=colour,
                markeredgecolor="black",
                label=f"{TITLES[method]}, the paper's last",
            )
        axes.set_xlabel("Sweep", fontsize=9)
        axes.set_ylabel(f"{METRICS[column].title} of the mesh [°]", fontsize=9)
        axes.tick_params(labelsize=8)
        axes.spines[["top", "right"]].set_visible(False)
    axes.legend(fontsize=8, frameon=False)
    figure.suptitle("The spiral, sweep by sweep", fontsize=13)
    figure.supxlabel("Of the paper only the figures after its last sweep are known.", fontsize=9)
    return figure


def _histograms(shown: PaperFigure, runs: Runs) -> Figure:
    """Draw the cells' angles and aspect ratios, a bar a method."""
    summaries: dict[str, Summary] = {GIVEN: quality(runs.meshes[shown.mesh]).summary(SHOWN)}
    summaries |= {method: runs.results[shown.mesh, method].after for method in METHODS}
    figure, width = new_figure(13.0, 4.6), 0.84 / len(summaries)
    for n, name in enumerate(SHOWN):
        metric, axes = METRICS[name], figure.add_subplot(1, len(SHOWN), n + 1)
        edges = summaries[GIVEN].histograms[name].edges
        places = np.arange(len(edges) - 1)
        for k, (method, summary) in enumerate(summaries.items()):
            axes.bar(
                places + (k - 1.5) * width,
                summary.histograms[name].percent,
                width,
                color=COLOURS[method],
                hatch=HATCHES[method],
                edgecolor="white",
                linewidth=0.4,
                label=f"{TITLES[method]}: worst {metric.text(summary.worst[name])}",
            )
        ticks = [f"{edge:g}" for edge in edges if np.isfinite(edge)]
        axes.set_xticks(np.arange(len(ticks)) - 0.5, ticks, fontsize=8)
        axes.tick_params(axis="y", labelsize=8)
        axes.set_xlabel(f"{metric.title} of a cell{metric.unit_words}", fontsize=9)
        axes.set_ylabel("Per cent of the cells", fontsize=9)
        axes.spines[["top", "right"]].set_visible(False)
        axes.legend(fontsize=8, frameon=False)
    figure.suptitle(shown.title, fontsize=13)
    return figure
