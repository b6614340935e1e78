"""Real meshes of finite element programs: each read as its table says, and written back."""

import re
import warnings
from pathlib import Path

import numpy as np
import pytest

from mesh_figures import assert_only_coordinates_differ, close, figures
from qsmooth.errors import MeshError, MeshWarning
from qsmooth.io import read_mesh, write_mesh
from qsmooth.io.registry import named

# Line cells of each; the rest of what is known stands in the table beside the files.
LINES = {
    "libmesh_mixed_named.xda": 22,
    "libmesh_h_channel_v070.xda": 34,
    "libmesh_quad4_v180.xda": 8,
    "salome_square.unv": 20,
    "test46.unv": 32,
    "test1427.unv": 48,
    "mfem_square_mixed_nodes.mesh": 16,
    "mfem_rectangle_linear_nodes.mesh": 20,
    "mfem_periodic_hexagon_l2.mesh": 0,
    "freefem_aile.msh": 40,
    "freefem_triqa.msh": 113,
    "freefem_torture.msh": 35,
    "hohq_half_circle_ism.mesh": 28,
    "hohq_ice_cream_ismv2.mesh": 142,
    "hohq_bone_materials_ismmm.mesh": 228,
    "hohq_ice_cream_abaqus.inp": 104,
}


@pytest.fixture(scope="module")
def more(shared_meshes: Path) -> Path:
    folder = shared_meshes / "more"
    if not folder.is_dir():
        pytest.skip("the folder of more formats is not here")
    return folder


@pytest.fixture(scope="module")
def table(more: Path) -> dict[str, list[str]]:
    lines = (more / "README.md").read_text().splitlines()
    rows = [line.strip("|").split("|") for line in lines if line.startswith("|")]
    return {row[0].rstrip("/"): row for row in rows[2:]}


def read(path: Path):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", MeshWarning)
        return read_mesh(path)


@pytest.mark.parametrize("name", LINES)
def test_counts_and_angles(more, table, name):
    mesh = read(more / name)
    counts = dict.fromkeys("vtq", 0)
    counts |= {kind: int(n) for n, kind in re.findall(r"(\d+)([vtq])", table[name][2])}
    corners = [cells.shape[1] for cells in mesh.cells for _ in cells]
    assert corners.count(3) == counts["t"]
    assert corners.count(4) == counts["q"]
    places = re.search(r"(\d+) places", table[name][5])
    assert mesh.n_vertices == int(places[1]) if places else counts["v"]
    assert len(mesh.topology.lines) == LINES[name]
    smallest, largest = table[name][4].split("/")
    found = figures(mesh.points[:, :2], mesh.cells)
    assert close(found["min"], smallest)
    assert close(found["max"], largest)


@pytest.mark.parametrize("name", LINES)
def test_only_coordinates_change(more, tmp_path, name):
    mesh = read(more / name)
    copy = tmp_path / name
    write_mesh(copy, mesh)
    assert copy.read_bytes() == (more / name).read_bytes()
    points = mesh.points.copy()
    moved = np.arange(mesh.n_vertices) % 3 == 1
    if "curved sides" in mesh.source.extras:
        moved = inner(mesh)
    points[moved, :2] += 1e-7
    n_moved = int(moved.sum())
    write_mesh(copy, mesh.with_points(points))
    back = read(copy)
    assert np.array_equal(back.points, points)
    for old, new in zip(mesh.source.blocks, back.source.blocks, strict=True):
        assert old[0] == new[0]
        assert np.array_equal(old[1], new[1])
    n_lines = 4 * n_moved  # of a vertex with copies
    assert_only_coordinates_differ((more / name).read_bytes(), copy.read_bytes(), n_lines)


def inner(mesh, every: int = 1) -> np.ndarray:
    """Mark vertices that nothing holds, one of so many."""
    held = mesh.topology.is_boundary.copy()
    held[mesh.topology.lines.ravel()] = True
    free = np.zeros(mesh.n_vertices, bool)
    free[np.flatnonzero(~held)[::every]] = True
    return free


def names_of(mesh, dimension: int) -> list[str]:
    return [name for name, (_, of) in mesh.source.names.items() if of == dimension]


def test_libmesh_names(more):
    mesh = read(more / "libmesh_mixed_named.xda")
    assert np.bincount(mesh.regions).tolist() == [15, 30]
    assert names_of(mesh, 2) == ["quads"]
    assert names_of(mesh, 1) == ["bottom", "top", "left", "right"]
    assert list(mesh.source.point_sets) == ["bottom", "top", "left", "right"]
    assert mesh.source.point_sets["left"].tolist() == [21, 24, 28, 31, 34, 38]
    mesh = read(more / "libmesh_quad4_v180.xda")
    assert mesh.regions.tolist() == [10, 11, 12, 13]
    assert len(names_of(mesh, 2)) == len(names_of(mesh, 1)) == 4
    mesh = read(more / "libmesh_h_channel_v070.xda")
    sides = mesh.source.tags[-1]
    assert np.bincount(sides).tolist() == [1, 1, 2, 30]


