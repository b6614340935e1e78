"""Opening and replacing files: a write happens whole or not at all."""

import errno
import os
import stat
import sys
import threading
from pathlib import Path

import numpy as np
import pytest

from qsmooth.errors import MeshError
from qsmooth.io import files, read_mesh, write_mesh
from qsmooth.mesh import Mesh

OLD = b"OFF\n4 1 0\n0 0 0\n1 0 0\n1 1 0\n0 1 0\n4 0 1 2 3\n"


@pytest.fixture
def path(tmp_path: Path) -> Path:
    (tmp_path / "a.off").write_bytes(OLD)
    return tmp_path / "a.off"


@pytest.fixture
def mesh(path: Path) -> Mesh:
    mesh = read_mesh(path)
    return mesh.with_points(np.add(mesh.points, (0.25, 0, 0)))


def only(path: Path) -> bool:
    return [p.name for p in path.parent.iterdir()] == [path.name]


def test_missing_file(tmp_path):
    with pytest.raises(MeshError, match=r"cannot read '.*no\.off': No such file") as caught:
        read_mesh(tmp_path / "no.off")
    assert isinstance(caught.value.__cause__, FileNotFoundError)


@pytest.mark.parametrize("ending", ["", ".off", ".vtu", ".bdf"])
def test_folder_instead_of_a_file(tmp_path, mesh, ending):
    folder = tmp_path / f"folder{ending}"
    folder.mkdir()
    with pytest.raises(MeshError, match=r"cannot read '.*folder.*': it is a folder"):
        read_mesh(folder)
    with pytest.raises(MeshError, match=r"cannot write '.*folder.*': "):
        write_mesh(folder, mesh, format="off")


def test_strings_and_paths(path, mesh):
    assert np.array_equal(read_mesh(str(path)).points, read_mesh(path).points)
    write_mesh(str(path), mesh)
    assert np.array_equal(read_mesh(path).points, mesh.points)


def test_no_permission_to_read(path, monkeypatch):
    def denied(self):
        raise PermissionError(errno.EACCES, os.strerror(errno.EACCES), str(self))

    monkeypatch.setattr(Path, "read_bytes", denied)
    with pytest.raises(MeshError, match=r"cannot read '.*a\.off': Permission denied"):
        read_mesh(path)


def test_no_permission_to_write(path, mesh, monkeypatch):
    monkeypatch.setattr(files.os, "access", lambda *_: False)
    with pytest.raises(MeshError, match=r"cannot write '.*a\.off': Permission denied"):
        write_mesh(path, mesh)
    assert path.read_bytes() == OLD


def test_no_such_folder(tmp_path, mesh):
    with pytest.raises(MeshError, match="No such file or directory"):
        write_mesh(tmp_path / "nowhere" / "a.off", mesh)


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no /dev/full here")
def test_full_disk_of_a_device(mesh):
    with pytest.raises(MeshError, match="cannot write '/dev/full': No space left on device"):
        write_mesh("/dev/full", mesh, format="off")


@pytest.mark.parametrize("step", ["fsync", "chmod", "replace"])
@pytest.mark.parametrize(
    "failure",
    [OSError(errno.ENOSPC, os.strerror(errno.ENOSPC)), KeyboardInterrupt(), MemoryError()],
    ids=["disk full", "interrupted", "no memory"],
)
def test_a_write_that_fails_leaves_the_old_file(path, mesh, monkeypatch, step, failure):
    def fail(*_):
        raise failure

    monkeypatch.setattr(files.os if step == "fsync" else Path, step, fail)
    expected = MeshError if isinstance(failure, OSError) else type(failure)
    with pytest.raises(expected) as caught:
        write_mesh(path, mesh)
    if expected is MeshError:
        assert str(caught.value) == f"cannot write '{path}': No space left on device"
    assert path.read_bytes() == OLD
    assert only(path)


def test_a_failing_writer_of_meshio_leaves_the_old_file(path, mesh, monkeypatch):
    import meshio

    def fail(*_args, **_options):
        print("something")
        sys.exit(1)

    target = path.with_name("a.bdf")
    target.write_bytes(b"old")
    monkeypatch.setattr(meshio, "write", fail)
    with pytest.raises(MeshError, match="meshio says: something"):
        write_mesh(target, mesh)
    assert target.read_bytes() == b"old"
    assert len(list(path.parent.iterdir())) == 2


def test_permission_bits_stay(path, mesh):
    path.chmod(0o640)
    write_mesh(path, mesh)
    assert stat.S_IMODE(path.stat().st_mode) == 0o640


def test_a_new_file_follows_the_umask(path, mesh):
    old = os.umask(0o027)
    try:
        write_mesh(path.with_name("new.off"), mesh)
    finally:
        os.umask(old)
    assert stat.S_IMODE(path.with_name("new.off").stat().st_mode) == 0o640


def test_a_link_stays_a_link(path, mesh, tmp_path):
    link = tmp_path / "link.off"
    link.symlink_to(path)
    write_mesh(link, mesh)
    assert link.is_symlink()
    assert np.array_equal(read_mesh(path).points, mesh.points)


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no pipes here")
def test_a_pipe_is_written_to_and_not_replaced(path, mesh, tmp_path):
    pipe = tmp_path / "pipe.off"
    os.mkfifo(pipe)
    got: list[bytes] = []
    reader = threading.Thread(target=lambda: got.append(pipe.read_bytes()))
    reader.start()
    write_mesh(pipe, mesh)
    reader.join(timeout=10)
    assert stat.S_ISFIFO(pipe.stat().st_mode)
    assert got[0].startswith(b"OFF\n4 1 0\n0.25 0 0\n1.25 0 0\n")


def test_the_input_may_be_the_output(path, mesh):
    write_mesh(path, mesh)
    write_mesh(path, read_mesh(path))
    assert path.read_bytes().endswith(b"1.25 1 0\n0.25 1 0\n4 0 1 2 3\n")
