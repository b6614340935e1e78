"""Whole sets of figures, as PNG, and of smaller meshes as SVG, too. Needs matplotlib."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from qsmooth.mesh import Mesh
from qsmooth.output import figures
from qsmooth.output.charts import plot_convergence, plot_histograms
from qsmooth.output.displacement import OVERLAY_CELLS, plot_displacement
from qsmooth.output.drawables import named_results
from qsmooth.output.drawing import require_matplotlib, save
from qsmooth.output.scales import Scale

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from qsmooth.result import SmoothResult

# Figures of so many cells are images in an SVG, too, so a PNG has all that it would have.
IMAGE_CELLS = OVERLAY_CELLS


def save_figures(
    before: Mesh,
    result: SmoothResult,
    folder: str | Path,
    *,
    metric: str = "max_angle",
    scale: Scale = "linear",
    log: bool = False,
) -> list[Path]:
    """Draw every figure of a smoothing, and save each as PNG and SVG.

    Of 20 000 cells and more as PNG alone, and without those that others show, too.

    Parameters
    ----------
    before, result
        The mesh that was smoothed and what came out.
    folder
        Made if it is not there.
    metric, scale
        What the cells are coloured by, and how.
    log
        Whether histograms have a logarithmic axis.

    Returns
    -------
    list of Path
        The files written.
    """
    look = {"metric": metric, "scale": scale}
    mesh, comparison = figures.plot_mesh, figures.plot_comparison
    large = before.n_cells >= IMAGE_CELLS
    wanted: dict[str, Callable[[], Figure]] = {}
    if not large:
        wanted["before"] = partial(mesh, before, title="Before smoothing", **look)  # type: ignore[arg-type]
        wanted["after"] = partial(mesh, result, title="After smoothing", **look)  # type: ignore[arg-type]
    wanted["histograms"] = partial(plot_histograms, result, log=log)
    wanted["convergence"] = partial(plot_convergence, result)
    wanted["displacement"] = partial(plot_displacement, before, result, scale=scale)
    for view in figures.VIEWS:
        if view != "overlay" or not large:
            wanted[f"comparison-{view}"] = partial(
                comparison,
                before,
                result,
                view=view,
                **look,  # type: ignore[arg-type]
            )
    return _save_all(wanted, folder, before)


def save_quality_figures(
    mesh: Mesh,
    folder: str | Path,
    *,
    metric: str = "max_angle",
    scale: Scale = "linear",
    log: bool = False,
) -> list[Path]:
    """Draw a mesh, its worst cells and histograms, and save each as `save_figures` does."""
    return _save_all(
        {
            "mesh": partial(figures.plot_mesh, mesh, metric=metric, scale=scale),
            "worst": partial(
                figures.plot_mesh, mesh, metric=metric, scale=scale, view="worst",
                title="Around the worst cell",
            ),
            "histograms": partial(plot_histograms, mesh, log=log),
        },
        folder,
        mesh,
    )  # fmt: skip


def save_method_figures(
    results: Mapping[str, SmoothResult] | Sequence[SmoothResult],
    folder: str | Path,
    *,
    metric: str = "max_angle",
    scale: Scale = "linear",
) -> list[Path]:
    """Draw what methods made of a mesh side by side, and save each as `save_figures` does."""
    mesh = next(iter(named_results(results).values())).mesh
    methods = partial(figures.plot_methods, results, metric=metric, scale=scale)
    return _save_all(
        {
            "methods-whole": partial(methods, view="whole"),
            "methods-worst": partial(methods, view="worst"),
            "convergence": partial(plot_convergence, results),
        },
        folder,
        mesh,
    )


def _save_all(
    wanted: Mapping[str, Callable[[], Figure]], folder: str | Path, mesh: Mesh
) -> list[Path]:
    require_matplotlib()
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    endings = ("png",) if mesh.n_cells >= IMAGE_CELLS else ("png", "svg")
    paths = []
    for name, draw in wanted.items():
        figure = draw()
        for ending in endings:
            paths.append(folder / f"{name}.{ending}")
            save(figure, paths[-1])
    return paths
