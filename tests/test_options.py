"""Options: fields that check themselves, and what is known of them."""

import dataclasses
import math
import re
from dataclasses import dataclass
from typing import Any, ClassVar, Literal

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import promises
from qsmooth.options import (
    Interval,
    Options,
    did_you_mean,
    is_number,
    one_of,
    opaque,
    option,
)
from qsmooth.registry import all_methods

pytestmark = pytest.mark.nojit


@dataclass(frozen=True, kw_only=True)
class Oven(Options):
    """One option of each kind."""

    owner: ClassVar[str] = "oven"

    step: float = option(0.5, within="(0, 1]", help="Share.")
    turn: float = option(90.0, within="(0, 180)", unit="degrees", help="Angle.")
    wait: float | None = option(None, within="(0, inf)", unit="seconds", help="Time.")
    size: float = option(1.0, help="Any number.")
    count: int = option(3, within="[0, inf)", help="How many.")
    racks: int | None = option(None, within="[1, 4]", default_words="by size", help="Racks.")
    seed: int = option(0, help="Any integer.")
    fan: bool = option(False, help="Whether it turns.")
    heat: Literal["top", "bottom", "both"] = option("both", help="From where.", flag="warmth")
    light: bool | Literal["dim"] = option(True, help="Three ways.")
    fuel: Literal["gas"] | None = option(None, help="Or none.")
    cake: Any = opaque(None, help="Anything.", metavar="CAKE", flag=None)


# ------------------------------------------------------------------------------- intervals


@pytest.mark.parametrize(
    ("text", "inside", "outside", "words"),
    [
        ("(0, 1]", [1e-300, 0.5, 1.0], [0.0, -1.0, 1.0000001, math.nan, math.inf], "in (0, 1]"),
        ("[0, 1)", [0.0, 0.999], [-1e-300, 1.0, math.nan], "in [0, 1)"),
        ("(-2.5,3)", [0, 2.999], [-2.5, 3], "in (-2.5, 3)"),
        ("[0, inf)", [0, 10**30], [-1, math.inf, math.nan], "0 or more"),
        ("(0, inf)", [1e-9], [0, math.inf], "over 0"),
    ],
)
def test_intervals_read_hold_and_say_what_they_are(text, inside, outside, words):
    interval = Interval.parse(text)
    assert all(x in interval for x in inside)
    assert not any(x in interval for x in outside)
    assert interval.words() == words
    assert interval == Interval.parse(text)
    unit = interval.words("degrees")
    assert "degrees" in unit
    assert unit.replace(" degrees", "") == words


# ------------------------------------------------------------------------------- checks


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"step": 2}, "step must be in (0, 1], got 2"),
        ({"step": 0.0}, "step must be in (0, 1], got 0.0"),
        ({"step": math.nan}, "step must be in (0, 1], got nan"),
        ({"step": None}, "step must be a number, got None"),
        ({"step": "0.5"}, "step must be a number, got '0.5'"),
        ({"step": True}, "step must be a number, got True"),
        ({"step": np.bool_(True)}, "step must be a number, got "),
        ({"step": 1j}, "step must be a number, got 1j"),
        ({"turn": 180}, "turn must be in (0, 180) degrees, got 180"),
        ({"wait": 0.0}, "wait must be over 0 seconds, got 0.0"),
        ({"wait": math.inf}, "wait must be over 0 seconds, got inf"),
        ({"size": []}, "size must be a number, got []"),
        ({"count": -1}, "count must be an integer of 0 or more, got -1"),
        ({"count": 2.0}, "count must be an integer of 0 or more, got 2.0"),
        ({"count": True}, "count must be an integer of 0 or more, got True"),
        ({"count": None}, "count must be an integer of 0 or more, got None"),
        ({"racks": 5}, "racks must be an integer in [1, 4], got 5"),
        ({"racks": "all"}, "racks must be an integer in [1, 4], got 'all'"),
        ({"seed": 0.5}, "seed must be an integer, got 0.5"),
        ({"fan": 1}, "fan must be True or False, got 1"),
        ({"fan": None}, "fan must be True or False, got None"),
        ({"heat": "left"}, "heat must be 'top', 'bottom' or 'both', got 'left'"),
        ({"heat": None}, "heat must be 'top', 'bottom' or 'both', got None"),
        ({"light": 1}, "light must be False, True or 'dim', got 1"),
        ({"fuel": "oil"}, "fuel must be 'gas', got 'oil'"),
    ],
)
def test_what_is_out_of_range_is_named_with_its_range_and_value(options, message):
    for make in (lambda: Oven(**options), lambda: Oven.of(options)):
        with pytest.raises(ValueError, match=f"^{re.escape(message)}"):
            make()


