"""Which part of a schedule this process sweeps, and how it learns of the others' moves.

One process sweeps all of it. Several ranks that smooth one mesh divide the movable vertices: each
sweeps its own, colour by colour, and after each colour is sent where those vertices have gone that
share a cell with one of its own. Within a colour the vertices that others wait for come first, so
that messages fly while the rest is swept.
"""

from __future__ import annotations

import weakref
from collections.abc import Callable
from typing import Any, NamedTuple, TypeAlias, TypeVar

import numpy as np
import numpy.typing as npt

from qsmooth._types import BoolArray, FloatArray, IndexArray
from qsmooth.checks import read_only
from qsmooth.kernels.stars import Stars
from qsmooth.metrics import Quality
from qsmooth.sums import exact_sum, scaled_sum, sum_of_scaled
from qsmooth.team import Team
from qsmooth.topology import Topology

T = TypeVar("T")
A = TypeVar("A", bound=npt.NDArray[Any])

# Runs a sweep over a range of colours, so many of them.
Runner: TypeAlias = Callable[[Callable[[Any], None], int], None]


class Moved(NamedTuple):
    """What a sweep, or a round of them, has moved.

    Attributes
    ----------
    largest, largest_share
        The longest move, in the unit of the coordinates, and as a share of the shortest edge.
    vertices
        How many moved.
    """

    largest: float
    largest_share: float
    vertices: int

    def together(self, other: Moved) -> Moved:
        """What both have moved."""
        return Moved(
            max(self.largest, other.largest),
            max(self.largest_share, other.largest_share),
            self.vertices + other.vertices,
        )


class Glance(NamedTuple):
    """What is asked of a mesh after every sweep; names as `Quality` has them."""

    extreme_angles: tuple[float, float]
    mean_shape: float
    n_invalid: int


def moved_by(lengths: FloatArray, shares: FloatArray) -> Moved:
    """Sum up the moves of some vertices, (n,) and (n,)."""
    return Moved(
        float(lengths.max(initial=0.0)),
        float(shares.max(initial=0.0)),
        int(np.count_nonzero(lengths > 0.0)),
    )


class Run(NamedTuple):
    """Cells that follow each other: those that one rank looks at.

    Attributes
    ----------
    cells, corners
        Which cells, and which of `Topology.cell_vertices`.
    topology
        These cells.
    """

    cells: slice
    corners: slice
    topology: Topology


class Alone:
    """One process that has all vertices: what several would have to tell each other."""

    def run_of(self, topology: Topology) -> Run:
        """Give the cells that this process looks at; all ranks together look at all."""
        return Run(slice(0, topology.n_cells), slice(0, topology.cell_vertices.size), topology)

    def of_cells(self, own: A, topology: Topology) -> A:
        """Join what there is at the cells of `run_of`, (n, ...), to all cells'."""
        return own

    def of_all(self, thing: T) -> list[T]:
        """What each process has; for small things."""
        return [thing]

    def either(self, marks: BoolArray) -> None:
        """Mark what any process has marked, in place."""

    def exact_sum(self, own: FloatArray) -> float:
        """Add up all processes' numbers, as `sums.exact_sum` does."""
        scaled = scaled_sum(own)
        found = self.of_all(exact_sum(own) if scaled is None else scaled)
        odd = [one for one in found if isinstance(one, float)]
        return sum(odd) if odd else sum_of_scaled(sum(map(int, found)))

    def complete(self, *values: FloatArray, colour: int | None = None) -> None:
        """Fill in what others have at their movable vertices, (n_vertices, ...), in place.

        Or at those of one colour, by its number in the whole schedule.
        """

    def moved(self, lengths: FloatArray, shares: FloatArray) -> Moved:
        """Sum up the moves of all ranks' vertices."""
        return moved_by(lengths, shares)

    def largest(self, value: float) -> float:
        """The largest of all ranks'."""
        return value

    def total(self, values: IndexArray) -> IndexArray:
        """Sum of all ranks' integers."""
        return values

    def glance(self, topology: Topology, xy: FloatArray) -> Quality | Glance:
        """Measure all cells; each rank its own."""
        return Quality(topology, xy)


