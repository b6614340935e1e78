"""The way into the command line: its commands, its exit codes, its errors in one line each.

Numba, meshio and matplotlib are loaded inside the commands, so that ``--help`` answers at once.
"""

from __future__ import annotations

import contextlib
import gc
import os
import sys
import traceback
import warnings
from collections.abc import Collection, Iterable, Sequence
from typing import TYPE_CHECKING, Annotated, Any, NoReturn

import typer

from qsmooth import __version__
from qsmooth.cli import ranks, terminal
from qsmooth.cli.compare import compare
from qsmooth.cli.convert import convert
from qsmooth.cli.demo import demo
from qsmooth.cli.files import DebugOption
from qsmooth.cli.formats import formats
from qsmooth.cli.help import HelpfulCommand, HelpfulGroup
from qsmooth.cli.info import info
from qsmooth.cli.methods import methods
from qsmooth.cli.options import Command, with_options
from qsmooth.cli.paper import paper
from qsmooth.cli.quality import quality
from qsmooth.cli.report import report
from qsmooth.cli.smooth import smooth
from qsmooth.cli.untangle import untangle
from qsmooth.cli.warmup import warmup
from qsmooth.errors import MeshWarning

if TYPE_CHECKING:
    from qsmooth.methods.base import Method


def _listed() -> Iterable[type[Method]]:
    from qsmooth.registry import methods

    return methods().values()


def _untangling() -> Iterable[type[Method]]:
    from qsmooth.registry import all_methods

    return [all_methods()["untangle"]]


COMMANDS = (
    Command(smooth, _listed),
    Command(untangle, _untangling),
    Command(quality),
    Command(compare, _listed),
    Command(report, _listed),
    Command(info),
    Command(convert),
    Command(formats),
    Command(methods),
    Command(demo, _listed, only=("max_sweeps",)),
    Command(paper),
    Command(warmup),
)


# New objects before garbage is looked for. Modules and cached kernels make some 200,000, all of
# which stay; by Python's own threshold going through them over and over is a tenth of a short call.
OBJECTS = 300_000


def main(arguments: Sequence[str] | None = None) -> NoReturn:
    """Run the command line and leave the interpreter with its exit code."""
    arguments = list(sys.argv[1:] if arguments is None else arguments)
    gc.set_threshold(OBJECTS)
    if ranks.started_by_mpi():
        sys.exit(ranks.run(lambda: run(arguments)))
    sys.exit(run(arguments))


def run(arguments: Sequence[str]) -> int:
    """Run the command line; every error becomes one line on standard error and a code.

    Returns
    -------
    int
        0 success, 1 a quality gate failed or cells stay invalid, 2 an error, 130 interrupted.
    """
    debug = "--debug" in arguments or os.environ.get("QSMOOTH_DEBUG", "0") not in ("", "0")
    with warnings.catch_warnings(), terminal.told_of_compiling():
        warnings.simplefilter("always", MeshWarning)
        show = warnings.showwarning

        def show_in_one_line(
            message: Warning | str, category: type[Warning], *where: Any, **more: Any
        ) -> None:
            if issubclass(category, MeshWarning):
                terminal.say(f"warning: {message}")
            else:
                show(message, category, *where, **more)

        warnings.showwarning = show_in_one_line
        try:
            app = make_app(arguments)
            code = app(args=list(arguments), prog_name="qsmooth", standalone_mode=False)
            sys.stdout.flush()
        except KeyboardInterrupt:
            code = terminal.INTERRUPTED
        except terminal.InterruptedRunError as error:
            terminal.say(str(error))
            return terminal.INTERRUPTED
        except typer.Abort:
            code = terminal.INTERRUPTED
        except (terminal.ReaderLeftError, BrokenPipeError):
            # Whoever read the output has left; nothing more can be said to him.
            with contextlib.suppress(OSError, ValueError):
                os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
            return terminal.BROKEN_PIPE
        except Exception as error:
            if debug:
                traceback.print_exc()
            terminal.say(f"error: {_in_words(error)}")
            return terminal.ERROR
    if code == terminal.INTERRUPTED:
        terminal.say("interrupted")
    return int(code or terminal.PASSED)


def make_app(called: Collection[str] = ()) -> typer.Typer:
    """Put the commands together; those that may be called, by name, with their made options."""
    app = typer.Typer(
        name="qsmooth",
        cls=HelpfulGroup,
        add_completion=False,
        pretty_exceptions_enable=False,
        rich_markup_mode="rich",
        context_settings={"help_option_names": ["--help", "-h"]},
    )
    app.callback(invoke_without_command=True)(_root)
    for command in COMMANDS:
        app.command(cls=HelpfulCommand)(with_options(command, made=command.name in called))
    return app


def _version(wanted: bool) -> None:
    if wanted:
        terminal.write(f"qsmooth {__version__}")
        raise typer.Exit


def _root(
    context: typer.Context,
    version: Annotated[
        bool,
        typer.Option("--version", callback=_version, is_eager=True, help="Show the version."),
    ] = False,
    debug: DebugOption = False,
) -> None:
    """Make 2D quadrilateral, triangle and mixed meshes better by moving their vertices.

    Start with [b]qsmooth demo[/b], which needs no file.
    """
    if context.invoked_subcommand is None:
        text = context.get_help()
        if text:
            terminal.write(text)


def _in_words(error: Exception) -> str:
    """Say in one line what went wrong."""
    from qsmooth.cli.options import spell
    from qsmooth.options import OptionError, spelled

    if hasattr(error, "format_message"):  # what Typer makes of a wrong command line
        return str(error.format_message())
    if isinstance(error, OptionError):
        return spelled(error.text, spell)
    if isinstance(error, (ImportError, ValueError)):
        return str(error)
    if isinstance(error, OSError) and error.strerror:
        return f"{error.strerror}: '{error.filename}'" if error.filename else error.strerror
    if isinstance(error, MemoryError):
        return "there is not enough memory for this mesh"
    return f"{type(error).__name__}: {error}; --debug shows where"
