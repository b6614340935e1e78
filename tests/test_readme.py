"""The README's commands and its example work as they stand."""

import re
import shlex
from pathlib import Path

import pytest

README = (Path(__file__).resolve().parent.parent / "README.md").read_text(encoding="utf-8")


def blocks(language):
    return re.findall(rf"^```{language}\n(.*?)^```$", README, re.MULTILINE | re.DOTALL)


def test_the_two_commands_are_one_line_each():
    start = "python3 -m venv .venv && .venv/bin/pip install '.[all]' && .venv/bin/"
    commands = [block for block in blocks("sh") if block.startswith("python3")]
    assert commands == [start + "qsmooth demo\n", start + "pytest\n"]


def test_the_example_runs(capsys):
    (example,) = blocks("python")
    names = {}
    exec(compile(example, "README.md", "exec"), names)
    assert names["result"].after.n_invalid == 0
    assert names["points"].shape == names["mesh"].points.shape
    assert "Largest angle" in capsys.readouterr().out


def test_shell_examples_use_options_that_exist(capsys):
    from qsmooth.cli import run

    lines = [line.partition("#")[0] for block in blocks("sh") for line in block.splitlines()]
    calls = [shlex.split(line) for line in lines if line.startswith("qsmooth ")]
    assert {words[1] for words in calls} == {"info", "quality", "smooth", "untangle", "compare"}
    for words in calls:
        assert run(words[1:]) == 2  # as the file is missing, and not for an unknown option
        assert "No such file" in capsys.readouterr().err


def test_formats_are_those_there_are():
    from qsmooth.io import own_formats

    table = README.partition("## File formats")[2].partition("## ")[0]
    endings = {ending for form in own_formats() for ending in form.ENDINGS}
    assert set(re.findall(r"`(\.\w+)`", table)) == endings


@pytest.mark.parametrize(
    "name", ["optimize", "star", "quad", "aspect-ratio", "angle", "smart-laplacian", "laplacian"]
)
def test_methods_are_described(name):
    from qsmooth.smoothing import METHODS

    table = README.partition("## Methods")[2].partition("## ")[0]
    assert f"| `{name}` |" in table
    assert set(re.findall(r"^\| `([\w-]+)` \|", table, re.MULTILINE)) == set(METHODS)
