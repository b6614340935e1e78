"""The optimiser: sweeps over blocks of lanes against a plain loop, and whole calls."""

import math
import time

import numba
import numpy as np
import pytest

from qsmooth import examples, limits, quality, smooth, untangle
from qsmooth.constraints import Constraints
from qsmooth.engine import threads_for
from qsmooth.kernels._jit import use_threads
from qsmooth.kernels.blocks import build_blocks
from qsmooth.kernels.cell_energy import cell_energy, cell_heights, worst_around
from qsmooth.kernels.held_figures import beyond_held, held_figures
from qsmooth.kernels.mapped_sweep import Maps, mapped_sweep
from qsmooth.kernels.newton_sweep import Wall, newton_sweep
from qsmooth.kernels.stacks import match_heights
from qsmooth.kernels.stars import NO_VERTEX
from qsmooth.kernels.untangle_sweep import untangle_sweep
from qsmooth.numbering import Inside
from qsmooth.optimizer.caps import FREE
from qsmooth.optimizer.extrapolation import Extrapolation
from qsmooth.optimizer.global_newton import GlobalNewton
from qsmooth.optimizer.lanes import Lanes
from qsmooth.optimizer.look import Look
from qsmooth.sliding import slider_of
from qsmooth.targets import ideal, learned

pytestmark = pytest.mark.benchmark(group="optimizer")
SWEEPS = 10
NONE = int(NO_VERTEX)
SINE_60, INV_ROOT3 = math.sqrt(0.75), 1.0 / math.sqrt(3.0)
# Mean and wall together, as in the stage of the worst cells.
WEIGHT, THRESHOLD, SQUARINGS = 1.0, 1.5, 4
EPSILON = 0.1
# As many as the walls of each neighbourhood look around.
RINGS = 10

# ------------------------------------------------------------------------------- the plain loop

plain = numba.njit(cache=True, error_model="numpy")


@plain
def _stand_in(det, soft):
    """What is divided by, and its derivative; `soft` is 0 for the determinant itself."""
    if soft == 0.0:
        return (det, 1.0) if det > 0.0 else (0.0, 0.0)
    root = math.sqrt(det * det + soft * soft)
    value = 0.5 * (det + root) if det > 0.0 else 0.5 * soft * soft / (root - det)
    return value, value / root


@plain
def _power(x, squarings):
    for _ in range(squarings):
        x *= x
    return x


@plain
def _corner(vx, vy, bx, by, dx, dy, du, dw, third, scale, soft, weight, inv_threshold, squarings):
    """Energy of the corner at v between b and d, its gradient and Hessian.

    The vertex that moves changes the edges u and w by du and dw; a triangle's energy has `third`,
    the product of both.
    """
    ux, uy, wx, wy = bx - vx, by - vy, dx - vx, dy - vy
    detx, dety = du * wy - dw * uy, dw * ux - du * wx
    uu, ww = ux * ux + uy * uy, wx * wx + wy * wy
    value, slope = _stand_in(ux * wy - uy * wx, soft)
    inv = 1.0 / value
    detx, dety = slope * detx, slope * dety
    e, ex, ey, exx, exy, eyy = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    if weight > 0.0:
        nx = scale * (2.0 * (du * ux + dw * wx) - third * (du * wx + dw * ux))
        ny = scale * (2.0 * (du * uy + dw * wy) - third * (du * wy + dw * uy))
        n2 = 2.0 * scale * (du * du + dw * dw - third * du * dw)
        f = scale * (uu + ww - third * (ux * wx + uy * wy)) * inv
        fx, fy = (nx - f * detx) * inv, (ny - f * dety) * inv
        e, ex, ey = weight * f, weight * fx, weight * fy
        exx = weight * (n2 - 2.0 * fx * detx) * inv
        exy = -weight * (fx * dety + fy * detx) * inv
        eyy = weight * (n2 - 2.0 * fy * dety) * inv
    if inv_threshold > 0.0:
        t = math.sqrt(ww / uu)
        g = uu * t * inv
        gx = (du * ux * t + dw * wx / t - g * detx) * inv
        gy = (du * uy * t + dw * wy / t - g * dety) * inv
        power = 2.0**squarings
        high = _power(g * inv_threshold, squarings)
        first = power * high / g
        second = (power - 1.0) * first / g
        n2 = du * du * t + dw * dw / t
        e, ex, ey = e + high, ex + first * gx, ey + first * gy
        exx += first * inv * (n2 - 2.0 * gx * detx) + second * gx * gx
        exy += second * gx * gy - first * inv * (gx * dety + gy * detx)
        eyy += first * inv * (n2 - 2.0 * gy * dety) + second * gy * gy
    return e, ex, ey, exx, exy, eyy


