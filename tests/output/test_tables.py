import json
import re

import numpy as np
import pytest

from qsmooth import quality, smooth
from qsmooth._json import finite
from qsmooth._words import plural
from qsmooth.examples import spiral
from qsmooth.metrics import METRICS
from qsmooth.output.tables import (
    change_table,
    comparison_tables,
    method_title,
    summary_table,
    verdict,
    worst_table,
)
from qsmooth.table import bar, percent_text, plain

pytestmark = pytest.mark.nojit

MIXED = (
    [(0, 0), (1, 0), (2, 0.5), (1, 1), (0, 1)],
    [[[0, 1, 3, 4]], [[1, 2, 3]]],
)
COLLAPSED = ([(0, 0), (1, 0), (1, 1), (0, 0)], [[0, 1, 2, 3]])


@pytest.fixture(scope="module")
def results():
    mesh = spiral(400, seed=1)
    return [smooth(mesh, method, max_sweeps=5) for method in ("star", "quad", "laplacian")]


def test_summary_in_full_words():
    text = str(quality(MIXED).summary())
    assert text.startswith("1 quad and 1 triangle, 5 vertices, area 1.5\n")
    assert re.search(r"Smallest angle +53\.13°", text)
    assert re.search(r"Largest angle +90\.00°", text)
    assert re.search(r"Largest aspect ratio +1\.12", text)
    assert re.search(r"Mean of largest angles +76\.72°", text)
    assert re.search(r"Mean of size ratios +1\.15", text)
    assert re.search(r"Cells not valid +0", text)
    assert re.search(r"90 to 100 degrees +1 cells +50\.0 % +█+", text)
    assert "60 to 70 degrees" in text  # from 60 where there are triangles
    assert "\x1b" not in text


def test_summary_is_what_str_gives():
    summary = quality(MIXED).summary()
    assert str(summary).endswith(str(summary_table(summary)))


def test_summary_of_a_collapsed_cell():
    text = str(quality(COLLAPSED).summary())
    assert re.search(r"Largest aspect ratio +infinite", text)
    assert re.search(r"Cells not valid +1", text)
    assert re.search(r"of these collapsed +1", text)
    assert "inverted" not in text


def test_change_says_better_and_worse(results):
    before, after = results[0].before, results[0].after
    lines = {line[:26].strip(): line for line in str(change_table(before, after)).splitlines()}
    assert "better by" in lines["Largest angle"]
    assert lines["Cells not valid"].endswith("same")
    back = {line[:26].strip(): line for line in str(change_table(after, before)).splitlines()}
    assert "worse by" in back["Largest angle"]
    assert str(change_table(before, after)).split()[:3] == ["Before", "After", "Change"]


def test_a_single_cell_has_no_neighbours():
    good = quality(([(0, 0), (1, 0), (1, 1), (0, 1)], [[0, 1, 2, 3]])).summary()
    assert re.search(r"Mean of size ratios +none", str(good))
    line = next(
        x
        for x in str(change_table(good, quality(MIXED).summary())).splitlines()
        if "Mean of size" in x
    )
    assert line.split()[4:] == ["none", "1.15"]


def test_methods_have_titles():
    assert method_title("aspect-ratio") == "By aspect ratio"
    assert method_title("untangle") == "Untangle"


def test_change_from_infinite():
    bad, good = quality(COLLAPSED).summary(), quality(MIXED).summary()
    line = next(
        line for line in str(change_table(bad, good)).splitlines() if "Largest aspect" in line
    )
    assert line.endswith("better")
    assert line.split()[3:5] == ["infinite", "1.12"]


def test_comparison_marks_the_best_of_a_row(results):
    (table,) = comparison_tables(results[0].before, results)
    assert table.columns == ("Original", "By star", "By quad", "Laplacian")
    rows = {row.label: row for section in table.sections for row in section.rows}
    values = [results[0].before.worst["max_angle"], *(r.after.worst["max_angle"] for r in results)]
    assert rows["Largest angle"].best == {int(np.argmin(values))}
    assert rows["Smallest angle"].cells[0].endswith("°")
    assert rows["Time of the sweeps"].cells[0] == ""
    assert 0 not in rows["Time of the sweeps"].best
    line = next(line for line in str(table).splitlines() if line.startswith("Largest angle"))
    assert line.count("*") == 1  # seen without colour, too
    assert "* best of the row" in str(table)


def test_nothing_is_best_among_equals(results):
    (table,) = comparison_tables(results[0].before, [results[0], results[0]])
    rows = {row.label: row for section in table.sections for row in section.rows}
    assert rows["Cells not valid"].best == set()
    assert rows["Largest angle"].best == {1, 2}


@pytest.mark.parametrize("width", [60, 70, 80, 100, 120, 200])
def test_comparison_fits_the_terminal(results, width):
    tables = comparison_tables(results[0].before, results, width=width, histograms=True)
    text = "\n".join(table.text(width) for table in tables)
    assert max(map(len, text.splitlines())) <= width
    for name in ("Original", "By star", "By quad", "Laplacian", "180 and more degrees"):
        assert name in text
    (wide,) = comparison_tables(results[0].before, results)
    cells = {c for s in wide.sections for row in s.rows for c in row.cells if c.strip()}
    assert all(cell in text for cell in cells)


