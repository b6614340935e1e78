"""What several ranks of MPI gain over one, beside threads, in one paired run.

    python benchmarks/ranks.py [--cells 1000000] [--sweeps 100] [--repeats 3]

A shaken square of quads is smoothed by one rank, two and four, and by one thread and two,
in turns, so that whatever else the machine does hits all of them alike. Shown are medians: seconds
of the whole call; of a sweep with all that belongs to it, from runs with few and many sweeps; bytes
and messages that a rank sends in a sweep, counted and by the model of `docs/mpi.md`; peak memory.
"""

import argparse
import json
import os
import resource
import shutil
import statistics
import subprocess
import sys
import time
from pathlib import Path

FEW = 5


def run(method, n_cells, sweeps, threads, comm):
    """Time one call; what it did."""
    from qsmooth import smooth, team
    from qsmooth.examples import jittered

    teams = []

    class Counted(team.Team):
        def __init__(self, comm):
            super().__init__(comm)
            teams.append(self)

    team.Team = Counted
    side = round(n_cells**0.5)
    options = {"comm": comm, "threads": threads, "max_sweeps": sweeps}
    if method != "optimize":
        options["rtol"] = 0.0
    smooth(jittered(40, 60), method, **options)
    mesh = jittered(side, side) if comm is None or comm.rank == 0 else None
    if comm is not None:
        comm.Barrier()
    started = time.perf_counter()
    result = smooth(mesh, method, **options)
    seconds = time.perf_counter() - started
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6
    sent = (teams[-1].messages, teams[-1].sent) if teams else (0, 0)
    peaks = [peak] if comm is None else comm.gather(peak)
    every = [sent] if comm is None else comm.gather(sent)
    if comm is None or comm.rank == 0:
        n = max(result.sweeps, 1)
        print(
            json.dumps(
                {
                    "seconds": seconds,
                    "sweeps": n,
                    "messages": max(m for m, _ in every) / n,
                    "bytes": max(b for _, b in every) / n,
                    "peaks": peaks,
                    "bits": hash(result.points.tobytes()),
                }
            )
        )


def measured(how, method, n_cells, sweeps):
    """Run in processes of its own."""
    kind, n = how
    mpiexec = Path(sys.executable).with_name("mpiexec")
    start = [str(mpiexec) if mpiexec.is_file() else shutil.which("mpiexec"), "-n", str(n)]
    arguments = [sys.executable, __file__, "--one", kind, str(n), method]
    arguments += ["--cells", str(n_cells), "--sweeps", str(sweeps)]
    arguments += ["--cells", str(n_cells), "--sweeps", str(sweeps)]
    done = subprocess.run(
        [*(start if kind == "ranks" else []), *arguments],
        capture_output=True, text=True, check=True, env={**os.environ, "PYTHONHASHSEED": "0"},
    )  # fmt: skip
    return json.loads(done.stdout)


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--cells", type=int, default=1_000_000)
    parser.add_argument("--sweeps", type=int, default=100)
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--methods", default="star,optimize")
    parser.add_argument("--one", nargs=3, help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.one:
        kind, n, method = given.one
        comm = None
        if kind == "ranks":
            from mpi4py import MPI

            comm = MPI.COMM_WORLD
        run(method, given.cells, given.sweeps, int(n) if kind == "threads" else 1, comm)
        return
    ways = [("threads", 1), ("threads", 2), ("ranks", 1), ("ranks", 2), ("ranks", 4)]
    print(f"{given.cells} quads, medians of {given.repeats} runs in turns")
    print("method     how         call s   sweep ms   gain   KB/sweep  messages   peak GB a rank")
    for method in given.methods.split(","):
        found = {way: {n: [] for n in (FEW, given.sweeps)} for way in ways}
        for _ in range(given.repeats):
            for way in ways:
                for sweeps in found[way]:
                    found[way][sweeps].append(measured(way, method, given.cells, sweeps))
        base = None
        for way in ways:
            few, many = (found[way][n] for n in (FEW, given.sweeps))
            seconds = [statistics.median(one["seconds"] for one in runs) for runs in (few, many)]
            sweep = (seconds[1] - seconds[0]) / (many[0]["sweeps"] - few[0]["sweeps"])
            if way == ("ranks", 1):
                base = seconds[1]
            gain = f"{base / seconds[1]:6.2f}" if base and way[0] == "ranks" else "      "
            peaks = " ".join(f"{peak:.2f}" for peak in many[0]["peaks"])
            print(
                f"{method:9}  {way[1]} {way[0]:8}  {seconds[1]:6.2f}   {1e3 * sweep:8.1f}  {gain}"
                f"   {many[0]['bytes'] / 1e3:8.1f}  {many[0]['messages']:8.1f}   {peaks}"
            )
        same = len({runs[-1]["bits"] for way in ways for runs in [found[way][given.sweeps]]}) == 1
        print(f"{method:9}  {'all have the same bits' if same else 'THE BITS DIFFER'}")


if __name__ == "__main__":
    main()
