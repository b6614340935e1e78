"""Processes of their own, with a time limit, and what the machine is that they ran on."""

import importlib.metadata
import importlib.util
import json
import math
import os
import platform
import signal
import subprocess
import sys
import time
from functools import cache, partial
from pathlib import Path

try:
    import resource
except ImportError:  # not on Windows
    resource = None

HERE = Path(__file__).resolve().parent
# Some libraries take as many threads as there are cores; all are to run on one.
ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "VTK_SMP_MAX_THREADS"), "1")
ANSWER = "ANSWER "
# A process may last so many times its processor time, where others want the cores.
PATIENCE = 5


def processor_time():
    """Seconds that the cores gave this process."""
    if resource is None:
        return time.process_time()
    # `time.process_time` goes by ticks of 4 ms on Linux where the processor time is limited.
    used = resource.getrusage(resource.RUSAGE_SELF)
    return used.ru_utime + used.ru_stime


def own_cache():
    """Point Numba's cache at the folder of these kernels, as in tests; before Numba is imported."""
    sys.path.append(str(HERE.parent / "tests"))
    from numba_cache import key_cache

    key_cache()


def answer(record):
    """Print what a process that `ask` started came to."""
    print(ANSWER + json.dumps(record), flush=True)


def ask(script, question, *, limit, python=sys.executable, threads=1):
    """Have `script` answer a question, a dict, in a process of its own.

    Parameters
    ----------
    limit
        Seconds of processor time that it may take.

    Returns
    -------
    dict or None
        What the process gave to `answer`.
    str
        Why there is none.
    """
    environment = {**os.environ, **(ONE_THREAD if threads == 1 else {})}
    try:
        done = subprocess.run(
            [python, str(HERE / script), "--question", json.dumps(question)],
            capture_output=True, text=True, timeout=PATIENCE * limit, check=False, env=environment,
            preexec_fn=partial(_allow, limit) if resource else None,
        )  # fmt: skip
    except subprocess.TimeoutExpired:
        return None, f"over {limit:g} s"
    for line in done.stdout.splitlines():
        if line.startswith(ANSWER):  # some libraries crash only when they are unloaded
            return json.loads(line[len(ANSWER) :]), ""
    if resource and done.returncode == -signal.SIGXCPU:
        return None, f"over {limit:g} s"
    if done.returncode < 0:
        return None, f"ended by signal {-done.returncode}"
    last = (done.stderr.strip() or done.stdout.strip() or "no message").splitlines()[-1]
    return None, f"ended with {done.returncode}: {last[:80]}"


def _allow(seconds):
    """Let this process end itself after so much processor time."""
    whole = max(1, math.ceil(seconds))
    resource.setrlimit(resource.RLIMIT_CPU, (whole, whole + 1))


@cache
def version(package, python=sys.executable):
    """Version of an installed package, "" where it is missing."""
    if python == sys.executable:
        try:
            return importlib.metadata.version(package)
        except importlib.metadata.PackageNotFoundError:
            return ""
    code = f"import importlib.metadata as m; print(m.version({package!r}))"
    done = subprocess.run([python, "-c", code], capture_output=True, text=True, check=False)
    return done.stdout.strip()


def free_memory():
    """Bytes of memory to be had, as far as that is known."""
    info = Path("/proc/meminfo")
    if info.exists():
        for line in info.read_text().splitlines():
            if line.startswith("MemAvailable:"):
                return 1024 * int(line.split()[1])
    return math.inf


def machine():
    """Processor, cores, load at the start and versions."""
    from qsmooth import __version__

    return {
        "processor": _processor(),
        "cores": os.cpu_count(),
        "load": round(os.getloadavg()[0], 1) if hasattr(os, "getloadavg") else None,
        "system": f"{platform.system()} {platform.machine()}",
        "python": platform.python_version(),
        "qsmooth": __version__,
        **{package: version(package) for package in ("numpy", "numba")},
    }


def machine_words(found):
    """The machine in one line."""
    return (
        f"{found['processor']}, {found['cores']} cores, {found['system']}; Python "
        f"{found['python']}, numpy {found['numpy']}, numba {found['numba']}, qsmooth "
        f"{found['qsmooth']}; load at the start {found['load']}"
    )


def _processor():
    info = Path("/proc/cpuinfo")
    if info.exists():
        for line in info.read_text().splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    return platform.processor() or platform.machine()


def markdown(head, rows):
    """Lines of a table."""
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join("| " + " | ".join(map(str, line)) + " |" for line in lines)
