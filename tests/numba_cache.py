"""A folder of its own for Numba's cache in each state of the kernels.

Numba's cache sees an edit to a kernel's own file, not to a helper it calls, and ignores the
bounds-check flag: without this a broken helper would pass the suite. Kernels import nothing but
each other and the array types, so an edit anywhere else costs no compilation.
"""

import hashlib
import importlib.util
import os
import tempfile
from pathlib import Path


def key_cache() -> Path:
    """Point NUMBA_CACHE_DIR at the folder for these sources; call it before Numba is imported."""
    spec = importlib.util.find_spec("qsmooth")
    assert spec is not None
    assert spec.origin is not None
    package = Path(spec.origin).parent
    digest = hashlib.sha256(os.environ.get("NUMBA_BOUNDSCHECK", "").encode())
    digest.update(str(package).encode())
    for path in (package / "_types.py", *sorted((package / "kernels").rglob("*.py"))):
        digest.update(str(path.relative_to(package)).encode())
        digest.update(path.read_bytes())
    folder = Path(tempfile.gettempdir()) / f"qsmooth-numba-{os.getuid()}" / digest.hexdigest()[:16]
    os.environ["NUMBA_CACHE_DIR"] = str(folder)
    return folder
