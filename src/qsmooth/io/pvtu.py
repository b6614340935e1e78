"""VTK XML unstructured grids in pieces: a file that names the files of its pieces, one a rank."""

from __future__ import annotations

import contextlib
import re
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any
from xml.etree import ElementTree

import numpy as np

from qsmooth._types import IndexArray
from qsmooth.errors import MeshError
from qsmooth.io import vtu
from qsmooth.io.file_content import FileContent, of_mesh, region_tags
from qsmooth.io.files import read_bytes, write_bytes
from qsmooth.io.in_place import InPlace

if TYPE_CHECKING:
    from qsmooth.mesh import Mesh

NAME = "pvtu"
ENDINGS = (".pvtu",)
HOLDS = vtu.HOLDS

SOURCE = re.compile(rb'(<Piece\b[^>]*\bSource=")([^"]*)(")')
# Point data with the global number of each vertex; the first is written.
GLOBAL_IDS = ("GlobalNodeIds", "GlobalNodeId", "GlobalPointIds", "GlobalNodeID")
# Cell data that marks cells of other pieces: a bit of the one, any level of the other.
GHOST_TYPE, GHOST_LEVELS = "vtkGhostType", "vtkGhostLevels"
DUPLICATE = 1


@dataclass(frozen=True)
class Piece:
    """One of the files.

    Attributes
    ----------
    data, slots
        Its bytes, and the place of its coordinates, as `FileContent` has them.
    vertices : (n,)
        Which vertex of the mesh each of its points is.
    """

    data: bytes
    slots: InPlace | None
    vertices: IndexArray


def sniff(head: bytes) -> bool:
    """Whether a file that starts so names pieces."""
    return b"<VTKFile" in head and b"PUnstructuredGrid" in head


def read(data: bytes) -> FileContent:
    """Refuse: without a path there are no pieces. See `read_at`."""
    raise MeshError("the pieces of a .pvtu file lie beside it: it is read by its path")


def read_at(path: Path, data: bytes) -> FileContent:
    """Read all pieces, and join them where they have the same vertices.

    These are vertices with the same global number, where all pieces have such numbers as point
    data, or else at the same place. Ghost cells are left out.
    """
    names = _sources(data)
    files = [read_bytes(path.parent / name) for name in names]
    contents = []
    for name, piece in zip(names, files, strict=True):
        with _named(name):
            contents.append(vtu.read(piece))
    ids = _global_ids(contents)
    points = np.concatenate([content.points for content in contents])
    vertex, first = _by_id(ids) if ids is not None else _by_place(contents)
    differ = (points != points[first][vertex]).any(axis=1)
    if differ.any():
        assert ids is not None
        at = int(np.argmax(differ))
        raise MeshError(f"vertex {ids[at]} lies elsewhere in another piece")
    ends = np.cumsum([len(content.points) for content in contents])
    of_pieces = np.split(vertex, ends[:-1])
    blocks: list[tuple[str, IndexArray]] = []
    cell_data: dict[str, list[Any]] = {name: [] for name in _common(contents, "cell_data")}
    for content, vertices in zip(contents, of_pieces, strict=True):
        for b, (kind, cells) in enumerate(content.blocks):
            own = _own_cells(content, b)
            blocks.append((kind, vertices[cells[own]]))
            for name, arrays in cell_data.items():
                arrays.append(np.asarray(content.cell_data[name][b])[own])
    for name in (GHOST_TYPE, GHOST_LEVELS):
        cell_data.pop(name, None)
    joined = {
        name: np.concatenate([np.asarray(content.point_data[name]) for content in contents])[first]
        for name in _common(contents, "point_data")
        if name != GHOST_TYPE
    }
    return FileContent(
        points[first],
        blocks,
        region_tags(cell_data, blocks),
        point_data=joined,
        cell_data=cell_data,
        field_data=contents[0].field_data,
        extras=tuple(dict.fromkeys(extra for content in contents for extra in content.extras)),
        pieces=tuple(
            Piece(piece, content.slots, vertices)
            for piece, content, vertices in zip(files, contents, of_pieces, strict=True)
        ),
    )


def write(content: FileContent) -> bytes:
    """Refuse: there are several files to write. See `write_at`."""
    raise MeshError("a .pvtu file is written with its pieces, by its path")


