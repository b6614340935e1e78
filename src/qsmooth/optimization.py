"""The optimiser: untangle, improve the mean shape, then the worst cells; and know when to stop."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import TypeAlias

import numpy as np

from qsmooth._types import BoolArray, FloatArray
from qsmooth._words import plural
from qsmooth.kernels.stars import Stars
from qsmooth.mesh import Mesh
from qsmooth.metrics import Quality, Validity

# Multiple of the Newton step that is tried first: neighbours follow the same way in their turn.
RELAXATION = 1.7
# Sweeps between two looks at the mesh.
ROUND = 10
# An energy that fell by less than this fraction in a round has settled.
SETTLED = 1e-5
# Before the worst cells are seen to, the mean gets this many rounds, or settles to this.
MEAN_ROUNDS = 12
MEAN_GAIN = 1e-4
# Sweeps that still gain this much a round after those rounds creep: a whole region has to move.
# Then at most so many Newton steps on the whole mesh, while each gains more than this.
CREEPING = 2e-3
GLOBAL_STEPS = 8
GLOBAL_GAIN = 2e-2
# Stages of the worst cells: power 2 ** squarings of the wall, and where it stands as a fraction of
# the worst corner's badness. The last one gives back what the mean need not have paid.
WALLS = ((2, 0.7), (3, 0.8), (4, 0.85), (5, 0.9), (6, 0.9), (6, 0.95))
# Rounds without a better result after which the next wall is put up.
WALL_PATIENCE = 2
# Share of the best mean shape that the worst cells may cost.
MEAN_LOSS = 0.1
# A result that is better by less than this in every figure is not worth moving a vertex for.
LEAST_GAIN = 1e-3
# Gain in the smallest scaled Jacobian for which the mean shape may get worse than it was.
LEAST_TRADE = 1e-2
# Sweeps without any progress after which untangling gives up.
UNTANGLE_PATIENCE = 400
# Sweeps of the logarithmic mean that makes the local size smooth.
SIZE_RINGS = 3


@dataclass
class Figures:
    """The four figures that a result must not lower, and two more.

    `free_jacobian` is the smallest scaled Jacobian of the corners that can change, 0 where one of
    them is not positive.
    """

    min_angle: float
    max_angle: float
    scaled_jacobian: float
    shape: float
    free_jacobian: float
    n_invalid: int

    def no_worse(self, other: Figures) -> bool:
        """Whether none of the four figures is worse than the other's."""
        return self.worst_no_worse(other) and self.shape >= other.shape

    def worst_no_worse(self, other: Figures) -> bool:
        """Whether the worst cells are no worse than the other's."""
        return (
            self.n_invalid <= other.n_invalid
            and self.min_angle >= other.min_angle
            and self.max_angle <= other.max_angle
            and self.scaled_jacobian >= other.scaled_jacobian
        )

    def better(self, other: Figures) -> bool:
        """Whether the worst corner is better, or about as good with a better mean."""
        gain = self.free_jacobian - other.free_jacobian
        return gain > LEAST_GAIN or (gain > -LEAST_GAIN and self.shape > other.shape)

    def gain(self, other: Figures) -> float:
        """Largest gain over the other in any figure; angles count in radians."""
        return max(
            math.radians(self.min_angle - other.min_angle),
            math.radians(other.max_angle - self.max_angle),
            self.scaled_jacobian - other.scaled_jacobian,
            self.free_jacobian - other.free_jacobian,
            self.shape - other.shape,
        )


# Called every round with the quality, and the length and share of each vertex's last move.
Note: TypeAlias = Callable[[Quality, FloatArray, FloatArray], None]