@plain
def _energy(vx, vy, bx, by, dx, dy, third, scale, soft, weight, inv_threshold, squarings):
    """Energy of the corner at v between b and d, infinite where it is not positive."""
    ux, uy, wx, wy = bx - vx, by - vy, dx - vx, dy - vy
    value, _ = _stand_in(ux * wy - uy * wx, soft)
    if value == 0.0:
        return np.inf
    uu, ww = ux * ux + uy * uy, wx * wx + wy * wy
    e = 0.0
    if weight > 0.0:
        e = weight * scale * (uu + ww - third * (ux * wx + uy * wy)) / value
    if inv_threshold > 0.0:
        e += _power(math.sqrt(uu * ww) / value * inv_threshold, squarings)
    return e


@plain
def _add(a, b):
    return a[0] + b[0], a[1] + b[1], a[2] + b[2], a[3] + b[3], a[4] + b[4], a[5] + b[5]


@plain
def _star(xy, x, y, first, last, corners, soft, weight, wall, squarings):
    """Energy, gradient and Hessian of a star with its vertex at x, y."""
    sum_ = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for row in range(first, last):
        a, b, c = corners[row, 0], corners[row, 1], corners[row, 2]
        ax, ay, cx, cy = xy[a, 0], xy[a, 1], xy[c, 0], xy[c, 1]
        if b == NONE:
            w = wall * SINE_60
            rest = INV_ROOT3, soft, weight, w, squarings
            sum_ = _add(sum_, _corner(x, y, ax, ay, cx, cy, -1.0, -1.0, 1.0, *rest))
            if w > 0.0:
                rest = 0.5, soft, 0.0, w, squarings
                sum_ = _add(sum_, _corner(ax, ay, cx, cy, x, y, 0.0, 1.0, 0.0, *rest))
                sum_ = _add(sum_, _corner(cx, cy, x, y, ax, ay, 1.0, 0.0, 0.0, *rest))
        else:
            bx, by = xy[b, 0], xy[b, 1]
            rest = 0.0, 0.5, soft, weight, wall, squarings
            sum_ = _add(sum_, _corner(x, y, ax, ay, cx, cy, -1.0, -1.0, *rest))
            sum_ = _add(sum_, _corner(ax, ay, bx, by, x, y, 0.0, 1.0, *rest))
            sum_ = _add(sum_, _corner(cx, cy, x, y, bx, by, 1.0, 0.0, *rest))
    return sum_


@plain
def _star_energy(xy, x, y, first, last, corners, soft, weight, wall, squarings):
    sum_ = 0.0
    for row in range(first, last):
        a, b, c = corners[row, 0], corners[row, 1], corners[row, 2]
        ax, ay, cx, cy = xy[a, 0], xy[a, 1], xy[c, 0], xy[c, 1]
        if b == NONE:
            w = wall * SINE_60
            sum_ += _energy(x, y, ax, ay, cx, cy, 1.0, INV_ROOT3, soft, weight, w, squarings)
            if w > 0.0:
                sum_ += _energy(ax, ay, cx, cy, x, y, 0.0, 0.5, soft, 0.0, w, squarings)
                sum_ += _energy(cx, cy, x, y, ax, ay, 0.0, 0.5, soft, 0.0, w, squarings)
        else:
            bx, by = xy[b, 0], xy[b, 1]
            rest = 0.0, 0.5, soft, weight, wall, squarings
            sum_ += _energy(x, y, ax, ay, cx, cy, *rest)
            sum_ += _energy(ax, ay, bx, by, x, y, *rest)
            sum_ += _energy(cx, cy, x, y, bx, by, *rest)
    return sum_


