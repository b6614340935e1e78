"""Slow, obvious versions of the optimiser's kernels and of the bounds on angles.

Derivatives come from arithmetic on jets (a value, its gradient, its Hessian) and not from formulas;
eigenvalues from numpy. Points are complex numbers, cells lists of vertex ids, as in `reference`.
"""

import cmath
import math
from collections import Counter, defaultdict

import numpy as np

import reference
from qsmooth.kernels.blocks import make_rows, row_corners

# Multiples of the Newton step, in the order in which they are tried.
FRACTIONS = (1.7, 1.0, 0.4, 0.1)
SINE_60 = math.sin(math.radians(60.0))


class Jet:
    """A number with its first and second derivatives by some variables."""

    def __init__(self, value, gradient, hessian):
        self.value, self.gradient, self.hessian = value, gradient, hessian

    @classmethod
    def variables(cls, values):
        n = len(values)
        return [cls(float(x), np.eye(n)[k], np.zeros((n, n))) for k, x in enumerate(values)]

    def apply(self, value, first, second):
        """A function of this number, given its value and derivatives here."""
        outer = np.outer(self.gradient, self.gradient)
        return Jet(value, first * self.gradient, first * self.hessian + second * outer)

    def __add__(self, other):
        if not isinstance(other, Jet):
            return Jet(self.value + other, self.gradient, self.hessian)
        return Jet(
            self.value + other.value, self.gradient + other.gradient, self.hessian + other.hessian
        )

    def __neg__(self):
        return Jet(-self.value, -self.gradient, -self.hessian)

    def __sub__(self, other):
        return self + (-other)

    def __rsub__(self, other):
        return -self + other

    def __mul__(self, other):
        if not isinstance(other, Jet):
            return Jet(self.value * other, self.gradient * other, self.hessian * other)
        cross = np.outer(self.gradient, other.gradient)
        return Jet(
            self.value * other.value,
            self.value * other.gradient + other.value * self.gradient,
            self.value * other.hessian + other.value * self.hessian + cross + cross.T,
        )

    __radd__, __rmul__ = __add__, __mul__

    def __truediv__(self, other):
        if not isinstance(other, Jet):
            return self * (1.0 / other)
        inv = 1.0 / other.value
        return self * other.apply(inv, -inv * inv, 2.0 * inv**3)

    def __pow__(self, p):
        x = self.value
        return self.apply(x**p, p * x ** (p - 1), p * (p - 1) * x ** (p - 2))


def value(x) -> float:
    return x.value if isinstance(x, Jet) else x


# ------------------------------------------------------------------------------- what is asked


class Asked:
    """What is asked of one cell: a target a corner, by vertex; area, its weight, the wall on f; the
    symmetric matrix that edges are multiplied by before f is taken; and what the threshold of the
    wall on g is divided by.
    """

    def __init__(
        self, targets, area=None, weight=0.0, slim=0.0, map_=((1.0, 0.0), (0.0, 1.0)), near=1.0
    ):
        self.targets, self.area, self.weight, self.slim = targets, area, weight, slim
        self.map, self.near = np.array(map_), near

    def mapped(self, u):
        return tuple(float(a) * u[0] + float(b) * u[1] for a, b in self.map)


def random_map(rng):
    """Symmetric, positive definite, of determinant one."""
    turn, stretch = rng.uniform(0.0, math.pi), math.exp(rng.normal())
    axes = np.array([[math.cos(turn), -math.sin(turn)], [math.sin(turn), math.cos(turn)]])
    return (axes * (stretch, 1.0 / stretch)) @ axes.T


