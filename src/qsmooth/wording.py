"""Every sentence that is made from an outcome; nothing reads one back."""

from __future__ import annotations

import math
from collections.abc import Callable

from qsmooth._words import in_a_row, plural
from qsmooth.outcome import (
    Aim,
    Carried,
    Held,
    Invalid,
    Outcome,
    Sizes,
    Sliding,
    Stage,
    Stop,
    Target,
    Trade,
)

# Figures in words, and how they are written.
_FIGURES: dict[str, tuple[str, str]] = {
    "min_angle": ("smallest angle", "{:.1f}°"),
    "max_angle": ("largest angle", "{:.1f}°"),
    "scaled_jacobian": ("smallest scaled Jacobian", "{:.3g}"),
    "aspect_ratio": ("largest aspect ratio", "{:.3g}"),
    "shape": ("smallest shape", "{:.3g}"),
    "min_edge": ("shortest edge", "{:.3g}"),
    "mean_shape": ("mean shape", "{:.3f}"),
    "target": ("mean quality towards the target", "{:.3f}"),
}
_TARGETS = {
    "squares": "ideal shapes beside layers and gradings as they are",
    "ratios": "rectangles",
    "initial": "the cells as they were, with right angles",
    "metric": "the metric",
}
# An outline that has moved by less than this share of an edge has not.
ROUNDING = 1e-9
# So many of the values that belong to places are named.
MOST_NAMED = 5
UNCHANGED = "already as good as this method gets: unchanged"


def reason(outcome: Outcome, *, spell: Callable[[str], str] = str, limits: bool = True) -> str:
    """Say what was done, why it stopped and what is wrong with the result, in one line.

    Parameters
    ----------
    spell
        How an option is written: "max_sweeps" in Python, "--max-sweeps" in a shell.
    limits
        Whether to add the limits of the angles.
    """
    parts = []
    if outcome.chosen:
        parts.append(f"auto chose {outcome.method}{outcome.chosen}")
    if outcome.cut is not None:
        cut = outcome.cut
        parts.append(
            f"{plural(cut.quads, 'quad was', 'quads were')} smoothed as two triangles each, cut "
            f"along the {cut.diagonal} diagonal, which broke {cut.broken or 'none'} of them"
        )
    if not outcome.unchanged:
        parts += _done(outcome)
        parts += [*towards(outcome.target), *_sizes(outcome.sizes, outcome.trades)]
        parts += _slid(outcome.sliding)
    parts += _without_effect(outcome.sliding)
    parts += [*given_up(outcome, spell), *_why(outcome, spell)]
    parts += _not_valid(outcome)
    parts += _carried([record for record in outcome.carried if record.largest > 0.0], spell)
    if limits and outcome.limits is not None:
        parts += str(outcome.limits).splitlines()
    return "; ".join(parts)


def _done(outcome: Outcome) -> list[str]:
    """What the stages with an aim of their own did; of plain sweeps it says why they stopped."""
    said: dict[Aim, Callable[[Stage, Outcome], str]] = {
        Aim.UNTANGLE: _untangled,
        Aim.MEAN_SHAPE: _improved,
        Aim.WORST_CELLS: _mended,
    }
    texts = [said[stage.aim](stage, outcome) for stage in outcome.stages if stage.aim in said]
    return [text for text in texts if text]


def _untangled(stage: Stage, outcome: Outcome) -> str:
    invalid = outcome.invalid
    if invalid is None or invalid.after:
        return ""
    return f"untangled {plural(invalid.before, 'cell')} in {plural(stage.sweeps, 'sweep')}"


def _improved(stage: Stage, _: Outcome) -> str:
    steps = f" and {plural(stage.steps, 'Newton step')} on the whole mesh" if stage.steps else ""
    return f"improved the mean shape in {plural(stage.sweeps, 'sweep')}{steps}"


def _mended(stage: Stage, _: Outcome) -> str:
    if not stage.sweeps:
        return ""
    return f"then the worst cells in {plural(stage.sweeps, 'sweep')}"


def given_up(outcome: Outcome, spell: Callable[[str], str]) -> list[str]:
    """What got worse for something else, and what could have been had for that."""
    said = []
    by_gain: dict[str, list[Trade]] = {}
    for trade in outcome.trades:
        by_gain.setdefault(trade.gained, []).append(trade)
    for trades in by_gain.values():
        text = in_a_row([_change(t.figure, t.before, t.after) for t in trades])
        gained = trades[0].gained
        if gained:
            gain = _change(gained, trades[0].gained_before, trades[0].gained_after, " of")
            text += f", for {'an' if gain[0] in 'aeiou' else 'a'} {gain}"
        said.append(text)
        if held := [t.figure for t in trades if t.figure != "mean_shape"]:
            them = "it" if len(held) == 1 else "them"
            listed = ",".join(held)
            said.append(f"hold {them} with " + spell(f"hold='{listed}'"))
    if outcome.forbidden is not None:
        said.append(
            "the worst cells could be better (smallest scaled Jacobian "
            f"{outcome.forbidden.scaled_jacobian:.2f}), but at a cost to the mean shape that "
            f"{spell('mean_loss')}={outcome.forbidden.mean_loss:g} forbids"
        )
    said += [kept_back(held) for held in outcome.held]
    return said


