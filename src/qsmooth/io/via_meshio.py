"""meshio: the formats that qsmooth does not read itself, and meshes in memory."""

from __future__ import annotations

import contextlib
import io
import random
import re
import sys
import warnings
from collections.abc import Iterator, Set
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from qsmooth.errors import MeshError
from qsmooth.io.apart import apart
from qsmooth.io.file_content import FileContent, region_tags
from qsmooth.io.files import reason, replace_file
from qsmooth.io.library_arrays import LIBRARIES, find_arrays
from qsmooth.io.missing import lacking, require

if TYPE_CHECKING:
    import meshio

# Their files hold no mesh that could be read back.
NOT_MESHES = frozenset(("svg", "neuroglancer"))
# Names other than meshio's: ugrid, which it has for AFLR's format, is UGRID's here.
OURS = {"ugrid": "aflr"}
THEIRS = {ours: theirs for theirs, ours in OURS.items()}
# One mesh in several files cannot be replaced in one step.
SEVERAL_FILES = frozenset(("tetgen", "xdmf"))
# What has some of these put all into one.
ALONE = {"xdmf": {"data_format": "XML"}}
# Of these meshio knows tetrahedra only.
SOLID = frozenset(("cgns",))
# What these hold is one block of each type of cell.
ONE_BLOCK = frozenset(("med", "aflr"))
# What only the content knows of; all else is seen when the file is read back.
UNSEEN = frozenset(
    (
        *("z", "vertex", "line", "regions", "names"),
        *("point_data", "cell_data", "field_data", "point_sets", "cell_sets"),
    )
)
# Types and numbers of columns that meshio writes data with.
XDMF_TYPES = ("i4", "i8", "u4", "u8", "f4", "f8")
XDMF_COLUMNS = (1, 2, 3, 6, 9)
# Readers that go on reading for ever where a file ends too early, and whether they read text.
ENDLESS = {"ansys": False, "mdpa": False, "tecplot": True}
MOST_ENDS = 1000
# How text files of formats begin that have a beginning of their own.
BEGINNINGS = (
    ("ansys", rb"\(\s*\d"),
    ("stl", rb"solid\b[^\n]*\n\s*facet\b"),
    ("xdmf", rb"(<\?xml[^>]*>)?\s*(<!DOCTYPE[^>]*>)?\s*<Xdmf\b"),
    ("dolfin-xml", rb"(<\?xml[^>]*>)?\s*<dolfin\b"),
    ("flac3d", rb"\* FLAC3D"),
    ("permas", rb"\$ENTER COMPONENT"),
    ("mdpa", rb"Begin (ModelPartData|Properties|Nodes)\b"),
    ("tecplot", rb"(?i)(TITLE\s*=[^\n]*\n\s*)?VARIABLES\s*="),
    ("nastran", rb"(\$[^\n]*\n\s*)*(SOL\s+\d|CEND\b|BEGIN\s+BULK|GRID[\s,*])"),
    ("wkt", rb"TIN\s*Z?\s*\(\("),
)
# Names of files with the numbers of an XDMF file.
BESIDE = re.compile(rb"([\w.+-]+\.(?:h5|hdf5|hdf|bin))\b")


def loaded() -> Any:
    """Load meshio; rich, which it brings, draws from the caller's random numbers meanwhile."""
    if "meshio" not in sys.modules:
        state = random.getstate()
        try:
            import meshio  # noqa: F401
        finally:
            random.setstate(state)
    return sys.modules["meshio"]


def names(path: Path, without: Set[str]) -> list[str]:
    """Names of the formats that meshio has for this ending, `without` left out."""
    meshio = loaded()

    found = meshio.extension_to_filetypes.get(path.suffix.lower(), [])
    return [name for name in map(_ours, found) if name not in without | NOT_MESHES]


def name_by_content(head: bytes, without: Set[str]) -> str | None:
    """Name of meshio's format whose files begin so, `without` left out."""
    fitting = [name for name, pattern in BEGINNINGS if re.match(pattern, head)]
    return next((name for name in fitting if name not in without), None)