def test_salome_groups_and_orientation(more):
    mesh = read(more / "salome_square.unv")
    assert names_of(mesh, 1) == ["1", "2", "3", "4"]
    assert [len(sets[0]) for sets in mesh.source.cell_sets.values()] == [5, 5, 5, 5]
    mesh = read(more / "test46.unv")
    assert np.bincount(mesh.regions).tolist() == [0, 40, 24]
    # Two groups of one name, faces and lines.
    assert [len(rows) for rows in mesh.source.cell_sets["1"]] == [8, 24]
    for name in ("test46.unv", "test1427.unv"):
        mesh = read(more / name)
        x, y = mesh.points[mesh.cells[0]][..., 0], mesh.points[mesh.cells[0]][..., 1]
        assert ((x * np.roll(y, -1, 1) - np.roll(x, -1, 1) * y).sum(axis=1) < 0).all()


def test_columns_of_a_universal_file_stay(more, tmp_path):
    mesh = read(more / "salome_square.unv")
    points = mesh.points / 3
    write_mesh(tmp_path / "a.unv", mesh.with_points(points))
    old = (more / "salome_square.unv").read_bytes().splitlines()
    new = (tmp_path / "a.unv").read_bytes().splitlines()
    assert list(map(len, new)) == list(map(len, old))


def test_a_periodic_mesh_has_a_vertex_for_each_place(more, tmp_path):
    path = more / "mfem_periodic_hexagon_l2.mesh"
    with pytest.warns(MeshWarning, match="12 vertices have 19 places"):
        mesh = read_mesh(path)
    assert mesh.regions.tolist() == 4 * [1] + 4 * [2] + 4 * [3]
    assert int(mesh.topology.is_boundary.sum()) == 12
    centre = int(np.argmin(np.abs(mesh.points).sum(axis=1)))
    points = mesh.points.copy()
    points[centre] = [0.1, 0.05]
    write_mesh(tmp_path / "a.mesh", mesh.with_points(points))
    changed = (tmp_path / "a.mesh").read_text().splitlines()
    assert sum(line.split() == ["0.1", "0.05"] for line in changed) == 3  # a copy in each cell
    assert np.array_equal(read(tmp_path / "a.mesh").points[centre], [0.1, 0.05])


def test_freefem_labels(more):
    mesh = read(more / "freefem_triqa.msh")
    assert np.unique(mesh.regions).tolist() == [0]
    assert np.unique(mesh.source.tags[1]).tolist() == [1, 2, 3, 4]


NAMES = {
    "hohq_half_circle_ism.mesh": (["circle", "bottom"], []),
    "hohq_ice_cream_ismv2.mesh": (["outerCircle", "cone1", "iceCream", "cone2", "hole"], []),
    "hohq_bone_materials_ismmm.mesh": (
        ["outer", "Circle1", "Circle2"],
        ["Muscle", "Bone", "Marrow"],
    ),
    "hohq_ice_cream_abaqus.inp": (["OuterCircle", "RightSlant", "IceCream", "LeftSlant"], []),
}


@pytest.mark.parametrize("name", NAMES)
def test_names_and_curves_of_hohqmesh(more, tmp_path, name):
    with pytest.warns(MeshWarning, match="curved sides stay as they are"):
        mesh = read_mesh(more / name)
    sides, materials = NAMES[name]
    assert sorted(names_of(mesh, 1)) == sorted(sides)
    assert names_of(mesh, 2) == materials
    points = mesh.points.copy()
    points[mesh.topology.lines[0], 0] += 1e-3
    with pytest.raises(MeshError, match="2 vertices at the ends of curved sides have moved"):
        write_mesh(tmp_path / "a", mesh.with_points(points))
    assert not (tmp_path / "a").exists()
    with pytest.warns(MeshWarning, match="curved sides"):
        write_mesh(tmp_path / "a.vtk", mesh.with_points(points))


def test_edges_of_ism_v2_are_those_of_hohqmesh(more):
    path = more / "hohq_ice_cream_ismv2.mesh"
    rows = path.read_text().splitlines()[2 + 454 :][:839]
    mesh = read(path)
    written = named("ism").write(mesh.source).decode().splitlines()[2 + 454 :][:839]
    assert [row.split() for row in written] == [row.split() for row in rows]
