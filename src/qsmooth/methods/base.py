"""What a method is: options that check themselves, and how it smooths a mesh."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, ClassVar, TypeAlias

from qsmooth.carrying import Carry, carried, parse_names, require_data
from qsmooth.constraints import Constraints
from qsmooth.mesh import Mesh
from qsmooth.options import OptionError, opaque, option
from qsmooth.result import SmoothResult, SweepRecord
from qsmooth.team import Team, is_comm

Callback: TypeAlias = Callable[[SweepRecord], object]


@dataclass(frozen=True, kw_only=True)
class Method(Constraints):
    """A smoothing method and its options; these, and `Constraints`, are what all methods have.

    A derived class sets the class attributes and `run`; its docstring says how it works and where
    it comes from. Called with one it is `qsmooth.smooth` that smooths.

    Attributes
    ----------
    name, title
        As in ``smooth(mesh, "star")``, and as the head of a column.
    purpose
        What it is for and when to take it, in a sentence; options in it stand in backticks.
    guarded
        Whether it keeps valid cells valid; some have an option that says otherwise, see `guards`.
    untangles
        Whether it makes invalid cells valid.
    listed
        Whether it is one to choose among; untangling alone is not.
    sweeps_a_record
        Sweeps between two records of its history, and so between two calls of `callback`.
    """

    name: ClassVar[str]
    title: ClassVar[str]
    purpose: ClassVar[str]
    guarded: ClassVar[bool] = True
    untangles: ClassVar[bool] = False
    listed: ClassVar[bool] = True
    sweeps_a_record: ClassVar[int] = 1

    max_sweeps: int = option(50, within="[0, inf)", flag="sweeps", help="Sweeps at most.")
    time_limit: float | None = option(
        None,
        within="(0, inf)",
        unit="seconds",
        metavar="SECONDS",
        help="Time after which it stops with the best so far, compiling left out; results then "
        "depend on the machine.",
    )
    threads: int | None = option(
        None,
        within="[1, inf)",
        default_words="by size",
        help="How many threads; the result does not depend on it.",
    )
    carry: Carry = option(
        "interpolate",
        help="What becomes of z on a flat mesh, and of the variables of a Selafin file: "
        "interpolate, they are found anew in the input mesh, where each vertex has come to; keep, "
        "they are carried along.",
    )
    interpolate: Any = option(
        (),
        metavar="NAMES",
        default_words="none",
        parse=tuple,
        repeats=True,
        help="Point data of the file to interpolate in the same way, floats only, with commas "
        "between, or one at a time, as names with commas need it (in Python a list); all other "
        "data stays with its vertices.",
    )
    callback: Callback | None = opaque(
        None,
        flag=None,
        help="Called after each sweep, of optimize each round of ten, with its `SweepRecord`; True "
        "stops with the best so far. What it raises gets through, with that as its `result`.",
    )

    comm: Any = opaque(
        None,
        flag=None,
        help="An ``mpi4py.MPI.Comm`` whose ranks smooth the mesh together, with the same bits as "
        "one process; all of them call. The first one has the mesh, and its options count.",
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        object.__setattr__(self, "interpolate", parse_names(self.interpolate))
        if self.callback is not None and not callable(self.callback):
            raise OptionError(f"`callback` must be callable, got {self.callback!r}")
        if not (self.comm is None or isinstance(self.comm, Team) or is_comm(self.comm)):
            raise OptionError(f"`comm` must be a communicator of mpi4py, got {self.comm!r}")

    def __init_subclass__(cls, **more: Any) -> None:
        super().__init_subclass__(**more)
        if "name" in cls.__dict__:
            cls.owner = f"method {cls.name!r}"

    @property
    def team(self) -> Team | None:
        """The ranks that smooth together; None for this process alone."""
        return self.comm if self.comm is None or isinstance(self.comm, Team) else Team(self.comm)

    @property
    def guards(self) -> bool:
        """Whether it keeps valid cells valid with these options."""
        return self.guarded

    def why_not(self, mesh: Mesh) -> str:
        """Say in a line why it can do nothing with the mesh's cells; "" where it can.

        Options in it stand in backticks, see `qsmooth.options.spelled`.
        """
        return ""

    def smooth(self, mesh: Mesh, chosen: str = "", *known: Any) -> SmoothResult:
        """Smooth a mesh, and see to the values that belong to its places.

        `chosen` says why this method was taken, for the outcome; `known` is for `run`.
        """
        names = require_data(mesh, self.interpolate)
        given = self.carry, names, self.threads
        try:
            return carried(mesh, self.run(mesh, chosen, *known), *given)
        except Exception as error:
            so_far = getattr(error, "result", None)
            if isinstance(so_far, SmoothResult):  # of a callback that raised
                error.result = carried(mesh, so_far, *given)  # type: ignore[attr-defined]
            raise

    def run(self, mesh: Mesh, chosen: str = "") -> SmoothResult:
        """Move the vertices; for derived classes, and called by `smooth`."""
        raise NotImplementedError
