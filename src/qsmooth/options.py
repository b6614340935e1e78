"""Options: a field with its default, range, unit and one line of help, checked where it is made.

A frozen, keyword-only dataclass derived from `Options` holds the options of one thing; the command
line, its help and the checks are all made from its fields.
"""

from __future__ import annotations

import dataclasses
import functools
import math
import numbers
import re
import types
import typing
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, Literal

from qsmooth._words import did_you_mean

_METADATA = "qsmooth"
_NUMBER = r"\s*([-+]?(?:[\d.]+(?:e[-+]?\d+)?|inf))\s*"
_INTERVAL = re.compile(rf"([\[(]){_NUMBER},{_NUMBER}([\])])")
# An option in a text, with a value or without: "`bad_step`", "`split_quads='shorter'`".
_NAMED = re.compile(r"`(\w+(?:=[^`]*)?)`")


class OptionError(ValueError):
    """A value that an option does not take.

    Attributes
    ----------
    text
        The message with options marked, as `spelled` takes it.
    """

    def __init__(self, text: str) -> None:
        super().__init__(spelled(text))
        self.text = text


@dataclass(frozen=True)
class Interval:
    """A range of numbers, with or without its ends; reads as it is written, "(0, 1]"."""

    low: float
    high: float
    with_low: bool
    with_high: bool

    @classmethod
    def parse(cls, text: str) -> Interval:
        """Read an interval such as ``"[0, 1)"`` or ``"(0, inf)"``.

        Raises
        ------
        ValueError
            If it does not read like that.
        """
        match = _INTERVAL.fullmatch(text)
        if match is None:
            raise ValueError(f"an interval reads like '(0, 1]', got {text!r}")
        return cls(float(match[2]), float(match[3]), match[1] == "[", match[4] == "]")

    def __contains__(self, value: float) -> bool:
        above = value >= self.low if self.with_low else value > self.low
        below = value <= self.high if self.with_high else value < self.high
        return above and below

    def words(self, unit: str = "") -> str:
        """Say it in a sentence: "in (0, 1]", "0 or more", "over 0 seconds"."""
        unit = f" {unit}" if unit else ""
        if math.isinf(self.high):
            return f"{self.low:g}{unit} or more" if self.with_low else f"over {self.low:g}{unit}"
        opening, closing = "[" if self.with_low else "(", "]" if self.with_high else ")"
        return f"in {opening}{self.low:g}, {self.high:g}{closing}{unit}"


@dataclass(frozen=True)
class Spec:
    """What is known of an option besides its value.

    Attributes
    ----------
    name, default
        As in Python; `default` may be None, which `default_words` explains.
    help
        One line; other options in it stand in backticks, so that they can be written as in a shell.
    kind
        ``"number"``, ``"integer"``, ``"flag"``, ``"choice"``, or ``"object"``, which only its own
        class can check.
    optional
        Whether None is allowed.
    interval, unit
        Range of a number and its unit in words, "" for none.
    choices
        Values of a choice.
    flag
        Name on the command line, without dashes, where it is another; None: not there at all.
    metavar
        What stands for its value in the help of the command line.
    default_words
        The default in words, where the value does not say it.
    parse
        Makes a value of the text that a command line gives, where its kind does not say how.
    repeats
        Whether a command line may give it several times; `parse` then takes a list of texts.
    """

    name: str
    default: Any
    help: str
    kind: Literal["number", "integer", "flag", "choice", "object"] = "object"
    optional: bool = False
    interval: Interval | None = None
    unit: str = ""
    choices: tuple[Any, ...] = ()
    flag: str | None = ""
    metavar: str = ""
    default_words: str = ""
    parse: Callable[[Any], Any] | None = None
    repeats: bool = False

    @property
    def range_words(self) -> str:
        """The range in a sentence, "" where there is none."""
        if self.kind == "choice":
            return one_of(self.choices)
        if self.interval is None:
            return ""
        words = self.interval.words(self.unit)
        return f"an integer {_of(words)}" if self.kind == "integer" else words

    def checked(self, value: Any) -> Any:
        """Return the value as its own type.

        Raises
        ------
        OptionError
            Naming the option, its range and the value.
        """
        if value is None and self.optional:
            return None
        if self.kind == "flag":
            if not _is_truth(value):
                raise OptionError(f"`{self.name}` must be True or False, got {value!r}")
            return bool(value)
        if self.kind == "choice":
            if not any(value is c or (type(value) is type(c) and value == c) for c in self.choices):
                raise OptionError(f"`{self.name}` must be {one_of(self.choices)}, got {value!r}")
            return value
        if self.kind == "object":
            return value
        whole = self.kind == "integer"
        if not is_number(value, whole):
            what = self.range_words if whole else "a number"
            raise OptionError(f"`{self.name}` must be {what or 'an integer'}, got {value!r}")
        if self.interval is not None and value not in self.interval:
            raise OptionError(f"`{self.name}` must be {self.range_words}, got {value}")
        return int(value) if whole else float(value)