def random_asked(cells, rng, *, maps=False):
    """Targets of any shape, areas, weights and walls, of cells by the set of their vertices."""
    asked = {}
    for cell in cells:
        n = len(cell)
        if n == 4:
            x, y = np.exp(rng.normal(size=2))
            shape = np.array([(0.0, 0.0), (x, 0.0), (x, y), (0.0, y)])
        else:
            shape = np.array([(0.0, 0.0), (1.0, 0.0), (rng.uniform(0.0, 1.0), rng.uniform(0.4, 2))])
        targets = {}
        for k, v in enumerate(cell):
            u, w = shape[(k + 1) % n] - shape[k], shape[k - 1] - shape[k]
            d = determinant(u, w)
            targets[v] = (w @ w / d, -(u @ w) / d, u @ u / d)
        sized = rng.random() < 0.7
        asked[frozenset(cell)] = Asked(
            targets,
            area=rng.uniform(0.3, 3.0) if sized else None,
            weight=rng.uniform(0.1, 3.0) if sized else 0.0,
            slim=rng.choice([0.0, 0.3, 0.7]),
            **({"map_": random_map(rng)} if maps else {}),
            near=rng.uniform(0.5, 1.0),
        )
    return asked


def asked_of(cell, asked) -> Asked:
    """What is asked of a cell; the ideal shape of any size where `asked` is None."""
    if asked is not None:
        return asked[frozenset(cell)]
    third = 1.0 / math.sqrt(3.0)
    target = (2.0 * third, -third, 2.0 * third) if len(cell) == 3 else (1.0, 0.0, 1.0)
    return Asked(dict.fromkeys(cell, target))


# ------------------------------------------------------------------------------- energies


def edges_at(places, cell, i):
    """Edge vectors from corner i to the next and to the previous one."""
    v, b, d = reference.corners(cell)[i]
    return tuple(
        (places[w][0] - places[v][0], places[w][1] - places[v][1]) for w in (b, d)
    )  # fmt: skip


def determinant(u, w):
    return u[0] * w[1] - u[1] * w[0]


def squared(u):
    return u[0] * u[0] + u[1] * u[1]


def squares_of(u, w, triangle):
    """What the shape energy divides by the determinant."""
    if triangle:
        return (squared(u) + squared(w) - (u[0] * w[0] + u[1] * w[1])) * (1.0 / math.sqrt(3.0))
    return (squared(u) + squared(w)) * 0.5


def badness(u, w, triangle, *, bound=False):
    """One over the corner's sine (over that of 60 degrees, in a triangle).

    With `bound` the length product |u| |w| is replaced by (|u|² t + |w|² / t) / 2, which touches it
    here and lies above it elsewhere.
    """
    uu, ww, det = squared(u), squared(w), determinant(u, w)
    if bound:
        t = math.sqrt(value(ww) / value(uu))
        g = (uu * t + ww * (1.0 / t)) * 0.5 / det
    else:
        g = (uu * ww) ** 0.5 / det
    return g * SINE_60 if triangle else g


def shape_energy(u, w, target):
    """The shape energy of a corner towards any target."""
    m11, m12, m22 = target
    n = squared(u) * m11 + (u[0] * w[0] + u[1] * w[1]) * (2.0 * m12) + squared(w) * m22
    return n * 0.5 / determinant(u, w)


def size_energy(det, area, weight):
    """Weight · ½ (τ − 1/τ)² of a corner; nothing without a weight."""
    if not weight:
        return det * 0.0
    tau = det * (1.0 / area)
    off = tau - tau**-1
    return off * off * (0.5 * weight)


def stand_in(det, soft, *, linear=False):
    """Positive everywhere, nearly `det` where that is large; with `linear`, its tangent here."""
    d = value(det)
    root = math.hypot(d, soft)
    chi = 0.5 * (d + root) if d > 0.0 else 0.5 * soft * soft / (root - d)
    if linear:
        return (det - d) * (chi / root) + chi
    return chi if not isinstance(det, Jet) else ((det * det + soft * soft) ** 0.5 + det) * 0.5


def terms(places, cells, only=None, *, bound=False, linear=False, soft=None):
    """Terms f and g of all corners in which a vertex of `only` takes part.

    A triangle has one f, and three g. With `soft` the f are those of the stand-in.
    """
    f, g = [], []
    for cell in cells:
        triangle = len(cell) == 3
        seen = False
        for i, corner in enumerate(reference.corners(cell)):
            if only is not None and not only & set(corner):
                continue
            u, w = edges_at(places, cell, i)
            det = determinant(u, w)
            if soft is not None:
                det = stand_in(det, soft, linear=linear)
            if not (triangle and seen):
                f.append(squares_of(u, w, triangle) / det)
            seen = True
            if soft is None:
                g.append(badness(u, w, triangle, bound=bound))
    return f, g


