"""The formats there are: each module of this package that has the names of one.

Nothing lists them, so a new format is a new module here. They are imported when a file is first
read or written, not with the package.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping
from functools import cache
from importlib import import_module
from pkgutil import iter_modules
from types import ModuleType
from typing import Protocol, cast

from qsmooth.io.file_content import FileContent

# What makes a module a format.
NAMES = ("NAME", "ENDINGS", "HOLDS", "sniff", "read", "write")


class Format(Protocol):
    """What the module of a format has.

    Seven more names may be there. ``read_at(path, data)`` and ``write_at(path, mesh, source,
    pieces)``, which lists what is lost, take the place of ``read`` and ``write`` where other files
    belong to the one that is named. ``WRITES``, True if it is not: whether it writes new files.
    ``PRIORITY``, 0 if it is not: of the formats that share an ending
    the one with the highest is asked first whether a file is its own, and is the one written.
    ``REPLACES``, ``(NAME,)`` if it is not: meshio's names for the format, which are then left out.
    ``in_degrees``: whether what lies beside a file, by its path, says that it is in degrees, or
    that it is not; None where nothing says it.
    ``ONLY``, None if it is not: the one type of cell, "triangle" or "quad", that it can hold.
    """

    @property
    def NAME(self) -> str: ...  # noqa: N802
    @property
    def ENDINGS(self) -> tuple[str, ...]: ...  # noqa: N802
    @property
    def HOLDS(self) -> frozenset[str]: ...  # noqa: N802

    def sniff(self, head: bytes) -> bool:
        """Whether a file that begins with `head` is of this format."""
        ...

    def read(self, data: bytes) -> FileContent:
        """The mesh in these bytes; MeshError where there is none."""
        ...

    def write(self, content: FileContent) -> bytes:
        """The bytes of a new file."""
        ...


class FolderFormat(Protocol):
    """What the module of a format has whose meshes are folders of several files.

    The first of `FILES` is the one without which a folder has no mesh; all of them have to be
    there, those of `OPTIONAL` may be. `POINTS` is the one with the coordinates.
    """

    @property
    def NAME(self) -> str: ...  # noqa: N802
    @property
    def HOLDS(self) -> frozenset[str]: ...  # noqa: N802
    @property
    def FILES(self) -> tuple[str, ...]: ...  # noqa: N802
    @property
    def OPTIONAL(self) -> tuple[str, ...]: ...  # noqa: N802
    @property
    def POINTS(self) -> str: ...  # noqa: N802

    def read_files(self, files: Mapping[str, bytes]) -> FileContent:
        """The mesh in these files, by name; slots are those of the file `POINTS`."""
        ...

    def write_files(self, content: FileContent) -> dict[str, bytes]:
        """All files of a new folder."""
        ...


@cache
def own_formats() -> tuple[Format, ...]:
    """The formats that qsmooth reads itself, those of a higher priority first, then by name.

    Raises
    ------
    AttributeError
        If a module has a ``NAME`` and lacks another name of a format.
    """
    found = [module for module in _modules() if not hasattr(module, "FILES")]
    for module in found:
        if missing := [name for name in NAMES if not hasattr(module, name)]:
            raise AttributeError(f"{module.__name__} is no format: it lacks {', '.join(missing)}")
    forms = cast("list[Format]", found)
    return tuple(sorted(forms, key=lambda form: (-priority(form), form.NAME)))


@cache
def folder_formats() -> tuple[FolderFormat, ...]:
    """The formats whose meshes are folders, by name."""
    found = [module for module in _modules() if hasattr(module, "FILES")]
    return tuple(sorted(cast("list[FolderFormat]", found), key=lambda form: form.NAME))


def folder_format(name: str) -> FolderFormat | None:
    """The format of this name whose meshes are folders."""
    return next((form for form in folder_formats() if name == form.NAME), None)


def _modules() -> list[ModuleType]:
    """The modules of this package that have the name of a format."""
    package = sys.modules[__package__]
    modules = [
        import_module(f"{__package__}.{info.name}") for info in iter_modules(package.__path__)
    ]
    return [module for module in modules if hasattr(module, "NAME")]


def with_ending(ending: str) -> list[Format]:
    """The formats with this ending, in lower case; the first is the one written."""
    return [form for form in own_formats() if ending in form.ENDINGS]


def named(name: str) -> Format | None:
    """The format of this name."""
    return next((form for form in own_formats() if name == form.NAME), None)


def priority(form: Format) -> int:
    """Rank among the formats that share an ending."""
    return int(getattr(form, "PRIORITY", 0))


def only(form: Format | None) -> str | None:
    """The one type of cell that a format can hold; None where it holds both."""
    return getattr(form, "ONLY", None)


def replaced() -> frozenset[str]:
    """Names that meshio has for the formats that qsmooth reads itself."""
    return frozenset(
        name for form in own_formats() for name in getattr(form, "REPLACES", (form.NAME,))
    )
