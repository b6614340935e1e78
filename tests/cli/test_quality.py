"""``qsmooth quality``."""

import json
import re

import pytest

from qsmooth import limits, quality, read_mesh
from qsmooth.metrics import METRICS, parse_metrics

pytestmark = pytest.mark.nojit


def test_quality_shows_the_limits(call, mesh_file):
    _, out, _ = call("quality", mesh_file)
    bounds = limits(read_mesh(mesh_file))
    assert f"no placement of this connectivity can exceed {bounds.min_angle:.2f}°" in out
    for line in str(bounds).splitlines():
        assert f"  {line[0].upper()}{line[1:]}.\n" in out
    facts = json.loads(call("quality", mesh_file, "--json", "-")[1])
    assert facts["limits"] == bounds.to_dict()


def test_quality_shows_extremes_and_worst_cells(call, mesh_file):
    code, out, err = call("quality", mesh_file, "--worst", 4, "--worst-by", "max_angle")
    assert (code, err) == (0, "")
    measured = quality(read_mesh(mesh_file))
    assert re.search(rf"Largest angle +{measured.max_angle.max():.2f}°", out)
    assert "Cells not valid" in out
    assert "The 4 worst cells by largest angle" in out
    for cell in measured.worst(4, "max_angle").cells:
        assert re.search(rf"^{cell} +[-\d.]+ +[-\d.]+ .* valid$", out, re.MULTILINE)


@pytest.mark.parametrize(
    ("arguments", "code"),
    [
        ([], 0),
        (["--fail-below", "min_angle=1"], 0),
        (["--fail-below", "min-angle=80"], 1),
        (["--fail-above", "aspect_ratio=1e6"], 0),
        (["--fail-above", "max_angle=120"], 1),
        (["--fail-below", "min_angle=1", "--fail-above", "max_angle=120"], 1),
        (["--fail-below", "min_angle=1", "--fail-below", "shape=0.9999"], 1),
        (["--fail-below", "scaled_jacobian=-1", "--fail-above", "max_angle=180"], 0),
        (["--fail-invalid"], 0),
    ],
)
def test_gate(call, mesh_file, arguments, code):
    found, out, _ = call("quality", mesh_file, *arguments)
    assert found == code
    assert ("FAILED: " in out) == (code == 1)


def test_gate_says_how_many_and_the_worst(call, mesh_file):
    _, out, _ = call("quality", mesh_file, "--fail-below", "min_angle=40")
    smallest = quality(read_mesh(mesh_file)).min_angle
    n_bad, worst = int((smallest < 40).sum()), int(smallest.argmin())
    assert f"FAILED: {n_bad} cells of {len(smallest)} with the smallest angle below 40" in out
    assert f"the worst: cell {worst} has {smallest[worst]:.2f}°" in out


def test_gate_at_the_limit_itself_passes(call, tmp_path):
    path = tmp_path / "square.off"
    path.write_text("OFF\n4 1 0\n0 0 0\n2 0 0\n2 1 0\n0 1 0\n4 0 1 2 3\n")
    limits = ["--fail-above", "aspect_ratio=2", "--fail-below", "aspect_ratio=2"]
    assert call("quality", path, *limits)[0] == 0
    assert call("quality", path, "--fail-above", "aspect_ratio=1.999")[0] == 1


def test_gate_on_validity(call, tmp_path):
    path = tmp_path / "concave.off"
    path.write_text("OFF\n4 1 0\n0 0 0\n2 0 0\n0.5 0.5 0\n0 2 0\n4 0 1 2 3\n")
    code, out, _ = call("quality", path)
    assert code == 0  # nothing was asked for
    assert "concave" in out
    code, out, _ = call("quality", path, "--fail-invalid")
    assert code == 1
    assert "FAILED: 1 cell of 1 not valid; the first: cell 0" in out


@pytest.mark.parametrize(
    "limit", ["min_angle", "min_angle=", "=3", "beauty=3", "min_angle=x", "min_angle=nan", ""]
)
@pytest.mark.parametrize("option", ["--fail-below", "--fail-above"])
def test_bad_limits(fails, mesh_file, option, limit):
    assert option in fails("quality", mesh_file, option, limit)


def test_bad_count_of_worst_cells(fails, mesh_file):
    assert "--worst must be 0 or more, got -1" in fails("quality", mesh_file, "--worst", -1)


def test_quality_as_json(call, mesh_file, tmp_path):
    report = tmp_path / "report.json"
    limits = ["--fail-below", "min_angle=40", "--fail-invalid"]
    code, _, _ = call("quality", mesh_file, "--worst", 3, "--json", report, *limits)
    assert code == 1
    facts = json.loads(report.read_text())
    measured = quality(read_mesh(mesh_file))
    for name, value in measured.summary().to_dict().items():
        assert facts[name] == value
    assert [c["cell"] for c in facts["worst_cells"]] == measured.worst(3).cells.tolist()
    assert facts["worst_cells"][0]["state"] == "valid"
    assert facts["passed"] is False
    assert [check["passed"] for check in facts["checks"]] == [False, True]
    assert facts["checks"][0]["n_failed"] == int((measured.min_angle < 40).sum())


