"""How far edges along lines can turn: against the same, written plainly; and lines of few nodes."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from qsmooth.kernels.angle_bounds import Swings
from qsmooth.kernels.swings import ANGLE_ROUNDING, MOST_NODES, NEARLY_STRAIGHT, line_swings


def spread(nodes):
    steps = np.diff(nodes, axis=0)
    steps = steps[(steps != 0.0).any(axis=1)]
    u, w = steps[:-1], steps[1:]
    cross, dot = u[:, 0] * w[:, 1] - u[:, 1] * w[:, 0], (u * w).sum(axis=1)
    ways = np.degrees(np.r_[0.0, np.cumsum(np.arctan2(cross, dot))])
    return float(np.ptp(ways)) + ANGLE_ROUNDING


def wrapped(angle):
    return (angle + np.pi) % (2.0 * np.pi) - np.pi


def swing(nodes, now, tolerance):
    whole = spread(nodes)
    if whole < NEARLY_STRAIGHT:
        return whole
    away = nodes[1:] - nodes[0]
    far = np.hypot(away[:, 0], away[:, 1])
    if len(nodes) > MOST_NODES or (far[:-1] == 0.0).any():
        return -1.0
    way = np.arctan2(away[:, 1], away[:, 0])
    turned = wrapped(way - way[0])
    low = high = 0.0
    for k in range(1, len(far)):
        share = tolerance * max(far[k - 1], far[k]) / far[:k]
        if share[0] >= 1.0:
            return -1.0
        half = np.where(share < 1.0, np.arcsin(np.minimum(share, 1.0)), np.inf)
        least, most = (turned[:k] - half).max(), (turned[:k] + half).min()
        if far[k] > 0.0:
            to = turned[k - 1] + wrapped(turned[k] - turned[k - 1])
            least, most = max(least, min(turned[k - 1], to)), min(most, max(turned[k - 1], to))
        if least <= most:
            low, high = min(low, least), max(high, most)
    at = float(wrapped(np.arctan2(*(now - nodes[0])[::-1]) - way[0]))
    return float(np.degrees(max(abs(low - at), abs(high - at)))) + ANGLE_ROUNDING


def swings_of(lines, wanted, tolerance):
    """Of lines whose vertices are their nodes."""
    counts = [len(nodes) for nodes in lines]
    offsets = np.cumsum([0, *counts])
    nodes = np.concatenate(lines)
    segments = np.arange(len(nodes))
    segments[offsets[1:] - 1] -= 1  # a line ends with its last segment
    found = Swings(*np.full((3, len(nodes)), -1.0))
    line_swings(
        nodes, nodes, np.arange(len(nodes)), segments, offsets, np.array(wanted), tolerance, found
    )
    return found, offsets


@pytest.mark.nojit
@given(st.integers(0, 2**32 - 1), st.sampled_from([0.0, 0.01, 0.2]), st.floats(0.0, 3.0))
def test_they_are_those_of_the_plain_version(seed, tolerance, bend):
    rng = np.random.default_rng(seed)
    lines = []
    for _ in range(3):
        ways = np.cumsum(rng.uniform(-bend, bend, rng.integers(2, 12)))
        steps = rng.uniform(0.1, 1.0, (ways.size, 1)) * np.stack([np.cos(ways), np.sin(ways)], 1)
        lines.append(np.concatenate([[[0.0, 0.0]], np.cumsum(steps, axis=0)]))
    found, offsets = swings_of(lines, [True, False, True], tolerance)
    for chain, nodes in enumerate(lines):
        first, last = offsets[chain], offsets[chain + 1] - 1
        if chain == 1:
            assert all((kind[first : last + 1] == -1.0).all() for kind in found)
            continue
        turn = spread(nodes)
        assert found.turn[first + 1 : last] == pytest.approx(turn if turn < 180.0 else -1.0)
        assert found.after[first + 1] == pytest.approx(swing(nodes, nodes[1], tolerance))
        assert found.before[last - 1] == pytest.approx(swing(nodes[::-1], nodes[-2], tolerance))


@pytest.mark.nojit
def test_along_a_straight_line_nothing_turns():
    found, _ = swings_of([np.outer(np.arange(4.0), [3.0, 1.0])], [True], 0.01)
    assert found.turn[1:3] == pytest.approx(0.0, abs=1e-8)
    assert (found.after[1], found.before[2]) == pytest.approx((0.0, 0.0), abs=1e-8)


def test_of_a_long_line_only_the_spread_is_known():
    way = np.linspace(0.0, 1.0, MOST_NODES + 1)
    found, _ = swings_of([np.stack([np.sin(way), np.cos(way)], axis=1)], [True], 0.01)
    assert found.turn[1] == pytest.approx(math.degrees(1.0), rel=1e-3)
    assert (found.after[1], found.before[MOST_NODES - 1]) == (-1.0, -1.0)
