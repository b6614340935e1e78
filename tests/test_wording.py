"""Sentences that are made from outcomes: what they say, and of what they say nothing."""

import itertools
from dataclasses import replace

import pytest

from qsmooth import Outcome, Stop
from qsmooth.outcome import Aim, Cut, Forbidden, Held, Invalid, Sizes, Stage, Target, Trade
from qsmooth.wording import UNCHANGED, reason
from test_outcome import FULL, LIMITS

pytestmark = pytest.mark.nojit

SWEPT = Outcome(method="star", stop=Stop.SETTLED, stages=(Stage(aim=Aim.ALL_CELLS, sweeps=12),))
STAGED = Outcome(
    method="optimize",
    stop=Stop.SETTLED,
    untangles=True,
    stages=(
        Stage(aim=Aim.MEAN_SHAPE, sweeps=20, steps=1),
        Stage(aim=Aim.WORST_CELLS, sweeps=1),
    ),
)
UNTANGLED = Outcome(
    method="untangle",
    stop=Stop.VALID,
    untangles=True,
    stages=(Stage(aim=Aim.UNTANGLE, sweeps=3),),
    invalid=Invalid(before=4, after=0),
)


@pytest.mark.parametrize(
    ("outcome", "text"),
    [
        (SWEPT, "quality no longer improves"),
        (
            replace(SWEPT, stop=Stop.RESTS, stop_at=0.001),
            "every vertex rests: none moved by over 0.001 of its shortest edge",
        ),
        (
            replace(SWEPT, stop=Stop.MAX_SWEEPS, stop_at=12.0, largest_share=0.0314),
            "stopped after 12 sweeps, as max_sweeps says; vertices still moved by up to 3.1 % of "
            "their shortest edge",
        ),
        (
            replace(SWEPT, stop=Stop.MAX_SWEEPS, stages=(Stage(aim=Aim.ALL_CELLS, sweeps=1),)),
            "stopped after 1 sweep, as max_sweeps says",
        ),
        (replace(SWEPT, stop=Stop.MAX_SWEEPS, stages=()), "no sweep was asked for"),
        (
            replace(SWEPT, stop=Stop.TIME_LIMIT, stop_at=0.5),
            "the time limit of 0.5 s was reached",
        ),
        (
            replace(SWEPT, stop=Stop.NOTHING_MOVES, stages=(), unchanged=True),
            "no vertex can move: all are on the boundary, fixed or in no cell",
        ),
        (
            replace(SWEPT, stop=Stop.NOTHING_MOVES, stages=(), selected=True, unchanged=True),
            "no vertex can move: all selected are on the boundary or fixed",
        ),
        (replace(SWEPT, unchanged=True), UNCHANGED),
        (replace(STAGED, unchanged=True), UNCHANGED),
        (replace(SWEPT, stop=Stop.RESTS, stop_at=0.001, unchanged=True), UNCHANGED),
        (
            STAGED,
            "improved the mean shape in 20 sweeps and 1 Newton step on the whole mesh; "
            "then the worst cells in 1 sweep",
        ),
        (
            replace(STAGED, stop=Stop.STOP_QUALITY, stop_at=0.6, stages=STAGED.stages[:1]),
            "improved the mean shape in 20 sweeps and 1 Newton step on the whole mesh; "
            "the worst cell reached stop_quality=0.6",
        ),
        (
            replace(
                STAGED,
                stop=Stop.MAX_SWEEPS,
                stages=(STAGED.stages[0], Stage(aim=Aim.WORST_CELLS, sweeps=0)),
            ),
            "improved the mean shape in 20 sweeps and 1 Newton step on the whole mesh; "
            "stopped after 20 sweeps, as max_sweeps says",
        ),
        (UNTANGLED, "untangled 4 cells in 3 sweeps"),
        (
            replace(UNTANGLED, stages=(), invalid=None, unchanged=True),
            "the mesh is valid: there was nothing to untangle",
        ),
        (
            replace(SWEPT, guarded=False, invalid=Invalid(before=0, after=3, first=2)),
            "quality no longer improves; star is unguarded: it made 3 cells invalid",
        ),
        (
            replace(SWEPT, invalid=Invalid(before=5, after=1, first=2)),
            "quality no longer improves; the mesh was not valid (5 cells invalid) and star does "
            "not untangle: 1 cell invalid now",
        ),
        (
            replace(SWEPT, cut=Cut(quads=1, diagonal="first", broken=0)),
            "1 quad was smoothed as two triangles each, cut along the first diagonal, which broke "
            "none of them; quality no longer improves",
        ),
        (
            replace(SWEPT, method="aspect-ratio", chosen=", as it is so"),
            "auto chose aspect-ratio, as it is so; quality no longer improves",
        ),
    ],
)
def test_what_is_said(outcome, text):
    assert reason(outcome) == text