def test_infinite_figures_are_null_in_json(call, tmp_path):
    path = tmp_path / "collapsed.off"
    path.write_text("OFF\n4 1 0\n0 0 0\n1 0 0\n1 0 0\n0 1 0\n4 0 1 2 3\n")
    code, out, err = call("quality", path, "--json", "-", "--fail-above", "aspect_ratio=9")
    facts = json.loads(out, parse_constant=pytest.fail)
    assert code == 1
    assert facts["worst"]["aspect_ratio"] is None
    assert facts["checks"][0]["worst_value"] is None
    assert "failed: 1 cell of 1 with the aspect ratio above 9" in err


@pytest.mark.parametrize("name", list(METRICS))
def test_any_metric_is_shown_ranked_and_gated(call, mesh_file, name):
    gates = ["--fail-above", f"{name}=-1e9", "--fail-below", f"{name.replace('_', '-')}=-1e9"]
    code, out, _ = call("quality", mesh_file, "--metrics", name, "--worst-by", name, *gates)
    assert code == 1
    assert METRICS[name].worst_words in out
    assert METRICS[name].mean_words in out
    assert f"worst cells by {METRICS[name].words}" in out
    assert len(re.findall("FAILED|passed", out)) == 2


def test_metrics_are_chosen(call, mesh_file):
    arguments = ["quality", mesh_file, "--worst", 2, "--json", "-"]
    facts = json.loads(call(*arguments, "--metrics", "taper, min-edge,taper")[1])
    assert list(facts["worst"]) == list(facts["mean"]) == ["taper", "min_edge"]
    ranked = {"cell", "centre", "state", "taper", "min_edge", "scaled_jacobian"}
    assert set(facts["worst_cells"][0]) == ranked
    facts = json.loads(call(*arguments, "--metrics", "all")[1])
    assert list(facts["worst"]) == list(METRICS)
    facts = json.loads(call(*arguments)[1])
    assert list(facts["worst"]) == list(parse_metrics(None))


@pytest.mark.parametrize("option", ["--metrics", "--worst-by"])
def test_unknown_metrics(fails, mesh_file, option):
    message = fails("quality", mesh_file, option, "tapper")
    assert message.startswith(f"{option} must be one of min_angle,")
    assert message.endswith("got 'tapper'; did you mean 'taper'?")


def test_help_names_the_metrics(call):
    words = set(re.findall(r"\w+", call("quality", "--help")[1]))
    assert words.issuperset(METRICS)


def test_failed_checks_as_annotations_of_github(call, mesh_file):
    gates = "--fail-below", "min_angle=40", "--fail-above", "aspect_ratio=1e9"
    code, out, err = call("quality", mesh_file, *gates, "--github")
    assert (code, err) == (1, "")
    (line,) = [row for row in out.splitlines() if row.startswith("::")]
    failed = next(row for row in out.splitlines() if row.startswith("FAILED: "))
    title = f"::error file={mesh_file},title=qsmooth%3A min_angle not below 40::"
    assert line == title + failed.removeprefix("FAILED: ")
    code, out, err = call("quality", mesh_file, *gates, "--github", "--json", "-")
    assert code == 1
    assert not json.loads(out)["passed"]
    assert title in err
    code, out, _ = call("quality", mesh_file, "--fail-invalid", "--github")
    assert "::error" not in out
    assert code == 0


def test_what_would_end_an_annotation_is_escaped():
    from pathlib import Path

    from qsmooth.cli.checks import workflow_commands
    from qsmooth.metrics import Check

    check = Check(
        metric="validity", rule="invalid", threshold=None, n_failed=1, worst_cell=0,
        worst_value=None, text="100% of it,\nall: bad",
    )  # fmt: skip
    (line,) = workflow_commands(Path("a,b:c%.off"), [check])
    assert line == (
        "::error file=a%2Cb%3Ac%25.off,title=qsmooth%3A no cell invalid::100%25 of it,%0Aall: bad"
    )


def test_checks_as_junit(call, fails, mesh_file, tmp_path):
    from xml.etree import ElementTree

    report = tmp_path / "report.xml"
    gates = "--fail-below", "min_angle=40", "--fail-above", "aspect_ratio=1e9", "--fail-invalid"
    code, out, _ = call("quality", mesh_file, *gates, "--junit", report)
    assert code == 1
    suites = ElementTree.parse(report).getroot()
    assert (suites.tag, suites.get("tests"), suites.get("failures")) == ("testsuites", "3", "1")
    cases = {case.get("name"): case for case in suites.iter("testcase")}
    assert list(cases) == [
        "min_angle not below 40",
        "aspect_ratio not above 1e+09",
        "no cell invalid",
    ]
    failures = {name: case.find("failure") for name, case in cases.items()}
    assert [name for name, failure in failures.items() if failure is not None] == [*cases][:1]
    message = failures["min_angle not below 40"].get("message")
    assert f"FAILED: {message}" in out
    assert all(case.get("classname") == str(mesh_file) for case in cases.values())
    assert call("quality", mesh_file, "--junit", report)[0] == 0
    assert ElementTree.parse(report).getroot().get("tests") == "0"
    message = fails("quality", mesh_file, "--junit", mesh_file)
    assert message == f"--junit would write over the file '{mesh_file}'"
    assert "--junit would write" in fails("quality", mesh_file, "--junit", "a", "--json", "a")
    assert "its folder is not there" in fails("quality", mesh_file, "--junit", tmp_path / "a" / "b")
