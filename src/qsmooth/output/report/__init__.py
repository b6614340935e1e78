"""Reports to look at: one HTML file that holds meshes, figures and all that shows them."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

from qsmooth.adapters import as_mesh
from qsmooth.metrics import parse_metrics
from qsmooth.output.report.content import Content
from qsmooth.output.report.page import html
from qsmooth.output.report.states import State, of_mesh, states_of

__all__ = ["State", "of_mesh", "report", "states_of", "write_report"]


def report(
    result: Any, path: str | os.PathLike[str], *, title: str = "", metrics: Any = None
) -> Path:
    """Write a report to look at, as one HTML file that needs no network.

    It shows the mesh before and after side by side, cells coloured by any of the metrics, the worst
    cells with what holds each, histograms, convergence, sizes, and what was promised and traded.

    Parameters
    ----------
    result
        A `SmoothResult`; several of the same mesh, as a sequence, a dict by name, or as `compare`
        gives them; or a mesh, of which the report has the quality alone.
    path
        The file, which is replaced where there is one.
    title
        What stands above; by default the name of the mesh's file, or what it consists of.
    metrics
        What cells are coloured by: names, in a sequence or with commas between, or ``"all"``; by
        default the short list. Areas are there in any case.

    Returns
    -------
    Path
        The file.

    Raises
    ------
    ValueError
        No result, results of different meshes, or a name that is no metric.
    MeshError
        If it cannot be written.
    """
    from qsmooth.result import SmoothResult

    skipped: dict[str, str] = {}
    if isinstance(result, tuple) and len(result) == 2 and all(isinstance(r, dict) for r in result):
        result, skipped = result  # of `compare`
    if isinstance(result, SmoothResult):
        states = states_of([result])
    elif isinstance(result, dict):
        states = states_of(list(result.values()), list(result))
    elif isinstance(result, (list, tuple)) and all(isinstance(r, SmoothResult) for r in result):
        states = states_of(result)
    else:
        states = [of_mesh("mesh", "Mesh", as_mesh(result))]
    notes = [f"{name}: skipped; {why}." for name, why in skipped.items()]
    return write_report(states, Path(path), title=title, metrics=metrics, notes=notes)


def write_report(
    states: list[State],
    path: Path,
    *,
    title: str = "",
    metrics: Any = None,
    notes: list[str] | None = None,
    spell: Any = str,
) -> Path:
    """Write a report of states of one mesh, the first before all others.

    Parameters
    ----------
    notes
        Sentences under the table.
    spell
        How an option is written, as in `wording.reason`.
    """
    from qsmooth.io.files import write_bytes

    content = Content(states, title, parse_metrics(metrics), notes or [], spell)
    write_bytes(path, html(content.facts, content.packed))
    return path
