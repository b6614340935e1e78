"""Methods that break a promise are caught, each by the check that is meant for it."""

import functools
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
import pytest

import promises
from meshes import grid, random_mesh, renumber, tangle
from qsmooth import Mesh, Stop, quality
from qsmooth.methods.driver import Sweep, SweepingMethod
from qsmooth.options import option
from qsmooth.outcome import Aim, Held, Sizes, Target, Trade

pytestmark = pytest.mark.nojit


@dataclass(frozen=True, kw_only=True)
class Honest(SweepingMethod):
    """Moves every vertex by nothing; those below change one thing of it."""

    name = "honest"
    title = "Honest"
    purpose = "To be changed."

    guard: Literal["quality", "clearance"] = option("quality", help="Kept as nothing moves.")

    def start(self, setting):
        setting.stars.vertices.flags.writeable = False
        n_sweeps = iter(range(10**6))

        def move(xy, colours, moves):
            first, last = setting.stars.colour_offsets[[colours[0], colours[1]]]
            chosen = setting.stars.vertices[first:last].astype(int)
            before = xy[chosen]
            self.shift(xy, chosen, setting, number[0], colours)
            moves.lengths[first:last] = np.hypot(*(xy[chosen] - before).T)
            moves.shares[first:last] = moves.lengths[first:last]

        number = [0]

        def count(xy):
            number[0] = next(n_sweeps)

        return Sweep(setting.n_colours, move, count)

    def shift(self, xy, chosen, setting, number, colours):
        """Move the chosen vertices in place."""


def honest_mesh(kind="quads", seed=3):
    return random_mesh(kind, 4, seed=seed, amount=0.5).mesh


def tangled_mesh():
    made = random_mesh("quads", 4, seed=3)
    return made.mesh.with_points(tangle(made.points, made.cells, np.random.default_rng(1), 0.8))


class Inverts(Honest):
    def shift(self, xy, chosen, setting, number, colours):
        xy[chosen] += 9.0


class InvertsAndGoesBack(Honest):
    def shift(self, xy, chosen, setting, number, colours):
        xy[chosen] += 9.0 if number % 2 == 0 else -9.0


class LowersTheWorstCell(Honest):
    def shift(self, xy, chosen, setting, number, colours):
        xy[chosen] += (0.3, -0.3)


class MovesTheBoundary(Honest):
    def shift(self, xy, chosen, setting, number, colours):
        xy[0] -= 1e-9


class MakesMoreInvalid(Honest):
    guarded, untangles = False, True

    def shift(self, xy, chosen, setting, number, colours):
        xy[chosen] = 0.0


class SweepsOn(Honest):
    def stages(self):
        return [(Aim.ALL_CELLS, self.max_sweeps + 1)]


class CallsBackTwice(Honest):
    def run(self, mesh, chosen=""):
        result = super().run(mesh)
        self.callback(result.history[-1])
        return result


class Untangles(Honest):
    """Says that it untangles, and moves all vertices by a little."""

    untangles = True

    def shift(self, xy, chosen, setting, number, colours):
        xy[chosen] += (0.1, 0.05)


class ExcusesNothing(Honest):
    """Tells of a trade where nothing fell."""

    untangles = True

    def run(self, mesh, chosen=""):
        result = super().run(mesh)
        trade = Trade(figure="mean_shape", before=1.0, after=0.9)
        return replace(result, outcome=replace(result.outcome, trades=(trade,)))


def telling(**lies):
    """A method whose outcome lies."""

    class Liar(Honest):
        def run(self, mesh, chosen=""):
            result = super().run(mesh)
            return replace(result, outcome=replace(result.outcome, **lies))

    return Liar


class ForgetsSweeps(Honest):
    """Tells of sweeps that no stage made, and so more than the history has."""

    def run(self, mesh, chosen=""):
        result = super().run(mesh)
        stages = [replace(s, sweeps=s.sweeps + self.max_sweeps) for s in result.outcome.stages]
        return replace(result, outcome=replace(result.outcome, stages=tuple(stages)))


class GainsWhatNobodyCanRead(Honest):
    def run(self, mesh, chosen=""):
        result = super().run(mesh)
        stages = [
            replace(s, gain={"n_invalid": 0, "min_angle": {1, 2}}) for s in result.outcome.stages
        ]
        return replace(result, outcome=replace(result.outcome, stages=tuple(stages)))


class MeasuresAnotherMesh(Honest):
    def run(self, mesh, chosen=""):
        result = super().run(mesh)
        return replace(result, quality_after=quality(Mesh(*grid(3, 3))))


class RefusesWithoutAWord(Honest):
    def run(self, mesh, chosen=""):
        raise ValueError("not today")


class TakesWhatItRefuses(Honest):
    def why_not(self, mesh):
        return "it can do nothing with any mesh"

    def run(self, mesh, chosen=""):
        return Honest(callback=self.callback).run(mesh)