def formats(without: Set[str]) -> dict[str, tuple[str, ...]]:
    """Names and endings of meshio's formats, `without` left out."""
    meshio = loaded()

    endings: dict[str, list[str]] = {}
    for ending, found in meshio.extension_to_filetypes.items():
        for name in map(_ours, found):
            if name not in without | NOT_MESHES:
                endings.setdefault(name, []).append(ending)
    return {name: tuple(found) for name, found in sorted(endings.items())}


def readers() -> frozenset[str]:
    """Names of the formats that meshio reads triangles or quads from."""
    return frozenset(map(_ours, loaded()._helpers.reader_map)) - SOLID


def writers() -> frozenset[str]:
    """Names of those that it has a writer for, and that `write` takes."""
    there = frozenset(map(_ours, loaded()._helpers._writer_map))
    return there - (SEVERAL_FILES - ALONE.keys()) - SOLID


def _ours(name: str) -> str:
    return OURS.get(name, name)


def read(path: Path, name: str) -> FileContent:
    """Read through meshio; every way in which it fails is a MeshError.

    Formats that are read by libraries in C are read in a process of its own.
    """
    if name not in LIBRARIES and name != "xdmf":
        return read_here(path, name)
    if name in LIBRARIES:
        require(LIBRARIES[name], f"format {name}")
    content: FileContent = apart(f"{__name__}:read_here", _size(path), path, name)
    return content


def _size(path: Path) -> int:
    """Bytes of a file, and of those beside it that it names."""
    data = path.read_bytes()
    named = {match.decode() for match in BESIDE.findall(data)} if data[:1] == b"<" else set()
    beside = [path.parent / name for name in named]
    sizes: list[int] = [one.stat().st_size for one in beside if one.is_file()]
    return len(data) + sum(sizes)


def read_here(path: Path, name: str) -> FileContent:
    """Read through meshio, in this process."""
    meshio = loaded()

    with _quiet() as said, _as_mesh_error(said, f"no valid file of format {name}"):
        file = path if name not in ENDLESS else _Ending.opened(path, text=ENDLESS[name])
        mesh = meshio.read(file, file_format=THEIRS.get(name, name))
    content = content_of(mesh)
    content.format = name
    if name in LIBRARIES:
        content.slots = find_arrays(path.read_bytes(), name, content.points)
    return content


def write(content: FileContent, path: Path, name: str) -> list[str]:
    """Write through meshio, read back what was written and list what is lost."""
    meshio = loaded()

    options = ALONE.get(name, {})
    if name in SEVERAL_FILES and not options:
        raise MeshError(f"cannot write '{path}': format {name} takes several files")
    mesh = meshio_of(_grouped(content) if name in ONE_BLOCK else content)
    # Where the format has them, they come back as groups of Gmsh or as sets.
    lost = content.losses(UNSEEN)
    names = content.names.keys() - mesh.field_data.keys() - mesh.cell_sets.keys()
    if names:
        lost.append("group names " + ", ".join(sorted(names)))
    if name == "xdmf":
        lost += _without_odd_data(mesh)

    def fill(temporary: Path) -> None:
        with _quiet() as said, _as_mesh_error(said, f"cannot write '{path}' as {name}"):
            theirs = THEIRS.get(name, name)
            meshio.write(temporary, mesh, file_format=theirs, **options)
            back = meshio.read(temporary, file_format=theirs)
        if np.ndim(back.points) != 2 or len(back.points) == 0:
            raise MeshError(f"cannot write '{path}': format {name} holds none of these cells")
        lost.extend(_missing(mesh, back))

    try:
        replace_file(path, fill)
    except OSError as error:
        raise MeshError(f"cannot write '{path}': {reason(error)}") from error
    return lost


