"""``qsmooth formats``: which files are read and written, and what they keep."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from qsmooth.cli import files, terminal

if TYPE_CHECKING:
    from qsmooth.io import FormatRecord
    from qsmooth.table import Table


def formats(json_file: files.JsonOption = None, debug: files.DebugOption = False) -> None:
    """List the formats of files: their endings, whether they are read and written, what is kept.

    Where several share an ending, and for an ending that none has, the content decides.
    """
    from qsmooth.io import format_records

    files.refuse_clash(json_file)
    records = format_records()
    with files.Outputs() as outputs:
        facts = {"formats": [record.to_dict() for record in records]}
        if not outputs.put_json(json_file, facts):
            terminal.write_table(_table(records))


def _table(records: Sequence[FormatRecord]) -> Table:
    from qsmooth.table import Row, Section, Table

    def rows(through: str) -> tuple[Row, ...]:
        return tuple(
            Row(record.name, _cells(record)) for record in records if record.through == through
        )

    return Table(
        columns=("endings", "read", "written", "kept in a new file besides points and cells"),
        sections=(
            Section("read and written by qsmooth", rows("qsmooth")),
            Section("through meshio; what is lost is told when one is written", rows("meshio")),
        ),
        left=True,
        corner="format",
    )


def _cells(record: FormatRecord) -> tuple[str, ...]:
    kept = "" if record.keeps is None else ", ".join(record.keeps) or "nothing"
    yes = ("no", "yes")
    return (" ".join(record.endings), yes[record.reads], yes[record.writes], kept)
