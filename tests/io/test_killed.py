"""A process that is killed while it writes: the old file or the new one is there, whole."""

import json
import os
import subprocess
import sys
import time

import numpy as np
import pytest

from qsmooth.io import files, read_mesh, write_mesh
from qsmooth.mesh import Mesh

KILLED = """
import json, os, random, signal, sys, time
from pathlib import Path
import numpy as np
from qsmooth.examples import structured
from qsmooth.io import write_mesh
from qsmooth.io.files import replace_bytes

folder, rng = Path(sys.argv[1]), random.Random(1)
mesh = structured(32, 32)
meshes = [mesh, mesh.with_points(2.0 * mesh.points)]
write = {
    "a.vtk": lambda path, k: write_mesh(path, meshes[k]),
    "a.bdf": lambda path, k: write_mesh(path, meshes[k]),
    "a.json": lambda path, k: replace_bytes(path, (b"x", b"y")[k] * 100_000),
}
wrong = []
for turn in range(100):
    name = rng.choice([*write])
    path, whole = folder / name, []
    for k in (1, 0):
        write[name](path, k)
        whole.append(path.read_bytes())
    reader, writer = os.pipe()
    child = os.fork()
    if not child:
        os.write(writer, b"x")
        k = 0
        while True:
            write[name](path, k := 1 - k)
    os.read(reader, 1)
    time.sleep(rng.random() * 0.03)
    os.kill(child, signal.SIGKILL)
    os.waitpid(child, 0)
    os.close(reader), os.close(writer)
    if path.read_bytes() not in whole:
        wrong.append([turn, name])
left = [path.name for path in folder.iterdir() if path.name not in write]
print(json.dumps([wrong, left]))
"""


@pytest.mark.skipif(not hasattr(os, "fork"), reason="there is no fork here")
def test_killed_at_a_hundred_moments_and_tidied_up_later(tmp_path):
    program, folder = tmp_path / "killed.py", tmp_path / "folder"
    program.write_text(KILLED)
    folder.mkdir()
    done = subprocess.run(
        [sys.executable, program, folder], capture_output=True, text=True, check=False, timeout=500
    )
    assert done.returncode == 0, done.stderr
    wrong, left = json.loads(done.stdout)
    assert wrong == []
    # Hidden, and no mesh's name; the next process that writes the same file removes what is old.
    assert left
    assert all(name.startswith(".qsmooth-") for name in left)
    for name in left:
        os.utime(folder / name, (0, time.time() - files.LEFT_BEHIND - 9))
    mesh = read_mesh(folder / "a.vtk")
    write_mesh(folder / "a.vtk", mesh)
    write_mesh(folder / "a.bdf", mesh)
    files.replace_bytes(folder / "a.json", b"z")
    assert sorted(path.name for path in folder.iterdir()) == ["a.bdf", "a.json", "a.vtk"]


def test_what_another_process_writes_just_now_is_left_alone(tmp_path):
    mesh = Mesh([(0, 0), (1, 0), (1, 1), (0, 1)], [(0, 1, 2, 3)])
    write_mesh(tmp_path / "a.off", mesh)
    theirs = tmp_path / f"{files._mark(tmp_path / 'a.off')}0123.off"
    others = tmp_path / f"{files._mark(tmp_path / 'b.off')}0123.off"
    for path in (theirs, others):
        path.write_text("x")
    os.utime(others, (0, 0))
    write_mesh(tmp_path / "a.off", mesh)
    assert theirs.exists()
    assert others.exists()
    assert np.array_equal(read_mesh(tmp_path / "a.off").points[:, :2], mesh.points)
