"""What notebooks show: small tables and pictures, short texts, data frames."""

import builtins
import dataclasses
import re
from xml.etree import ElementTree

import numpy as np
import pytest

from qsmooth import Mesh, Smoother, limits, quality, smooth
from qsmooth.examples import lake, structured, tangled

MOST = 100_000


@pytest.fixture(scope="module")
def result():
    return smooth(tangled(6, 5, seed=1), "laplacian", max_sweeps=2)


def parsed(html):
    return ElementTree.fromstring(html.replace("&nbsp;", " "))


def words(html):
    return " ".join("".join(parsed(html).itertext()).split())


def test_of_a_mesh():
    mesh = Mesh([(0, 0), (2, 0), (2, 1), (0, 1), (9, 9)], [(0, 1, 2, 3)], regions=[7])
    html = mesh._repr_html_()
    assert "Mesh(5 vertices, 1 quads)" in html
    assert re.search(r"Extent.*9 × 9.*Boundary vertices.*4.*Regions.*1", html)
    # The picture is of the cells: the orphan far outside has no part in it.
    (svg,) = parsed(html).iter("{http://www.w3.org/2000/svg}svg")
    assert svg.get("viewBox") == "-2 -2 604 304"
    cell, edge = (path.get("d") for path in svg)
    assert cell == "M0 300l600 0 0 -300 -600 0z"
    assert sorted(edge.split("M")[1:]) == [
        "0 0l0 300",
        "0 300l600 0",
        "600 0l-600 0",
        "600 300l0 -300",
    ]


def test_of_quality_a_summary_and_limits(result):
    html = result.quality_before._repr_html_()
    n_invalid = result.before.n_invalid
    assert n_invalid
    assert f"Cells not valid{n_invalid}" in words(html).replace("valid ", "valid")
    assert "#b2182b" in html
    assert "#b2182b" not in quality(structured(3, 3))._repr_html_()
    assert "Smallest angle" in result.before._repr_html_()
    text = words(limits(structured(3, 3))._repr_html_())
    assert "Now" in text
    assert "90.00°" in text


def test_limits_are_drawn_with_the_mesh_and_told_without():
    mesh = structured(3, 3)
    found = limits(mesh)
    assert found.quality is quality(mesh)
    assert quality(mesh).picture() in found._repr_html_()
    assert "quality" not in found.to_dict()
    assert found == dataclasses.replace(found, quality=None)
    assert "svg" not in dataclasses.replace(found, quality=None)._repr_html_()


def test_of_a_result(result):
    html = result._repr_html_()
    assert len(list(parsed(html).iter("{http://www.w3.org/2000/svg}svg"))) == 2
    text = words(html)
    assert "Before" in text
    assert "laplacian, 2 sweeps" in text
    assert " ".join(result.reason.split()) in text


def test_of_large_meshes_it_is_small():
    mesh = lake(6000)
    result = smooth(mesh, "laplacian", max_sweeps=1)
    for thing in (mesh, result, result.quality_after):
        assert len(thing._repr_html_().encode()) < MOST


def test_the_worst_cells_of_a_large_mesh_are_drawn():
    mesh = structured(120, 120)
    xy = mesh.xy.copy()
    inner = np.flatnonzero(~mesh.is_boundary)[7000]
    star = mesh.star_cells[mesh.star_offsets[inner] : mesh.star_offsets[inner + 1]]
    other = [v for c in star for v in mesh.cells[0][c] if v not in mesh.cells[0][star[0]]]
    xy[inner] = xy[other[0]]
    picture = quality(mesh.with_points(xy)).picture()
    assert "#b2182b" in picture or "#ef8a62" in picture
    assert "#b2182b" not in quality(mesh).picture()
    assert len(picture) < MOST // 2


def test_what_is_not_finite_is_left_out():
    mesh = structured(4, 4)
    xy = mesh.xy.copy()
    xy[12] = np.nan
    broken = type(quality(mesh))(mesh.topology, xy)
    assert "nan" not in broken.picture()
    assert broken.picture().count("l") < quality(mesh).picture().count("l")
    parsed(broken._repr_html_())


def test_texts_are_escaped(result):
    odd = dataclasses.replace(result)
    odd.__dict__["before"] = result.before
    outcome = dataclasses.replace(result.outcome, method="<b>")
    assert "<b>," not in dataclasses.replace(odd, outcome=outcome)._repr_html_()


def test_reprs_are_short_and_rounded(result):
    shown = [
        result,
        result.history,
        result.before,
        result.quality_after,
        limits(result.mesh),
        result.mesh,
        result.history[0],
        result.quality_after.worst(9),
        result.quality_after.worst(0),
        Smoother(result.mesh, "laplacian").step(result.points.copy()),
    ]
    for thing in shown:
        assert len(repr(thing)) < 250
        assert not re.search(r"\d\.\d{5}|\n", repr(thing)), repr(thing)
    assert re.fullmatch(
        r"SmoothResult\(laplacian: \S+° to \S+°, \d+ not valid → \S+° to \S+°, \d+ not valid; "
        r"2 sweeps, .* s\)",
        repr(result),
    )
    assert repr(quality(structured(3, 3))) == (
        "Quality(9 cells, 90.0° to 90.0°, mean shape 1.000, 0 not valid)"
    )
    assert repr(smooth(structured(2, 2), "laplacian", max_sweeps=0).history) == "History()"


def test_data_frames(result):
    pandas = pytest.importorskip("pandas")
    cells = result.quality_before.to_dataframe(["taper", "shape"])
    assert isinstance(cells, pandas.DataFrame)
    assert cells.columns.tolist() == ["taper", "shape", "validity"]
    assert cells.index.name == "cell"
    assert (cells["validity"] != "valid").sum() == result.before.n_invalid
    assert np.array_equal(cells["shape"], result.quality_before["shape"])
    assert result.history.to_dataframe()["n_moved"].tolist() == result.history["n_moved"].tolist()
    assert result.after.to_dataframe().loc["min_angle", "worst"] == result.after.worst["min_angle"]
    worst = result.quality_after.worst(3)
    assert worst.to_dataframe().index.tolist() == worst.cells.tolist()
    assert worst.to_dataframe().columns.tolist()[:2] == ["x", "y"]


def test_without_pandas_one_line_says_so(result, monkeypatch):
    real = builtins.__import__

    def without(name, *args, **kwargs):
        if name == "pandas":
            raise ImportError(name)
        return real(name, *args, **kwargs)

    monkeypatch.setattr(builtins, "__import__", without)
    with pytest.raises(ImportError, match="pip install pandas"):
        result.history.to_dataframe()
