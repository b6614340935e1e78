"""Libraries that only some formats need: asked for when such a file comes."""

from __future__ import annotations

from importlib import import_module
from typing import Any

from qsmooth.errors import MeshError


def library(name: str, what: str) -> Any:
    """Import a library of the extra ``io``.

    Raises
    ------
    MeshError
        If it is not installed; the message says how to.
    """
    try:
        return import_module(name)
    except ImportError as error:
        raise needs(name, what) from error


def needs(name: str, what: str) -> MeshError:
    """Say that a library has to be installed for `what`."""
    return MeshError(f"{what} needs {name}, which is not installed: pip install 'qsmooth[io]'")