def shape_terms(places, cells, only=None, asked=None):
    """Shape and size energy, and the wall on shape, of all corners, or triangles, as in `terms`."""
    mean, walls = [], []
    for cell in cells:
        own = asked_of(cell, asked)
        for i, corner in enumerate(reference.corners(cell)):
            if only is not None and not only & set(corner):
                continue
            u, w = edges_at(places, cell, i)
            f = shape_energy(own.mapped(u), own.mapped(w), own.targets[corner[0]])
            mean.append(f + size_energy(determinant(u, w), own.area, own.weight))
            walls.append((f * own.slim) ** 16 if own.slim else f * 0.0)
            if len(cell) == 3:
                break
    return mean, walls


def star_energy(places, v, cells, mean_weight, limit, squarings, *, bound=False, asked=None):
    """Sum of mean_weight · (f and size) + (f slim)^16 + (g near / limit)^(2^squarings) around v."""
    fan = reference.fan(v, cells)
    mean, walls = shape_terms(places, fan, {v}, asked)
    wall = sum(corner_walls(places, fan, {v}, limit, squarings, bound=bound, asked=asked))
    return sum(x * mean_weight for x in mean) + sum(walls) + wall


def corner_walls(places, cells, only, limit, squarings, *, bound=False, asked=None):
    """(g near / limit)^(2^squarings) of all corners in which a vertex of `only` takes part."""
    return [
        (g * (asked_of(cell, asked).near / limit)) ** 2**squarings
        for cell in cells
        for g in terms(places, [cell], only, bound=bound)[1]
    ]


def total_energy(points, cells, movable, mean_weight, limit, squarings, *, asked=None) -> float:
    """The same over all corners that can change, plain numbers."""
    places = [(z.real, z.imag) for z in points]
    mean, walls = shape_terms(places, cells, set(movable), asked)
    wall = math.fsum(corner_walls(places, cells, set(movable), limit, squarings, asked=asked))
    return math.fsum(mean_weight * x for x in mean) + math.fsum(walls) + wall


def soft_energy(places, v, cells, soft, *, linear=False):
    """Sum of the untangling terms over the corners that v takes part in; `soft` is ε r."""
    return sum(terms(places, reference.fan(v, cells), {v}, soft=soft, linear=linear)[0])


def total_soft_energy(points, cells, movable, soft) -> float:
    places = [(z.real, z.imag) for z in points]
    return math.fsum(terms(places, cells, set(movable), soft=soft)[0])


# ------------------------------------------------------------------------------- sweeps


def places_with(points, v, z):
    """Coordinates of all vertices as pairs, those of v as given."""
    places = [(p.real, p.imag) for p in points]
    places[v] = z
    return places


def newton_step(energy: Jet) -> complex:
    return complex(*np.linalg.solve(energy.hessian, -energy.gradient))


def _sweep(points, order, at, is_safe) -> list[complex]:
    """Move each vertex to the first of the fractions of its Newton step that is downhill."""
    points = list(points)
    for v in order:
        z = points[v]
        jet = at(points, v, Jet.variables((z.real, z.imag)), True)
        step = newton_step(jet)
        for fraction in FRACTIONS:
            new = z + fraction * step
            if is_safe(points, v, new) and at(points, v, (new.real, new.imag), False) < jet.value:
                points[v] = new
                break
    return points


