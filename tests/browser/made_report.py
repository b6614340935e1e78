"""A report of a made-up grid, as the page of the package takes it, without smoothing anything."""

import base64
import gzip
import json
from html import escape
from pathlib import Path

import numpy as np

ASSETS = Path(__file__).resolve().parents[2] / "src" / "qsmooth" / "output" / "report" / "assets"
NAMES = ("min_angle", "max_angle", "scaled_jacobian", "aspect_ratio")
METRICS = [
    {
        "name": "min_angle",
        "label": "smallest angle",
        "unit": "°",
        "better": "higher",
        "range": [0, 90],
    },
    {
        "name": "max_angle",
        "label": "largest angle",
        "unit": "°",
        "better": "lower",
        "range": [90, 360],
    },
    {
        "name": "scaled_jacobian",
        "label": "scaled Jacobian",
        "unit": "",
        "better": "higher",
        "range": [-1, 1],
    },
    {"name": "aspect_ratio", "label": "aspect ratio", "unit": "", "better": "lower", "range": None},
]


def grid(n):
    """The corners of n by n quads, row by row."""
    at = np.arange((n + 1) ** 2, dtype=np.uint32).reshape(n + 1, n + 1)
    return np.stack([at[:-1, :-1], at[:-1, 1:], at[1:, 1:], at[1:, :-1]], axis=-1).reshape(-1, 4)


def places(n, jitter, seed=1):
    """A grid whose inner vertices are off their places by a share of a cell."""
    v, u = np.meshgrid(np.arange(n + 1.0), np.arange(n + 1.0), indexing="ij")
    uv = np.stack([u, v], axis=-1)
    shifts = np.random.default_rng(seed).uniform(-jitter, jitter, (n - 1, n - 1, 2))
    uv[1:-1, 1:-1] += shifts
    return (uv.reshape(-1, 2) / n).astype(np.float32)


def figures(uv, quads):
    """The four metrics of each quad, in NumPy."""
    corners = uv[quads].astype(float)
    ahead = np.roll(corners, -1, axis=1) - corners
    back = np.roll(corners, 1, axis=1) - corners
    cross = ahead[..., 0] * back[..., 1] - ahead[..., 1] * back[..., 0]
    dot = (ahead * back).sum(axis=-1)
    angles = np.degrees(np.arctan2(cross, dot)) % 360.0
    lengths = np.linalg.norm(ahead, axis=-1)
    jacobians = (cross / (lengths * np.roll(lengths, 1, axis=1))).min(axis=1)
    ratio = lengths.max(axis=1) / lengths.min(axis=1)
    ratio[0] = np.inf  # as of a cell that has collapsed
    return dict(zip(NAMES, (angles.min(1), angles.max(1), jacobians, ratio), strict=True))


class Arrays:
    """Arrays as elements of a page."""

    def __init__(self):
        self.records, self.elements = [], []

    def add(self, values, kind, delta=False):
        flat = (
            np.ascontiguousarray(values)
            .ravel()
            .astype({"f4": "<f4", "u4": "<u4", "u1": "u1"}[kind])
        )
        stored = np.diff(flat, prepend=flat.dtype.type(0)) if delta else flat
        planes = kind != "u1"
        raw = stored.view(np.uint8).reshape(-1, 4).T.tobytes() if planes else stored.tobytes()
        text = base64.b64encode(gzip.compress(raw, 1)).decode()
        k = len(self.records)
        self.records.append({"type": kind, "length": len(flat), "planes": planes, "delta": delta})
        self.elements.append(
            f'<script id="array-{k}" type="application/octet-stream">{text}</script>'
        )
        return k


def worst_cells(found, ids):
    listed = []
    for name, ends in (("max_angle", -1), ("min_angle", 1)):
        for cell in np.argsort(ends * found[name], kind="stable")[:10]:
            values = {
                key: float(v[cell]) if np.isfinite(v[cell]) else None for key, v in found.items()
            }
            why = f"nothing proven of cell <{ids[cell]}>"
            listed.append({"cell": int(ids[cell]), "values": values, "metric": name, "why": why})
    return listed


def state(name, label, uv, quads, ids, arrays):
    found = figures(uv, quads)
    history = {"names": ["min_angle"], "rows": {"min_angle": [10.0, 30.0, None, 41.0, 42.5]}}
    return {
        "name": name,
        "label": label,
        "points": arrays.add(uv, "f4"),
        "values": {key: arrays.add(values, "f4") for key, values in found.items()},
        "n_invalid": int((found["scaled_jacobian"] <= 0).sum()),
        "seconds": 0.5,
        "sweeps": 4,
        "reason": "It stopped <b>here</b>.",
        "worst": worst_cells(found, ids),
        "history": None if name == "before" else history,
        "promised": ["A valid mesh stays valid."],
        "traded": [],
        "sizes": ["The shortest edge is 0.9 of what it was."],
    }, found


def make(path, n, jitter=0.45):
    """Write a report of n by n quads; gives its ids, corners, and places and figures by state."""
    arrays, quads = Arrays(), grid(n)
    ids = np.random.default_rng(3).permutation(len(quads)).astype(np.uint32)
    states, truth = [], {}
    for name, label, share in (("before", "Before", jitter), ("star", "By star", jitter / 4)):
        uv = places(n, share)
        made, found = state(name, label, uv, quads, ids, arrays)
        states.append(made)
        truth[name] = {"uv": uv, "figures": found}
    data = {
        "version": 1,
        "title": f"grid of {n} by {n} </script>",
        "program": "qsmooth",
        "n_vertices": (n + 1) ** 2,
        "n_cells": n * n,
        "origin": [0, 0],
        "scale": 1,
        "cells": {
            "n_triangles": 0,
            "triangles": None,
            "n_quads": n * n,
            "quads": arrays.add(quads, "u4", delta=True),
            "ids": arrays.add(ids, "u4"),
        },
        "fixed": None,
        "metrics": [{**metric, "log": metric["name"] == "aspect_ratio"} for metric in METRICS],
        "states": states,
        "usual": 1,
        "table": {
            "columns": ["", "before", "star"],
            "rows": [["smallest angle", "1.0°", "42.5°"]],
            "best": [[0, 2]],
        },
        "arrays": arrays.records,
    }
    write(path, data, arrays.elements)
    return {"ids": ids, "quads": quads, **truth}


def write(path, data, elements):
    def assets(ending):
        found = sorted(ASSETS.glob(f"*{ending}"), key=lambda file: file.name)
        return "\n".join(file.read_text(encoding="utf-8") for file in found)

    page = assets(".html").replace("<!--TITLE-->", escape(data["title"]))
    page = page.replace("/*STYLE*/", assets(".css")).replace("/*SCRIPT*/", assets(".js"))
    page = page.replace("/*DATA*/", json.dumps(data, allow_nan=False).replace("<", "\\u003c"))
    Path(path).write_text(page.replace("<!--ARRAYS-->", "\n".join(elements)), encoding="utf-8")
