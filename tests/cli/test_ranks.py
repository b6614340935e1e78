"""Whether a process is one of several: what launchers leave in the environment."""

import os

import pytest

from qsmooth.cli import ranks

pytestmark = pytest.mark.nojit
ALL = (*ranks.SIZES, ranks.SLURM_SIZE, *ranks.OF_MPI, ranks.TALKS, ranks.SWITCH)


@pytest.mark.parametrize(
    ("told", "several"),
    [
        ({}, False),
        ({"PMI_SIZE": "4", "PMI_RANK": "0"}, True),
        ({"PMI_SIZE": "1", "PMI_RANK": "0"}, False),
        ({"OMPI_COMM_WORLD_SIZE": "2"}, True),
        ({"MV2_COMM_WORLD_SIZE": "x"}, False),
        ({"SLURM_STEP_NUM_TASKS": "8"}, False),  # tasks, but not of MPI
        ({"SLURM_STEP_NUM_TASKS": "8", "PMIX_RANK": "3"}, True),
        ({"SLURM_STEP_NUM_TASKS": "1", "PMIX_RANK": "0"}, False),
        ({"PMI_SIZE": "4", "QSMOOTH_MPI": "0"}, False),
        ({"PMI_SIZE": "4", "PMI_FD": "0"}, True),
        ({"PMI_SIZE": "4", "PMI_FD": "987"}, False),  # inherited from an MPI program: closed
    ],
)
def test_what_launchers_say(monkeypatch, told, several):
    for name in ALL:
        monkeypatch.delenv(name, raising=False)
    for name, value in told.items():
        monkeypatch.setenv(name, value)
    if told.get("PMI_FD") == "0":
        read, write = os.pipe()
        monkeypatch.setenv("PMI_FD", str(read))
    assert ranks.started_by_mpi() == several
    if told.get("PMI_FD") == "0":
        os.close(read)
        os.close(write)


def test_one_process_smooths_alone():
    assert ranks.size() == 1
