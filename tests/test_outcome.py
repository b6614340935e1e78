"""Outcomes: records that add up and that can be written down."""

import dataclasses
import json
import math

import pytest

from qsmooth import Limits, Outcome, Stop
from qsmooth.outcome import Aim, Cut, Forbidden, Held, Invalid, Sizes, Stage, Target, Trade

pytestmark = pytest.mark.nojit

LIMITS = Limits(
    min_angle=45.0, min_angle_vertex=3, max_angle=120.0, max_angle_vertex=-1,
    reached_min_angle=44.0, reached_max_angle=121.0,
)  # fmt: skip
FULL = Outcome(
    method="optimize",
    stop=Stop.TIME_LIMIT,
    stop_at=2.5,
    chosen=", as asked",
    untangles=True,
    stages=(
        Stage(aim=Aim.UNTANGLE, sweeps=3, seconds=0.5, gain={"n_invalid": -4}),
        Stage(aim=Aim.MEAN_SHAPE, sweeps=20, steps=2, seconds=1.5, gain={"mean_shape": 0.1}),
    ),
    largest_share=0.01,
    trades=(
        Trade(
            figure="aspect_ratio",
            before=20.0,
            after=33.0,
            gained="min_angle",
            gained_before=8.4,
            gained_after=40.3,
        ),
    ),
    forbidden=Forbidden(scaled_jacobian=0.4, mean_loss=0.1),
    held=(Held(figure="max_angle", value=129.7, cell=17, vertices=3),),
    invalid=Invalid(before=4, after=2, first=7, proven=1, first_proven=9),
    cut=Cut(quads=6, diagonal="shorter", broken=1),
    target=Target(kind="squares", before=0.71, after=0.95, ideal_before=0.6, ideal_after=0.65),
    sizes=Sizes(
        area_low=0.97,
        area_median=1.0,
        area_high=1.31,
        min_edge_before=0.159,
        min_edge_after=0.519,
        layers=0.12,
    ),
    limits=LIMITS,
)


def test_sweeps_are_those_of_all_stages():
    assert FULL.sweeps == 23
    assert Outcome(method="star", stop=Stop.NOTHING_MOVES).sweeps == 0


def test_records_are_frozen_and_the_clock_does_not_count():
    with pytest.raises(dataclasses.FrozenInstanceError):
        FULL.stop = Stop.RESTS
    one = Stage(aim=Aim.ALL_CELLS, sweeps=3, seconds=1.0)
    assert one == dataclasses.replace(one, seconds=2.0)
    assert one != dataclasses.replace(one, sweeps=4)


@pytest.mark.parametrize("stop", Stop)
def test_done_or_cut_short(stop):
    cut_short = {Stop.MAX_SWEEPS, Stop.TIME_LIMIT, Stop.CALLBACK, Stop.STUCK}
    assert stop.by_itself == (stop not in cut_short)


@pytest.mark.parametrize(
    "outcome", [FULL, *(Outcome(method="star", stop=s, stop_at=math.nan) for s in Stop)]
)
def test_it_is_written_down_as_it_is(outcome):
    plain = json.loads(json.dumps(outcome.to_dict(), allow_nan=False))
    assert Stop(plain["stop"]) is outcome.stop
    assert plain["sweeps"] == outcome.sweeps
    assert {*plain} == {*(field.name for field in dataclasses.fields(Outcome)), "sweeps"}
    again = [Stage(**{**s, "aim": Aim(s["aim"])}) for s in plain["stages"]]
    assert tuple(again) == outcome.stages
    assert tuple(Trade(**trade) for trade in plain["trades"]) == outcome.trades
    assert tuple(Held(**held) for held in plain["held"]) == outcome.held
    records = {"forbidden": Forbidden, "invalid": Invalid, "cut": Cut}
    for name, record in {**records, "target": Target, "sizes": Sizes}.items():
        given = plain[name]
        assert (None if given is None else record(**given)) == getattr(outcome, name)
    for name in ("method", "chosen", "guarded", "untangles", "selected", "unchanged"):
        assert plain[name] == getattr(outcome, name)
    assert plain["stop_at"] == (None if math.isnan(outcome.stop_at) else outcome.stop_at)


def test_a_trade_for_nothing_is_written_down_with_none():
    outcome = Outcome(
        method="any", stop=Stop.SETTLED, trades=(Trade(figure="shape", before=0.2, after=0.1),)
    )
    (trade,) = json.loads(json.dumps(outcome.to_dict(), allow_nan=False))["trades"]
    assert (trade["gained"], trade["gained_before"], trade["gained_after"]) == ("", None, None)


def test_the_limits_are_written_down_too():
    assert FULL.to_dict()["limits"] == LIMITS.to_dict()
    assert FULL.to_dict()["limits"]["min_angle"] == 45.0
