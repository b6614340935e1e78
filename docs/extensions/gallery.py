"""The directives ``picture`` and ``gallery``: what ``docs/pictures.py`` draws, with its code.

Pictures are drawn while the documentation is built, into ``build/pictures``.
"""

from __future__ import annotations

import inspect
from pathlib import Path

import pictures
from docutils import nodes
from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxDirective

FOLDER = Path(__file__).resolve().parent.parent / "build" / "pictures"


class Picture(SphinxDirective):
    """One picture, by the name of the function that draws it, with its first line as caption."""

    required_arguments = 1

    def run(self) -> list[nodes.Node]:
        """Make the figure."""
        name = self.arguments[0]
        if name not in pictures.PICTURES:
            raise self.error(f"docs/pictures.py has no {name}")
        summary = (pictures.PICTURES[name].__doc__ or "").splitlines()[0]
        figure = nodes.figure()
        figure += nodes.image(uri=f"/build/pictures/{name}.png", alt=summary)
        figure += nodes.caption(text=summary)
        return [figure]


class Gallery(SphinxDirective):
    """All pictures, each under its own heading and with the code that draws it."""

    def run(self) -> list[nodes.Node]:
        """Make the sections."""
        sections: list[nodes.Node] = []
        for name, draw in pictures.PICTURES.items():
            section = nodes.section(ids=[f"picture-{name}"])
            section += nodes.title(text=name.replace("_", " ").capitalize())
            section += nodes.paragraph(text=inspect.getdoc(draw) or "")
            summary = (draw.__doc__ or "").splitlines()[0]
            section += nodes.image(uri=f"/build/pictures/{name}.png", alt=summary)
            code = inspect.getsource(draw).partition("\n")[2]
            section += nodes.literal_block(text=code.rstrip(), language="python")
            sections.append(section)
        return sections


def _draw(app: Sphinx) -> None:
    pictures.draw_all(FOLDER)


def setup(app: Sphinx) -> dict[str, bool]:
    """Draw the pictures before pages are read, and register the directives with Sphinx."""
    app.connect("builder-inited", _draw)
    app.add_directive("picture", Picture)
    app.add_directive("gallery", Gallery)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