def option(
    default: Any,
    *,
    help: str,
    within: str = "",
    unit: str = "",
    flag: str | None = "",
    metavar: str = "",
    default_words: str = "",
    parse: Callable[[Any], Any] | None = None,
    repeats: bool = False,
) -> Any:
    """Declare a field of an `Options` class; see `Spec` for the arguments.

    Its kind follows from its type: float, int, bool or Literal, each with None or without.
    """
    metadata = {
        "help": help,
        "interval": Interval.parse(within) if within else None,
        "unit": unit,
        "flag": flag,
        "metavar": metavar,
        "default_words": default_words,
        "parse": parse,
        "repeats": repeats,
    }
    return dataclasses.field(default=default, metadata={_METADATA: metadata})


def opaque(
    default: Any,
    *,
    help: str,
    flag: str | None = "",
    metavar: str = "",
    parse: Callable[[str], Any] | None = None,
) -> Any:
    """Declare an option that is no plain value and so does not count when options are compared."""
    field = option(default, help=help, flag=flag, metavar=metavar, parse=parse)
    return dataclasses.field(default=default, metadata=field.metadata, compare=False, hash=False)


@dataclass(frozen=True, kw_only=True)
class Options:
    """Base of the frozen dataclasses that hold options: they check themselves."""

    # What the options belong to, for messages: "method 'star'".
    owner: ClassVar[str] = "options"

    def __post_init__(self) -> None:
        for spec in self.specs().values():
            # frozen, and yet 1 becomes 1.0: kernels are compiled once, for one type
            object.__setattr__(self, spec.name, spec.checked(getattr(self, spec.name)))

    @classmethod
    @functools.cache
    def specs(cls) -> dict[str, Spec]:
        """What is known of each option, by name, in the order of the fields."""
        hints = typing.get_type_hints(cls)
        return {
            field.name: _spec(field, hints[field.name])
            for field in dataclasses.fields(cls)
            if _METADATA in field.metadata
        }

    @classmethod
    def of(cls, options: dict[str, Any]) -> typing.Self:
        """Make one from names and values.

        Raises
        ------
        TypeError
            For a name that is no option; it says what was meant, where that can be told.
        OptionError
            For a value out of range.
        """
        for name in options:
            if name not in cls.specs():
                raise TypeError(
                    f"{cls.owner} has no option {name!r}{did_you_mean(name, cls.specs())}"
                )
        return cls(**options)

    @classmethod
    def takes(cls, name: str, value: Any) -> bool:
        """Whether there is such an option and, where it is a choice, whether the value is one."""
        spec = cls.specs().get(name)
        return spec is not None and (spec.kind != "choice" or value in spec.choices)

    def given(self) -> dict[str, Any]:
        """Options that differ from their defaults, by name."""
        return {
            name: getattr(self, name)
            for name, spec in self.specs().items()
            if not _same(getattr(self, name), spec.default)
        }


def spelled(text: str, spell: Callable[[str], str] = str) -> str:
    """Write the options in a text, which stand in backticks, in another way: with `spell`."""
    return _NAMED.sub(lambda found: spell(found[1]), text)


def text_of(path: str | Path, option: str) -> str:
    """Read a file that an option names.

    Raises
    ------
    OptionError
        If it can't be read, or is no text.
    """
    try:
        return Path(path).read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        why = getattr(error, "strerror", None) or "it is no text"
        raise OptionError(f"`{option}`: cannot read '{path}': {why}") from None


def one_of(values: Iterable[Any]) -> str:
    """List values in a sentence: "'a', 'b' or 'c'"."""
    words = [repr(value) for value in values]
    return " or ".join([", ".join(words[:-1]), words[-1]] if len(words) > 1 else words)


def is_number(value: object, whole: bool = False) -> bool:
    """Whether a value is a number (a whole one), NumPy's included, and no truth value."""
    kind = numbers.Integral if whole else numbers.Real  # NumPy's scalars are registered there
    return isinstance(value, kind) and not _is_truth(value)


def _is_truth(value: Any) -> bool:
    """Whether a value is True or False, NumPy's included; without loading NumPy."""
    is_numpy = getattr(value, "shape", None) == () and getattr(value.dtype, "kind", "") == "b"
    return isinstance(value, bool) or is_numpy


def _of(words: str) -> str:
    return words if words.startswith("in ") else f"of {words}"


def _same(value: Any, default: Any) -> bool:
    return value is default or (isinstance(value, (str, int, float)) and value == default)


def _spec(field: dataclasses.Field[Any], hint: Any) -> Spec:
    parts = list(typing.get_args(hint)) if _is_union(hint) else [hint]
    optional = types.NoneType in parts
    parts = [part for part in parts if part is not types.NoneType]
    choices: list[Any] = []
    for part in parts:
        if typing.get_origin(part) is Literal:
            choices += typing.get_args(part)
        elif part is bool and len(parts) > 1:
            choices = [False, True, *choices]
    kind: Any = {float: "number", int: "integer", bool: "flag"}.get(parts[0], "object")
    if choices:
        kind = "choice"
    elif len(parts) > 1:
        kind = "object"
    return Spec(
        name=field.name,
        default=field.default,
        kind=kind,
        optional=optional,
        choices=tuple(choices),
        **field.metadata[_METADATA],
    )


def _is_union(hint: Any) -> bool:
    return typing.get_origin(hint) in (typing.Union, types.UnionType)
