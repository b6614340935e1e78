"""The registry finds every method that has a module, and knows what was meant."""

import importlib
import inspect
import sys
import textwrap

import pytest

import qsmooth
from qsmooth import registry
from qsmooth.methods.base import Method

pytestmark = pytest.mark.nojit


def test_the_methods_there_are():
    listed = registry.methods()
    assert next(iter(listed)) == "optimize", "the default comes first"
    assert {*registry.all_methods()} == {*listed, "untangle"}
    for name, known in registry.all_methods().items():
        assert known.name == name
        assert known.owner == f"method {name!r}"
        assert known.listed == (name in listed)
        # Public under the name of its class.
        assert getattr(qsmooth, known.__name__) is known
    with pytest.raises(TypeError):
        listed["mine"] = Method


@pytest.mark.parametrize("known", registry.all_methods().values(), ids=registry.all_methods())
def test_a_method_says_what_it_is(known):
    assert known.name == known.name.lower()
    assert known.title
    assert known.purpose.endswith(".")
    assert "\n" not in known.purpose
    assert "Notes\n" in inspect.getdoc(known), "where it comes from"
    # Found under the class's name in words, and in a module of its own room.
    words = known.__name__.lower()
    assert words == known.name.replace("-", "")
    assert known.__module__.rpartition(".")[0] in registry.ROOMS


@pytest.mark.parametrize(
    ("name", "hint"),
    [
        ("stars", "; did you mean 'star'?"),
        ("optimise", "; did you mean 'optimize'?"),
        ("Quad", "; did you mean 'quad'?"),
        ("xyzzy", ""),
        (None, ""),
        (3, ""),
        (["star"], "; did you mean 'star'?"),
        ("untangle", "; that is qsmooth.untangle"),
    ],
)
def test_a_name_that_is_none(name, hint):
    with pytest.raises(
        ValueError, match=r"^method must be one of auto, optimize, .*; got "
    ) as error:
        registry.method_class(name)
    assert str(error.value).endswith(f"got {name!r}{hint}")


def test_what_auto_takes():
    assert registry.choose({}) == ("optimize", "")
    assert registry.choose({"split_quads": False}) == ("optimize", "")
    for how in (True, "shorter"):
        name, why = registry.choose({"split_quads": how})
        assert name == "aspect-ratio"
        assert why == ", as the quads are cut in triangles"


def test_a_module_in_a_room_is_all_that_a_new_method_takes(tmp_path, monkeypatch):
    room = tmp_path / "spare_room"
    room.mkdir()
    (room / "__init__.py").write_text("")
    (room / "nothing.py").write_text(
        textwrap.dedent(
            '''
            """Leaves everything where it is."""
            from dataclasses import dataclass
            from qsmooth.methods.driver import Sweep, SweepingMethod
            from qsmooth.methods.star import Star  # not found a second time
            from qsmooth.options import option

            @dataclass(frozen=True, kw_only=True)
            class Shared(SweepingMethod):
                """Without a name: a base."""

            @dataclass(frozen=True, kw_only=True)
            class Nothing(Shared):
                """Rests."""
                name = "nothing"
                title = "Nothing"
                purpose = "For a rest."
                depth: float = option(1.0, within="(0, 1]", help="How little.")

                def start(self, setting):
                    def rest(xy, colours, moves):
                        moves.lengths[:], moves.shares[:] = 0.0, 0.0
                    return Sweep(1, rest)
            '''
        )
    )
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr(registry, "ROOMS", (*registry.ROOMS, "spare_room"))
    registry.all_methods.cache_clear()
    try:
        assert "nothing" in registry.methods()
        assert [*registry.methods()].count("star") == 1
        mesh = qsmooth.Mesh([(0, 0), (1, 0), (1, 1), (0, 1), (0.4, 0.4)],
                            [(0, 1, 4), (1, 2, 4), (2, 3, 4), (3, 0, 4)])  # fmt: skip
        result = qsmooth.smooth(mesh, "nothing", depth=0.5)
        assert result.outcome.stop is qsmooth.Stop.RESTS
        assert result.outcome.unchanged
        with pytest.raises(TypeError, match="method 'nothing' has no option 'dept'; did you mean"):
            qsmooth.smooth(mesh, "nothing", dept=0.5)
        results, _ = qsmooth.compare(mesh, ["nothing", "laplacian"], max_sweeps=1)
        assert [*results] == ["nothing", "laplacian"]
    finally:
        registry.all_methods.cache_clear()
        for name in ("spare_room", "spare_room.nothing"):
            sys.modules.pop(name, None)
        importlib.invalidate_caches()
