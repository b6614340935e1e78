"""Write the README's table of times, its picture and `docs/performance.md`.

    python benchmarks/publish.py             # run, store, write; ten minutes on a quiet machine
    python benchmarks/publish.py --growth    # growth to ten million quads as well; needs 16 GB
    python benchmarks/publish.py --stored    # write again what is stored in benchmarks/results

All programs have to be installed, `pip install '.[plot,dev,peers]'`, or be found by --python.
"""

import argparse
import json
import sys
from pathlib import Path

import growth
import paper
import peers
from apart import machine_words, markdown
from peer_meshes import MESHES, Figures
from peer_programs import PROGRAMS
from time_to_quality import TOLERANCE

ROOT = Path(__file__).resolve().parent.parent
RESULTS = ROOT / "benchmarks" / "results"
PAGE, PLOT, GROWTH_PLOT = (
    ROOT / "docs" / name for name in ("performance.md", "performance.png", "growth.png")
)
# The README's section lies between these lines.
START, END = "<!-- benchmarks/publish.py -->", "<!-- the end of benchmarks/publish.py -->"
SHORT = {
    "gmsh-untangle": "gmsh UntangleMeshGeometry",
    "gmsh-relocate": "gmsh Relocate2D",
    "mfem": "MFEM TMOP",
    "meshkernel": "MeshKernel",
    "vtk": "VTK Laplacian",
    "scipy": "scipy Jacobi",
}


def stored(name):
    """Figures of a file in `RESULTS`."""
    return json.loads((RESULTS / f"{name}.json").read_text(encoding="utf-8"))


def store(name, found):
    RESULTS.mkdir(exist_ok=True)
    (RESULTS / f"{name}.json").write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")


# ------------------------------------------------------------------------------- texts


def readme_section(found):
    """What stands in the README between `START` and `END`."""
    head = ["Mesh", "qsmooth, to its end", *(SHORT[peer] for peer in found["programs"])]
    rows = [
        [name, _end(mesh), *(_peer(other) for other in mesh["peers"].values())]
        for name, mesh in found["meshes"].items()
    ]
    return f"""\
Beside others on meshes of {found["size"].upper()} cells, same mesh and same boundary: seconds, the
smallest angle reached, and in bold **how many times as fast qsmooth comes as far**, in the worst
cell and in the mean, or, where the other leaves invalid cells of an invalid mesh, to the first
valid one. A valid mesh that the other makes invalid has no such figure:

{markdown(head, rows)}

![How many times as fast as others, by mesh](docs/performance.png)

{machine_words(found["machine"])}; one thread each, processor time. Written by
`python benchmarks/publish.py`; all figures, growth to ten million quads and memory are in
[performance](docs/performance.md)."""


def _end(mesh):
    own = mesh["qsmooth"]
    if "why" in own:
        return own["why"]
    return f"{own['seconds']:.2g} s, {_reached(own['figures'])}"


def _reached(figures):
    found = Figures(*figures)
    return f"{found.invalid} invalid" if found.invalid else f"{found.angle:.1f}°"


def _peer(other):
    if "why" in other:
        return other["why"] if other["why"].startswith("over") else "fails"
    text = f"{other['seconds']:.2g} s, {_reached(other['figures'])}"
    if "ratio" in other:
        return f"{text}, **{peers.times(other['ratio'])}**"
    return f"{text}, not reached" if "reached" in other else text


