"""The page on the paper: its table beside ours, why ours differ, which command makes which figure.

One list of blocks is written as HTML, which needs no network, and as Markdown, which
`docs/paper.md` is, too.
"""

from __future__ import annotations

import html
import re
import textwrap
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from qsmooth._words import in_a_row, plural
from qsmooth.io.files import replace_bytes
from qsmooth.paper.drawing import BY_SWEEP, FIGURES, TITLES
from qsmooth.paper.runs import (
    COLUMNS,
    KNOWN,
    OUR_GUARD,
    OUR_STEP,
    PAPER_GUARD,
    PAPER_STEP,
    UNKNOWN,
    Row,
    text_of,
)

HEADS = {
    "seconds": "seconds",
    "aspect_ratio": "largest aspect ratio",
    "mean_aspect_ratio": "mean",
    "max_angle": "largest angle",
    "min_angle": "smallest",
}
FULL_HEADS = {
    "aspect_ratio": "largest aspect ratio of",
    "mean_aspect_ratio": "mean aspect ratio of",
    "max_angle": "largest angle of",
    "min_angle": "smallest angle of",
}
ABOUT = """\
"Quadrilateral Mesh Smoothing" moves the vertices of quads by star and by quad. `qsmooth paper`
runs both, and Laplacian smoothing, on a spiral of 1.9K quads and on a lake of 24K, {sweeps} sweeps
each."""
UNKNOWN_WORDS = """\
What is known here of the paper's results are the numbers of its spiral, which stand in the table;
an empty place is a number that is not known. Its meshes are not public, and the captions of its
figures were not at hand: **which subject stands under which of the numbers 13 and 16 to 22 is our
own choice**, and the meshes are rebuilt, of the same outlines and sizes. On what machine its times
were taken is not known."""
STYLE = """\
body{font:16px/1.5 sans-serif;max-width:72rem;margin:2rem auto;padding:0 1rem;color:#222}
table{border-collapse:collapse;margin:1rem 0}td,th{border:1px solid #bbb;padding:.2rem .6rem}
td{text-align:right}td:first-child,td:nth-child(2){text-align:left}img{max-width:100%}
code{background:#f2f2f2;padding:0 .2em}figure{margin:1rem 0}"""


@dataclass(frozen=True)
class Heading:
    """The title of a part."""

    text: str
    level: int = 2


@dataclass(frozen=True)
class Text:
    """A paragraph; `code` and **bold** as in Markdown."""

    text: str


@dataclass(frozen=True)
class Table:
    """Rows of texts under their heads."""

    heads: Sequence[str]
    rows: Sequence[Sequence[str]]


@dataclass(frozen=True)
class Picture:
    """A figure in files of this name beside the page."""

    name: str
    title: str


Block = Heading | Text | Table | Picture


def blocks(found: dict[str, Any], *, pictures: bool = True) -> list[Block]:
    """Put the page together of what was found; without pictures it is `docs/paper.md`."""
    page: list[Block] = [
        Heading("The paper, made again", 1),
        Text(ABOUT.format(sweeps=found["sweeps"])),
        Text(UNKNOWN_WORDS),
        Heading("Its table"),
        _numbers(found["rows"]),
        Heading("Where ours differ, and why"),
        *_reasons(found),
    ]
    if pictures:
        page.append(Picture(BY_SWEEP, "The spiral, sweep by sweep"))
    page += [Heading("Its figures"), Text(_commands_words(pictures)), _mapping()]
    if pictures:
        page += [Picture(figure.name, f"{figure.number}. {figure.title}") for figure in FIGURES]
    return page


def write_page(found: dict[str, Any], folder: Path) -> list[Path]:
    """Write ``index.html`` and ``index.md`` into the folder of the figures."""
    page = blocks(found)
    texts = {"index.html": html_text(page), "index.md": markdown_text(page)}
    for name, text in texts.items():
        replace_bytes(folder / name, text.encode("utf-8"))
    return [folder / name for name in texts]


# ------------------------------------------------------------------------------- what is said