@plain
def plain_sweep(xy, vertices, offsets, corners, sizes, epsilon, weight, threshold, squarings):
    """Vertex by vertex what the block kernels do; epsilon 0 for the Newton sweep."""
    wall = 1.0 / threshold if epsilon == 0.0 else 0.0
    for i in range(vertices.size):
        v = vertices[i]
        x, y = xy[v, 0], xy[v, 1]
        rest = offsets[i], offsets[i + 1], corners, epsilon * sizes[v], weight, wall, squarings
        e, ex, ey, exx, exy, eyy = _star(xy, x, y, *rest)
        inv = 1.0 / (exx * eyy - exy * exy)
        sx, sy = -(eyy * ex - exy * ey) * inv, -(exx * ey - exy * ex) * inv
        for fraction in (1.7, 1.0, 0.4, 0.1):
            px, py = x + fraction * sx, y + fraction * sy
            if _star_energy(xy, px, py, *rest) < e:
                xy[v, 0], xy[v, 1] = px, py
                break


# ------------------------------------------------------------------------------- sweeps


class Case:
    """A mesh with what both loops need, and `SWEEPS` sweeps by each."""

    def __init__(self, mesh, epsilon):
        self.mesh, self.epsilon = mesh, epsilon
        self.stars = mesh.topology.schedule()
        self.blocks = build_blocks(self.stars)
        self.all = 0, self.blocks.colour_blocks.size - 1
        self.sizes = np.ones(mesh.n_vertices)
        self.moves = np.empty(self.blocks.vertices.size)
        lanes = Lanes(mesh.topology, self.stars, threads_for(1, self.stars.vertices.size))
        # With maps, so that all has rows: these are for mapped sweeps too.
        no_maps = np.tile([1.0, 0.0, 1.0], (mesh.n_cells, 1))
        lanes.aim_at(ideal(mesh.topology)._replace(maps=no_maps))
        wall = Wall(WEIGHT, THRESHOLD, SQUARINGS)
        self.held, self.rows = lanes.caps.swept, lanes.rows_for(wall)

    def by_blocks(self):
        xy = self.mesh.xy.copy()
        for _ in range(SWEEPS):
            if self.epsilon:
                rest = 1.7, self.sizes, self.epsilon, self.moves
                untangle_sweep(xy, self.blocks, self.all, *rest)
            else:
                wall = Wall(WEIGHT, THRESHOLD, SQUARINGS)
                newton_sweep(xy, self.blocks, self.all, 1.7, wall, self.held, self.rows, self.moves)
        return xy

    def plainly(self):
        xy, s = self.mesh.xy.copy(), self.stars
        for _ in range(SWEEPS):
            plain_sweep(
                xy, s.vertices, s.offsets, s.corners, self.sizes, self.epsilon, WEIGHT, THRESHOLD,
                SQUARINGS,
            )  # fmt: skip
        return xy


@pytest.mark.parametrize("name", ["newton", "untangle"])
def test_blocks_over_a_plain_loop(benchmark, mesh, note, print_ratio, smoke, name):
    """Vertex steps a second on one thread, from the same start to the same end."""
    case = Case(mesh, EPSILON if name == "untangle" else 0.0)
    seconds = {"blocks": [], "plain": []}

    def both():
        ends = []
        for key, run in (("blocks", case.by_blocks), ("plain", case.plainly)):
            start = time.perf_counter()
            ends.append(run())
            seconds[key].append(time.perf_counter() - start)
        return ends

    size = np.ptp(mesh.xy)
    np.testing.assert_allclose(*both(), rtol=0, atol=1e-6 * size)
    for values in seconds.values():
        values.clear()
    benchmark.pedantic(both, rounds=1 if smoke else 9 if mesh.n_cells < 10_000 else 2)
    n = case.moves.size * SWEEPS
    # The least: a sweep is shorter than what other processes take a core away for.
    blocks, plain_loop = (min(values) for values in seconds.values())
    note(
        mesh, 1, rate=None, steps_per_second=round(n / blocks),
        plain_steps_per_second=round(n / plain_loop),
    )  # fmt: skip
    print_ratio(
        f"{name} sweep, {mesh.n_vertices} vertices, 1 thread: {n / blocks / 1e6:.1f} M vertex "
        f"steps/s in blocks, {n / plain_loop / 1e6:.1f} M plainly, ratio {plain_loop / blocks:.1f}"
    )