class ChangesItsInput(Honest):
    def run(self, mesh, chosen=""):
        result = super().run(mesh)
        mesh._points.flags.writeable = True
        mesh._points[0] += 1.0
        return result


ONE_RUN = {
    "inverts": (Inverts(), "lost a corner"),
    "inverts and goes back": (InvertsAndGoesBack(max_sweeps=2, rtol=0.0), "invalid on the way"),
    "lowers the worst cell": (LowersTheWorstCell(max_sweeps=1), "a worse cell"),
    "moves the boundary": (MovesTheBoundary(guard="clearance"), "moved what is fixed"),
    "sweeps on": (SweepsOn(max_sweeps=3, rtol=0.0), "too many sweeps"),
    "calls back twice": (CallsBackTwice(), "the callback heard something else"),
    "excuses nothing": (ExcusesNothing(), "a trade that was none"),
    "unchanged is a lie": (telling(unchanged=False)(), "says that it is unchanged"),
    "stop is a lie": (telling(stop=Stop.NOTHING_MOVES)(), "whether a vertex can move"),
    "valid is a lie": (telling(stop=Stop.TIME_LIMIT)(), "stopped by time_limit"),
    "forgets sweeps": (ForgetsSweeps(), "too many sweeps"),
    "gains what nobody can read": (GainsWhatNobodyCanRead(), "not JSON serializable"),
    "measures another mesh": (MeasuresAnotherMesh(), "summary of another mesh"),
    "refuses": (RefusesWithoutAWord(), "refuses other meshes than it says"),
    "takes what it refuses": (TakesWhatItRefuses(), "refuses other meshes than it says"),
    "changes its input": (ChangesItsInput(), "changed its input"),
}


@pytest.mark.parametrize(("method", "message"), ONE_RUN.values(), ids=ONE_RUN)
def test_a_broken_promise_is_caught(method, message):
    mesh = honest_mesh()
    assert promises.corner_signs(mesh).min() == 1
    with pytest.raises((AssertionError, TypeError), match=message):
        promises.check(mesh, method)


@pytest.mark.parametrize(
    ("method", "message"),
    [
        (Inverts(), "lost a corner"),
        (MakesMoreInvalid(), "more invalid cells"),
        (telling(invalid=None)(), "invalid cells"),
    ],
)
def test_a_promise_broken_on_a_tangled_mesh_is_caught(method, message):
    with pytest.raises(AssertionError, match=message):
        promises.check(tangled_mesh(), method)


def with_a_bad_corner():
    """Squares of which a fixed one is bad: it sets the three figures of the worst cell."""
    points, cells = grid(4, 4)
    points[0] = 0.4, 0.4
    return Mesh(points, cells, fixed=[6])


@dataclass(frozen=True, kw_only=True)
class Holds(Untangles):
    hold: tuple = option((), help="What is held.")
    mean_loss: float = option(0.1, within="[0, 1)", help="May be lost.")


class HoldsBadly(Holds):
    def shift(self, xy, chosen, setting, number, colours):
        xy[chosen] += (0.35, 0.15)


def judged(outcome, kind="squares"):
    """Give an outcome what the optimiser's has."""
    sizes = Sizes(
        area_low=1.0, area_median=1.0, area_high=1.0, min_edge_before=1.0, min_edge_after=1.0,
        layers=0.0,
    )  # fmt: skip
    return replace(outcome, target=Target(kind=kind, before=1.0, after=1.0), sizes=sizes)


@pytest.mark.parametrize(
    ("mesh", "method", "message"),
    [
        (honest_mesh(), Untangles, "angle|a worse cell"),
        (with_a_bad_corner(), Untangles, "lost of the mean"),
        (with_a_bad_corner(), functools.partial(Holds, hold=("shape",), mean_loss=0.9), ""),
        (
            with_a_bad_corner(),
            functools.partial(HoldsBadly, hold=("min_edge",)),
            "a worse min_edge",
        ),
    ],
)
def test_what_is_held_is_measured(mesh, method, message):
    seen = promises.run(mesh, method(guard="clearance", max_sweeps=1))
    if message:
        with pytest.raises(AssertionError, match=message):
            promises.figures_get_no_worse(seen)
    else:
        promises.figures_get_no_worse(seen)


@pytest.mark.parametrize(
    ("check", "message"),
    [
        (promises.figures_get_no_worse, "tells another mean"),
        (promises.trades_are_told, "a trade of min_edge untold|a trade of mean_shape untold"),
        (promises.sizes_are_told, "other areas"),
    ],
)
def test_what_is_told_is_measured(check, message):
    seen = promises.run(with_a_bad_corner(), HoldsBadly(guard="clearance", max_sweeps=1))
    outcome = judged(seen.result.outcome, "ideal")
    seen = replace(seen, result=replace(seen.result, outcome=outcome))
    with pytest.raises(AssertionError, match=message):
        check(seen)


