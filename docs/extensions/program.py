"""The directive ``commands``: the help of every command of the shell, as the program prints it."""

from __future__ import annotations

import contextlib
import io
import os
from unittest import mock

from docutils import nodes
from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxDirective

COLUMNS = "96"


def help_of(*words: str) -> str:
    """Run ``qsmooth WORDS --help`` in this process, and return what it prints."""
    from qsmooth.cli import run

    printed = io.StringIO()
    plain = {"COLUMNS": COLUMNS, "TERMINAL_WIDTH": COLUMNS, "NO_COLOR": "1", "TERM": "dumb"}
    with mock.patch.dict(os.environ, plain), contextlib.redirect_stdout(printed):
        code = run([*words, "--help"])
    text = "\n".join(line.rstrip() for line in printed.getvalue().splitlines()).strip("\n")
    if code or not text:
        raise RuntimeError(f"qsmooth {' '.join(words)} --help ended with {code}")
    return text


class Commands(SphinxDirective):
    """A section for each command there is."""

    def run(self) -> list[nodes.Node]:
        """Make the sections."""
        from qsmooth.cli.app import COMMANDS

        sections: list[nodes.Node] = []
        for command in sorted(COMMANDS, key=lambda command: command.name):
            section = nodes.section(ids=[f"command-{command.name}"])
            section += nodes.title(text=f"qsmooth {command.name}")
            section += nodes.literal_block(text=help_of(command.name), language="text")
            sections.append(section)
        return sections


def setup(app: Sphinx) -> dict[str, bool]:
    """Register the directive with Sphinx."""
    app.add_directive("commands", Commands)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
