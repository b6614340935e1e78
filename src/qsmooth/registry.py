"""The methods by name: every module of `qsmooth.methods` and `qsmooth.optimizer` is looked at."""

from __future__ import annotations

import functools
import importlib
import pkgutil
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

from qsmooth._words import did_you_mean
from qsmooth.methods.base import Method
from qsmooth.options import OptionError

if TYPE_CHECKING:
    from collections.abc import Mapping

# The rooms where methods live; the default method comes first.
ROOMS = ("qsmooth.optimizer", "qsmooth.methods")


@functools.cache
def all_methods() -> Mapping[str, type[Method]]:
    """Every class with a method's name, by that name."""
    found = {}
    for room in ROOMS:
        package = importlib.import_module(room)
        for module in pkgutil.iter_modules(package.__path__, room + "."):
            for thing in vars(importlib.import_module(module.name)).values():
                if _is_method(thing) and thing.__module__ == module.name:
                    found[thing.name] = thing
    return MappingProxyType(found)


def methods() -> Mapping[str, type[Method]]:
    """The methods to choose among, by name."""
    return MappingProxyType({n: m for n, m in all_methods().items() if m.listed})


def method_class(name: str) -> type[Method]:
    """Look a method up by its name.

    Raises
    ------
    OptionError
        If there is none; it says what was meant, where that can be told.
    """
    known = methods()
    if isinstance(name, str) and name in known:
        return known[name]
    names = ["auto", *known]
    hint = did_you_mean(name, names)
    if isinstance(name, str) and name in all_methods():
        hint = f"; that is qsmooth.{name}"
    raise OptionError(f"`method` must be one of {', '.join(names)}; got {name!r}{hint}")


def choose(options: Mapping[str, Any]) -> tuple[str, str]:
    """Pick a method for ``"auto"`` by the options that were given, and say why."""
    if options.get("split_quads", False) is not False:
        return "aspect-ratio", ", as the quads are cut in triangles"
    return "optimize", ""


def _is_method(thing: Any) -> bool:
    return isinstance(thing, type) and issubclass(thing, Method) and "name" in thing.__dict__
