"""The optimiser: sweeps over blocks of lanes against a plain loop, and whole calls."""

import math
import statistics
import time

import numba
import numpy as np
import pytest

from qsmooth import examples, limits, smooth_optimize, untangle
from qsmooth.kernels import newton
from qsmooth.kernels import untangle as untangling
from qsmooth.kernels._jit import use_threads
from qsmooth.kernels.blocks import build_blocks
from qsmooth.kernels.topology import NO_VERTEX

SWEEPS = 10
NONE = int(NO_VERTEX)
SINE_60, INV_ROOT3 = math.sqrt(0.75), 1.0 / math.sqrt(3.0)
# Mean and wall together, as in the stage of the worst cells.
WEIGHT, LIMIT, SQUARINGS = 1.0, 1.5, 4
EPSILON = 0.1

# ------------------------------------------------------------------------------- the plain loop

plain = numba.njit(cache=True, error_model="numpy")


@plain
def _corner(vx, vy, bx, by, dx, dy, k, scale, soft, weight, inv_limit, squarings, out):
    """Add the corner at v between b and d; k says which of the three moves. False where flat."""
    ux, uy, wx, wy = bx - vx, by - vy, dx - vx, dy - vy
    det = ux * wy - uy * wx
    # Derivatives of u and w by the vertex that moves.
    du, dw = (-1.0, -1.0) if k == 0 else ((1.0, 0.0) if k == 1 else (0.0, 1.0))
    detx, dety = du * wy - dw * uy, dw * ux - du * wx
    uu, ww = ux * ux + uy * uy, wx * wx + wy * wy
    value, slope = det, 1.0
    if soft > 0.0:
        root = math.sqrt(det * det + soft * soft)
        value = 0.5 * (det + root) if det > 0.0 else 0.5 * soft * soft / (root - det)
        slope = value / root
    elif not det > 0.0:
        return False
    inv = 1.0 / value
    detx, dety = slope * detx, slope * dety
    if weight > 0.0:
        squares, nx, ny = uu + ww, 2.0 * (du * ux + dw * wx), 2.0 * (du * uy + dw * wy)
        n2 = 2.0 * (du * du + dw * dw)
        if scale == INV_ROOT3:
            squares -= ux * wx + uy * wy
            nx, ny = nx - du * wx - dw * ux, ny - du * wy - dw * uy
            n2 -= 2.0 * du * dw
        f = scale * squares * inv
        fx, fy = (scale * nx - f * detx) * inv, (scale * ny - f * dety) * inv
        out[0] += weight * f
        out[1] += weight * fx
        out[2] += weight * fy
        out[3] += weight * (scale * n2 - 2.0 * fx * detx) * inv
        out[4] -= weight * (fx * dety + fy * detx) * inv
        out[5] += weight * (scale * n2 - 2.0 * fy * dety) * inv
    if inv_limit > 0.0:
        t = math.sqrt(ww / uu)
        g = math.sqrt(uu * ww) * inv
        gx = (du * ux * t + dw * wx / t - g * detx) * inv
        gy = (du * uy * t + dw * wy / t - g * dety) * inv
        power = 2.0**squarings
        high = g * inv_limit
        for _ in range(squarings):
            high *= high
        first = power * high / g
        second = (power - 1.0) * first / g
        n2 = du * du * t + dw * dw / t
        out[0] += high
        out[1] += first * gx
        out[2] += first * gy
        out[3] += first * inv * (n2 - 2.0 * gx * detx) + second * gx * gx
        out[4] += second * gx * gy - first * inv * (gx * dety + gy * detx)
        out[5] += first * inv * (n2 - 2.0 * gy * dety) + second * gy * gy
    return True


@plain
def _star(xy, x, y, first, last, corners, soft, weight, inv_limit, squarings, out):
    """Energy, gradient and Hessian of a star with its vertex at x, y. False where not valid."""
    out[:] = 0.0
    for row in range(first, last):
        a, b, c = corners[row, 0], corners[row, 1], corners[row, 2]
        ax, ay, cx, cy = xy[a, 0], xy[a, 1], xy[c, 0], xy[c, 1]
        wall = inv_limit if soft == 0.0 else 0.0
        if b == NONE:
            wall *= SINE_60
            good = _corner(x, y, ax, ay, cx, cy, 0, INV_ROOT3, soft, weight, wall, squarings, out)
            if wall > 0.0:
                good &= _corner(ax, ay, cx, cy, x, y, 2, 0.5, soft, 0.0, wall, squarings, out)
                good &= _corner(cx, cy, x, y, ax, ay, 1, 0.5, soft, 0.0, wall, squarings, out)
        else:
            bx, by = xy[b, 0], xy[b, 1]
            good = _corner(x, y, ax, ay, cx, cy, 0, 0.5, soft, weight, wall, squarings, out)
            good &= _corner(ax, ay, bx, by, x, y, 2, 0.5, soft, weight, wall, squarings, out)
            good &= _corner(cx, cy, x, y, bx, by, 1, 0.5, soft, weight, wall, squarings, out)
        if not good:
            return False
    return True


