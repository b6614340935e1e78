from dataclasses import dataclass
from typing import Literal

import numpy as np
import pytest

from qsmooth.options import OptionError, Options, is_number, opaque, option, spelled

pytestmark = pytest.mark.nojit


@dataclass(frozen=True, kw_only=True)
class Kettle(Options):
    """Options to test with."""

    heat: float = option(0.5, within="(0, 1]", unit="bar", help="How hot; see `lid`.")
    cups: int = option(2, within="[1, inf)", help="How many.")
    lid: bool = option(True, help="Whether it is closed.")
    tea: bool | Literal["green", "black"] = option(False, help="Which.")
    guest: object = opaque(None, help="Who comes.", parse=str.upper)


def test_values_have_their_own_types():
    kettle = Kettle(heat=1, cups=np.int64(3), lid=np.False_)
    assert [type(v) for v in (kettle.heat, kettle.cups, kettle.lid)] == [float, int, bool]
    assert kettle.given() == {"heat": 1.0, "cups": 3, "lid": False}


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"heat": 0}, "heat must be in (0, 1] bar, got 0"),
        ({"heat": True}, "heat must be a number, got True"),
        ({"cups": 1.0}, "cups must be an integer of 1 or more, got 1.0"),
        ({"cups": np.True_}, "cups must be an integer of 1 or more, got "),
        ({"lid": 1}, "lid must be True or False, got 1"),
        ({"tea": "white"}, "tea must be False, True, 'green' or 'black', got 'white'"),
        ({"tea": 1}, "tea must be False, True, 'green' or 'black', got 1"),
    ],
)
def test_errors_name_options_as_they_are_to_be_spelled(options, message):
    with pytest.raises(OptionError) as found:
        Kettle.of(options)
    assert str(found.value).startswith(message)
    (name,) = options
    loud = spelled(found.value.text, lambda named: f"--{named.upper()}")
    assert loud == str(found.value).replace(name, f"--{name.upper()}", 1)


def test_options_in_texts():
    assert spelled("`lid` needs `tea='green'`, see `x y`") == "lid needs tea='green', see `x y`"
    assert spelled("`lid`", str.upper) == "LID"


def test_unknown_options_say_what_was_meant():
    with pytest.raises(TypeError, match=r"options has no option 'cup'; did you mean 'cups'\?"):
        Kettle.of({"cup": 1})


def test_what_is_taken():
    assert Kettle.takes("tea", "green")
    assert not Kettle.takes("tea", "white")
    assert Kettle.takes("heat", 7.0)  # another one's business
    assert not Kettle.takes("milk", True)
    assert Kettle.specs()["guest"].parse("me") == "ME"


@pytest.mark.parametrize("value", [1, 1.5, np.float32(2), np.int8(1)])
def test_numbers(value):
    assert is_number(value)
    assert is_number(value, whole=True) == isinstance(value, (int, np.integer))


@pytest.mark.parametrize("value", [True, np.True_, "1", None, 1j, np.array([1.0])])
def test_what_is_no_number(value):
    assert not is_number(value)
