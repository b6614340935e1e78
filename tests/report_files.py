"""A report's file read back, as its script does it."""

import base64
import gzip
import json
import re

import numpy as np


def read_report(path):
    """Facts of a report, and its arrays."""
    text = path.read_text(encoding="utf-8")
    facts = json.loads(re.search(r'<script id="data"[^>]*>(.*?)</script>', text, re.DOTALL)[1])
    found = re.findall(r'<script id="array-(\d+)"[^>]*>(.*?)</script>', text, re.DOTALL)
    assert [int(k) for k, _ in found] == list(range(len(facts["arrays"])))
    return facts, [_array(facts["arrays"][int(k)], packed) for k, packed in found]


def _array(spec, text):
    data = np.frombuffer(gzip.decompress(base64.b64decode(text)), np.uint8)
    kind = np.dtype("<" + spec["type"])
    if spec.get("planes"):
        data = data.reshape(kind.itemsize, spec["length"]).T
    array = np.ascontiguousarray(data).reshape(-1).view(kind)
    assert array.size == spec["length"]
    return np.cumsum(array, dtype=kind) if spec.get("delta") else array


def state_arrays(facts, arrays, k):
    """Places, (n, 2), of a state and its figures by name in the caller's order of cells."""
    state = facts["states"][k]
    uv = arrays[state["points"]].reshape(-1, 2).astype(float)
    ids = facts["cells"]["ids"]
    order = np.arange(facts["n_cells"]) if ids is None else arrays[ids]
    figures = {}
    for name, at in state["values"].items():
        figures[name] = np.empty(facts["n_cells"])
        figures[name][order] = arrays[at]
    return np.array(facts["origin"]) + facts["scale"] * uv, figures
