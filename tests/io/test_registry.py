"""Which formats there are, and which of them a file or an ending means."""

import itertools
import subprocess
import sys

import numpy as np
import pytest

import qsmooth.io
from format_samples import EVERY, content_of
from qsmooth.io import formats, own_formats, read_mesh, registry, write_mesh
from qsmooth.mesh import Mesh

TOY = """
import numpy as np
from qsmooth.io.file_content import FileContent
NAME = "toy"
ENDINGS = (".toy", ".off", ".bdf")
HOLDS = frozenset()
def sniff(head):
    return head.startswith(b"toy")
def read(data):
    n, *numbers = data.split()[1:]
    xy = np.array(numbers, float).reshape(int(n), 2)
    return FileContent(xy, [("triangle", np.array([[0, 1, 2]]))])
def write(content):
    rows = "\\n".join(f"{x!r} {y!r}" for x, y in content.points[:, :2].tolist())
    return f"toy {len(content.points)}\\n{rows}\\n".encode()
"""


@pytest.fixture
def add(tmp_path_factory, monkeypatch):
    """Put a module into the package's path."""
    names = []

    def put(name: str, text: str) -> None:
        folder = tmp_path_factory.mktemp("formats")
        (folder / f"{name}.py").write_text(text)
        monkeypatch.setattr(qsmooth.io, "__path__", [*qsmooth.io.__path__, str(folder)])
        names.append(name)
        own_formats.cache_clear()

    yield put
    own_formats.cache_clear()
    for name in names:
        sys.modules.pop(f"qsmooth.io.{name}", None)


def test_a_module_is_all_that_a_format_takes(add, tmp_path):
    add("toy", TOY + 'REPLACES = ("toy", "nastran")')
    assert formats()["toy"] == (".toy", ".off", ".bdf")
    assert "nastran" not in formats()
    mesh = Mesh([(0, 0), (1, 0), (0, 1)], [(0, 1, 2)])
    for name in ("a.toy", "a.bdf"):
        write_mesh(tmp_path / name, mesh)
        assert (tmp_path / name).read_bytes().startswith(b"toy 3")
        assert np.array_equal(read_mesh(tmp_path / name).points, mesh.points)
    # An ending that another format has too: the content decides, and OFF comes before by its name.
    (tmp_path / "b.off").write_bytes((tmp_path / "a.toy").read_bytes())
    assert read_mesh(tmp_path / "b.off").source.format == "toy"
    write_mesh(tmp_path / "c.off", mesh)
    assert (tmp_path / "c.off").read_bytes().startswith(b"OFF")


def test_priority_says_which_is_written_where_an_ending_is_shared(add, tmp_path):
    add("toy", TOY + "PRIORITY = 1")
    assert [form.NAME for form in registry.with_ending(".off")] == ["toy", "off"]
    write_mesh(tmp_path / "c.off", Mesh([(0, 0), (1, 0), (0, 1)], [(0, 1, 2)]))
    assert (tmp_path / "c.off").read_bytes().startswith(b"toy")


def test_a_format_that_lacks_something_is_named(add):
    add("toy", TOY.replace("HOLDS", "HAS").replace("def sniff", "def smell"))
    with pytest.raises(AttributeError, match=r"io\.toy is no format: it lacks HOLDS, sniff"):
        own_formats()


def test_endings_and_names_are_well_formed():
    for form in own_formats():
        assert form.ENDINGS
        assert all(ending == ending.lower() and ending[0] == "." for ending in form.ENDINGS)
        assert isinstance(form.HOLDS, frozenset)
        assert form.__doc__
    names = [form.NAME for form in own_formats()]
    assert len(set(names)) == len(names)


def test_one_format_comes_first_in_every_shared_ending():
    for ending in {ending for form in own_formats() for ending in form.ENDINGS}:
        ranks = [registry.priority(form) for form in registry.with_ending(ending)]
        assert ranks == sorted(ranks, reverse=True)
        assert ranks.count(ranks[0]) == 1, ending


def test_what_shared_endings_are_written_as():
    assert registry.with_ending(".inp")[0].NAME == "abaqus"
    assert registry.with_ending(".mesh")[0].NAME == "medit"
    assert registry.with_ending(".msh")[0].NAME == "gmsh"


def test_a_file_is_of_one_format(tmp_path):
    points = [(0, 0), (1, 0), (1, 1), (0, 1)]
    for form, other in itertools.product(own_formats(), own_formats()):
        mesh = Mesh(points, [(0, 1, 2) if registry.only(form) == "triangle" else (0, 1, 2, 3)])
        path = tmp_path / form.NAME
        write_mesh(path, mesh, format=form.NAME)
        assert other.sniff(path.read_bytes()) == (form is other), (form.NAME, other.NAME)
    for name in EVERY:
        assert sum(form.sniff(content_of(name)) for form in own_formats()) == 1, name


def test_nothing_is_searched_before_a_file_is_read():
    code = (
        "import sys, qsmooth.io\n"
        "assert 'qsmooth.io.registry' in sys.modules\n"
        "print({'qsmooth.io.off', 'qsmooth.io.vtu', 'meshio', 'numba'} & set(sys.modules))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "set()"
