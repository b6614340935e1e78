"""What a process of `peers.py` does: make a mesh, run one program on it, or run qsmooth."""

import argparse
import json
import statistics
import time

import numpy as np

from apart import answer, own_cache, processor_time
from peer_meshes import Figures, boundary, make, measure

# A small mesh goes through first, so that nothing is loaded or set up in the time that counts.
SMALL = 64
# Long runs are not repeated.
LONG = 5.0


def make_meshes(name, size, folder):
    """Write a mesh, and a small one of its kind."""
    own_cache()
    for file, cells in (("small.npz", SMALL), ("mesh.npz", size)):
        points, made = make(name, cells)
        np.savez(f"{folder}/{file}", points=points, cells=made)
    return {"cells": len(made), "figures": measure(points, made)}


def load(folder, file="mesh.npz"):
    data = np.load(f"{folder}/{file}")
    return data["points"], data["cells"]


def run_program(program, folder, repeat):
    """Median of a program's processor time, each time on a mesh given anew, and what it made."""
    from peer_programs import PROGRAMS

    start = PROGRAMS[program].start
    run, _ = start(*load(folder, "small.npz"))
    run()
    points, cells = load(folder)
    seconds, wall = [], []
    while len(seconds) < repeat and sum(seconds) < LONG:
        run, result = start(points.copy(), cells.copy())
        begin = processor_time(), time.perf_counter()
        run()
        seconds.append(processor_time() - begin[0])
        wall.append(time.perf_counter() - begin[1])
        made = np.array(result())
    fixed = boundary(cells, len(points))
    off = np.abs(made[fixed] - points[fixed]).max() / np.ptp(points)
    return {
        "seconds": statistics.median(seconds),
        "wall": statistics.median(wall),
        "runs": len(seconds),
        "figures": measure(made, cells),
        "holds_boundary": bool(off < 1e-6),
    }


def run_qsmooth(folder, others):
    """Qsmooth with its defaults to its end, and as far as each of the others came, in its time."""
    own_cache()
    from peer_programs import PROGRAMS
    from qsmooth import warmup
    from time_to_quality import Calls

    warmup()
    points, cells = load(folder)
    given, calls = measure(points, cells), Calls(points, cells)
    seconds, result = calls.median("optimize")
    reached = {}
    for name, other in others.items():
        wanted = Figures(*other["figures"])
        if wanted.invalid and not given.invalid:
            continue  # what it was given is the first valid mesh
        found = calls.quickest(wanted, seconds, PROGRAMS[name].guarded)
        reached[name] = found and found._asdict()
    return {
        "seconds": seconds,
        "sweeps": result.sweeps,
        "figures": measure(result.points, cells),
        "reached": reached,
    }


TASKS = {"make": make_meshes, "program": run_program, "qsmooth": run_qsmooth}

if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--question", required=True)
    question = json.loads(parser.parse_args().question)
    answer(TASKS[question.pop("task")](**question))
