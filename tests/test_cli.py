import inspect
import io
import json
import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from qsmooth import Mesh, __version__, cli, limits, quality, read_mesh, smooth, untangle, write_mesh
from qsmooth.cli import run
from qsmooth.examples import random_triangles, spiral, tangled

pytestmark = pytest.mark.nojit

COMMANDS = ["smooth", "untangle", "quality", "compare", "info", "demo"]


@pytest.fixture(autouse=True)
def coarse(monkeypatch):
    """Figures of fewer pixels, for speed."""
    monkeypatch.setattr("qsmooth.plot.DPI", 40)


@pytest.fixture
def mesh_file(tmp_path):
    path = tmp_path / "mesh.off"
    write_mesh(path, spiral(300, seed=1))
    return path


@pytest.fixture
def call(capsys):
    """Run the command line; gives its exit code, standard output and standard error."""

    def run_it(*arguments):
        code = run([str(argument) for argument in arguments])
        out, err = capsys.readouterr()
        assert "Traceback" not in out + err
        return code, out, err

    return run_it


@pytest.fixture
def fails(call):
    """Run the command line and expect an error, of which it gives the one line."""

    def run_it(*arguments):
        code, out, err = call(*arguments)
        assert code == 2
        assert out == ""
        assert err.startswith("qsmooth: error: ")
        assert err.count("\n") == 1
        assert err.endswith("\n")
        return err.removeprefix("qsmooth: error: ").strip()

    return run_it


def start(*arguments, **options):
    """Run the command line in a process of its own."""
    source = str(Path(sys.modules["qsmooth"].__file__).parent.parent)
    environment = {**os.environ, "PYTHONPATH": source, "PYTHONIOENCODING": "utf-8"}
    environment.update(options.pop("environment", {}))
    return subprocess.run(
        [sys.executable, *arguments], capture_output=True, text=True, env=environment,
        timeout=120, check=False, encoding="utf-8", **options,
    )  # fmt: skip


# What every command has in common.


def test_version(call):
    assert call("--version") == (0, f"qsmooth {__version__}\n", "")


def test_as_a_module():
    done = start("-m", "qsmooth", "--version")
    assert (done.returncode, done.stdout, done.stderr) == (0, f"qsmooth {__version__}\n", "")


@pytest.mark.parametrize("arguments", [[], ["--help"], ["-h"]])
def test_help_names_the_commands(call, arguments):
    code, out, err = call(*arguments)
    assert (code, err) == (0, "")
    assert all(command in out for command in COMMANDS)


@pytest.mark.parametrize("command", COMMANDS)
def test_help_of_a_command(call, command):
    code, out, err = call(command, "--help")
    assert (code, err) == (0, "")
    assert f"qsmooth {command}" in out


def test_help_loads_nothing_heavy():
    code = (
        "import sys; from qsmooth.cli import run; run(['smooth', '--help']); "
        "print([m for m in ('numba', 'numpy', 'meshio', 'matplotlib') if m in sys.modules])"
    )
    assert start("-c", code).stdout.splitlines()[-1] == "[]"


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["polish"], "No such command 'polish'"),
        (["quality"], "Missing argument 'IN'"),
        (["smooth", "a.off"], "Missing option '--output'"),
        (["smooth", "a.off", "-o", "b.off", "--sweeps", "many"], "--sweeps"),
        (["quality", "a.off", "--surface", "round"], "--surface"),
        (["quality", "a.off", "--fast"], "--fast"),
    ],
)
def test_wrong_command_line(fails, arguments, message):
    assert message in fails(*arguments)


@pytest.mark.parametrize("command", ["quality", "info", "compare"])
def test_no_such_file(fails, tmp_path, command):
    assert "No such file" in fails(command, tmp_path / "nothing.off")


@pytest.mark.parametrize("command", ["quality", "info", "compare"])
def test_no_mesh_in_the_file(fails, tmp_path, command):
    path = tmp_path / "bad.off"
    path.write_text("OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 7\n")
    assert str(path) in fails(command, path)


