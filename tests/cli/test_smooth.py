"""``qsmooth smooth``."""

import json
import os
import signal
import sys

import meshio
import numpy as np
import pytest

from qsmooth import Mesh, limits, read_mesh, smooth, transfer, write_mesh
from qsmooth.examples import spiral

pytestmark = pytest.mark.nojit


def test_smooth_writes_what_python_gives(call, mesh_file, tmp_path):
    out_file = tmp_path / "out.off"
    before = mesh_file.read_bytes()
    code, out, err = call("smooth", mesh_file, "-o", out_file, "--sweeps", 5)
    assert (code, err) == (0, "")
    mesh = read_mesh(mesh_file)
    expected = smooth(mesh, max_sweeps=5)
    assert np.array_equal(read_mesh(out_file).points, expected.mesh.points)
    assert mesh_file.read_bytes() == before
    for words in ("Before", "After", "Largest angle", "Cells not valid", "better by"):
        assert words in out
    assert "Optimise: 5 sweeps in" in out
    assert "stopped after 5 sweeps, as --sweeps says" in out
    assert f"Wrote {out_file}" in out
    assert "\x1b" not in out


OPTIONS = [
    ("quad", {
        "rtol": 0.0, "guard": "clearance", "max_angle": 130.0, "min_angle": 50.0,
        "triangle_max_angle": 100.0, "triangle_min_angle": 40.0, "step": 0.25,
        "worst_fraction": 0.5, "keep_interfaces": False, "threads": 1,
    }),
    ("star", {
        "worst_fraction": 0.3, "worst_first": True, "bad_angle": 150.0, "bad_step": 0.5,
        "selection": "max_angle > 130", "selection_rings": 1,
    }),
    ("optimize", {
        "worst": False, "stop_quality": 0.9, "time_limit": 1000.0, "mean_loss": 0.2,
        "objective": "shape-size", "size_weight": 0.5, "target": "initial",
        "hold": ["aspect_ratio", "shape"], "selection": [3, 7, 12], "selection_rings": 2,
    }),
    ("aspect-ratio", {"split_quads": "first", "max_edge_ratio": 1.5}),
    ("angle", {"guard": "none", "step": 0.5}),
    ("smart-laplacian", {"weights": "area"}),
]  # fmt: skip


@pytest.mark.parametrize(("method", "options"), OPTIONS, ids=[m for m, _ in OPTIONS])
def test_smooth_takes_every_option(call, mesh_file, tmp_path, method, options):
    report = tmp_path / "report.json"
    code, _, _ = call(
        "smooth", mesh_file, "-o", tmp_path / "out.off", "--method", method, "--sweeps", 30,
        "--json", report, *arguments_for(options),
    )  # fmt: skip
    assert code == 0
    expected = smooth(read_mesh(mesh_file), method, max_sweeps=30, **options)
    assert np.array_equal(read_mesh(tmp_path / "out.off").points, expected.mesh.points)
    facts = json.loads(report.read_text())
    assert facts["options"] == {"sweeps": 30, **options}
    assert facts["method"] == method


def arguments_for(options):
    """Options of Python as they are written in the shell."""
    words = []
    for name, value in options.items():
        option = "--" + name.replace("_", "-")
        if isinstance(value, list):
            value = ",".join(map(str, value))
        if isinstance(value, bool):
            words += [option if value else option.replace("--", "--no-", 1)]
        else:
            words += [option, value]
    return words


def test_smooth_reports_as_json(call, mesh_file, tmp_path):
    report = tmp_path / "report.json"
    assert (
        call("smooth", mesh_file, "-o", tmp_path / "out.off", "--no-worst", "--json", report)[0]
        == 0
    )
    facts = json.loads(report.read_text())
    result = smooth(read_mesh(mesh_file), worst=False)
    assert facts["method"] == "optimize"
    assert facts["sweeps"] == result.sweeps
    assert len(facts["history"]) == len(result.history)
    assert facts["options"] == {"worst": False}
    assert facts["limits"] == limits(result.mesh).to_dict()
    assert facts["converged"] is result.converged
    assert facts["reason"] == result.reason
    assert facts["before"] == result.before.to_dict()
    assert facts["after"] == result.after.to_dict()
    assert facts["outcome"]["stop"] == result.outcome.stop
    assert facts["outcome"]["sweeps"] == result.sweeps
    assert [stage["aim"] for stage in facts["outcome"]["stages"]] == [
        stage.aim for stage in result.outcome.stages
    ]
    assert facts["history"][0]["n_moved"] == result.history[0].n_moved


