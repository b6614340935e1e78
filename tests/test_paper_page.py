"""`docs/paper.md` says what is in the stored run, and the run has all that the page asks for."""

import copy
import runpy
from pathlib import Path

import pytest

from qsmooth.examples import spiral
from qsmooth.metrics import quality
from qsmooth.paper.drawing import FIGURES
from qsmooth.paper.page import blocks, markdown_text
from qsmooth.paper.runs import KNOWN, METHODS

ROOT = Path(__file__).resolve().parent.parent
STUDY = runpy.run_path(str(ROOT / "studies" / "paper.py"), run_name="study")
FOUND = STUDY["stored"]()


def test_the_page_has_the_stored_figures():
    assert STUDY["PAGE"].read_text(encoding="utf-8") == STUDY["page"](FOUND)


@pytest.mark.parametrize("part", ["rows", "ways"])
def test_another_figure_is_another_page(part):
    found = copy.deepcopy(FOUND)
    found[part][0]["max_angle"] -= 1.0
    assert STUDY["page"](found) != STUDY["page"](FOUND)


def test_another_spread_is_another_page():
    found = copy.deepcopy(FOUND)
    assert "No spiral of ours ends with the paper's" in STUDY["page"](found)
    for method, numbers in KNOWN.items():
        if method[1] in found["seeds"]:
            for column, known in zip(found["seeds"][method[1]], numbers[1:], strict=True):
                found["seeds"][method[1]][column][1] = known
                found["seeds"][method[1]][column][0] = min(
                    known, found["seeds"][method[1]][column][0]
                )
    page = STUDY["page"](found)
    assert "What these spirals come to includes the paper's largest aspect ratio of `star`" in page
    assert "No spiral of ours" not in page


def test_the_run_is_of_the_packaged_spiral():
    given = FOUND["rows"][0]
    summary = quality(spiral()).summary()
    assert given["cells"] == summary.n_cells
    assert given["max_angle"] == pytest.approx(summary.worst["max_angle"], rel=1e-12)
    assert [row["method"] for row in FOUND["rows"]] == 2 * ["given", *METHODS]


def test_the_figures_are_those_of_the_papers_results():
    assert [figure.number for figure in FIGURES] == [13, *range(16, 23)]


def test_every_number_known_of_the_paper_stands_beside_ours():
    page = markdown_text(blocks(FOUND))
    table = page.partition("## Its table")[2].partition("## ")[0]
    for text in ("59.8", "2.61", "180.0°", "20.7°", "10.3", "1.86", "177.0°", "15.9°", "10.1",
                 "1.91", "155.0°", "18.8°"):  # fmt: skip
        assert f"| {text} |" in table


def test_seconds_stand_there_where_they_were_taken():
    found = copy.deepcopy(FOUND)
    assert "seconds" not in STUDY["page"](found)
    found["rows"][2]["seconds"] = 0.0125
    assert "| 0.0125 | 1.5 |" in STUDY["page"](found)
