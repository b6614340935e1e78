"""Whole sets of figures, each as PNG and SVG, into a folder. Needs matplotlib."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from qsmooth.mesh import Mesh
from qsmooth.output import figures
from qsmooth.output.charts import plot_convergence, plot_histograms
from qsmooth.output.drawing import require_matplotlib, save
from qsmooth.output.scales import Scale

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from qsmooth.result import SmoothResult


def save_figures(
    before: Mesh,
    result: SmoothResult,
    folder: str | Path,
    *,
    metric: str = "max_angle",
    scale: Scale = "linear",
) -> list[Path]:
    """Draw every figure of a smoothing, and save each as PNG and SVG.

    Parameters
    ----------
    before, result
        The mesh that was smoothed and what came out.
    folder
        Made if it is not there.
    metric, scale
        What the cells are coloured by, and how.

    Returns
    -------
    list of Path
        The files written.
    """
    look = {"metric": metric, "scale": scale}
    mesh, comparison = figures.plot_mesh, figures.plot_comparison
    wanted: dict[str, Callable[[], Figure]] = {
        "before": partial(mesh, before, title="Before smoothing", **look),  # type: ignore[arg-type]
        "after": partial(mesh, result, title="After smoothing", **look),  # type: ignore[arg-type]
        "histograms": partial(plot_histograms, result),
        "convergence": partial(plot_convergence, result),
        "displacement": partial(figures.plot_displacement, before, result, scale=scale),
    }
    for view in figures.VIEWS:
        if view != "overlay" or before.n_cells < figures.OVERLAY_CELLS:
            wanted[f"comparison-{view}"] = partial(
                comparison,
                before,
                result,
                view=view,
                **look,  # type: ignore[arg-type]
            )
    return _save_all(wanted, folder)


def save_quality_figures(
    mesh: Mesh, folder: str | Path, *, metric: str = "max_angle", scale: Scale = "linear"
) -> list[Path]:
    """Draw a mesh, its worst cells and histograms, and save each as PNG and SVG."""
    return _save_all(
        {
            "mesh": partial(figures.plot_mesh, mesh, metric=metric, scale=scale),
            "worst": partial(
                figures.plot_mesh, mesh, metric=metric, scale=scale, view="worst",
                title="Around the worst cell",
            ),
            "histograms": partial(plot_histograms, mesh),
        },
        folder,
    )  # fmt: skip


def save_method_figures(
    results: Mapping[str, SmoothResult] | Sequence[SmoothResult],
    folder: str | Path,
    *,
    metric: str = "max_angle",
    scale: Scale = "linear",
) -> list[Path]:
    """Draw what methods made of a mesh side by side, and save each figure as PNG and SVG."""
    methods = partial(figures.plot_methods, results, metric=metric, scale=scale)
    return _save_all(
        {
            "methods-whole": partial(methods, view="whole"),
            "methods-worst": partial(methods, view="worst"),
            "convergence": partial(plot_convergence, results),
        },
        folder,
    )


def _save_all(wanted: Mapping[str, Callable[[], Figure]], folder: str | Path) -> list[Path]:
    require_matplotlib()
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    paths = []
    for name, draw in wanted.items():
        figure = draw()
        for ending in ("png", "svg"):
            paths.append(folder / f"{name}.{ending}")
            save(figure, paths[-1])
    return paths
