"""Output on a terminal."""

import io
import re
import sys

import pytest

from qsmooth.bars import left_text
from qsmooth.cli import run

pytestmark = pytest.mark.nojit


class Terminal(io.StringIO):
    encoding = "utf-8"

    def isatty(self):
        return True


@pytest.mark.parametrize(
    "arguments",
    [["quality"], ["compare", "--sweeps", "3"], ["info"], ["smooth", "--sweeps", "3", "-o", "OUT"]],
    ids=lambda arguments: arguments[0],
)
def test_terminals_get_colour_and_progress(mesh_file, tmp_path, monkeypatch, arguments):
    out, err = Terminal(), Terminal()
    monkeypatch.setattr(sys, "stdout", out)
    monkeypatch.setattr(sys, "stderr", err)
    for name in ("NO_COLOR", "FORCE_COLOR"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("TERM", "xterm-256color")
    monkeypatch.setenv("COLUMNS", "90")
    command, *more = [str(tmp_path / "out.off") if word == "OUT" else word for word in arguments]
    assert run([command, str(mesh_file), *more]) == 0
    assert "\x1b[1m" in out.getvalue()
    bare = re.sub(r"\x1b\[[0-9;?]*[a-zA-Z]", "", out.getvalue())
    assert max(map(len, bare.splitlines())) <= 90
    assert "…" not in bare
    if command == "compare":
        assert "3 of 3 sweeps" in err.getvalue()
        assert "star (6 of 6)" in err.getvalue()
        assert "0 s left" in err.getvalue()
    if command == "smooth":  # the optimiser's rounds, whose count nobody knows
        assert "about 10 sweeps" in err.getvalue()


@pytest.mark.parametrize(
    ("seconds", "sweeps", "to_come", "text"),
    [
        (0.0, 0, 9, ""),
        (2.0, 4, 10, "5 s left"),
        (60.0, 2, 3, "1:30 min left"),
        (1, 1, 0, "0 s left"),
    ],
)
def test_what_is_left_of_a_run(seconds, sweeps, to_come, text):
    assert left_text(seconds, sweeps, to_come) == text


@pytest.mark.parametrize(
    "command",
    [
        ["smooth", "--sweeps", "20", "-o", "out.vtu"],
        ["quality"],
        ["untangle", "-o", "out.vtu"],
        ["info"],
    ],
)
def test_tables_of_a_real_mesh_fit_80_columns(call, tmp_path, monkeypatch, shared_meshes, command):
    monkeypatch.setenv("COLUMNS", "80")
    monkeypatch.chdir(tmp_path)
    name = "superior_24k.off"
    (tmp_path / name).symlink_to(shared_meshes / name)
    code, out, _ = call(command[0], name, *command[1:])
    assert code == 0
    assert max(map(len, out.splitlines())) <= 80
