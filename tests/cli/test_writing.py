"""Full disks and closed folders: tables are shown all the same, and the old files are whole."""

import errno
import json
import os
import resource

import pytest

from qsmooth.io import files

pytestmark = pytest.mark.skipif(not hasattr(resource, "RLIMIT_FSIZE"), reason="no limits here")
SMOOTH = ("--method", "laplacian", "--sweeps", "2", "--overwrite")


@pytest.fixture
def full(call):
    """Run a command where files may have so many bytes, as on a disk that gets full."""

    def run_it(size, *arguments):
        soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
        resource.setrlimit(resource.RLIMIT_FSIZE, (size, hard))
        try:
            return call(*arguments)
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))

    return run_it


def last_line(err):
    return err.strip().splitlines()[-1]


def test_a_full_disk_costs_neither_the_tables_nor_the_old_mesh(tmp_path, mesh_file, call, full):
    out = tmp_path / "out.off"
    out.write_text("old")
    call("smooth", mesh_file, "-o", tmp_path / "warm.off", *SMOOTH)
    code, said, err = full(1000, "smooth", mesh_file, "-o", out, *SMOOTH)
    assert code == 2
    assert "Smallest angle" in said
    assert "Wrote" not in said
    assert last_line(err) == f"qsmooth: error: cannot write '{out}': File too large"
    assert out.read_text() == "old"
    assert not list(tmp_path.glob(".qsmooth-*"))


def test_what_there_is_room_for_is_written(tmp_path, mesh_file, full):
    # The mesh has some 15 kB, the report less; figures have more.
    pytest.importorskip("matplotlib")
    out, figures, report = tmp_path / "out.off", tmp_path / "figures", tmp_path / "a.json"
    more = ("--plot", figures, "--json", report)
    code, said, err = full(40_000, "smooth", mesh_file, "-o", out, *SMOOTH, *more)
    assert code == 2
    assert f"Wrote {out}\n" in said
    assert "cannot write" in last_line(err)
    assert str(figures) in last_line(err)
    assert json.loads(report.read_text())["output"] == str(out)
    for path in figures.iterdir():
        assert path.suffix in (".png", ".svg")
        assert path.read_bytes()[-12:].rstrip().endswith((b"IEND\xaeB`\x82", b"</svg>"))


@pytest.mark.parametrize("command", ["quality", "info", "compare", "untangle", "smooth"])
def test_a_report_that_cannot_be_written_leaves_the_old_one(
    tmp_path, mesh_file, call, full, command
):
    report, out = tmp_path / "a.json", tmp_path / "out.off"
    report.write_text("old")
    more = {"compare": ("--methods", "laplacian", "--sweeps", "1"), "smooth": SMOOTH}
    arguments = [command, mesh_file, *more.get(command, ())]
    arguments += ["-o", out] if command in ("smooth", "untangle") else []
    call(*arguments)
    if out.exists():
        out.unlink()
    code, said, err = full(400, *arguments, "--json", report)
    assert code == 2
    assert said.count("\n") > 10
    assert f"cannot write '{report}': File too large" in last_line(err)
    assert report.read_text() == "old"
    assert not list(tmp_path.glob(".qsmooth-*"))


def test_a_failed_gate_and_a_report_that_fails_is_an_error(tmp_path, mesh_file, call, full):
    arguments = ["quality", mesh_file, "--fail-below", "min_angle=89"]
    assert call(*arguments)[0] == 1
    code, said, _ = full(400, *arguments, "--json", tmp_path / "a.json")
    assert code == 2
    assert "FAILED: " in said


def test_a_permission_that_is_lost_while_smoothing(tmp_path, mesh_file, call, monkeypatch):
    out, report = tmp_path / "out.off", tmp_path / "a.json"
    real = os.open

    def denied(path, *more):
        if ".qsmooth-" in str(path):
            raise PermissionError(errno.EACCES, os.strerror(errno.EACCES), str(path))
        return real(path, *more)

    monkeypatch.setattr(files.os, "open", denied)
    code, said, err = call("smooth", mesh_file, "-o", out, *SMOOTH, "--json", report)
    assert code == 2
    assert "Smallest angle" in said
    parts = [f"cannot write '{path}': Permission denied" for path in (out, report)]
    assert last_line(err) == f"qsmooth: error: {'; '.join(parts)}"
    assert not out.exists()
    assert not report.exists()
