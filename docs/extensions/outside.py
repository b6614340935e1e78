"""CONTRIBUTING.md and CHANGELOG.md as pages, and links to them as links to these pages.

On GitHub all of their links are relative to where the files are.
"""

from __future__ import annotations

from pathlib import Path

from sphinx.application import Sphinx

LINKS = {"](../CONTRIBUTING.md": "](contributing.md", "](../CHANGELOG.md": "](changelog.md"}


def _read(app: Sphinx, name: str, content: list[str]) -> None:
    for link, page in LINKS.items():
        content[0] = content[0].replace(link, page)


def _included(app: Sphinx, path: Path, parent: str, content: list[str]) -> None:
    content[0] = content[0].replace("](docs/", "](")


def setup(app: Sphinx) -> dict[str, bool]:
    """Connect what is above."""
    app.connect("source-read", _read)
    app.connect("include-read", _included)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
