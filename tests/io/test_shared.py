"""Every real mesh is read cell for cell and digit for digit, or refused for what it is."""

import re
import warnings
from pathlib import Path

import numpy as np
import pytest

from mesh_figures import assert_only_coordinates_differ, close, figures
from qsmooth.errors import MeshError, MeshWarning
from qsmooth.io import read_mesh, write_mesh

REFUSED = {
    "mesquite_quad9_part.vtk": r"101 of type quad9 \(second order or higher\).*line 456",
    "mesquite_polygons.vtk": "type polygon5.*cell 0, line 82",
    "libmesh_non_manifold.obj": "edge",
    "mesquite_paraboloid.vtk": "plane",
}
# What Mesh makes of a plane known to six digits is its own affair, and tested there.
FLAT = {"river_mixed_z.obj", "odense_mixed_z.obj"}


@pytest.fixture(scope="module")
def table(shared_meshes: Path) -> dict[str, list[str]]:
    rows = {}
    for line in (shared_meshes / "README.md").read_text().splitlines():
        cells = [cell.strip() for cell in line.strip("|").split(" | ")]
        if len(cells) == 11 and (match := re.match(r"`(\S+\.\w+)`$", cells[0].strip())):
            rows[match[1]] = cells
    return rows


def read_quietly(path: Path, surface: str = "auto"):
    if path.name == "mesquite_unstrquad.vtk":
        with pytest.warns(MeshWarning, match="CELLS says 80 integers, its 30 rows have 150"):
            return read_mesh(path, surface=surface)
    return read_mesh(path, surface=surface)


def names(shared_meshes: Path) -> list[str]:
    paths = [path for path in shared_meshes.iterdir() if path.is_file()]
    return sorted(p.name for p in paths if p.suffix not in (".md", ".py", ".poly"))


def test_every_file_is_in_the_table(shared_meshes, table):
    assert set(names(shared_meshes)) <= set(table)
    assert len(table) >= 42


def test_figures_of_every_file(shared_meshes, table):
    wrong = []
    for name in names(shared_meshes):
        path = shared_meshes / name
        if name in REFUSED:
            with pytest.raises(MeshError, match=REFUSED[name]) as caught:
                read_quietly(path)
            assert str(path) in str(caught.value)
            continue
        row = table[name]
        mesh = read_quietly(path, "flat" if name in FLAT else "auto")
        counts = {"tri": 0, "quad": 0}
        for number, kind in re.findall(r"(\d+) (tri|quad)\b", row[3]):
            counts[kind] = int(number)
        found = {
            kind: sum(len(c) for c in mesh.cells if c.shape[1] == size)
            for kind, size in (("tri", 3), ("quad", 4))
        }
        n_lines = sum(int(n) for n in re.findall(r"(\d+) line", row[3]))
        if found != counts or len(mesh.points) != int(row[4]):
            wrong.append(f"{name}: {found} and {len(mesh.points)} vertices")
        if n_lines and len(mesh.topology.lines) != n_lines:
            wrong.append(f"{name}: {len(mesh.topology.lines)} lines")
        flat = mesh.points if "figures in 3D" in row[10] else mesh.points[:, :2]
        has = figures(flat, mesh.cells)
        smallest, largest = row[5].split(" / ")
        aspect, mean = re.match(r"(\S+) \((\S+)\)", row[6]).groups()
        concave, crossed = map(int, row[7].split(" / "))
        for key, shown in (("min", smallest), ("max", largest), ("aspect", aspect), ("mean", mean)):
            if not close(has[key], shown):
                wrong.append(f"{name}: {key} {has[key]}, not {shown}")
        if (has["concave"], has["crossed"]) != (concave, crossed):
            wrong.append(f"{name}: {has['concave']} / {has['crossed']} concave / crossed")
    assert not wrong


