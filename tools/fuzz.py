"""Read damaged mesh files for a while: ``python tools/fuzz.py --seconds 3600 --seed 7``.

Each has to be a mesh or a MeshError within two seconds and 500 MB. Prints what was not; exit code 1
where anything was. ``--keep FOLDER`` stores those files.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "tests"))

from fuzzing import damaged, fuzz, samples, write_all
from numba_cache import key_cache


def main() -> int:
    """Run the command."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--first", type=int, default=0, help="Number of the first case.")
    parser.add_argument("--keep", type=Path, help="Folder for the files that went wrong.")
    given = parser.parse_args()
    key_cache()
    with tempfile.TemporaryDirectory() as written:
        write_all(Path(written))
        files = samples(Path(written))
    wrong = 0
    for case, what in fuzz(given.seed, given.seconds, given.first):
        if not what:
            print(f"{case - given.first} cases, {wrong} went wrong")
            continue
        wrong += 1
        print(f"seed {given.seed}, case {case}: {what}", flush=True)
        if given.keep:
            given.keep.mkdir(exist_ok=True)
            name, data = damaged(files, given.seed, case)
            (given.keep / f"{case}-{name}").write_bytes(data)
    return int(wrong > 0)


if __name__ == "__main__":
    sys.exit(main())
