"""Figures of meshes as the tables of real files have them, and what may change in a file."""

import re

import numpy as np


def figures(points: np.ndarray, blocks: list[np.ndarray]) -> dict[str, float]:
    """Angles, aspects and shapes, each cell by its own orientation."""
    angles, aspects, concave, crossed = [], [], 0, 0
    for cells in blocks:
        p = points[cells]
        edges = np.roll(p, -1, axis=1) - p
        lengths = np.linalg.norm(edges, axis=-1)
        with np.errstate(divide="ignore", invalid="ignore"):
            aspects.append(lengths.max(axis=1) / lengths.min(axis=1))
        back = -np.roll(edges, 1, axis=1)
        dot = (edges * back).sum(axis=-1)
        if points.shape[1] == 3:
            sine = np.linalg.norm(np.cross(edges, back), axis=-1)
            angle = np.degrees(np.arctan2(sine, dot))
        else:
            sine = edges[..., 0] * back[..., 1] - edges[..., 1] * back[..., 0]
            x, y = p[..., 0] - p[:, :1, 0], p[..., 1] - p[:, :1, 1]
            area = (x * np.roll(y, -1, axis=1) - np.roll(x, -1, axis=1) * y).sum(axis=1)
            sine = sine * np.where(area < 0, -1.0, 1.0)[:, None]
            angle = np.degrees(np.arctan2(sine, dot)) % 360
        angles.append(angle)
        if cells.shape[1] == 4 and points.shape[1] == 2:
            crossed += int(opposite_edges_cross(p).sum())
            concave += int((angle > 180 + 1e-9).any(axis=1).sum())
    every = np.concatenate([a.ravel() for a in angles])
    aspect = np.concatenate(aspects)
    return {
        "min": every.min(),
        "max": every.max(),
        "aspect": aspect.max(),
        "mean": aspect[np.isfinite(aspect)].mean(),
        "concave": concave,
        "crossed": crossed,
    }


def opposite_edges_cross(p: np.ndarray) -> np.ndarray:
    def side(a, b, c):
        return np.sign(
            (b[:, 0] - a[:, 0]) * (c[:, 1] - a[:, 1]) - (b[:, 1] - a[:, 1]) * (c[:, 0] - a[:, 0])
        )

    def meet(a, b, c, d):
        return (side(a, b, c) * side(a, b, d) < 0) & (side(c, d, a) * side(c, d, b) < 0)

    a, b, c, d = (p[:, i] for i in range(4))
    return meet(a, b, c, d) | meet(b, c, d, a)


def close(found: float, shown: str) -> bool:
    """Whether a number agrees with one rounded to the digits shown."""
    if shown == "inf":
        return bool(np.isinf(found))
    if "e" in shown:
        return f"{found:.2e}"[:4] == f"{float(shown):.2e}"[:4]
    return abs(found - float(shown)) <= 0.0051


def assert_only_coordinates_differ(old: bytes, new: bytes, n_moved: int) -> None:
    before, after = old.splitlines(keepends=True), new.splitlines(keepends=True)
    assert len(before) == len(after)
    differ = 0
    for a, b in zip(before, after, strict=True):
        if a != b and not a.startswith(b"POINTS"):
            x, y = re.split(rb"[\s,]+", a.strip()), re.split(rb"[\s,]+", b.strip())
            assert len(x) == len(y)
            assert re.sub(rb"[^\s,]+", b"", a) == re.sub(rb"[^\s,]+", b"", b)  # same spaces
            differ += 1
    assert differ <= n_moved