@pytest.mark.parametrize(
    ("options", "value", "kind"),
    [
        ({"step": 1}, 1.0, float),
        ({"step": np.float32(0.5)}, 0.5, float),
        ({"step": np.int8(1)}, 1.0, float),
        ({"size": -(10**6)}, -1e6, float),
        ({"wait": None}, None, type(None)),
        ({"wait": np.float64(2)}, 2.0, float),
        ({"count": np.int32(4)}, 4, int),
        ({"count": np.uint8(4)}, 4, int),
        ({"racks": None}, None, type(None)),
        ({"fan": np.True_}, True, bool),
        ({"heat": "top"}, "top", str),
        ({"light": False}, False, bool),
        ({"light": "dim"}, "dim", str),
        ({"fuel": None}, None, type(None)),
    ],
    ids=str,
)
def test_values_get_the_type_of_their_option(options, value, kind):
    # A kernel is compiled once more for another type.
    (name,) = options
    found = getattr(Oven(**options), name)
    assert found == value
    assert type(found) is kind


def test_names_that_are_none_and_what_was_meant():
    with pytest.raises(TypeError, match=r"^oven has no option 'stepp'; did you mean 'step'\?$"):
        Oven.of({"stepp": 0.5})
    with pytest.raises(TypeError, match=r"^oven has no option 'xyzzy'$"):
        Oven.of({"xyzzy": 0.5})
    with pytest.raises(TypeError, match="unexpected keyword"):
        Oven(stepp=0.5)
    with pytest.raises(TypeError):
        Oven(0.5)


def test_an_unknown_name_goes_before_a_bad_value():
    with pytest.raises(TypeError, match="no option 'fann'"):
        Oven.of({"step": 7.0, "fann": True})


def test_options_are_frozen_equal_and_hashed_by_their_values():
    one, other = Oven(step=1, fan=np.False_), Oven(step=1.0)
    assert one == other
    assert hash(one) == hash(other)
    assert one != Oven(step=0.5)
    assert Oven(cake=[1]) == Oven(cake=np.ones(3)), "what is no plain value does not count"
    assert hash(Oven(cake=[1])) == hash(Oven())
    for name in ("step", "cake"):
        with pytest.raises(dataclasses.FrozenInstanceError):
            setattr(one, name, 0.1)
    with pytest.raises(ValueError, match="step must be in"):
        dataclasses.replace(one, step=3)
    assert dataclasses.replace(one, step=0.25).step == 0.25


def test_what_was_given():
    assert Oven().given() == {}
    assert Oven(step=0.5, count=3, light=True).given() == {}
    cake = object()
    given = Oven(step=1, racks=2, light="dim", cake=cake).given()
    assert given == {"step": 1.0, "racks": 2, "light": "dim", "cake": cake}
    assert Oven.of(given) == Oven(step=1, racks=2, light="dim")


# ------------------------------------------------------------------------------- what is known


def test_what_is_known_of_each_option():
    specs = Oven.specs()
    assert list(specs) == [field.name for field in dataclasses.fields(Oven)]
    kinds = {name: spec.kind for name, spec in specs.items()}
    assert kinds == {
        "step": "number", "turn": "number", "wait": "number", "size": "number",
        "count": "integer", "racks": "integer", "seed": "integer", "fan": "flag",
        "heat": "choice", "light": "choice", "fuel": "choice", "cake": "object",
    }  # fmt: skip
    assert [name for name, spec in specs.items() if spec.optional] == ["wait", "racks", "fuel"]
    assert specs["heat"].choices == ("top", "bottom", "both")
    assert specs["light"].choices == (False, True, "dim")
    assert specs["turn"].interval == Interval(0.0, 180.0, False, False)
    assert (specs["turn"].unit, specs["turn"].default, specs["turn"].help) == (
        "degrees", 90.0, "Angle.",
    )  # fmt: skip
    assert specs["heat"].flag == "warmth"
    assert specs["cake"].flag is None
    assert specs["cake"].metavar == "CAKE"
    assert specs["racks"].default_words == "by size"
    ranges = {name: spec.range_words for name, spec in specs.items()}
    assert ranges == {
        "step": "in (0, 1]", "turn": "in (0, 180) degrees", "wait": "over 0 seconds", "size": "",
        "count": "an integer of 0 or more", "racks": "an integer in [1, 4]", "seed": "",
        "fan": "", "heat": "'top', 'bottom' or 'both'", "light": "False, True or 'dim'",
        "fuel": "'gas'", "cake": "",
    }  # fmt: skip


