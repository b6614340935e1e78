"""Grids in pieces: joined rightly, written with a piece a part, and whole or not at all."""

import warnings

import numpy as np
import pytest

from qsmooth import Mesh, MeshError, quality, read_mesh, smooth, write_mesh
from qsmooth.cli import run
from qsmooth.examples import jittered
from qsmooth.io import files, vtu
from qsmooth.io.file_content import FileContent


def cells_of(mesh):
    return sorted(tuple(row) for block in mesh.cells for row in block.tolist())


def mixed():
    points = [(0, 0), (1, 0), (2, 0), (0, 1), (1.1, 0.9), (2, 1), (3, 0), (9, 9)]
    blocks = [[(0, 1, 4, 3), (1, 2, 5, 4)], [(2, 6, 5)]]
    return Mesh(np.array(points, float), [np.array(b) for b in blocks], regions=[1, 2, 2])


@pytest.mark.parametrize("n", [1, 2, 3, 7])
@pytest.mark.parametrize("make", [lambda: jittered(6, 5), mixed])
def test_pieces_are_cut_and_joined(tmp_path, make, n):
    mesh = make()
    write_mesh(tmp_path / "a.pvtu", mesh, pieces=n)
    there = sorted(path.name for path in tmp_path.iterdir())
    assert there == ["a.pvtu", *(f"a_{k}.vtu" for k in range(min(n, mesh.n_cells)))]
    back = read_mesh(tmp_path / "a.pvtu")
    assert np.array_equal(back.points[:, :2], mesh.points)
    assert cells_of(back) == cells_of(mesh)
    assert back.source.point_data["GlobalNodeIds"].tolist() == list(range(mesh.n_vertices))
    if mesh.regions is not None:
        assert sorted(back.regions.tolist()) == sorted(mesh.regions.tolist())
    n_points = [len(read_mesh(tmp_path / name).points) for name in there[1:]]
    assert sum(n_points) >= mesh.n_vertices
    assert max(n_points) < mesh.n_vertices or n == 1


def test_a_smoothed_file_changes_in_coordinates_alone(tmp_path):
    write_mesh(tmp_path / "a.pvtu", jittered(8, 8), pieces=3)
    mesh = read_mesh(tmp_path / "a.pvtu")
    result = smooth(mesh, "star")
    write_mesh(tmp_path / "b.pvtu", result.mesh, pieces=8)  # it keeps those that it has
    old, new = ((tmp_path / f"{name}.pvtu").read_text() for name in "ab")
    assert new == old.replace("a_", "b_")
    assert not (tmp_path / "b_3.vtu").exists()
    back = read_mesh(tmp_path / "b.pvtu")
    assert np.array_equal(back.points, result.points)
    assert [c.tolist() for c in back.cells] == [c.tolist() for c in mesh.cells]
    for k in range(3):
        old, new = ((tmp_path / f"{name}_{k}.vtu").read_bytes().split(b"\n") for name in "ab")
        assert sum(a != b for a, b in zip(old, new, strict=True)) == 1  # the block of points


def test_in_its_place_old_pieces_go_and_others_stay(tmp_path):
    path = tmp_path / "a.pvtu"
    write_mesh(path, jittered(8, 8), pieces=3)
    (tmp_path / "a_9.vtu").write_text("somebody's")
    write_mesh(path, smooth(read_mesh(path), "star").mesh)
    there = {p.name for p in tmp_path.iterdir()}
    assert there == {"a.pvtu", "a_9.vtu", "a-1_0.vtu", "a-1_1.vtu", "a-1_2.vtu"}
    assert quality(read_mesh(path)).n_invalid == 0


