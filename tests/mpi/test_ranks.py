"""Several ranks of MPI: the same bits as one process, and errors that reach all of them."""

import json
import os
import shutil
import subprocess
import sys
import time
from pathlib import Path

import pytest

from qsmooth import read_mesh, write_mesh
from qsmooth.examples import distorted

HERE = Path(__file__).parent
# A run that waits for a message that never comes is ended by this, and the test fails.
PATIENCE = 600
# What fails on one rank ends all others within this.
SECONDS = 30


@pytest.fixture(scope="session")
def mpiexec():
    """Start Python on several ranks."""
    if not os.environ.get("QSMOOTH_REQUIRE_MPI"):
        pytest.importorskip("mpi4py")
    beside = Path(sys.executable).with_name("mpiexec")
    found = str(beside) if beside.is_file() else shutil.which("mpiexec")
    if found is None:
        if os.environ.get("QSMOOTH_REQUIRE_MPI"):
            pytest.fail("mpiexec is missing, and QSMOOTH_REQUIRE_MPI is set")
        pytest.skip("mpiexec is not here")

    def start(n, *arguments, patience=PATIENCE):
        return subprocess.run(
            [found, "-n", str(n), sys.executable, *map(str, arguments)],
            capture_output=True,
            text=True,
            timeout=patience,
            check=False,
        )

    return start


def found_by(run):
    assert run.returncode == 0, run.stderr[-3000:]
    return json.loads(run.stdout)


@pytest.mark.parametrize("n", [1, 2, 3, 4])
def test_the_same_bits_as_one_process(mpiexec, n):
    found = found_by(mpiexec(n, "-W", "error", HERE / "same_bits.py"))
    assert len(found) > 200
    assert [case for case, same in found.items() if not same] == []


