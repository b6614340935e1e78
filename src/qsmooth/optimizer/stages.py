"""The stages of the optimiser on a valid mesh: the mean shape first, then the worst cells."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import numpy as np

from qsmooth._types import FloatArray
from qsmooth.kernels.compiling import clock
from qsmooth.optimizer.best import Best
from qsmooth.optimizer.caps import HOLDABLE
from qsmooth.optimizer.global_newton import GlobalNewton
from qsmooth.optimizer.lanes import Lanes
from qsmooth.optimizer.progress import Progress

# An energy that fell by less than this fraction in a round has settled.
SETTLED = 1e-5
# Before the worst cells are seen to, the mean gets this many rounds, or settles to this.
MEAN_ROUNDS = 12
MEAN_GAIN = 1e-4
# After the first rounds a Newton step on the whole mesh is tried while a round gains more than
# `MEAN_GAIN`: the larger the region that has to move, the less do sweeps. Where a round with a step
# gains less than this the next steps are waited for longer and longer. One is tried in the end
# where no more than this has been gained at all.
FIRST_ROUNDS, CREEPING = 3, 5e-3
# Of such a step the energy may rise by this fraction, if a round of sweeps then brings it below
# what it was.
RISE = 0.5
# Where the mean shape has fallen below this fraction of its best the coordinates of that are gone
# back to.
NEARLY = 0.99
# The same where a sweep would gain this fraction of the energy if nothing were held.
KEPT_BACK = 2e-2
# The walls put up one after the other: power 2 ** squarings, and where each stands as a fraction of
# the worst corner's badness. At the last it stands so near the worst corner that all others can go
# back to where the mean shape is best.
WALLS = ((2, 0.7), (3, 0.8), (4, 0.85), (5, 0.9), (6, 0.9), (6, 0.95))
# After so many rounds in which the worst corner did not get better by this the next wall is put up;
# more rounds where there are layers, whose angles get better by and by.
WALL_PATIENCE, LAYER_PATIENCE, WALL_GAIN = 1, 2, 5e-4
# The same where sizes count: there nothing is extrapolated, and a round gains less.
SIZED_GAIN = 4e-4
# The last walls are put up once more with walls on the shapes that stand this much farther back.
LAST_WALLS, LOOSER = 3, 3.0
# Then these walls stand by the worst cell of so many rings, for so many rounds each; they may cost
# the mean this fraction; and no shape is to be worse than this multiple of the worst one.
EVEN_WALLS, EVEN_RINGS, EVEN_ROUNDS, EVEN_LOSS, EVEN_SLIM = 2, 10, 3, 5e-3, 0.85
# Rounds at most in which the mean gets back what the worst cells do not need, what a round must
# gain for another, and how much the mean counts beside the wall.
RELAX_ROUNDS, RELAX_GAIN, RELAX_WEIGHT = 12, 1e-4, 11.0
# Low angles and the worst shape keep this fraction of what they have. A round that would cost them
# more is taken back, and so often tried with the mean counting for less.
KEPT, RELAX_PATIENCE, RELAX_LESS = 0.97, 2, 0.2
# Where vertices slide a low wall, at a sine of one over this, then pushes back all high and low
# angles a little: its power 2 ** squarings, how much the mean counts beside it, rounds at most. A
# round that is no gain is taken back, and tried with the mean counting for more.
EASE_WALL, EASE_WEIGHT, EASE_ROUNDS, EASE_PATIENCE, EASE_MORE = (2, 1.2), 6.0, 6, 2, 4.0


def improve_mean(
    lanes: Lanes, xy: FloatArray, best: Best, progress: Progress, *, worst: bool
) -> None:
    """Sweep downhill on the mean shape until it has settled, in place.

    Sweeps carry a change from neighbour to neighbour; where a whole region has to move they creep.
    Newton steps on the whole mesh then take over, as long as each of them pays.

    Parameters
    ----------
    lanes, xy
        The sweeps, and the coordinates, (n, 2).
    best, progress
        Each round is offered to the one and counted by the other.
    worst
        Whether the worst cells are seen to afterwards: then the mean need not settle wholly.
    """
    from qsmooth.kernels.newton_sweep import Wall

    settled = MEAN_GAIN if worst else SETTLED
    no_wall, whole = Wall(1.0, np.inf, 1), _WholeMesh(lanes)
    energy, rounds = np.inf, 0
    start = lanes.total_energy(xy)
    best_shape, since, best_xy = 0.0, 0, xy.copy()
    creeping, stuck = False, False
    while not progress.spent() and not best.good_enough():
        stepped = (creeping or stuck) and whole.step(xy, progress)
        lanes.newton(xy, no_wall, progress, extrapolate=not stepped)
        rounds += 1
        before, energy = energy, lanes.total_energy(xy)
        gain = 1.0 - energy / before if before else 0.0
        if stepped and not whole.judge(xy, gain):
            energy = before
            continue
        shape = best.offer(xy, by_mean=not worst).shape
        # The energy counts bad cells for more than the mean of the shapes does: where the one
        # falls at the other's cost there is no more to gain here.
        if shape > best_shape:
            best_shape, since, best_xy[:] = shape, 0, xy
        else:
            since += 1
        creeping = rounds > FIRST_ROUNDS and gain > MEAN_GAIN
        over = gain <= settled or (worst and rounds >= MEAN_ROUNDS and gain <= CREEPING)
        if since >= MEAN_ROUNDS or (over and stuck):
            break
        if over:
            stuck = energy >= start * (1.0 - CREEPING) or lanes.kept_back(xy) > KEPT_BACK
            if not stuck:
                break
        else:
            stuck = False
    if best.last.shape < NEARLY * best_shape:
        xy[:] = best_xy


class _WholeMesh:
    """Newton steps on the whole mesh, set up when first wanted.

    Parameters
    ----------
    lanes
        What moves, and what is asked of it.
    """

    def __init__(self, lanes: Lanes) -> None:
        self._lanes, self._wait, self._waits = lanes, 0, 0
        self._seconds: float | None = None

    @cached_property
    def _newton(self) -> GlobalNewton:
        lanes = self._lanes
        targets = lanes.targets.corners, lanes.sizes, lanes.maps
        return GlobalNewton(lanes.topology, lanes.stars, *targets, lanes.caps, lanes.rails)

    def step(self, xy: FloatArray, progress: Progress) -> bool:
        """Take a step if it is time to, in place; say whether."""
        if self._wait:
            self._wait -= 1
            return False
        # The first one takes about as long as the rounds before it.
        expected = progress.seconds if self._seconds is None else self._seconds
        if not progress.watch.leaves_time_for(expected):
            return False
        self._before, started = xy.copy(), clock()
        taken = self._newton.step(xy, RISE) != 0.0
        self._seconds = clock() - started
        progress.steps += taken
        if not taken:
            self._put_off()
        return taken

    def judge(self, xy: FloatArray, gain: float) -> bool:
        """Say whether the last step and the sweeps since have gained anything; else go back."""
        if gain > CREEPING:
            self._waits = 0
        else:
            self._put_off()
        if gain <= 0.0:
            xy[:] = self._before
        return gain > 0.0

    def _put_off(self) -> None:
        self._wait = self._waits = 2 * self._waits + 1


def mend_worst(lanes: Lanes, xy: FloatArray, best: Best, progress: Progress) -> None:
    """Push the worst corners back with a wall that gets steeper, while the mean affords it.

    Where they gain no more the worst of each neighbourhood have their turn, and the worst shapes;
    then the mean gets back what none of these need.

    Parameters are those of `improve_mean`.
    """
    best.limit_sizes()
    start = best.mark()
    first = xy.copy()
    lanes.wall_off(xy)
    _push(lanes, xy, best, progress, WALLS)
    strict, walls = best.mark(), WALLS[-LAST_WALLS:]
    xy[:] = best.xy
    if best.forbidden is not None:
        # The walls on shapes cost the mean more than it affords: all once more, with these far off.
        walls, xy[:] = WALLS, first
        best.start_again(start)
    lanes.wall_off(xy, looser=LOOSER)
    _push(lanes, xy, best, progress, walls)
    if not best.pays_since(strict):
        best.back_to(strict)
    if best.good_enough() or lanes.targets.is_layer.any():
        return  # the angles of layers would go back to what their sizes ask for
    lanes.caps.hold(best.xy, HOLDABLE)
    low = KEPT * best.figures.low_angle
    xy[:] = best.xy
    _even_out(lanes, xy, best, progress, low)
    lanes.caps.hold(best.xy, HOLDABLE)
    xy[:] = best.xy
    _relax(lanes, xy, best, progress, low)
    if lanes.slides:
        lanes.caps.hold(best.xy, HOLDABLE)
        xy[:] = best.xy
        _ease(lanes, xy, best, progress)


def _push(
    lanes: Lanes, xy: FloatArray, best: Best, progress: Progress, walls: Sequence[tuple[int, float]]
) -> None:
    """Put these walls up one after the other."""
    from qsmooth.kernels.newton_sweep import Wall

    weight, seen = 1.0, best.figures.free_jacobian
    most = LAYER_PATIENCE if lanes.targets.is_layer.any() else WALL_PATIENCE
    least = SIZED_GAIN if lanes.sized else WALL_GAIN
    for squarings, share in walls:
        patience = most
        while patience and not (progress.spent() or best.good_enough() or best.at_limit()):
            worst = lanes.largest_badness(xy)
            wall = Wall(weight, share * worst, squarings)
            lanes.newton(xy, wall, progress, extrapolate=True)
            now = best.offer(xy)
            # Mean and sizes count for more where the wall has cost them more than is allowed.
            affordable = best.affords(now)
            weight = max(1.0, 0.5 * weight) if affordable else 2.0 * weight
            gains = affordable and now.free_jacobian > seen + least
            patience = most if gains else patience - 1
            seen = max(seen, now.free_jacobian) if affordable else seen


def _even_out(lanes: Lanes, xy: FloatArray, best: Best, progress: Progress, low: float) -> None:
    """Put walls up by the worst of each neighbourhood, and by the worst shape of all."""
    from qsmooth.kernels.newton_sweep import Wall

    lanes.wall_off(xy, most=EVEN_SLIM)
    weight, floor = 1.0, best.figures.shape * (1.0 - EVEN_LOSS)
    for squarings, share in [wall for wall in WALLS[-EVEN_WALLS:] for _ in range(EVEN_ROUNDS)]:
        if progress.spent():
            break
        lanes.measure_near(xy, EVEN_RINGS)
        lanes.newton(xy, Wall(weight, share, squarings), progress)
        best.offer_overall(xy, floor, low)
        if best.last.shape < floor:
            weight *= 4.0


def _relax(lanes: Lanes, xy: FloatArray, best: Best, progress: Progress, low: float) -> None:
    """Give the mean back what it can have without the worst cells getting worse again."""
    from qsmooth.kernels.newton_sweep import Wall

    shape, weight, patience = best.figures.shape, RELAX_WEIGHT, RELAX_PATIENCE
    low = max(low, KEPT * best.figures.low_angle)
    worst = KEPT * best.figures.least_shape
    for _ in range(RELAX_ROUNDS):
        if progress.spent() or not patience:
            break
        lanes.weigh_good(xy)
        # Walls where the worst corners are: by caps alone vertices would be stopped one by one.
        lanes.measure_near(xy, EVEN_RINGS)
        lanes.newton(xy, Wall(weight, 1.0, WALLS[-1][0]), progress)
        if best.offer_relaxed(xy, low, worst):
            before, shape = shape, best.last.shape
            if shape < before + RELAX_GAIN:
                break
        else:
            xy[:] = best.xy
            weight, patience = RELAX_LESS * weight, patience - 1


def _ease(lanes: Lanes, xy: FloatArray, best: Best, progress: Progress) -> None:
    """Push all high and low angles back a little, where that is worth what it costs the mean."""
    from qsmooth.kernels.newton_sweep import Wall

    (squarings, threshold), weight, patience = EASE_WALL, EASE_WEIGHT, EASE_PATIENCE
    floor, low = best.figures.shape * (1.0 - EVEN_LOSS), KEPT * best.figures.low_angle
    for _ in range(EASE_ROUNDS):
        if progress.spent() or not patience:
            break
        lanes.weigh_good(xy, 1)
        lanes.newton(xy, Wall(weight, threshold, squarings), progress)
        if not best.offer_eased(xy, floor, low):
            xy[:] = best.xy
            weight, patience = EASE_MORE * weight, patience - 1
