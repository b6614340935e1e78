"""What notebooks show of a mesh and its quality: a small table, and a small picture."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape

import numpy as np

from qsmooth._types import BoolArray, FloatArray, IndexArray
from qsmooth.table import Table

# At most so many cells, and edges of the boundary, are drawn: a sample of more.
MOST_CELLS, MOST_EDGES = 900, 1200
# The longer side, in the unit of the drawing, to which all places are rounded; and in pixels.
UNITS, PIXELS = 600, 240
# Cells with a figure from 0 to 1 below these have these colours, the others the last one.
CLASSES = (0.0, 0.2, 0.4, 0.6)
COLOURS = "#b2182b", "#ef8a62", "#fddbc7", "#d1e5f0", "#a6cee3"
PLAIN = "#d1e5f0"

_CELL = "text-align:{};padding:1px 8px"


def page(title: str, table: Table | None = None, pictures: Sequence[str] = ()) -> str:
    """Put a line of text, pictures and a table together as HTML."""
    parts = [f"<div><b>{escape(title)}</b></div>"]
    if pictures:
        parts.append(f'<div style="display:flex;gap:16px">{"".join(pictures)}</div>')
    if table is not None:
        parts.append(_table(table))
    return f'<div class="qsmooth">{"".join(parts)}</div>'


def thumbnail(
    xy: FloatArray,
    cells: tuple[IndexArray, IndexArray],
    twins: IndexArray,
    worth: FloatArray | None,
) -> str:
    """Draw a mesh as SVG, of less than 50 kB whatever its size.

    Parameters
    ----------
    xy : (n_vertices, 2)
        Coordinates; what is not finite is left out.
    cells
        Offsets, and corners in the order of the offsets.
    twins : (n_corners,)
        Negative where the edge from this corner to the next of its cell is on the boundary.
    worth : (n_cells,) or None
        A figure for each cell that says its colour, 1 for the best, 0 and below for cells that
        are not valid. Where not all cells are drawn the worst are.
    """
    offsets, vertices = cells
    places, width, height = _on_paper(xy, vertices)
    known = np.isfinite(xy[:, 0]) & np.isfinite(xy[:, 1])
    # A cell is known where all its corners are.
    whole: BoolArray = np.logical_and.reduceat(known[vertices], offsets[:-1])
    drawn, n_worst = _sample(whole, worth)
    # Each of a sample stands for its surroundings, which it covers; the worst are drawn on it.
    grow = max(1.0, np.count_nonzero(whole) / max(1, len(drawn))) ** 0.5
    line = ' stroke="#555" stroke-linejoin="round"' if grow == 1.0 else ""
    classes = np.zeros(len(drawn), np.int64)
    colours: Sequence[str] = (PLAIN,)
    if worth is not None:
        classes, colours = np.searchsorted(CLASSES, worth[drawn], side="right"), COLOURS
    paths = []
    for layer in (slice(n_worst, None), slice(n_worst)):
        growth = grow if layer.start is not None else max(1.0, 0.5 * grow)
        for k in reversed(range(len(colours))):  # the worst on top
            outlines = [
                _outline(places[vertices[offsets[c] : offsets[c + 1]]], growth)
                for c in drawn[layer][classes[layer] == k]
            ]
            if outlines:
                paths.append(f'<path d="{"".join(outlines)}" fill="{colours[k]}"{line}/>')
    edges = _boundary(places, offsets, vertices, (twins < 0) & np.repeat(whole, np.diff(offsets)))
    paths.append(f'<path d="{edges}" fill="none" stroke="#000" stroke-width="2"/>')
    scale = PIXELS / UNITS
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{scale * width:.0f}" '
        f'height="{scale * height:.0f}" viewBox="-2 -2 {width + 4} {height + 4}">'
        f"{''.join(paths)}</svg>"
    )


def _on_paper(xy: FloatArray, vertices: IndexArray) -> tuple[FloatArray, int, int]:
    """Coordinates from 0 to `UNITS`, y downwards, (n_vertices, 2); width and height."""
    used = xy[vertices]
    used = used[np.isfinite(used).all(axis=1)]
    low = used.min(axis=0) if len(used) else np.zeros(2)
    span = np.ptp(used, axis=0) if len(used) else np.ones(2)
    scale = UNITS / (float(span.max()) or 1.0)
    width, height = (max(1, round(side * scale)) for side in span.tolist())
    # What is not finite, and orphans far outside, are in no cell that is drawn.
    places = np.clip(np.nan_to_num((xy - low) * scale), 0.0, UNITS)
    places[:, 1] = height - places[:, 1]
    return places, width, height


def _sample(whole: BoolArray, worth: FloatArray | None) -> tuple[IndexArray, int]:
    """Cells to draw: all, or so many of the worst, the count of which is given, and others."""
    found = np.flatnonzero(whole)
    if len(found) <= MOST_CELLS:
        return found, 0
    n_worst = 0 if worth is None else MOST_CELLS // 3
    # At random, as every so-manieth of a grid is a pattern of its own; always the same ones.
    spread = np.random.default_rng(0).choice(found, MOST_CELLS - n_worst, replace=False)
    if worth is None:
        return spread, 0
    worst = found[np.argpartition(worth[found], n_worst)[:n_worst]]
    return np.concatenate([worst, spread]), n_worst


def _outline(corners: FloatArray, growth: float) -> str:
    """A closed path, its steps relative, which is shorter; grown from its middle."""
    middle = corners.mean(axis=0)
    dots = np.rint(middle + growth * (corners - middle)).astype(np.int64)
    (x, y), steps = dots[0].tolist(), np.diff(dots, axis=0).tolist()
    return f"M{x} {y}l{' '.join(f'{dx} {dy}' for dx, dy in steps)}z"


def _boundary(
    places: FloatArray, offsets: IndexArray, vertices: IndexArray, outside: BoolArray
) -> str:
    """Paths along the boundary; edges that are no longer than a dot are joined by the dot."""
    after = np.arange(1, len(vertices) + 1)
    after[offsets[1:] - 1] = offsets[:-1]
    dots = np.rint(places).astype(np.int64)
    ends = np.concatenate([dots[vertices[outside]], dots[vertices[after[outside]]]], axis=1)
    ends[:, 2:] -= ends[:, :2]
    ends = np.unique(ends[ends[:, 2:].any(axis=1)], axis=0)
    if len(ends) > MOST_EDGES:
        ends = ends[np.linspace(0, len(ends) - 1, MOST_EDGES).astype(np.int64)]
    return "".join(f"M{x} {y}l{dx} {dy}" for x, y, dx, dy in ends.tolist())


def _table(table: Table) -> str:
    rows = []
    if any(table.columns):
        heads = "".join(_cell("th", name, "right") for name in table.columns)
        rows.append(f"<tr>{_cell('th', table.corner, 'left')}{heads}</tr>")
    for section in table.sections:
        if section.title:
            rows.append(f"<tr>{_cell('th', section.title, 'left')}</tr>")
        for row in section.rows:
            texts = "".join(_cell("td", text, "right") for text in row.cells)
            rows.append(f"<tr>{_cell('td', row.label, 'left')}{texts}</tr>")
    note = f"<div>{escape(table.note)}</div>" if table.note else ""
    return f"<table>{''.join(rows)}</table>{note}"


def _cell(tag: str, text: str, side: str) -> str:
    return f'<{tag} style="{_CELL.format(side)}">{escape(text)}</{tag}>'