@pytest.mark.parametrize("threads", [1, 2])
@pytest.mark.parametrize("name", ["newton", "untangle"])
def test_sweep(benchmark, mesh, note, name, threads):
    case = Case(mesh, EPSILON if name == "untangle" else 0.0)
    note(mesh, threads, rate=(case.moves.size * SWEEPS, "steps"), sweeps=SWEEPS)
    with use_threads(threads):
        case.by_blocks()
        benchmark(case.by_blocks)


CONSTRAINTS = {
    "none": Constraints(),
    "reach": Constraints(max_move_share=0.05),
    "directions": Constraints(directions=(0.6, 0.8)),
}


@pytest.mark.parametrize("name", CONSTRAINTS)
def test_newton_sweep_on_rails(benchmark, mesh, note, name):
    """What it costs a sweep to confine its trials."""
    case = Case(mesh, 0.0)
    case.blocks = case.blocks._replace(rails=CONSTRAINTS[name].freedom(mesh).rails())
    note(mesh, 1, rate=(case.moves.size * SWEEPS, "steps"), sweeps=SWEEPS)
    with use_threads(1):
        case.by_blocks()
        benchmark(case.by_blocks)


@pytest.mark.parametrize("threads", [1, 2])
def test_mapped_sweep(benchmark, mesh, note, threads):
    """A sweep towards targets with a direction, here none: the cost of the maps."""
    case = Case(mesh, 0.0)
    ones, zeros = np.ones(case.blocks.cells.size), np.zeros(case.blocks.cells.size)
    wall, maps = Wall(WEIGHT, THRESHOLD, SQUARINGS), Maps(ones, zeros, ones)
    rest = case.held, case.rows, maps, case.moves

    def run():
        xy = mesh.xy.copy()
        for _ in range(SWEEPS):
            mapped_sweep(xy, case.blocks, case.all, 1.7, wall, *rest)
        return xy

    note(mesh, threads, rate=(case.moves.size * SWEEPS, "steps"), sweeps=SWEEPS)
    with use_threads(threads):
        np.testing.assert_allclose(run(), case.by_blocks(), rtol=0, atol=1e-6 * np.ptp(mesh.xy))
        benchmark(run)


def test_slide_sweep(benchmark, mesh, note):
    """Sweeps over what slides along the boundary, from where it was; set beside all the others."""
    slider = slider_of(Constraints(boundary="slide").freedom(mesh), mesh, Inside(mesh, kept=True))
    asked, lengths = slider.ask_ideal(), np.empty(slider.vertices.size)
    held = np.tile(FREE[:3], (mesh.n_vertices, 1))

    def sweep():
        xy = mesh.xy.copy()
        for _ in range(SWEEPS):
            slider.sweep(xy, Wall(WEIGHT, THRESHOLD, SQUARINGS), held, asked, lengths)
        return xy

    note(mesh, 1, rate=(lengths.size * SWEEPS, "steps"), sweeps=SWEEPS)
    assert (sweep() != mesh.xy).any()
    benchmark(sweep)


def test_swings(benchmark, mesh, note):
    """How far the edges of what slides can turn, for the limits; once a run."""
    slider = slider_of(Constraints(boundary="slide").freedom(mesh), mesh, Inside(mesh, kept=True))
    note(mesh, 1)
    assert (slider.swings(mesh.xy).turn >= 0.0).any()
    benchmark(slider.swings, mesh.xy)


