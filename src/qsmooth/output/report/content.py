"""What a report holds: facts for its script, and arrays."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import fields
from importlib import import_module
from typing import Any

import numpy as np

from qsmooth._types import FloatArray, IndexArray
from qsmooth._words import capitalised
from qsmooth.metrics import METRICS, Validity
from qsmooth.metrics.summary import figure_sections, size_text
from qsmooth.output.report import telling
from qsmooth.output.report.holding import Holding, worst_cells
from qsmooth.output.report.packing import Packed
from qsmooth.output.report.states import State
from qsmooth.result import SweepRecord
from qsmooth.table import Row, Section, best_columns, time_text
from qsmooth.wording import reason

# How many of the worst cells are listed, by each of these.
WORST, WORST_BY = 10, ("max_angle", "min_angle", "aspect_ratio")
# Areas are held in single precision.
LARGEST = float(np.finfo(np.float32).max)
AREA = {"name": "area", "label": "area", "unit": "", "better": "higher", "range": None, "log": True}
CHANGE = {**AREA, "name": "area_change", "label": "area over what it was"}


class Content:
    """Facts and arrays of a report.

    Parameters
    ----------
    states
        The first is what all others are compared with.
    title
        What stands above.
    metrics
        What cells are coloured by.
    notes
        Sentences under the table.
    spell
        How an option is written, as in `wording.reason`.

    Attributes
    ----------
    facts, packed
        For the page.
    """

    def __init__(
        self,
        states: Sequence[State],
        title: str,
        metrics: tuple[str, ...],
        notes: Sequence[str],
        spell: Callable[[str], str],
    ) -> None:
        self.packed, self.states, self.metrics, self.spell = Packed(), states, metrics, spell
        mesh = states[0].mesh
        self.order = np.argsort(mesh.topology.cell_sizes, kind="stable")
        low, high = _box(states)
        self.origin = low + 0.5 * (high - low)
        self.scale = float((high - low).max()) / 2.0 or 1.0
        summary = states[0].quality.summary()
        self.facts: dict[str, Any] = {
            "version": 1,
            "title": title or getattr(mesh.source, "file", "") or size_text(summary),
            "size": size_text(summary),
            "program": f"qsmooth {import_module('qsmooth').__version__}",
            "n_vertices": mesh.n_vertices,
            "n_cells": mesh.n_cells,
            "origin": self.origin.tolist(),
            "scale": self.scale,
            "cells": self._cells(),
            "fixed": self.packed.marks(~states[0].movable),
            "metrics": self._metrics(),
            "states": [self._state(state) for state in states],
            "usual": 1 if len(states) > 1 else 0,
            "table": table(states),
            "notes": list(notes),
            "arrays": self.packed.specs,
        }

    def _cells(self) -> dict[str, Any]:
        topology, packed, order = self.states[0].mesh.topology, self.packed, self.order
        first = topology.cell_offsets[:-1]
        corners: dict[int, IndexArray] = {
            n: topology.cell_vertices[first[topology.cell_sizes == n][:, None] + np.arange(n)]
            for n in (3, 4)
        }
        same = bool((np.diff(order) == 1).all())
        return {
            "n_triangles": len(corners[3]),
            "triangles": packed.ids(corners[3]),
            "n_quads": len(corners[4]),
            "quads": packed.ids(corners[4]),
            "ids": None if same else packed.ids(order),
        }

    def _metrics(self) -> list[dict[str, Any]]:
        listed = [_described(name) for name in self.metrics]
        if self._has_areas():
            listed.append(AREA)
            listed += [CHANGE] if len(self.states) > 1 else []
        return listed

    def _has_areas(self) -> bool:
        areas = [np.abs(state.quality.area).max() for state in self.states]
        return bool(1.0 / LARGEST < max(areas) < LARGEST)

    def _values(self, state: State) -> dict[str, int]:
        figures: dict[str, FloatArray] = {name: state.quality[name] for name in self.metrics}
        if self._has_areas():
            figures["area"] = state.quality.area
            if state is not self.states[0]:
                figures["area_change"] = telling.area_change(self.states[0], state)
        return {name: self.packed.figures(v[self.order]) for name, v in figures.items()}

    def _placed(self, xy: FloatArray) -> FloatArray:
        placed: FloatArray = (xy - self.origin) / self.scale
        return placed

    def _state(self, state: State) -> dict[str, Any]:
        before, result = self.states[0], state.result
        is_first = state is before
        worst = worst_cells(state, Holding(state, before), WORST_BY, self.metrics, WORST)
        for cell in worst:
            cell["place"] = self._placed(np.asarray(cell["place"])).tolist()
        return {
            "name": state.name,
            "label": state.label,
            "points": self.packed.places(self._placed(state.mesh.xy)),
            "values": self._values(state),
            "summary": state.quality.summary(self.metrics).to_dict(),
            "n_invalid": state.quality.n_invalid,
            "invalid": self.packed.marks(state.quality.validity[self.order] != Validity.VALID),
            "seconds": None if result is None else result.seconds,
            "sweeps": None if result is None else result.sweeps,
            "reason": self._reason(state),
            "worst": worst,
            "history": _history(state),
            "traded": _sentences(telling.traded(state, self.spell)),
            "promised": [] if is_first else _sentences(telling.promised(before, state)),
            "sizes": [] if is_first else _sentences(telling.sizes(before, state)),
            "limits": _sentences(telling.limits(before, state)),
        }

    def _reason(self, state: State) -> str:
        if state.result is None:
            return ""
        text = reason(state.result.outcome, spell=self.spell, limits=False)
        return f"{capitalised(text)}." if text else ""


def table(states: Sequence[State]) -> dict[str, Any]:
    """Lay out the states side by side, with the rows of ``qsmooth compare``."""
    sections = figure_sections([state.quality.summary() for state in states], mark=True)
    if any(state.result is not None for state in states):
        sections.insert(0, _effort(states))
    rows: list[list[str]] = []
    best: list[list[int]] = []
    for row in (row for section in sections for row in section.rows):
        best += [[len(rows), 1 + k] for k in sorted(row.best)]
        rows.append([row.label.strip(), *row.cells])
    return {"columns": ["", *(state.label for state in states)], "rows": rows, "best": best}


def _effort(states: Sequence[State]) -> Section:
    results = [state.result for state in states]
    seconds = ["" if r is None else time_text(r.seconds) for r in results]
    known = [k for k, r in enumerate(results) if r is not None]
    quickest = best_columns(
        [r.seconds for r in results if r is not None],
        [seconds[k] for k in known],
        higher_is_better=False,
    )
    return Section(
        "Effort",
        (
            Row("Time of the sweeps", tuple(seconds), frozenset(known[k] for k in quickest)),
            Row("Sweeps", tuple("" if r is None else str(r.sweeps) for r in results)),
            Row(
                "Stopped by itself",
                tuple("" if r is None else "yes" if r.converged else "no" for r in results),
            ),
        ),
        marked=True,
    )


def _described(name: str) -> dict[str, Any]:
    """Say what the script has to know of a metric."""
    metric = METRICS[name]
    ends = [metric.ideal, metric.worst_colour]
    known = None if None in ends else sorted(float(end) for end in ends if end is not None)
    return {
        "name": name,
        "label": metric.words,
        "unit": metric.degrees,
        "better": "higher" if metric.higher_is_better else "lower",
        "range": known,
        "log": False,
        "definition": metric.explanation,
    }


def _history(state: State) -> dict[str, Any] | None:
    if state.result is None or not state.result.history:
        return None
    names = [f.name for f in fields(SweepRecord)]
    return {"names": names, "rows": {n: state.result.history[n].tolist() for n in names}}


def _sentences(texts: Sequence[str]) -> list[str]:
    return [f"{capitalised(text)}." for text in texts]


def _box(states: Sequence[State]) -> tuple[FloatArray, FloatArray]:
    """Lower left and upper right corner of all states, without vertices that are in no cell."""
    used = states[0].mesh.topology.used
    low = np.min([state.mesh.xy[used].min(axis=0) for state in states], axis=0)
    high = np.max([state.mesh.xy[used].max(axis=0) for state in states], axis=0)
    return low, high