def keeps(points, v, cells, held) -> bool:
    """Whether the cells around v are no worse than what is held there, as `newton_sweep` has it."""
    most, least, sine, ratio, shape, edge = held
    places = [(z.real, z.imag) for z in points]
    good = True
    for cell in reference.fan(v, cells):
        ideal = asked_of(cell, None)
        lengths = [abs(points[cell[i]] - points[cell[i - 1]]) for i in range(len(cell))]
        good &= (max(lengths) / min(lengths)) ** 2 < ratio
        good &= min(lengths[0], lengths[1]) ** 2 / 2.0 > edge
        for i, corner in enumerate(reference.corners(cell)):
            if v not in corner:
                continue
            u, w = edges_at(places, cell, i)
            product = math.hypot(*u) * math.hypot(*w)
            cosine = (u[0] * w[0] + u[1] * w[1]) / product
            good &= least < cosine < most
            best = SINE_60 if len(cell) == 3 else 1.0
            good &= determinant(u, w) / (best * product) > sine
            good &= shape_energy(u, w, ideal.targets[corner[0]]) < shape
    return good


def newton_sweep(
    points, cells, order, mean_weight, limit, squarings, *, asked=None, held=None
) -> list[complex]:
    def at(points, v, z, bound):
        places = places_with(points, v, z)
        return star_energy(
            places, v, cells, mean_weight, limit, squarings, bound=bound, asked=asked
        )

    def is_safe(points, v, new):
        moved = [*points[:v], new, *points[v + 1 :]]
        if held is not None and not keeps(moved, v, cells, held):
            return False
        return all(
            reference.sign(*(moved[w] for w in corner)) > 0
            for cell in reference.fan(v, cells)
            for corner in reference.corners(cell)
            if v in corner
        )

    return _sweep(points, order, at, is_safe)


def untangle_sweep(points, cells, order, sizes, epsilon) -> list[complex]:
    def at(points, v, z, linear):
        return soft_energy(
            places_with(points, v, z), v, cells, epsilon * sizes[v], linear=linear
        )  # fmt: skip

    return _sweep(points, order, at, lambda points, v, new: True)


# ------------------------------------------------------------------------------- whole mesh


def worst_around(values, cells, rings) -> list[float]:
    """Largest value among the cells that so many steps from cell to cell across a vertex reach."""
    found = []
    for cell in cells:
        reached = {tuple(cell)}
        for _ in range(rings):
            seen = {v for other in reached for v in other}
            reached = {tuple(other) for other in cells if seen & set(other)}
        by_cell = zip(cells, values, strict=True)
        found.append(max(value for other, value in by_cell if tuple(other) in reached))
    return found


def corner_jet(u, w) -> Jet:
    """(|u|² + |w|²) / (2 det(u, w)) by its four variables."""
    ux, uy, wx, wy = Jet.variables((*u, *w))
    return squares_of((ux, uy), (wx, wy), triangle=False) / determinant((ux, uy), (wx, wy))


def semi_definite(matrix):
    """The nearest semi-definite matrix."""
    values, vectors = np.linalg.eigh(matrix)
    return (vectors * np.maximum(values, 0.0)) @ vectors.T


def size_jet(u, w, area, weight):
    """Gradient and Hessian of the size term of a corner; τ as if it were linear in the Hessian."""
    ux, uy, wx, wy = Jet.variables((*u, *w))
    det = determinant((ux, uy), (wx, wy))
    linear = Jet(det.value, det.gradient, np.zeros((4, 4)))
    size = size_energy(linear, area, weight)
    return size.gradient, size.hessian