def write_at(path: Path, mesh: Mesh, source: FileContent | None, n_pieces: int) -> list[str]:
    """Write a mesh, and list what is lost; `source` is where it comes from if that is the same.

    Then it keeps its pieces, in which only coordinates change; else it gets so many, along a curve
    that fills the plane. Pieces are new files, whose names no other file has, and the file that
    names them is replaced in one step: what fails before leaves everything as it was.
    """
    lost: list[str] = []
    made = None if source is None else _rewritten(source, mesh)
    template = b"" if made is None or source is None else source.data
    if made is None:
        content = of_mesh(mesh)
        if source is None:
            content.raise_level(HOLDS)
        made, lost = _new_pieces(content, n_pieces), content.losses(HOLDS)
    old = _own_pieces(path)
    names = _free_names(path, len(made))
    try:
        for name, data in zip(names, made, strict=True):
            write_bytes(path.parent / name, data)
        write_bytes(path, _main(template, names, made[0]))
    except BaseException:
        for name in names:
            with contextlib.suppress(OSError):
                (path.parent / name).unlink()
        raise
    for name in old:
        with contextlib.suppress(OSError):
            (path.parent / name).unlink()
    return lost


def _sources(data: bytes) -> list[str]:
    """Names of the pieces' files."""
    try:
        root = ElementTree.fromstring(data)
    except (ElementTree.ParseError, ValueError, LookupError) as error:
        raise MeshError(f"no valid XML: {error}") from error
    kind = root.get("type")
    if root.tag != "VTKFile" or kind != "PUnstructuredGrid":
        raise MeshError(f"VTKFile of type {kind} is not read, only PUnstructuredGrid")
    names = [piece.get("Source", "") for piece in root.findall("PUnstructuredGrid/Piece")]
    if not names:
        raise MeshError("the file has no Piece")
    if "" in names:
        raise MeshError(f"piece {names.index('')} has no Source")
    if len(set(names)) < len(names):
        raise MeshError(f"{max(names, key=names.count)!r} is the file of two pieces")
    return names


@contextlib.contextmanager
def _named(name: str) -> Iterator[None]:
    try:
        yield
    except MeshError as error:
        raise MeshError(f"piece {name!r}: {error}") from error.__cause__


def _common(contents: list[FileContent], what: str) -> list[str]:
    """Names of the data that all pieces have."""
    first, *others = [getattr(content, what) for content in contents]
    return [name for name in first if all(name in other for other in others)]


def _own_cells(content: FileContent, b: int) -> IndexArray:
    """Which cells of a block are not ghosts."""
    n, own = len(content.blocks[b][1]), np.ones(len(content.blocks[b][1]), np.bool_)
    if (kinds := content.cell_data.get(GHOST_TYPE)) is not None and np.size(kinds[b]) == n:
        own &= (np.ravel(kinds[b]).astype(np.int64) & DUPLICATE) == 0
    if (levels := content.cell_data.get(GHOST_LEVELS)) is not None and np.size(levels[b]) == n:
        own &= np.ravel(levels[b]) == 0
    return np.flatnonzero(own)


def _global_ids(contents: list[FileContent]) -> IndexArray | None:
    """Global numbers of the points of all pieces, in a row; None where some lack them."""
    for name in GLOBAL_IDS:
        if not all(name in content.point_data for content in contents):
            continue
        found = [np.asarray(content.point_data[name]) for content in contents]
        if all(a.dtype.kind in "iu" and a.size == len(a) for a in found):
            ids = [a.ravel().astype(np.int64) for a in found]
            if all(np.unique(a).size == a.size for a in ids):
                return np.concatenate(ids)
    return None


def _by_id(ids: IndexArray) -> tuple[IndexArray, IndexArray]:
    """Vertex of each point, and the first point of each vertex."""
    _, first, vertex = np.unique(ids, return_index=True, return_inverse=True)
    return vertex.ravel(), first


def _by_place(contents: list[FileContent]) -> tuple[IndexArray, IndexArray]:
    """As `_by_id`; of several points at one place in a piece the first is the first elsewhere."""
    keys = []
    for content in contents:
        places = content.points + 0.0  # no negative zeros
        _, inverse = np.unique(places, axis=0, return_inverse=True)
        order = np.argsort(inverse.ravel(), kind="stable")
        ranks = np.empty(len(places), np.int64)
        group = inverse.ravel()[order]
        starts = np.flatnonzero(np.diff(group, prepend=-1))
        ranks[order] = np.arange(group.size) - np.repeat(starts, np.diff([*starts, group.size]))
        keys.append(np.column_stack([places, ranks]))
    _, first, inverse = np.unique(
        np.concatenate(keys), axis=0, return_index=True, return_inverse=True
    )
    order = np.argsort(first)  # vertices in the order of the files
    place = np.empty(order.size, np.int64)
    place[order] = np.arange(order.size)
    return place[inverse.ravel()], first[order]


