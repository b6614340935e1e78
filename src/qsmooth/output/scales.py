"""Which colour stands for which figure. Needs matplotlib."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal, TypeAlias, get_args

import numpy as np

from qsmooth._types import FloatArray
from qsmooth.metrics import Metric, Quality

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Scale: TypeAlias = Literal["linear", "quantiles"]
# From good to bad: light to dark, readable without colour and by everybody.
COLOURS = "YlOrRd"
# Of how far vertices moved, which is neither good nor bad.
MOVES_COLOURS = "YlGnBu"
# Of cells that the metric is not defined for.
UNDEFINED_COLOUR = "#D0D0D0"
# Where a metric has cells worse than the end of its own scale, so many of them keep apart.
MOST_PERCENT = 98.0
# Inches of a letter beside the bar.
LETTER = 0.072
# Sizes and ratios that differ by more than this have colours that go with their logarithm.
LARGEST_LINEAR_RATIO = 100.0
# A class of the scale by quantiles has this share of the cells; the worst have smaller ones.
SHARES = (0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 0.95, 0.99, 1.0)


@dataclass(frozen=True)
class ColourScale:
    """Colours along the figures that are there.

    Attributes
    ----------
    best, worst
        Figures at the light and at the dark end; either may be the larger.
    beyond
        Whether there are cells worse than the dark end.
    edges
        Where classes of colour end, from best to worst; none where colours go with the figure.
    label, colours
        What stands beside it; the name of a map of colours.
    log
        Whether colours go with the logarithm of the figure.
    """

    best: float
    worst: float
    label: str
    beyond: bool = False
    edges: tuple[float, ...] = ()
    colours: str = COLOURS
    log: bool = False

    def shares(self, values: FloatArray) -> FloatArray:
        """Place of each figure from 0, the best, to 1; NaN for NaN."""
        sign = 1.0 if self.worst > self.best else -1.0
        if self.edges:
            inner = sign * np.array(self.edges[1:-1])
            places = np.searchsorted(inner, sign * values, side="right") / len(inner)
        elif self.log:
            low = min(self.best, self.worst)
            places = np.log(np.maximum(values, low) / self.best) / np.log(self.worst / self.best)
        else:
            places = (values - self.best) / (self.worst - self.best)
        shares: FloatArray = np.where(np.isnan(values), np.nan, np.clip(places, 0.0, 1.0))
        return shares

    def faces(self, values: FloatArray) -> FloatArray:
        """Colour of each figure, (n, 4)."""
        from matplotlib import colormaps
        from matplotlib.colors import to_rgba

        shares = self.shares(values)
        faces: FloatArray = colormaps[self.colours](shares)
        faces[np.isnan(shares)] = to_rgba(UNDEFINED_COLOUR)
        return faces

    def draw_bar(self, panels: Sequence[Axes], place: Axes | None) -> None:
        """Draw it into a place of its own, or beside the panels."""
        from matplotlib import colormaps
        from matplotlib.cm import ScalarMappable
        from matplotlib.colors import BoundaryNorm, LogNorm, Normalize

        rising = self.worst > self.best
        colours = colormaps[self.colours] if rising else colormaps[self.colours].reversed()
        kind: Any = LogNorm if self.log else Normalize
        norm: Any = kind(min(self.best, self.worst), max(self.best, self.worst))
        options: dict[str, Any] = {}
        if self.edges:
            ticks = np.sort(self.edges)
            norm = BoundaryNorm(ticks, colours.N)
            options = {"spacing": "uniform", "ticks": ticks, "format": _tick}
        elif self.beyond:
            options = {"extend": "max" if rising else "min"}
        figure: Any = panels[0].figure
        beside = {"ax": list(panels), "fraction": 0.04} if place is None else {"cax": place}
        bar = figure.colorbar(ScalarMappable(norm, colours), **beside, **options)
        # Words that are longer than the figure is high go on in a second line.
        letters = int(0.8 * figure.get_size_inches()[1] / LETTER)
        bar.set_label(textwrap.fill(self.label, max(30, letters)), fontsize=9)
        bar.ax.tick_params(labelsize=8)


def require_scale(scale: str, option: str = "scale") -> None:
    """Refuse what is no kind of scale."""
    if scale not in get_args(Scale):
        raise ValueError(f"{option} must be one of {', '.join(get_args(Scale))}; got {scale!r}")


def colour_scale(metric: Metric, measured: Sequence[Quality], scale: Scale) -> ColourScale:
    """Spread colours over what these meshes have of a metric."""
    require_scale(scale)
    values = np.concatenate([of[metric.name] for of in measured])
    values = values[np.isfinite(values)]
    if not values.size:
        values = np.array([0.0, 1.0])
    better = "more is better" if metric.higher_is_better else "less is better"
    label = f"{metric.title}{metric.unit_words} ({better})"
    if scale == "quantiles":
        edges = _quantiles(values, metric.higher_is_better)
        if len(edges) > 2:
            label = f"{label}; by tenths of the cells"
            return ColourScale(edges[0], edges[-1], label, edges=edges)
    low, high = _widened(float(values.min()), float(values.max()))
    best, worst = (high, low) if metric.higher_is_better else (low, high)
    end, sign = metric.worst_colour, -1.0 if metric.higher_is_better else 1.0
    beyond = False
    if end is not None and sign * (worst - end) > 0.0:
        most = 100.0 - MOST_PERCENT if metric.higher_is_better else MOST_PERCENT
        kept = sign * max(sign * end, sign * float(np.percentile(values, most)))
        if sign * (kept - best) > 0.0 and kept != worst:
            worst, beyond = kept, True
    return ColourScale(best, worst, label, beyond, log=_is_wide(metric, values))


def _is_wide(metric: Metric, values: FloatArray) -> bool:
    """Whether most figures of a size or a ratio, which have no end, span decades."""
    if not np.isinf(metric.span[1]) or values.min() <= 0.0:
        return False
    low, high = np.percentile(values, (100.0 - MOST_PERCENT, MOST_PERCENT))
    return bool(high > LARGEST_LINEAR_RATIO * low)


def moves_scale(shares: FloatArray, scale: Scale) -> ColourScale:
    """Spread colours over how far vertices moved."""
    require_scale(scale)
    label = "How far a vertex moved, over the mean of its edges before"
    moved = shares[shares > 0.0]
    if not moved.size:
        moved = np.ones(1)
    if scale == "quantiles":
        edges = (0.0, *(e for e in _quantiles(moved, higher_is_better=False) if e > 0.0))
        if len(edges) > 2:
            label = f"{label}; by tenths of those that moved"
            return ColourScale(0.0, edges[-1], label, edges=edges, colours=MOVES_COLOURS)
    most = float(np.percentile(moved, MOST_PERCENT))
    beyond = bool(moved.max() > most)
    return ColourScale(0.0, most, label, beyond, colours=MOVES_COLOURS)


def _quantiles(values: FloatArray, higher_is_better: bool) -> tuple[float, ...]:
    """Ends of classes from best to worst; figures that many cells share are in one of them."""
    ordered = -values if higher_is_better else values
    edges = np.unique(np.quantile(ordered, SHARES, method="closest_observation"))
    return tuple((-edges if higher_is_better else edges).tolist())


def _widened(low: float, high: float) -> tuple[float, float]:
    if low < high:
        return low, high
    return low - 0.5 * (abs(low) or 1.0), high + 0.5 * (abs(high) or 1.0)


def _tick(value: float, _place: int | None = None) -> str:
    return f"{value:.4g}"
