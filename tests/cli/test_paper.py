"""``qsmooth paper``."""

import re
import shlex
import sys
from functools import partial

import pytest

from qsmooth import quality, read_mesh
from qsmooth.examples import spiral
from qsmooth.paper import runs
from qsmooth.paper.drawing import FIGURES
from qsmooth.paper.runs import text_of


@pytest.fixture(scope="module", name="small")
def _small():
    return partial(runs.run, (300, 1000), sweeps=4, seeds=range(2))


@pytest.fixture(scope="module", name="folder")
def _folder(small, tmp_path_factory):
    pytest.importorskip("matplotlib")
    from qsmooth.cli import run

    folder = tmp_path_factory.mktemp("paper") / "there"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("qsmooth.paper.run", small)
        assert run(["paper", "-o", str(folder)]) == 0
    return folder


def test_all_figures_and_a_page_that_leads_to_them(folder):
    names = {path.name for path in folder.iterdir()}
    stems = ["by-sweep", *(figure.name for figure in FIGURES)]
    assert names == {"index.html", "index.md", "spiral.off", "lake.off"} | {
        f"{stem}.{ending}" for stem in stems for ending in ("png", "svg")
    }
    page = (folder / "index.html").read_text(encoding="utf-8")
    links = set(re.findall(r'(?:src|href)="([^"]+)"', page))
    assert links == {name for name in names if name.endswith((".png", ".svg"))}
    assert "http" not in page  # no network
    in_markdown = (folder / "index.md").read_text(encoding="utf-8")
    assert set(re.findall(r"\]\(([^)]+)\)", in_markdown)) == links
    for figure in FIGURES:
        for command in figure.commands:
            assert f"`{command}`" in in_markdown
            assert f"<code>{command}</code>" in page


def test_the_numbers_of_the_page_are_those_of_the_meshes_beside_it(folder):
    lines = (folder / "index.md").read_text(encoding="utf-8").splitlines()
    for name in ("spiral", "lake"):
        summary = quality(read_mesh(folder / f"{name}.off")).summary()
        (given,) = (line for line in lines if re.match(rf"\| {name}, \d+ quads \| As given", line))
        assert f"| {text_of('max_angle', summary.worst['max_angle'])} |" in given
        assert f"| {text_of('aspect_ratio', summary.worst['aspect_ratio'])} |" in given


def test_commands_of_the_page_make_its_numbers(folder, call, monkeypatch, small):
    monkeypatch.chdir(folder)
    found = small().results
    for figure in FIGURES:
        alone, plain = (shlex.split(command)[1:] for command in figure.commands)
        assert alone[:3] == ["paper", "-o", "paper"]
        if "--plot" in plain:
            del plain[plain.index("--plot") : plain.index("--plot") + 2]
        if figure.mesh == "lake":
            continue
        plain = ["4" if word == str(runs.SWEEPS) else word for word in plain]
        code, _, err = call(*plain)
        assert (code, err) == (0, "")
        if plain[0] == "smooth":
            reached = quality(read_mesh(folder / plain[plain.index("-o") + 1])).max_angle.max()
            ours = found["spiral", figure.method].after.worst["max_angle"]
            assert reached == pytest.approx(ours, abs=1e-9)


def test_one_figure_alone(call, tmp_path, monkeypatch, small):
    pytest.importorskip("matplotlib")
    monkeypatch.setattr("qsmooth.paper.run", small)
    code, _, err = call("paper", "-o", tmp_path, "--figure", 19)
    assert (code, err) == (0, "")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["figure-19.png", "figure-19.svg"]


def test_it_refuses_what_it_cannot_do(fails, mesh_file, tmp_path, monkeypatch):
    assert "13, 16, 17, 18, 19, 20, 21, 22, got 14" in fails("paper", "--figure", 14)
    assert "is a file" in fails("paper", "-o", mesh_file)
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    monkeypatch.setitem(sys.modules, "matplotlib.figure", None)
    assert "pip install 'qsmooth[plot]'" in fails("paper", "-o", tmp_path / "new")
    assert not (tmp_path / "new").exists()


def test_what_is_run_at_its_own_size_is_the_packaged_spiral():
    assert runs.spiral is spiral
    assert runs.run.__defaults__ == ((1900, 24_000),)
