"""Output on a terminal."""

import io
import re
import sys

import pytest

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
    if command == "smooth":  # the optimiser's rounds, whose count nobody knows
        assert "about 10 sweeps" in err.getvalue()