def gradient_and_hessian(points, cells, unknowns, asked=None):
    """Of the sum of f over the corners that can change; each corner's Hessian semi-definite.

    Unknowns are the vertices of the rows; the matrix is dense.
    """
    n = 2 * len(unknowns)
    row = {v: 2 * k for k, v in enumerate(unknowns)}
    gradient, hessian = np.zeros(n), np.zeros((n, n))
    for cell in cells:
        own = asked_of(cell, asked)
        for v, b, d in reference.corners(cell)[: 1 if len(cell) == 3 else 4]:
            if not {v, b, d} & row.keys():
                continue
            # (u, w) as a linear function of the three places; the target corner (p, q) is mapped to
            # a square's.
            to = np.zeros((4, 6))
            to[:2, :2], to[:2, 2:4] = -np.eye(2), np.eye(2)
            to[2:, :2], to[2:, 4:] = -np.eye(2), np.eye(2)
            to = np.kron(np.eye(2), own.map) @ to
            _, m12, m22 = own.targets[v]
            # |p|² = m22 and p·q = -m12 at the scale where det(p, q) = 1.
            first = to[:2] / math.sqrt(m22)
            to = np.concatenate([first, math.sqrt(m22) * (to[2:] + (m12 / m22) * to[:2])])
            at = np.array([[points[w].real, points[w].imag] for w in (v, b, d)])
            u_w = to @ (at - at[0]).ravel()
            jet = corner_jet(u_w[:2], u_w[2:])
            # The maps keep areas.
            size_gradient, size_hessian = size_jet(u_w[:2], u_w[2:], own.area, own.weight)
            local_gradient = to.T @ (jet.gradient + size_gradient)
            local_hessian = to.T @ (semi_definite(jet.hessian) + size_hessian) @ to
            for i, p in enumerate((v, b, d)):
                if p not in row:
                    continue
                gradient[row[p] : row[p] + 2] += local_gradient[2 * i : 2 * i + 2]
                for j, q in enumerate((v, b, d)):
                    if q in row:
                        hessian[row[p] : row[p] + 2, row[q] : row[q] + 2] += local_hessian[
                            2 * i : 2 * i + 2, 2 * j : 2 * j + 2
                        ]
    return gradient, hessian


# ------------------------------------------------------------------------------- bounds on angles


def angle_shares(points, v, cells, movable) -> list[float]:
    """What the angle between two neighbouring fixed edges at v is for each cell in between.

    Cells at v belong together where the edge between them can move; 360 degrees where they close.
    """
    fan = reference.fan(v, cells)
    group = list(range(len(fan)))
    owners = defaultdict(list)
    for c, cell in enumerate(fan):
        for w in (cell[1], cell[-1]):
            owners[w].append(c)
    for w, pair in owners.items():
        if len(pair) == 2 and (movable[v] or movable[w]):
            old, new = group[pair[1]], group[pair[0]]
            group = [new if g == old else g for g in group]
    shares = []
    for g in set(group):
        members = [c for c in range(len(fan)) if group[c] == g]
        # A run starts at the first edge of some cell that is the last edge of no other, and so on.
        firsts = Counter(fan[c][1] for c in members)
        lasts = Counter(fan[c][-1] for c in members)
        start, stop = list((firsts - lasts).elements()), list((lasts - firsts).elements())
        if not start:
            # Closed: round a free vertex, or from the one fixed edge to itself.
            shares.append(360.0 / len(members))
            continue
        if movable[v] or movable[start[0]] or movable[stop[0]]:
            continue
        a, b = points[start[0]] - points[v], points[stop[0]] - points[v]
        if not (a and b):
            continue
        angle = math.degrees(cmath.phase(b * a.conjugate())) % 360.0
        shares.append((angle or 360.0) / len(members))
    return shares


def angle_limits(points, cells, movable):
    """Bounds on the smallest and the largest angle, each with its vertex, -1 for a cell's sum."""
    low = min(60.0 if len(cell) == 3 else 90.0 for cell in cells)
    high = max(60.0 if len(cell) == 3 else 90.0 for cell in cells)
    at_low = at_high = -1
    for v in range(len(points)):
        for share in angle_shares(points, v, cells, movable):
            if share < low - 1e-9:
                low, at_low = share, v
            if share > high + 1e-9:
                high, at_high = share, v
    return low, high, at_low, at_high


def rows_of(mesh, blocks, shapes, *figures):
    """`Rows` of blocks; per row m11, m12, m22 (n_rows, 3), then area, weight and slim (n_rows,)."""
    corners = row_corners(blocks, *mesh.topology.cells)
    of_corners = np.ones((mesh.cell_vertices.size, 3))
    of_corners[corners] = shapes
    of_cells = np.zeros((len(figures), mesh.n_cells))
    of_cells[:, blocks.cells] = figures
    return make_rows(blocks, corners, of_corners, *of_cells, np.ones(mesh.n_cells))
