"""Tecplot ASCII: finite element zones by points or by blocks, their variables kept."""

from __future__ import annotations

import re
from typing import NoReturn

import numpy as np

from qsmooth._types import FloatArray, IndexArray
from qsmooth.errors import MeshError
from qsmooth.io.file_content import FACES, REGION_NAMES, Block, FileContent, region_tags
from qsmooth.io.in_place import InPlace
from qsmooth.io.tecplot_header import Zone, headers
from qsmooth.io.text import EXACT, Text, finish, line_of, rows_of, runs

NAME = "tecplot"
ENDINGS = (".dat", ".tec")
HOLDS = frozenset(("z", "regions", "point_data"))

START = re.compile(rb"(?i)(?:\s|#[^\r\n]*[\r\n])*(?:title|variables|filetype|zone)\b")
# Names of coordinates, in lower case and without a unit; else they are the first variables.
AXES = tuple((a, f"coordinate{a}", f"{a}-coordinate", f"{a}coord", f"{a}_coord") for a in "xyz")
UNIT = re.compile(r"[\s,\[({].*")


def sniff(head: bytes) -> bool:
    """Whether a file that starts so is Tecplot's."""
    return START.match(head) is not None


def read(data: bytes) -> FileContent:
    """Read Tecplot; zones become regions, or else a variable at cells with such a name."""
    return _Reader(data).content()


class _Reader:
    """Goes through the zones of one file."""

    def __init__(self, data: bytes) -> None:
        self.variables, self.zones, clean, self.extras = headers(data)
        self.text = Text(clean)
        if len(self.variables) < 2:
            raise MeshError("VARIABLES names less than two")
        self.axes = _axes(self.variables)
        self.firsts: list[int] = []  # first vertex of each zone
        # of each zone with coordinates of its own: the tokens of each variable at its vertices
        self.nodes: list[dict[int, IndexArray]] = []
        self.blocks: list[Block] = []
        self.tags: list[IndexArray] = []
        self.places: list[IndexArray] = []
        self.cell_data: list[dict[int, FloatArray]] = []

    def content(self) -> FileContent:
        n_vertices = 0
        for number, zone in enumerate(self.zones):
            owned = [v for v in range(len(self.variables)) if v not in zone.shared]
            tokens, token = self.columns(zone, owned)
            sources = {zone.shared[axis] for axis in self.axes if axis in zone.shared}
            if not sources:
                self.firsts.append(n_vertices)
                n_vertices += zone.n_nodes
                self.nodes.append({v: t for v, t in tokens.items() if v not in zone.at_cells})
                if zone.connectivity is not None:
                    self.fail(zone, "cells of another zone on places of its own: a moving mesh")
            else:
                self.firsts.append(self.shared_first(zone, number, sources))
                if any(v not in zone.at_cells for v in owned):
                    self.extras.append(f"values of zone {number + 1}")
            if zone.connectivity is None:
                values = {v: self.text.numbers_at(tokens[v]) for v in owned if v in zone.at_cells}
                token = self.cells(zone, number, token, values)
            if token != zone.last:
                self.fail(
                    zone, f"{token - zone.first} numbers expected, {zone.last - zone.first} found"
                )
        return self.assemble()

    def fail(self, zone: Zone, what: str) -> NoReturn:
        raise MeshError(f"line {line_of(self.text.data, zone.offset)}: {what}")

    def columns(self, zone: Zone, owned: list[int]) -> tuple[dict[int, IndexArray], int]:
        """Tokens of each variable, and the first behind all of them."""
        zone.first = int(np.searchsorted(self.text.starts, zone.begin))
        zone.last = int(np.searchsorted(self.text.starts, zone.end))
        sizes = [zone.n_cells if v in zone.at_cells else zone.n_nodes for v in owned]
        if zone.first + sum(sizes) > zone.last:
            self.fail(zone, f"{sum(sizes)} values expected, {zone.last - zone.first} found")
        if zone.by_point:
            rows = zone.first + len(owned) * np.arange(zone.n_nodes)
            return {v: rows + k for k, v in enumerate(owned)}, zone.first + sum(sizes)
        ends = zone.first + np.cumsum([0, *sizes])
        tokens = {v: np.arange(ends[k], ends[k + 1]) for k, v in enumerate(owned)}
        return tokens, int(ends[-1])

    def shared_first(self, zone: Zone, number: int, sources: set[int]) -> int:
        """First vertex of the zone whose coordinates this one shares."""
        source = sources.pop()
        if sources or any(axis not in zone.shared for axis in self.axes):
            self.fail(zone, "coordinates that are partly of another zone")
        if not 0 <= source < number or self.zones[source].n_nodes != zone.n_nodes:
            self.fail(zone, f"coordinates of zone {source + 1}, which has not as many nodes")
        return self.firsts[source]

    def cells(self, zone: Zone, number: int, token: int, values: dict[int, FloatArray]) -> int:
        """Cells of a zone; quads that have a corner twice are triangles. Gives the next token."""
        n, size = zone.n_cells, zone.n_corners
        table = self.text.numbers(token, token + n * size, np.int64).reshape(n, size) - 1
        if n and not (table.min() >= 0 and table.max() < zone.n_nodes):
            row = int(np.argmax(((table < 0) | (table >= zone.n_nodes)).any(axis=1)))
            self.text.fail(token + size * row, f"a cell names a node outside 1..{zone.n_nodes}")
        twice = slim = np.zeros(n, np.bool_)
        if size == 4:
            twice = table == np.roll(table, -1, axis=1)
            slim = twice.any(axis=1)
        places = self.text.starts[token + size * np.arange(n)]
        for i, j in runs(slim.astype(np.int64)) if slim.any() else [(0, n)]:
            rows, kind = table[i:j], zone.kind
            if slim[i]:
                keep = np.ones((j - i, 4), np.bool_)
                keep[np.arange(j - i), np.argmax(twice[i:j], axis=1)] = False
                rows, kind = rows[keep].reshape(-1, 3), "triangle"
            self.blocks.append((kind, rows + self.firsts[number]))
            self.tags.append(np.full(j - i, number + 1))
            self.places.append(places[i:j])
            self.cell_data.append({v: part[i:j] for v, part in values.items()})
        return token + n * size

    def assemble(self) -> FileContent:
        def at_vertices(v: int) -> tuple[FloatArray, IndexArray]:
            tokens = np.concatenate([columns[v] for columns in self.nodes])
            return self.text.numbers_at(tokens), tokens

        if not self.nodes:
            raise MeshError("the file has no ZONE")
        if any(axis not in columns for columns in self.nodes for axis in self.axes):
            raise MeshError("coordinates at cells, not at vertices")
        # In a file by blocks the tokens of a zone's x come before those of its y, by points not:
        # a column at a time they ascend.
        axes = [at_vertices(axis) for axis in self.axes]
        point_data: dict[str, FloatArray] = {}
        data_slots: dict[str, InPlace] = {}
        for v, name in enumerate(self.variables):
            if v not in self.axes and all(v in columns for columns in self.nodes):
                values, tokens = at_vertices(v)
                point_data[name] = values
                data_slots[name] = self.text.slots(tokens[:, None])
        cell_data = {}
        for v, name in enumerate(self.variables):
            if self.cell_data and all(v in values for values in self.cell_data):
                parts = [values[v] for values in self.cell_data]
                if name in REGION_NAMES and all(map(_are_whole, parts)):
                    parts = [part.astype(np.int64) for part in parts]
                cell_data[name] = parts
        tags: list[IndexArray] | None = self.tags
        names = self.names()
        faces = {
            int(t[0]) for (kind, _), t in zip(self.blocks, self.tags, strict=True) if kind in FACES
        }
        if len(faces) == 1:
            tags = region_tags(cell_data, self.blocks)
            names = {name: pair for name, pair in names.items() if pair[1] != 2}
        if tags is None and names:
            tags = self.tags
        return FileContent(
            np.stack([values for values, _ in axes], axis=1),
            self.blocks,
            tags,
            names,
            point_data=point_data,
            cell_data=cell_data,
            extras=tuple(dict.fromkeys(self.extras)),
            slots=self.text.slots(np.stack([tokens for _, tokens in axes], axis=1)),
            data_slots=data_slots,
            places=self.places,
        )

    def names(self) -> dict[str, tuple[int, int]]:
        """Names of zones with cells; one that comes again is set apart."""
        names: dict[str, tuple[int, int]] = {}
        for number, zone in enumerate(self.zones, start=1):
            if not zone.title or zone.connectivity is not None:
                continue
            name = zone.title if zone.title not in names else f"{zone.title}_{number}"
            names[name] = (number, 1 if zone.kind == "line" else 2)
        return names


