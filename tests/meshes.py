"""Meshes for tests: made by hand, or at random from a seed.

A mesh is a pair of points, (n, 2), and a list of blocks of cells, as `qsmooth.Mesh` takes them.
Random ones are valid unless their maker says otherwise.
"""

import math
from dataclasses import dataclass

import numpy as np
from hypothesis import strategies as st

from qsmooth import Mesh

# ------------------------------------------------------------------------------- connectivity


def grid(nx: int, ny: int):
    """Unit squares: points row by row, cells counter-clockwise."""
    y, x = np.mgrid[0 : ny + 1, 0 : nx + 1].astype(float)
    ids = np.arange((nx + 1) * (ny + 1)).reshape(ny + 1, nx + 1)
    quads = np.stack([ids[:-1, :-1], ids[:-1, 1:], ids[1:, 1:], ids[1:, :-1]], axis=-1)
    return np.stack([x.ravel(), y.ravel()], axis=1), [quads.reshape(-1, 4)]


def rough_grid(n: int):
    """Squares, any number of them, moved at random but convex still."""
    points, cells = grid(n, n)
    inner = ((points > 0) & (points < n)).all(axis=1)
    rng = np.random.default_rng(0)
    return points + rng.uniform(-0.2, 0.2, points.shape) * inner[:, None], cells


def split(quads, choice):
    """Cut each quad in two triangles along the diagonal that `choice` names."""
    first = np.where(choice[:, None], quads[:, [0, 1, 2]], quads[:, [0, 1, 3]])
    second = np.where(choice[:, None], quads[:, [0, 2, 3]], quads[:, [1, 2, 3]])
    return np.concatenate([first, second])


def triangles(nx, ny, rng):
    points, (quads,) = grid(nx, ny)
    return points, [split(quads, rng.random(len(quads)) < 0.5)]


def mixed(nx, ny, rng):
    points, (quads,) = grid(nx, ny)
    cut = rng.random(len(quads)) < 0.4
    cut[0], cut[-1] = True, False
    return points, [quads[~cut], split(quads[cut], rng.random(cut.sum()) < 0.5)]


def annulus(n_around, n_out):
    """A ring of quads whose radius doubles."""
    angle = 2 * math.pi * np.arange(n_around) / n_around
    radius = np.geomspace(1.0, 2.0, n_out + 1)
    points = np.stack(
        [np.outer(radius, np.cos(angle)).ravel(), np.outer(radius, np.sin(angle)).ravel()], axis=1
    )
    ids = np.arange(len(points)).reshape(n_out + 1, n_around)
    after = np.roll(ids, -1, axis=1)
    quads = np.stack([ids[:-1], ids[1:], after[1:], after[:-1]], axis=-1)
    return points, [quads.reshape(-1, 4)]


def l_shape(n):
    """A grid of 2n by 2n squares without its upper right quarter."""
    points, (quads,) = grid(2 * n, 2 * n)
    centre = points[quads].mean(axis=1)
    keep = quads[(centre < n).any(axis=1)]
    used = np.unique(keep)
    return points[used], [np.searchsorted(used, keep)]


def graded(nx, ny, ratio=1.5):
    """Rectangles whose sides grow by `ratio` from one to the next."""
    points, cells = grid(nx, ny)
    return (ratio**points - 1.0) / (ratio - 1.0), cells


def fan(valence, kind="quad"):
    """One interior vertex, 0, with a star of quads, of triangles, or of both by turns."""
    points = [(0.0, 0.0)]
    quads, tris = [], []
    n_ring = 2 * valence

    def ring(k):
        return 1 + k % n_ring

    for k in range(n_ring):
        radius = 1.0 if k % 2 == 0 else 1.2 / math.cos(math.pi / n_ring)
        turn = 2 * math.pi * k / n_ring
        points.append((radius * math.cos(turn), radius * math.sin(turn)))
    for k in range(valence):
        a, b, c = ring(2 * k), ring(2 * k + 1), ring(2 * k + 2)
        if kind == "quad" or (kind == "mixed" and k % 2 == 0):
            quads.append((0, a, b, c))
        else:
            tris.append((0, a, c))
    used = sorted({v for cell in quads + tris for v in cell})
    number = {v: k for k, v in enumerate(used)}
    blocks = [np.array([[number[v] for v in c] for c in b]) for b in (quads, tris) if b]
    return np.array(points)[used], blocks


# ------------------------------------------------------------------------------- geometry


def as_cells(blocks):
    """Cells as rows of four; a triangle repeats its last vertex."""
    return np.concatenate([b if b.shape[1] == 4 else b[:, [0, 1, 2, 2]] for b in blocks])


def worst_corner(points, blocks):
    """Smallest sine of each cell's corners."""
    worst = []
    for block in blocks:
        at = points[block]
        u, w = np.roll(at, -1, axis=1) - at, np.roll(at, 1, axis=1) - at
        det = u[..., 0] * w[..., 1] - u[..., 1] * w[..., 0]
        lengths = np.linalg.norm(u, axis=-1) * np.linalg.norm(w, axis=-1)
        worst.append((det / np.where(lengths == 0.0, np.inf, lengths)).min(axis=1))
    return np.concatenate(worst)


def interior(points, blocks):
    mesh = Mesh(points, blocks)
    return ~mesh.is_boundary


