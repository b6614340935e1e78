"""What formats there are, as records: made from their modules and from meshio, listed nowhere."""

from __future__ import annotations

from collections.abc import Set
from dataclasses import asdict, dataclass
from typing import Any

from qsmooth.io import via_meshio
from qsmooth.io.registry import FolderFormat, Format, folder_formats, own_formats, replaced

# What formats hold, by the words of ``HOLDS``, in the order in which it is told.
WORDS = {
    "z": "z",
    "level": "z as a value",
    "geographic": "degrees",
    "vertex": "point cells",
    "line": "line cells",
    "regions": "regions",
    "names": "names of groups",
    "point_sets": "point sets",
    "cell_sets": "cell sets",
    "point_data": "point data",
    "cell_data": "cell data",
    "field_data": "field data",
}


@dataclass(frozen=True)
class FormatRecord:
    """One format.

    Attributes
    ----------
    name
        As ``format`` takes it.
    endings
        In lower case, with their dots; none of a format whose meshes are folders.
    title
        What it is, in a line; empty for those that come through meshio.
    reads, writes
        Whether it is read, and written.
    keeps
        What a new file holds besides points, triangles and quads, in words. None where only
        writing tells, as with those that come through meshio.
    through
        What reads and writes it: "qsmooth" or "meshio".
    """

    name: str
    endings: tuple[str, ...]
    title: str
    reads: bool
    writes: bool
    keeps: tuple[str, ...] | None
    through: str

    def to_dict(self) -> dict[str, Any]:
        """Plain values, fit for JSON."""
        return {
            **asdict(self),
            "endings": list(self.endings),
            "keeps": None if self.keeps is None else list(self.keeps),
        }


def format_records() -> tuple[FormatRecord, ...]:
    """All formats: qsmooth's own by name, then those that come through meshio."""
    own: list[Format | FolderFormat] = [*own_formats(), *folder_formats()]
    own.sort(key=lambda form: form.NAME)
    found = [
        FormatRecord(
            name=form.NAME,
            endings=getattr(form, "ENDINGS", ()),
            title=_title(form.__doc__ or ""),
            reads=True,
            writes=bool(getattr(form, "WRITES", True)),
            keeps=_kept(form.HOLDS),
            through="qsmooth",
        )
        for form in own
    ]
    readers, writers = via_meshio.readers(), via_meshio.writers()
    others = [
        FormatRecord(
            name=name,
            endings=endings,
            title="",
            reads=name in readers,
            writes=name in writers,
            keeps=None,
            through="meshio",
        )
        for name, endings in via_meshio.formats(replaced()).items()
    ]
    return (*found, *others)


def _title(text: str) -> str:
    """The first sentence of a module's text, on one line, without its full stop."""
    return " ".join(text.strip().partition("\n\n")[0].split()).removesuffix(".")


def _kept(holds: Set[str]) -> tuple[str, ...]:
    return tuple(words for key, words in WORDS.items() if key in holds)
