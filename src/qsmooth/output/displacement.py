"""How far vertices moved: a map of it, and two meshes over each other. Needs matplotlib."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from qsmooth._types import FloatArray
from qsmooth._words import plural
from qsmooth.mesh import Mesh
from qsmooth.output import drawing
from qsmooth.output.drawables import Drawable, pair
from qsmooth.output.scales import ColourScale, Scale, moves_scale
from qsmooth.output.views import edge_lengths, whole_window, window_around

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# From so many cells on two nets over each other are grey.
OVERLAY_CELLS = 20_000


def plot_displacement(
    before: Drawable,
    after: Drawable | None = None,
    *,
    scale: Scale = "linear",
    title: str = "",
    ax: Axes | None = None,
    path: str | Path | None = None,
) -> Figure:
    """Draw how far vertices moved, over the mean length of their edges before.

    Parameters
    ----------
    before, after
        As in `plot_comparison`. Each cell has the colour of its corner that moved farthest.
    scale, title, ax, path
        As in `plot_mesh`.

    Returns
    -------
    matplotlib.figure.Figure

    Raises
    ------
    ImportError, ValueError
        As in `plot_comparison`.
    """
    meshes = pair(before, after)
    shares = moved_shares(*meshes)
    colours, window = moves_scale(shares, scale), whole_window(meshes[1])
    sheet = drawing.map_sheet(ax, [window], bar=True)
    _draw_moves(sheet.panels[0], meshes[1], shares, colours, window)
    colours.draw_bar(sheet.panels, sheet.bar)
    return sheet.finish(title or "How far vertices moved", _moves_words(meshes[1], shares), path)


def overlay(
    meshes: tuple[Mesh, Mesh],
    cell: int,
    names: tuple[str, str],
    scale: Scale,
    title: str,
    ax: Sequence[Axes] | None,
    path: str | Path | None,
) -> Figure:
    """Draw two meshes over each other, whole and around a cell."""
    from matplotlib.lines import Line2D

    whole = whole_window(*meshes)
    slope = float(np.clip(np.ptp(whole[:, 1]) / np.ptp(whole[:, 0]), 0.1, 4.0))
    windows = whole, window_around(meshes[0], cell, slope)
    moves = meshes[0].n_cells >= OVERLAY_CELLS
    sheet = drawing.map_sheet(ax, windows, bar=moves)
    for axes, window in zip(sheet.panels[moves:], windows[moves:], strict=True):
        drawing.draw_nets(axes, meshes, window)
    sheet.panels[0].set_title("Whole", fontsize=10)
    sheet.panels[1].set_title("Around the worst cell before", fontsize=10)
    caption = f"{drawing.size_of(meshes[0])}."
    if moves:
        shares = moved_shares(*meshes)
        colours = moves_scale(shares, scale)
        _draw_moves(sheet.panels[0], meshes[1], shares, colours, whole)
        colours.draw_bar(sheet.panels, sheet.bar)
        sheet.panels[0].set_title("How far vertices moved", fontsize=10)
        caption = _moves_words(meshes[1], shares)
    sheet.panels[1].legend(
        [
            Line2D([], [], color=colour, linewidth=2)
            for colour in (drawing.BEFORE_COLOUR, drawing.AFTER_COLOUR)
        ],
        names,
        loc="upper right",
        fontsize=8,
    )
    return sheet.finish(title or "Both meshes drawn over each other", caption, path)


def moved_shares(before: Mesh, after: Mesh) -> FloatArray:
    """How far each vertex moved over the mean of its edges before, (n_vertices,)."""
    lengths = edge_lengths(before)
    moved = np.linalg.norm(after.xy - before.xy, axis=1)
    shares: FloatArray = np.divide(moved, lengths, out=np.zeros_like(moved), where=lengths > 0.0)
    return shares


def _draw_moves(
    axes: Axes, mesh: Mesh, shares: FloatArray, colours: ColourScale, window: FloatArray
) -> None:
    values = np.maximum.reduceat(shares[mesh.cell_vertices], mesh.cell_offsets[:-1])
    drawing.draw_cells(axes, mesh, values, colours, window)


def _moves_words(mesh: Mesh, shares: FloatArray) -> str:
    n_moved = int((shares > 0.0).sum())
    text = f"{drawing.size_of(mesh)}. {plural(n_moved, 'vertex', 'vertices')} moved"
    if n_moved:
        text += f", by {np.median(shares[shares > 0.0]):.2g} in the median"
        text += f", by {shares.max():.2g} at most, vertex {int(np.argmax(shares))}"
    return f"{text}. A cell has the colour of its corner that moved farthest."
