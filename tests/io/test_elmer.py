"""Meshes that are folders: read, written with one file replaced, whole or not at all."""

import shutil
import warnings
from pathlib import Path

import numpy as np
import pytest

from format_samples import POINTS, QUADS, TRIANGLES
from qsmooth.cli import run
from qsmooth.errors import MeshError, MeshWarning
from qsmooth.io import files as io_files
from qsmooth.io import formats, read_mesh, write_mesh
from qsmooth.mesh import Mesh

FILES = {
    "mesh.header": "8 3 3\n4\n101 1\n202 2\n303 1\n404 2\n",
    "mesh.nodes": "".join(f"{10 * i + 5} -1 {x} {y} 0.0\n" for i, (x, y) in enumerate(POINTS)),
    "mesh.elements": "1 1 404 5 15 45 35\n2 2 404 15 25 55 45\n3 2 303 25 65 55\n",
    "mesh.boundary": "1 9 1 0 202 5 15\n2 9 2 0 202 15 25\n3 4 0 0 101 75\n",
    "mesh.names": (
        "! ----- names for bodies -----\n$ left part = 1\n$ right = 2\n"
        "! ----- names for boundaries -----\n$ shore = 9\n"
    ),
}


@pytest.fixture
def folder(tmp_path) -> Path:
    path = tmp_path / "plate"
    path.mkdir()
    for name, text in FILES.items():
        (path / name).write_text(text)
    return path


def content(path: Path) -> dict[str, bytes]:
    return {file.name: file.read_bytes() for file in path.iterdir()}


def move(mesh: Mesh) -> Mesh:
    points = mesh.points.copy()
    points[4, :2] += [1 / 3, -1e-17]
    return mesh.with_points(points)


def test_reading(folder):
    mesh = read_mesh(folder)
    assert mesh.points[:, :2].tolist() == [list(map(float, p)) for p in POINTS]
    assert [tuple(row) for cells in mesh.cells for row in cells.tolist()] == [*QUADS, *TRIANGLES]
    assert mesh.regions.tolist() == [1, 2, 2]
    assert mesh.source.names == {"left part": (1, 2), "right": (2, 2), "shore": (9, 1)}
    assert mesh.topology.lines.tolist() == [[0, 1], [1, 2]]
    assert "elmer" in formats()
    assert read_mesh(folder, format="elmer").n_cells == 3


def test_only_coordinates_change(folder, tmp_path):
    mesh = read_mesh(folder)
    write_mesh(tmp_path / "copy", mesh)
    before = content(folder)
    assert content(tmp_path / "copy") == before
    (folder / "case.sif").write_text("kept")
    write_mesh(folder, move(mesh))
    after = content(folder)
    assert after.pop("case.sif") == b"kept"
    assert np.array_equal(read_mesh(folder).points, move(mesh).points)
    assert {name for name in before if before[name] != after[name]} == {"mesh.nodes"}
    old, new = before["mesh.nodes"].split(), after["mesh.nodes"].split()
    assert sum(a != b for a, b in zip(old, new, strict=True)) == 1  # 0.9 - 1e-17 is 0.9


def test_a_new_folder_from_any_mesh(folder, tmp_path):
    mesh = Mesh(
        np.array(POINTS, float) / 3, [np.array(QUADS), np.array(TRIANGLES)], regions=[0, 1, 1]
    )
    write_mesh(tmp_path / "new", mesh, format="elmer")
    back = read_mesh(tmp_path / "new")
    assert np.array_equal(back.points[:, :2], mesh.points)
    assert back.regions.tolist() == [1, 2, 2]
    assert sorted(content(tmp_path / "new")) == sorted(FILES.keys() - {"mesh.names"})

    other = tmp_path / "a.msh"
    write_mesh(other, read_mesh(folder))
    write_mesh(tmp_path / "again", read_mesh(other), format="elmer")
    back = read_mesh(tmp_path / "again")
    assert back.source.names == {"left_part": (1, 2), "right": (2, 2), "shore": (9, 1)}
    assert back.topology.lines.tolist() == [[0, 1], [1, 2]]
    parents = [
        row.split()[2:4] for row in (tmp_path / "again/mesh.boundary").read_text().splitlines()
    ]
    assert parents == [["1", "0"], ["2", "0"], ["0", "0"]]


def test_another_mesh_in_the_folder_is_left_as_it_is(folder, tmp_path):
    before = content(folder)
    other = Mesh([(0, 0), (1, 0), (0, 1)], [(0, 1, 2)])
    with pytest.raises(MeshError, match=f"cannot write '{folder}': another mesh is in this folder"):
        write_mesh(folder, other, format="elmer")
    assert content(folder) == before
    (tmp_path / "empty").mkdir()
    (tmp_path / "empty/case.sif").write_text("kept")
    write_mesh(tmp_path / "empty", other, format="elmer")
    assert read_mesh(tmp_path / "empty").n_cells == 1
    (tmp_path / "file").write_text("x")
    with pytest.raises(MeshError, match="It is a file, and the format takes a folder"):
        write_mesh(tmp_path / "file", other, format="elmer")