def test_smooth_prints_json_alone(call, mesh_file, tmp_path):
    code, out, _ = call(
        "smooth", mesh_file, "-o", tmp_path / "out.off", "--sweeps", 1, "--json", "-"
    )
    assert code == 0
    assert json.loads(out)["method"] == "optimize"


def test_out_format_goes_by_its_ending(call, mesh_file, tmp_path):
    assert call("smooth", mesh_file, "-o", tmp_path / "out.obj", "--sweeps", 1)[0] == 0
    assert (tmp_path / "out.obj").read_text().startswith(("v ", "#", "o "))
    named = tmp_path / "out.txt"
    assert call("smooth", mesh_file, "-o", named, "--output-format", "obj", "--sweeps", 1)[0] == 0
    assert call("quality", named, "--format", "obj")[0] == 0


@pytest.fixture
def heard():
    """Ctrl-C is heard; a shell has what it runs in the background ignore it."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.mark.usefixtures("heard")
@pytest.mark.skipif(os.name != "posix", reason="signals are others elsewhere")
@pytest.mark.parametrize("command", ["smooth", "untangle"])
@pytest.mark.parametrize("keep", ["best", "best, but OUT is there", "nothing"])
def test_an_interrupted_run(call, mesh_file, tmp_path, monkeypatch, command, keep):
    from qsmooth.examples import tangled
    from qsmooth.methods.watching import Watch

    tell, told = Watch.tell, []

    def press(self, record):
        if not told:
            os.kill(os.getpid(), signal.SIGINT)
        told.append(record)
        tell(self, record)

    monkeypatch.setattr(Watch, "tell", press)
    if command == "untangle":
        write_mesh(mesh_file, tangled(8, 8, amount=3.0))
    out, options = tmp_path / "out.off", []
    if keep != "nothing":
        options = ["--keep-best"]
    if keep == "best, but OUT is there":
        out.write_bytes(b"precious")
        options.append("--overwrite")
    code, said, err = call(command, mesh_file, "-o", out, *options)
    assert (code, said) == (130, "")
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
    if keep == "best":
        assert err == f"qsmooth: interrupted, wrote the best so far, {out}\n"
        assert len(told) == 1
        assert not np.array_equal(read_mesh(out).points, read_mesh(mesh_file).points)
    elif keep == "nothing":
        assert err == "qsmooth: interrupted\n"
        assert not out.exists()
    else:
        assert err == f"qsmooth: interrupted, '{out}' is left as it was\n"
        assert out.read_bytes() == b"precious"


def test_input_is_safe_without_overwrite(fails, mesh_file):
    before = mesh_file.read_bytes()
    assert "OUT is the input" in fails("smooth", mesh_file, "-o", mesh_file)
    other = mesh_file.parent / "." / "x" / ".." / mesh_file.name
    (mesh_file.parent / "x").mkdir()
    assert "OUT is the input" in fails("smooth", mesh_file, "-o", other)
    assert mesh_file.read_bytes() == before


@pytest.mark.skipif(os.name != "posix", reason="needs links")
@pytest.mark.parametrize("kind", ["symbolic", "hard"])
def test_input_is_safe_behind_a_link(fails, mesh_file, tmp_path, kind):
    link = tmp_path / "link.off"
    link.symlink_to(mesh_file) if kind == "symbolic" else link.hardlink_to(mesh_file)
    before = mesh_file.read_bytes()
    assert "OUT is the input" in fails("smooth", mesh_file, "-o", link)
    assert "OUT is the input" in fails("smooth", link, "-o", mesh_file)
    assert mesh_file.read_bytes() == before


def test_another_file_is_safe_without_overwrite(fails, call, mesh_file, tmp_path):
    other = tmp_path / "other.off"
    other.write_text("precious")
    assert "exists; --overwrite" in fails("smooth", mesh_file, "-o", other)
    assert other.read_text() == "precious"
    assert call("smooth", mesh_file, "-o", other, "--overwrite", "--sweeps", 1)[0] == 0
    assert read_mesh(other).n_cells == read_mesh(mesh_file).n_cells


def test_overwrite_allows_the_input(call, mesh_file):
    expected = smooth(read_mesh(mesh_file), max_sweeps=2).mesh.points
    assert call("smooth", mesh_file, "-o", mesh_file, "--overwrite", "--sweeps", 2)[0] == 0
    assert np.array_equal(read_mesh(mesh_file).points, expected)


@pytest.mark.parametrize("command", [["smooth", "-o", "OUT"], ["quality"], ["compare"], ["info"]])
def test_json_does_not_destroy_the_mesh(fails, mesh_file, tmp_path, command):
    before = mesh_file.read_bytes()
    name, *more = [str(tmp_path / "out.off") if word == "OUT" else word for word in command]
    assert "--json" in fails(name, mesh_file, *more, "--json", mesh_file)
    assert mesh_file.read_bytes() == before
    assert "its folder is not there" in fails(
        name, mesh_file, *more, "--json", tmp_path / "n" / "j"
    )


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--sweeps", -1], "--sweeps must be an integer of 0 or more, got -1"),
        (["--rtol", 1], "--rtol must be in [0, 1), got 1.0"),
        (["--rtol", "nan"], "--rtol must be in [0, 1), got nan"),
        (["--step", 0], "--step must be in (0, 1], got 0.0"),
        (["--worst-fraction", 2], "--worst-fraction must be in (0, 1], got 2.0"),
        (["--method", "star", "--max-angle", 50], "--max-angle must be over --min-angle"),
        (["--triangle-min-angle", -5], "--triangle-min-angle must be in (0, 180)"),
        (["--threads", 0], "--threads must be an integer of 1 or more"),
        (["--method", "magic"], "--method must be one of auto, optimize, angle"),
        (["--method", "laplacian", "--step", 0.2], "no option --step"),
        (["--method", "laplacian", "--max-angle", 130], "no option --max-angle"),
        (["--step", 0.2], "method 'optimize' has no option --step (auto chose optimize)"),
        (["--method", "star", "--worst-first"], "--worst-first needs a --worst-fraction below 1"),
        (["--method", "star", "--bad-angle", 400], "--bad-angle must be in (0, 360)"),
        (["--method", "star", "--bad-step", 3], "--bad-step must be in (0, 2]"),
        (["--method", "star", "--guard", "none"], "--guard must be 'quality' or 'clearance'"),
        (["--method", "star", "--no-worst"], "method 'star' has no option --worst"),
        (["--method", "aspect-ratio"], "--split-quads shorter cuts the quads in two"),
        (["--max-edge-ratio", 0.5], "--max-edge-ratio must be 1 or more"),
        (["--selection", "3,x"], "--selection takes cell ids such as 3,7,12 or a threshold such"),
        (["--selection", "beauty > 3"], "such as 'max_angle > 150' on one of min_angle,"),
        (["--selection", "2,100000"], "1 cell id in --selection is outside 0 .. "),
        (["--selection-rings", -1], "--selection-rings must be an integer of 0 or more"),
        (["--stop-quality", 2], "--stop-quality must be in (0, 1], got 2.0"),
        (
            ["--hold", "aspect"],
            "--hold takes 'aspect_ratio', 'shape' or 'min_edge', got 'aspect'; "
            "did you mean 'aspect_ratio'?",
        ),
        (
            ["--target", "idle"],
            "--target must be 'auto', 'ideal' or 'initial', got 'idle'; did you mean 'ideal'?",
        ),
        (["--size-weight", -1], "--size-weight must be 0 or more, got -1.0"),
        (["--time-limit", 0], "--time-limit must be over 0 seconds, got 0.0"),
        (["--mean-loss", 1], "--mean-loss must be in [0, 1), got 1.0"),
        (["--weights", "heavy"], "--weights must be 'uniform' or 'area', got 'heavy'"),
        (["--objective", "beauty"], "--objective"),
        (["--split-quads", "longer"], "--split-quads"),
    ],
)
def test_options_out_of_range(fails, mesh_file, tmp_path, arguments, message):
    out_file = tmp_path / "out.off"
    report = tmp_path / "out.json"
    assert message in fails("smooth", mesh_file, "-o", out_file, "--json", report, *arguments)
    assert not out_file.exists()
    assert not report.exists()


def test_places_that_cannot_be_written(fails, mesh_file, tmp_path):
    assert "there is no folder" in fails("smooth", mesh_file, "-o", tmp_path / "no" / "out.off")
    assert "is a folder" in fails("smooth", mesh_file, "-o", tmp_path)
    out_file = tmp_path / "out.off"
    assert "takes a folder" in fails("smooth", mesh_file, "-o", out_file, "--plot", mesh_file)
    assert not out_file.exists()


def test_smooth_with_figures(call, mesh_file, tmp_path, monkeypatch):
    pytest.importorskip("matplotlib")
    monkeypatch.setattr("qsmooth.output.figures.VIEWS", ("worst",))  # for speed
    folder = tmp_path / "figures"
    code, out, _ = call(
        "smooth", mesh_file, "-o", tmp_path / "out.off", "--sweeps", 2, "--plot", folder,
        "--plot-metric", "shape",
    )  # fmt: skip
    assert code == 0
    assert f"Wrote {tmp_path / 'out.off'} and {folder}" in out
    assert {path.suffix for path in folder.iterdir()} == {".png", ".svg"}


def test_figures_without_matplotlib(fails, mesh_file, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    monkeypatch.setitem(sys.modules, "matplotlib.figure", None)
    out_file = tmp_path / "out.off"
    message = fails("smooth", mesh_file, "-o", out_file, "--plot", tmp_path / "figures")
    assert "pip install 'qsmooth[plot]'" in message
    assert not out_file.exists()  # said before the work, not after


def test_z_as_a_value(call, fails, tmp_path):
    mesh = spiral(300)
    path = tmp_path / "bed.off"
    bed = np.sin(9 * mesh.points[:, 0])
    write_mesh(path, Mesh(np.column_stack([mesh.points, bed]), mesh.cells, surface="flat"))
    assert "--surface flat" in fails("quality", path)
    for command in (["quality"], ["info"], ["compare", "--sweeps", 2]):
        assert call(command[0], path, "--surface", "flat", *command[1:])[0] == 0
    out_file = tmp_path / "out.off"
    assert call("smooth", path, "-o", out_file, "--surface", "flat", "--sweeps", 20)[0] == 0
    old, new = (read_mesh(p, surface="flat") for p in (path, out_file))
    z = transfer(old, new, old.points[:, 2])
    assert np.array_equal(z, new.points[:, 2])
    assert not np.array_equal(z, old.points[:, 2])
    flags = "--surface", "flat", "--sweeps", 20, "--overwrite", "--carry", "keep"
    code, out, _ = call("smooth", path, "-o", out_file, *flags)
    assert code == 0
    assert "z was carried along unchanged and is wrong by up to" in " ".join(out.split())
    assert "--carry interpolate mends that" in " ".join(out.split())
    kept = read_mesh(out_file, surface="flat")
    assert np.array_equal(kept.points[:, 2], old.points[:, 2])
    assert np.array_equal(kept.xy, new.xy)


@pytest.mark.parametrize("given", [["bed, east"], ["bed", "east"], ["u, v"], ["u, v", "bed,east"]])
def test_names_of_point_data_are_told_apart(call, tmp_path, given):
    mesh = spiral(300)
    x, y = mesh.points.T
    path, out_file = tmp_path / "in.vtu", tmp_path / "out.vtu"
    data = {"bed": x + y, "east": x, "u, v": mesh.points + 1.0}
    meshio.Mesh(mesh.points, [("quad", mesh.cells[0])], point_data=data).write(path)
    words = [word for name in given for word in ("--interpolate", name)]
    assert call("smooth", path, "-o", out_file, "--method", "star", "--sweeps", 3, *words)[0] == 0
    new = meshio.read(out_file)
    x, y = new.points[:, :2].T
    expected = {"bed": x + y, "east": x, "u, v": new.points[:, :2] + 1.0}
    for name in data:
        named = any(name in each for each in given)
        same = np.allclose(new.point_data[name], expected[name], atol=1e-12)
        assert same == named
        assert np.array_equal(new.point_data[name], data[name]) != named


def test_point_data_is_interpolated_where_it_is_named(call, fails, tmp_path):
    mesh = spiral(300)
    data = {"bed": mesh.points @ [2.0, 3.0], "wind": np.cos(mesh.points), "id": np.arange(9)}
    data["id"] = np.arange(mesh.n_vertices)
    path, out_file = tmp_path / "in.vtu", tmp_path / "out.vtu"
    meshio.Mesh(mesh.points, [("quad", mesh.cells[0])], point_data=data).write(path)
    flags = "--sweeps", 20, "--interpolate", "bed"
    code, out, _ = call("smooth", path, "-o", out_file, *flags)
    assert code == 0
    assert "bed was interpolated in the input mesh" in " ".join(out.split())
    new = meshio.read(out_file)
    np.testing.assert_allclose(new.point_data["bed"], new.points[:, :2] @ [2.0, 3.0], atol=1e-12)
    assert np.array_equal(new.point_data["wind"], data["wind"])
    for name, words in (("bad", "did you mean 'bed'?"), ("id", "floats, 'id' is int64")):
        assert words in fails("smooth", path, "-o", tmp_path / "no.vtu", "--interpolate", name)
    message = fails("smooth", path, "-o", tmp_path / "no.off", *flags)
    assert f"--interpolate: format off of '{tmp_path / 'no.off'}' holds no point data" in message
    assert not (tmp_path / "no.off").exists()
    assert call("untangle", path, "-o", tmp_path / "no.vtu", "--interpolate", "bed")[0] == 0


def test_smooth_shows_the_limits_on_lines_of_their_own(call, mesh_file, tmp_path):
    out_file = tmp_path / "out.off"
    code, out, _ = call("smooth", mesh_file, "-o", out_file, "--sweeps", 20)
    assert code == 0
    for line in str(limits(read_mesh(out_file))).splitlines():
        assert f"\n  {line[0].upper()}{line[1:]}.\n" in out
    assert out.count("no placement of this connectivity") == 2
    code, out, _ = call("smooth", mesh_file, "-o", tmp_path / "star.off", "--method", "star")
    assert out.count("no placement of this connectivity") == 2


@pytest.mark.parametrize("command", ["smooth", "untangle"])
def test_unknown_endings_are_refused_before_the_work(fails, call, mesh_file, tmp_path, command):
    message = fails(command, mesh_file, "-o", tmp_path / "out.ofg")
    assert "unknown ending '.ofg', known are " in message
    assert message.endswith("; did you mean '.off'?")
    assert not (tmp_path / "out.ofg").exists()
    assert "unknown format 'oof'" in fails(
        command, mesh_file, "-o", tmp_path / "out", "--output-format", "oof"
    )
    done = call(command, mesh_file, "-o", tmp_path / "out", "--sweeps", 1)
    assert done[0] == 0  # no ending: as IN
    assert (tmp_path / "out").read_text().startswith("OFF")
    named = tmp_path / "mesh.txt"
    named.write_bytes(mesh_file.read_bytes())
    done = call(command, named, "--format", "off", "-o", tmp_path / "out.txt", "--sweeps", 1)
    assert done[0] == 0  # the ending that IN has
