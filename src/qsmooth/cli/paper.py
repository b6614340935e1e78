"""``qsmooth paper``: the seed paper's table and figures, beside its own numbers."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from qsmooth.cli import files, terminal

if TYPE_CHECKING:
    from qsmooth.paper import PaperFigure


def paper(
    output: Annotated[
        Path,
        typer.Option("--output", "-o", metavar="FOLDER", help="Where to put page and figures."),
    ] = Path("qsmooth-paper"),
    figure: Annotated[
        list[int] | None,
        typer.Option(
            metavar="NUMBER",
            help="Draw this figure of the paper alone, 13 or 16 to 22; may be repeated.",
        ),
    ] = None,
    debug: files.DebugOption = False,
) -> None:
    """Make the figures of the paper "Quadrilateral Mesh Smoothing" again.

    From the packaged spiral and lake: its figures 13 and 16 to 22, as PNG and SVG, and a page that
    puts its numbers beside ours and says where ours differ and why. Look at FOLDER/index.html.
    """
    if output.exists() and not output.is_dir():
        raise ValueError(f"'{output}' is a file; --output takes a folder")
    chosen = _chosen(figure)
    from qsmooth.output.drawing import require_matplotlib

    require_matplotlib()
    from qsmooth.io import write_mesh
    from qsmooth.paper import draw, run, write_page
    from qsmooth.paper.drawing import BY_SWEEP, draw_by_sweep, save_both

    with terminal.status("smoothing"):
        runs = run()
    output.mkdir(parents=True, exist_ok=True)
    n_files = 0
    with terminal.status("drawing"):
        for each in chosen:
            n_files += len(save_both(draw(each, runs), output, each.name))
        if figure is None:
            n_files += len(save_both(draw_by_sweep(runs), output, BY_SWEEP))
    terminal.write_line(f"Wrote {n_files} files of figures into {output}")
    if figure is None:
        for name, mesh in runs.meshes.items():
            write_mesh(output / f"{name}.off", mesh)
        pages = write_page(runs.found, output)
        terminal.write_line(f"Look first at {pages[0]}")


def _chosen(numbers: list[int] | None) -> list[PaperFigure]:
    """Look up figures by their numbers."""
    from qsmooth.paper import FIGURES

    known = {figure.number: figure for figure in FIGURES}
    for number in numbers or ():
        if number not in known:
            raise ValueError(f"--figure takes one of {', '.join(map(str, known))}, got {number}")
    return [known[number] for number in dict.fromkeys(numbers)] if numbers else list(FIGURES)
