"""What every command has in common: help, versions, errors in one line."""

import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from qsmooth import Mesh, __version__, write_mesh
from qsmooth.cli import run
from qsmooth.cli.app import COMMANDS
from qsmooth.examples import spiral

pytestmark = pytest.mark.nojit


NAMES = [command.name for command in COMMANDS]


def test_version(call):
    assert call("--version") == (0, f"qsmooth {__version__}\n", "")


def test_as_a_module(start):
    done = start("-m", "qsmooth", "--version")
    assert (done.returncode, done.stdout, done.stderr) == (0, f"qsmooth {__version__}\n", "")


@pytest.mark.parametrize("arguments", [[], ["--help"], ["-h"]])
def test_help_names_the_commands(call, arguments):
    code, out, err = call(*arguments)
    assert (code, err) == (0, "")
    assert all(command in out for command in NAMES)


@pytest.mark.parametrize("command", NAMES)
def test_help_of_a_command(call, command):
    code, out, err = call(command, "--help")
    assert (code, err) == (0, "")
    assert f"qsmooth {command}" in out


@pytest.mark.parametrize("width", [40, 60, 80, 120])
@pytest.mark.parametrize("command", [None, *NAMES])
def test_help_is_readable_at_any_width(call, monkeypatch, command, width):
    monkeypatch.setenv("COLUMNS", str(width))
    code, out, _ = call(*filter(None, [command]), "--help")
    assert code == 0
    assert max(map(len, out.splitlines())) <= width
    assert "…" not in out
    assert not re.search(r"<\w+>|VALUE\b(?<!=VALUE)|\[/?(b|dim)\]|\\", out)
    for known in COMMANDS:
        if known.name == command:
            for flag in (flag for made in known.made() for flag in made.flags):
                assert re.search(rf"{flag}(?![\w-])", out)


@pytest.mark.parametrize("command", [None, *NAMES])
def test_help_loads_nothing_heavy(start, command):
    heavy = ["numba", "scipy", "meshio", "matplotlib"]
    if command is None:  # the others look at the methods and metrics, for which NumPy is needed
        heavy += ["numpy", "qsmooth.mesh"]
    arguments = ["--help"] if command is None else [command, "--help"]
    code = (
        f"import sys; from qsmooth.cli import run; run({arguments}); "
        f"print([m for m in {heavy} if m in sys.modules])"
    )
    assert start("-c", code).stdout.splitlines()[-1] == "[]"


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["polish"], "No such command 'polish'"),
        (["quality"], "Missing argument 'IN'"),
        (["smooth", "a.off"], "Missing option '--output'"),
        (["smooth", "a.off", "-o", "b.off", "--sweeps", "many"], "--sweeps"),
        (["quality", "a.off", "--surface", "round"], "--surface"),
        (["quality", "a.off", "--fast"], "--fast"),
    ],
)
def test_wrong_command_line(fails, arguments, message):
    assert message in fails(*arguments)


@pytest.mark.parametrize("command", ["quality", "info", "compare"])
def test_no_such_file(fails, tmp_path, command):
    assert "No such file" in fails(command, tmp_path / "nothing.off")


@pytest.mark.parametrize("command", ["quality", "info", "compare"])
def test_no_mesh_in_the_file(fails, tmp_path, command):
    path = tmp_path / "bad.off"
    path.write_text("OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 7\n")
    assert str(path) in fails(command, path)


def test_debug_shows_the_traceback(tmp_path, capsys, monkeypatch):
    path = str(tmp_path / "nothing.off")
    assert run(["quality", path, "--debug"]) == 2
    err = capsys.readouterr().err
    assert "Traceback" in err
    assert err.splitlines()[-1].startswith("qsmooth: error: ")
    monkeypatch.setenv("QSMOOTH_DEBUG", "1")
    assert run(["quality", path]) == 2
    assert "Traceback" in capsys.readouterr().err
    monkeypatch.setenv("QSMOOTH_DEBUG", "0")
    assert run(["quality", path]) == 2
    assert "Traceback" not in capsys.readouterr().err


@pytest.mark.parametrize(
    ("error", "code", "message"),
    [
        (MemoryError(), 2, "qsmooth: error: there is not enough memory for this mesh\n"),
        (PermissionError(13, "Permission denied", "x.off"), 2,
         "qsmooth: error: Permission denied: 'x.off'\n"),
        (ZeroDivisionError("one\ntwo"), 2,
         "qsmooth: error: ZeroDivisionError: one two; --debug shows where\n"),
        (KeyboardInterrupt(), 130, "qsmooth: interrupted\n"),
    ],
)  # fmt: skip
def test_whatever_goes_wrong_is_one_line(capfd, monkeypatch, mesh_file, error, code, message):
    def fail(*_arguments, **_options):
        raise error

    monkeypatch.setattr("qsmooth.io.read_mesh", fail)
    assert run(["quality", str(mesh_file)]) == code
    assert capfd.readouterr().err.lstrip() == message  # some versions of Typer break the line


@pytest.mark.skipif(os.name != "posix", reason="pipes break otherwise elsewhere")
def test_reader_who_leaves_is_no_failed_gate(mesh_file):
    process = subprocess.Popen(
        [sys.executable, "-m", "qsmooth", "quality", str(mesh_file), "--worst", "300"],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE,
        env={**os.environ, "PYTHONPATH": str(Path(sys.modules["qsmooth"].__file__).parents[1])},
    )  # fmt: skip
    process.stdout.close()
    assert process.wait(120) == 141
    assert process.stderr.read() == b""
    process.stderr.close()


def test_mesh_warnings_are_one_line(call, tmp_path):
    from qsmooth.errors import MeshWarning

    path = tmp_path / "mesh.vtk"
    mesh = spiral(300)
    write_mesh(path, Mesh(mesh.points, mesh.cells, regions=np.arange(mesh.n_cells) % 2))
    code, _, err = call("smooth", path, "-o", tmp_path / "out.off", "--sweeps", 1)
    assert code == 0
    assert re.fullmatch(r"qsmooth: warning: [^\n]*2 regions[^\n]*\n", err)
    assert issubclass(MeshWarning, UserWarning)


def test_poor_terminals_get_plain_signs(start, mesh_file):
    done = start(
        "-m", "qsmooth", "quality", str(mesh_file), environment={"PYTHONIOENCODING": "ascii"}
    )
    assert done.returncode == 0
    assert done.stdout.isascii()
    assert "####" in done.stdout
