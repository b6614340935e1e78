"""``--geographic`` and ``--no-geographic``, and what is said where degrees are only likely."""

import json

import numpy as np
import pytest

from qsmooth import quality, read_mesh, write_mesh
from qsmooth.examples import jittered
from qsmooth.mesh import Mesh


@pytest.fixture
def sea(tmp_path):
    mesh = jittered(6, 6, seed=1)
    write_mesh(tmp_path / "sea.off", Mesh(0.2 * mesh.points + [-87.0, 60.0], mesh.cells))
    return tmp_path / "sea.off"


def smallest(call, command, path, *more):
    code, out, err = call(command, path, "--json", "-", *more)
    assert code == 0
    facts = json.loads(out)
    return facts, err


@pytest.mark.nojit
def test_likely_degrees_are_pointed_out_and_taken_when_said(call, sea):
    plain, err = smallest(call, "info", sea)
    assert "look like degrees" in err
    assert "--geographic" in err
    assert err.count("\n") == 1
    for flag in ("--geographic", "--no-geographic"):
        facts, err = smallest(call, "info", sea, flag)
        assert err == ""
        assert ("longitudes" in json.dumps(facts)) == (flag == "--geographic")
    assert "longitudes" not in json.dumps(plain)


@pytest.mark.nojit
def test_quality_is_that_of_the_ground(call, sea):
    wanted = quality(read_mesh(sea, geographic=True))
    _, out, _ = call("quality", sea, "--geographic")
    assert f"{wanted.min_angle.min():.2f}°" in out
    assert f"{quality(read_mesh(sea)).min_angle.min():.2f}°" not in out


def test_smoothing_gives_degrees_back(call, sea, tmp_path):
    out = tmp_path / "out.off"
    for command, more in (("smooth", ["--method", "star"]), ("untangle", [])):
        code, _, err = call(command, sea, "-o", out, "--overwrite", "--geographic", *more)
        assert (code, err) == (0, "")
    code, _, err = call("smooth", sea, "-o", out, "--overwrite", "--geographic", "--method", "star")
    old, new = (read_mesh(path, geographic=True) for path in (sea, out))
    assert 0.0 < np.abs(new.points - old.points).max() < 1.0
    assert quality(new).min_angle.min() > quality(old).min_angle.min()
    code, shown, _ = call("compare", sea, "--geographic", "--methods", "star")
    assert code == 0
    assert f"{quality(new).min_angle.min():.2f}" in shown
