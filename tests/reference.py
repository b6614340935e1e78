"""Slow, obvious versions of what the kernels do, to agree with.

Points are complex numbers, cells are lists of vertex ids that run counter-clockwise, signs come
from fractions. Nothing here is shared with the package.
"""

import cmath
import math
from collections import defaultdict
from dataclasses import dataclass, field
from fractions import Fraction

VALID, COLLAPSED, CONCAVE, CROSSED, INVERTED = range(5)


# ------------------------------------------------------------------------------- conversions


def as_complex(xy) -> list[complex]:
    return [complex(x, y) for x, y in xy]


def as_lists(mesh) -> list[list[int]]:
    """Cells of a `qsmooth.Mesh`, running alike."""
    return [
        mesh.cell_vertices[a:b].tolist()
        for a, b in zip(mesh.cell_offsets[:-1], mesh.cell_offsets[1:], strict=True)
    ]


# ------------------------------------------------------------------------------- connectivity


def sides(cell):
    return list(zip(cell, cell[1:] + cell[:1], strict=True))


def stars(cells, n_vertices):
    return [[c for c, cell in enumerate(cells) if v in cell] for v in range(n_vertices)]


def edges(cells):
    """Cells on each edge."""
    found = defaultdict(list)
    for c, cell in enumerate(cells):
        for v, w in sides(cell):
            found[frozenset((v, w))].append(c)
    return found


def rings(cells, n_vertices):
    neighbours = [set() for _ in range(n_vertices)]
    for v, w in map(tuple, edges(cells)):
        neighbours[v].add(w)
        neighbours[w].add(v)
    return [sorted(n) for n in neighbours]


def boundary(cells, n_vertices):
    ends = {v for edge, owners in edges(cells).items() if len(owners) == 1 for v in edge}
    return [v in ends for v in range(n_vertices)]


def interface(cells, regions, n_vertices):
    ends = {
        v
        for edge, owners in edges(cells).items()
        if len({regions[c] for c in owners}) > 1
        for v in edge
    }
    return [v in ends for v in range(n_vertices)]


def fan(v, cells):
    """The cells at v, each turned to begin with v."""
    return [cell[cell.index(v) :] + cell[: cell.index(v)] for cell in cells if v in cell]


# ------------------------------------------------------------------------------- exact signs


def determinant(a: complex, b: complex, c: complex) -> Fraction:
    """Twice the signed area of a triangle, exactly."""
    ax, ay, bx, by, cx, cy = (Fraction(t) for t in (a.real, a.imag, b.real, b.imag, c.real, c.imag))
    return (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)


def sign(a: complex, b: complex, c: complex) -> int:
    d = determinant(a, b, c)
    return (d > 0) - (d < 0)


def corners(cell):
    """Each corner with its next and its previous one."""
    n = len(cell)
    return [(cell[i], cell[(i + 1) % n], cell[i - 1]) for i in range(n)]


def corner_signs(points, cell) -> list[int]:
    return [sign(points[v], points[b], points[d]) for v, b, d in corners(cell)]


def validity(points, cell) -> int:
    signs = corner_signs(points, cell)
    n_negative, n_zero = signs.count(-1), signs.count(0)
    if len(cell) == 3:
        return INVERTED if n_negative else COLLAPSED if n_zero else VALID
    if n_negative >= 3:
        return INVERTED
    if n_negative == 2 or (n_negative == 1 and n_zero):
        return CROSSED
    if n_negative == 1:
        return CONCAVE
    return COLLAPSED if n_zero else VALID


# ------------------------------------------------------------------------------- metrics


def corner_angle(v: complex, b: complex, d: complex) -> float:
    """Degrees in [0, 360) from the next vertex b round to the previous vertex d; None undefined."""
    if v in (b, d):
        return None
    angle = math.degrees(cmath.phase((d - v) * (b - v).conjugate()))
    return angle % 360.0 if angle % 360.0 < 360.0 else 0.0


def angles(points, cell) -> list[float]:
    return [corner_angle(points[v], points[b], points[d]) or 0.0 for v, b, d in corners(cell)]


