"""Run qsmooth beside other smoothers, on the same meshes with the same boundary, all in one run.

    python benchmarks/peers.py                       # what is installed, meshes of 2K cells
    python benchmarks/peers.py --size 24k --limit 300 --json peers.json
    python benchmarks/peers.py --peer mfem --mesh fold --python /path/to/another/python

Beside each program's time and quality stands the time in which qsmooth comes as far: no smaller
scaled Jacobian, mean scaled Jacobian or mean shape, but for .001; where the program leaves invalid
cells of an invalid mesh, the time to the first valid mesh. Which guarded method was the quickest
there, with how many sweeps, is said; `time_to_quality` has how they are found. Only beside programs
that do not look at cells at all the plain Laplacian may be the quickest, too.

Every run has a process of its own with a time limit, as some libraries end the process on meshes
they can't handle. What counts is the processor time of the smoothing call alone, on one thread, the
median of several, each on a mesh given anew, after a small mesh; the file has the wall time as
well. Quality is measured by one piece of code for all. A program that is not installed is skipped;
`pip install '.[peers]'` brings all of them.
"""

import argparse
import json
import math
import statistics
import sys
import tempfile
from pathlib import Path

from apart import ask, machine, machine_words, markdown, version
from peer_meshes import MESHES, SIZES, Figures
from peer_programs import PROGRAMS

# Making a mesh, and finding the sweeps that are enough for each program, may take so long.
PATIENCE = 900.0
HEAD = (
    "mesh", "program", "seconds", "smallest angle", "min SJ", "mean SJ", "mean shape", "invalid",
    "as far", "by", "times as fast",
)  # fmt: skip


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("--size", choices=SIZES, default="2k", help="about how many cells")
    parser.add_argument("--mesh", action="append", choices=MESHES, help="default: all")
    parser.add_argument("--peer", action="append", choices=PROGRAMS, help="default: all")
    parser.add_argument(
        "--repeat", type=int, default=3, help="runs of a program, if they are short"
    )
    parser.add_argument(
        "--limit", type=float, default=60.0, help="seconds a program may take in all"
    )
    parser.add_argument(
        "--python", action="append", default=[], help="more interpreters to look for programs in"
    )
    parser.add_argument("--json", type=Path, help="write all figures into this file")
    parser.add_argument("--markdown", action="store_true", help="print a table for Markdown")
    options = parser.parse_args()
    found = run(
        options.size, options.mesh or MESHES, options.peer or tuple(PROGRAMS),
        limit=options.limit, repeat=options.repeat, pythons=(sys.executable, *options.python),
    )  # fmt: skip
    if options.json:
        options.json.write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")
    print("\n" + (markdown(HEAD, lines(found)) if options.markdown else plain(found)))
    print("\n" + summary(found))


def run(size, meshes, peers, *, limit, repeat, pythons, say=print):
    """All figures of a run, as plain values."""
    found = {
        "machine": machine(), "size": size, "limit": limit, "repeat": repeat, "programs": {},
        "meshes": {},
    }  # fmt: skip
    places = _places(peers, pythons)
    for peer in peers:
        package = PROGRAMS[peer].package
        found["programs"][peer] = version(package, places[peer]) if places[peer] else None
    for name in meshes:
        with tempfile.TemporaryDirectory() as folder:
            made = _beside(name, SIZES[size], folder, places, limit, repeat, say)
        found["meshes"][name] = made
    return found


def _places(peers, pythons):
    """First interpreter that has the package of each program, or None."""
    return {
        peer: next((p for p in pythons if version(PROGRAMS[peer].package, p)), None)
        for peer in peers
    }


def missing(peers, pythons):
    """Packages that no interpreter has."""
    places = _places(peers, pythons)
    return sorted({PROGRAMS[peer].package for peer in peers if places[peer] is None})


