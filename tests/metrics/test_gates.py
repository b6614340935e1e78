import json

import numpy as np
import pytest

from meshes import random_mesh
from qsmooth import Mesh, quality
from qsmooth.metrics import METRICS, check_gate, check_validity, parse_gate

pytestmark = pytest.mark.nojit


@pytest.fixture(scope="module")
def own():
    return quality(random_mesh("mixed", 6, seed=6, amount=1.0).mesh)


@pytest.mark.parametrize("below", [True, False])
@pytest.mark.parametrize("name", METRICS)
def test_a_gate_counts_the_cells_beyond_a_threshold(own, name, below):
    values = own[name]
    threshold = float(np.nanmedian(values))
    check = check_gate(own, name, threshold, below=below)
    bad = values < threshold if below else values > threshold
    assert check.n_failed == bad.sum()
    assert check.passed == (not bad.any())
    assert check.worst_value == (np.nanmin(values) if below else np.nanmax(values))
    assert values[check.worst_cell] == check.worst_value
    assert METRICS[name].words in check.text
    assert f"cell {check.worst_cell} has" in check.text
    plain = check.to_dict()
    assert json.loads(json.dumps(plain, allow_nan=False)) == plain
    assert plain["threshold"] == threshold
    assert plain["passed"] == check.passed


def test_a_gate_on_what_no_cell_has_passes_and_says_so():
    own = quality(([(0, 0), (1, 0), (0, 1)], [[0, 1, 2]]))
    for name in ("taper", "skewness"):
        check = check_gate(own, name, 0.5, below=False)
        assert check.passed
        assert check.worst_cell is None
        assert "as none has one" in check.text


def test_validity():
    points = [(0, 0), (1, 0), (1, 1), (0, 1), (2, 0), (0.5, 0.5)]
    mesh = Mesh(points, [[0, 1, 2, 3], [1, 4, 5, 2]])
    check = check_validity(quality(mesh))
    assert not check.passed
    assert check.worst_cell == 1
    assert check.text == "1 cell of 2 not valid; the first: cell 1"
    assert check_validity(quality((points[:4], [[0, 1, 2, 3]]))).passed


def test_gates_are_parsed():
    assert parse_gate("min-angle = 20") == ("min_angle", 20.0)
    assert parse_gate("taper=0.5") == ("taper", 0.5)
    for text in ("min_angle", "=3", ""):
        with pytest.raises(ValueError, match=r"--fail-below takes METRIC=VALUE with a metric"):
            parse_gate(text, "--fail-below")
    with pytest.raises(ValueError, match=r"did you mean 'taper'\?"):
        parse_gate("tapr=1")
    for value in ("", "x", "nan", "inf"):
        with pytest.raises(ValueError, match="min_angle needs a number"):
            parse_gate(f"min_angle={value}")