@pytest.mark.parametrize("threads", [1, 2])
def test_extrapolation(benchmark, mesh, note, threads):
    """A round of notes and the place that it leads to; to be set beside ten sweeps."""
    rng, engine = np.random.default_rng(0), threads_for(threads, mesh.n_vertices)
    vertices = mesh.topology.schedule().vertices
    ahead = Extrapolation(vertices, SWEEPS, engine)
    moves = rng.uniform(-1e-4, 1e-4, (SWEEPS, *mesh.xy.shape))
    size = np.full(vertices.size, 1e-3)

    def round_of_sweeps():
        ahead.start(mesh.xy, size)
        for move in moves:
            ahead.note(mesh.xy + move)
        return ahead.extrapolated(mesh.xy)

    note(mesh, threads)
    with engine.running():
        round_of_sweeps()
        benchmark(round_of_sweeps)


# ------------------------------------------------------------------------------- cell by cell


def _cell_kernels(mesh):
    """Calls of what is measured of every cell after a round, and before the first."""
    cells, plain = mesh.topology.cells, ideal(mesh.topology)
    out, more, six = np.empty(mesh.n_cells), np.empty(mesh.n_cells), np.empty((mesh.n_cells, 6))
    movable, sizes, no_maps = ~mesh.is_fixed, np.zeros((mesh.n_cells, 2)), np.empty((0, 3))
    values = 1.0 / quality(mesh).shape
    free, nowhere = np.tile(FREE, (2, 1)), np.zeros(mesh.n_cells, np.int64)
    marked = np.empty(mesh.n_cells, np.bool_)
    return {
        "cell_energy": lambda: cell_energy(
            mesh.xy, *cells, movable, plain.corners, sizes, no_maps, out, more
        ),
        "round_figures": lambda: Look(mesh.topology, mesh.xy, movable, plain, sizes, no_maps),
        "worst_around": lambda: worst_around(values, RINGS, *cells, mesh.n_vertices),
        "held_figures": lambda: held_figures(mesh.xy, *cells, movable, six),
        "cell_heights": lambda: cell_heights(values, values, values, values, out, out, 6, more),
        "beyond_held": lambda: beyond_held(mesh.xy, *cells, movable, free, nowhere, marked),
        "learned": lambda: learned(mesh.topology, mesh.xy),
    }


@pytest.mark.parametrize("threads", [1, 2])
@pytest.mark.parametrize(
    "name",
    [
        "cell_energy",
        "round_figures",
        "worst_around",
        "held_figures",
        "beyond_held",
        "cell_heights",
        "learned",
    ],
)
def test_cells(benchmark, mesh, note, name, threads):
    run = _cell_kernels(mesh)[name]
    note(mesh, threads, rings=RINGS)
    with use_threads(threads):
        run()
        benchmark(run)


