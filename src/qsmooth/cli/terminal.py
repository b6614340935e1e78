"""The terminal: printing, width, colour, progress, exit codes.

Tables go to standard output, in colour on a terminal and as plain text elsewhere; progress,
warnings and errors go to standard error.
"""

from __future__ import annotations

import contextlib
import logging
import os
import signal
import sys
import textwrap
import threading
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Any, TextIO

from qsmooth.kernels import compiling

if TYPE_CHECKING:
    from qsmooth.methods.base import Method
    from qsmooth.result import SweepRecord
    from qsmooth.table import Table

PASSED, FAILED, ERROR, INTERRUPTED, BROKEN_PIPE = 0, 1, 2, 130, 141
# Texts that are laid out, as opposed to lines, are broken here where the output is no terminal.
TEXT_WIDTH = 100


class ReaderLeftError(Exception):
    """The reader of standard output left; Typer would exit with 1, which means a failed gate."""


class InterruptedRunError(Exception):
    """The user stopped a run; says what became of its result."""


def width() -> int | None:
    """Characters in a line: of the terminal, or as COLUMNS says; None where neither is there."""
    if _is_terminal(sys.stdout):
        return int(_console(sys.stdout).width)
    columns = os.environ.get("COLUMNS", "")
    return int(columns) if columns.isdecimal() and int(columns) else None


def write(text: str) -> None:
    """Print a text as it is."""
    from qsmooth.table import plain

    try:
        sys.stdout.write(plain(text, sys.stdout.encoding) + "\n")
    except BrokenPipeError as error:
        raise ReaderLeftError from error


def write_table(table: Table) -> None:
    """Print a table."""
    if _is_terminal(sys.stdout):
        from rich.measure import Measurement

        console = _console(sys.stdout)
        options = console.options.update(max_width=10_000)
        if table.left or Measurement.get(console, options, table).minimum <= console.width:
            console.print(table)
            return
    write(f"{table.text(width())}\n")  # the terminal breaks lines, where rich would cut them


def write_heading(text: str) -> None:
    """Print a heading."""
    if not _write_rich(text, "bold"):
        room = width()
        lines = [text] if room is None else textwrap.wrap(text, room, break_long_words=False)
        write("\n".join([*lines, ""]))


def write_line(text: str) -> None:
    """Print a line; where the width is known it is broken between words."""
    if not _write_rich(text):
        room = width()
        margin = " " * (len(text) - len(text.lstrip()))
        lines = (
            [text]
            if room is None
            else textwrap.wrap(
                text, room, subsequent_indent=margin, break_long_words=False, break_on_hyphens=False
            )
        )
        write("\n".join(lines))


def write_paragraph(text: str, indent: int = 0) -> None:
    """Print a text broken into lines."""
    margin = indent * " "
    room = min(width() or TEXT_WIDTH, TEXT_WIDTH)
    lines = textwrap.wrap(
        text, room, initial_indent=margin, subsequent_indent=margin, break_on_hyphens=False
    )
    write("\n".join(lines))


def write_title(text: str) -> None:
    """Print the title of a text that follows."""
    if not _write_rich(text, "bold"):
        write(text)


def write_command(text: str, aside: bool) -> None:
    """Print a line for a program that follows what is printed; `aside` on standard error."""
    if aside:
        with contextlib.suppress(OSError, ValueError):
            sys.stderr.write(f"{text}\n")
    else:
        write(text)


def say(text: str) -> None:
    """Print one line on standard error."""
    line = "qsmooth: " + " ".join(str(text).split())
    encoding = getattr(sys.stderr, "encoding", None) or "utf-8"
    with contextlib.suppress(OSError, ValueError):
        sys.stderr.write(line.encode(encoding, "replace").decode(encoding) + "\n")
        sys.stderr.flush()


class _Saying(logging.Handler):
    def emit(self, record: logging.LogRecord) -> None:
        if record.msg != compiling.MESSAGE:
            say(f"warning: {record.getMessage()}")
        elif _is_terminal(sys.stderr):
            say(record.getMessage())


@contextlib.contextmanager
def told_of_compiling() -> Iterator[None]:
    """Say what is logged; only on a terminal that kernels compile, which happens once."""
    logger, handler = logging.getLogger("qsmooth"), _Saying()
    logger.addHandler(handler)
    try:
        yield
    finally:
        logger.removeHandler(handler)


@contextlib.contextmanager
def status(text: str) -> Iterator[None]:
    """Say on a terminal what is going on."""
    if not _is_terminal(sys.stderr):
        yield
        return
    with _console(sys.stderr).status(text):
        yield


@contextlib.contextmanager
def progress(method: Method, part: str = "") -> Iterator[Callable[[SweepRecord], None] | None]:
    """Show on a terminal a bar of the sweeps; gives what a method calls with each record.

    `part` says which of several runs it is: "2 of 7".
    """
    if not _is_terminal(sys.stderr):
        yield None
        return
    from qsmooth.bars import bar, counted

    name = f"{method.name} ({part})" if part else method.name
    with bar(_console(sys.stderr), name) as show:
        yield counted(method, show)


class Interrupt:
    """Whether the user has asked to stop."""

    asked = False


@contextlib.contextmanager
def held_interrupt(wanted: bool) -> Iterator[Interrupt]:
    """Note the first Ctrl-C inside the block, if wanted; the second interrupts as ever."""
    interrupt = Interrupt()
    if not wanted or threading.current_thread() is not threading.main_thread():
        yield interrupt
        return
    before = signal.getsignal(signal.SIGINT)

    def note(_signal: int, _frame: object) -> None:
        interrupt.asked = True
        signal.signal(signal.SIGINT, signal.default_int_handler)

    signal.signal(signal.SIGINT, note)
    try:
        yield interrupt
    finally:
        signal.signal(signal.SIGINT, before)


def _write_rich(text: str, style: str = "") -> bool:
    """Print on a terminal; False where there is none."""
    if not _is_terminal(sys.stdout):
        return False
    from rich.text import Text

    _console(sys.stdout).print(Text(text, style=style))
    return True


def _console(stream: TextIO) -> Any:
    from rich.console import Console

    return Console(file=stream, highlight=False)


def _is_terminal(stream: TextIO) -> bool:
    try:
        return stream.isatty()
    except (AttributeError, ValueError):
        return False