def test_first_and_last_vertex_and_cell_digit_for_digit(shared_meshes):
    mesh = read_mesh(shared_meshes / "cantilever_crlf.su2")
    text = (shared_meshes / "cantilever_crlf.su2").read_text().split("NPOIN=")[1].splitlines()
    assert mesh.points.tolist() == [list(map(float, line.split()[:2])) for line in text[1:1112]]
    mesh = read_mesh(shared_meshes / "hughes_qt_cpe4.inp")
    assert mesh.points[0].tolist() == [-0.663058, 3.29301, 0]
    mesh = read_mesh(shared_meshes / "odense_mixed_z.obj", surface="flat")
    assert mesh.points[0].tolist() == [212437.6934946647, 6157513.13628371, -2.125976238395296]


def test_zones_of_su2_are_joined_and_are_regions(shared_meshes):
    mesh = read_mesh(shared_meshes / "wall_channel_two_zones.su2")
    assert len(mesh.points) == 2370 + 150
    assert np.bincount(mesh.regions).tolist() == [0, 2240, 116]
    assert mesh.cells[-1].min() == 2370
    assert len(mesh.topology.lines) == 38 + 38 + 62 + 58 + 29 + 29 + 4 + 29 + 4 + 29 + 4


@pytest.mark.parametrize(
    ("name", "regions"),
    [
        ("sfepy_tri932.mesh", 2),
        ("sfepy_square_triquad.mesh", 2),
        ("sfepy_apartment_tri.vtk", 3),
        ("dealii_two_holes.msh", 1),
        ("mfem_logo.mesh", 1),
    ],
)
def test_regions_come_from_the_file(shared_meshes, name, regions):
    assert len(np.unique(read_mesh(shared_meshes / name).regions)) == regions


def test_z_as_a_field_needs_to_be_said(shared_meshes):
    for name in ("river_mixed_z.obj", "odense_mixed_z.obj"):
        with pytest.raises(MeshError, match="surface"):
            read_mesh(shared_meshes / name)


def test_round_trip_of_every_file(shared_meshes, tmp_path):
    """Unsmoothed the same bytes; with some vertices moved the same but for their coordinates."""
    for name in names(shared_meshes):
        if name in REFUSED:
            continue
        path = shared_meshes / name
        # With six digits the one mesh in a tilted plane is in it by its boundary's rounding alone.
        surface = "flat" if name in FLAT | {"mesquite_plane_not_xy.vtk"} else "auto"
        mesh = read_quietly(path, surface)
        copy = tmp_path / name
        write_mesh(copy, mesh)
        assert copy.read_bytes() == path.read_bytes(), name

        rng = np.random.default_rng(1)
        points = mesh.points.copy()
        moved = rng.choice(len(points), max(1, len(points) // 3), replace=False)
        points[moved, :2] += 1e-7 * rng.random((len(moved), 2))
        write_mesh(copy, mesh.with_points(points))
        back = read_quietly(copy, surface)
        assert np.array_equal(back.points, points), name
        old, new = mesh.source, back.source
        assert [kind for kind, _ in new.blocks] == [kind for kind, _ in old.blocks]
        for (_, a), (_, b) in zip(old.blocks, new.blocks, strict=True):
            assert np.array_equal(a, b)
        assert (old.tags is None) == (new.tags is None)
        for a, b in zip(old.tags or [], new.tags or [], strict=True):
            assert np.array_equal(a, b)
        assert_only_coordinates_differ(path.read_bytes(), copy.read_bytes(), len(moved))


def test_formats_not_yet_read_are_refused_in_one_sentence(shared_meshes):
    """Other formats, some with an ending that has a reader: a mesh or a clear refusal."""
    more = shared_meshes / "more"
    if not more.is_dir():
        pytest.skip("the folder of more formats is not here")
    for path in sorted(path for path in more.rglob("*") if path.is_file()):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", MeshWarning)
            try:
                mesh = read_mesh(path, surface="flat")
            except MeshError as error:
                assert str(path) in str(error)  # noqa: PT017
                assert "\n" not in str(error)  # noqa: PT017
            else:
                assert mesh.n_cells > 0