def test_derived_options_come_after_those_they_are_derived_from_and_may_differ():
    @dataclass(frozen=True, kw_only=True)
    class Small(Oven):
        owner: ClassVar[str] = "small oven"
        step: float = option(0.1, within="(0, 0.5]", help="Less.")
        door: bool = option(True, help="Open.")

    assert [*Small.specs()] == [*Oven.specs(), "door"]
    assert Small().step == 0.1
    with pytest.raises(ValueError, match=r"step must be in \(0, 0.5\], got 1"):
        Small(step=1)
    assert Oven(step=1).step == 1.0
    with pytest.raises(TypeError, match="small oven has no option 'dor'; did you mean 'door'"):
        Small.of({"dor": False})


def test_a_field_that_is_no_option_is_left_alone():
    @dataclass(frozen=True, kw_only=True)
    class Labelled(Oven):
        label: str = "mine"

    assert "label" not in Labelled.specs()
    assert Labelled(label=3).label == 3
    with pytest.raises(TypeError, match="no option 'label'"):
        Labelled.of({"label": "yours"})


def test_a_default_out_of_its_own_range_is_found_when_first_made():
    @dataclass(frozen=True, kw_only=True)
    class Wrong(Options):
        step: float = option(2.0, within="(0, 1]", help="Too much.")

    with pytest.raises(ValueError, match=r"step must be in \(0, 1\], got 2"):
        Wrong()


@pytest.mark.parametrize("within", ["0, 1", "(0 1)", "(a, b)", "(0, 1, 2)", "()", "[0; 1]"])
def test_an_interval_that_is_none_is_found_when_it_is_declared(within):
    with pytest.raises(ValueError, match="interval"):
        option(0.5, within=within, help="Broken.")


# ------------------------------------------------------------------------------- words


def test_did_you_mean():
    assert did_you_mean("max_swep", ["max_sweeps", "step"]) == "; did you mean 'max_sweeps'?"
    assert did_you_mean("colour", ["max_sweeps", "step"]) == ""
    assert did_you_mean(3, ["step"]) == ""
    assert did_you_mean("step", []) == ""


def test_one_of():
    assert one_of(["a"]) == "'a'"
    assert one_of(["a", "b"]) == "'a' or 'b'"
    assert one_of([False, True, "b"]) == "False, True or 'b'"


def test_numbers_are_numbers():
    assert all(is_number(x) for x in (1, 1.5, np.int8(1), np.float16(1), math.nan))
    assert not any(is_number(x) for x in (True, np.True_, "1", None, 1j, [1]))
    assert is_number(np.int64(3), whole=True)
    assert not is_number(3.0, whole=True)


# ------------------------------------------------------------------------------- of the methods

each_option = pytest.mark.parametrize(
    ("method", "spec"),
    [(m, spec) for m in all_methods().values() for spec in m.specs().values()],
    ids=[f"{name}-{option}" for name, m in all_methods().items() for option in m.specs()],
)


@each_option
def test_options_of_methods_are_declared_well(method, spec):
    assert spec.checked(spec.default) == spec.default
    assert spec.help[0].isupper()
    assert spec.help.endswith(".")
    assert "\n" not in spec.help
    if spec.kind in ("number", "integer"):
        assert spec.interval is not None, "any number at all?"


@each_option
@given(st.data())
@settings(max_examples=10)
def test_any_value_in_range_is_taken_and_any_out_of_it_named(method, spec, data):
    value = data.draw(promises.values(spec))
    taken = spec.checked(value)
    assert taken == value
    assert type(taken) is {"number": float, "integer": int}.get(spec.kind, type(value)) or (
        value is None and spec.optional
    )
    if spec.interval is not None:
        ends = (spec.interval.low - 1, spec.interval.high + 1, math.nan)
        for bad in (x for x in ends if x not in spec.interval):
            with pytest.raises(
                ValueError, match=f"^{spec.name} must be {re.escape(spec.range_words)}"
            ):
                method(**{spec.name: bad})