def _grouped(content: FileContent) -> FileContent:
    """The same content with all cells of a type in one block."""
    kinds = list(dict.fromkeys(kind for kind, _ in content.blocks))
    of_kind = [[b for b, (kind, _) in enumerate(content.blocks) if kind == one] for one in kinds]

    def joined(arrays: list[Any]) -> list[Any]:
        return [np.concatenate([np.asarray(arrays[b]) for b in these]) for these in of_kind]

    before = np.zeros(len(content.blocks), np.int64)
    for these in of_kind:
        lengths = [len(content.blocks[b][1]) for b in these]
        before[these] = np.cumsum(lengths) - lengths
    return replace(
        content,
        blocks=list(zip(kinds, joined([cells for _, cells in content.blocks]), strict=True)),
        tags=None if content.tags is None else joined(content.tags),
        cell_data={name: joined(arrays) for name, arrays in content.cell_data.items()},
        cell_sets={
            name: joined(
                [np.asarray(part) + first for part, first in zip(parts, before, strict=True)]
            )
            for name, parts in content.cell_sets.items()
        },
    )


def _without_odd_data(mesh: meshio.Mesh) -> list[str]:
    """Take out what XDMF has no type or no shape for, and name it."""
    lost = []
    for what in ("point_data", "cell_data"):
        data = getattr(mesh, what)
        odd = [name for name, values in data.items() if not _fits_xdmf(values)]
        for name in odd:
            del data[name]
        if odd:
            lost.append(f"{what.replace('_', ' ')} {', '.join(odd)}")
    return lost


def _fits_xdmf(values: Any) -> bool:
    arrays = [np.asarray(one) for one in (values if isinstance(values, list) else [values])]
    return all(
        one.dtype.str[1:] in XDMF_TYPES
        and (one.ndim == 1 or (one.ndim == 2 and one.shape[1] in XDMF_COLUMNS))
        for one in arrays
    )


class _Ending:
    """A file that says so when somebody reads on and on behind its end."""

    def __init__(self, file: io.BytesIO | io.TextIOWrapper) -> None:
        self._file = file
        self._ends = 0

    @classmethod
    def opened(cls, path: Path, text: bool) -> _Ending:
        """The bytes of a file, as text or as they are."""
        data = io.BytesIO(path.read_bytes())
        return cls(io.TextIOWrapper(data) if text else data)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._file, name)

    def __iter__(self) -> Iterator[Any]:
        return iter(self._file)

    def read(self, *size: int) -> Any:
        return self._counted(self._file.read(*size))

    def readline(self, *size: int) -> Any:
        return self._counted(self._file.readline(*size))

    def _counted(self, found: Any) -> Any:
        self._ends += not found
        if self._ends > MOST_ENDS:
            raise EOFError("the file ends too early")
        return found


def content_of(mesh: meshio.Mesh) -> FileContent:
    """Content of a mesh in memory, checked: meshio takes much that is no mesh.

    Raises
    ------
    MeshError
        If arrays are of a wrong shape or not numbers.
    """
    points = np.asarray(mesh.points)
    if points.ndim != 2 or points.shape[1] not in (2, 3) or points.dtype.kind not in "fiu":
        raise MeshError(f"points of shape {points.shape} and type {points.dtype}")
    blocks = []
    for block in mesh.cells:
        cells = np.asarray(block.data)
        if cells.dtype.kind not in "iu" or cells.ndim != 2:
            if len(cells) == 0:
                continue
            cells = np.zeros((len(cells), 1), np.int64)
            blocks.append((f"{block.type} (not an array of integers)", cells))
            continue
        blocks.append((block.type, cells.astype(np.int64)))
    keep = [b for b, block in enumerate(mesh.cells) if len(block.data)]
    blocks = [block for block in blocks if len(block[1])]
    cell_data = {
        name: [np.asarray(parts[b]) for b in keep] for name, parts in mesh.cell_data.items()
    }
    cell_sets = {
        name: [np.asarray([] if parts[b] is None else parts[b], dtype=np.int64) for b in keep]
        for name, parts in mesh.cell_sets.items()
    }
    groups = {}
    for name, value in mesh.field_data.items():
        pair = np.asarray(value)
        if pair.shape == (2,) and pair.dtype.kind in "iu":  # Gmsh's physical names
            groups[name] = (int(pair[0]), int(pair[1]))
    return FileContent(
        points.astype(np.float64),
        blocks,
        region_tags(cell_data, blocks),
        groups,
        point_data=dict(mesh.point_data),
        cell_data=cell_data,
        field_data=dict(mesh.field_data),
        point_sets=dict(mesh.point_sets),
        cell_sets=cell_sets,
    )