def test_what_was_given_up_and_what_was_not():
    gain = {"gained": "min_angle", "gained_before": 8.4, "gained_after": 40.3}
    aspect = Trade(figure="aspect_ratio", before=20.0, after=33.0, **gain)
    assert reason(replace(STAGED, trades=(aspect,))).endswith(
        "; largest aspect ratio 20 -> 33, for a smallest angle of 8.4° -> 40.3°; hold it with "
        "hold='aspect_ratio'"
    )
    edge = Trade(figure="min_edge", before=0.5, after=0.25, **gain)
    mean = Trade(figure="mean_shape", before=0.9, after=0.85, **gain)
    assert reason(replace(STAGED, trades=(aspect, edge, mean))).endswith(
        "; largest aspect ratio 20 -> 33, shortest edge 0.5 -> 0.25 and mean shape 0.900 -> 0.850, "
        "for a smallest angle of 8.4° -> 40.3°; hold them with hold='aspect_ratio,min_edge'"
    )
    assert reason(replace(STAGED, trades=(mean,))).endswith(
        "; mean shape 0.900 -> 0.850, for a smallest angle of 8.4° -> 40.3°"
    )
    for_nothing = Trade(figure="shape", before=0.2, after=0.1)
    assert reason(replace(STAGED, trades=(for_nothing,))).endswith(
        "; smallest shape 0.2 -> 0.1; hold it with hold='shape'"
    )
    forbidden = replace(
        STAGED, unchanged=True, forbidden=Forbidden(scaled_jacobian=0.4321, mean_loss=0.02)
    )
    assert (
        "the worst cells could be better (smallest scaled Jacobian 0.43), but at a cost to the "
        "mean shape that mean_loss=0.02 forbids" in reason(forbidden)
    )
    assert UNCHANGED not in reason(forbidden)
    assert UNCHANGED in reason(replace(STAGED, unchanged=True))


def test_where_what_is_held_kept_something_from_getting_better():
    angle = Held(figure="max_angle", value=129.66, cell=4711, vertices=12)
    ratio = Held(figure="aspect_ratio", value=19.93, cell=3, vertices=1)
    text = reason(replace(STAGED, held=(angle, ratio)))
    assert text.endswith(
        "; the largest angle, held at 129.7°, keeps 12 vertices from better places, as at cell "
        "4711; the largest aspect ratio, held at 19.9, keeps 1 vertex from a better place, as at "
        "cell 3"
    )
    unchanged = reason(replace(STAGED, unchanged=True, held=(angle,)))
    assert unchanged.startswith("the largest angle, held at 129.7°, keeps 12 vertices from")
    assert UNCHANGED not in unchanged


def test_what_became_of_sizes_and_of_the_target():
    sizes = Sizes(
        area_low=0.97, area_median=1.0, area_high=1.31, min_edge_before=0.159,
        min_edge_after=0.519, layers=0.12,
    )  # fmt: skip
    told = replace(STAGED, sizes=sizes)
    assert reason(told).endswith(
        "; cell areas x 0.97 to 1.31; shortest edge 0.159 -> 0.519; 12 % of the cells are layers "
        "and were kept"
    )
    assert "layers" not in reason(replace(told, sizes=replace(sizes, layers=0.0)))
    for layers, words in {
        0.001: "0.1 % of the cells",
        0.9297: "93 % of the cells",
        0.998: "over 99 % of the cells",
        1.0: "all cells",
    }.items():
        text = reason(replace(told, sizes=replace(sizes, layers=layers)))
        assert text.endswith(f"; {words} are layers and were kept")
    large = replace(sizes, area_low=1e-4, area_high=15115.8)
    assert "cell areas x 0.0001 to 1.5e+04;" in reason(replace(told, sizes=large))
    # Once is enough.
    trade = Trade(figure="min_edge", before=0.5, after=0.25)
    assert reason(replace(told, trades=(trade,))).count("shortest edge") == 1
    assert "cell areas" not in reason(replace(told, unchanged=True))
    assert "target" not in reason(replace(told, target=Target(kind="ideal", before=0.7, after=0.9)))
    for kind, words in {
        "squares": "ideal shapes beside layers and gradings as they are",
        "ratios": "rectangles",
        "initial": "the cells as they were, with right angles",
        "metric": "the metric",
    }.items():
        aimed = replace(told, target=Target(kind=kind, before=0.71, after=0.95))
        assert f"; mean quality towards {words} 0.710 -> 0.950; cell areas" in reason(aimed)
    both = Target(kind="metric", before=0.71, after=0.95, ideal_before=0.8, ideal_after=0.35)
    assert (
        "; mean quality towards the metric 0.710 -> 0.950, towards ideal shapes alone 0.800 -> "
        "0.350; cell areas"
    ) in reason(replace(told, target=both))


