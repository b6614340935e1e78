"""What a mesh file holds, whatever its format."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from qsmooth._types import BoolArray, FloatArray, IndexArray
from qsmooth.checks import counted
from qsmooth.errors import MeshError
from qsmooth.geographic import no_degrees
from qsmooth.io.in_place import InPlace, Slots
from qsmooth.io.text import line_of

if TYPE_CHECKING:
    from qsmooth.mesh import Mesh, Surface

Block = tuple[str, IndexArray]

# Cell types that are read, with the vertices of each; all others are refused by name.
N_VERTICES = {"vertex": 1, "line": 2, "triangle": 3, "quad": 4}
FACES = ("triangle", "quad")

# So many of the types that are refused are named.
NAMED = 5

# Cell data that says which region a cell belongs to, the first found wins; integers only.
REGION_NAMES = (
    "region",
    "regions",
    "region_id",
    "RegionId",
    "material",
    "materials",
    "material_id",
    "MaterialIds",
    "mat_id",
    "gmsh:physical",
    "gmsh:geometrical",
    "medit:ref",
    "mfem:attribute",
    "avsucd:material",
    "CellEntityIds",
    "cell_tags",
)


@dataclass
class FileContent:
    """One mesh as its file has it.

    Parameters
    ----------
    points : (n_vertices, 2) or (n_vertices, 3)
        As many coordinates as the file has.
    blocks
        Cells in the order of the file, in runs of one type; types are named as in meshio,
        vertices count from 0.
    tags
        An integer for each cell of each block (region of a face, marker of a line), or None.
    names
        What a tag is called: name -> (tag, dimension).
    point_data, cell_data, field_data, point_sets, cell_sets
        As in meshio: cell data is an array for each block, a cell set the cell numbers
        within each block.
    changed
        Names of point data whose values are no longer those of the file.
    extras
        What else was seen in the file; kept in its own format, lost in any other.
    notes
        What was odd in the file and yet could be read rightly.
    geographic
        Whether the file says that its coordinates are longitudes and latitudes in degrees, or that
        they are none; None where it says nothing.
    z_means
        What z is by the format's definition: a value on a flat mesh, counted upwards ("height") or
        downwards ("depth"); "" where it is a coordinate, or may be.
    fields
        Names of point data that belong to places by the format's definition.
    level
        Name of the point data that formats with a z for it have as z, and how it counts; or None.
    held
        Vertices that stay, as more than their place hangs on them; or None.
    turned
        Which of the triangles and quads, one block after the other, run clockwise; or None where
        that is not known.
    tilted
        Whether the mesh lies in another plane than that of x and y.
    format, file, ending, data, slots, data_slots
        Where it comes from: name of the format, name, ending and bytes of the file, place of its
        coordinates and of its point data, by name, as far as that can be written back.
        `slots` is None where there is no file or where it cannot be written back.
    beside
        The other files of the mesh, by name, where its format is a folder.
    pieces
        The files that it is in, where its format has several for parts of the mesh.
    places
        For each block the byte at which each cell stands, for messages; or None.
    """

    points: FloatArray
    blocks: list[Block]
    tags: list[IndexArray] | None = None
    names: dict[str, tuple[int, int]] = field(default_factory=dict)
    point_data: dict[str, Any] = field(default_factory=dict)
    cell_data: dict[str, list[Any]] = field(default_factory=dict)
    field_data: dict[str, Any] = field(default_factory=dict)
    point_sets: dict[str, Any] = field(default_factory=dict)
    cell_sets: dict[str, list[Any]] = field(default_factory=dict)
    changed: frozenset[str] = frozenset()
    extras: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    geographic: bool | None = None
    z_means: Literal["", "height", "depth"] = ""
    fields: tuple[str, ...] = ()
    level: tuple[str, Literal["height", "depth"]] | None = None
    held: IndexArray | None = None
    turned: BoolArray | None = None
    tilted: bool = False
    format: str = ""
    file: str = ""
    ending: str = ""
    data: bytes = b""
    slots: InPlace | None = None
    data_slots: dict[str, InPlace] = field(default_factory=dict)
    beside: dict[str, bytes] = field(default_factory=dict)
    places: list[IndexArray] | None = None
    pieces: tuple[Any, ...] = ()

    @property
    def faces(self) -> list[int]:
        """Numbers of the blocks of triangles and quads."""
        return [b for b, (kind, _) in enumerate(self.blocks) if kind in FACES]

    @property
    def points_3d(self) -> FloatArray:
        """(n_vertices, 3), with z = 0 where the file has none."""
        return np.pad(self.points, ((0, 0), (0, 3 - self.points.shape[1])))

    @property
    def plain_points(self) -> FloatArray:
        """(n_vertices, 2) where z is 0 everywhere, as solvers of flat problems want it."""
        if self.points.shape[1] == 3 and not self.points[:, 2].any():
            return np.ascontiguousarray(self.points[:, :2])
        return self.points

    def z(self, means: Literal["height", "depth"]) -> FloatArray:
        """Give z, (n_vertices,), counted upwards or downwards; 0 where the file has none."""
        z = self.points_3d[:, 2]
        return 0.0 - z if self.z_means not in ("", means) else z

    def of_type(self, *kinds: str) -> list[tuple[IndexArray, IndexArray | None]]:
        """The cells and tags of each block of these types."""
        return [
            (cells, None if self.tags is None else self.tags[b])
            for b, (kind, cells) in enumerate(self.blocks)
            if kind in kinds
        ]

    def counter_clockwise(self) -> list[tuple[IndexArray, IndexArray | None]]:
        """Give the cells and tags of each block of triangles or quads, all turned to run alike."""
        found, first = [], 0
        for cells, tags in self.of_type(*FACES):
            if self.turned is not None:
                turned = self.turned[first : first + len(cells), None]
                cells = np.where(turned, np.roll(cells[:, ::-1], 1, axis=1), cells)
            first += len(cells)
            found.append((cells, tags))
        return found

    @property
    def lines(self) -> tuple[IndexArray, IndexArray]:
        """All line cells, (n_lines, 2), and their tags, 0 where there are none."""
        parts = self.of_type("line")
        tags = [np.zeros(len(cells), np.int64) if t is None else t for cells, t in parts]
        return (
            np.concatenate([np.empty((0, 2), np.int64), *(cells for cells, _ in parts)]),
            np.concatenate([np.empty(0, np.int64), *tags]),
        )

    def check(self) -> None:
        """Refuse types that cannot be smoothed and vertices that do not exist.

        Raises
        ------
        MeshError
            With the number of offenders and the first of them.
        """
        n_vertices = len(self.points)
        lost = ~np.isfinite(self.points).all(axis=1)
        if lost.any():
            vertex = int(np.argmax(lost))
            where = f"vertex {vertex}"
            if isinstance(self.slots, Slots) and self.slots.dtype is None:
                where += f", line {line_of(self.data, int(self.slots.starts[vertex, 0]))}"
            n_lost = counted(int(lost.sum()), "vertex is", "vertices are")
            raise MeshError(f"{n_lost} not finite, the first is {where}")
        if self._is_sound():
            return
        refused: dict[str, tuple[int, str]] = {}
        first_cell = 0
        for b, (kind, cells) in enumerate(self.blocks):
            if kind not in N_VERTICES:
                if kind not in refused:  # asked once: it counts the lines before it
                    refused[kind] = (
                        0,
                        "" if len(refused) > NAMED else self._place(b, 0, first_cell),
                    )
                refused[kind] = (refused[kind][0] + len(cells), refused[kind][1])
            elif cells.size and not (cells.min() >= 0 and cells.max() < n_vertices):
                bad = (cells < 0) | (cells >= n_vertices)
                rows = np.flatnonzero(bad.any(axis=1))
                row = int(rows[0])
                n_bad = counted(rows.size, f"{kind} cell names", f"{kind} cells name")
                raise MeshError(
                    f"{n_bad} vertices outside the {n_vertices} of the file, "
                    f"the first is {self._place(b, row, first_cell)}, "
                    f"vertex {int(cells[row][bad[row]][0])} (counted from 0)"
                )
            first_cell += len(cells)
        if refused:
            kinds = ", ".join(
                f"{count} of type {kind}{_reason(kind)} (the first is {where})"
                for kind, (count, where) in list(refused.items())[:NAMED]
            )
            more = f", and {len(refused) - NAMED} more types" if len(refused) > NAMED else ""
            raise MeshError(
                f"only first-order triangles and quads can be smoothed; there are {kinds}{more}"
            )
        if not self.faces:
            raise MeshError(
                f"no triangle or quad among {n_vertices} vertices and {first_cell} cells"
            )

    def _is_sound(self) -> bool:
        """Whether all cells can be read and have vertices, at one look: blocks may be many."""
        if not self.faces or any(kind not in N_VERTICES for kind, _ in self.blocks):
            return False
        every = np.concatenate([cells.ravel() for _, cells in self.blocks])
        return bool(every.size and every.min() >= 0 and every.max() < len(self.points))

    def _place(self, block: int, row: int, first_cell: int) -> str:
        where = f"cell {first_cell + row}"
        if self.places is not None and len(self.places[block]) > row:
            where += f", line {line_of(self.data, int(self.places[block][row]))}"
        return where

    def to_mesh(self, surface: Surface, geographic: bool | None = None) -> Mesh:
        """Mesh of the triangles and quads, which carries this content with it.

        Parameters
        ----------
        geographic
            Whether x and y are longitudes and latitudes; by default what the file says.
        """
        # Here, as Mesh brings Numba, which reading a list of formats does not need.
        from qsmooth.mesh import Mesh

        self.check()
        if geographic is None and self.geographic and no_degrees(self.points).any():
            self.notes += (
                "degrees are declared, but the coordinates can be none: taken as lengths",
            )
            geographic = False
        if geographic is not None:
            self.geographic = geographic
        regions = None
        if self.tags is not None:
            regions = np.concatenate([self.tags[b] for b in self.faces])
        mesh = Mesh(
            self.points,
            [self.blocks[b][1] for b in self.faces],
            surface="flat" if self.z_means else surface,
            regions=regions,
            fixed=self.held,
            geographic=bool(self.geographic),
        )
        return mesh.with_source(self, self.lines[0])

    def raise_level(self, holds: frozenset[str]) -> None:
        """Make z of the point data that is the level, where a format has no other place for it."""
        if self.level is None or self.points.shape[1] != 2 or self.level[0] not in self.point_data:
            return
        name, means = self.level
        z = np.asarray(self.point_data[name], np.float64)
        fits = "level" in holds or ("z" in holds and "point_data" not in holds)
        if fits and z.shape == (len(self.points),) and np.isfinite(z).all():
            self.points = np.column_stack((self.points, z))
            self.z_means = means
            self.point_data = {k: v for k, v in self.point_data.items() if k != name}

    def losses(self, holds: frozenset[str]) -> list[str]:
        """What a format that holds only `holds` cannot keep, in words."""
        lost = []
        if "level" in holds and self.tilted:
            lost.append("the tilt of the mesh's plane, as z is a value there")
        if self.geographic and "geographic" not in holds:
            lost.append("that x and y are degrees")
        if "z" in holds and self.z_means and self.plain_points.shape[1] == 3:
            lost.append("that z is a value")
        if not holds & {"z", "level"} and self.plain_points.shape[1] == 3:
            lost.append("z coordinates")
        for kind, name in (("line", "line"), ("vertex", "point")):
            count = sum(len(cells) for cells, _ in self.of_type(kind))
            if count and kind not in holds:
                lost.append(f"{count} {name} cells")
        face_tags = [tags for _, tags in self.of_type(*FACES) if tags is not None]
        if face_tags and "regions" not in holds:
            n_regions = len(np.unique(np.concatenate(face_tags)))
            if n_regions > 1:
                lost.append(f"{n_regions} regions")
        kept = {dim for dim, kind in ((0, "vertex"), (1, "line"), (2, "regions")) if kind in holds}
        names = [n for n, (_, dim) in self.names.items() if not ("names" in holds and dim in kept)]
        if names:
            lost.append("group names " + ", ".join(names))
        for what in ("point_data", "cell_data", "field_data", "point_sets", "cell_sets"):
            keys = [k for k in getattr(self, what) if k not in (*REGION_NAMES, *self.names)]
            if keys and what not in holds:
                lost.append(what.replace("_", " ") + " " + ", ".join(keys))
        return lost + list(self.extras)


def of_mesh(mesh: Mesh) -> FileContent:
    """FileContent with the mesh's present points: what its file held besides, if it had one."""
    source = mesh.source
    own: dict[str, Any] = {
        "points": np.array(mesh.points),
        "turned": mesh.topology.turned,
        "tilted": mesh.plane is not None,
        "geographic": mesh.geographic,
    }
    if isinstance(source, FileContent):
        fields = {
            key: value
            for key, value in vars(source).items()
            if key not in ("data", "slots", "data_slots", "beside", "pieces")
        }
        return FileContent(**{**fields, **own})
    blocks = [("triangle" if cells.shape[1] == 3 else "quad", cells) for cells in mesh.cells]
    tags = None
    if mesh.regions is not None:
        ends = np.cumsum([len(cells) for _, cells in blocks])
        tags = np.split(np.asarray(mesh.regions), ends[:-1])
    return FileContent(blocks=blocks, tags=tags, **own)


def region_tags(cell_data: Mapping[str, list[Any]], blocks: list[Block]) -> list[IndexArray] | None:
    """Tags from cell data with the name of a region, None where there is none."""
    for name in REGION_NAMES:
        arrays = [np.asarray(a) for a in cell_data.get(name, [])]
        if len(arrays) != len(blocks) or any(a.dtype.kind not in "iu" for a in arrays):
            continue
        if any(a.size != len(cells) for a, (_, cells) in zip(arrays, blocks, strict=True)):
            continue
        faces = [a for a, (kind, _) in zip(arrays, blocks, strict=True) if kind in FACES]
        # Gmsh writes physical tags of 0 where there are no physical groups.
        if name == "gmsh:physical" and not any(a.any() for a in faces):
            continue
        return [a.reshape(-1).astype(np.int64) for a in arrays]
    return None


def _reason(kind: str) -> str:
    if kind.startswith(("polygon", "pentagon", "hexagon")):
        return ""
    linear = kind.rstrip("0123456789")
    if linear in ("line", "triangle", "quad"):
        return " (second order or higher)"
    return " (3D or unknown)"