class Part(Alone):
    """The whole of a schedule.

    Parameters
    ----------
    run
        Runs a sweep on this process.
    stars
        The schedule that this process sweeps.

    Attributes
    ----------
    own_blocks : (n_blocks,) or None
        Which blocks of lanes this process sweeps in the steps of a session; None for all.
    """

    own_blocks: BoolArray | None = None

    def __init__(self, run: Runner, stars: Stars) -> None:
        self._run, self.stars = run, stars

    @property
    def n_colours(self) -> int:
        """Colours of `stars`."""
        return self.stars.colour_offsets.size - 1

    def sweep(self, move: Callable[[Any], None], n_colours: int, xy: FloatArray) -> None:
        """Sweep over all colours, or over 1 where all vertices move at once."""
        self._run(move, n_colours)

    def sweep_one(self, move: Callable[[Any], None], colour: int) -> None:
        """Sweep over one colour, by the number that it has in the whole schedule."""
        self._run(lambda _: move((colour, colour + 1)), 1)

    def near(self, topology: Topology, rings: int) -> tuple[BoolArray | None, Topology]:
        """Give the cells of so many rings around those of `stars`: marks, (n_cells,), None for all.

        And these cells themselves.
        """
        return None, topology


class Share(Part):
    """What one of several ranks has of a schedule.

    Parameters
    ----------
    team
        The ranks.
    run
        Runs a sweep on this rank.
    topology, whole
        The cells that are swept, and the schedule of all ranks.
    owner : (n_vertices,)
        Which rank each vertex belongs to.
    measured
        The cells that `glance` is asked about, if others.
    """

    def __init__(
        self,
        team: Team,
        run: Runner,
        topology: Topology,
        whole: Stars,
        owner: IndexArray,
        measured: Topology | None = None,
    ) -> None:
        from qsmooth.kernels.dividing import shared_vertices

        self._team, self._owner = team, owner
        self._colours = whole.colour_offsets.size - 1
        colour = np.full(owner.size, -1, np.int64)
        colour[whole.vertices] = np.repeat(np.arange(self._colours), np.diff(whole.colour_offsets))
        self._is_movable = colour >= 0
        cells = {id(each): each.cells for each in (topology, measured or topology)}
        found = [shared_vertices(owner, self._is_movable, *each) for each in cells.values()]
        wanting, vertices = np.divmod(np.unique(np.concatenate(found)), owner.size)
        mine, others = owner[vertices] == team.rank, wanting == team.rank
        self._channels = [
            _Channels(
                team,
                _by_rank(vertices[mine], wanting[mine], colour, c),
                _by_rank(vertices[others], owner[vertices[others]], colour, c),
                c,
            )
            for c in range(self._colours)
        ]
        wanted = np.zeros(owner.size, np.bool_)
        wanted[vertices[mine]] = True
        super().__init__(run, self._stars_of(whole, wanted))
        movable = np.flatnonzero(self._is_movable)
        ranks = owner[movable]
        order = np.argsort(ranks, kind="stable")  # each rank's as they lie in memory
        self._movable, self._counts = movable[order], np.bincount(ranks, minlength=team.size)
        self._colour_of = colour[self._movable].astype(np.int16)
        self._near: dict[tuple[Topology, int], tuple[BoolArray, Topology]] = {}
        self._runs: dict[Topology, Run] = {}
        self._measured, self._cells = topology, topology
        self._is_split = False

    def _stars_of(self, whole: Stars, wanted: BoolArray) -> Stars:
        """Give what this rank sweeps; the vertices that others want come first."""
        return _own_stars(whole, self._owner[whole.vertices] == self._team.rank, wanted)

    def close(self) -> None:
        """Give back what MPI holds."""
        for channels in self._channels:
            channels.close()

    def sweep(self, move: Callable[[Any], None], n_colours: int, xy: FloatArray) -> None:
        """Sweep over all colours, and have the others' moves, as far as cells are shared."""
        if n_colours == 1:
            self._run(lambda _: move((0, self.n_colours)), 1)
            for channels in self._channels:
                channels.start(xy)
            for channels in self._channels:
                channels.finish(xy)
            return
        for colour, channels in enumerate(self._channels):
            self._run_range(move, 2 * colour)
            channels.start(xy)
            self._run_range(move, 2 * colour + 1)
            channels.finish(xy)

    def _run_range(self, move: Callable[[Any], None], first: int) -> None:
        self._run(lambda _: move((first, first + 1)), 1)

    def sweep_one(self, move: Callable[[Any], None], colour: int) -> None:
        """Sweep over one colour, by the number that it has in the whole schedule."""
        self._run(lambda _: move((2 * colour, 2 * colour + 2)), 1)

    def near(self, topology: Topology, rings: int) -> tuple[BoolArray | None, Topology]:
        """Give the cells of so many rings around those of `stars`: marks, (n_cells,), None for all.

        And these cells themselves.
        """
        if (topology, rings) not in self._near:
            chosen, at = np.zeros(topology.n_cells, np.bool_), np.zeros(self._owner.size, np.bool_)
            chosen[self.stars.cells] = True
            for _ in range(rings):
                at[topology.cell_vertices[np.repeat(chosen, topology.cell_sizes)]] = True
                chosen = np.logical_or.reduceat(
                    at[topology.cell_vertices], topology.cell_offsets[:-1]
                )
            self._near[topology, rings] = chosen, topology.only_cells(chosen)
        return self._near[topology, rings]

    def complete(self, *values: FloatArray, colour: int | None = None) -> None:
        """Fill in what others have at their movable vertices, (n_vertices, ...), in place.

        Or at those of one colour, by its number in the whole schedule.
        """
        vertices, counts = self._movable, self._counts
        if colour is not None:
            chosen = self._colour_of == colour
            vertices = vertices[chosen]
            ends = np.cumsum(counts)
            counts = np.diff(np.append(0, np.cumsum(chosen))[np.append(0, ends)])
        first = int(counts[: self._team.rank].sum())
        after = first + int(counts[self._team.rank])
        for array in values:
            joined = self._team.joined(array[vertices[first:after]], counts)
            array[vertices[:first]] = joined[:first]
            array[vertices[after:]] = joined[after:]

    def moved(self, lengths: FloatArray, shares: FloatArray) -> Moved:
        """Sum up the moves of all ranks' vertices."""
        found, *others = self._team.of_all(moved_by(lengths, shares))
        for other in others:
            found = found.together(other)
        return found

    def largest(self, value: float) -> float:
        """The largest of all ranks'."""
        return max(self._team.of_all(value))

    def run_of(self, topology: Topology) -> Run:
        """Give the cells that this rank looks at; all ranks together look at all."""
        if topology not in self._runs:
            ends = self._ends_of_runs(topology)[self._team.rank :][:2].tolist()
            corners = topology.cell_offsets[ends].tolist()
            self._runs[topology] = Run(slice(*ends), slice(*corners), topology.run_of_cells(*ends))
        return self._runs[topology]

    def _ends_of_runs(self, topology: Topology) -> IndexArray:
        """Where the ranks' runs of cells begin and end, (size + 1,)."""
        ends: IndexArray = np.arange(self._team.size + 1) * topology.n_cells // self._team.size
        return ends

    def of_cells(self, own: A, topology: Topology) -> A:
        """Join what there is at the cells of `run_of`, (n, ...), to all cells'."""
        ends = self._ends_of_runs(topology)
        return self._team.joined(own, np.diff(ends))

    def of_all(self, thing: T) -> list[T]:
        """What each rank has, by rank; for small things."""
        return self._team.of_all(thing)

    def either(self, marks: BoolArray) -> None:
        """Mark what any rank has marked, in place."""
        self._team.either(marks)

    def total(self, values: IndexArray) -> IndexArray:
        """Sum of all ranks' integers."""
        total: IndexArray = np.sum(self._team.of_all(values), axis=0, dtype=np.int64)
        return total

    def glance(self, topology: Topology, xy: FloatArray) -> Quality | Glance:
        """Measure all cells; each rank those with the first of whose movable vertices is its."""
        from qsmooth.kernels.dividing import own_cells

        if not self._is_split or self._measured is not topology:
            mine = np.empty(topology.n_cells, np.bool_)
            own_cells(self._team.rank, self._owner, self._is_movable, *topology.cells, mine)
            self._cells = topology.only_cells(mine)
            self._measured, self._is_split = topology, True
        own = Quality(self._cells, xy)
        n_own = self._cells.n_cells
        part = (
            own.extreme_angles if n_own else (np.inf, -np.inf),
            scaled_sum(own.shape_of_glance) if n_own else 0,
            own.n_invalid if n_own else 0,
        )
        angles, sums, invalid = zip(*self._team.of_all(part), strict=True)
        if any(scaled is None for scaled in sums):  # a shape that is NaN
            self.complete(xy)
            return Quality(topology, xy)
        lowest, highest = zip(*angles, strict=True)
        return Glance(
            (min(lowest), max(highest)),
            sum_of_scaled(sum(sums)) / topology.n_cells,
            sum(invalid),
        )


