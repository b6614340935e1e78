"""``qsmooth methods``."""

import json
import re

import pytest

from qsmooth.cli.options import default_words, range_words, spell
from qsmooth.options import spelled
from qsmooth.registry import methods

pytestmark = pytest.mark.nojit


def test_every_method_says_what_it_is_for(call):
    code, out, err = call("methods")
    assert (code, err) == (0, "")
    words = re.sub(r"\s+", " ", out)
    for name, method in methods().items():
        assert re.search(rf"^{name}\b", out, re.MULTILINE)
        assert spelled(method.purpose, spell) in words
    assert "optimize, the default" in out
    assert max(map(len, out.splitlines())) <= 100


@pytest.mark.parametrize("name", list(methods()))
def test_a_method_shows_its_options(call, name):
    code, out, _ = call("methods", name)
    assert code == 0
    for spec in methods()[name].specs().values():
        if spec.flag is None:
            assert not re.search(rf"\b{spec.name}\b", out)
            continue
        (line,) = re.findall(rf"^  {spell(spec.name)}\b(?!-).*$", out, re.MULTILINE)
        assert range_words(spec) in line
        assert default_words(spec) in line
    assert "`" not in out


def test_several_methods(call):
    out = call("methods", "star", "quad", "star")[1]
    assert re.findall(r"^(\w+)$", out, re.MULTILINE) == ["star", "quad"]


def test_methods_as_json(call, tmp_path):
    facts = json.loads(call("methods", "--json", "-")[1])["methods"]
    assert [method["name"] for method in facts] == list(methods())
    (star,) = json.loads(call("methods", "star", "--json", "-")[1])["methods"]
    (step,) = [found for found in star["options"] if found["name"] == "step"]
    assert step == {
        "name": "step", "option": "--step", "help": "Share of each proposed move that is made.",
        "kind": "number", "default": 0.25, "range": "in (0, 1]", "unit": None, "choices": None,
    }  # fmt: skip
    report = tmp_path / "methods.json"
    assert "star" in call("methods", "--json", report)[1]
    assert json.loads(report.read_text())["methods"] == facts


def test_unknown_method(fails):
    assert "got 'stra'; did you mean 'star'?" in fails("methods", "stra")