def _rewritten(source: FileContent, mesh: Mesh) -> list[bytes] | None:
    """The pieces with the new coordinates; None where they can't be put into their places."""
    points, made = np.asarray(mesh.points), []
    if source.changed or not source.pieces or points.shape != source.points.shape:
        return None
    for piece in source.pieces:
        old, new = source.points[piece.vertices], points[piece.vertices]
        if np.array_equal(old, new):
            made.append(piece.data)
        elif piece.slots is None:
            return None
        else:
            made.append(piece.slots.write(piece.data, old, new))
    return made


def _new_pieces(content: FileContent, n_pieces: int) -> list[bytes]:
    """Cut a mesh into pieces, with the global numbers of their vertices."""
    from qsmooth.topology import along_curve

    kinds = [kind for kind, _ in content.blocks]
    middles = [content.points[cells].mean(axis=1)[:, :2] for _, cells in content.blocks]
    order = along_curve(np.concatenate(middles))
    n_pieces = max(1, min(n_pieces, sum(map(len, middles))))
    piece = np.empty(order.size, np.int64)
    piece[order] = np.arange(order.size) * n_pieces // order.size
    of_blocks = np.split(piece, np.cumsum([len(m) for m in middles])[:-1])
    lone = np.ones(len(content.points), np.bool_)
    for _, cells in content.blocks:
        lone[cells] = False
    ids = next((name for name in GLOBAL_IDS if name in content.point_data), None)
    point_data = dict(content.point_data)
    if ids is None:
        point_data[GLOBAL_IDS[0]] = np.arange(len(content.points))
    made = []
    for k in range(n_pieces):
        rows = [np.flatnonzero(of == k) for of in of_blocks]
        used = [cells[r].ravel() for (_, cells), r in zip(content.blocks, rows, strict=True)]
        there = np.unique(np.concatenate([*used, np.flatnonzero(lone) if k == 0 else used[0][:0]]))
        local = np.empty(len(content.points), np.int64)
        local[there] = np.arange(there.size)
        kept = [b for b, r in enumerate(rows) if r.size]
        part = replace(
            content,
            points=content.points[there],
            blocks=[(kinds[b], local[content.blocks[b][1][rows[b]]]) for b in kept],
            tags=None if content.tags is None else [content.tags[b][rows[b]] for b in kept],
            point_data={name: np.asarray(v)[there] for name, v in point_data.items()},
            cell_data={
                name: [np.asarray(arrays[b])[rows[b]] for b in kept]
                for name, arrays in content.cell_data.items()
            },
        )
        made.append(vtu.write(part))
    return made


def _own_pieces(path: Path) -> list[str]:
    """The pieces of the file that is replaced, as far as their names are made of its own."""
    try:
        names = _sources(path.read_bytes())
    except (OSError, MeshError):
        return []
    own = re.compile(re.escape(path.stem) + r"(-\d+)?_\d+\.vtu")
    return [name for name in names if own.fullmatch(name)]


def _free_names(path: Path, n: int) -> list[str]:
    """Names for the pieces that no file has."""
    turn = 0
    while True:
        stem = path.stem if turn == 0 else f"{path.stem}-{turn}"
        names = [f"{stem}_{k}.vtu" for k in range(n)]
        if not any((path.parent / name).exists() for name in names):
            return names
        turn += 1


def _main(template: bytes, names: list[str], first: bytes) -> bytes:
    """The file that names the pieces: as it was but for the names, or a new one."""
    if template:
        left = iter(names)
        found, n = SOURCE.subn(
            lambda m: m[1] + next(left, "").translate(vtu.ESCAPED).encode() + m[3], template
        )
        if n == len(names):
            return found
    piece = ElementTree.fromstring(first).find("UnstructuredGrid/Piece")
    lines = [
        '<?xml version="1.0"?>',
        '<VTKFile type="PUnstructuredGrid" version="1.0" byte_order="LittleEndian" '
        'header_type="UInt64">',
        '<PUnstructuredGrid GhostLevel="0">',
    ]
    for tag in ("PointData", "CellData", "Points"):
        lines.append(f"<P{tag}>")
        for array in [] if piece is None else piece.findall(f"{tag}/DataArray"):
            shape = [(key, array.get(key)) for key in ("type", "Name", "NumberOfComponents")]
            said = " ".join(
                f'{key}="{value.translate(vtu.ESCAPED)}"' for key, value in shape if value
            )
            lines.append(f"<PDataArray {said}/>")
        lines.append(f"</P{tag}>")
    lines += [f'<Piece Source="{name.translate(vtu.ESCAPED)}"/>' for name in names]
    return ("\n".join([*lines, "</PUnstructuredGrid>", "</VTKFile>"]) + "\n").encode()
