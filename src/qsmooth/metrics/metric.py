"""What there is to know about a metric, in one record."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal, Protocol, TypeAlias

import numpy as np
import numpy.typing as npt

from qsmooth._types import FloatArray, IndexArray
from qsmooth._words import capitalised
from qsmooth.topology import Topology

Mean: TypeAlias = Literal["arithmetic", "finite", "geometric"]
# From here on a number is written with an exponent.
LARGE = 1e5
# Words that say by themselves which end is meant: no "smallest shortest edge".
SUPERLATIVES = "smallest ", "largest ", "shortest "


class Cells(Protocol):
    """What is measured: cells at coordinates, and what several metrics are made of."""

    @property
    def topology(self) -> Topology:
        """The cells and how they hang together."""
        ...

    @property
    def xy(self) -> FloatArray:
        """Coordinates in the plane of the mesh, (n_vertices, 2)."""
        ...

    def figure(self, name: str) -> FloatArray:
        """Measure angles, edges, corners and areas in one pass, and give one of these figures."""
        ...

    @property
    def area(self) -> FloatArray:
        """Signed area of each cell."""
        ...


@dataclass(frozen=True, kw_only=True)
class Metric:
    """A figure for each cell, and all that is needed to rank, sum up, name and draw it.

    Attributes
    ----------
    name
        Its name in Python, JSON and the shell; that of its kernel, too.
    measure
        Takes the cells and gives a figure for each, (n_cells,). NaN means "not defined for this
        cell", and is left out of all that follows; a broken cell has the worst figure instead.
    words, many
        Its name in a sentence, and that of several: by default with an "s".
    definition
        One line that may stand under a table, without a full stop.
    source
        Where the definition is from.
    higher_is_better
        Its direction.
    ideal, triangle_ideal
        The best figure, that of a square and that of an equilateral triangle; the latter is the
        same by default. None for a metric without a best.
    span
        The least and the largest figure that a cell can have.
    unit
        ``"°"``, ``"length"`` for the unit of the coordinates, or nothing.
    corners
        Which cells it is defined for: those of 3, of 4, or of both.
    inner
        Whether it is about inner edges: not defined for a cell without one.
    bins
        Edges of the histogram's bins; none for a metric without a histogram.
    worst_colour
        Where the colour scale ends; it begins at the ideal. None: at the worst of the mesh.
    mean
        Which mean sums it up: over all cells, over those with a finite figure, or the geometric
        one over the latter.
    short
        Whether it is in the table that nobody has asked to be longer.
    number
        How a figure is written, as by `format`.
    evident
        Whether its words say it all, and tables need no definition.
    blind
        Whether it may call a cell ideal that has no positive area, as one does that is made of
        lengths alone, or that takes angles as they come.
    """

    name: str
    measure: Callable[[Cells], FloatArray]
    words: str
    many: str = ""
    definition: str
    source: str = ""
    higher_is_better: bool
    ideal: float | None = 1.0
    triangle_ideal: float | None = None
    span: tuple[float, float]
    unit: Literal["", "°", "length"] = ""
    corners: tuple[int, ...] = (3, 4)
    inner: bool = False
    bins: tuple[float, ...] = ()
    worst_colour: float | None
    mean: Mean = "arithmetic"
    short: bool = False
    number: str = ".4f"
    evident: bool = False
    blind: bool = False

    @property
    def partial(self) -> bool:
        """Whether there may be cells that it is not defined for, and NaN stands for these."""
        return self.inner or len(self.corners) < 2

    @property
    def title(self) -> str:
        """Its name at the head of a column: "Scaled Jacobian"."""
        return capitalised(self.words)

    @property
    def worst_words(self) -> str:
        """The worst cell's figure: "Largest aspect ratio"."""
        if self.words.startswith(SUPERLATIVES):
            return self.title
        return f"{'Smallest' if self.higher_is_better else 'Largest'} {self.words}"

    @property
    def mean_words(self) -> str:
        """The mean of all cells: "Mean of aspect ratios"."""
        return f"Mean of {self.many or self.words + 's'}"

    @property
    def explanation(self) -> str:
        """One sentence under a table; nothing where the words say it all."""
        if self.evident:
            return ""
        ideal = "" if self.ideal is None else f"; ideal: {self.ideal:g}{self.degrees}"
        if self.triangle_ideal is not None:
            ideal += f", in triangles {self.triangle_ideal:g}{self.degrees}"
        mean = ", geometric mean" if self.mean == "geometric" else ""
        return f"{self.title}: {self.definition}{mean}{ideal}."

    @property
    def degrees(self) -> str:
        """The sign of degrees, where it is one of these."""
        return "°" if self.unit == "°" else ""

    @property
    def unit_words(self) -> str:
        """Its unit after a comma, for the axis of a figure."""
        return {"": "", "°": ", degrees", "length": ", in the mesh's unit"}[self.unit]

    def ideal_of(self, sizes: IndexArray) -> float | None:
        """Best figure that a mesh can have whose cells have so many corners."""
        if self.ideal is None:
            return None
        triangle = self.ideal if self.triangle_ideal is None else self.triangle_ideal
        found = [best for n, best in ((3, triangle), (4, self.ideal)) if (sizes == n).any()]
        return max(found) if self.higher_is_better else min(found)

    def edges_of(self, sizes: IndexArray) -> tuple[float, ...]:
        """Edges of the bins, without those beyond the best that such cells can have."""
        ideal = self.ideal_of(sizes)
        edges = self.bins
        if ideal is None or not edges:
            return edges
        if self.higher_is_better:
            last = next((k for k, edge in enumerate(edges) if edge >= ideal), len(edges) - 1)
            return edges[: last + 1]
        first = max((k for k, edge in enumerate(edges) if edge <= ideal), default=0)
        return edges[first:]

    def defined(self, values: FloatArray) -> FloatArray:
        """Figures of the cells that it is defined for."""
        if not self.partial:
            return values
        missing = np.isnan(values)
        return values[~missing] if missing.any() else values

    def worst_of(self, values: FloatArray) -> float:
        """Worst figure of all cells; NaN where it is not defined for any."""
        values = self.defined(values)
        if not values.size:
            return math.nan
        return float(values.min() if self.higher_is_better else values.max())

    def mean_of(self, values: FloatArray) -> float:
        """Mean figure; infinite where no cell has a finite one, NaN where none has any."""
        values = self.defined(values)
        if not values.size:
            return math.nan
        if self.mean == "arithmetic":
            return float(values.mean())
        is_finite = np.isfinite(values)
        finite = values if is_finite.all() else values[is_finite]
        if self.mean == "geometric":
            return float(np.exp(np.log(finite).mean())) if finite.size else math.nan
        if not finite.size:
            return -math.inf if self.higher_is_better else math.inf
        return float(finite.mean())

    def worst_cells(self, values: FloatArray, k: int) -> npt.NDArray[np.intp]:
        """Ids of the `k` worst cells that it is defined for, the worst first."""
        goodness = values if self.higher_is_better else -values
        if not self.partial:
            # Here NaN is no "not defined" but a lost coordinate: worse than all.
            goodness = np.where(np.isnan(goodness), -np.inf, goodness)
        return np.argsort(goodness, kind="stable")[: min(k, self.defined(values).size)]

    def fails(self, values: FloatArray, threshold: float, *, below: bool) -> npt.NDArray[np.bool_]:
        """Mark the cells below a threshold, or above it."""
        passed = values >= threshold if below else values <= threshold
        return ~(passed | np.isnan(values)) if self.partial else ~passed

    def text(self, value: float) -> str:
        """Write a figure, with its unit where that is degrees."""
        if math.isnan(value):
            return "none"
        if math.isinf(value):
            return "infinite" if value > 0 else "minus infinite"
        number = f"{value:.3e}" if abs(value) >= LARGE else f"{value:{self.number}}"
        return number + self.degrees
