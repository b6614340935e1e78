"""Libraries that only some formats need."""

from __future__ import annotations

from importlib.util import find_spec

from qsmooth.errors import MeshError


def require(library: str, what: str) -> None:
    """Refuse what needs a library of the extra ``io`` that is not installed.

    Raises
    ------
    MeshError
        Saying how to install it.
    """
    if find_spec(library) is None:
        raise lacking(library, what)


def lacking(library: str, what: str) -> MeshError:
    """Say that a library has to be installed for `what`."""
    return MeshError(f"{what} needs {library}, which is not installed: pip install 'qsmooth[io]'")
