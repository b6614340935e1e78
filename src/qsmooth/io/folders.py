"""Meshes that are folders of several files."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from qsmooth.errors import MeshError
from qsmooth.io.file_content import FileContent, of_mesh
from qsmooth.io.files import read_bytes, refused, write_folder
from qsmooth.io.registry import FolderFormat, folder_format, folder_formats

if TYPE_CHECKING:
    from qsmooth.mesh import Mesh


def has_mesh(path: Path) -> bool:
    """Whether the folder has a mesh."""
    return any((path / form.FILES[0]).is_file() for form in folder_formats())


def read(path: Path, name: str | None) -> FileContent:
    """Read the mesh in a folder.

    Raises
    ------
    MeshError
        If there is none, or a file of it is missing or wrong.
    """
    if name is None:
        fitting = [form for form in folder_formats() if (path / form.FILES[0]).is_file()]
        if not fitting:
            wanted = " or ".join(f"{form.FILES[0]} ({form.NAME})" for form in folder_formats())
            raise MeshError(f"it is a folder, and has no {wanted}")
        form = fitting[0]
    else:
        found = folder_format(name)
        if found is None:
            raise MeshError(f"it is a folder, and format {name} takes a file")
        form = found
    optional = [name for name in form.OPTIONAL if (path / name).is_file()]
    files = {name: read_bytes(path / name) for name in (*form.FILES, *optional)}
    with refused(f"folder of format {form.NAME}"):
        content = form.read_files(files)
    content.format, content.data = form.NAME, files.pop(form.POINTS)
    content.beside = files
    return content


def write(path: Path, form: FolderFormat, mesh: Mesh, source: FileContent | None) -> list[str]:
    """Write a mesh, and list what is lost; `source` is where it comes from if that is the same."""
    if source is not None and source.slots is not None and not source.changed:
        points = source.slots.write(source.data, source.points, np.asarray(mesh.points))
        made, lost = source.beside | {form.POINTS: points}, []
    else:
        content = of_mesh(mesh)
        made, lost = form.write_files(content), content.losses(form.HOLDS)
    every = (*form.FILES, *form.OPTIONAL)
    write_folder(path, {name: made[name] for name in every if name in made}, every)
    return lost
