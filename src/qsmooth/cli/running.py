"""Running methods: which one with which options, with progress, and what to say of the result."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from qsmooth._words import did_you_mean, in_a_row, plural
from qsmooth.cli import ranks
from qsmooth.cli.options import spell
from qsmooth.cli.terminal import InterruptedRunError, held_interrupt, progress, write_line

if TYPE_CHECKING:
    from pathlib import Path

    from qsmooth.mesh import Mesh
    from qsmooth.methods.base import Method
    from qsmooth.metrics import Limits
    from qsmooth.result import SmoothResult, SweepRecord


def method_with(name: str, options: Mapping[str, Any]) -> tuple[Method, str]:
    """Make a method by its name or ``"auto"``; also why that was chosen, for the outcome.

    Raises
    ------
    ValueError
        If there is no such method, a value is out of range, or the method lacks an option.
    """
    from qsmooth.registry import choose, method_class, methods

    why = auto = ""
    if name == "auto":
        name, why = choose(options)
        auto = f" (auto chose {name})"
    known = method_class(name)
    for option, value in options.items():
        if option not in known.specs():
            having = [thing for thing in methods().values() if option in thing.specs()]
            having[0].specs()[option].checked(value)
            near = did_you_mean(option, known.specs(), spell)
            raise ValueError(
                f"{known.owner} has no option {spell(option)}{auto}, it is of "
                f"{in_a_row([thing.name for thing in having])}{near}"
            )
    return known.of(dict(options)), why


def run(mesh: Mesh, method: Method, *, part: str = "") -> SmoothResult:
    """Smooth a mesh, and show how far it is; as the second of seven, say."""
    with progress(method, part) as callback:
        return ranks.smooth(replace(method, callback=callback), mesh)


def run_to_end(
    mesh: Mesh, method: Method, output: Path, why: str = "", *, format: str | None, keep: bool
) -> SmoothResult:
    """Smooth a mesh; of a run that is interrupted write, if it is to be kept, the best so far.

    Raises
    ------
    InterruptedRunError
        After that. A file that is there already is left as it was.
    """
    with held_interrupt(keep) as interrupt, progress(method) as shown:

        def callback(record: SweepRecord) -> bool:
            if shown is not None:
                shown(record)
            return interrupt.asked

        result = ranks.smooth(replace(method, callback=callback), mesh, why)
    if not interrupt.asked:
        return result
    if output.exists():
        raise InterruptedRunError(f"interrupted, '{output}' is left as it was")
    from qsmooth.io import write_mesh

    write_mesh(output, result.mesh, format=format)
    raise InterruptedRunError(f"interrupted, wrote the best so far, {output}")


def limits_of(before: Mesh, result: SmoothResult, method: Method) -> Limits:
    """Bounds of the angles of a result."""
    from qsmooth import sliding
    from qsmooth.metrics import Limits

    known = result.outcome.limits
    if isinstance(known, Limits):
        return known
    return sliding.limits_of(method.freedom(before), before, result.mesh)


def show_outcome(result: SmoothResult) -> None:
    """Say what was done and why it stopped; limits of the angles are left to `show_limits`."""
    from qsmooth import wording
    from qsmooth.output import tables
    from qsmooth.table import time_text

    text = (
        f"{tables.method_title(result.method)}: {plural(result.sweeps, 'sweep')} in "
        f"{time_text(result.seconds)}"
    )
    reason = wording.reason(result.outcome, spell=spell, limits=False)
    write_line(f"{text}; {reason}." if reason else f"{text}.")


def show_limits(limits: Limits) -> None:
    """Say how near to their bounds the angles are, in lines of their own."""
    for line in str(limits).splitlines():
        write_line(f"  {line[0].upper()}{line[1:]}.")
