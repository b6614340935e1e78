"""Results: the history by columns, and the whole as plain values."""

import json
from dataclasses import fields

import numpy as np
import pytest

from meshes import random_mesh
from qsmooth import History, Mesh, Quality, SweepRecord, quality, smooth
from qsmooth.wording import reason


def record(n):
    return SweepRecord(
        largest_move=0.5, largest_share=0.1, n_moved=n, min_angle=40.0 + n, max_angle=140.0 - n,
        mean_shape=0.9, n_invalid=0,
    )  # fmt: skip


@pytest.mark.nojit
def test_the_history_is_a_tuple_with_columns():
    history = History(record(n) for n in range(3))
    assert history == tuple(record(n) for n in range(3))
    assert len(history) == 3
    assert history[-1] == record(2)
    assert history[np.int64(0)] == record(0)
    assert history[:2] == (record(0), record(1))
    assert [r.n_moved for r in history] == [0, 1, 2]
    assert history["min_angle"].tolist() == [40.0, 41.0, 42.0]
    assert history["n_moved"].dtype.kind == "i"
    for field in fields(SweepRecord):
        assert history[field.name].shape == (3,)
    assert hash(history) == hash(tuple(history))


@pytest.mark.nojit
def test_a_column_that_is_none():
    for history in (History(), History([record(1)])):
        with pytest.raises(KeyError, match=r"no column 'min_angel' in the history; did you mean"):
            history["min_angel"]
        with pytest.raises(KeyError, match="no column 'xyzzy' in the history"):
            history["xyzzy"]
    assert History()["min_angle"].shape == (0,)
    with pytest.raises(IndexError):
        History()[0]


@pytest.fixture(scope="module")
def result():
    return smooth(random_mesh("quads", 4, seed=1, amount=0.9).mesh, "star", max_sweeps=3)


@pytest.mark.nojit
def test_what_a_result_is_short_for(result):
    assert result.points is result.mesh.points
    assert result.method == result.outcome.method == "star"
    assert result.sweeps == result.outcome.sweeps == 3
    assert result.converged == result.outcome.stop.by_itself
    assert result.reason == reason(result.outcome)
    assert "history" not in repr(result), "which is long"


@pytest.mark.nojit
def test_plain_values(result):
    plain = json.loads(json.dumps(result.to_dict(), allow_nan=False))
    assert (plain["method"], plain["sweeps"], plain["converged"]) == ("star", 3, False)
    assert plain["reason"] == result.reason
    assert plain["seconds"] == result.seconds
    assert plain["outcome"]["stop"] == "max_sweeps"
    assert plain["outcome"]["stop_at"] == 3.0
    assert [SweepRecord(**r) for r in plain["history"]] == list(result.history)
    for name in ("before", "after"):
        assert plain[name] == json.loads(json.dumps(getattr(result, name).to_dict()))


def test_plain_values_of_a_mesh_where_nothing_is_finite():
    points = [(3.0, 3.0)] * 9
    cells = [(0, 1, 4, 3), (1, 2, 5, 4), (4, 5, 8, 7), (3, 4, 7, 6)]
    for method in ("star", "laplacian", "optimize"):
        result = smooth(Mesh(points, cells), method, max_sweeps=3)
        assert quality(result.mesh).n_invalid == 4
        json.dumps(result.to_dict(), allow_nan=False)


@pytest.mark.nojit
@pytest.mark.parametrize("method", ["star", "laplacian", "optimize"])
def test_quality_is_summed_up_when_asked_for_and_once(method, monkeypatch):
    asked = []
    own = Quality.summary
    monkeypatch.setattr(Quality, "summary", lambda self: asked.append(self) or own(self))
    result = smooth(random_mesh("quads", 4, seed=1).mesh, method, max_sweeps=2)
    assert not asked
    assert result.after is result.after
    assert result.before is result.before
    assert asked == [result.quality_after, result.quality_before]
    assert result.after == own(quality(result.mesh))


@pytest.mark.nojit
def test_what_is_measured_of_a_mesh_is_shared_while_somebody_holds_it():
    mesh = random_mesh("mixed", 4, seed=1).mesh
    result = smooth(mesh, "star", max_sweeps=2)
    assert quality(mesh) is result.quality_before
    assert quality(result.mesh) is result.quality_after
    assert quality(mesh.with_points(mesh.points)) is not result.quality_before
    with pytest.raises(ValueError, match="read-only"):
        quality(mesh).shape[0] = 1.0
    with pytest.raises(ValueError, match="read-only"):
        quality(mesh).validity[0] = 1


@pytest.mark.nojit
@pytest.mark.parametrize("method", ["star", "laplacian"])
def test_where_nothing_moves_the_mesh_is_the_input(method):
    mesh = random_mesh("quads", 4, seed=1).mesh
    result = smooth(mesh, method, max_sweeps=0)
    assert result.mesh is mesh
    assert result.quality_after is result.quality_before
    assert result.outcome.unchanged
