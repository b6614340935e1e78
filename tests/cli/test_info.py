"""``qsmooth info``."""

import json
import re

import pytest

pytestmark = pytest.mark.nojit


def test_info_on_an_odd_mesh(call, tmp_path):
    path = tmp_path / "odd.off"
    # A square, a clockwise one on its own that shares a place with it, and an orphan.
    path.write_text(
        "OFF\n9 2 0\n0 0 0\n1 0 0\n1 1 0\n0 1 0\n1 1 0\n2 1 0\n2 2 0\n1 2 0\n7 7 0\n"
        "4 0 1 2 3\n4 4 7 6 5\n"
    )
    code, out, err = call("info", path)
    assert (code, err) == (0, "")
    assert re.search(r"Quads +2\n", out)
    assert re.search(r"Boundary loops +2\n", out)
    assert re.search(r"Orientation +mixed: 1 cell of 2 run clockwise", out)
    assert re.search(r"Orphan vertices +1, in no cell: vertices 8\n", out)
    assert re.search(r"Coincident vertices +1, .*: vertices 2-4\n", out)
    assert re.search(r"Hanging nodes +none", out)
    assert re.search(r"Disconnected parts +1, .*: cells 1\n", out)
    code, out, _ = call("info", path, "--json", "-")
    facts = json.loads(out)
    assert facts["findings"]["coincident vertices"] == {
        "count": 1, "kind": "vertices", "first": [[2, 4]],
    }  # fmt: skip
    assert facts["n_turned"] == 1


def test_info_cuts_ids(call, fails, tmp_path):
    path = tmp_path / "orphans.off"
    orphans = "".join(f"{k} 9 0\n" for k in range(20))
    path.write_text(f"OFF\n23 1 0\n0 0 0\n1 0 0\n0 1 0\n{orphans}3 0 1 2\n")
    _, out, _ = call("info", path, "--ids", 2)
    assert "20, in no cell: vertices 3, 4, ..." in out
    assert "--ids must be 0 or more" in fails("info", path, "--ids", -1)