def kept_back(held: Held) -> str:
    """Where what is held kept something from getting better."""
    name, form = _FIGURES[held.figure]
    places = "a better place" if held.vertices == 1 else "better places"
    return (
        f"the {name}, held at {form.format(held.value)}, keeps "
        f"{plural(held.vertices, 'vertex', 'vertices')} from {places}, as at cell {held.cell}"
    )


def _change(figure: str, before: float, after: float, of: str = "") -> str:
    """A figure before and after: "largest aspect ratio 20 -> 33"."""
    name, form = _FIGURES[figure]
    return f"{name}{of} {form.format(before)} -> {form.format(after)}"


def towards(target: Target | None) -> list[str]:
    """How near the cells are to what they are meant to be, where that is not the ideal shape."""
    if target is None or target.kind == "ideal":
        return []
    words = _TARGETS[target.kind]
    text = f"mean quality towards {words} {target.before:.3f} -> {target.after:.3f}"
    if math.isfinite(target.ideal_after):
        text += (
            f", towards ideal shapes alone {target.ideal_before:.3f} -> {target.ideal_after:.3f}"
        )
    return [text]


def _sizes(sizes: Sizes | None, trades: tuple[Trade, ...]) -> list[str]:
    """What became of the cells' sizes; of a shorter edge the trade tells."""
    if sizes is None:
        return []
    said = [f"cell areas x {_factor(sizes.area_low)} to {_factor(sizes.area_high)}"]
    if all(trade.figure != "min_edge" for trade in trades):
        said.append(_change("min_edge", sizes.min_edge_before, sizes.min_edge_after))
    if sizes.layers:
        said.append(f"{_share(sizes.layers)} cells are layers and were kept")
    return said


def _slid(sliding: Sliding | None) -> list[str]:
    """How many vertices slid, and how far that took their lines."""
    if sliding is None:
        return []
    counts = []
    if sliding.slid:
        counts.append(f"{sliding.slid} of {sliding.boundary_vertices} boundary vertices slid")
    if sliding.interface_slid:
        of = plural(sliding.interface_vertices, "vertex", "vertices")
        counts.append(f"{sliding.interface_slid} of {of} on lines inside that may slide did")
    if counts and sliding.deviation_share > ROUNDING:
        percent = 100.0 * sliding.deviation_share
        what = "edges are off the curve" if sliding.on_curve else "the outline moved"
        counts.append(f"{what} by at most {percent:.2g} % of the local edge")
    elif counts:
        counts.append(f"the outline is {'on the curve' if sliding.on_curve else 'where it was'}")
    return counts


def _without_effect(sliding: Sliding | None) -> list[str]:
    """What was asked of sliding vertices in vain."""
    if sliding is None:
        return []
    n_sliding = sliding.may_slide + sliding.interface_vertices
    if not n_sliding:
        return [_nothing_slides(sliding)]
    said = []
    if sliding.beside:
        beside = plural(sliding.beside, "vertex", "vertices")
        said.append(
            f"{beside} could not be brought onto the curve, up to {sliding.off_curve:.3g} away"
        )
    if sliding.curves_unused:
        said.append(_unused(sliding, n_sliding))
    return said


def _nothing_slides(sliding: Sliding) -> str:
    """Why no vertex may slide."""
    n, kept = sliding.line_vertices, sliding.kept_vertices
    if not n:
        return "no vertex may slide, as there is no line to slide along"
    why = []
    if kept:
        why.append(f"{kept} are fixed, outside the selection or have a direction of their own")
    if kept < n:
        why.append(f"{n - kept} are corners, or ends of lines")
    return f"no vertex may slide: of {n} on the lines {' and '.join(why)}"


def _unused(sliding: Sliding, n_sliding: int) -> str:
    """Say that curves were given which nothing follows."""
    if not sliding.on_curve:
        return (
            "no line of the mesh follows the curve given, every vertex within an edge of it: they "
            "are their own curves"
        )
    curves = plural(sliding.curves_unused, "curve", "curves")
    return (
        f"{curves} given, but followed by no line of the mesh; {sliding.along_curve} of "
        f"{n_sliding} vertices that may slide are along one"
    )


def _factor(value: float) -> str:
    return f"{value:.2f}" if 0.01 <= value < 100.0 else f"{value:.2g}"


