"""The README's commands and its example work as they stand; its pages tell of all there is."""

import re
import shlex
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
README = (ROOT / "README.md").read_text(encoding="utf-8")
PAGES = sorted([*ROOT.glob("*.md"), *(ROOT / "docs").glob("*.md")])


def page(name):
    return (ROOT / "docs" / name).read_text(encoding="utf-8")


def blocks(language):
    return re.findall(rf"^```{language}\n(.*?)^```$", README, re.MULTILINE | re.DOTALL)


def test_it_is_one_page():
    assert len(README.splitlines()) <= 200


def test_the_two_commands_are_one_line_each():
    commands = [block for block in blocks("sh") if block.startswith("python3")]
    start = "python3 -m venv .venv && .venv/bin/pip install "
    assert commands == [
        f"{start}'.[plot]' && .venv/bin/qsmooth demo\n",
        f"{start}'.[all]' && .venv/bin/pytest\n",
    ]


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
    calls = [shlex.split(line)[1:] for line in lines if line.startswith("qsmooth ")]
    assert {words[0] for words in calls} == {
        "info", "quality", "smooth", "untangle", "compare", "report", "convert", "methods",
    }  # fmt: skip
    for words in calls:
        if words == ["methods"]:
            assert run(words) == 0
            continue
        assert run(words) == 2  # as the file is missing, and not for an unknown option
        assert "No such file" in capsys.readouterr().err


@pytest.mark.parametrize("path", PAGES, ids=lambda path: path.name)
def test_links_lead_somewhere(path):
    targets = re.findall(r"\]\(([^)#\s]+)", path.read_text(encoding="utf-8"))
    missing = [t for t in targets if "://" not in t and not (path.parent / t).exists()]
    assert missing == []


def test_methods_are_those_there_are():
    from qsmooth.registry import methods

    table = README.partition("## Methods")[2].partition("## ")[0]
    assert set(re.findall(r"^\| `([\w-]+)` \|", table, re.MULTILINE)) == set(methods())


def test_options_are_described():
    from qsmooth.registry import methods

    text = page("methods.md")
    options = {name for method in methods().values() for name in method.specs()}
    assert options - set(re.findall(r"`(\w+)[`=]", text)) == set()


def test_metrics_are_those_there_are():
    from qsmooth.metrics import METRICS

    rows = re.findall(r"^\| (`.*?) \|", page("metrics.md"), re.MULTILINE)
    assert {name for row in rows for name in re.findall(r"`(\w+)`", row)} == set(METRICS)


def test_formats_are_those_there_are():
    from qsmooth.io import own_formats

    endings = {ending for form in own_formats() for ending in form.ENDINGS}
    assert set(re.findall(r"`(\.\w+)`", page("formats.md"))) == endings
