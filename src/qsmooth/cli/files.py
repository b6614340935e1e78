"""Files of the commands: how they are named, read and kept from harm."""

from __future__ import annotations

import json
import os
import warnings
from collections.abc import Callable, Mapping, Sequence
from enum import StrEnum
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Annotated, Any

import typer

from qsmooth._json import finite
from qsmooth._words import plural
from qsmooth.cli.options import FILES, REPORT, spell
from qsmooth.cli.terminal import say, status, write
from qsmooth.errors import MeshError, MeshWarning

if TYPE_CHECKING:
    from qsmooth.mesh import Mesh
    from qsmooth.result import SmoothResult


class Surface(StrEnum):
    """What a third coordinate means."""

    auto = "auto"
    flat = "flat"


In = Annotated[Path, typer.Argument(metavar="IN", help="Mesh file to read.", show_default=False)]
OutOption = Annotated[
    Path,
    typer.Option(
        "--output",
        "-o",
        metavar="OUT",
        help="Mesh file to write; its ending tells the format.",
        show_default=False,
        rich_help_panel=FILES,
    ),
]
OverwriteOption = Annotated[
    bool,
    typer.Option(
        "--overwrite", help="Allow OUT to replace a file, IN itself too.", rich_help_panel=FILES
    ),
]
KeepBestOption = Annotated[
    bool,
    typer.Option(
        "--keep-best",
        help="Interrupted (Ctrl-C), write the best so far, if OUT is not there yet; twice, stop at "
        "once.",
        rich_help_panel=FILES,
    ),
]
SurfaceOption = Annotated[
    Surface,
    typer.Option(
        "--surface",
        metavar="[auto|flat]",
        help="What z means: [b]auto[/b], the mesh lies in one plane; [b]flat[/b], z is a value on "
        "a mesh in x and y, such as depth; where vertices move it is interpolated. In fort.14, "
        "gr3, 2dm, MIKE and Selafin files it always is one.",
        rich_help_panel=FILES,
    ),
]
GeographicOption = Annotated[
    bool | None,
    typer.Option(
        "--geographic/--no-geographic",
        help="Whether x and y are longitudes and latitudes in degrees: angles are then the true "
        "ones, lengths in metres. By default what the file says.",
        rich_help_panel=FILES,
    ),
]
FormatOption = Annotated[
    str | None,
    typer.Option(
        "--format",
        metavar="NAME",
        help="Format of IN; by default its ending and content tell.",
        rich_help_panel=FILES,
    ),
]
OutputFormatOption = Annotated[
    str | None,
    typer.Option(
        "--output-format",
        metavar="NAME",
        help="Format of OUT, if its ending does not say.",
        rich_help_panel=FILES,
    ),
]
WithQualityOption = Annotated[
    bool,
    typer.Option(
        "--with-quality",
        help="Put every metric of the cells, and their validity, into OUT as cell data; for "
        "formats that hold it, such as .vtu.",
        rich_help_panel=FILES,
    ),
]
MergeOption = Annotated[
    bool,
    typer.Option(
        "--merge",
        help="Weld seams, where edges of the boundary lie on one another: their vertices become "
        "one, and those after them have other numbers.",
        rich_help_panel=FILES,
    ),
]
MergeToleranceOption = Annotated[
    float | None,
    typer.Option(
        "--merge-tolerance",
        metavar="SHARE",
        help="How far apart they may be to be welded, as a share of the shortest edge there, in "
        "\\[0, 0.25]; 0: at the same place to the bit. Implies --merge.  "
        "[dim]\\[default: 1e-9][/dim]",
        rich_help_panel=FILES,
        show_default=False,
    ),
]
JsonOption = Annotated[
    Path | None,
    typer.Option(
        "--json",
        metavar="FILE",
        help="Also write the figures as JSON; [b]-[/b] prints them, and no table.",
        rich_help_panel=REPORT,
    ),
]
ReportOption = Annotated[
    Path | None,
    typer.Option(
        "--report",
        metavar="FILE",
        help="Also write a report to look at, one HTML file.",
        rich_help_panel=REPORT,
    ),
]
DebugOption = Annotated[
    bool, typer.Option("--debug", help="Show a traceback on errors (or set QSMOOTH_DEBUG=1).")
]


def merge_within(merge: bool, tolerance: float | None) -> float | None:
    """Say within which share of edges seams are welded; None where they are not to be."""
    from qsmooth.merging import MOST, TOLERANCE

    if tolerance is None:
        return TOLERANCE if merge else None
    if not 0.0 <= tolerance <= MOST:
        raise ValueError(f"--merge-tolerance must be in [0, {MOST:g}], got {tolerance:g}")
    return tolerance


