"""Which format a file is of, by its ending and its first bytes, and what is said where it is none.

Refusals name endings, as those are what a caller has written, and the nearest of them.
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from qsmooth._words import did_you_mean
from qsmooth.errors import MeshError
from qsmooth.io import via_meshio
from qsmooth.io.file_content import FileContent
from qsmooth.io.registry import (
    Format,
    folder_format,
    folder_formats,
    named,
    own_formats,
    replaced,
    with_ending,
)


def formats() -> dict[str, tuple[str, ...]]:
    """Names of all formats, with their endings: qsmooth's own first, then meshio's."""
    own = {form.NAME: form.ENDINGS for form in own_formats()}
    own |= {form.NAME: () for form in folder_formats()}
    return dict(sorted(own.items())) | via_meshio.formats(replaced())


def endings() -> list[str]:
    """Endings of all formats, each once, in order."""
    return sorted({ending for of_one in formats().values() for ending in of_one})


def format_to_read(path: Path, head: bytes) -> Format | str:
    """The format of a file that begins so: its module, or meshio's name for it.

    Raises
    ------
    MeshError
        If neither ending nor content is that of a format, or they are of two.
    """
    claiming = with_ending(path.suffix.lower())
    fitting = [form for form in claiming or own_formats() if form.sniff(head)]
    if fitting and claiming:
        return fitting[0]
    foreign = via_meshio.names(path, replaced())
    if foreign and (not claiming or head[:1] == b"("):  # .msh is ANSYS's too
        return foreign[0]
    if fitting:
        return fitting[0]
    if not claiming:
        name = via_meshio.name_by_content(head, replaced())
        if name is None:
            raise MeshError(f"{_ending_in_words(path)}, and it begins like no file that is read")
        return name
    others = [form.NAME for form in own_formats() if form.sniff(head)]
    hint = f"; it looks like {others[0]}: say so with format={others[0]!r}" if others else ""
    wanted = " or ".join(form.NAME for form in claiming)
    raise MeshError(f"this is no file of format {wanted}: it begins with {head[:30]!r}{hint}")


def format_to_write(path: Path, source: FileContent | None) -> str:
    """Name of the format that a file of this ending is written in.

    Raises
    ------
    MeshError
        If there is none.
    """
    ending = path.suffix.lower()
    claiming = [form.NAME for form in with_ending(ending)]
    names = claiming or via_meshio.names(path, replaced())
    if source is not None and source.format:
        # An ending that says nothing is the one it was read from, or left out.
        says_nothing = not names and ending in ("", source.ending)
        if source.format in names or says_nothing:
            return source.format
    if not names:
        raise MeshError(f"cannot write '{path}': {_ending_in_words(path)}")
    return names[0]


def require_known(name: str) -> None:
    """Refuse a name that is no format's; meshio is asked last, as it is slow to load.

    Raises
    ------
    MeshError
        Naming those there are, and the nearest.
    """
    if not (named(name) or folder_format(name)) and name not in formats():
        raise MeshError(f"unknown format {name!r}{_near(name, formats())}")


def _ending_in_words(path: Path) -> str:
    """What is wrong with the ending of a name, and which there are."""
    if not path.suffix:
        return f"its name has no ending, known are {', '.join(endings())}"
    return f"unknown ending {path.suffix!r}{_near(path.suffix.lower(), endings())}"


def _near(name: str, known: Iterable[str]) -> str:
    known = list(known)
    return f", known are {', '.join(known)}{did_you_mean(name, known)}"
