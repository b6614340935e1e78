"""Options of the shell are those of the methods: over the registry, none by hand."""

import json
import re
from dataclasses import dataclass
from types import MappingProxyType
from typing import Literal

import numpy as np
import pytest

from qsmooth import from_meshio, read_mesh, registry, smooth, to_meshio, write_mesh
from qsmooth.cli.app import COMMANDS
from qsmooth.cli.options import Command, default_words, range_words, spell
from qsmooth.methods.driver import Sweep, SweepingMethod
from qsmooth.options import option

pytestmark = pytest.mark.nojit

OFFERED = [
    pytest.param(method, spec, id=f"{name}-{spec.name}")
    for name, method in registry.all_methods().items()
    for spec in method.specs().values()
    if spec.flag is not None
]


def command_of(method):
    """Words that run a method."""
    return ["smooth", "--method", method.name] if method.listed else [method.name]


def other_value(spec):
    """A value that an option takes and that is not its default; in Python and in the shell."""
    flag = spell(spec.name)
    if spec.kind == "flag":
        value = not spec.default
        return value, [flag if value else flag.replace("--", "--no-", 1)]
    if spec.kind == "choice":
        written = [choice for choice in spec.choices if isinstance(choice, str)]
        value = next((choice for choice in written if choice != spec.default), written[0])
        return value, [flag, value]
    if spec.name == "hold":
        return ("aspect_ratio", "shape"), [flag, "shape,aspect_ratio"]
    if spec.name == "interpolate":
        return ("bed", "wind"), [flag, "bed", flag, "wind"]
    if spec.name == "target":
        return "initial", [flag, "initial"]
    if spec.name == "directions":
        return (0.0, 1.0), [flag, "0,1"]
    if spec.name == "fixed_file":
        return "file.txt", [flag, "file.txt"]
    if spec.name == "curve":
        return [[(0.0, 0.0), (1.0, 0.0)]], [flag, "curve.txt"]
    if spec.kind == "object":
        return [0, 1], [flag, "0,1"]
    low, high = spec.interval.low, min(spec.interval.high, spec.interval.low + 1e6)
    given = low if spec.default is None else spec.default
    value = given + 0.25 * (high - given) if given < high else given - 0.25 * (given - low)
    value = int(value) if spec.kind == "integer" else value
    return value, [flag, value]


def with_data(mesh_file, names):
    """The same mesh in a file that has point data of these names."""
    mesh, path = to_meshio(read_mesh(mesh_file)), mesh_file.with_suffix(".vtu")
    mesh.point_data = dict.fromkeys(names, mesh.points[:, 0])
    write_mesh(path, from_meshio(mesh))
    return path


def help_of(call, monkeypatch, *command):
    """Help with each option in one line."""
    monkeypatch.setenv("COLUMNS", "100")
    code, out, _ = call(*command, "--help")
    assert code == 0
    return re.sub(r"\n {3,}", " ", out)


@pytest.mark.parametrize(("method", "spec"), OFFERED)
def test_every_option_of_every_method_arrives(call, mesh_file, tmp_path, monkeypatch, method, spec):
    seen = []
    monkeypatch.setattr("qsmooth.cli.running.replace", lambda made, **_: seen.append(made) or made)
    monkeypatch.setattr(method, "run", lambda *_: 1 / 0)
    value, words = other_value(spec)
    needed = {"worst_first": {"worst_fraction": 0.5}, "curve": {"boundary": "slide"}}
    with_it = needed.get(spec.name, {})
    words += [word for name, given in with_it.items() for word in (spell(name), given)]
    out = tmp_path / "out.off"
    if spec.name == "interpolate":
        mesh_file, out = with_data(mesh_file, value), tmp_path / "out.vtu"
    if spec.name == "curve":
        words[1] = tmp_path / words[1]
        words[1].write_text("0 0\n1 0\n")
    name, *more = command_of(method)
    code, _, err = call(name, mesh_file, "-o", out, *more, *words)
    assert code == 2
    assert "ZeroDivisionError" in err  # it came as far as the run
    assert np.array_equal(getattr(seen[0], spec.name), value)
    others = set(seen[0].given()) - {spec.name}
    assert others == set(with_it)


@pytest.mark.parametrize(("method", "spec"), OFFERED)
def test_every_option_is_checked_under_its_name_in_the_shell(
    fails, mesh_file, tmp_path, method, spec
):
    name, *more = command_of(method)
    flag = spell(spec.name)
    wrong = {"number": "-1e9", "integer": "-7", "choice": "zebra", "object": "zebra"}
    words = [f"{flag}=maybe"] if spec.kind == "flag" else [flag, wrong[spec.kind]]
    message = fails(name, mesh_file, "-o", tmp_path / "out.off", *more, *words)
    assert flag in message
    if spec.interval is not None:
        assert range_words(spec) in message
    assert not (tmp_path / "out.off").exists()