@pytest.mark.parametrize("fails", [0, 1, 2])
def test_what_fails_half_way_leaves_all_as_it_was(tmp_path, monkeypatch, fails):
    path = tmp_path / "a.pvtu"
    write_mesh(path, jittered(6, 6), pieces=2)
    before = {p.name: p.read_bytes() for p in tmp_path.iterdir()}
    mesh, calls, usual = smooth(read_mesh(path), "star").mesh, [], files.replace_bytes

    def failing(target, data):
        calls.append(target)
        if len(calls) > fails:
            raise OSError(28, "No space left on device", str(target))
        usual(target, data)

    monkeypatch.setattr(files, "replace_bytes", failing)
    with pytest.raises(MeshError, match="No space left"):
        write_mesh(path, mesh)
    assert {p.name: p.read_bytes() for p in tmp_path.iterdir()} == before


def piece(points, cells, point_data=None, cell_data=None):
    content = FileContent(
        np.pad(np.array(points, float), ((0, 0), (0, 1))),
        [("quad", np.array(cells))],
        point_data=point_data or {},
        cell_data={name: [np.array(v)] for name, v in (cell_data or {}).items()},
    )
    return vtu.write(content)


def put(folder, *pieces):
    sources = "".join(f'<Piece Source="{k}.vtu"/>' for k in range(len(pieces)))
    (folder / "main.pvtu").write_text(
        f'<VTKFile type="PUnstructuredGrid"><PUnstructuredGrid GhostLevel="0">{sources}'
        "</PUnstructuredGrid></VTKFile>"
    )
    for k, data in enumerate(pieces):
        (folder / f"{k}.vtu").write_bytes(data)
    return folder / "main.pvtu"


LEFT = [(0, 0), (1, 0), (1, 1), (0, 1)]
RIGHT = [(1, 0), (2, 0), (2, 1), (1, 1)]


def test_without_global_numbers_places_join_and_ghosts_go(tmp_path):
    both = [*LEFT, (2, 0), (2, 1)]
    ghosts = {"vtkGhostType": np.array([0, 1], np.uint8), "p": np.array([1.0, 9.0])}
    path = put(
        tmp_path,
        piece(both, [(0, 1, 2, 3), (1, 4, 5, 2)], {"h": np.arange(6.0)}, ghosts),
        piece(RIGHT, [(0, 1, 2, 3)], {"h": np.arange(10.0, 14.0)},
              {"vtkGhostType": np.zeros(1, np.uint8), "p": np.array([2.0])}),
    )  # fmt: skip
    mesh = read_mesh(path)
    assert mesh.points[:, :2].tolist() == [list(map(float, p)) for p in both]
    assert cells_of(mesh) == [(0, 1, 2, 3), (1, 4, 5, 2)]
    assert mesh.source.point_data["h"].tolist() == [0.0, 1.0, 2.0, 3.0, 4.0, 5.0]
    assert [a.tolist() for a in mesh.source.cell_data["p"]] == [[1.0], [2.0]]
    assert "vtkGhostType" not in mesh.source.cell_data


def test_two_points_at_one_place_in_a_piece_stay_two(tmp_path):
    slit = [(0, 0), (1, 0), (1, 1), (0, 1), (1, 0), (2, 0), (2, 1), (1, 1)]
    path = put(tmp_path, piece(slit, [(0, 1, 2, 3), (4, 5, 6, 7)]))
    assert read_mesh(path).n_vertices == 8


def test_global_numbers_join_what_they_say(tmp_path):
    ids = {"GlobalNodeIds": np.array([0, 2, 3, 1])}, {"GlobalNodeIds": np.array([2, 4, 5, 3])}
    path = put(tmp_path, piece(LEFT, [(0, 1, 2, 3)], ids[0]), piece(RIGHT, [(0, 1, 2, 3)], ids[1]))
    assert cells_of(read_mesh(path)) == [(0, 2, 3, 1), (2, 4, 5, 3)]
    moved = [(1.5, 0), *RIGHT[1:]]
    path = put(tmp_path, piece(LEFT, [(0, 1, 2, 3)], ids[0]), piece(moved, [(0, 1, 2, 3)], ids[1]))
    with pytest.raises(MeshError, match="vertex 2 lies elsewhere in another piece"):
        read_mesh(path)


