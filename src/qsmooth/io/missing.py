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
    try:
        found = find_spec(library) is not None
    except (ImportError, ValueError):  # by a finder, or by None in sys.modules
        found = False
    if not found:
        raise lacking(library, what)


def lacking(library: str, what: str) -> MeshError:
    """Say that a library has to be installed for `what`."""
    return MeshError(f"{what} needs {library}, which is not installed: pip install 'qsmooth[io]'")
