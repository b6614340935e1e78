"""How far a run is, shown while it runs: a bar on a terminal or in a notebook, else a line."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import TYPE_CHECKING, Any, TypeAlias

from qsmooth.result import SweepRecord

if TYPE_CHECKING:
    from qsmooth.methods.base import Method

# From so many characters on there is room for the angles, too.
WIDE = 100

# Called with a record, the sweeps so far, and the most that there can be, None where it is not
# known what a run will take.
Shown: TypeAlias = Callable[[SweepRecord, int, int | None], object]


@contextmanager
def watched(method: Method, progress: bool | Shown | None) -> Iterator[Method]:
    """Have a method show how far it is: True for a bar or a line, or a function; else nothing.

    Gives the method with a callback that does it, and then calls the method's own.
    """
    if progress is None or progress is False:
        yield method
    elif progress is not True and not callable(progress):
        raise TypeError(f"progress must be True, False or a function, got {progress!r}")
    elif callable(progress):
        yield _with(method, progress)
    else:
        from rich.console import Console

        console = Console(file=sys.stderr, highlight=False)
        if console.is_terminal or console.is_jupyter:
            with bar(console, method.name) as show:
                yield _with(method, show)
        else:
            with _line(method.name) as show:
                yield _with(method, show)


@contextmanager
def bar(console: Any, name: str) -> Iterator[Shown]:
    """Show a bar on a console of rich; it pulses where it is not known how many sweeps come.

    Where it is, it also says how long they will take; a method that rests may stop before.
    """
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    texts = ["{task.fields[done]}", "{task.fields[left]}"]
    texts += ["{task.fields[state]}"] if console.width >= WIDE else []
    columns = (
        TextColumn("{task.fields[method]}"),
        BarColumn(bar_width=None),
        TimeElapsedColumn(),
        *map(TextColumn, texts),
    )
    first: tuple[float, int] | None = None
    with Progress(*columns, console=console, transient=True, expand=True) as progress:
        task = progress.add_task("", total=None, method=name, done="", left="", state="")

        def show(record: SweepRecord, done: int, total: int | None) -> None:
            nonlocal first
            now = time.monotonic()
            first = first or (now, done)  # whatever is compiled is compiled by then
            text = f"about {done} sweeps" if total is None else f"{done} of {total} sweeps"
            left = "" if total is None else left_text(now - first[0], done - first[1], total - done)
            progress.update(
                task, total=total, completed=done, done=text, left=left, state=_state(record)
            )

        yield show


def left_text(seconds: float, sweeps: int, to_come: int) -> str:
    """Say how long the sweeps to come will take, from the time that some have taken; or nothing."""
    if sweeps <= 0:
        return ""
    left = round(seconds / sweeps * to_come)
    minutes, rest = divmod(left, 60)
    return f"{minutes}:{rest:02d} min left" if minutes else f"{left} s left"


@contextmanager
def _line(name: str) -> Iterator[Shown]:
    """Print a line in the end."""
    last = ""

    def show(record: SweepRecord, done: int, total: int | None) -> None:
        nonlocal last
        last = f"qsmooth: {name}, {done} sweeps, {_state(record)}\n"

    try:
        yield show
    finally:
        sys.stderr.write(last)
        sys.stderr.flush()


def counted(method: Method, show: Shown) -> Callable[[SweepRecord], None]:
    """Make of a function that shows one that counts sweeps by the records.

    Where a record is of several sweeps their count is about right; and such a method stops by
    itself long before the last.
    """
    each = method.sweeps_a_record
    total = method.max_sweeps if each == 1 else None
    done = 0

    def tell(record: SweepRecord) -> None:
        nonlocal done
        done += each
        show(record, done, total)

    return tell


def _with(method: Method, show: Shown) -> Method:
    """Let the method show each record before it calls back."""
    tell, own = counted(method, show), method.callback

    def callback(record: SweepRecord) -> object:
        tell(record)
        return None if own is None else own(record)

    return replace(method, callback=callback)


def _state(record: SweepRecord) -> str:
    text = f"angles {record.min_angle:.1f}° to {record.max_angle:.1f}°"
    if record.n_invalid:
        text += f", {record.n_invalid} cells not valid"
    return text