def test_debug_shows_the_traceback(tmp_path, capsys, monkeypatch):
    path = str(tmp_path / "nothing.off")
    assert run(["quality", path, "--debug"]) == 2
    err = capsys.readouterr().err
    assert "Traceback" in err
    assert err.splitlines()[-1].startswith("qsmooth: error: ")
    monkeypatch.setenv("QSMOOTH_DEBUG", "1")
    assert run(["quality", path]) == 2
    assert "Traceback" in capsys.readouterr().err
    monkeypatch.setenv("QSMOOTH_DEBUG", "0")
    assert run(["quality", path]) == 2
    assert "Traceback" not in capsys.readouterr().err


@pytest.mark.parametrize(
    ("error", "code", "message"),
    [
        (MemoryError(), 2, "qsmooth: error: there is not enough memory for this mesh\n"),
        (PermissionError(13, "Permission denied", "x.off"), 2,
         "qsmooth: error: Permission denied: 'x.off'\n"),
        (ZeroDivisionError("one\ntwo"), 2,
         "qsmooth: error: ZeroDivisionError: one two; --debug shows where\n"),
        (KeyboardInterrupt(), 130, "qsmooth: interrupted\n"),
    ],
)  # fmt: skip
def test_whatever_goes_wrong_is_one_line(capfd, monkeypatch, mesh_file, error, code, message):
    def fail(*_arguments, **_options):
        raise error

    monkeypatch.setattr("qsmooth.io.read_mesh", fail)
    assert run(["quality", str(mesh_file)]) == code
    assert capfd.readouterr().err.lstrip() == message  # some versions of Typer break the line


@pytest.mark.skipif(os.name != "posix", reason="pipes break otherwise elsewhere")
def test_reader_who_leaves_is_no_failed_gate(mesh_file):
    process = subprocess.Popen(
        [sys.executable, "-m", "qsmooth", "quality", str(mesh_file), "--worst", "300"],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE,
        env={**os.environ, "PYTHONPATH": str(Path(sys.modules["qsmooth"].__file__).parents[1])},
    )  # fmt: skip
    process.stdout.close()
    assert process.wait(120) == 141
    assert process.stderr.read() == b""
    process.stderr.close()


def test_mesh_warnings_are_one_line(call, tmp_path):
    from qsmooth.errors import MeshWarning

    path = tmp_path / "mesh.vtk"
    mesh = spiral(300)
    write_mesh(path, Mesh(mesh.points, mesh.cells, regions=np.arange(mesh.n_cells) % 2))
    code, _, err = call("smooth", path, "-o", tmp_path / "out.off", "--sweeps", 1)
    assert code == 0
    assert re.fullmatch(r"qsmooth: warning: [^\n]*2 regions[^\n]*\n", err)
    assert issubclass(MeshWarning, UserWarning)


def test_poor_terminals_get_plain_signs(mesh_file):
    done = start(
        "-m", "qsmooth", "quality", str(mesh_file), environment={"PYTHONIOENCODING": "ascii"}
    )
    assert done.returncode == 0
    assert done.stdout.isascii()
    assert "####" in done.stdout


# smooth


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
    assert "--sweeps 5 was reached" in out
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
        "worst": False, "target_quality": 0.9, "time_limit": 1000.0, "mean_loss": 0.2,
        "objective": "shape", "selection": [3, 7, 12], "selection_rings": 2,
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


def test_every_option_of_python_is_one_of_the_shell():
    taken = {"callback", "mesh", "method", "max_sweeps"}
    options = set(inspect.signature(smooth).parameters) - taken
    assert options == {name for _, options in OPTIONS for name in options}
    for command in ("smooth", "compare"):
        names = inspect.signature(getattr(cli, command)).parameters
        assert options | {"sweeps"} <= set(names)