def _are_whole(values: FloatArray) -> bool:
    """Whether all are integers that are known exactly."""
    return bool(((np.abs(values) < EXACT) & (values == np.floor(values))).all())


def _axes(variables: list[str]) -> list[int]:
    """Numbers of the variables that are coordinates."""
    plain = [UNIT.sub("", name.strip().lower()) for name in variables]
    found = [next((k for k, n in enumerate(plain) if n in names), -1) for names in AXES]
    if min(found[:2]) < 0:
        return [0, 1]
    return [k for k in found if k >= 0]


def write(content: FileContent) -> bytes:
    """Write one zone by blocks; regions are a variable at cells, triangles quads of three nodes."""
    points = content.plain_points
    columns = {name: points[:, k] for k, name in enumerate("xyz"[: points.shape[1]])}
    for name, values in content.point_data.items():
        array = np.asarray(values)
        if array.dtype.kind not in "fiub":
            continue
        table = array.reshape(len(points), -1).T
        for k, column in enumerate(table):
            columns[name if len(table) == 1 else f"{name}_{k}"] = column
    faces = content.of_type(*FACES)
    cells = np.concatenate([np.pad(c, ((0, 0), (0, 4 - c.shape[1])), "edge") for c, _ in faces])
    only_triangles = all(c.shape[1] == 3 for c, _ in faces)
    tags = None if content.tags is None else np.concatenate([t for _, t in faces if t is not None])
    names = [*columns, "region"] if tags is not None else [*columns]
    kind = "FETRIANGLE" if only_triangles else "FEQUADRILATERAL"
    lines = [
        'TITLE = "mesh"',
        "VARIABLES = " + ", ".join(f'"{name}"'.replace("\n", " ") for name in names),
        f"ZONE NODES={len(points)}, ELEMENTS={len(cells)}, DATAPACKING=BLOCK, ZONETYPE={kind}",
    ]
    if tags is not None:
        lines.append(f"VARLOCATION=([{len(names)}]=CELLCENTERED)")
    for column in columns.values():
        lines += rows_of(column)
    if tags is not None:
        lines += rows_of(tags)
    return finish([*lines, *rows_of(cells[:, : 3 if only_triangles else 4] + 1)])
