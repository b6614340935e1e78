"""The Python blocks of the guide run as they stand, page by page, and its shell blocks after them.

`docs/programs.md` needs other libraries: `test_programs_page.py`; the README has `test_readme.py`.
"""

import os
import re
import shlex
from pathlib import Path

import numpy as np
import pytest

ROOT = Path(__file__).resolve().parent.parent
# Pages whose blocks are excerpts of sources, or forms to be filled in.
EXCERPTS = {"style.md", "contributing.md"}
ELSEWHERE = {"programs.md"}


def blocks(path, language):
    text = path.read_text(encoding="utf-8")
    return re.findall(rf"^```{language}\n(.*?)^```$", text, re.MULTILINE | re.DOTALL)


PAGES = [
    path
    for path in sorted((ROOT / "docs").glob("*.md"))
    if blocks(path, "python") and path.name not in EXCERPTS | ELSEWHERE
]


def prepared(name):
    """Names that a page takes for granted."""
    if name not in ("simulation.md", "mpi.md"):
        return {}
    from qsmooth import write_mesh
    from qsmooth.examples import jittered

    mesh = jittered(6, 6)
    body = np.flatnonzero(mesh.is_boundary)[:3]
    places = mesh.points[body].copy()
    if name == "mpi.md":
        write_mesh("lake.msh", mesh)
    return {
        "mesh": mesh,
        "points": mesh.points.copy(),
        "cells": mesh.cells,
        "vertex_ids": np.arange(mesh.n_vertices),
        "cell_ids": np.arange(mesh.n_cells),
        "times": range(2),
        "body": body,
        "place_of_body": lambda time: places,
    }


@pytest.mark.parametrize("path", PAGES, ids=lambda path: path.name)
def test_blocks_run(path, tmp_path, monkeypatch, capsys):
    from qsmooth.cli import run

    if path.name == "mpi.md" and not os.environ.get("QSMOOTH_REQUIRE_MPI"):
        pytest.importorskip("mpi4py")
    monkeypatch.chdir(tmp_path)
    names = prepared(path.name)
    for number, block in enumerate(blocks(path, "python")):
        exec(compile(block, f"{path.name}, block {number}", "exec"), names)
    if path.name != "tutorial.md":
        return
    for line in "".join(blocks(path, "sh")).splitlines():
        assert run(shlex.split(line, comments=True)[1:]) == 0, capsys.readouterr().err