def aspect_ratio(points, cell) -> float:
    lengths = [abs(points[w] - points[v]) for v, w in sides(cell)]
    return max(lengths) / min(lengths) if min(lengths) else math.inf


def scaled_jacobian(points, cell) -> float:
    """Sine of the worst corner, over sin 60° in a triangle; 0 at an edge of no length."""
    sines = []
    for v, b, d in corners(cell):
        u, w = points[b] - points[v], points[d] - points[v]
        area = (u.conjugate() * w).imag
        sines.append(area / (abs(u) * abs(w)) if u and w else 0.0)
    return min(sines) / (math.sin(math.radians(60)) if len(cell) == 3 else 1.0)


def shape(points, cell) -> float:
    values = []
    for v, b, d in corners(cell):
        u, w = points[b] - points[v], points[d] - points[v]
        det = (u.conjugate() * w).imag
        if len(cell) == 3:
            squares = abs(u) ** 2 + abs(w) ** 2 + abs(w - u) ** 2
            values.append(2 * math.sqrt(3) * det / squares if squares else 0.0)
        else:
            squares = abs(u) ** 2 + abs(w) ** 2
            values.append(2 * det / squares if squares else 0.0)
    return max(0.0, min(values))


def area(points, cell) -> float:
    return 0.5 * sum((points[v].conjugate() * points[w]).imag for v, w in sides(cell))


# ------------------------------------------------------------------------------- guards


def guard_lines(points, v, cells):
    """Lines (p, q) that v must be on the left of; those of no length are left out."""
    lines = []
    for cell in fan(v, cells):
        if len(cell) == 3:
            _, a, c = cell
            lines.append((a, c))
        else:
            _, a, b, c = cell
            lines += [(a, b), (b, c), (a, c)]
    return [(points[p], points[q]) for p, q in lines if points[p] != points[q]]


def left_of(p: complex, q: complex, z: complex) -> float:
    """Signed distance of z from the line p→q, positive on its left."""
    return ((q - p).conjugate() * (z - p)).imag / abs(q - p)


def clearance(lines, z: complex) -> float:
    return min((left_of(p, q, z) for p, q in lines), default=math.inf)


def tolerance(points, v, cells) -> float:
    """What a clearance may fall by: section 3's τ."""
    star = fan(v, cells)
    longest = max(abs(points[w] - points[v]) for cell in star for w in (cell[1], cell[-1]))
    largest = max(abs(t) for cell in star for w in cell for t in (points[w].real, points[w].imag))
    return max(1e-12 * longest, 16.0 * math.ulp(largest))


def loses_a_corner(points, v, cells, z: complex) -> bool:
    moved = dict(enumerate(points)) | {v: z}
    return any(
        before > 0 >= after
        for cell in fan(v, cells)
        for before, after in zip(corner_signs(points, cell), corner_signs(moved, cell), strict=True)
    )


def star_score(points, v, cells, z: complex) -> float:
    moved = dict(enumerate(points)) | {v: z}
    return min(scaled_jacobian(moved, cell) for cell in fan(v, cells))


# ------------------------------------------------------------------------------- moves


@dataclass
class Options:
    """Those of a sweep; `good` is None for the clearance guard."""

    max_angle: float = 120.0
    min_angle: float = 60.0
    triangle_max_angle: float = 90.0
    triangle_min_angle: float = 45.0
    step: float = 0.5
    good: float | None = None
    active: set[int] | None = field(default=None)

    def thresholds(self, cell) -> tuple[float, float]:
        if len(cell) == 3:
            return self.triangle_max_angle, self.triangle_min_angle
        return self.max_angle, self.min_angle


def half_tangent(angle: float) -> float:
    return math.tan(0.5 * math.radians(angle))