@plain
def plain_sweep(xy, vertices, offsets, corners, sizes, epsilon, weight, limit, squarings):
    """Vertex by vertex what the block kernels do; epsilon 0 for the Newton sweep."""
    own, other = np.empty(6), np.empty(6)
    for i in range(vertices.size):
        v = vertices[i]
        x, y, soft = xy[v, 0], xy[v, 1], epsilon * sizes[v]
        rest = offsets[i], offsets[i + 1], corners, soft, weight, 1.0 / limit, squarings
        _star(xy, x, y, *rest, own)
        inv = 1.0 / (own[3] * own[5] - own[4] * own[4])
        sx = -(own[5] * own[1] - own[4] * own[2]) * inv
        sy = -(own[3] * own[2] - own[4] * own[1]) * inv
        for fraction in (1.7, 1.0, 0.4, 0.1):
            px, py = x + fraction * sx, y + fraction * sy
            if _star(xy, px, py, *rest, other) and other[0] < own[0]:
                xy[v, 0], xy[v, 1] = px, py
                break


# ------------------------------------------------------------------------------- sweeps


class Case:
    """A mesh with what both loops need, and `SWEEPS` sweeps by each."""

    def __init__(self, mesh, epsilon):
        self.mesh, self.epsilon = mesh, epsilon
        self.schedule = s = mesh._topology.schedule(True)
        colour_blocks, blocks, vertices, stars, _ = build_blocks(
            s.colour_offsets, s.vertices, s.offsets, s.corners
        )
        self.blocks = colour_blocks, blocks, vertices, stars, s.largest_star
        self.sizes = np.ones(mesh.n_vertices)
        self.moves = np.empty(vertices.size)

    def by_blocks(self):
        xy = self.mesh.xy.copy()
        for _ in range(SWEEPS):
            if self.epsilon:
                untangling.untangle_sweep(
                    xy, *self.blocks, 1.7, self.sizes, self.epsilon, self.moves
                )
            else:
                newton.newton_sweep(xy, *self.blocks, 1.7, WEIGHT, LIMIT, SQUARINGS, self.moves)
        return xy

    def plainly(self):
        xy, s = self.mesh.xy.copy(), self.schedule
        for _ in range(SWEEPS):
            plain_sweep(
                xy, s.vertices, s.offsets, s.corners, self.sizes, self.epsilon, WEIGHT, LIMIT,
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
    benchmark.pedantic(both, rounds=1 if smoke else 5)
    n = case.moves.size * SWEEPS
    blocks, plain_loop = (statistics.median(values) for values in seconds.values())
    note(
        mesh, 1, steps_per_second=round(n / blocks), plain_steps_per_second=round(n / plain_loop)
    )  # fmt: skip
    print_ratio(
        f"{name} sweep, {mesh.n_vertices} vertices, 1 thread: {n / blocks / 1e6:.1f} M vertex "
        f"steps/s in blocks, {n / plain_loop / 1e6:.1f} M plainly, ratio {plain_loop / blocks:.1f}"
    )


@pytest.mark.parametrize("threads", [1, 2])
@pytest.mark.parametrize("name", ["newton", "untangle"])
def test_sweep(benchmark, mesh, note, name, threads):
    case = Case(mesh, EPSILON if name == "untangle" else 0.0)
    note(mesh, threads, sweeps=SWEEPS)
    with use_threads(threads):
        case.by_blocks()
        benchmark(case.by_blocks)


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
    smooth_optimize(mesh, max_sweeps=20)  # compiled
    result = benchmark.pedantic(
        lambda: smooth_optimize(mesh, max_sweeps=20 if smoke else 5000), rounds=1 if smoke else 3
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
    result = benchmark.pedantic(lambda: untangle(mesh), rounds=1 if smoke else 3)
    note(mesh, 1, sweeps=result.sweeps, invalid=result.after.n_invalid)