@pytest.mark.parametrize("command", ["smooth", "compare", "untangle"])
def test_help_shows_each_option_once_with_range_and_default(call, monkeypatch, command):
    out = help_of(call, monkeypatch, command)
    (offers,) = [known for known in COMMANDS if known.name == command]
    words = re.sub(r"\s+", " ", out)
    for made in offers.made():
        lines = [line for line in out.splitlines() if re.search(rf"^  {made.flags[0]}\b", line)]
        (line,) = [line for line in lines if re.search(rf"{made.flags[0]}(,| )", line)]
        assert set(made.flags) <= set(re.findall(r"--[\w-]+", line))
        for spec in made.specs.values():
            assert range_words(spec).lower() in words.lower()
            assert all(str(choice) in line for choice in made.choices)
            assert not default_words(spec) or re.search(
                rf"\[default: [^\]]*{re.escape(default_words(spec))}", words
            )


def test_defaults_that_differ_are_said(call, monkeypatch):
    words = re.sub(r"\s+", " ", help_of(call, monkeypatch, "smooth"))
    assert "[default: 50; optimize 5000]" in words
    assert "[default: 0.25; angle 1, aspect-ratio 0.2]" in words
    assert "[default: as --step]" in words
    assert "by --bad-step instead of --step" in words
    assert "`" not in words


def test_demo_has_the_sweeps_only():
    (demo,) = [command for command in COMMANDS if command.name == "demo"]
    assert [made.name for made in demo.made()] == ["max_sweeps"]


def test_a_command_without_options():
    assert Command(lambda: None).made() == []


def test_options_have_their_own_names_too(call, mesh_file, tmp_path):
    report = tmp_path / "report.json"
    out_file = tmp_path / "out.off"
    assert call("smooth", mesh_file, "-o", out_file, "--max-sweeps", 2, "--json", report)[0] == 0
    facts = json.loads(report.read_text())
    assert facts["options"] == {"sweeps": 2}
    assert facts["outcome"]["stop"] == "max_sweeps"


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--method", "star", "--mean-loss", 0.2],
         "method 'star' has no option --mean-loss, it is of optimize"),
        (["--method", "laplacian", "--step", 0.2],
         "method 'laplacian' has no option --step, it is of angle, aspect-ratio, quad and star"),
        (["--method", "laplace"], "got 'laplace'; did you mean 'laplacian'?"),
        (["--method", "optimize", "--worst-fraction", 0.5], "no option --worst-fraction"),
        (["--max-sweps", 3], "--max-sweps"),
        (["--selection", "max_angel > 3"], "did you mean 'max_angle'?"),
        (["--plot-metric", "max_angel"], "--plot-metric must be one of"),
    ],
)  # fmt: skip
def test_what_was_meant(fails, mesh_file, tmp_path, arguments, message):
    assert message in fails("smooth", mesh_file, "-o", tmp_path / "out.off", *arguments)


@dataclass(frozen=True, kw_only=True)
class Toy(SweepingMethod):
    """Do nothing at all."""

    name = "toy"
    title = "Toy"
    purpose = "Leaves every vertex where it is; for tests."

    toy_strength: float = option(0.5, within="[0, 3)", unit="apples", help="How hard it tries.")
    toy_mood: Literal["glad", "sad"] = option("glad", help="How it feels; see `toy_strength`.")

    def start(self, setting):
        def move(xy, colours, moves):
            pass

        return Sweep(1, move)


@pytest.fixture
def toy(monkeypatch):
    """A method that is registered from now on."""
    known = MappingProxyType({**registry.all_methods(), "toy": Toy})
    monkeypatch.setattr(registry, "all_methods", lambda: known)


@pytest.mark.usefixtures("toy")
def test_a_new_method_is_in_smooth(call, fails, mesh_file, tmp_path, monkeypatch):
    words = re.sub(r"\s+", " ", help_of(call, monkeypatch, "smooth"))
    assert "How hard it tries. In [0, 3) apples. [default: 0.5]" in words
    assert "Options of toy" in words
    assert "How it feels; see --toy-strength. [default: glad]" in words
    out_file = tmp_path / "out.off"
    arguments = ["smooth", mesh_file, "-o", out_file, "--method", "toy"]
    assert "--toy-strength must be in [0, 3) apples, got 3.0" in fails(
        *arguments, "--toy-strength", 3
    )
    code, out, _ = call(*arguments, "--toy-strength", 2, "--toy-mood", "sad")
    assert code == 0
    assert "Toy: " in out
    assert "already as good as this method gets: unchanged" in out
    mesh = read_mesh(mesh_file)
    assert (read_mesh(out_file).points == mesh.points).all()
    assert smooth(mesh, "toy", toy_strength=2.0).outcome.method == "toy"


@pytest.mark.usefixtures("toy")
def test_a_new_method_is_in_compare(call, mesh_file):
    code, out, _ = call("compare", mesh_file, "--sweeps", 1, "--toy-mood", "sad")
    assert code == 0
    assert "Toy" in next(line for line in out.splitlines() if "Original" in line)
    code, out, _ = call("compare", mesh_file, "--methods", "toy", "--sweeps", 1, "--json", "-")
    assert [facts["method"] for facts in json.loads(out)["methods"]] == ["toy"]


@pytest.mark.usefixtures("toy")
def test_a_new_method_is_in_methods(call):
    assert Toy.purpose in re.sub(r"\s+", " ", call("methods")[1])
    code, out, _ = call("methods", "toy")
    assert code == 0
    assert "--toy-strength" in out
    assert "in [0, 3) apples" in out
    assert "--toy-mood glad|sad" in out