def _numbers(rows: Sequence[Row]) -> Table:
    """Tabulate our numbers, each with the paper's beside it; seconds where they were kept."""
    timed = any(row["seconds"] is not None for row in rows)
    columns = COLUMNS if timed else COLUMNS[1:]
    heads = ["mesh", "method"]
    for column in columns:
        heads += [HEADS[column], "paper's"]
    lines = []
    for row in rows:
        known = dict(zip(COLUMNS, KNOWN.get((row["mesh"], row["method"]), UNKNOWN), strict=True))
        invalid = f", {row['invalid']} invalid" if row["invalid"] else ""
        line = [f"{row['mesh']}, {row['cells']} quads", TITLES[row["method"]] + invalid]
        for column in columns:
            line += [text_of(column, row[column]), text_of(column, known[column])]
        lines.append(line)
    return Table(heads, lines)


def _reasons(found: dict[str, Any]) -> Iterable[Block]:
    """Say what step, guard and mesh make of the numbers, and what is left."""
    yield Text(
        f"**Step and guard.** As the paper is understood here, its moves are made by half (step "
        f"{PAPER_STEP:g}), and it asks only that no vertex comes nearer to the lines of its star "
        f"(guard `{PAPER_GUARD}`); the defaults here are a step of {OUR_STEP:g} and the guard "
        f"`{OUR_GUARD}`, with which the worst cell never gets worse. Both guards certify each move "
        "exactly, by the signs of the corners; that cannot be turned off. The spiral by each "
        "choice:"
    )
    columns = COLUMNS[1:]
    heads = ["method", "step, guard", *(HEADS[c] for c in columns), "as far as the paper after"]
    rows = [
        [
            TITLES[row["method"]],
            f"{row['step']:g}, {row['guard']}",
            *(text_of(column, row[column]) for column in columns),
            "not" if row["as_far"] is None else plural(row["as_far"], "sweep"),
        ]
        for row in found["ways"]
    ]
    yield Table(heads, rows)
    yield Text(
        "As far means: the largest angle is, and stays, at most that of the paper after its last "
        f"sweep. {_step_words(found['ways'])} {_guard_words(found['ways'])}"
    )
    yield Text(
        f"**The mesh.** The paper's spiral is not this one. {found['n_seeds']} others of the same "
        "make, whose interior vertices were moved by other random numbers, with the paper's "
        "choices:"
    )
    yield _spread(found["seeds"])
    yield Text(_left_words(found))


def _way(ways: Sequence[Row], method: str, step: float, guard: str) -> Row:
    return next(
        row for row in ways if (row["method"], row["step"], row["guard"]) == (method, step, guard)
    )


def _step_words(ways: Sequence[Row]) -> str:
    """Say what half the step does to the largest angles."""
    changes = []
    for method in ("star", "quad"):
        whole, half = (
            _way(ways, method, step, PAPER_GUARD)["max_angle"] for step in (PAPER_STEP, OUR_STEP)
        )
        changes.append(f"from {whole:.1f}° to {half:.1f}° with `{method}`")
    return f"By the smaller step the largest angle goes {' and '.join(changes)}."


def _guard_words(ways: Sequence[Row]) -> str:
    """Say how much the choice of the guard changes at the paper's step."""
    most = max(
        abs(
            _way(ways, method, PAPER_STEP, OUR_GUARD)[column]
            - _way(ways, method, PAPER_STEP, PAPER_GUARD)[column]
        )
        for method in ("star", "quad")
        for column in ("max_angle", "min_angle")
    )
    return f"At the paper's step the guards part the extreme angles by {most:.1f}° at most."


def _spread(seeds: dict[str, dict[str, list[float]]]) -> Table:
    """Tabulate the ranges over other spirals, the paper's numbers beside them."""
    heads = ["method"]
    for column in COLUMNS[1:]:
        heads += [HEADS[column], "paper's"]
    rows = []
    for method, ranges in seeds.items():
        line = [TITLES[method]]
        known = dict(zip(COLUMNS, KNOWN["spiral", method], strict=True))
        for column in COLUMNS[1:]:
            low, high = (text_of(column, value) for value in ranges[column])
            line += [f"{low} – {high}", text_of(column, known[column])]
        rows.append(line)
    return Table(heads, rows)