@pytest.mark.parametrize("exists", [False, True])
def test_what_fails_half_way_leaves_no_mesh(folder, tmp_path, monkeypatch, exists):
    mesh, out = read_mesh(folder), tmp_path / "out"
    if exists:
        out.mkdir()
    replace, calls = io_files.replace_bytes, []

    def fail(path, data):
        calls.append(path)
        if len(calls) == 3:
            raise OSError(28, "No space left on device")
        replace(path, data)

    monkeypatch.setattr(io_files, "replace_bytes", fail)
    with pytest.raises(MeshError, match="No space left"):
        write_mesh(out, mesh)
    assert sorted(p.name for p in tmp_path.iterdir()) == (["out"] if exists else []) + ["plate"]
    assert not exists or content(out) == {}


WRONG = [
    ("mesh.header", "8 3 3", "9 3 3", "mesh.nodes, line 8: 9 nodes of the header take 45 numbers"),
    ("mesh.header", "8 3 3", "8 4 3", "mesh.elements, line 3: the header says 4 lines"),
    ("mesh.header", "8 3 3", "8 x 3", "mesh.header, line 1: 'x' is not an integer"),
    ("mesh.elements", "404 5 15", "404 15", "mesh.elements, line 1: an element of type 404 with 3"),
    ("mesh.elements", "404 5 15", "404 6 15", "node id 6"),
    ("mesh.elements", "3 2 303 25 65 55", "3 2 306 25 65 55 5 15 35", "triangle6"),
    ("mesh.boundary", "202 5 15", "902 5 15", "mesh.boundary, line 1: an element of type 902"),
    ("mesh.nodes", "2 1 0.0", "2 nan 0.0", "1 vertex is not finite, the first is vertex 5, line 6"),
]


@pytest.mark.parametrize(("name", "old", "new", "message"), WRONG)
def test_wrong_files(folder, name, old, new, message):
    assert old in FILES[name]
    (folder / name).write_text(FILES[name].replace(old, new, 1))
    with pytest.raises(MeshError, match=message) as caught:
        read_mesh(folder)
    assert str(folder) in str(caught.value)


def test_a_folder_without_a_mesh(folder, tmp_path):
    (folder / "mesh.elements").unlink()
    with pytest.raises(MeshError, match=r"mesh\.elements': No such file"):
        read_mesh(folder)
    with pytest.raises(MeshError, match="it is a folder, and format off takes a file"):
        read_mesh(folder, format="off")
    with pytest.raises(MeshError, match=r"it is a folder, and has no mesh\.header \(elmer\)"):
        read_mesh(tmp_path)


def test_damaged_files_are_a_mesh_or_a_mesh_error(folder):
    rng = np.random.default_rng(0)
    for name, text in FILES.items():
        for _ in range(40):
            damaged = bytearray(text.encode())
            for place in rng.integers(0, len(damaged), 3):
                damaged[place] = rng.integers(0, 256)
            if rng.random() < 0.3:
                del damaged[rng.integers(0, len(damaged)) :]
            (folder / name).write_bytes(bytes(damaged))
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", MeshWarning)
                try:
                    read_mesh(folder)
                except MeshError as error:
                    assert str(folder) in str(error)  # noqa: PT017
        (folder / name).write_text(text)


def test_the_shell_takes_folders(folder, tmp_path, capsys):
    out = tmp_path / "out"
    given = ["smooth", str(folder), "-o", str(out), "--method", "laplacian", "--sweeps", "1"]
    assert run(given) == 0
    assert read_mesh(out).regions.tolist() == [1, 2, 2]
    assert run(given) == 2
    assert "exists; --overwrite replaces it" in capsys.readouterr().err
    assert run([*given, "--overwrite"]) == 0
    shutil.rmtree(out)
    out.mkdir()
    assert run(given) == 2
    assert "is a folder; OUT must be a file" in capsys.readouterr().err


def test_real_folder(shared_meshes, tmp_path):
    path = shared_meshes / "more" / "elmer_rayleigh_quads"
    if not path.is_dir():
        pytest.skip("the folder of more formats is not here")
    mesh = read_mesh(path)
    assert mesh.n_vertices == 231
    assert [cells.shape for cells in mesh.cells] == [(200, 4)]
    assert len(mesh.topology.lines) == 60
    assert np.unique(mesh.source.tags[1]).tolist() == [1, 2, 3, 4]
    write_mesh(tmp_path / "copy", mesh)
    assert content(tmp_path / "copy") == content(path)