@pytest.mark.parametrize(
    ("invalid", "said", "unsaid"),
    [
        (
            Invalid(before=4, after=1, first=7, proven=1, first_proven=7),
            ["1 of 4 invalid cells stays invalid, the first is cell 7",
             "for 1 of them nothing can help", "(the first is cell 7)"],
            "no way was found",
        ),
        (
            Invalid(before=4, after=3, first=7, proven=1, first_proven=9),
            ["3 of 4 invalid cells stay invalid, the first is cell 7",
             "for 1 of them nothing can help", "(the first is cell 9)",
             "for 2 no way was found, which does not prove that there is none"],
            "untangled",
        ),
        (
            Invalid(before=1, after=1, first=0),
            ["1 of 1 invalid cell stays invalid, the first is cell 0", "for 1 no way was found"],
            "nothing can help",
        ),
    ],
)  # fmt: skip
def test_what_stays_invalid(invalid, said, unsaid):
    text = reason(replace(UNTANGLED, stop=Stop.STUCK, invalid=invalid))
    for words in said:
        assert words in text
    assert unsaid not in text


def test_how_near_the_angles_are_to_their_bounds():
    told = replace(STAGED, limits=LIMITS)
    assert "placement" not in reason(told, limits=False)
    text = reason(told).removeprefix(reason(told, limits=False) + "; ")
    smallest, largest = text[: text.index("; largest")], text[text.index("largest angle") :]
    assert smallest == (
        "smallest angle 44.00°; no placement of this connectivity can exceed 45.00°; "
        "set at vertex 3"
    )
    assert largest == (
        "largest angle 121.00°; no placement of this connectivity can go below 120.00°, "
        "the mean angle of a cell"
    )


def test_options_are_spelled_as_the_reader_writes_them():
    def spell(name):
        return "--" + name.replace("_", "-")

    outcome = replace(
        SWEPT, stop=Stop.MAX_SWEEPS, forbidden=Forbidden(scaled_jacobian=0.4, mean_loss=0.1)
    )
    text = reason(outcome, spell=spell)
    assert "as --max-sweeps says" in text
    assert "--mean-loss=0.1 forbids" in text
    assert "max_sweeps" not in text
    assert "mean_loss" not in text


def consistent(outcome):
    """Whether an outcome can be: what is unchanged has the invalid cells that it had."""
    invalid = outcome.invalid or Invalid(before=0, after=0)
    if outcome.unchanged and (invalid.before != invalid.after or outcome.trades):
        return False
    if outcome.stop is Stop.STUCK:
        return invalid.after > 0
    if outcome.stop is Stop.VALID:
        return invalid.after == 0 and (invalid.before > 0) == (outcome.sweeps > 0)
    return True


@pytest.mark.parametrize("stop", Stop)
@pytest.mark.parametrize("untangles", [False, True])
def test_there_is_always_something_to_say_and_in_one_line(stop, untangles):
    # Whatever goes together in one outcome: one line, and no empty part of it.
    texts = [
        reason(outcome)
        for unchanged, selected, invalid, stages, trades in itertools.product(
            (False, True),
            (False, True),
            (None, *(Invalid(before=2, after=n, first=0) for n in (0, 1, 2))),
            (FULL.stages, UNTANGLED.stages, SWEPT.stages, ()),
            ((), FULL.trades),
        )
        if consistent(
            outcome := Outcome(
                method="any", stop=stop, stop_at=1.0, untangles=untangles, unchanged=unchanged,
                selected=selected, invalid=invalid, stages=stages, trades=trades,
            )
        )
    ]  # fmt: skip
    assert texts
    for text in texts:
        assert text
        assert "\n" not in text
        assert all(part.strip() == part and part for part in text.split("; "))
