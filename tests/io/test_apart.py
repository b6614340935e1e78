"""What libraries in C may do to a process happens to another one."""

import sys

import pytest

from qsmooth.errors import MeshError
from qsmooth.io.apart import apart

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="limits of Linux")

FATES = {
    "crash": ("import ctypes\ndef go():\n    ctypes.string_at(1)\n", r"crashes \(SIGSEGV\)"),
    "leave": ("import os\ndef go():\n    os._exit(3)\n", "fails"),
    "loop": ("def go():\n    while True: pass\n", "goes on and on"),
    "eat": ("def go():\n    bytearray(10 << 30)\n", "too much memory"),
    "raise": ("def go():\n    raise KeyError('x')\n", "KeyError"),
}


@pytest.mark.parametrize("fate", FATES)
def test_whatever_becomes_of_it_is_a_mesh_error(tmp_path, monkeypatch, fate):
    code, message = FATES[fate]
    (tmp_path / f"fate_{fate}.py").write_text(code)
    monkeypatch.syspath_prepend(tmp_path)
    with pytest.raises(MeshError, match=message):
        apart(f"fate_{fate}:go", 1000)


def test_answers_come_back_and_what_is_printed_does_not_hurt(tmp_path, monkeypatch):
    (tmp_path / "answers.py").write_text("def go(a, b):\n    print('hello')\n    return a + b\n")
    monkeypatch.syspath_prepend(tmp_path)
    assert apart("answers:go", 0, b"a", b"b") == b"ab"
    monkeypatch.setattr(sys, "executable", "/opt/some-program")
    assert apart("answers:go", 0, 1, 2) == 3