def arguments_for(options):
    """Options of Python as they are written in the shell."""
    words = []
    for name, value in options.items():
        option = "--" + name.replace("_", "-")
        if name == "selection" and not isinstance(value, str):
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
        (["--max-angle", 50], "--max-angle must be over --min-angle"),
        (["--triangle-min-angle", -5], "--triangle-min-angle must be in (0, 180)"),
        (["--threads", 0], "--threads must be an integer of 1 or more"),
        (["--method", "magic"], "--method must be one of auto, optimize, star, quad"),
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
        (["--target-quality", 2], "--target-quality must be in (0, 1], got 2.0"),
        (["--time-limit", 0], "--time-limit must be over 0 seconds, got 0.0"),
        (["--mean-loss", 1], "--mean-loss must be in [0, 1), got 1.0"),
        (["--weights", "heavy"], "--weights"),
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
    monkeypatch.setattr("qsmooth.plot.VIEWS", ("worst",))  # for speed
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
    z = [read_mesh(p, surface="flat").points[:, 2] for p in (path, out_file)]
    assert np.array_equal(*z)


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
    assert "unknown ending '.ofg', known are abaqus, gmsh" in message
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


# untangle


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


# quality


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


# compare


def test_compare_puts_methods_side_by_side(call, mesh_file):
    before = mesh_file.read_bytes()
    code, out, err = call("compare", mesh_file, "--sweeps", 4)
    assert (code, err) == (0, "")
    head = next(line for line in out.splitlines() if "Original" in line)
    for name in ("Optimise", "By star", "By quad", "Angle-based", "Laplacian", "Smart Laplacian"):
        assert name in head
        assert f"{name}: 4 sweeps in" in out
    assert "By aspect ratio" not in head
    assert "By aspect ratio: skipped; method 'aspect-ratio' is for triangles" in out
    assert "--split-quads shorter cuts the quads in two" in out
    assert re.search(r"Size ratio of neighbours +\d", out)
    assert "* best of the row" in out
    assert mesh_file.read_bytes() == before


def test_compare_takes_names_and_options(call, mesh_file, tmp_path):
    report = tmp_path / "report.json"
    code, out, _ = call(
        "compare", mesh_file, "--methods", "quad, laplacian,quad", "--sweeps", 3, "--step", 0.25,
        "--json", report,
    )  # fmt: skip
    assert code == 0
    assert "By star" not in out
    facts = json.loads(report.read_text())
    assert [m["method"] for m in facts["methods"]] == ["quad", "laplacian"]
    mesh = read_mesh(mesh_file)
    for found, options in zip(facts["methods"], [{"step": 0.25}, {}], strict=True):
        expected = smooth(mesh, found["method"], max_sweeps=3, **options)
        assert found["after"] == expected.after.to_dict()


def test_compare_on_triangles_has_the_extremes_of_each_method(call, tmp_path):
    path = tmp_path / "triangles.off"
    write_mesh(path, random_triangles(60))
    code, out, _ = call("compare", path)
    assert code == 0
    assert "skipped" not in out
    head = next(line for line in out.splitlines() if "Original" in line)
    assert "By aspect ratio" in head
    for label in ("Smallest angle", "Largest angle", "Largest aspect ratio"):
        (row,) = re.findall(rf"^{label}  .*$", out, re.MULTILINE)
        assert len(re.findall(r"[\d.]+", row)) == 8  # the original and seven methods
    assert out.count("no placement of this connectivity") == 2  # of the optimiser's result


def test_compare_hands_options_to_those_that_have_them(call, mesh_file, tmp_path):
    report = tmp_path / "report.json"
    code, _, _ = call(
        "compare", mesh_file, "--methods", "optimize,angle,aspect-ratio,star", "--sweeps", 20,
        "--no-worst", "--guard", "none", "--split-quads", "second", "--json", report,
    )  # fmt: skip
    assert code == 0
    facts = json.loads(report.read_text())
    assert facts["skipped"] == {}
    mesh = read_mesh(mesh_file)
    split = {"split_quads": "second"}
    own = [{"worst": False}, {"guard": "none", **split}, split, split]
    for found, options in zip(facts["methods"], own, strict=True):
        expected = smooth(mesh, found["method"], max_sweeps=20, **options)
        assert found["after"] == expected.after.to_dict()
        assert found["limits"] == limits(expected.mesh).to_dict()