def page(found, grown, papers):
    """What stands in `docs/performance.md`."""
    summary = "\n".join(f"- {line}" for line in peers.summary(found).splitlines()[:-1])
    return f"""\
# Performance

This page, and the table and the picture of the README, are written by
`python benchmarks/publish.py` from the files in `benchmarks/results`, of runs on one machine; a
test holds them together.

## Beside others

Same meshes (`benchmarks/peer_meshes.py`), connectivity and boundary, one thread each. Seconds are
processor time of the smoothing call alone; a program may take {found["limit"]:g} s. "As far" is
qsmooth's time to the same quality: no smaller scaled Jacobian, mean scaled Jacobian or mean shape
but for {TOLERANCE:g}; where the program leaves invalid cells of an invalid mesh, to the first
valid mesh. "By" is the quickest method there, with the `max_sweeps` that it takes: a guarded one,
but beside VTK and scipy, which look at no cell, it may be the plain Laplacian. MeshKernel slides
boundary vertices along the boundary; they are put back.

{markdown(peers.HEAD, peers.lines(found))}

{summary}
- {machine_words(found["machine"])}.

## Growth

Rough grids: ten sweeps of `star`, and `optimize` for {growth.TIME_LIMIT:g} s at most; grids over a
steep bump, where a whole region has to move: `optimize` for {growth.BUMP_LIMIT:g} s at most, by the
clock. Peak bytes a quad are those of the process above what it had before the mesh was read, 48
bytes a quad of the caller's among them.

{markdown(growth.HEAD, [growth.line(row) for row in grown["rows"]])}

![Time and memory a quad by the number of quads](growth.png)

{machine_words(grown["machine"])}; one thread, processor time.

## The paper's table

"Quadrilateral Mesh Smoothing", {papers["sweeps"]} sweeps. The paper's meshes are not public: these
are of the same outlines and sizes, and the spiral is as bad as the paper's. On what machine its
times were taken is not known, nor are its figures of the lake here.

{markdown(paper.HEAD, paper.lines(papers))}

{machine_words(papers["machine"])}; one thread, processor time.
"""


def with_section(text, section):
    """The README with another section."""
    before, _, rest = text.partition(START)
    _, _, after = rest.partition(END)
    return f"{before}{START}\n{section}\n{END}{after}"


def plot(found, path):
    """A row a mesh, a dot a program: how many times as fast qsmooth comes as far."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8.0, 3.0), layout="constrained")
    axes, names = figure.subplots(), list(found["meshes"])
    for k, peer in enumerate(found["programs"]):
        others = [found["meshes"][name]["peers"][peer] for name in names]
        known = [(i, other) for i, other in enumerate(others) if "ratio" in other]
        for invalid in (False, True):
            dots = [
                (other["ratio"], i + 0.1 * (k - 2.5))
                for i, other in known
                if invalid == bool(Figures(*other["figures"]).invalid)
            ]
            colour = f"C{k}"
            style = {"edgecolors": colour, "facecolors": "none" if invalid else colour}
            if dots:
                axes.scatter(*zip(*dots, strict=True), s=28, **style)
        axes.scatter([], [], s=28, color=f"C{k}", label=PROGRAMS[peer].title)
    axes.scatter([], [], s=28, edgecolors="grey", facecolors="none", label="leaves invalid cells")
    axes.axvline(1.0, color="grey", linewidth=0.8)
    axes.set(xscale="log", xlabel="times as fast to the same quality")
    axes.set_yticks(range(len(names)), names)
    axes.set_ylim(len(names) - 0.5, -0.5)
    axes.grid(axis="x", alpha=0.3)
    figure.legend(loc="outside right center", fontsize=8)
    figure.savefig(path, dpi=130)


def write():
    """Write all that is made of the stored files."""
    found, grown = stored("peers_24k"), stored("growth")
    readme = ROOT / "README.md"
    text = with_section(readme.read_text(encoding="utf-8"), readme_section(found))
    readme.write_text(text, encoding="utf-8")
    PAGE.write_text(page(found, grown, stored("paper")), encoding="utf-8")
    plot(found, PLOT)
    growth.plot(grown, GROWTH_PLOT)


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("--stored", action="store_true", help="run nothing")
    parser.add_argument("--growth", action="store_true", help="growth, to ten million quads, too")
    parser.add_argument("--limit", type=float, default=150.0, help="seconds a program may take")
    parser.add_argument("--python", action="append", default=[], help="where else programs are")
    options = parser.parse_args()
    if not options.stored:
        pythons = (sys.executable, *options.python)
        missing = peers.missing(PROGRAMS, pythons)
        if missing:
            raise SystemExit(f"not installed: {', '.join(missing)}; pip install '.[peers]'")
        found = peers.run("24k", MESHES, PROGRAMS, limit=options.limit, repeat=3, pythons=pythons)
        store("peers_24k", found)
        store("paper", paper.run())
        if options.growth:
            store("growth", growth.run(full=True))
    write()


if __name__ == "__main__":
    main()