@dataclass
class Progress:
    """Options of the optimiser, what it has done so far, and its clock."""

    worst: bool
    target_quality: float | None
    time_limit: float | None
    max_sweeps: int
    mean_loss: float
    note: Note
    sweeps: int = 0
    parts: list[str] = field(default_factory=list)
    started: float = field(default_factory=time.perf_counter)
    limit: str = ""

    def spent(self) -> bool:
        """Whether a limit that the caller set is reached."""
        if self.sweeps >= self.max_sweeps:
            self.limit = f"max_sweeps={self.max_sweeps} was reached"
        elif self.time_limit is not None and time.perf_counter() - self.started >= self.time_limit:
            self.limit = f"the time limit of {self.time_limit:g} s was reached"
        return bool(self.limit)

    def next_round(self) -> int:
        """Sweeps of the next round."""
        return min(ROUND, self.max_sweeps - self.sweeps)

    def verdict(self) -> str:
        """Say in words what was done and what limits it."""
        return "; ".join([*self.parts, *([self.limit] if self.limit else [])])


class Blocks:
    """The movable vertices of a mesh in blocks of lanes, and the sweeps over them."""

    def __init__(self, mesh: Mesh, schedule: Stars) -> None:
        from qsmooth.kernels.blocks import build_blocks

        self.mesh = mesh
        self.cells = mesh.cell_offsets, mesh.cell_vertices
        self.movable = np.zeros(mesh.n_vertices, np.bool_)
        self.movable[schedule.vertices] = True
        blocks = build_blocks(schedule)
        vertices = blocks.vertices
        self._arguments = blocks, (0, blocks.colour_blocks.size - 1)
        self._vertices, self._rings = vertices, (mesh.ring_offsets, mesh.ring_vertices)
        self.moves, self._shortest = np.zeros(vertices.size), np.empty(vertices.size)
        self._badness, self._shape = np.empty(mesh.n_cells), np.empty(mesh.n_cells)

    def newton(
        self, xy: FloatArray, mean_weight: float, limit: float, squarings: int, progress: Progress
    ) -> None:
        """Sweep a round downhill on mean_weight · f + (g / limit)^(2^squarings)."""
        from qsmooth.kernels.newton_sweep import Wall, newton_sweep

        wall = Wall(float(mean_weight), float(limit), squarings)
        for _ in range(progress.next_round()):
            newton_sweep(xy, *self._arguments, RELAXATION, wall, self.moves)
            progress.sweeps += 1

    def report(self, xy: FloatArray, now: Quality, progress: Progress) -> None:
        """Tell the caller of the last sweep."""
        from qsmooth.kernels.untangle_sweep import shortest_edges

        shortest_edges(xy, *self._rings, self._vertices, self._shortest)
        shares = np.divide(
            self.moves, self._shortest, out=np.zeros_like(self.moves), where=self.moves > 0.0
        )
        progress.note(now, self.moves, shares)

    def untangle(self, xy: FloatArray, sizes: FloatArray, epsilon: float) -> None:
        """Sweep once downhill on the regularised energy."""
        from qsmooth.kernels.untangle_sweep import untangle_sweep

        untangle_sweep(xy, *self._arguments, RELAXATION, sizes, epsilon, self.moves)

    def energy(self, xy: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Largest badness and summed shape energy of each cell."""
        from qsmooth.kernels.newton_sweep import cell_energy

        cell_energy(xy, *self.cells, self.movable, self._badness, self._shape)
        return self._badness, self._shape


def optimize(mesh: Mesh, schedule: Stars, progress: Progress) -> FloatArray:
    """Improve a mesh by all stages; return the best coordinates that were seen, (n, 2).

    Parameters
    ----------
    mesh
        The mesh; its own coordinates are what the result must not be worse than.
    schedule
        The movable vertices.
    progress
        Options, callback and clock; sweeps and what was done are noted there.
    """
    blocks, xy = Blocks(mesh, schedule), mesh.xy.copy()
    best = _Best(blocks, progress)
    if best.given.n_invalid:
        _untangle(blocks, xy, progress)
        best.restart(xy, mean_counts=False)
    _mean_stage(blocks, xy, schedule, best, progress)
    if progress.worst and not best.reached_target():
        _worst_stage(blocks, xy, best, progress)
    progress.parts += best.settle()
    return best.xy


def untangle(mesh: Mesh, schedule: Stars, progress: Progress) -> FloatArray:
    """Make a mesh valid, or as nearly so as was seen; return its coordinates, (n, 2)."""
    xy = mesh.xy.copy()
    if _n_invalid(mesh, xy):
        _untangle(Blocks(mesh, schedule), xy, progress)
    else:
        progress.parts.append("the mesh is valid: there was nothing to untangle")
    return xy


class _Best:
    """The best coordinates so far, by the promise that no figure gets worse than it was."""

    def __init__(self, blocks: Blocks, progress: Progress) -> None:
        self.blocks, self.progress = blocks, progress
        self.updates = 0
        self.restart(blocks.mesh.xy)

    def restart(self, xy: FloatArray, *, mean_counts: bool = True) -> None:
        """Take these coordinates as the ones that the result must not be worse than.

        The mean shape of a mesh that has just been untangled is no one's: it does not count.
        """
        self._given_xy, self.xy = xy.copy(), xy.copy()
        self.given = self.figures = self._measure(xy, Quality(self.blocks.mesh._at_xy(xy)))
        self.best_shape = self.given.shape if self.given.n_invalid == 0 else 0.0
        if not mean_counts:
            self.given = replace(self.given, shape=0.0)
        # The worst cells first: what to take where nothing keeps all four figures.
        self._trade: tuple[FloatArray, Figures] | None = None
        # The best that was seen and cost too much.
        self._too_dear = 0.0

    def offer(self, xy: FloatArray) -> Figures:
        """Measure coordinates, and keep them if they are the best."""
        quality = Quality(self.blocks.mesh._at_xy(xy))
        now = self._measure(xy, quality)
        self.blocks.report(xy, quality, self.progress)
        self.best_shape = max(self.best_shape, now.shape)
        affordable = now.shape >= self.floor()
        if now.n_invalid < self.figures.n_invalid or (
            affordable and now.no_worse(self.given) and now.better(self.figures)
        ):
            self.updates += now.free_jacobian > self.figures.free_jacobian + LEAST_GAIN
            self.xy[:], self.figures = xy, now
        elif affordable and now.n_invalid == 0 and now.worst_no_worse(self.given):
            then = self.given if self._trade is None else self._trade[1]
            if self._trade is None or now.better(then):
                self.updates += now.free_jacobian > then.free_jacobian + LEAST_GAIN
                self._trade = xy.copy(), now
        elif now.n_invalid == 0 and now.worst_no_worse(self.given):
            self._too_dear = max(self._too_dear, now.free_jacobian)
        return now

    def floor(self) -> float:
        """Mean shape that the worst cells may not cost more than."""
        return (1.0 - self.progress.mean_loss) * self.best_shape

    def reached_target(self) -> bool:
        """Whether the smallest scaled Jacobian is what the caller asked for."""
        target = self.progress.target_quality
        return target is not None and self.figures.free_jacobian >= target

    def settle(self) -> list[str]:
        """Settle on the result, and say what it had to give up."""
        if self.figures.gain(self.given) >= LEAST_GAIN:
            return []
        trade = self._trade
        if trade and trade[1].free_jacobian > self.given.free_jacobian + LEAST_TRADE:
            self.xy, self.figures = trade
            return [
                "the worst cells went first, as not all figures could be had: mean shape "
                f"{self.given.shape:.3f} -> {self.figures.shape:.3f}"
            ]
        self.xy, self.figures = self._given_xy, self.given
        if self._too_dear > self.given.free_jacobian + LEAST_TRADE:
            return [
                f"the worst cells could be better (smallest scaled Jacobian {self._too_dear:.2f}), "
                "but at a cost to the mean shape that "
                f"mean_loss={self.progress.mean_loss:g} forbids"
            ]
        return ["nothing more was to gain"]

    def _measure(self, xy: FloatArray, quality: Quality) -> Figures:
        smallest, largest = quality.extreme_angles
        return Figures(
            min_angle=smallest,
            max_angle=largest,
            scaled_jacobian=float(quality.scaled_jacobian.min()),
            shape=float(quality.shape.mean()),
            free_jacobian=1.0 / float(self.blocks.energy(xy)[0].max()),
            n_invalid=quality.n_invalid,
        )


def _untangle(blocks: Blocks, xy: FloatArray, progress: Progress) -> None:
    """Sweep until every cell is valid; else leave the coordinates with the fewest invalid cells."""
    from qsmooth.kernels.untangle_sweep import smallest_determinant

    mesh = blocks.mesh
    sizes = _local_sizes(mesh)
    smallest = np.empty(mesh.n_cells)
    best_count, best_xy = _n_invalid(mesh, xy), xy.copy()
    given = best_count
    n_hopeless = int(_hopeless(blocks, xy).sum())
    floor, least, patience, first = 1e-4, -np.inf, UNTANGLE_PATIENCE, progress.sweeps
    while best_count > n_hopeless and not progress.spent():
        smallest_determinant(xy, *blocks.cells, sizes, smallest)
        worst = float(smallest.min())
        if worst > least + 1e-3 * abs(least):
            least, patience = worst, UNTANGLE_PATIENCE
        elif patience == 0 and floor > 1e-9:  # a sharper wall, once the soft one gains no more
            floor, least, patience = 0.01 * floor, worst, UNTANGLE_PATIENCE
        elif patience == 0:
            break
        patience -= 1
        epsilon = float(np.sqrt(floor + 0.04 * min(0.0, worst) ** 2))
        blocks.untangle(xy, sizes, epsilon)
        progress.sweeps += 1
        if progress.sweeps % ROUND == 0:
            blocks.report(xy, Quality(mesh._at_xy(xy)), progress)
        if worst > 0.0 or progress.sweeps % ROUND == 0 or (smallest <= 0.0).sum() < best_count:
            count = _n_invalid(mesh, xy)
            if count < best_count:
                best_count, best_xy[:] = count, xy
    xy[:] = best_xy
    sweeps = progress.sweeps - first
    if best_count == 0:
        progress.parts.append(f"untangled {plural(given, 'cell')} in {plural(sweeps, 'sweep')}")
    else:
        progress.parts.append(_what_stays_invalid(blocks, xy, best_count, given))


def _mean_stage(
    blocks: Blocks, xy: FloatArray, schedule: Stars, best: _Best, progress: Progress
) -> None:
    """Sweep downhill on the mean shape until it has settled.

    Sweeps carry a change from neighbour to neighbour; where a whole region has to move they creep.
    Newton steps on the whole mesh then take over, as long as each of them pays.
    """
    settled = MEAN_GAIN if progress.worst else SETTLED
    first, energy, steps, rounds = progress.sweeps, np.inf, 0, 0
    best_shape, since = 0.0, 0
    while not progress.spent() and not best.reached_target():
        blocks.newton(xy, 1.0, np.inf, 1, progress)
        rounds += 1
        before, energy = energy, _total(blocks.energy(xy)[1])
        shape = best.offer(xy).shape
        # The energy counts bad cells for more than the mean of the shapes does: where the one
        # falls at the other's cost there is no more to gain here.
        best_shape, since = max(best_shape, shape), 0 if shape > best_shape else since + 1
        if energy >= before * (1.0 - settled) or since >= MEAN_ROUNDS:
            break
        if rounds % MEAN_ROUNDS == 0:
            gained = 0
            if best.figures.n_invalid == 0 and energy < before * (1.0 - CREEPING):
                gained = _global_steps(xy, schedule, best, progress)
                steps += gained
                energy = _total(blocks.energy(xy)[1])
            if progress.worst and not gained:
                break
    progress.parts.append(
        f"improved the mean shape in {plural(progress.sweeps - first, 'sweep')}"
        + (f" and {plural(steps, 'Newton step')} on the whole mesh" if steps else "")
    )


def _global_steps(xy: FloatArray, schedule: Stars, best: _Best, progress: Progress) -> int:
    """Take Newton steps on all vertices at once while each pays; return their count."""
    from qsmooth.newton import GlobalNewton

    solver = GlobalNewton(best.blocks.mesh, schedule)
    trial, shape = xy.copy(), 0.0
    for count in range(GLOBAL_STEPS):
        if progress.spent():
            return count
        gain = solver.step(trial)
        # The sum of f counts bad cells for more than the mean of the shapes 1 / f does: a step that
        # serves the first at the second's cost does not pay.
        now = best.offer(trial) if gain else best.figures
        if gain == 0.0 or now.shape < max(shape, best.best_shape - LEAST_GAIN):
            return count
        xy[:], shape = trial, now.shape
        if gain < GLOBAL_GAIN:
            return count + 1
    return GLOBAL_STEPS


def _total(energy: FloatArray) -> float:
    return float(energy[np.isfinite(energy)].sum())


def _worst_stage(blocks: Blocks, xy: FloatArray, best: _Best, progress: Progress) -> None:
    """Push the worst corners back with a wall that gets steeper, as long as the mean affords it."""
    first, weight = progress.sweeps, 1.0
    for squarings, share in WALLS:
        patience, updates = WALL_PATIENCE, best.updates
        while patience and not progress.spent() and not best.reached_target():
            worst = _largest(blocks.energy(xy)[0])
            blocks.newton(xy, weight, share * worst, squarings, progress)
            now = best.offer(xy)
            # Where the mean can't afford the wall, it gets a louder voice.
            weight = 2.0 * weight if now.shape < best.floor() else max(1.0, 0.5 * weight)
            patience = WALL_PATIENCE if best.updates > updates else patience - 1
            updates = best.updates
    progress.parts.append(f"then the worst cells in {plural(progress.sweeps - first, 'sweep')}")


def _largest(badness: FloatArray) -> float:
    return float(badness[np.isfinite(badness)].max(initial=1.0))


def _n_invalid(mesh: Mesh, xy: FloatArray) -> int:
    return Quality(mesh._at_xy(xy)).n_invalid


def _local_sizes(mesh: Mesh) -> FloatArray:
    """Mean squared edge length at each vertex, (n,), made smooth over a few rings."""
    from qsmooth.kernels.untangle_sweep import mean_squared_edge, spread_logarithms

    sizes, spread = np.empty(mesh.n_vertices), np.empty(mesh.n_vertices)
    rings = mesh.ring_offsets, mesh.ring_vertices
    mean_squared_edge(mesh.xy, *rings, sizes)
    with np.errstate(divide="ignore"):
        logarithms = np.log(sizes)
    for _ in range(SIZE_RINGS):
        spread_logarithms(*rings, logarithms, spread)
        logarithms, spread = spread, logarithms
    finite = logarithms[np.isfinite(logarithms)]
    logarithms[~np.isfinite(logarithms)] = finite.mean() if finite.size else 0.0
    return np.exp(logarithms)


def _what_stays_invalid(blocks: Blocks, xy: FloatArray, count: int, given: int) -> str:
    """Say which cells stay invalid, and for which of them that is proven."""
    invalid = Quality(blocks.mesh._at_xy(xy)).validity != Validity.VALID
    hopeless = _hopeless(blocks, xy)
    first = int(np.argmax(invalid))
    text = f"{count} of {given} invalid cells stay invalid, the first is cell {first}"
    proven = int(hopeless.sum())
    if proven:
        text += (
            f"; for {proven} of them nothing can help, as the vertices of a corner that is not "
            f"convex are all fixed (the first is cell {int(np.argmax(hopeless))})"
        )
    if proven < count:
        text += f"; for {count - proven} no way was found, which does not prove that there is none"
    return text


def _hopeless(blocks: Blocks, xy: FloatArray) -> BoolArray:
    """Mark the cells that no move can make valid, (n_cells,)."""
    from qsmooth.kernels.untangle_sweep import hopeless_cells

    hopeless = np.empty(blocks.mesh.n_cells, np.bool_)
    hopeless_cells(xy, *blocks.cells, blocks.movable, hopeless)
    return hopeless
