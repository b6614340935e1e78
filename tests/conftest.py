"""Fixtures of the whole suite; it also keys Numba's cache by the sources."""

import os
from pathlib import Path

import hypothesis
import pytest

from numba_cache import key_cache

key_cache()
if (os.cpu_count() or 1) < 2:
    os.environ.setdefault("NUMBA_NUM_THREADS", "2")  # threads are to be compared on any machine

ROOT = Path(__file__).resolve().parent.parent

# The same examples at every run: a red suite then means that the code has changed. To look for
# new ones: HYPOTHESIS_PROFILE=explore pytest.
hypothesis.settings.register_profile(
    "suite",
    deadline=None,
    derandomize=True,
    database=None,
    max_examples=40,
    print_blob=False,
    suppress_health_check=[hypothesis.HealthCheck.too_slow],
)
hypothesis.settings.register_profile(
    "explore", hypothesis.settings.get_profile("suite"), derandomize=False, max_examples=1000
)
hypothesis.settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "suite"))


def pytest_configure(config: pytest.Config) -> None:
    """Let kernels in plain Python divide by zero without a word, as they do when compiled."""
    if os.environ.get("NUMBA_DISABLE_JIT", "0") != "0":
        what = "ignore:(divide by zero|invalid value|overflow) encountered:RuntimeWarning"
        config.addinivalue_line("filterwarnings", what)


@pytest.fixture(scope="session")
def shared() -> Path:
    """The folder of real meshes and peers beside the checkout, where there is one."""
    folder = ROOT.parent / "shared"
    if not folder.is_dir():
        if os.environ.get("QSMOOTH_REQUIRE_SHARED"):
            pytest.fail(f"{folder} is missing, and QSMOOTH_REQUIRE_SHARED is set")
        pytest.skip("the folder of real meshes is not here")
    return folder


@pytest.fixture(scope="session")
def shared_meshes(shared: Path) -> Path:
    """The folder of real meshes."""
    return shared / "meshes"