@pytest.mark.parametrize("n", [2, 3])
def test_what_is_wrong_on_one_rank_is_told_on_all(mpiexec, n):
    started = time.monotonic()
    found = found_by(mpiexec(n, "-W", "error", HERE / "refusals.py", patience=SECONDS + 30))
    assert time.monotonic() - started < SECONDS + 30
    first, *others = found.pop("callback")
    assert first == "KeyError: 'from the callback'"
    assert set(others) == {""}  # the first rank calls it
    for case, messages in found.items():
        assert len(set(messages)) == 1, case
    told = {case: messages[0] for case, messages in found.items()}
    last = n - 1
    expected = {
        "nan": f"MeshError: on rank {last}: 1 vertex is not finite, the first is vertex ",
        "elsewhere": "MeshError: vertex ",
        "no cell": "MeshError: cell {c} is on no rank",
        "no vertex": "MeshError: vertex 71 is on no rank",
        "other cells": "MeshError: cell 0 has other vertices on one rank than on another",
        "dimension": "MeshError: points must have as many columns",
        "no mesh": "MeshError: ",
        "option": "OptionError: step must be in (0, 1], got 3.0",
        "method": "OptionError: method must be one of ",
        "not a mesh": "TypeError: expected a Mesh",
        "fixed": "OptionError: 1 vertex id in fixed is outside 0 .. 80, the first is 1000000",
        "function": "TypeError: `target` is a function, which each rank has to be given",
        "step": "MeshError: points must have the shape ",
        "after all that": "",
    }
    assert told.keys() == expected.keys()
    first_of_last = -(-64 * last // n)
    for case, text in expected.items():
        assert told[case].startswith(text.format(c=first_of_last)), (case, told[case])


SHELL = ("-W", "error", "-m", "qsmooth")


@pytest.fixture
def bad_mesh(tmp_path):
    path = tmp_path / "in.off"
    write_mesh(path, distorted(80))
    return path


@pytest.mark.parametrize("command", [["smooth", "-m", "star"], ["smooth"], ["untangle"]])
def test_the_shell_writes_what_one_process_writes(mpiexec, bad_mesh, tmp_path, command):
    outputs = [tmp_path / f"out{n}.off" for n in (1, 2)]
    alone = subprocess.run(
        [sys.executable, *SHELL, command[0], bad_mesh, "-o", outputs[0], *command[1:]],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert alone.returncode == 0, alone.stderr
    run = mpiexec(2, *SHELL, command[0], bad_mesh, "-o", outputs[1], *command[1:])
    assert run.returncode == 0, run.stderr
    assert outputs[0].read_bytes() == outputs[1].read_bytes()
    assert run.stdout.count("Wrote") == 1


def test_the_shell_compares_and_measures(mpiexec, bad_mesh):
    run = mpiexec(2, *SHELL, "compare", bad_mesh, "--methods", "star,quad")
    assert run.returncode == 0, run.stderr
    assert run.stdout.count("best or equal") == 1
    run = mpiexec(2, *SHELL, "quality", bad_mesh, "--fail-below", "min_angle=89")
    assert run.returncode == 1


WRONG = {
    "no file": (["missing.off"], "missing.off"),
    "an option": (["in.off", "--fixed", "9999999"], "9999999"),
    "no option": (["in.off", "--stpe", "0.1"], "--stpe"),
}


@pytest.mark.parametrize("case", WRONG)
def test_the_shell_ends_with_one_message(mpiexec, bad_mesh, tmp_path, case):
    (name, *more), word = WRONG[case]
    output = tmp_path / "out.off"
    run = mpiexec(
        3, *SHELL, "smooth", tmp_path / name, "-o", output, *more, patience=SECONDS
    )  # fmt: skip
    assert run.returncode == 2
    assert run.stderr.count("qsmooth: error") == 1
    assert word in run.stderr
    assert not output.exists()


FAILING = """
import os, signal, sys
from mpi4py import MPI
from qsmooth import engine, parts
from qsmooth.cli import main

rank, how, *arguments = sys.argv[1:]
calls = []
engine.LEAST_DIVIDED = 0

def complete(self, *values, usual=parts.Share.complete):
    calls.append(0)
    if MPI.COMM_WORLD.rank == int(rank) and len(calls) == 2:
        if how == "memory":
            raise MemoryError("no more")
        if how == "interrupt":
            raise KeyboardInterrupt
        os.kill(os.getpid(), signal.SIGKILL)
    return usual(self, *values)

parts.Share.complete = complete
main(arguments)
"""


@pytest.mark.parametrize("how", ["memory", "interrupt", "kill"])
@pytest.mark.parametrize("rank", [0, 1])
def test_a_rank_that_fails_ends_all_and_the_file_stays(mpiexec, bad_mesh, tmp_path, rank, how):
    output = tmp_path / "out.off"
    output.write_bytes(b"as it was")
    run = mpiexec(
        2, "-c", FAILING, rank, how, "smooth", bad_mesh, "-o", output, "--overwrite",
        patience=SECONDS,
    )  # fmt: skip
    assert run.returncode != 0
    assert output.read_bytes() == b"as it was"
    if how != "kill":
        word = {"memory": "MemoryError: no more", "interrupt": "interrupted"}[how]
        assert run.stderr.count("qsmooth: ") == 1
        assert f"{word} (on rank {rank})" in run.stderr
    assert read_mesh(bad_mesh).n_cells == 6400


def test_the_example_has_the_same_bits_on_any_number_of_ranks(mpiexec, tmp_path):
    example = HERE.parent.parent / "examples" / "distributed_body.py"
    said, meshes = [], []
    for n in (1, 2, 3):
        folder = tmp_path / str(n)
        folder.mkdir()
        run = mpiexec(n, "-W", "error", "-X", "utf8", example, folder)
        assert run.returncode == 0, run.stderr
        assert f"{n} ranks; this one has " in run.stdout
        said.append([line for line in run.stdout.splitlines() if line.endswith("yes")])
        meshes.append((folder / "body.vtk").read_bytes())
    assert len(said[0]) == 5
    assert said[0] == said[1] == said[2]
    assert meshes[0] == meshes[1] == meshes[2]


def test_the_shell_writes_a_piece_a_rank(mpiexec, bad_mesh, tmp_path):
    output = tmp_path / "out.pvtu"
    run = mpiexec(3, *SHELL, "smooth", bad_mesh, "-m", "star", "-o", output)
    assert run.returncode == 0, run.stderr
    assert len(list(tmp_path.glob("out_*.vtu"))) == 3
    again = tmp_path / "again.pvtu"
    run = mpiexec(2, *SHELL, "smooth", output, "-m", "quad", "-o", again)
    assert run.returncode == 0, run.stderr
    assert len(list(tmp_path.glob("again_*.vtu"))) == 3
    assert read_mesh(again).n_cells == 6400


STARTS = """
import subprocess, sys
from mpi4py import MPI
if MPI.COMM_WORLD.rank == 0:
    subprocess.run([sys.executable, "-m", "qsmooth", "info", sys.argv[1]], check=True)
MPI.COMM_WORLD.Barrier()
"""


def test_a_program_of_mpi_starts_the_shell_as_a_process_of_its_own(mpiexec, bad_mesh):
    run = mpiexec(2, "-c", STARTS, bad_mesh, patience=SECONDS)
    assert run.returncode == 0, run.stderr
    assert run.stdout.count("Doublets") == 1