@pytest.mark.parametrize("threads", [1, 2])
def test_heights_of_layers(benchmark, note, smoke, threads):
    """Heights matched to where the layers lie, in stacks of 32."""
    mesh = examples.structured(32, 64 if smoke else 4096)
    n = mesh.n_cells
    heights = np.exp(0.2 * np.random.default_rng(0).normal(size=n))
    stacks = np.arange(0, n + 1, 32), np.arange(n), np.zeros(n // 32, np.bool_)
    out, walls, ones = np.empty(n), np.ones((n // 32, 2), np.bool_), np.ones(n)
    note(mesh, threads)
    with use_threads(threads):
        match_heights(*stacks, walls, heights, ones, 8, out)
        benchmark(match_heights, *stacks, walls, heights, ones, 8, out)


# ------------------------------------------------------------------------------- the whole mesh

BUMPS = {"24K": 155, "250K": 500, "1M": 1000}


@pytest.fixture(params=BUMPS)
def bump(request, smoke):
    """A region that has to move as a whole; the larger ones for --full."""
    if request.param != "24K" and not request.config.getoption("full", default=False):
        pytest.skip("only with --full")
    return examples.bump(24 if smoke else BUMPS[request.param])


def _whole_mesh(mesh, threads):
    """Steps on the whole mesh, and a sweep to set beside them."""
    lanes = Lanes(mesh.topology, mesh.topology.schedule(), threads_for(threads, mesh.n_vertices))
    lanes.aim_at(ideal(mesh.topology))
    args = lanes.stars, lanes.targets.corners, lanes.sizes, lanes.maps, lanes.caps
    xy, wall = mesh.xy.copy(), Wall(1.0, math.inf, 1)
    sweep = lanes.sweep(xy, wall, lanes.caps.swept, lanes._moves.lengths)
    return lambda: GlobalNewton(mesh.topology, *args), lambda: sweep((0, lanes.n_colours))


def _seconds(run):
    start = time.perf_counter()
    run()
    return time.perf_counter() - start


@pytest.mark.parametrize("threads", [1, 2])
@pytest.mark.parametrize("part", ["set-up", "step"])
def test_whole_mesh(benchmark, bump, note, print_ratio, smoke, part, threads):
    """A Newton step on the whole mesh, and what it takes once per call; a sweep beside it."""
    note(bump, threads)
    set_up, sweep = _whole_mesh(bump, threads)
    with use_threads(threads):
        steps = set_up()
        steps.step(bump.xy.copy())
        run = set_up if part == "set-up" else (lambda: steps.step(bump.xy.copy()))
        benchmark.pedantic(run, rounds=1 if smoke else 5)
        one = min(_seconds(sweep) for _ in range(3))
    if not smoke:
        seconds = benchmark.stats.stats.min
        print_ratio(
            f"whole mesh, {part}, {bump.n_vertices} vertices, {threads} threads: {seconds:.3f} s, "
            f"{1e6 * seconds / bump.n_vertices:.2f} µs a vertex, {seconds / one:.0f} sweeps"
        )


# ------------------------------------------------------------------------------- whole calls

WHOLE = {
    "jittered squares 2K": lambda: examples.jittered(45, 45, seed=1),
    "jittered squares 24K": lambda: examples.jittered(155, 155, seed=1),
    "lake 2K": lambda: examples.lake(2000),
    "lake 24K": lambda: examples.lake(24_000),
    "random triangles 2K": lambda: examples.random_triangles(2000),
    "bump 10K": lambda: examples.bump(100),
    "random interior 2K": lambda: examples.random_interior(45, 45),
    "random interior 24K": lambda: examples.random_interior(155, 155),
}


@pytest.mark.parametrize("name", WHOLE)
def test_optimize(benchmark, note, print_ratio, smoke, name):
    """The whole optimiser with its defaults; what it reached stands beside the time."""
    mesh = WHOLE["jittered squares 2K" if smoke else name]()
    smooth(mesh, "optimize", max_sweeps=20)  # compiled
    result = benchmark.pedantic(
        lambda: smooth(mesh, "optimize", max_sweeps=20 if smoke else 5000), rounds=1
    )
    found, worst = limits(result.mesh), result.after.worst
    note(
        mesh, 1, sweeps=result.sweeps, invalid=result.after.n_invalid,
        min_angle=round(worst["min_angle"], 3), limit=round(found.min_angle, 3),
        scaled_jacobian=round(worst["scaled_jacobian"], 4),
        mean_shape=round(result.after.mean["shape"], 4),
    )  # fmt: skip
    print_ratio(
        f"optimize {name}: {result.seconds:.3f} s, {result.sweeps} sweeps, smallest angle "
        f"{worst['min_angle']:.2f}° of {found.min_angle:.2f}°, {result.after.n_invalid} invalid"
    )


@pytest.mark.parametrize("name", ["random interior 2K", "random interior 24K"])
def test_untangle(benchmark, note, smoke, name):
    mesh = WHOLE["random interior 2K" if smoke else name]()
    untangle(mesh)
    result = benchmark.pedantic(lambda: untangle(mesh), rounds=1)
    note(mesh, 1, sweeps=result.sweeps, invalid=result.after.n_invalid)