def jitter(points, blocks, amount, rng, least=0.02):
    """Move interior vertices at random by `amount` of their shortest edge, valid cells staying so.

    Where a corner's sine gets under `least`, its cell's vertices go half the way back, and again.
    """
    mesh = Mesh(points, blocks)
    shortest = np.full(len(points), np.inf)
    for block in blocks:
        for i in range(block.shape[1]):
            v, w = block[:, i], block[:, (i + 1) % block.shape[1]]
            length = np.linalg.norm(points[v] - points[w], axis=1)
            np.minimum.at(shortest, v, length)
            np.minimum.at(shortest, w, length)
    shift = rng.uniform(-1.0, 1.0, points.shape) * (amount * shortest * ~mesh.is_fixed)[:, None]
    rows = as_cells(blocks)
    for _ in range(60):
        bad = worst_corner(points + shift, blocks) < least
        if not bad.any():
            return points + shift
        shift[rows[bad].ravel()] *= 0.5
    return points.copy()


def place(points, *, scale=1.0, turn=0.0, shift=(0.0, 0.0), mirror=False):
    """Mirror, turn (radians), scale and shift, in this order."""
    rotation = np.array([[math.cos(turn), math.sin(turn)], [-math.sin(turn), math.cos(turn)]])
    flip = np.array([-1.0, 1.0]) if mirror else np.ones(2)
    return (points * flip) @ rotation * scale + np.asarray(shift)


def tilt(points, seed=0, scale=1.0):
    """Put a plane mesh into space: a plane that is not one of the axes' own."""
    rng = np.random.default_rng(seed)
    axes = np.linalg.qr(rng.normal(size=(3, 3)))[0][:2]
    return (points @ axes) * scale + rng.normal(size=3)


def turn_cells(blocks, rng, share=0.5):
    """Reverse some cells, and let each begin anywhere."""
    turned = []
    for block in blocks:
        block = block.copy()
        back = rng.random(len(block)) < share
        block[back] = block[back][:, ::-1]
        start = rng.integers(block.shape[1], size=len(block))
        columns = (np.arange(block.shape[1]) + start[:, None]) % block.shape[1]
        turned.append(np.take_along_axis(block, columns, axis=1))
    return turned


def renumber(points, blocks, rng):
    """Shuffle vertices and cells; also gives the new number of each old vertex."""
    new_of = rng.permutation(len(points))
    shuffled = np.empty_like(points)
    shuffled[new_of] = points
    return shuffled, [new_of[rng.permutation(block)] for block in blocks], new_of


def tangle(points, blocks, rng, amount=1.0):
    """Move interior vertices anywhere: cells of every class."""
    free = interior(points, blocks)
    return points + amount * rng.uniform(-1.0, 1.0, points.shape) * free[:, None]


# ------------------------------------------------------------------------------- random meshes

KINDS = {
    "quads": lambda n, rng: grid(n, n + 1),
    "triangles": lambda n, rng: triangles(n, n + 1, rng),
    "mixed": lambda n, rng: mixed(n, n, rng),
    "annulus": lambda n, rng: annulus(3 * n, n),
    "L": lambda n, rng: l_shape(n),
    "graded": lambda n, rng: graded(n + 1, n),
    "quad fan": lambda n, rng: fan(n + 1, "quad"),
    "triangle fan": lambda n, rng: fan(n + 1, "triangle"),
    "mixed fan": lambda n, rng: fan(n + 1, "mixed"),
}


@dataclass(frozen=True, repr=False)
class RandomMesh:
    """A valid mesh and how it was made."""

    kind: str
    size: int
    seed: int
    amount: float
    scale: float
    shift: tuple[float, float]
    turned: float
    turn: float
    points: np.ndarray
    cells: list[np.ndarray]

    def __repr__(self) -> str:  # what to call to get it again
        names = "kind", "size", "seed", "amount", "scale", "shift", "turned", "turn"
        return f"random_mesh({', '.join(f'{name}={getattr(self, name)!r}' for name in names)})"

    @property
    def mesh(self) -> Mesh:
        return Mesh(self.points, self.cells)


def random_mesh(
    kind="quads", size=5, seed=0, amount=0.6, scale=1.0, shift=(0.0, 0.0), turned=0.0, turn=0.3
) -> RandomMesh:
    rng = np.random.default_rng(seed)
    points, cells = KINDS[kind](size, rng)
    points = jitter(points, cells, amount, rng)
    points = place(points, scale=scale, turn=turn, shift=shift)
    if turned:
        cells = turn_cells(cells, rng, turned)
    return RandomMesh(kind, size, seed, amount, scale, shift, turned, turn, points, cells)


SIZES = st.integers(2, 7)


@st.composite
def random_meshes(draw, sizes=SIZES):
    """Valid meshes of every kind, at every scale and place, numbered and turned anyhow."""
    scale = draw(st.sampled_from([1.0, 1e-9, 1e-3, 500.0, 1e30]))
    # Near 6e6 the numbers are 1e-9 apart: smaller cells would not be valid there.
    shifts = [(0.0, 0.0), (6e6, -6.1e6)] if 1e-3 <= scale <= 500.0 else [(0.0, 0.0)]
    return random_mesh(
        kind=draw(st.sampled_from(sorted(KINDS))),
        size=draw(sizes),
        seed=draw(st.integers(0, 2**32 - 1)),
        amount=draw(st.sampled_from([0.0, 0.3, 0.6, 1.0])),
        scale=scale,
        shift=draw(st.sampled_from(shifts)),
        turned=draw(st.sampled_from([0.0, 0.5, 1.0])),
        turn=draw(st.floats(0.0, 6.0)),
    )
