"""What a caller gives for `hold` and `target`, made into values or refused."""

from __future__ import annotations

import reprlib
from collections.abc import Iterable
from typing import Any

import numpy as np

from qsmooth._words import did_you_mean
from qsmooth.optimizer.caps import ALWAYS, HELD, HOLDABLE
from qsmooth.options import OptionError, one_of

TARGETS = ("auto", "ideal", "initial")


def parse_hold(given: str | Iterable[str]) -> tuple[str, ...]:
    """Take figures to hold: a name, names with commas between, or an iterable of names.

    Raises
    ------
    OptionError
        If one of them can't be held, or is held anyway.
    """
    try:
        names = given.split(",") if isinstance(given, str) else list(given)
    except TypeError:
        raise OptionError(f"`hold` takes {one_of(HOLDABLE)}, got {given!r}") from None
    found = []
    for name in names:
        known = name.strip().replace("-", "_") if isinstance(name, str) else name
        if known == "" and isinstance(given, str):
            continue
        if known not in HOLDABLE:
            hint = did_you_mean(known, HOLDABLE) if isinstance(known, str) else ""
            if known in HELD[:ALWAYS]:
                hint = ", which is held anyway, but where a metric is the target"
            raise OptionError(f"`hold` takes {one_of(HOLDABLE)}, got {name!r}{hint}")
        found.append(known)
    return tuple(name for name in HOLDABLE if name in found)


def parse_target(given: Any) -> Any:
    """Take a target: a name, ratios of sides, metric tensors, or a function that gives tensors.

    Raises
    ------
    OptionError
        If it is none of these; what depends on the mesh is checked with it.
    """
    if isinstance(given, str):
        if given not in TARGETS:
            near = did_you_mean(given, TARGETS)
            raise OptionError(f"`target` must be {one_of(TARGETS)}, got {given!r}{near}")
        return given
    if callable(given):
        return given
    try:
        array = np.array(given)
        array = np.empty(()) if np.iscomplexobj(array) else array.astype(np.float64)
    except (TypeError, ValueError):
        array = np.empty(())
    if array.ndim != 1 and (array.ndim != 3 or array.shape[1:] != (2, 2)):
        raise OptionError(
            f"`target` must be {one_of(TARGETS)}; or real numbers: ratios of sides, (n_cells,), or "
            "metric tensors, (n_vertices, 2, 2); or a function of places that gives such tensors; "
            f"got {_brief(given)}"
        )
    return array


def _brief(given: Any) -> str:
    if not isinstance(given, np.ndarray):
        return reprlib.repr(given)
    return f"an array of {given.dtype} of the shape {given.shape}"