def meshio_of(content: FileContent) -> meshio.Mesh:
    """The content as a mesh of meshio; regions become cell data "region"."""
    meshio = loaded()

    cell_data = dict(content.cell_data)
    if content.tags is not None and region_tags(cell_data, content.blocks) is None:
        cell_data["region"] = content.tags
    return meshio.Mesh(
        content.points,
        content.blocks,
        point_data=content.point_data,
        cell_data=cell_data,
        field_data=content.field_data,
        point_sets=content.point_sets,
        cell_sets=content.cell_sets,
    )


@contextlib.contextmanager
def _quiet() -> Iterator[io.StringIO]:
    """Keep what meshio prints and warns of; it goes into the message if it fails."""
    said = io.StringIO()
    with (
        contextlib.redirect_stdout(said),
        contextlib.redirect_stderr(said),
        warnings.catch_warnings(),
        np.errstate(all="ignore"),
    ):
        warnings.simplefilter("ignore")
        yield said


@contextlib.contextmanager
def _as_mesh_error(said: io.StringIO, what: str = "") -> Iterator[None]:
    try:
        yield
    except ImportError as error:
        raise lacking(error.name or str(error), what or "this format") from error
    except (Exception, SystemExit) as error:  # meshio leaves the interpreter on a bad file
        words = " ".join(said.getvalue().split()) or _in_words(error)
        if isinstance(error, OSError) and error.strerror:
            words = error.strerror
        raise MeshError(f"{what + ': ' if what else ''}meshio says: {words[:300]}") from error


def _in_words(error: BaseException) -> str:
    """Say what an error of meshio is that it did not foresee."""
    name = type(error).__name__
    if isinstance(error, KeyError):
        return f"{error} is asked for, which it does not know or the file does not have ({name})"
    if not str(error):
        return f"what it expects at some place is not there ({name})"
    return f"{name} {error}"


def _missing(mesh: meshio.Mesh, back: meshio.Mesh) -> list[str]:
    """What `mesh` has and `back` lacks or has otherwise."""
    lost = []
    old, new = np.asarray(mesh.points, float), np.asarray(back.points, float)
    n = min(old.shape[1], new.shape[1])
    if old.shape[0] != new.shape[0]:
        lost.append(f"{old.shape[0] - new.shape[0]} vertices, and the order of the others")
    elif not np.array_equal(old[:, :n], new[:, :n]):
        lost.append(f"digits of coordinates (up to {abs(old[:, :n] - new[:, :n]).max():.2g})")
    if old.shape[1] > n and old[:, n:].any():
        lost.append("z coordinates")
    if not _same_cells(mesh, back):
        lost.append("order or types of cells")
    for what in ("point_data", "cell_data", "field_data", "point_sets", "cell_sets"):
        names = [name for name in getattr(mesh, what) if name not in getattr(back, what)]
        if names:
            lost.append(what.replace("_", " ") + " " + ", ".join(names))
    return lost


def _same_cells(mesh: meshio.Mesh, back: meshio.Mesh) -> bool:
    old = [(block.type, np.asarray(block.data)) for block in mesh.cells]
    new = [(block.type, np.asarray(block.data)) for block in back.cells]
    kinds = dict.fromkeys(kind for kind, _ in old)
    if sum(len(c) for _, c in old) != sum(len(c) for _, c in new):
        return False
    return all(
        np.array_equal(
            np.concatenate([c for k, c in old if k == kind]),
            np.concatenate([c for k, c in new if k == kind] or [np.empty((0, 1))]),
        )
        for kind in kinds
    )