def test_what_is_wrong_is_named(tmp_path):
    path = put(tmp_path, piece(LEFT, [(0, 1, 2, 3)]), b"<VTKFile")
    with pytest.raises(MeshError, match=r"piece '1\.vtu': no valid XML"):
        read_mesh(path)
    (tmp_path / "1.vtu").unlink()
    with pytest.raises(MeshError, match=r"1\.vtu.*No such file"):
        read_mesh(path)
    path.write_text('<VTKFile type="PUnstructuredGrid"><PUnstructuredGrid/></VTKFile>')
    with pytest.raises(MeshError, match="the file has no Piece"):
        read_mesh(path)
    path.write_text(
        '<VTKFile type="PUnstructuredGrid"><PUnstructuredGrid><Piece Source="0.vtu"/>'
        '<Piece Source="0.vtu"/></PUnstructuredGrid></VTKFile>'
    )
    with pytest.raises(MeshError, match=r"'0\.vtu' is the file of two pieces"):
        read_mesh(path)


def test_vtk_reads_it(tmp_path):
    pyvista = pytest.importorskip("pyvista")
    mesh = mixed()
    write_mesh(tmp_path / "a.pvtu", mesh, pieces=2)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        grid = pyvista.read(tmp_path / "a.pvtu")
    assert grid.n_cells == 3
    ids = np.asarray(grid.point_data["GlobalNodeIds"])
    assert np.array_equal(np.asarray(grid.points)[:, :2], mesh.points[ids])


def test_from_the_shell(tmp_path, capsys):
    write_mesh(tmp_path / "a.off", jittered(6, 6))
    there = str(tmp_path / "a.off"), str(tmp_path / "b.pvtu")
    assert run(["convert", *there, "--pieces", "4"]) == 0
    assert run(["smooth", there[1], "-o", str(tmp_path / "c.pvtu"), "-m", "star"]) == 0
    assert len(list(tmp_path.glob("c_*.vtu"))) == 4
    assert "Nothing was lost" in capsys.readouterr().out


def test_merged_pieces_are_written_anew(tmp_path):
    left = jittered(4, 4)
    right = np.column_stack([left.points[:, 0].max() + left.points[:, 0], left.points[:, 1]])
    apart = Mesh(np.vstack([left.points, right]), [np.vstack([left.cells[0], left.cells[0] + 25])])
    write_mesh(tmp_path / "a.pvtu", apart, pieces=2)
    assert read_mesh(tmp_path / "a.pvtu").n_vertices == 50
    paths = [str(tmp_path / name) for name in ("a.pvtu", "b.pvtu")]
    assert run(["smooth", paths[0], "-o", paths[1], "-m", "star", "--merge"]) == 0
    back = read_mesh(tmp_path / "b.pvtu")
    assert (back.n_vertices, back.n_cells) == (45, 32)
    assert quality(back).n_invalid == 0


def test_pieces_made_anew_are_described_anew(tmp_path):
    write_mesh(tmp_path / "a.pvtu", jittered(4, 4), pieces=1)
    paths = [str(tmp_path / name) for name in ("a.pvtu", "b.pvtu")]
    assert run(["smooth", paths[0], "-o", paths[1], "-m", "star", "--with-quality"]) == 0
    main, piece = ((tmp_path / name).read_text() for name in ("b.pvtu", "b_0.vtu"))
    assert main.count("<PDataArray") == piece.count("<DataArray") - 3  # those of its cells
    mesh = read_mesh(paths[0])
    mesh.source.point_data["depth"] = np.arange(25.0)
    mesh.source.changed = frozenset({"depth"})
    write_mesh(tmp_path / "c.pvtu", mesh)
    assert 'Name="depth"' in (tmp_path / "c.pvtu").read_text()