class Steps(Share):
    """What one of several ranks has of the steps of a session: some blocks of lanes, wholly.

    Blocks rest and wake as one, so that they are not cut up. Each rank has as many of each colour,
    one after the other as they lie in memory.

    Parameters
    ----------
    team, run, topology, whole
        As of a `Share`.
    block_of : (n_vertices,)
        Block of each of the vertices of `whole`; blocks are counted colour by colour.
    """

    def __init__(
        self,
        team: Team,
        run: Runner,
        topology: Topology,
        whole: Stars,
        block_of: IndexArray,
    ) -> None:
        vertices = whole.vertices.astype(np.int64)
        blocks, n_colours = block_of[vertices], whole.colour_offsets.size - 1
        colour = np.empty(int(blocks.max(initial=-1)) + 1, np.int64)
        colour[blocks] = np.repeat(np.arange(n_colours), np.diff(whole.colour_offsets))
        counts = np.bincount(colour, minlength=n_colours)
        place = np.arange(colour.size) - (np.cumsum(counts) - counts)[colour]
        rank_of = place * team.size // counts[colour]
        owner = np.zeros(topology.n_vertices, np.int64)
        owner[vertices] = rank_of[blocks]
        super().__init__(team, run, topology, whole, owner)
        self.own_blocks = rank_of == team.rank
        weakref.finalize(self, _give_back, self._channels).atexit = False

    def _stars_of(self, whole: Stars, wanted: BoolArray) -> Stars:
        return whole

    def sweep(self, move: Callable[[Any], None], n_colours: int, xy: FloatArray) -> None:
        """Sweep over all colours of the blocks selected, and have the others' moves."""
        for colour, channels in enumerate(self._channels):
            self._run_range(move, colour)
            channels.start(xy)
            channels.finish(xy)


