"""Help as plain text: a line for each option, what it does beside or below, no line too long."""

from __future__ import annotations

import enum
import inspect
import re
import shutil
import sys
import textwrap
from typing import Any

from typer.core import TyperCommand, TyperGroup

from qsmooth.table import plain

WIDEST, NARROWEST = 100, 30
# Where texts begin: beside names that end before, in terminals that are wide enough for that.
BESIDE, BELOW, WIDE_ENOUGH = 24, 6, 60
_MARKUP = re.compile(r"(?<!\\)\[/?(?:b|dim)\]")


class HelpfulCommand(TyperCommand):
    """A command whose help is laid out by `help_text`."""

    def format_help(self, ctx: Any, formatter: Any) -> None:
        """Write the help."""
        formatter.write(help_text(self, ctx))


class HelpfulGroup(TyperGroup):
    """The commands together, whose help is laid out by `help_text`."""

    def format_help(self, ctx: Any, formatter: Any) -> None:
        """Write the help."""
        formatter.write(help_text(self, ctx))


def help_text(command: Any, context: Any) -> str:
    """Lay out the help of a command: usage, what it does, then its options by group."""
    width = max(NARROWEST, min(shutil.get_terminal_size().columns, WIDEST))
    usage = f"Usage: {context.command_path} {' '.join(_pieces(command, context))}"
    out = [_wrapped(usage, width, 0, " " * 7), ""]
    for paragraph in inspect.cleandoc(command.help or "").split("\n\n"):
        out += [_wrapped(_bare(paragraph), width), ""]
    for title, entries in _groups(command, context).items():
        out.append(_wrapped(f"{title}:", width))
        out += [_entry(head, text, width) for head, text in entries]
        out.append("")
    return plain("\n".join(out), getattr(sys.stdout, "encoding", None))


def _pieces(command: Any, context: Any) -> list[str]:
    arguments = [p for p in command.get_params(context) if p.param_type_name == "argument"]
    if hasattr(command, "commands"):
        return ["[OPTIONS]", "COMMAND", "[ARGS]..."]
    needed = [p for p in command.get_params(context) if p.required and p not in arguments]
    options = [f"{max(p.opts, key=len)} {_value(p)}" for p in needed]
    return [*map(_value, arguments), *options, "[OPTIONS]"]


def _groups(command: Any, context: Any) -> dict[str, list[tuple[str, str]]]:
    """Heads and texts by the title of their group; what all commands have comes last."""
    groups: dict[str, list[tuple[str, str]]] = {}
    for name, child in getattr(command, "commands", {}).items():
        groups.setdefault("Commands", []).append((name, _bare(child.get_short_help_str(300))))
    common: list[tuple[str, str]] = []
    for param in command.get_params(context):
        argument = param.param_type_name == "argument"
        head = _value(param) if argument else _head(param)
        entry = head, _text(param)
        panel = "Arguments" if argument else getattr(param, "rich_help_panel", None)
        (groups.setdefault(panel, []) if panel else common).append(entry)
    return groups | ({"Options": common} if common else {})


def _head(param: Any) -> str:
    names = [*sorted(param.opts, key=lambda name: not name.startswith("--")), *param.secondary_opts]
    value = "" if param.is_flag else f" {_value(param)}"
    return f"{', '.join(names)}{value}"


def _value(param: Any) -> str:
    """What stands for the value of an option or argument."""
    return str(param.metavar or "VALUE")


def _text(param: Any) -> str:
    """What it is for, and its default."""
    text = _bare(param.help or "")
    if param.required and param.param_type_name == "option":
        return f"{text} Needed."
    default = param.default
    if isinstance(default, enum.Enum):
        default = default.value
    shown = param.show_default and not param.is_eager and default not in (None, False, (), [])
    return f"{text}  [default: {default}]" if shown and not callable(default) else text


def _bare(text: str) -> str:
    """Take the markup out of a text."""
    return _MARKUP.sub("", text).replace("\\[", "[").replace("\\\\", "\\")


def _entry(head: str, text: str, width: int) -> str:
    margin = BESIDE if width >= WIDE_ENOUGH else BELOW
    lines = _wrapped(text, width, margin)
    if margin == BESIDE and len(head) + 4 <= margin:
        return f"  {head}".ljust(margin) + lines[margin:]
    heads = _wrapped(_breakable(head), width, 2, " " * 4)
    return f"{heads}\n{lines}" if lines else heads


def _breakable(head: str) -> str:
    """Let a long list of choices break behind its bars."""
    return head.replace("|", "| ") if len(head) > 40 else head


def _wrapped(text: str, width: int, indent: int = 0, hanging: str | None = None) -> str:
    margin = indent * " "
    return "\n".join(
        textwrap.wrap(
            " ".join(text.split()),
            width,
            initial_indent=margin,
            subsequent_indent=margin if hanging is None else hanging,
            break_on_hyphens=False,
        )
    )
