"""The page: a template of HTML, filled."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from html import escape
from importlib.resources import files
from typing import Any

from qsmooth._json import finite
from qsmooth.output.report.packing import Packed

PLACES = re.compile(rb"<!--TITLE-->|/\*STYLE\*/|/\*SCRIPT\*/|/\*DATA\*/|<!--ARRAYS-->")


def html(facts: dict[str, Any], packed: Packed) -> bytes:
    """Fill the page with facts, which the script reads as JSON, and arrays."""
    fill: dict[bytes, Callable[[], bytes]] = {
        b"<!--TITLE-->": lambda: escape(facts["title"]).encode("utf-8", "replace"),
        b"/*STYLE*/": lambda: assets(".css"),
        b"/*SCRIPT*/": lambda: assets(".js"),
        b"/*DATA*/": lambda: as_json(facts),
        b"<!--ARRAYS-->": lambda: b"\n".join(map(_array, range(len(packed.texts)), packed.texts)),
    }
    # In one pass: what is filled in may read like a place itself.
    return PLACES.sub(lambda found: fill[found.group()](), assets(".html"))


def assets(ending: str) -> bytes:
    """Read the files of the page with this ending, in the order of their names."""
    folder = files("qsmooth.output.report") / "assets"
    found = sorted((f for f in folder.iterdir() if f.name.endswith(ending)), key=lambda f: f.name)
    return b"\n".join(f.read_bytes() for f in found)


def as_json(facts: dict[str, Any]) -> bytes:
    """Write facts such that nothing in them ends the script that they stand in."""
    text = json.dumps(finite(facts), allow_nan=False, separators=(",", ":"))
    return text.replace("<", "\\u003c").encode("ascii")


def _array(k: int, text: bytes) -> bytes:
    return b'<script id="array-%d" type="application/octet-stream">%s</script>' % (k, text)
