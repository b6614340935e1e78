"""What smoothing gives back: the mesh, its quality before and after, and how it came about."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import asdict, dataclass, field, fields
from functools import cached_property
from typing import Any, SupportsIndex, overload

import numpy as np
import numpy.typing as npt

from qsmooth._frames import data_frame
from qsmooth._json import finite
from qsmooth._types import FloatArray
from qsmooth._words import did_you_mean, plural
from qsmooth.adapters import back
from qsmooth.mesh import Mesh
from qsmooth.metrics import Quality, Summary
from qsmooth.metrics.summary import figure_sections, size_text
from qsmooth.notebook import page
from qsmooth.outcome import Outcome
from qsmooth.table import Table, time_text
from qsmooth.wording import reason


@dataclass(frozen=True)
class SweepRecord:
    """What one sweep did; of the optimiser, one round of sweeps.

    Attributes
    ----------
    largest_move
        Length of the longest move, in the mesh's unit.
    largest_share
        Largest move as a share of its vertex's shortest edge.
    n_moved
        Vertices that moved.
    min_angle, max_angle
        Smallest and largest angle of the mesh afterwards, degrees.
    mean_shape
        Mean of the cells' shape afterwards.
    n_invalid
        Cells that are not valid afterwards.
    """

    largest_move: float
    largest_share: float
    n_moved: int
    min_angle: float
    max_angle: float
    mean_shape: float
    n_invalid: int

    def __repr__(self) -> str:
        return (
            f"SweepRecord({self.min_angle:.1f}° to {self.max_angle:.1f}°, "
            f"mean shape {self.mean_shape:.3f}, {self.n_invalid} not valid; {self.n_moved} moved, "
            f"by {self.largest_move:.3g} at most, {self.largest_share:.3g} of the shortest edge)"
        )


class History(tuple[SweepRecord, ...]):
    """Records of the sweeps in order; ``history["min_angle"]`` is an array, a value a record."""

    __slots__ = ()

    def __new__(cls, records: Iterable[SweepRecord] = ()) -> History:
        """Keep the records."""
        return super().__new__(cls, tuple(records))

    def __repr__(self) -> str:
        if not self:
            return "History()"
        low, high = (f"{self[k].min_angle:.1f}° to {self[k].max_angle:.1f}°" for k in (0, -1))
        return f"History({plural(len(self), 'record')}: {low} in the first, {high} in the last)"

    def to_dataframe(self) -> Any:
        """Give a ``pandas.DataFrame`` with a row a record.

        Raises
        ------
        ImportError
            Where there is no pandas.
        """
        columns = {f.name: self[f.name] for f in fields(SweepRecord)}
        return data_frame(columns, np.arange(len(self)), "record")

    @overload
    def __getitem__(self, key: str) -> npt.NDArray[Any]: ...
    @overload
    def __getitem__(self, key: SupportsIndex) -> SweepRecord: ...
    @overload
    def __getitem__(self, key: slice) -> tuple[SweepRecord, ...]: ...
    def __getitem__(self, key: str | SupportsIndex | slice) -> Any:
        """Get a column by its name, or records as of a tuple."""
        if not isinstance(key, str):
            return super().__getitem__(key)
        names = [f.name for f in fields(SweepRecord)]
        if key not in names:
            raise KeyError(f"no column {key!r} in the history{did_you_mean(key, names)}")
        return np.array([getattr(record, key) for record in self])


@dataclass(frozen=True)
class SmoothResult:
    """A smoothed mesh, and how it came about.

    Attributes
    ----------
    mesh
        The mesh at its new coordinates; connectivity and data are the input's.
    outcome
        What was done and why it stopped, as a record.
    history
        A record a sweep, of the optimiser a round of ten; columns by name.
    quality_before, quality_after
        Metrics of every cell of the input and of the result.
    seconds
        Time of the sweeps, and of the looks between them by which the optimiser goes on; without
        callbacks, reading, checking and the compiling of kernels.
    freedom
        What could move of the input, and where to, as a `constraints.Freedom`; reports say by it
        what holds a cell. None where that is not known.
    """

    mesh: Mesh
    outcome: Outcome
    history: History
    quality_before: Quality
    quality_after: Quality
    seconds: float
    freedom: Any = field(default=None, repr=False, compare=False)

    def __repr__(self) -> str:
        figures = (
            f"{low:.1f}° to {high:.1f}°, {q.n_invalid} not valid"
            for q in (self.quality_before, self.quality_after)
            for low, high in (q.extreme_angles,)
        )
        return (
            f"SmoothResult({self.method}: {' → '.join(figures)}; "
            f"{plural(self.sweeps, 'sweep')}, {time_text(self.seconds)})"
        )

    def _repr_html_(self) -> str:
        """Show a table and pictures, before and after, in a notebook."""
        sections = figure_sections([self.before, self.after], mark=False)
        table = Table(("Before", "After"), tuple(sections), self.reason)
        pictures = [self.quality_before.picture(), self.quality_after.picture()]
        done = f"{self.method}, {plural(self.sweeps, 'sweep')}, {time_text(self.seconds)}"
        return page(f"{size_text(self.after)}: {done}", table, pictures)

    @cached_property
    def before(self) -> Summary:
        """Quality of the input, summed up when first asked for."""
        return self.quality_before.summary()

    @cached_property
    def after(self) -> Summary:
        """Quality of the result, summed up when first asked for."""
        return self.quality_after.summary()

    @property
    def points(self) -> FloatArray:
        """New coordinates, in the shape of the input's."""
        return self.mesh.points

    def back(self, obj: Any = None) -> Any:
        """Give the mesh in the form that it came in, with all that it carried there.

        Parameters
        ----------
        obj
            What was smoothed, where the result can't know it: once it has been pickled.

        Returns
        -------
        object
            Of what `as_mesh` takes a copy of the same class, with the new coordinates, as float64,
            and the point data that was interpolated; a gmsh model itself, changed in place; a pair
            ``(points, cells)``. The mesh, where it came as a `Mesh` of arrays or from a file.

        Raises
        ------
        ValueError
            If it has other vertices by now, or is no longer there.
        """
        if obj is None:
            obj = self.mesh if self.mesh.origin is None else self.mesh.origin
        return back(self.mesh, obj)

    @property
    def method(self) -> str:
        """The method's name."""
        return self.outcome.method

    @property
    def sweeps(self) -> int:
        """How many sweeps were made."""
        return self.outcome.sweeps

    @property
    def converged(self) -> bool:
        """Whether it stopped by itself, and was neither cut short nor stuck."""
        return self.outcome.stop.by_itself

    @property
    def reason(self) -> str:
        """What was done and why it stopped, in words for people; programs read `outcome`."""
        return reason(self.outcome)

    def to_dict(self) -> dict[str, Any]:
        """Plain values, fit for JSON, without the mesh: None for what is not finite."""
        return {
            "method": self.method,
            "sweeps": self.sweeps,
            "converged": self.converged,
            "reason": self.reason,
            "seconds": self.seconds,
            "outcome": self.outcome.to_dict(),
            "before": self.before.to_dict(),
            "after": self.after.to_dict(),
            "history": [finite(asdict(record)) for record in self.history],
        }
