"""``qsmooth info``: what a mesh consists of, and what is odd about it."""

from __future__ import annotations

from typing import Annotated

import typer

from qsmooth.cli import files, terminal
from qsmooth.cli.options import REPORT


def info(
    mesh_file: files.In,
    ids: Annotated[
        int,
        typer.Option(
            metavar="N", help="How many ids of each finding to show.", rich_help_panel=REPORT
        ),
    ] = 10,
    merge: files.MergeOption = False,
    merge_tolerance: files.MergeToleranceOption = None,
    surface: files.SurfaceOption = files.Surface.auto,
    geographic: files.GeographicOption = None,
    format: files.FormatOption = None,
    json_file: files.JsonOption = None,
    debug: files.DebugOption = False,
) -> None:
    """Say what a mesh consists of, and what is odd about it.

    Cells, boundary loops, orientation, regions; orphan and coincident vertices, edges without
    length, hanging nodes, pinched vertices, parts, cells that are not valid.
    """
    from qsmooth.inspection import inspect
    from qsmooth.output.tables import inspection_table

    if ids < 0:
        raise ValueError(f"--ids must be 0 or more, got {ids}")
    files.refuse_clash(json_file, mesh_file)
    within = files.merge_within(merge, merge_tolerance)
    facts = inspect(files.read(mesh_file, surface, format, geographic, within))
    with files.Outputs() as outputs:
        if not outputs.put_json(json_file, {"input": str(mesh_file), **facts.to_dict(ids)}):
            terminal.write_heading(str(mesh_file))
            terminal.write_table(inspection_table(facts, ids))
