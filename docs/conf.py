"""Settings of the documentation; CONTRIBUTING.md has the command that builds it.

Nothing is fetched: there are no references to other projects' indices, formulas are MathML, and
the theme brings its own files.
"""

from __future__ import annotations

import sys
from pathlib import Path

from docutils import nodes
from sphinx.application import Sphinx

import qsmooth

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE), str(HERE / "extensions")]

project = "qsmooth"
author = "the authors of qsmooth"
copyright = "the authors of qsmooth"
version = release = qsmooth.__version__

extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "mathml",
    "program",
    "gallery",
    "outside",
]
exclude_patterns = ["build"]

myst_enable_extensions = ["dollarmath"]
myst_heading_anchors = 4  # as on GitHub, so that links to headings work in both

html_theme = "furo"
html_title = f"qsmooth {version}"
html_math_renderer = "mathml"
html_copy_source = False

# Docstrings: types stand in signatures; single backticks name what is near, not always an object.
autodoc_typehints_format = "short"
autodoc_member_order = "bysource"
autodoc_preserve_defaults = True
napoleon_google_docstring = False
napoleon_use_rtype = False
napoleon_use_ivar = True
default_role = "literal"

nitpicky = True


def leave_other_projects(
    app: Sphinx, env: object, node: nodes.Element, contents: nodes.TextElement
) -> nodes.TextElement | None:
    """Leave the types of signatures that are not documented here as text, as there is no network.

    Links between pages have to be found.
    """
    of_signature = node.get("refdomain") == "py" and node.get("reftype") in ("class", "obj", "exc")
    return contents if of_signature else None


def setup(app: Sphinx) -> None:
    """Connect what is above."""
    app.connect("missing-reference", leave_other_projects)
