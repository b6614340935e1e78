"""``qsmooth warmup``, and what a terminal is told while kernels compile."""

import logging
import os

import pytest

from qsmooth import warmup
from qsmooth.cli import terminal


@pytest.mark.skipif(bool(os.environ.get("NUMBA_DISABLE_JIT")), reason="nothing is compiled")
def test_warmup_says_when_there_is_nothing_to_do(call):
    warmup("laplacian")
    assert call("warmup", "laplacian") == (0, "Everything was compiled already\n", "")


@pytest.mark.nojit
def test_warmup_says_how_much_it_compiled(call, monkeypatch):
    monkeypatch.setattr("qsmooth.warming.warmup", lambda names: 3 if names is None else len(names))
    code, out, _ = call("warmup")
    assert code == 0
    assert out.startswith("Compiled 3 kernels in ")
    assert call("warmup", "star")[1].startswith("Compiled 1 kernel in ")


@pytest.mark.nojit
def test_what_is_to_be_compiled_beside_methods(call, monkeypatch):
    asked = []
    monkeypatch.setattr("qsmooth.warming.warmup", lambda names, **also: asked.append(also) or 2)
    assert call("warmup", "star", "--session", "--interpolate")[0] == 0
    assert call("warmup", "star", "--slide")[0] == 0
    assert asked == [{"session": True, "interpolate": True}, {"slide": True}]


@pytest.mark.nojit
def test_a_name_that_is_no_method(fails):
    said = fails("warmup", "stars")
    assert "NAME is one of auto, optimize, " in said  # there is no --method here
    assert "did you mean 'star'" in said


@pytest.mark.nojit
@pytest.mark.parametrize("there_is_one", [True, False])
def test_only_a_terminal_is_told_that_kernels_compile(capsys, monkeypatch, there_is_one):
    monkeypatch.setattr(terminal, "_is_terminal", lambda stream: there_is_one)
    with terminal.told_of_compiling():
        logging.getLogger("qsmooth").warning("compiling, first time only")
    said = "qsmooth: compiling, first time only\n" if there_is_one else ""
    assert capsys.readouterr() == ("", said)