def proposals(points, cell, options, by_quad):
    """All moves that one cell proposes, as (vertex, place)."""
    found = []
    step = options.step
    for v, b, d in corners(cell):
        z, p, q = points[v], points[b], points[d]
        length = abs(q - p)
        if length == 0.0:
            continue
        along = (q - p) / length
        normal = 1j * along  # to the left of p→q, where v belongs
        height = left_of(p, q, z)
        angle = corner_angle(z, p, q)
        largest, smallest = options.thresholds(cell)
        if angle is not None:
            for threshold, too_large in ((largest, True), (smallest, False)):
                if not (angle > threshold if too_large else angle < threshold):
                    continue
                # Move 1: push or pull along the normal of the diagonal.
                wanted = 0.5 * length / half_tangent(threshold)
                if height < wanted if too_large else height > wanted:
                    found.append((v, z + step * (wanted - height) * normal))
                # Move 2: shrink or elongate the diagonal.
                if by_quad and len(cell) == 4:
                    wanted = 2.0 * abs(height) * half_tangent(threshold)
                    if length > wanted if too_large else length < wanted:
                        shift = 0.5 * step * (length - wanted)
                        shift = max(-0.5 * step * length, min(0.5 * step * length, shift))
                        found.append((b, p + shift * along))
                        found.append((d, q - shift * along))
        # Move 3: even out.
        way = ((0.5 * (p + q) - z) * along.conjugate()).real
        found.append((v, z + step * way * along))
    return found


def mean_of_accepted(points, v, cells, places) -> complex:
    """The mean of the places that keep the clearance; the present one where there is none."""
    tau = tolerance(points, v, cells)
    lines = guard_lines(points, v, cells)
    least = clearance(lines, points[v]) - tau
    accepted = [z for z in places if abs(z - points[v]) >= tau and clearance(lines, z) >= least]
    if not accepted:
        return points[v]
    return points[v] + sum(z - points[v] for z in accepted) / len(accepted)


def allowed(points, v, cells, target, options, check_clearance=False) -> complex:
    """The whole step, a half, a quarter, an eighth: the first that every guard allows."""
    z = points[v]
    lines = guard_lines(points, v, cells)
    least = clearance(lines, z) - tolerance(points, v, cells)
    for share in (1.0, 0.5, 0.25, 0.125):
        new = z + share * (target - z)
        if check_clearance and clearance(lines, new) < least:
            continue
        if loses_a_corner(points, v, cells, new):
            continue
        if options.good is not None:
            score = star_score(points, v, cells, new)
            if score < options.good and score < star_score(points, v, cells, z):
                continue
        return new
    return z


def star_sweep(points, cells, order, options) -> list[complex]:
    """By star: each vertex in turn, in place."""
    points = list(points)
    for v in order:
        places = [
            place
            for c, cell in enumerate(cells)
            if v in cell and (options.active is None or c in options.active)
            for w, place in proposals(points, cell, options, by_quad=False)
            if w == v
        ]
        target = mean_of_accepted(points, v, cells, places)
        points[v] = allowed(points, v, cells, target, options)
    return points


def quad_sweep(points, cells, order, options) -> list[complex]:
    """By quad: all cells propose from the same positions, then the vertices follow."""
    places = defaultdict(list)
    for c, cell in enumerate(cells):
        if options.active is None or c in options.active:
            for v, place in proposals(points, cell, options, by_quad=True):
                places[v].append(place)
    steps = {v: mean_of_accepted(points, v, cells, places[v]) - points[v] for v in order}
    points = list(points)
    for v in order:
        points[v] = allowed(points, v, cells, points[v] + steps[v], options, check_clearance=True)
    return points


def laplacian_sweep(points, cells, order) -> list[complex]:
    ring = rings(cells, len(points))
    new = list(points)
    for v in order:
        new[v] = sum(points[w] for w in ring[v]) / len(ring[v])
    return new


def smart_laplacian_sweep(points, cells, order, options) -> list[complex]:
    ring = rings(cells, len(points))
    points = list(points)
    for v in order:
        target = sum(points[w] for w in ring[v]) / len(ring[v])
        points[v] = allowed(points, v, cells, target, options)
    return points


def worst_cells(points, cells, fraction) -> set[int]:
    """The share of cells with the largest angles, the worst group."""
    ranked = sorted(range(len(cells)), key=lambda c: -max(angles(points, cells[c])))
    return set(ranked[: math.ceil(fraction * len(cells))])