def test_compare_says_in_json_what_was_skipped(call, mesh_file):
    facts = json.loads(call("compare", mesh_file, "--sweeps", 1, "--json", "-")[1])
    assert list(facts["skipped"]) == ["aspect-ratio"]
    assert len(facts["methods"]) == 6


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--methods", "star,quad", "--guard", "none"], "method star, quad knows no guard none"),
        (["--methods", "star", "--no-worst"], "method star has no option --worst"),
        (["--methods", "magic"], "--methods takes names out of optimize, star, quad"),
        (["--methods", ","], "got none"),
        (["--methods", "laplacian", "--step", 0.5], "method laplacian has no option --step"),
        (["--sweeps", -1], "--sweeps must be"),
    ],
)
def test_compare_refuses(fails, mesh_file, arguments, message):
    assert message in fails("compare", mesh_file, *arguments)


def test_no_sweep_at_all(call, mesh_file):
    code, out, _ = call("compare", mesh_file, "--sweeps", 0)
    assert code == 0
    assert "no sweep was asked for" in out


# info


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


# demo


def test_demo_needs_no_file(call, tmp_path, monkeypatch):
    pytest.importorskip("matplotlib")
    monkeypatch.chdir(tmp_path)
    code, out, err = call("demo", "--sweeps", 2)
    assert (code, err) == (0, "")
    folder = tmp_path / "qsmooth-demo"
    assert "Spiral: 1899 quads" in out
    assert "Smart Laplacian" in out
    assert "Wrote 16 figures, as PNG and SVG, into qsmooth-demo" in out
    assert quality(read_mesh(folder / "spiral-optimize.off")).n_invalid == 0
    assert read_mesh(folder / "spiral.off").n_cells == 1899
    assert (folder / "comparison-whole.png").exists()


def test_demo_without_matplotlib(call, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    monkeypatch.setitem(sys.modules, "matplotlib.figure", None)
    folder = tmp_path / "there"
    code, out, err = call("demo", "--sweeps", 1, "-o", folder)
    assert code == 0
    assert "Smart Laplacian" in out
    assert err.startswith("qsmooth: warning: no figures: ")
    assert sorted(path.name for path in folder.iterdir()) == ["spiral-optimize.off", "spiral.off"]


def test_demo_of_the_lake(call, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    monkeypatch.setitem(sys.modules, "matplotlib.figure", None)
    from qsmooth.examples import lake

    monkeypatch.setattr("qsmooth.examples.lake", lambda: lake(1000))
    code, out, _ = call("demo", "--mesh", "lake", "--sweeps", 1, "-o", tmp_path)
    assert code == 0
    assert re.search(r"^Lake: \d+ quads", out)
    names = sorted(path.name for path in tmp_path.iterdir())
    assert names == ["lake-optimize.off", "lake.off"]


def test_demo_refuses_a_file_for_a_folder(fails, mesh_file):
    assert "is a file" in fails("demo", "-o", mesh_file)


# On a terminal


class Terminal(io.StringIO):
    encoding = "utf-8"

    def isatty(self):
        return True


@pytest.mark.parametrize(
    "arguments",
    [["quality"], ["compare", "--sweeps", "3"], ["info"], ["smooth", "--sweeps", "3", "-o", "OUT"]],
    ids=lambda arguments: arguments[0],
)
def test_terminals_get_colour_and_progress(mesh_file, tmp_path, monkeypatch, arguments):
    out, err = Terminal(), Terminal()
    monkeypatch.setattr(sys, "stdout", out)
    monkeypatch.setattr(sys, "stderr", err)
    for name in ("NO_COLOR", "FORCE_COLOR"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("TERM", "xterm-256color")
    monkeypatch.setenv("COLUMNS", "90")
    command, *more = [str(tmp_path / "out.off") if word == "OUT" else word for word in arguments]
    assert run([command, str(mesh_file), *more]) == 0
    assert "\x1b[1m" in out.getvalue()
    bare = re.sub(r"\x1b\[[0-9;?]*[a-zA-Z]", "", out.getvalue())
    assert max(map(len, bare.splitlines())) <= 90
    assert "…" not in bare
    if command == "compare":
        assert "3 of 3 sweeps" in err.getvalue()
    if command == "smooth":  # the optimiser's rounds, whose count nobody knows
        assert "about 10 sweeps" in err.getvalue()
