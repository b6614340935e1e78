"""Links, anchors and images of the documentation, in Markdown and in HTML where that is built.

QSMOOTH_BUILT_DOCS names the folder of the HTML; `.ci/run` builds it and sets that.
"""

import os
import re
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

import pytest

import qsmooth

ROOT = Path(__file__).resolve().parent.parent
PAGES = sorted(
    [*ROOT.glob("*.md"), *(ROOT / "docs").glob("*.md"), *(ROOT / "docs/api").glob("*.md")]
)
REMOTE = ("http", "https", "mailto", "data", "javascript")


def anchors(text):
    """Ids that GitHub gives to the headings of a page."""
    headings = re.findall(
        r"^#+ +(.*?)\s*$", re.sub(r"^```.*?^```", "", text, flags=re.M | re.S), re.M
    )
    return {re.sub(r"[^\w\- ]", "", h.lower()).replace(" ", "-") for h in headings}


@pytest.mark.parametrize("path", PAGES, ids=lambda path: path.name)
def test_links_and_images_of_markdown(path):
    missing = []
    for target in re.findall(r"\]\(([^)\s]+)\)", path.read_text(encoding="utf-8")):
        parts = urlsplit(target)
        if parts.scheme in REMOTE:
            continue
        file = path.parent / parts.path if parts.path else path
        if not file.exists() or (
            parts.fragment and parts.fragment not in anchors(file.read_text(encoding="utf-8"))
        ):
            missing.append(target)
    assert missing == []


class Found(HTMLParser):
    """Ids of a page, what it links to, and what a browser would fetch to show it."""

    def __init__(self, path):
        super().__init__()
        self.ids, self.links, self.fetched = set(), [], []
        self.feed(path.read_text(encoding="utf-8"))

    def handle_starttag(self, tag, attrs):
        given = dict(attrs)
        self.ids.update(given[name] for name in ("id", "name") if given.get(name))
        if tag == "a" and given.get("href"):
            self.links.append(given["href"])
        elif tag == "link" and given.get("rel") == "stylesheet":
            self.fetched.append(given["href"])
        elif tag in ("img", "script", "source", "iframe") and given.get("src"):
            self.fetched.append(given["src"])


def test_links_and_images_of_the_built_pages():
    folder = os.environ.get("QSMOOTH_BUILT_DOCS")
    if not folder:
        pytest.skip("QSMOOTH_BUILT_DOCS does not say where the documentation was built")
    pages = {path.resolve(): Found(path) for path in Path(folder).rglob("*.html")}
    assert len(pages) > 20
    missing = []
    for path, found in pages.items():
        for target in [*found.links, *found.fetched]:
            parts = urlsplit(target)
            if parts.scheme in REMOTE:
                if target in found.fetched and parts.scheme != "data":
                    missing.append((path.name, target, "fetched from elsewhere"))
                continue
            file = (path.parent / unquote(parts.path)).resolve() if parts.path else path
            fragment = unquote(parts.fragment)
            known = pages[file].ids if file in pages else set()
            if not file.exists() or (fragment and file in pages and fragment not in known):
                missing.append((path.name, target))
    assert missing == []


def test_every_public_name_is_on_a_page():
    text = "\n".join(p.read_text(encoding="utf-8") for p in (ROOT / "docs/api").glob("*.md"))
    named = re.findall(r"^\.\. auto\w+:: qsmooth\.(\w+)$", text, re.MULTILINE)
    assert sorted(named) == sorted(set(qsmooth.__all__) - {"__version__"})


def test_every_page_is_in_the_index():
    index = (ROOT / "docs/index.md").read_text(encoding="utf-8")
    listed = set(re.findall(r"^([\w-]+)$", index, re.MULTILINE)) | {"index"}
    assert {path.stem for path in (ROOT / "docs").glob("*.md")} == listed
