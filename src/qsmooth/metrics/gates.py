"""Gates: every cell held to a threshold, as a pipeline asks."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from qsmooth._json import finite
from qsmooth._words import plural
from qsmooth.metrics.quality import Quality
from qsmooth.metrics.registry import METRICS, find_metric, unknown


@dataclass(frozen=True, kw_only=True)
class Check:
    """What came of holding every cell to a rule.

    Attributes
    ----------
    metric
        Its name, or ``"validity"``.
    rule
        What no cell may be: ``"below"`` or ``"above"`` the threshold, or ``"invalid"``.
    threshold
        None for validity.
    n_failed
        Cells that break the rule.
    worst_cell, worst_value
        The worst cell by the metric; None where it is not defined for any. For validity the first
        cell that is not valid.
    text
        The same in words.
    """

    metric: str
    rule: str
    threshold: float | None
    n_failed: int
    worst_cell: int | None
    worst_value: float | None
    text: str

    @property
    def passed(self) -> bool:
        """Whether no cell breaks the rule."""
        return self.n_failed == 0

    def to_dict(self) -> dict[str, Any]:
        """Plain values, fit for JSON."""
        plain = {**asdict(self), "passed": self.passed}
        return {name: finite(value) for name, value in plain.items()}


def parse_gate(text: str, option: str = "a gate") -> tuple[str, float]:
    """Take a gate such as ``"min_angle=20"`` apart; `option` is what messages call it.

    Raises
    ------
    ValueError
        If it does not read like that.
    """
    name, sign, value = text.partition("=")
    name = name.strip().replace("-", "_")
    if not sign or not name:
        raise ValueError(
            f"{option} takes METRIC=VALUE with a metric out of {', '.join(METRICS)}, got '{text}'"
        )
    if name not in METRICS:
        raise ValueError(f"{option} takes METRIC=VALUE: {unknown(name)}")
    try:
        threshold = float(value)
    except ValueError:
        threshold = math.nan
    if not math.isfinite(threshold):
        raise ValueError(f"{option} {name} needs a number, got '{value}'")
    return name, threshold


def check_gate(quality: Quality, name: str, threshold: float, *, below: bool) -> Check:
    """Hold every cell that a metric is defined for to a threshold.

    Parameters
    ----------
    below
        Whether a cell fails that has less than the threshold, or one that has more.

    Raises
    ------
    ValueError
        If `name` is no metric.
    """
    metric = find_metric(name)
    values = quality[name]
    n_failed = int(metric.fails(values, threshold, below=below).sum())
    defined = metric.defined(values)
    what = f"{metric.words} {'below' if below else 'above'} {threshold:g}"
    if not defined.size:
        return Check(
            metric=name,
            rule="below" if below else "above",
            threshold=threshold,
            n_failed=0,
            worst_cell=None,
            worst_value=None,
            text=f"no cell has its {what}, as none has one",
        )
    # By the rule, which may be the other way round than the metric's own direction.
    far = values if below else -values
    cell = int(np.nanargmin(far) if metric.partial else np.argmin(far))
    value = float(values[cell])
    text = f"no cell has its {what}; cell {cell} has {metric.text(value)}"
    if n_failed:
        text = (
            f"{plural(n_failed, 'cell')} of {defined.size} with the {what}; the worst: "
            f"cell {cell} has {metric.text(value)}"
        )
    return Check(
        metric=name,
        rule="below" if below else "above",
        threshold=threshold,
        n_failed=n_failed,
        worst_cell=cell,
        worst_value=value,
        text=text,
    )


def check_validity(quality: Quality) -> Check:
    """Hold every cell to be valid."""
    bad = quality.validity.nonzero()[0]
    text = "no cell is not valid"
    if len(bad):
        text = f"{plural(len(bad), 'cell')} of {len(quality.validity)} not valid"
        text += f"; the first: cell {bad[0]}"
    return Check(
        metric="validity",
        rule="invalid",
        threshold=None,
        n_failed=len(bad),
        worst_cell=int(bad[0]) if len(bad) else None,
        worst_value=None,
        text=text,
    )
