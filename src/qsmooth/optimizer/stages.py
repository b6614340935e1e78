"""The stages of the optimiser on a valid mesh: the mean shape first, then the worst cells."""

from __future__ import annotations

import numpy as np

from qsmooth._types import FloatArray
from qsmooth.kernels.stars import Stars
from qsmooth.optimizer.best import LEAST_GAIN, Best
from qsmooth.optimizer.lanes import HOLDABLE, Lanes
from qsmooth.optimizer.progress import Progress

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
# The walls put up one after the other: power 2 ** squarings, and where each stands as a fraction of
# the worst corner's badness. At the last it stands so near the worst corner that all others can go
# back to where the mean shape is best.
WALLS = ((2, 0.7), (3, 0.8), (4, 0.85), (5, 0.9), (6, 0.9), (6, 0.95))
# Rounds without a better result after which the next wall is put up.
WALL_PATIENCE = 2
# Rounds at most in which the mean gets back what the worst cells do not need, and what a round must
# gain for another.
RELAX_ROUNDS, RELAX_GAIN = 12, 1e-3


def improve_mean(
    lanes: Lanes, xy: FloatArray, stars: Stars, best: Best, progress: Progress, *, worst: bool
) -> None:
    """Sweep downhill on the mean shape until it has settled, in place.

    Sweeps carry a change from neighbour to neighbour; where a whole region has to move they creep.
    Newton steps on the whole mesh then take over, as long as each of them pays.

    Parameters
    ----------
    lanes, xy, stars
        The sweeps, the coordinates, (n, 2), and the movable vertices.
    best, progress
        Each round is offered to the one and counted by the other.
    worst
        Whether the worst cells are seen to afterwards: then the mean need not settle wholly.
    """
    from qsmooth.kernels.newton_sweep import Wall

    settled = MEAN_GAIN if worst else SETTLED
    no_wall = Wall(1.0, np.inf, 1)
    energy, rounds = np.inf, 0
    start = _total(lanes.energy(xy)[1])
    best_shape, since = 0.0, 0
    while not progress.spent() and not best.good_enough():
        lanes.newton(xy, no_wall, progress)
        rounds += 1
        before, energy = energy, _total(lanes.energy(xy)[1])
        shape = best.offer(xy).shape
        # The energy counts bad cells for more than the mean of the shapes does: where the one
        # falls at the other's cost there is no more to gain here.
        best_shape, since = max(best_shape, shape), 0 if shape > best_shape else since + 1
        if energy >= before * (1.0 - settled) or since >= MEAN_ROUNDS:
            if best.figures.n_invalid or energy < start * (1.0 - CREEPING):
                break
            # Sweeps gained nothing: vertices that are held by their neighbours can move together.
            _global_steps(lanes, xy, stars, best, progress)
            before, energy = energy, _total(lanes.energy(xy)[1])
            if energy >= before * (1.0 - CREEPING):
                break
            start = energy
        if rounds % MEAN_ROUNDS == 0:
            gained = 0
            if best.figures.n_invalid == 0 and energy < before * (1.0 - CREEPING):
                gained = _global_steps(lanes, xy, stars, best, progress)
                energy = _total(lanes.energy(xy)[1])
            if worst and not gained:
                break


def mend_worst(lanes: Lanes, xy: FloatArray, best: Best, progress: Progress) -> None:
    """Push the worst corners back with a wall that gets steeper, while the mean affords it.

    Parameters are those of `improve_mean`.
    """
    from qsmooth.kernels.newton_sweep import Wall

    lanes.wall_off(xy)
    best.limit_sizes()
    weight = 1.0
    for squarings, share in WALLS:
        patience, updates = WALL_PATIENCE, best.updates
        while patience and not progress.spent() and not best.good_enough():
            worst = _largest(lanes.energy(xy)[0])
            lanes.newton(xy, Wall(weight, share * worst, squarings), progress)
            now = best.offer(xy)
            # Mean and sizes count for more where the wall has cost them more than is allowed.
            weight = max(1.0, 0.5 * weight) if best.affords(now) else 2.0 * weight
            patience = WALL_PATIENCE if best.updates > updates else patience - 1
            updates = best.updates
    _relax(lanes, xy, best, progress)


def _relax(lanes: Lanes, xy: FloatArray, best: Best, progress: Progress) -> None:
    """Give the mean back what it can have without the worst cells getting worse again."""
    from qsmooth.kernels.newton_sweep import Wall

    if best.figures.n_invalid or best.good_enough() or lanes.targets.is_layer.any():
        return  # the angles of layers would go back to what their sizes ask for
    xy[:] = best.xy
    lanes.hold(xy, HOLDABLE)
    energy = _total(lanes.energy(xy)[1])
    for _ in range(RELAX_ROUNDS):
        if progress.spent():
            break
        lanes.newton(xy, Wall(1.0, np.inf, 1), progress)
        before, energy = energy, _total(lanes.energy(xy)[1])
        if not best.relaxed(xy) or energy >= before * (1.0 - RELAX_GAIN):
            break


def _global_steps(
    lanes: Lanes, xy: FloatArray, stars: Stars, best: Best, progress: Progress
) -> int:
    """Take Newton steps on all vertices at once while each pays; return their count."""
    from qsmooth.optimizer.global_newton import GlobalNewton

    solver = GlobalNewton(
        lanes.topology, stars, lanes.targets.corners, lanes.sizes, lanes.maps, lanes.forbidden
    )
    trial, shape, count = xy.copy(), 0.0, 0
    while count < GLOBAL_STEPS and not progress.spent():
        gain = solver.step(trial)
        # The sum of f counts bad cells for more than the mean of the shapes 1 / f does: a step that
        # serves the first at the second's cost does not pay.
        now = best.offer(trial) if gain else best.figures
        if gain == 0.0 or now.shape < max(shape, best.best_shape - LEAST_GAIN):
            break
        xy[:], shape = trial, now.shape
        count += 1
        if gain < GLOBAL_GAIN:
            break
    progress.steps += count
    return count


def _total(energy: FloatArray) -> float:
    return float(energy[np.isfinite(energy)].sum())


def _largest(badness: FloatArray) -> float:
    return float(badness[np.isfinite(badness)].max(initial=1.0))
