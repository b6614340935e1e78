"""``qsmooth untangle``."""

import json
import re

import numpy as np
import pytest

from qsmooth import quality, read_mesh, untangle, write_mesh
from qsmooth.examples import tangled

pytestmark = pytest.mark.nojit


# A pentagon's corner that no move mends: it and its neighbours are all on the boundary.
HOPELESS = "OFF\n6 2 0\n0 0 0\n2 0 0\n0.5 0.5 0\n0 2 0\n-2 0 0\n-2 2 0\n4 0 1 2 3\n4 4 0 3 5\n"


@pytest.fixture
def tangled_file(tmp_path):
    path = tmp_path / "tangled.off"
    write_mesh(path, tangled(12, 12, seed=3))
    return path


def test_untangle_writes_what_python_gives(call, tangled_file, tmp_path):
    before, out_file = tangled_file.read_bytes(), tmp_path / "out.off"
    code, out, err = call("untangle", tangled_file, "-o", out_file)
    assert (code, err) == (0, "")
    expected = untangle(read_mesh(tangled_file))
    assert np.array_equal(read_mesh(out_file).points, expected.points)
    assert quality(read_mesh(out_file)).n_invalid == 0
    assert tangled_file.read_bytes() == before
    n = expected.before.n_invalid
    assert re.search(rf"Cells not valid +{n} +0 +better by {n}", out)
    for kind, count in expected.before.validity.items():
        if kind != "valid" and count:
            assert re.search(rf"of these {kind} +{count} +0", out)
    assert f"Untangle: {expected.sweeps} sweep" in out
    assert f"untangled {n} cells" in out
    assert out.endswith(f"Wrote {out_file}\n")


def test_untangle_writes_its_best_where_cells_stay_invalid(call, tmp_path):
    path, out_file = tmp_path / "hopeless.off", tmp_path / "out.off"
    path.write_text(HOPELESS)
    code, out, err = call("untangle", path, "-o", out_file)
    assert (code, err) == (1, "")
    assert "FAILED: 1 cell of 2 not valid" in out
    assert f"Wrote the best that was found, {out_file}" in out
    assert read_mesh(out_file).n_cells == 2
    code, out, err = call("untangle", path, "-o", out_file, "--overwrite", "--json", "-")
    assert code == 1
    facts = json.loads(out)
    assert facts["valid"] is False
    assert facts["method"] == "untangle"
    assert facts["after"]["n_invalid"] == 1
    assert "failed: 1 cell of 2 not valid" in err


def test_untangle_takes_every_option(call, tangled_file, tmp_path):
    report = tmp_path / "report.json"
    code, _, _ = call(
        "untangle", tangled_file, "-o", tmp_path / "out.off", "--sweeps", 1, "--time-limit", 100,
        "--no-keep-interfaces", "--threads", 1, "--json", report,
    )  # fmt: skip
    facts = json.loads(report.read_text())
    assert facts["options"] == {
        "sweeps": 1, "time_limit": 100.0, "keep_interfaces": False, "threads": 1,
    }  # fmt: skip
    expected = untangle(read_mesh(tangled_file), max_sweeps=1)
    assert facts["sweeps"] == expected.sweeps
    assert facts["after"] == expected.after.to_dict()
    assert code == (1 if expected.after.n_invalid else 0)


def test_untangle_leaves_a_valid_mesh(call, mesh_file, tmp_path):
    out_file = tmp_path / "out.off"
    code, out, _ = call("untangle", mesh_file, "-o", out_file)
    assert code == 0
    assert "there was nothing to untangle" in out
    assert out_file.read_bytes() == mesh_file.read_bytes()


def test_untangle_overwrites_nothing(fails, tangled_file, tmp_path):
    before = tangled_file.read_bytes()
    assert "OUT is the input" in fails("untangle", tangled_file, "-o", tangled_file)
    assert tangled_file.read_bytes() == before
    other = tmp_path / "other.off"
    other.write_text("precious")
    assert "exists; --overwrite" in fails("untangle", tangled_file, "-o", other)
    assert other.read_text() == "precious"


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--sweeps", -1], "--sweeps must be an integer of 0 or more, got -1"),
        (["--time-limit", 0], "--time-limit must be over 0 seconds"),
        (["--threads", 0], "--threads must be an integer of 1 or more"),
    ],
)
def test_untangle_refuses(fails, tangled_file, tmp_path, arguments, message):
    assert message in fails("untangle", tangled_file, "-o", tmp_path / "out.off", *arguments)
    assert not (tmp_path / "out.off").exists()