def read(
    path: Path,
    surface: Surface,
    format: str | None,
    geographic: bool | None = None,
    within: float | None = None,
) -> Mesh:
    """Read a mesh; weld its seams, `within` a share of their edges, or point them out."""
    from qsmooth.inspection import may_be_degrees
    from qsmooth.io import read_mesh
    from qsmooth.merging import TOLERANCE, find_seams, merge

    with status(f"reading {path}"):
        mesh = read_mesh(path, surface=surface.value, format=format, geographic=geographic)
        seams = find_seams(mesh, TOLERANCE if within is None else within)
        merged = mesh if within is None else merge(mesh, within)
    if geographic is None and may_be_degrees(mesh):
        warnings.warn(
            f"'{path}': coordinates look like degrees, and are taken as lengths; --geographic "
            "takes them as longitudes and latitudes, --no-geographic says that they are none",
            MeshWarning,
            stacklevel=2,
        )
    if within is None:
        if seams.n_edges:
            say(f"warning: '{path}': {seams}, and stay apart; --merge welds them")
        return mesh
    say(
        f"'{path}': {seams}, {plural(mesh.n_vertices - merged.n_vertices, 'vertex', 'vertices')} "
        "merged"
        if seams.n_edges
        else f"'{path}': nothing to merge"
    )
    return merged


def require_format(
    path: Path,
    mesh: Mesh,
    name: str | None,
    interpolate: tuple[str, ...] = (),
    with_quality: bool = False,
) -> None:
    """Refuse a format that can't be written, or holds no data to interpolate, before the work."""
    from qsmooth.carrying import require_data
    from qsmooth.io import format_of, holds_cell_data, holds_point_data

    found = format_of(path, mesh, format=name)
    require_data(mesh, interpolate)
    if interpolate and not holds_point_data(found):
        raise ValueError(f"--interpolate: format {found} of '{path}' holds no point data")
    if with_quality and not holds_cell_data(found):
        raise ValueError(
            f"--with-quality: format {found} of '{path}' holds no cell data; vtu and vtk do"
        )


def to_write(mesh: Mesh, with_quality: bool) -> Mesh:
    """Give the mesh as it is to be written: with the metrics of its cells, if wanted."""
    if not with_quality:
        return mesh
    from qsmooth.output.cell_quality import with_quality as measured

    return measured(mesh)


def refuse_unsafe(mesh_file: Path, output: Path, overwrite: bool, json_file: Path | None) -> None:
    """Refuse outputs that would destroy a file, before any work is done."""
    from qsmooth.io.folders import has_mesh

    if output.is_dir() and not has_mesh(output):
        raise ValueError(f"'{output}' is a folder; OUT must be a file")
    if not output.parent.is_dir():
        raise ValueError(f"cannot write '{output}': there is no folder '{output.parent}'")
    if output.exists() and not overwrite:
        if _same_file(output, mesh_file):
            raise ValueError(f"OUT is the input, '{mesh_file}'; --overwrite allows that")
        raise ValueError(f"'{output}' exists; --overwrite replaces it")
    refuse_clash(json_file, mesh_file, output)


def refuse_clash(report: Path | None, *others: Path, option: str = "--json") -> None:
    """Refuse a report that would replace a mesh, or another report, or cannot be written."""
    if report is None or (report == Path("-") and option == "--json"):
        return
    for other in others:
        if _same_file(report, other):
            raise ValueError(f"{option} would write over the file '{other}'")
    if report.is_dir() or not report.parent.is_dir():
        raise ValueError(f"cannot write '{report}': it is a folder, or its folder is not there")


def _same_file(one: Path, other: Path) -> bool:
    if one.exists() and other.exists():
        return one.samefile(other)
    return os.path.realpath(one) == os.path.realpath(other)


class Outputs:
    """What a command writes. What cannot be written is told after the tables: they took the time.

    Used as a context; the end of it is the error.
    """

    def __init__(self) -> None:
        self.written: list[Path] = []
        self._failed: list[str] = []

    def __enter__(self) -> Outputs:
        return self

    def put(self, path: Path, make: Callable[[], object]) -> None:
        """Have `make` write a file, or files into a folder."""
        from qsmooth.io.files import reason

        try:
            make()
        except (OSError, ValueError) as error:
            where = getattr(error, "filename", None) or path
            told = isinstance(error, ValueError)
            self._failed.append(str(error) if told else f"cannot write '{where}': {reason(error)}")
        else:
            self.written.append(path)

    def put_json(self, path: Path | None, facts: dict[str, Any]) -> bool:
        """Write facts as JSON; True if that went to standard output in place of the tables."""
        from qsmooth.io.files import replace_bytes

        if path is None:
            return False
        text = json.dumps(finite(facts), indent=2, allow_nan=False)
        if path == Path("-"):
            write(text)
            return True
        self.put(path, lambda: replace_bytes(path, f"{text}\n".encode()))
        return False

    def put_report(
        self,
        path: Path | None,
        mesh_file: Path,
        results: Sequence[SmoothResult],
        skipped: Mapping[str, str] = MappingProxyType({}),
    ) -> None:
        """Write the report that ``--report`` asks for, of what methods made of a mesh."""
        if path is None:
            return
        from qsmooth.output.report import states_of, write_report

        def make() -> None:
            title, notes = mesh_file.name, skipped_notes(skipped)
            write_report(states_of(results), path, title=title, notes=notes, spell=spell)

        with status("writing the report"):
            self.put(path, make)

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        if self._failed and (kind is None or issubclass(kind, typer.Exit)):
            raise MeshError("; ".join(self._failed))


def skipped_notes(skipped: Mapping[str, str]) -> list[str]:
    """Say which methods were skipped, and why."""
    from qsmooth.output.tables import method_title

    return [f"{method_title(name)}: skipped; {why}." for name, why in skipped.items()]
