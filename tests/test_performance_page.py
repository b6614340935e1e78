"""The README's table of times and `docs/performance.md` say what is in the stored results."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

import publish
from peer_meshes import MESHES
from peer_programs import PROGRAMS

ROOT = Path(__file__).resolve().parent.parent


def test_the_readme_has_the_stored_figures():
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    assert text.count(publish.START) == text.count(publish.END) == 1
    found = publish.stored("peers_24k")
    assert publish.with_section(text, publish.readme_section(found)) == text


def test_the_page_has_the_stored_figures():
    found = (publish.stored(name) for name in ("peers_24k", "growth", "paper"))
    assert publish.PAGE.read_text(encoding="utf-8") == publish.page(*found)


def test_another_figure_is_another_text():
    found = publish.stored("peers_24k")
    others = publish.stored("growth"), publish.stored("paper")
    before = publish.readme_section(found), publish.page(found, *others)
    found["meshes"]["square"]["peers"]["mfem"]["ratio"] *= 10.0
    after = publish.readme_section(found), publish.page(found, *others)
    assert before[0] != after[0]
    assert before[1] != after[1]


def test_every_program_and_mesh_is_in_the_stored_run():
    found = publish.stored("peers_24k")
    assert list(found["meshes"]) == list(MESHES)
    for mesh in found["meshes"].values():
        assert list(mesh["peers"]) == list(PROGRAMS)
        assert not any(other.get("why") == "not installed" for other in mesh["peers"].values())
        assert mesh["cells"] > 20_000


def test_the_pictures_are_there(tmp_path):
    pytest.importorskip("matplotlib")
    assert publish.PLOT.stat().st_size > 1000
    assert publish.GROWTH_PLOT.stat().st_size > 1000
    publish.plot(publish.stored("peers_24k"), tmp_path / "plot.png")
    assert (tmp_path / "plot.png").stat().st_size > 1000


def _benchmarks(*arguments):
    what = str(ROOT / "benchmarks" / "test_metric_kernels.py"), "-k", "test_glance and 2K"
    done = subprocess.run(
        [sys.executable, "-m", "pytest", *what, *arguments], cwd=ROOT, capture_output=True,
        text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@pytest.mark.skipif(os.environ.get("NUMBA_BOUNDSCHECK") == "1", reason="of compiled code only")
def test_tables_of_benchmarks_show_rates_and_two_commits_side_by_side(tmp_path):
    pytest.importorskip("pytest_benchmark")
    kept = f"--benchmark-storage={tmp_path}"
    first = _benchmarks(kept, "--benchmark-autosave")
    (row,) = re.findall(r"^test_glance\[2K\] .*$", first, re.MULTILINE)
    assert re.search(r"\d M cells/s, \d+% of the bound", row)
    second = _benchmarks(kept, "--benchmark-compare")
    rows = re.findall(r"^test_glance\[2K\] .*$", second, re.MULTILINE)
    assert len(rows) == 2
    assert sum("(NOW)" in row for row in rows) == 1
    assert all("M cells/s" in row for row in rows)
