"""Steps of a session: what they cost beside their sweeps, and a body that turns in its box.

    pytest benchmarks/test_session.py

Targets, on one thread and warm: overhead of a step .1 ms at 2K vertices and 1 ms at 24K; a step of
the body that turns 1 ms and 10 ms, each valid, with a scaled Jacobian of .5 at least. Where the
boundary slides and z is interpolated, a few times that.
"""

import numpy as np
import pytest

from qsmooth import Mesh, Smoother, smooth
from qsmooth.examples import around_body

pytestmark = pytest.mark.benchmark(group="session")
SIDES = {"2K": 45, "24K": 158}
STEPS, DEGREES = 200, 45.0


class Turning:
    """The box, and where its body is at each step."""

    def __init__(self, side, steps):
        self.mesh = around_body(side)
        points = self.mesh.points
        self.body = self.mesh.is_boundary & (np.abs(points).max(axis=1) < 0.5)
        angles = np.radians(DEGREES) / STEPS * np.arange(1, steps + 1)
        cos, sin = np.cos(angles), np.sin(angles)
        turns = np.array([[cos, sin], [-sin, cos]]).transpose(2, 0, 1)
        self.places = points[self.body] @ turns


# What a session is asked for beside the mesh.
ASKED = {
    "boundary stays": {},
    "boundary slides": {"boundary": "slide"},
    "z is interpolated": {"carry": "interpolate"},
    "slides, with z": {"boundary": "slide", "carry": "interpolate"},
}


@pytest.fixture(params=SIDES)
def turning(request, smoke):
    return Turning(8 if smoke else SIDES[request.param], 3 if smoke else STEPS)


def session(turning, options):
    """A session, and its points after a first step."""
    mesh = turning.mesh
    if "carry" in options:
        bed = np.sin(3.0 * mesh.points[:, 0])
        mesh = Mesh(np.column_stack([mesh.points, bed]), mesh.cells, surface="flat")
    smoother, points = Smoother(mesh, threads=1, **options), mesh.points.copy()
    smoother.step(points)
    return smoother, points


@pytest.mark.parametrize("options", ASKED.values(), ids=ASKED)
def test_overhead(benchmark, turning, options, note):
    """All that a step does but its sweeps, of a mesh whose body has just moved."""
    smoother, points = session(turning, options)
    k = 0

    def call():
        nonlocal k
        k = (k + 1) % len(turning.places)
        points[turning.body, :2] = turning.places[k % 2]
        smoother.step(points, max_sweeps=0)

    benchmark(call)
    note(turning.mesh, 1, rate=None)


@pytest.mark.parametrize("options", ASKED.values(), ids=ASKED)
def test_body_turns(benchmark, turning, options, note, print_ratio, smoke):
    mesh = turning.mesh
    records = []

    def start():
        records.clear()
        return session(turning, options), {}

    def turn(smoother, points):
        for place in turning.places:
            points[turning.body, :2] = place
            records.append(smoother.step(points))

    benchmark.pedantic(turn, setup=start, rounds=1 if smoke else 3, warmup_rounds=1)
    assert all(record.valid for record in records)
    worst = min(record.scaled_jacobian for record in records)
    assert worst > 0.5
    note(mesh, 1, rate=(len(records), "steps"), scaled_jacobian=round(worst, 3))
    if not smoke:
        each = 1e3 * benchmark.stats.stats.min / len(records)
        print_ratio(f"{mesh.n_vertices} vertices: {each:.2f} ms a step, worst corner {worst:.3f}")


def test_smooth_each_step(benchmark, turning, note, print_ratio, smoke):
    """The same with `smooth`, without the worst cells, for the first ten steps."""
    mesh, places = turning.mesh, turning.places[:10]

    def turn():
        now = mesh
        for place in places:
            points = now.points.copy()
            points[turning.body] = place
            now = smooth(now.with_points(points), worst=False, threads=1).mesh
        return now

    benchmark.pedantic(turn, rounds=1 if smoke else 2, warmup_rounds=1)
    note(mesh, 1, rate=(len(places), "steps"))
    if not smoke:
        each = 1e3 * benchmark.stats.stats.min / len(places)
        print_ratio(f"{mesh.n_vertices} vertices: {each:.2f} ms a call of smooth(worst=False)")
