"""Files that are damaged at random, read by a process that may take so much time and memory.

A case is a seed and a number: it says which file is taken and what becomes of it, so that
``python tests/fuzzing.py --seed 1 --case 17 --keep FILE`` makes it again.
"""

from __future__ import annotations

import argparse
import json
import random
import re
import resource
import signal
import subprocess
import sys
import tempfile
import time
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path

from numba_cache import key_cache

MOST_SECONDS = 2.0  # of processor time, on a machine that does nothing else
MOST_MEMORY = 500 << 20
MOST_BYTES = 1 << 20
# Every so many cases a new process: what one leaves behind is not the next one's fault.
CASES_A_PROCESS = 2000
SHARED = Path(__file__).resolve().parent.parent.parent / "shared" / "meshes"
NOT_MESHES = (".md", ".py", ".poly")

NUMBER = re.compile(rb"(?<![\w.])-?\d+(?:\.\d*)?(?:[eE][-+]?\d+)?(?![\w.])")
ODD_NUMBERS = (
    b"0 -1 1 2 7 1000000 1000000000 2147483647 2147483648 4294967295 -2147483648 "
    b"9223372036854775807 9223372036854775808 -9223372036854775809 1e308 1e400 -1e400 nan inf "
    b"-inf 1.5 0x10 1_000 word '' \xc3\xa9 1e-320 " + 400 * b"9"
).split()
ODD_BYTES = (b"\0", b"\xff", b"\n", b"\r", b" ", b"\t", b"<", b">", b"&", b'"', b"#", b"$", b"*")


def flip(data: bytearray, rng: random.Random) -> None:
    for _ in range(rng.choice((1, 1, 3, 20))):
        data[rng.randrange(len(data))] = rng.randrange(256)


def cut_off(data: bytearray, rng: random.Random) -> None:
    del data[rng.randrange(len(data)) :]


def cut_out(data: bytearray, rng: random.Random) -> None:
    begin = rng.randrange(len(data))
    del data[begin : begin + rng.choice((1, 2, 4, 30, 1000))]


def repeat(data: bytearray, rng: random.Random) -> None:
    begin = rng.randrange(len(data))
    piece = data[begin : begin + rng.choice((1, 8, 100, 3000))]
    data[begin:begin] = rng.choice((1, 2, 50)) * piece


def lines(data: bytearray, rng: random.Random) -> None:
    rows = data.split(b"\n")
    i, j = rng.randrange(len(rows)), rng.randrange(len(rows))
    what = rng.randrange(4)
    if what == 0:
        del rows[i]
    elif what == 1:
        rows.insert(i, rows[i])
    elif what == 2:
        rows[i], rows[j] = rows[j], rows[i]
    else:
        del rows[min(i, j) : max(i, j)]
    data[:] = b"\n".join(rows)


def number(data: bytearray, rng: random.Random) -> None:
    begin = rng.choice((0, 0, rng.randrange(len(data))))  # counts stand at the beginning
    found = list(NUMBER.finditer(bytes(data[begin : begin + 3000])))
    if found:
        one = rng.choice(found)
        data[begin + one.start() : begin + one.end()] = rng.choice(ODD_NUMBERS)


def word(data: bytearray, rng: random.Random) -> None:
    found = list(re.finditer(rb"[A-Za-z_$*]+", bytes(data[:20000])))
    if found:
        one = rng.choice(found)
        other = bytes(data[slice(*rng.choice(found).span())])
        data[one.start() : one.end()] = rng.choice((b"", b"x", other, other, one[0].swapcase()))


def integer(data: bytearray, rng: random.Random) -> None:
    size = rng.choice((1, 2, 4, 4, 8))
    begin = rng.randrange(len(data))
    value = rng.choice((0, -1, 1, 255, (1 << (8 * size - 1)) - 1, -(1 << (8 * size - 1))))
    order = rng.choice(("little", "big"))
    value = max(min(value, (1 << (8 * size - 1)) - 1), -(1 << (8 * size - 1)))
    data[begin : begin + size] = value.to_bytes(size, order, signed=True)


def odd_byte(data: bytearray, rng: random.Random) -> None:
    begin = rng.randrange(len(data))
    data[begin:begin] = rng.choice((1, 1, 1000)) * rng.choice(ODD_BYTES)


def ends_of_lines(data: bytearray, rng: random.Random) -> None:
    data[:] = data.replace(b"\n", rng.choice((b"\r\n", b"\r", b" ", b"\n\n", b"\x0c")))


def encoding(data: bytearray, rng: random.Random) -> None:
    text = data.decode("latin-1")
    data[:] = text.encode(rng.choice(("utf-16", "utf-32", "utf-8", "utf-8-sig", "utf-16-be")))


MUTATIONS: tuple[Callable[[bytearray, random.Random], None], ...] = (
    flip, cut_off, cut_out, repeat, lines, lines, number, number, number, word, word, integer,
    odd_byte, ends_of_lines, encoding,
)  # fmt: skip


def samples(written: Path) -> dict[str, bytes]:
    """Good files by name: samples, what is written in each format, real ones where there are."""
    from format_samples import ALONE, EVERY, content_of

    found = {name: content_of(name) for name in EVERY} | ALONE
    found |= {path.name: path.read_bytes() for path in sorted(written.iterdir())}
    for folder in (SHARED, SHARED / "more"):
        if folder.is_dir():
            for path in sorted(folder.iterdir()):
                if path.is_file() and path.suffix not in NOT_MESHES:
                    data = path.read_bytes()
                    if len(data) <= MOST_BYTES:
                        found[path.name] = data
    return found