def _beside(name, cells, folder, places, limit, repeat, say):
    """One mesh: the programs, then qsmooth as far as each of them came."""
    question = {"task": "make", "name": name, "size": cells, "folder": folder}
    made, why = ask("peer_runs.py", question, limit=PATIENCE)
    if made is None:
        return {"why": why}
    others = {}
    for peer, python in places.items():
        if python is None:
            others[peer] = {"why": "not installed"}
            continue
        question = {"task": "program", "program": peer, "folder": folder, "repeat": repeat}
        done, why = ask("peer_runs.py", question, limit=limit, python=python)
        others[peer] = done or {"why": why}
        say(f"{name}: {peer} {_seconds(done['seconds']) if done else why}", flush=True)
    ran = {peer: other for peer, other in others.items() if "seconds" in other}
    question = {"task": "qsmooth", "folder": folder, "others": ran}
    own, why = ask("peer_runs.py", question, limit=PATIENCE)
    say(f"{name}: qsmooth {_seconds(own['seconds']) if own else why}", flush=True)
    for peer, reached in own["reached"].items() if own else ():
        others[peer]["reached"] = reached
        if reached:
            others[peer]["ratio"] = others[peer]["seconds"] / reached["seconds"]
    return {**made, "qsmooth": own or {"why": why}, "peers": others}


def lines(found):
    """Rows of the table, as texts."""
    rows = []
    for name, mesh in found["meshes"].items():
        if "why" in mesh:
            rows.append([name, mesh["why"], *[""] * 9])
            continue
        rows.append(
            [f"{name}, {mesh['cells']}", "(given)", "", *_quality(mesh["figures"]), *[""] * 3]
        )
        own = mesh["qsmooth"]
        if "why" in own:
            rows.append([name, f"qsmooth: {own['why']}", *[""] * 9])
        else:
            by = f"optimize, {own['sweeps']} sweeps"
            quality = _quality(own["figures"])
            rows.append([name, "qsmooth", _seconds(own["seconds"]), *quality, "", by, ""])
        rows += [_line(name, peer, other) for peer, other in mesh["peers"].items()]
    return rows


def _line(name, peer, other):
    if "why" in other:
        return [name, peer, other["why"], *[""] * 8]
    row = [name, peer, _seconds(other["seconds"]), *_quality(other["figures"])]
    if not other["holds_boundary"]:
        row[1] += ", moved the boundary"
    if "reached" not in other:
        return [*row, "", "was valid as given", ""]
    if other["reached"] is None:
        return [*row, "", "not reached", ""]
    reached = other["reached"]
    by = f"{reached['method']}, {reached['sweeps']} sweeps"
    return [*row, _seconds(reached["seconds"]), by, times(other["ratio"])]


def _quality(figures):
    f = Figures(*figures)
    return f"{f.angle:.2f}°", f"{f.worst:.3f}", f"{f.mean:.3f}", f"{f.shape:.3f}", str(f.invalid)


def _seconds(seconds):
    return f"{1e3 * seconds:.3g} ms" if seconds < 1.0 else f"{seconds:.3g} s"


def times(ratio):
    """A ratio in two digits, or all that it has before the point."""
    return f"{ratio:.2g}" if ratio < 99.5 else f"{ratio:.0f}"


def plain(found):
    """The table in columns."""
    table = [HEAD, *lines(found)]
    widths = [max(len(row[k]) for row in table) for k in range(len(HEAD))]
    return "\n".join(
        "  ".join(text.ljust(width) for text, width in zip(row, widths, strict=True)).rstrip()
        for row in table
    )


def ratios(found, valid=True):
    """Ratios of each program by mesh, of its valid or of its invalid results."""
    out = {}
    for name, mesh in found["meshes"].items():
        for peer, other in mesh.get("peers", {}).items():
            if "ratio" in other and valid != bool(Figures(*other["figures"]).invalid):
                out.setdefault(peer, {})[name] = other["ratio"]
    return out


def summary(found):
    """How many times as long as qsmooth each program took, and what all ran on."""
    texts = []
    for peer, which in found["programs"].items():
        if not which:
            texts.append(f"{peer}: not installed")
        for valid, aim in ((True, "the same quality"), (False, "a valid mesh, which it has not")):
            values = ratios(found, valid).get(peer, {}).values()
            if values:
                mean = math.exp(statistics.fmean(map(math.log, values)))
                texts.append(
                    f"{PROGRAMS[peer].title} ({which}): {times(min(values))} to "
                    f"{times(max(values))} times as long as qsmooth to {aim}, on {len(values)} "
                    f"of {len(found['meshes'])} meshes, geometric mean {times(mean)}"
                )
    texts.append(f"{machine_words(found['machine'])}; one thread each, processor time")
    return "\n".join(texts)


if __name__ == "__main__":
    main()
