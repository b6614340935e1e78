"""Reading and writing mesh files.

A format is a module of this package with six names: ``NAME``, ``ENDINGS``, ``HOLDS`` (what it can
keep besides points, triangles and quads), ``sniff`` (does a file begin like one of its own),
``read`` and ``write``; `registry` finds it, and says what else it may have. All else that meshio
reads comes through it, checked.

A format whose meshes are folders of several files has other names, see `registry.FolderFormat`.

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
from qsmooth.io import folders, via_meshio
from qsmooth.io.file_content import FileContent, of_mesh
from qsmooth.io.files import read_bytes, refused, write_bytes
from qsmooth.io.listing import FormatRecord, format_records
from qsmooth.io.recognition import format_to_read, format_to_write, formats, require_known
from qsmooth.io.registry import Format, folder_format, named, only, own_formats

if TYPE_CHECKING:
    from qsmooth.mesh import Mesh, MeshLike, Surface

__all__ = [
    "FormatRecord",
    "format_of",
    "format_records",
    "formats",
    "holds_cell_data",
    "holds_point_data",
    "own_formats",
    "read_mesh",
    "write_and_tell",
    "write_mesh",
]

PathLike: TypeAlias = str | os.PathLike[str]

HEAD = 1 << 16  # bytes that tell a format; comments may come first


def read_mesh(
    path: PathLike,
    *,
    surface: Surface = "auto",
    format: str | None = None,
    geographic: bool | None = None,
) -> Mesh:
    """Read a mesh from a file.

    Parameters
    ----------
    path
        A file, or the folder of a mesh of several files, as Elmer has them. The format goes by
        the file's ending, and by its content where several share an ending or none has it.
    surface
        "flat" takes z for a field on a flat mesh; see `Mesh`. Of hydrodynamic formats it is one.
    format
        Name of a format, one of `formats()`, if the ending does not say it.
    geographic
        Whether x and y are longitudes and latitudes in degrees; by default what the file says.

    Raises
    ------
    MeshError
        If the file cannot be read rightly. The message names the file, what is wrong and where.
    """
    path = Path(path)
    try:
        content = _read(path, format)
        content.file, content.ending = path.name, path.suffix.lower()
        mesh = content.to_mesh(surface, geographic)
    except MeshError as error:
        message = str(error)
        if str(path) not in message:
            message = f"cannot read '{path}': {message}"
        raise MeshError(message) from error.__cause__
    for note in content.notes:
        warnings.warn(f"'{path}': {note}", MeshWarning, stacklevel=2)
    return mesh


def write_mesh(
    path: PathLike, mesh: MeshLike, *, format: str | None = None, pieces: int = 1
) -> None:
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
    pieces
        Into how many files of its own a ``.pvtu`` file divides a mesh that was read from another
        format; no other has several.

    Raises
    ------
    MeshError
        If the format is unknown or the file cannot be written.
    """
    from qsmooth.mesh import plain_mesh

    lost = write_and_tell(path, mesh, format=format, pieces=pieces)
    if lost:
        name = format_of(path, plain_mesh(mesh), format=format)
        warnings.warn(
            f"'{path}': format {name} cannot hold {'; '.join(lost)}", MeshWarning, stacklevel=2
        )


def write_and_tell(
    path: PathLike, mesh: MeshLike, *, format: str | None = None, pieces: int = 1
) -> tuple[str, ...]:
    """Write a mesh as `write_mesh` does, and give what its format cannot hold, in words."""
    from qsmooth.mesh import plain_mesh

    path, mesh = Path(path), plain_mesh(mesh)
    source = mesh.source if isinstance(mesh.source, FileContent) else None
    name = format_of(path, mesh, format=format)
    same_format = source is not None and source.format == name
    if folder := folder_format(name):
        return tuple(folders.write(path, folder, mesh, source if same_format else None))
    if write_at := getattr(named(name), "write_at", None):
        return tuple(write_at(path, mesh, source if same_format else None, pieces))
    if same_format and source is not None and source.data and _can_write_in_place(source, mesh):
        write_bytes(path, _written_in_place(source, mesh))
        return ()
    content = of_mesh(mesh)
    if form := named(name):
        if not same_format:
            content.raise_level(form.HOLDS)
        data = form.write(content)
        write_bytes(path, data)
        return tuple(content.losses(form.HOLDS | _told_beside(form, path)))
    return tuple(via_meshio.write(content, path, name))


def format_of(path: PathLike, mesh: Mesh, *, format: str | None = None) -> str:
    """Name the format that `write_mesh` writes with these arguments.

    Raises
    ------
    MeshError
        If there is none, no such one, or none that holds these cells.
    """
    path = Path(path)
    source = mesh.source if isinstance(mesh.source, FileContent) else None
    name = format or format_to_write(path, source)
    try:
        require_known(name)
    except MeshError as error:
        raise MeshError(f"cannot write '{path}': {error}") from None
    kind = only(named(name))
    n_others = sum(len(c) for c in mesh.cells if c.shape[1] != (3 if kind == "triangle" else 4))
    if kind and n_others:
        other = "quads" if kind == "triangle" else "triangles"
        raise MeshError(
            f"cannot write '{path}': format {name} holds {kind}s only, there are {n_others} {other}"
        )
    return name


def holds_point_data(name: str) -> bool:
    """Whether a format can keep point data; of meshio's that is seen when it is written."""
    form = named(name) or folder_format(name)
    return form is None or "point_data" in form.HOLDS


def holds_cell_data(name: str) -> bool:
    """Whether a format can keep cell data; of meshio's that is seen when it is written."""
    form = named(name) or folder_format(name)
    return form is None or "cell_data" in form.HOLDS


def _read(path: Path, name: str | None) -> FileContent:
    if path.is_dir():
        return folders.read(path, name)
    data = read_bytes(path)
    if not data.strip():
        raise MeshError("the file is empty")
    clean = _clean(data)
    if name is not None:
        require_known(name)
    form = format_to_read(path, clean[:HEAD].lstrip()) if name is None else named(name) or name
    if isinstance(form, str):
        content = via_meshio.read(path, form)
        # Kept to write an unchanged mesh as it was; of no use where a second file belongs to it.
        content.data = b"" if form in via_meshio.SEVERAL_FILES else data
        return content
    with refused(f"file of format {form.NAME}"):
        read_at = getattr(form, "read_at", None)
        content = form.read(clean) if read_at is None else read_at(path, clean)
    content.format, content.data = form.NAME, data
    beside = getattr(form, "in_degrees", None)
    if content.geographic is None and beside:
        content.geographic = beside(path)
    return content


def _told_beside(form: Format, path: Path) -> frozenset[str]:
    """What a new file need not hold, as its name or what lies beside it says it."""
    beside = getattr(form, "in_degrees", None)
    return frozenset(("geographic",)) if beside and beside(path) else frozenset()


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
    content: FileContent | None = None
    for name in sorted(source.changed):
        if content is None or not getattr(content.data_slots[name], "steady", False):
            content = form.read(_clean(data))  # as the places of others have changed
        old, new = (_as_columns(of.point_data[name]) for of in (content, source))
        data = content.data_slots[name].write(data, old, new)
    return data


def _as_columns(values: Any) -> FloatArray:
    return np.array(values, np.float64, order="C").reshape(len(values), -1)


def _clean(data: bytes) -> bytes:
    """Blank a byte order mark, which is no part of the mesh: every other byte stays in place."""
    return b"   " + data[3:] if data.startswith(b"\xef\xbb\xbf") else data
