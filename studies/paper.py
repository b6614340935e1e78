"""What `qsmooth paper` finds, as it stands in `docs/paper.md`.

    python studies/paper.py             # print the page
    python studies/paper.py --write     # run, store the figures, and write the page
    python studies/paper.py --stored    # write the page from what is stored

Times are left out: `benchmarks/paper.py` takes them.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

from qsmooth.paper.page import blocks, markdown_text
from qsmooth.paper.runs import run

ROOT = Path(__file__).resolve().parent.parent
RESULTS = ROOT / "studies" / "results" / "paper.json"
PAGE = ROOT / "docs" / "paper.md"
SOURCE = "<!-- python studies/paper.py --write -->\n\n"


def measured() -> dict[str, Any]:
    """Run all, and leave the times out."""
    found = run().found
    rows = [row | {"seconds": None} for row in found["rows"]]
    return found | {"rows": rows}


def stored() -> dict[str, Any]:
    """Figures of the run that the page shows."""
    found: dict[str, Any] = json.loads(RESULTS.read_text(encoding="utf-8"))
    return found


def page(found: dict[str, Any]) -> str:
    """Text of `docs/paper.md`."""
    return SOURCE + markdown_text(blocks(found, pictures=False))


def main() -> None:
    """Print the page, or write it."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--write", action="store_true", help="store the figures, write the page")
    parser.add_argument("--stored", action="store_true", help="write the page, run nothing")
    options = parser.parse_args()
    found = stored() if options.stored else measured()
    if options.write:
        RESULTS.write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")
    if options.write or options.stored:
        PAGE.write_text(page(found), encoding="utf-8")
    else:
        print(page(found))


if __name__ == "__main__":
    main()