class _Channels:
    """Messages of one colour: to whom which vertices' places go, and whose come from where.

    Buffers and requests are made once.
    """

    def __init__(
        self, team: Team, out: dict[int, IndexArray], into: dict[int, IndexArray], tag: int
    ) -> None:
        self._team = team
        self._out = [(ids, np.empty((ids.size, 2))) for ids in out.values()]
        self._into = [(ids, np.empty((ids.size, 2))) for ids in into.values()]
        self._receive = [
            team.comm.Recv_init(buffer, rank, tag)
            for rank, (_, buffer) in zip(into, self._into, strict=True)
        ]
        self._send = [
            team.comm.Send_init(buffer, rank, tag)
            for rank, (_, buffer) in zip(out, self._out, strict=True)
        ]

    def start(self, xy: FloatArray) -> None:
        """Send where the own vertices have come to."""
        for request in self._receive:
            request.Start()
        for (ids, buffer), request in zip(self._out, self._send, strict=True):
            np.take(xy, ids, axis=0, out=buffer, mode="clip")
            request.Start()
            self._team.messages += 1
            self._team.sent += buffer.nbytes

    def finish(self, xy: FloatArray) -> None:
        """Wait for the others' vertices, and put them in their places."""
        for (ids, buffer), request in zip(self._into, self._receive, strict=True):
            request.Wait()
            xy[ids] = buffer
        for request in self._send:
            request.Wait()

    def close(self) -> None:
        """Free the requests."""
        for request in (*self._receive, *self._send):
            request.Free()


def _give_back(every: list[_Channels]) -> None:
    """Free what MPI holds, where that is still there."""
    from mpi4py import MPI

    if not MPI.Is_finalized():
        for channels in every:
            channels.close()


def _by_rank(
    vertices: IndexArray, ranks: IndexArray, colours: IndexArray, colour: int
) -> dict[int, IndexArray]:
    """Sort vertices of one colour by rank."""
    chosen = colours[vertices] == colour
    vertices, ranks = vertices[chosen], ranks[chosen]
    return {int(rank): np.sort(vertices[ranks == rank]) for rank in np.unique(ranks)}


def _own_stars(whole: Stars, own: BoolArray, wanted: BoolArray) -> Stars:
    """Keep some vertices of a schedule; each colour in two, those first that others wait for."""
    n_colours = whole.colour_offsets.size - 1
    colour = np.repeat(np.arange(n_colours), np.diff(whole.colour_offsets))
    places = np.flatnonzero(own)
    turn = 2 * colour[places] + ~wanted[whole.vertices[places]]
    places = places[np.argsort(turn, kind="stable")]
    counts = np.diff(whole.offsets)[places]
    offsets = np.concatenate([[0], np.cumsum(counts)])
    rows = np.repeat(whole.offsets[places] - offsets[:-1], counts) + np.arange(offsets[-1])
    of_turns = np.bincount(turn, minlength=2 * n_colours)
    return Stars(
        colour_offsets=read_only(np.concatenate([[0], np.cumsum(of_turns)])),
        vertices=read_only(whole.vertices[places]),
        offsets=read_only(offsets),
        corners=read_only(whole.corners[rows]),
        cells=read_only(whole.cells[rows]),
        largest=int(counts.max(initial=0)),
    )
