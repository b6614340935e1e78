"""Reading and writing mesh files.

A format is a module of this package with six names: ``NAME``, ``ENDINGS``, ``HOLDS`` (what it can
keep besides points, triangles and quads), ``sniff`` (does a file begin like one of its own),
``read`` and ``write``; `registry` finds it, and says what else it may have. All else that meshio
reads comes through it, checked.

A file is written back in its own format by putting the coordinates that changed in place of the
old ones; every other byte stays.
"""

from __future__ import annotations

import os
import warnings
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from qsmooth._types import FloatArray
from qsmooth.errors import MeshError, MeshWarning
from qsmooth.io import via_meshio
from qsmooth.io.file_content import FileContent, of_mesh
from qsmooth.io.files import read_bytes, write_bytes
from qsmooth.io.registry import Format, named, own_formats, replaced, with_ending

if TYPE_CHECKING:
    from qsmooth.mesh import Mesh, MeshLike, Surface

__all__ = ["format_of", "formats", "own_formats", "read_mesh", "write_mesh"]

PathLike: TypeAlias = str | os.PathLike[str]

HEAD = 1 << 16  # bytes that tell a format; comments may come first


def formats() -> dict[str, tuple[str, ...]]:
    """Names of all formats, with their endings: qsmooth's own first, then meshio's."""
    own = sorted(own_formats(), key=lambda form: form.NAME)
    return {form.NAME: form.ENDINGS for form in own} | via_meshio.formats(replaced())


def read_mesh(path: PathLike, *, surface: Surface = "auto", format: str | None = None) -> Mesh:
    """Read a mesh from a file.

    Parameters
    ----------
    path
        The format goes by the file's ending, and by its content where several share an ending.
    surface
        "flat" takes z for a field on a flat mesh; see `Mesh`.
    format
        Name of a format, one of `formats()`, if the ending does not say it.

    Raises
    ------
    MeshError
        If the file cannot be read rightly. The message names the file, what is wrong and where.
    """
    path = Path(path)
    try:
        content = _read(path, format)
        content.ending = path.suffix.lower()
        mesh = content.to_mesh(surface)
    except MeshError as error:
        message = str(error)
        if str(path) not in message:
            message = f"cannot read '{path}': {message}"
        raise MeshError(message) from error.__cause__
    for note in content.notes:
        warnings.warn(f"'{path}': {note}", MeshWarning, stacklevel=2)
    return mesh


def write_mesh(path: PathLike, mesh: MeshLike, *, format: str | None = None) -> None:
    """Write a mesh to a file, in one step: if it fails, an older file stays whole.

    Into the format it was read from, nothing but the coordinates that changed is new. What
    another format cannot hold is listed in a `MeshWarning`.

    Parameters
    ----------
    mesh
        A `Mesh`, or a pair ``(points, cells)``; what else there is goes through `as_mesh`.
    path
        The format goes by the ending; where several share it, or there is none, by the file the
        mesh came from.
    format
        Name of a format, one of `formats()`, if the ending does not say it.

    Raises
    ------
    MeshError
        If the format is unknown or the file cannot be written.
    """
    from qsmooth.mesh import plain_mesh

    path, mesh = Path(path), plain_mesh(mesh)
    source = mesh.source if isinstance(mesh.source, FileContent) else None
    name = format_of(path, mesh, format=format)
    same_format = source is not None and source.format == name
    lost: list[str] = []
    if same_format and source is not None and source.data and _can_write_in_place(source, mesh):
        write_bytes(path, _written_in_place(source, mesh))
    elif form := named(name):
        content = of_mesh(mesh)
        data = form.write(content)
        lost = content.losses(form.HOLDS)
        write_bytes(path, data)
    else:
        content = of_mesh(mesh)
        lost = via_meshio.write(content, path, name) + list(content.extras)
    if lost:
        warnings.warn(
            f"'{path}': format {name} cannot hold {'; '.join(lost)}", MeshWarning, stacklevel=2
        )