@pytest.mark.parametrize(
    ("lie", "message"),
    [
        ({"figure": "shape"}, "a figure that is not held"),
        ({"cell": 0}, "a cell that nothing changes"),
        ({}, ""),
        ({"value": 120.0}, "held at what is worse"),
    ],
)
def test_what_is_said_to_hold_back_is_looked_at(lie, message):
    mesh = Mesh(*grid(4, 4), fixed=[6])
    seen = promises.run(mesh, Untangles(guard="clearance", max_sweeps=0))
    held = replace(Held(figure="max_angle", value=90.0, cell=5, vertices=1), **lie)
    outcome = replace(seen.result.outcome, held=(held,), stop=Stop.SETTLED)
    seen = replace(seen, result=replace(seen.result, outcome=outcome))
    if message:
        with pytest.raises(AssertionError, match=message):
            promises.what_holds_back_is_told(seen)
    else:
        promises.what_holds_back_is_told(seen)


def test_an_honest_method_passes():
    promises.check(honest_mesh(), Honest())
    promises.check(honest_mesh("mixed"), Honest(split_quads=True))
    promises.check(tangled_mesh(), Honest())
    promises.check(Mesh(*grid(1, 3)), Honest())
    promises.bits_are_the_same(honest_mesh(), Honest())
    made = random_mesh("triangles", 4, seed=2)
    promises.follows_the_input(made, Honest(), turn=1.0, scale=3.0, mirror=True)
    promises.scales_by_bits(made, Honest(), 5)
    promises.numbering_breaks_nothing(
        made, *renumber(made.points, made.cells, np.random.default_rng(0)), Honest()
    )


# ------------------------------------------------------------------------------- several runs


class NeverTheSame(Honest):
    guarded, calls = False, iter(range(10**6))

    def shift(self, xy, chosen, setting, number, colours):
        xy[chosen] += 1e-3 * next(self.calls)


class CountsThreads(Honest):
    guarded = False

    def run(self, mesh, chosen=""):
        object.__setattr__(self, "_n", self.threads)
        return super().run(mesh)

    def shift(self, xy, chosen, setting, number, colours):
        xy[chosen] += 1e-3 * self._n


class SeesTheRange(Honest):
    guarded = False

    def shift(self, xy, chosen, setting, number, colours):
        xy[chosen] += 1e-3 * (colours[1] - colours[0])


class SweepsByItself(Honest):
    """Tells of sweeps that no engine ran."""

    def run(self, mesh, chosen=""):
        result = super().run(mesh)
        stages = [replace(s, sweeps=30) for s in result.outcome.stages]
        return replace(result, outcome=replace(result.outcome, stages=tuple(stages)))


@pytest.mark.parametrize(
    ("method", "message"),
    [
        (NeverTheSame(max_sweeps=2), "another result the second time"),
        (CountsThreads(max_sweeps=2), "depends on the threads"),
        (SeesTheRange(max_sweeps=2), "depends on what runs the colours"),
        (SweepsByItself(max_sweeps=30), "sweeps that no engine runs"),
    ],
)
def test_bits_that_are_not_the_same_are_caught(method, message):
    with pytest.raises(AssertionError, match=message):
        promises.bits_are_the_same(honest_mesh(), method)


class GoesEast(Honest):
    guarded = False

    def shift(self, xy, chosen, setting, number, colours):
        xy[chosen] += (0.01, 0.0)


class RoundsOff(Honest):
    guarded = False

    def shift(self, xy, chosen, setting, number, colours):
        xy[chosen] = np.round(xy[chosen], 6)


class CollapsesByNumber(Honest):
    """Flattens what is around vertices with an even number."""

    guarded = False

    def shift(self, xy, chosen, setting, number, colours):
        even = chosen[chosen < 12]
        xy[even] += 0.3 * (xy[0] - xy[even])


def test_symmetries_that_are_broken_are_caught():
    made = random_mesh("triangles", 4, seed=2)
    for motion in ({"turn": 1.0}, {"scale": 3.0}, {"mirror": True}):
        with pytest.raises(AssertionError):
            promises.follows_the_input(made, GoesEast(max_sweeps=1), **motion)
    with pytest.raises(AssertionError):
        promises.follows_the_input(made, RoundsOff(max_sweeps=1), shift=(0.1234567891, 0.0))
    with pytest.raises(AssertionError, match="depends on the unit"):
        promises.scales_by_bits(made, RoundsOff(max_sweeps=1), 3)
    renumbered = renumber(made.points, made.cells, np.random.default_rng(0))
    with pytest.raises(AssertionError, match="another mean shape"):
        promises.numbering_breaks_nothing(
            made, *renumbered, CollapsesByNumber(guard="clearance", max_sweeps=4)
        )