def _left_words(found: dict[str, Any]) -> str:
    """Say which of the paper's numbers no spiral of ours comes to."""
    outside: list[str] = []
    within: list[str] = []
    for method in ("star", "quad"):
        for column, known in zip(COLUMNS[1:], KNOWN["spiral", method][1:], strict=True):
            if known is None:
                continue
            ours = [*found["seeds"][method][column]]
            ours.append(_way(found["ways"], method, PAPER_STEP, PAPER_GUARD)[column])
            inside = min(ours) <= known <= max(ours)
            words = f"{FULL_HEADS[column]} `{method}` ({text_of(column, known)})"
            (within if inside else outside).append(words)
    parts = ["**What is left.**"]
    if within:
        parts.append(f"What these spirals come to includes the paper's {in_a_row(within)}.")
    if outside:
        parts.append(
            f"No spiral of ours ends with the paper's {in_a_row(outside)}: step, guard and the "
            "random numbers of the mesh do not explain these. What else can differ is the paper's "
            "own mesh, above all its connectivity and its boundary, which no method moves; the "
            "order in which vertices are visited, here by colours; and whether its test of a move "
            "knows on which side of a line a vertex is. None of these can be measured without the "
            "paper's mesh or its program."
        )
    return " ".join(parts)


def _commands_words(pictures: bool) -> str:
    where = "the folder of this page" if pictures else "the folder that it made"
    return (
        "`qsmooth paper -o paper` makes all; the first command of each row makes that figure "
        f"alone, the second the same numbers by plain commands, in {where}, where the meshes lie. "
        f"With `--step {PAPER_STEP:g} --guard {PAPER_GUARD}` those of `star` and `quad` take what "
        "is understood here as the paper's choices; the figures are of the defaults."
    )


def _mapping() -> Table:
    rows = [
        [str(figure.number), figure.title, *(f"`{command}`" for command in figure.commands)]
        for figure in FIGURES
    ]
    return Table(["figure", "what it shows", "alone", "by plain commands"], rows)


# ------------------------------------------------------------------------------- how it is written


def markdown_text(page: Iterable[Block]) -> str:
    """Write blocks as Markdown."""
    return "\n\n".join(_as_markdown(block) for block in page) + "\n"


def _as_markdown(block: Block) -> str:
    match block:
        case Heading(text, level):
            return f"{'#' * level} {text}"
        case Text(text):
            return textwrap.fill(" ".join(text.split()), 100, break_on_hyphens=False)
        case Table(heads, rows):
            lines = [heads, ["---"] * len(heads), *rows]
            return "\n".join(f"| {' | '.join(line)} |" for line in lines)
        case Picture(name, title):
            return f"![{title}]({name}.png)\n\n{title} ([SVG]({name}.svg))"


def html_text(page: Iterable[Block]) -> str:
    """Write blocks as a page of HTML."""
    body = "\n".join(_as_html(block) for block in page)
    return (
        '<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8">'
        f"<title>The paper, made again</title><style>{STYLE}</style></head><body>\n{body}\n"
        "</body></html>\n"
    )


def _as_html(block: Block) -> str:
    match block:
        case Heading(text, level):
            return f"<h{level}>{_marked(text)}</h{level}>"
        case Text(text):
            return f"<p>{_marked(text)}</p>"
        case Table(heads, rows):
            lines = ["".join(f"<th>{_marked(head)}</th>" for head in heads)]
            lines += ["".join(f"<td>{_marked(cell)}</td>" for cell in row) for row in rows]
            return "<table>" + "\n".join(f"<tr>{line}</tr>" for line in lines) + "</table>"
        case Picture(name, title):
            words = html.escape(title)
            return (
                f'<figure id="{name}"><img src="{name}.png" alt="{words}" loading="lazy">'
                f'<figcaption>{words} (<a href="{name}.svg">SVG</a>)</figcaption></figure>'
            )


def _marked(text: str) -> str:
    """Turn `code` and **bold** into HTML, and escape all else."""
    text = html.escape(text, quote=False)
    text = re.sub(r"`([^`]*)`", r"<code>\1</code>", text)
    return re.sub(r"\*\*(.+?)\*\*", r"<strong>\1</strong>", text, flags=re.DOTALL)