def write_all(folder: Path) -> None:
    """Write a mesh in each format that can hold it."""
    from qsmooth.errors import MeshError
    from qsmooth.examples import jittered
    from qsmooth.io import formats, write_mesh

    mesh = jittered(5, 5, kind="mixed", seed=1)
    for name, endings in formats().items():
        if not endings:  # a folder
            continue
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            try:
                write_mesh(folder / f"written-{name}{endings[0]}", mesh, format=name)
            except (MeshError, ImportError):
                continue


def damaged(files: dict[str, bytes], seed: int, case: int) -> tuple[str, bytes]:
    """Make a case: the name that it is read by, and what is in it."""
    rng = random.Random(f"{seed} {case}")
    # Small files more often: more of their bytes matter.
    name = rng.choice(list(files))
    if len(files[name]) > 50_000 and rng.random() < 0.7:
        name = rng.choice([other for other, data in files.items() if len(data) <= 50_000])
    data = bytearray(files[name])
    for _ in range(rng.choice((1, 1, 1, 2, 4))):
        if data:
            rng.choice(MUTATIONS)(data, rng)
    return name, bytes(data[:MOST_BYTES])


def fault(path: Path) -> str:
    """Read a file; what is wrong with how that went, or nothing."""
    from qsmooth.errors import MeshError, MeshWarning
    from qsmooth.io import read_mesh

    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        try:
            read_mesh(path)
        except MeshError as error:
            causes, cause = [], error.__cause__
            while cause is not None:
                causes.append(cause)
                cause = cause.__cause__ or cause.__context__
            if any(isinstance(cause, MemoryError) for cause in causes):
                return "memory"
            if str(path) not in str(error):
                return f"a message without the file's name: {error}"
        except BaseException as error:  # the rest is what is looked for
            import traceback

            where = traceback.extract_tb(error.__traceback__)[-1]
            return f"{type(error).__name__}: {error} in {where.filename}:{where.lineno}"[:300]
    strange = [str(one.message) for one in said if not issubclass(one.category, MeshWarning)]
    return f"a warning: {strange[0]}" if strange else ""


def run(
    seed: int, first: int, last: int, until: float, written: Path, most: float = MOST_SECONDS
) -> None:
    """Read the cases from `first` on, and print which and what was wrong; the child's part."""
    files = samples(written)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for good in ("a.off", "a.vtu", "v2.msh"):  # compiles, and loads what is slow to load
            (folder / good).write_bytes(files[good])
            assert fault(folder / good) == ""
        (folder / "a.bdf").write_bytes(b"x")
        fault(folder / "a.bdf")
        used = int(re.search(r"VmSize:\s+(\d+)", Path("/proc/self/status").read_text())[1]) << 10
        resource.setrlimit(resource.RLIMIT_AS, (used + MOST_MEMORY, -1))
        # Time that other programs take does not count; nothing can catch it, C code neither.
        signal.signal(signal.SIGPROF, signal.SIG_DFL)
        for case in range(first, last):
            if time.monotonic() > until:
                print(json.dumps([case, "stop"]), flush=True)
                return
            name, data = damaged(files, seed, case)
            path = folder / name
            path.write_bytes(data)
            print(json.dumps([case, "begin", name]), flush=True)
            signal.setitimer(signal.ITIMER_PROF, most)
            wrong = fault(path)
            signal.setitimer(signal.ITIMER_PROF, 0.0)
            path.unlink()
            if wrong:
                print(json.dumps([case, "wrong", f"{name}: {wrong}"]), flush=True)
    print(json.dumps([last, "end"]), flush=True)


def fuzz(
    seed: int, seconds: float, first: int = 0, most: float = MOST_SECONDS
) -> Iterator[tuple[int, str]]:
    """Read cases for so many seconds; give those that went wrong, then the number of the next."""
    until = time.monotonic() + seconds
    case = first
    with tempfile.TemporaryDirectory() as written:
        write_all(Path(written))
        while time.monotonic() < until:
            arguments = ["--seed", seed, "--case", case, "--until", until, "--written", written,
                         "--most", most]  # fmt: skip
            child = subprocess.Popen(
                [sys.executable, __file__, *map(str, arguments)],
                stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
            )  # fmt: skip
            said, errors = child.communicate()
            rows = [json.loads(line) for line in said.splitlines()]
            yield from ((row[0], row[2]) for row in rows if row[1] == "wrong")
            if not rows:
                raise RuntimeError(errors)
            case, what = rows[-1][:2]
            if what not in ("stop", "end"):
                name = signal.Signals(-child.returncode).name if child.returncode < 0 else ""
                over = f"over {most} s" if name == "SIGPROF" else f"died, {name} {errors}"
                yield case, f"{rows[-1][2]}: {over[:1000]}"
                case += 1
    yield case, ""


def main() -> None:
    key_cache()
    parser = argparse.ArgumentParser()
    parser.add_argument("--seed", type=int, required=True)
    parser.add_argument("--case", type=int, required=True)
    parser.add_argument("--until", type=float, default=0.0)
    parser.add_argument("--written", type=Path)
    parser.add_argument("--most", type=float, default=MOST_SECONDS)
    parser.add_argument("--keep", type=Path)
    given = parser.parse_args()
    if given.keep:
        with tempfile.TemporaryDirectory() as written:
            write_all(Path(written))
            name, data = damaged(samples(Path(written)), given.seed, given.case)
        given.keep.write_bytes(data)
        print(f"{given.keep}: read it as {name}")
        return
    last = given.case + CASES_A_PROCESS
    run(given.seed, given.case, last, given.until, given.written, given.most)


if __name__ == "__main__":
    main()
