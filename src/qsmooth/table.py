"""Tables of text in sections, with bars: they know nothing of what they show."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rich.table import Table as RichTable

BEST = "*"
LONGEST_BAR = 12
NOTE_WIDTH = 100
# Characters between two columns.
BETWEEN = 2
# Where room is short texts have so many at least.
LEAST_TEXT = 20
# Eighths of a character cell, from one to seven, then a full one.
EIGHTHS = "▏▎▍▌▋▊▉█"
# For terminals whose encoding lacks these.
PLAIN = str.maketrans(
    {**dict.fromkeys("▍▌▋▊▉█", "#"), "▏": ".", "▎": ".", "°": "d", "−": "-", "×": "x"}
)


@dataclass(frozen=True)
class Row:
    """One line of a table.

    Attributes
    ----------
    label, cells
        What it says, and its value in each column.
    best
        Columns that hold the best value.
    """

    label: str
    cells: tuple[str, ...]
    best: frozenset[int] = frozenset()


@dataclass(frozen=True)
class Section:
    """A heading and the rows under it; `marked` where its rows may have a best value."""

    title: str
    rows: tuple[Row, ...]
    marked: bool = False


@dataclass(frozen=True)
class Table:
    """Rows in sections under named columns; prints as plain text, and in colour with rich."""

    columns: tuple[str, ...]
    sections: tuple[Section, ...]
    note: str = ""
    left: bool = False  # texts, not numbers: aligned left
    title: str = ""
    corner: str = ""  # name of the first column

    def only(self, columns: Sequence[int]) -> Table:
        """Keep some of the columns, in this order."""

        def kept(row: Row) -> Row:
            best = frozenset(n for n, k in enumerate(columns) if k in row.best)
            return Row(row.label, tuple(row.cells[k] for k in columns), best)

        sections = tuple(
            Section(s.title, tuple(kept(row) for row in s.rows), s.marked) for s in self.sections
        )
        return replace(self, columns=tuple(self.columns[k] for k in columns), sections=sections)

    def narrowed(self, width: int | None, kept: int = 0) -> list[Table]:
        """Spread the columns over tables that fit a line of so many characters, None for any.

        The first `kept` columns stand in each. Columns stand closer before there are two tables.
        """
        if width is None:
            return [self]
        least = self._widths(broken=True)
        between = BETWEEN if sum(least) + BETWEEN * (len(least) - 1) <= width else 1
        label, *widths = (w + between for w in least)
        label -= between
        groups: list[list[int]] = [[]]
        for k in range(kept, len(widths)):
            shown = [*range(kept), *groups[-1], k]
            if groups[-1] and label + sum(widths[n] for n in shown) > width:
                groups.append([])
            groups[-1].append(k)
        tables = [self.only([*range(kept), *group]) for group in groups]
        return [replace(t, note="") for t in tables[:-1]] + tables[-1:]

    @property
    def natural_width(self) -> int:
        """Characters that it takes on a terminal, its names of columns unbroken."""
        return sum(width + BETWEEN for width in self._widths()) - BETWEEN

    def _widths(self, broken: bool = False) -> list[int]:
        lines = [
            (row.label, *self._marked(section, row))
            for section in self.sections
            for row in section.rows
        ]
        heads = [(self.corner,), *(name.split() if broken else (name,) for name in self.columns)]
        columns = zip(*lines, strict=True) if lines else ((),) * len(heads)
        return [widest([*h, *c]) for h, c in zip(heads, columns, strict=True)]

    def __str__(self) -> str:
        return self.text()

    def text(self, width: int | None = None) -> str:
        """Write it as plain text.

        Where `width` asks for that names of columns are broken, and columns stand closer.
        """
        widths, between = self._widths(), BETWEEN
        broken = width is not None and sum(widths) + BETWEEN * (len(widths) - 1) > width
        if width is not None and broken:
            widths = self._widths(broken=True)
            is_close = sum(widths) + BETWEEN * (len(widths) - 1) > width and not self.left
            between = 1 if is_close else BETWEEN
        heads: list[list[str]] = [[self.corner]]
        for name, w in zip(self.columns, widths[1:], strict=True):
            heads.append((textwrap.wrap(name, w) if broken else [name]) or [""])
        height = max(map(len, heads))
        heads = [[""] * (height - len(head)) + head for head in heads]

        if self.left and width is not None:  # the last column of texts is broken between words
            room = width - sum(widths[:-1]) - between * (len(widths) - 1)
            widths[-1] = min(widths[-1], max(room, LEAST_TEXT))

        def line(cells: Sequence[str]) -> str:
            padded = [cells[0].ljust(widths[0])]
            pad = str.ljust if self.left else str.rjust
            padded += [pad(c, w) for c, w in zip(cells[1:], widths[1:], strict=True)]
            return (between * " ").join(padded).rstrip()

        def lines(cells: Sequence[str]) -> list[str]:
            *others, last = cells
            if not self.left or len(last) <= widths[-1]:
                return [line(cells)]
            first, *rest = textwrap.wrap(last, widths[-1], break_on_hyphens=False)
            below = [""] * len(others)
            return [line([*others, first]), *(line([*below, text]) for text in rest)]

        rule = sum(widths) + between * (len(widths) - 1)
        out = [self.title, ""] if self.title else []
        out += [line(cells) for cells in zip(*heads, strict=True)] if any(self.columns) else []
        for section in self.sections:
            out += ["", section.title, "-" * rule] if section.title else ["-" * rule]
            for row in section.rows:
                out += lines((row.label, *self._marked(section, row)))
        if self.note:
            out += ["", *textwrap.wrap(self.note, min(width or NOTE_WIDTH, NOTE_WIDTH))]
        return "\n".join(out).lstrip("\n")

    def _marked(self, section: Section, row: Row) -> list[str]:
        if not section.marked:
            return list(row.cells)
        return [f"{c} {BEST if k in row.best else ' '}" for k, c in enumerate(row.cells)]

    def __rich__(self) -> RichTable:
        from rich import box
        from rich.table import Table as RichTable
        from rich.text import Text

        table = RichTable(
            box=box.SIMPLE_HEAD,
            caption=self.note or None,
            caption_justify="left",
            collapse_padding=True,
            pad_edge=False,
        )
        if self.title:
            table.title, table.title_justify = Text(self.title, style="bold"), "left"
        table.show_header = any(self.columns)
        table.add_column(self.corner, no_wrap=True, header_style="bold")
        for k, name in enumerate(self.columns):
            values = [
                self._marked(section, row)[k] for section in self.sections for row in section.rows
            ]
            table.add_column(
                name,
                justify="left" if self.left else "right",
                # Where room is short names are broken, and texts, but no number and no word.
                min_width=0 if self.left else max(map(len, [*values, *name.split()]), default=0),
                overflow="fold",
                header_style="bold",
            )
        for n, section in enumerate(self.sections):
            if section.title:
                if n:
                    table.add_row()
                table.add_row(Text(section.title, style="bold cyan"))
            for row in section.rows:
                cells = [
                    Text(text, style="bold green" if k in row.best else "")
                    for k, text in enumerate(self._marked(section, row))
                ]
                table.add_row(("  " if section.title else "") + row.label, *cells)
        return table


def best_columns(
    values: Sequence[float], texts: Sequence[str], *, higher_is_better: bool
) -> frozenset[int]:
    """Columns of the best value; what reads the same is equal, and among equals none is best."""
    if len(set(texts)) < 2:
        return frozenset()
    known = [value for value in values if not math.isnan(value)]
    best = texts[values.index(max(known) if higher_is_better else min(known))]
    return frozenset(k for k, text in enumerate(texts) if text == best)


def bar(share: float, length: int) -> str:
    """Draw a share of a bar, padded to `length` characters; what is not zero is seen."""
    eighths = math.ceil(min(max(share, 0.0), 1.0) * 8 * length - 1e-9)
    full, rest = divmod(eighths, 8)
    return (EIGHTHS[-1] * full + (EIGHTHS[rest - 1] if rest else "")).ljust(length)


def percent_text(percent: float) -> str:
    """Write a share in seven characters."""
    if percent == 0.0:
        return "    0 %"
    return f"{percent:5.1f} %" if percent >= 0.05 else " <0.1 %"


def time_text(seconds: float) -> str:
    """Write a time in seconds, to three figures or milliseconds."""
    return f"{seconds:.3f} s" if seconds < 10.0 else f"{seconds:.1f} s"


def widest(texts: Iterable[str]) -> int:
    """Characters of the longest text; 0 where there is none."""
    return max(map(len, texts), default=0)


def plain(text: str, encoding: str | None) -> str:
    """Replace bars and signs that an encoding lacks."""
    try:
        text.encode(encoding or "ascii")
    except (UnicodeEncodeError, LookupError):
        return text.translate(PLAIN)
    return text