def test_comparison_of_many_at_80_columns_takes_a_table_a_section(results):
    tables = comparison_tables(results[0].before, 2 * results, width=80)
    assert len(tables) == 3
    assert "Cells by" not in str(tables)
    marked = {row.label for table in tables for s in table.sections for row in s.rows if row.best}
    (wide,) = comparison_tables(results[0].before, 2 * results)
    best = {wide.columns[k] for s in wide.sections for row in s.rows for k in row.best}
    assert marked == best


def test_verdict_counts_what_is_best_or_equal(results):
    before = results[0].before
    text = verdict(before, results, ["angle"])
    name, counts = re.match(r"([\w, ]+): best or equal in (\d+ of 13) figures", text).groups()
    assert name in ("star", "quad", "laplacian")
    assert int(counts.split()[0]) > 0
    assert text.endswith("; skipped: angle")


def test_verdict_prefers_valid_meshes_and_says_what_is_left_invalid():
    from qsmooth.examples import notch

    mesh = notch(200)
    both = [smooth(mesh, name, max_sweeps=50) for name in ("laplacian", "smart-laplacian")]
    assert both[0].after.n_invalid
    text = verdict(both[0].before, both)
    assert text.startswith("smart-laplacian: best")
    assert f"cells left invalid: laplacian {both[0].after.n_invalid}" in text


def test_verdict_where_nothing_changed():
    mesh = spiral(200)
    text = verdict(quality(mesh).summary(), [smooth(mesh, "star", max_sweeps=0)])
    assert text.startswith("no method changed the mesh")


def test_worst_cells_with_places():
    measured = quality(spiral(400))
    table = worst_table(measured, 3, "max_angle")
    assert "3 worst cells by largest angle" in table.title
    worst = measured.worst(3, "max_angle")
    assert [row.label for row in table.sections[0].rows] == [str(c) for c in worst.cells]
    assert len(str(table).splitlines()) == 7
    assert all(row.cells[-1] == "valid" for row in table.sections[0].rows)


def test_worst_cells_with_the_metrics_asked_for():
    table = worst_table(quality(MIXED), 5, "taper", "min_edge")
    assert table.columns == ("Centre x", "Centre y", "Shortest edge", "Taper", "State")
    assert [row.label for row in table.sections[0].rows] == ["0"]  # a triangle has no taper
    assert "The 1 worst cell by taper" in str(table)


def test_tables_show_the_metrics_asked_for():
    metrics = "min_edge, non_orthogonality, oddy"
    before = quality(MIXED).summary(metrics)
    text = str(before)
    assert re.search(r"Shortest edge +1\n", text)
    assert re.search(r"Largest Oddy distortion +0\.0000", text)
    assert "Non-orthogonality: angle between" in text
    assert "aspect ratio" not in text
    after = quality(COLLAPSED).summary(metrics)
    change = str(change_table(before, after))
    assert re.search(r"Largest Oddy distortion +0\.0000 +infinite +worse", change)
    assert re.search(r"Largest non-orthogonality +\S+° +none", change)


@pytest.mark.parametrize("metric", METRICS.values(), ids=METRICS.keys())
def test_every_metric_is_in_tables_that_ask_for_it(metric):
    measured = quality(MIXED)
    text = str(measured.summary([metric.name]))
    assert metric.worst_words in text
    assert metric.mean_words in text
    assert ("Cells by" in text) == bool(metric.bins)
    assert metric.title in worst_table(measured, 1, metric.name).columns


def test_bars():
    assert bar(0.0, 4) == "    "
    assert bar(1.0, 4) == "████"
    assert bar(0.5, 4) == "██  "
    assert bar(1e-9, 4) == "▏   "  # what is not zero is seen
    assert bar(2.0, 2) == "██"


def test_numbers_as_text():
    assert METRICS["min_angle"].text(12.375) == "12.38°"
    assert METRICS["aspect_ratio"].text(np.inf) == "infinite"
    assert METRICS["aspect_ratio"].text(2.07e7) == "2.070e+07"
    assert percent_text(0.0).strip() == "0 %"
    assert percent_text(0.01).strip() == "<0.1 %"
    assert percent_text(100.0) == "100.0 %"
    assert plural(1, "vertex", "vertices") == "1 vertex"
    assert plural(0, "vertex", "vertices") == "0 vertices"


def test_plain_text_for_poor_terminals():
    text = "█▌▏ 90°"
    assert plain(text, "utf-8") == text
    assert plain(text, "ascii") == "##. 90d"
    assert plain(text, None) == "##. 90d"


def test_finite_is_fit_for_json():
    value = {"a": [np.float64(1.5), np.inf], 2: (np.nan, np.int64(3)), "c": np.array([1.0, np.inf])}
    assert json.loads(json.dumps(finite(value), allow_nan=False)) == {
        "a": [1.5, None],
        "2": [None, 3],
        "c": [1.0, None],
    }