def _share(value: float) -> str:
    """Say a share of the cells: "0.12 % of the", "93 % of the", "all"."""
    percent = 100.0 * value
    if value == 1.0:
        return "all"
    return f"{percent:.2g} % of the" if percent < 99.0 else "over 99 % of the"


def _why(outcome: Outcome, spell: Callable[[str], str]) -> list[str]:
    """Why it stopped."""
    if outcome.stop is Stop.NOTHING_MOVES:
        if outcome.selected:
            return ["no vertex can move: all selected are on the boundary or fixed"]
        return ["no vertex can move: all are on the boundary, fixed or in no cell"]
    if outcome.stop is Stop.VALID:
        if not outcome.sweeps:
            return ["the mesh is valid: there was nothing to untangle"]
        return [] if _done(outcome) else ["all cells are valid"]
    if outcome.stop is Stop.TIME_LIMIT:
        return [f"the time limit of {outcome.stop_at:g} s was reached"]
    if outcome.stop is Stop.CALLBACK:
        return ["stopped when it was told to"]
    if outcome.stop is Stop.MAX_SWEEPS:
        if not outcome.sweeps:
            return ["no sweep was asked for"]
        return [
            f"stopped after {plural(outcome.sweeps, 'sweep')}, as {spell('max_sweeps')} says"
            + _still_moving(outcome)
        ]
    if outcome.stop is Stop.STOP_QUALITY:
        return [f"the worst cell reached {spell('stop_quality')}={outcome.stop_at:g}"]
    if outcome.unchanged:
        return [] if outcome.forbidden or outcome.held or outcome.invalid else [UNCHANGED]
    if outcome.stop is Stop.RESTS:
        return [
            f"every vertex rests: none moved by over {outcome.stop_at:.3g} of its shortest edge"
        ]
    if outcome.stop is Stop.SETTLED and not _done(outcome):
        return ["quality no longer improves"]
    return []


def _still_moving(outcome: Outcome) -> str:
    if not outcome.largest_share:
        return ""
    return (
        f"; vertices still moved by up to {100.0 * outcome.largest_share:.2g} % of their "
        "shortest edge"
    )


def _not_valid(outcome: Outcome) -> list[str]:
    """What is not valid, and why."""
    invalid = outcome.invalid
    if invalid is None:
        return []
    if outcome.untangles:
        return [_stays_invalid(invalid)] if invalid.after else []
    if invalid.before:
        return [
            f"the mesh was not valid ({plural(invalid.before, 'cell')} invalid) and "
            f"{outcome.method} does not untangle: {plural(invalid.after, 'cell')} invalid now"
        ]
    if not outcome.guarded:
        return [f"{outcome.method} is unguarded: it made {plural(invalid.after, 'cell')} invalid"]
    return []


def _carried(records: list[Carried], spell: Callable[[str], str]) -> list[str]:
    """What became of values that belong to places."""
    found = [record for record in records if record.interpolated]
    parts = []
    if len(found) == 1:
        parts.append(
            f"{found[0].name} was interpolated in the input mesh, which changed it "
            f"{_error(found[0])}: carried along unchanged it would be wrong by that"
        )
    elif found:
        named = ", ".join(f"{record.name} {_error(record)}" for record in found[:MOST_NAMED])
        more = f" and {len(found) - MOST_NAMED} more" if len(found) > MOST_NAMED else ""
        parts.append(
            f"values were interpolated in the input mesh, which changed {named}{more}: carried "
            "along unchanged they would be wrong by that"
        )
    return parts + [
        f"{record.name} was carried along unchanged and is wrong {_error(record)}; "
        f"{spell('carry=' + repr('interpolate'))} mends that"
        for record in records
        if not record.interpolated
    ]


def _error(record: Carried) -> str:
    return f"by up to {record.largest:.3g} (root mean square {record.rms:.3g})"


def _stays_invalid(invalid: Invalid) -> str:
    """Say which cells stay invalid, and for which of them that is proven."""
    text = (
        f"{invalid.after} of {plural(invalid.before, 'invalid cell')} "
        f"{'stays' if invalid.after == 1 else 'stay'} invalid, the first is cell {invalid.first}"
    )
    if invalid.proven:
        reasons = []
        if fixed := invalid.proven - invalid.proven_doublets:
            reasons.append(
                f"for {fixed} of them nothing can help, as what is fixed keeps a corner from being "
                "convex"
            )
        if invalid.proven_doublets:
            reasons.append(
                f"for {invalid.proven_doublets} of them nothing can help, as an interior vertex "
                "has no other cell than two, and one of these has 180 degrees or more there"
            )
        text += f"; {'; '.join(reasons)} (the first is cell {invalid.first_proven})"
    if open_ := invalid.after - invalid.proven:
        text += f"; for {open_} no way was found, which does not prove that there is none"
    return text
