"""A process of its own for libraries in C that may crash, or go on for ever, on a damaged file."""

from __future__ import annotations

import contextlib
import importlib
import os
import pickle
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

from qsmooth.errors import MeshError

# What a damaged file may cost; more for the size of one that is not.
SECONDS, SECONDS_A_BYTE = 2, 1e-7
MEMORY, TIMES_ITS_SIZE = 500 << 20, 20
# Beyond that the machine is busy, or the process sleeps.
LONGEST = 30.0

START = (
    "import pickle, sys\n"
    "sys.path[:] = pickle.load(sys.stdin.buffer)\n"
    "from qsmooth.io.apart import serve\n"
    "serve()\n"
)


def apart(function: str, size: int, *arguments: Any) -> Any:
    """Call a function in another process, and give back what it returns.

    Parameters
    ----------
    function
        Module and name, as in ``"qsmooth.io.ugrid:content_of"``.
    size
        Bytes of the file that it is about, by which time and memory are limited.
    arguments
        Go to the other process by pickle, as does what comes back.

    Raises
    ------
    MeshError
        That the function raised, or that says that the process did not survive.
    """
    if "python" not in Path(sys.executable or "").name.lower():
        return _called(function, arguments)  # another program has Python inside
    given = [sys.path, (function, size, arguments)]
    command = [sys.executable, "-c", START]
    # One thread each: what these reserve would count as memory.
    environment = os.environ | {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
    try:
        done = subprocess.run(
            command,
            input=b"".join(pickle.dumps(one) for one in given),
            capture_output=True,
            env=environment,
            timeout=LONGEST + 10 * SECONDS_A_BYTE * size,
        )
    except subprocess.TimeoutExpired:
        raise MeshError("the file takes too long to read: it is damaged") from None
    if done.returncode != 0 or not done.stdout:
        raise MeshError(f"the library that reads it {_fate(done)}: the file is damaged")
    good, result = pickle.loads(done.stdout)
    if not good:
        raise MeshError(result)
    return result


def serve() -> None:
    """Do in the other process what is asked for on standard input."""
    function, size, arguments = pickle.load(sys.stdin.buffer)
    out = os.fdopen(os.dup(sys.stdout.fileno()), "wb")
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())  # what libraries print is no answer
    module = importlib.import_module(function.partition(":")[0])
    _limit(size)
    try:
        answer = True, _called(f"{module.__name__}:{function.partition(':')[2]}", arguments)
    except MeshError as error:
        answer = False, str(error)
    except MemoryError:
        answer = False, "the file asks for too much memory: it is damaged"
    except Exception as error:  # a file can be wrong in more ways than a reader checks
        answer = False, f"it cannot be read ({error!r:.200})"
    pickle.dump(answer, out)
    out.flush()
    # Without the libraries' farewells, which may crash after a damaged file.
    os._exit(0)


def _called(function: str, arguments: tuple[Any, ...]) -> Any:
    module, _, name = function.partition(":")
    return getattr(importlib.import_module(module), name)(*arguments)


def _limit(size: int) -> None:
    with contextlib.suppress(ImportError, OSError, ValueError):
        import resource

        seconds = SECONDS + int(SECONDS_A_BYTE * size)
        used = resource.getrusage(resource.RUSAGE_SELF)
        seconds += int(used.ru_utime + used.ru_stime) + 1
        resource.setrlimit(resource.RLIMIT_CPU, (seconds, seconds + 1))
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        pages = int(Path("/proc/self/statm").read_text().split()[0])
        most = pages * resource.getpagesize() + MEMORY + TIMES_ITS_SIZE * size
        hard = resource.getrlimit(resource.RLIMIT_AS)[1]
        if hard == resource.RLIM_INFINITY or most < hard:
            resource.setrlimit(resource.RLIMIT_AS, (most, hard))


def _fate(done: subprocess.CompletedProcess[bytes]) -> str:
    if done.returncode == -getattr(signal, "SIGXCPU", 0):
        return "goes on and on"
    if done.returncode < 0:
        return f"crashes ({signal.Signals(-done.returncode).name})"
    words = done.stderr.decode(errors="replace").strip().splitlines()
    return f"fails ({words[-1][:200] if words else 'without a word'})"
