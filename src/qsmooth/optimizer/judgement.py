"""What became of a mesh: figures that were given up, and for what; sizes."""

from __future__ import annotations

import math

import numpy as np

from qsmooth.metrics import Quality
from qsmooth.optimizer.caps import HOLDABLE
from qsmooth.outcome import Sizes, Target, Trade

# A figure that got worse by over this fraction is told of.
WORSE = 0.01
PERCENTILES = (1.0, 50.0, 99.0)


def judged(
    before: Quality, start: Quality, after: Quality, target: Target | None, layers: float
) -> tuple[tuple[Trade, ...], Sizes | None]:
    """Say what was given up, and what became of the sizes.

    Parameters
    ----------
    before, start, after
        The mesh as it came, as it was when it was valid, and as it is.
    target
        Mean quality towards what cells are meant to be; None where there was no such aim.
    layers
        Share of the cells that are of layers.
    """
    if target is None:
        return (), None
    trades = () if start.n_invalid or after.n_invalid else _trades(start, after, target)
    return trades, _sizes(before, after, layers)


def figures(quality: Quality) -> dict[str, float]:
    """The figures of a mesh that can be gained or given up."""
    smallest, largest = quality.extreme_angles
    return {
        "min_angle": smallest,
        "max_angle": largest,
        "scaled_jacobian": float(quality["scaled_jacobian"].min()),
        "aspect_ratio": float(quality["aspect_ratio"].max()),
        "shape": float(quality["shape"].min()),
        "min_edge": float(quality["min_edge"].min()),
        "mean_shape": float(quality["shape"].mean()),
    }


def _trades(start: Quality, after: Quality, target: Target) -> tuple[Trade, ...]:
    old, new = figures(start), figures(after)
    old["target"], new["target"] = target.before, target.after
    gains = {name: _gain(name, old[name], new[name]) for name in old}
    best = max(gains, key=lambda name: gains[name])
    gained = (best, old[best], new[best]) if gains[best] > 1.0 else ("", math.nan, math.nan)
    return tuple(
        Trade(
            figure=name,
            before=old[name],
            after=new[name],
            gained=gained[0],
            gained_before=gained[1],
            gained_after=gained[2],
        )
        for name in (*HOLDABLE, "mean_shape")
        if gains[name] < (1.0 / (1.0 + WORSE) if name == "aspect_ratio" else 1.0 - WORSE)
    )


def _gain(name: str, old: float, new: float) -> float:
    """How many times as good a figure is; of the largest angle its room below 180 degrees."""
    if name == "max_angle":
        old, new = 180.0 - old, 180.0 - new
    elif name == "aspect_ratio":
        old, new = new, old
    return new / old if old > 0.0 else 1.0


def _sizes(before: Quality, after: Quality, layers: float) -> Sizes:
    old, new = before.area, after.area
    good = old > 0.0
    ratios = new[good] / old[good] if good.any() else np.ones(1)
    low, median, high = np.percentile(ratios, PERCENTILES).tolist()
    return Sizes(
        area_low=low,
        area_median=median,
        area_high=high,
        min_edge_before=float(before["min_edge"].min()),
        min_edge_after=float(after["min_edge"].min()),
        layers=layers,
    )