def format_of(path: PathLike, mesh: Mesh, *, format: str | None = None) -> str:
    """Name the format that `write_mesh` writes with these arguments.

    Raises
    ------
    MeshError
        If there is none, or no such one.
    """
    path = Path(path)
    source = mesh.source if isinstance(mesh.source, FileContent) else None
    name = format or _name_for(path, source)
    if named(name) is None and name not in formats():  # meshio is asked last: it is slow to load
        raise MeshError(f"cannot write '{path}': unknown format {name!r}, known are {_known()}")
    return name


def holds_point_data(name: str) -> bool:
    """Whether a format can keep point data; of meshio's that is seen when it is written."""
    form = named(name)
    return form is None or "point_data" in form.HOLDS


def _read(path: Path, name: str | None) -> FileContent:
    data = read_bytes(path)
    if not data.strip():
        raise MeshError("the file is empty")
    clean = _clean(data)
    form = _by_content(path, clean[:HEAD].lstrip()) if name is None else named(name) or name
    if isinstance(form, str):
        if form not in via_meshio.formats(replaced()):
            raise MeshError(f"unknown format {form!r}, known are {_known()}")
        content = via_meshio.read(path, form)
        # Kept to write an unchanged mesh as it was; of no use where a second file belongs to it.
        content.data = b"" if form in via_meshio.SEVERAL_FILES else data
        return content
    try:
        content = form.read(clean)
    except (MeshError, MemoryError):
        raise
    except Exception as error:  # a file can be wrong in more ways than a reader checks
        raise MeshError(f"no valid file of format {form.NAME} ({error!r})") from error
    content.format, content.data = form.NAME, data
    return content


def _by_content(path: Path, head: bytes) -> Format | str:
    """The format of a file that begins so: its module, or meshio's name for it."""
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
        raise MeshError(f"unknown format: ending {path.suffix!r}, known are {_known()}")
    others = [form.NAME for form in own_formats() if form.sniff(head)]
    hint = f"; it looks like {others[0]}: say so with format={others[0]!r}" if others else ""
    wanted = " or ".join(form.NAME for form in claiming)
    raise MeshError(f"this is no file of format {wanted}: it begins with {head[:30]!r}{hint}")


def _name_for(path: Path, source: FileContent | None) -> str:
    """Name of the format to write a file of this ending in."""
    ending = path.suffix.lower()
    claiming = [form.NAME for form in with_ending(ending)]
    names = claiming or via_meshio.names(path, replaced())
    if source is not None and source.format:
        # An ending that says nothing is the one it was read from, or left out.
        says_nothing = not names and ending in ("", source.ending)
        if source.format in names or says_nothing:
            return source.format
    if not names:
        raise MeshError(f"cannot write '{path}': unknown ending {ending!r}, known are {_known()}")
    return names[0]


def _known() -> str:
    return ", ".join(formats())


def _can_write_in_place(source: FileContent, mesh: Mesh) -> bool:
    if not source.changed <= source.data_slots.keys():
        return False
    return source.slots is not None or np.array_equal(source.points, mesh.points)


def _written_in_place(source: FileContent, mesh: Mesh) -> bytes:
    data = source.data
    if source.slots is not None:
        data = source.slots.write(data, source.points, np.asarray(mesh.points))
    form = named(source.format)
    if form is None:
        return data
    for name in sorted(source.changed):
        # Read again, as with every array that is written the places of others change.
        content = form.read(_clean(data))
        old, new = (_as_columns(of.point_data[name]) for of in (content, source))
        data = content.data_slots[name].write(data, old, new)
    return data


def _as_columns(values: Any) -> FloatArray:
    return np.array(values, np.float64, order="C").reshape(len(values), -1)


def _clean(data: bytes) -> bytes:
    """Blank a byte order mark, which is no part of the mesh: every other byte stays in place."""
    return b"   " + data[3:] if data.startswith(b"\xef\xbb\xbf") else data
