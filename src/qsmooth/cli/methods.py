"""``qsmooth methods``: what each method is for, and the options that it has."""

from __future__ import annotations

import inspect
from typing import TYPE_CHECKING, Annotated, Any

import typer

from qsmooth.cli import files, terminal
from qsmooth.cli.options import check_names, default_words, range_words, shell_name, spell
from qsmooth.options import Spec, spelled

if TYPE_CHECKING:
    from qsmooth.methods.base import Method


def methods(
    names: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="[NAME]...",
            help="Show these with their options; out of {methods}.",
            show_default=False,
        ),
    ] = None,
    json_file: files.JsonOption = None,
    debug: files.DebugOption = False,
) -> None:
    """Say what each method is for and when to take it; by name, also its options."""
    from qsmooth import registry

    files.refuse_clash(json_file)
    known = registry.methods()
    check_names(names or (), known)
    chosen = [known[name] for name in dict.fromkeys(names or known)]
    facts = {"methods": [_facts(thing) for thing in chosen]}
    with files.Outputs() as outputs:
        if outputs.put_json(json_file, facts):
            return
        for thing in chosen:
            usual = ", the default" if thing.name == registry.choose({})[0] else ""
            terminal.write_title(f"{thing.name}{usual}")
            terminal.write_paragraph(spelled(thing.purpose, spell), indent=2)
            if names:
                _show_details(thing)
            terminal.write("")
        if not names:
            terminal.write_line(f"The options of one: qsmooth methods {next(iter(known))}")


def _show_details(thing: type[Method]) -> None:
    for paragraph in inspect.cleandoc(thing.__doc__ or "").split("\n\n"):
        terminal.write("")
        lines = paragraph.splitlines()
        if len(lines) > 1 and set(lines[1]) == {"-"}:  # the head of a section
            terminal.write_title(f"  {lines[0]}")
            lines = lines[2:]
        terminal.write_paragraph(" ".join(lines).replace("`", ""), indent=2)
    for spec in _offered(thing):
        terminal.write("")
        values = "|".join(_choices(spec)) or spec.metavar
        words = [
            range_words(spec),
            f"default: {default}" if (default := default_words(spec)) else "",
        ]
        terminal.write_title(
            "  "
            + " ".join(filter(None, [_flag(spec), values]))
            + "".join(f"; {word}" for word in words if word)
        )
        terminal.write_paragraph(spelled(spec.help, spell), indent=6)


def _facts(thing: type[Method]) -> dict[str, Any]:
    return {
        "name": thing.name,
        "title": thing.title,
        "purpose": spelled(thing.purpose, spell),
        "guarded": thing.guarded,
        "untangles": thing.untangles,
        "options": [
            {
                "name": spec.name,
                "option": f"--{shell_name(spec)}",
                "help": spelled(spec.help, spell),
                "kind": spec.kind,
                "default": None if spec.kind == "object" else spec.default,
                "range": range_words(spec) or None,
                "unit": spec.unit or None,
                "choices": _choices(spec) or None,
            }
            for spec in _offered(thing)
        ],
    }


def _offered(thing: type[Method]) -> list[Spec]:
    return [spec for spec in thing.specs().values() if spec.flag is not None]


def _flag(spec: Spec) -> str:
    name = shell_name(spec)
    return f"--{name}/--no-{name}" if spec.kind == "flag" else f"--{name}"


def _choices(spec: Spec) -> list[str]:
    return [str(choice) for choice in spec.choices if not isinstance(choice, bool)]
