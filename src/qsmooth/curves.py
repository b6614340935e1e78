"""Curves that vertices are to slide along: as callers give them, and where a chain is on them."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np

from qsmooth._types import BoolArray, FloatArray, IndexArray
from qsmooth.options import OptionError, text_of

# Places on a curve for (k, 2) places near it.
Projection: TypeAlias = Callable[[FloatArray], FloatArray]
# A curve given as polylines, or as a projection.
Curve: TypeAlias = "list[FloatArray] | Projection"

# Nodes of a line; and of each vertex of the chain its segment, fraction, and whether it is off.
Line: TypeAlias = tuple[FloatArray, IndexArray, FloatArray, BoolArray]

# A projection is asked for so many places an edge.
SAMPLES = 32
# A curve is that of a chain if no vertex of the chain is farther from it than this share of its
# longer edge on the chain.
NEAR = 1.0
# The largest fraction of a segment that is not its end.
BELOW_ONE = 1.0 - 2.0**-53
# More than the rounding of a way round a loop, as a share of it.
ROUNDING = 1e-9
# Distances to a curve are worked out for so many pairs at a time.
PAIRS = 1_000_000


def read_curve(path: str | Path) -> list[FloatArray]:
    """Read curves from a file: a line of x and y for each place, an empty line between two curves;
    what follows a # does not count.

    Raises
    ------
    OptionError
        If there is no such file, or something else in it.
    """
    rows = text_of(path, "curve").replace(",", " ").splitlines()
    curves: list[list[list[str]]] = [[]]
    for row in rows:
        words = row.partition("#")[0].split()
        if words:
            curves[-1].append(words)
        elif not row.strip() and curves[-1]:
            curves.append([])
    try:
        places = [np.array(curve, dtype=np.float64) for curve in curves if curve]
        return checked_curve(places)  # type: ignore[return-value]
    except ValueError:
        raise OptionError(
            "`curve` takes a file of places, lines x y of finite numbers, two or more for each "
            f"curve; '{path}' is none"
        ) from None


def checked_curve(curve: Any) -> Curve:
    """Take what a caller gives as curve: an array (k, 2), a list of such, or a function.

    Raises
    ------
    OptionError
        If it is none of these.
    """
    if callable(curve):
        return curve  # type: ignore[no-any-return]
    listed = list(curve) if isinstance(curve, (list, tuple)) else [curve]
    if listed and np.ndim(listed[0]) == 1:
        listed = [curve]
    try:
        curves = [np.array(one, dtype=np.float64) for one in listed]
    except (TypeError, ValueError):
        curves = []
    good = [one.ndim == 2 and one.shape[1] == 2 and len(one) > 1 for one in curves]
    if not curves or not all(good) or not all(np.isfinite(one).all() for one in curves):
        raise OptionError(
            "`curve` takes places (k, 2), finite and two at least, a list of such arrays, or a "
            "function that projects (k, 2) places"
        )
    return curves


def line_of(places: FloatArray, curve: Curve | None) -> tuple[Line, int]:
    """Give the line that a chain at these places, (m, 2), slides along.

    Returns
    -------
    line, which
        And the number of the curve that it is part of; -1 where the chain is its own line.
    """
    if callable(curve):
        return _sampled(places, curve), 0
    for which, one in enumerate(curve or []):
        line = _on_curve(places, one)
        if line is not None:
            return line, which
    return _with_end(places, np.arange(len(places)), np.zeros(len(places), np.bool_)), -1


def project(curve: Projection, places: FloatArray) -> FloatArray:
    """Ask a projection for its places, (k, 2), for as many.

    Raises
    ------
    OptionError
        If it gives anything else, or raises an exception.
    """
    n = len(places)
    try:
        answer = curve(places.copy())
    except Exception as error:
        raise OptionError(
            f"`curve` was asked to project {n} places, an array {places.shape}, and raised "
            f"{type(error).__name__}: {error}"
        ) from error
    try:
        found = np.array(answer, dtype=np.float64)
    except (TypeError, ValueError):
        raise OptionError(
            f"`curve` must give an array of places {places.shape} for as many, got "
            f"{type(answer).__name__}"
        ) from None
    if found.shape != places.shape:
        raise OptionError(f"`curve` must give places {places.shape} for as many, got {found.shape}")
    bad = ~np.isfinite(found).all(axis=1)
    if bad.any():
        x, y = places[bad][0].tolist()
        raise OptionError(
            f"`curve` must give finite places: {bad.sum()} of {n} are not, the first for "
            f"({x:g}, {y:g})"
        )
    return found


def _with_end(nodes: FloatArray, at_nodes: IndexArray, off: BoolArray) -> Line:
    """Make a line whose chain has its vertices at nodes."""
    segments, fractions = at_nodes.copy(), np.zeros(at_nodes.size)
    segments[-1], fractions[-1] = len(nodes) - 2, 1.0
    return nodes, segments, fractions, off


def _sampled(places: FloatArray, curve: Projection) -> Line:
    """Ask for places on a curve, as many for each edge."""
    shares = np.arange(SAMPLES)[:, None] / SAMPLES
    steps = np.diff(places, axis=0)
    between = places[:-1, None] + shares * steps[:, None]
    asked = np.concatenate([between.reshape(-1, 2), places[-1:]])
    nodes = project(curve, asked)
    at = np.arange(len(places)) * SAMPLES
    return _with_end(nodes, at, (nodes[at] != places).any(axis=1))


def _on_curve(places: FloatArray, curve: FloatArray, turned: bool = False) -> Line | None:
    """Find the stretch of a polyline that a chain follows; None if it does not follow it."""
    at, distance = _nearest(places, curve)
    edges = np.sqrt((np.diff(places, axis=0) ** 2).sum(axis=1))
    longer = np.maximum(np.r_[0.0, edges], np.r_[edges, 0.0])
    if (distance > NEAR * longer).any():
        return None
    n, closed = len(curve) - 1, bool((curve[0] == curve[-1]).all())
    steps = np.diff(at)
    if closed:
        steps = (steps + 0.5 * n) % n - 0.5 * n
    if steps.sum() < 0.0 and not turned:
        return _on_curve(places, curve[::-1].copy(), turned=True)
    if (steps <= 0.0).any() or steps.sum() > n * (1.0 + ROUNDING):
        return None
    way = at[0] + np.r_[0.0, np.cumsum(steps)]  # in segments of the curve, on and on round a loop
    first, last = int(np.floor(way[0])) + 1, int(np.ceil(way[-1])) - 1
    nodes = np.concatenate(
        [_on(curve, way[:1]), curve[np.arange(first, last + 1) % n], _on(curve, way[-1:])]
    ) if closed else np.concatenate(
        [_on(curve, way[:1]), curve[first : last + 1], _on(curve, way[-1:])]
    )  # fmt: skip
    segments = np.clip(np.floor(way).astype(np.int64) - first + 1, 0, len(nodes) - 2)
    a, d = nodes[segments], nodes[segments + 1] - nodes[segments]
    squares = (d * d).sum(axis=1)
    fractions = np.divide(((places - a) * d).sum(axis=1), squares, where=squares > 0.0,
                          out=np.zeros(len(places)))  # fmt: skip
    fractions = np.clip(fractions, 0.0, BELOW_ONE)
    segments[0], fractions[0] = 0, 0.0
    segments[-1], fractions[-1] = len(nodes) - 2, 1.0
    return nodes, segments, fractions, np.ones(len(places), np.bool_)


def _on(curve: FloatArray, at: FloatArray) -> FloatArray:
    """Places at so many segments along a polyline, modulo its length."""
    n = len(curve) - 1
    at = np.where(at > n, at - n, at)
    k = np.minimum(at.astype(np.int64), n - 1)
    share = (at - k)[:, None]
    return np.asarray(curve[k] + share * (curve[k + 1] - curve[k]))


def _nearest(places: FloatArray, curve: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Where each place is nearest to a polyline, in segments along it, and how near."""
    a, d = curve[:-1], np.diff(curve, axis=0)
    squares = (d * d).sum(axis=1)
    at, distance = np.empty(len(places)), np.empty(len(places))
    chunk = max(1, PAIRS // len(a))
    for first in range(0, len(places), chunk):
        p = places[first : first + chunk, None]
        f = np.divide(((p - a) * d).sum(axis=2), squares, where=squares > 0.0,
                      out=np.zeros((len(p), len(a))))  # fmt: skip
        f = np.clip(f, 0.0, 1.0)
        off = ((p - (a + f[..., None] * d)) ** 2).sum(axis=2)
        k = off.argmin(axis=1)
        rows = np.arange(len(p))
        at[first : first + chunk] = k + f[rows, k]
        distance[first : first + chunk] = np.sqrt(off[rows, k])
    return at, distance
