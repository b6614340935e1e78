"""``qsmooth warmup``: compile ahead of the first use."""

from __future__ import annotations

import time
from typing import Annotated

import typer

from qsmooth._words import plural
from qsmooth.cli import files, terminal
from qsmooth.cli.options import check_names


def warmup(
    names: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="[NAME]...",
            help="Compile what these methods need; out of {methods}. By default all.",
            show_default=False,
        ),
    ] = None,
    session: Annotated[
        bool, typer.Option("--session", help="Also what steps of a qsmooth.Smoother need.")
    ] = False,
    slide: Annotated[
        bool, typer.Option("--slide", help="Also what sliding along boundary and interfaces needs.")
    ] = False,
    interpolate: Annotated[
        bool,
        typer.Option(
            "--interpolate", help="Also what interpolates depths and point data at new places."
        ),
    ] = False,
    debug: files.DebugOption = False,
) -> None:
    """Compile what methods need, so that the first mesh need not wait for it.

    It is kept on disk. Useful after installing or upgrading, as in the recipe of a container.
    """
    from qsmooth.registry import methods
    from qsmooth.table import time_text
    from qsmooth.warming import warmup

    check_names(names or (), ["auto", *methods()])
    started = time.perf_counter()
    asked = {"session": session, "slide": slide, "interpolate": interpolate}
    count = warmup(names, **{name: True for name, wanted in asked.items() if wanted})
    if count:
        taken = time_text(time.perf_counter() - started)
        terminal.write_line(f"Compiled {plural(count, 'kernel')} in {taken}")
    else:
        terminal.write_line("Everything was compiled already")
