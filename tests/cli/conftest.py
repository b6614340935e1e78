"""What the tests of the command line share."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from qsmooth import write_mesh
from qsmooth.cli import run
from qsmooth.examples import spiral


@pytest.fixture(autouse=True)
def coarse(monkeypatch):
    """Figures of fewer pixels, for speed."""
    monkeypatch.setattr("qsmooth.output.drawing.DPI", 40)


@pytest.fixture
def mesh_file(tmp_path):
    path = tmp_path / "mesh.off"
    write_mesh(path, spiral(300, seed=1))
    return path


@pytest.fixture
def call(capsys):
    """Run the command line; gives its exit code, standard output and standard error."""

    def run_it(*arguments):
        code = run([str(argument) for argument in arguments])
        out, err = capsys.readouterr()
        assert "Traceback" not in out + err
        return code, out, err

    return run_it


@pytest.fixture
def fails(call):
    """Run the command line and expect an error, of which it gives the one line."""

    def run_it(*arguments):
        code, out, err = call(*arguments)
        assert code == 2
        assert out == ""
        assert err.startswith("qsmooth: error: ")
        assert err.count("\n") == 1
        assert err.endswith("\n")
        return err.removeprefix("qsmooth: error: ").strip()

    return run_it


@pytest.fixture
def start():
    """Run Python in a process of its own."""

    def start_it(*arguments, **options):
        source = str(Path(sys.modules["qsmooth"].__file__).parent.parent)
        environment = {**os.environ, "PYTHONPATH": source, "PYTHONIOENCODING": "utf-8"}
        environment.update(options.pop("environment", {}))
        return subprocess.run(
            [sys.executable, *arguments], capture_output=True, text=True, env=environment,
            timeout=120, check=False, encoding="utf-8", **options,
        )  # fmt: skip

    return start_it
