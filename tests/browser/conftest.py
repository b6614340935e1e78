"""A headless Chromium, and pages in it that must not complain."""

import os
import shutil
from pathlib import Path

import pytest

REQUIRED = os.environ.get("QSMOOTH_REQUIRE_BROWSER") == "1"
SOFTWARE_GL = [
    "--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"
]  # fmt: skip


def missing(what):
    if REQUIRED:
        pytest.fail(f"{what} is missing, and QSMOOTH_REQUIRE_BROWSER is set")
    pytest.skip(f"{what} is not here; see tests/browser/install.sh")


@pytest.fixture(scope="session")
def chromium():
    executable = shutil.which("chromium")
    if executable is None:
        missing("chromium")
    try:
        from playwright.sync_api import sync_playwright
    except ImportError:
        missing("playwright")
    with sync_playwright() as play:
        browser = play.chromium.launch(executable_path=executable, args=SOFTWARE_GL)
        yield browser
        browser.close()


@pytest.fixture
def open_page(chromium):
    """Opens a file; afterwards nothing may have been complained of or asked of the network."""
    contexts, troubles = [], []

    def opened(path, width=1280, height=900, timeout=30, before=None, fragment=""):
        context = chromium.new_context(viewport={"width": width, "height": height})
        contexts.append(context)
        page = context.new_page()
        page.set_default_timeout(1000 * timeout)
        if before:
            page.add_init_script(before)
        page.on(
            "console", lambda said: said.type in ("error", "warning") and troubles.append(said.text)
        )
        page.on("pageerror", lambda error: troubles.append(str(error)))
        page.on("requestfailed", lambda request: troubles.append(request.url))
        page.on(
            "request", lambda asked: asked.url.startswith("http") and troubles.append(asked.url)
        )
        page.goto(path.as_uri() + fragment)
        page.evaluate("() => qsmoothReport.ready")
        page.wait_for_function("() => qsmoothReport.state().isComplete")
        return page

    yield opened
    for context in contexts:
        context.close()
    # Reading pixels back, as tests and screenshots do, is slow, and Chromium says so.
    assert [text for text in troubles if "ReadPixels" not in text] == []


@pytest.fixture(scope="session")
def pictures(tmp_path_factory):
    """Where screenshots go; QSMOOTH_PICTURES names a folder to keep them in."""
    kept = os.environ.get("QSMOOTH_PICTURES")
    folder = Path(kept) if kept else tmp_path_factory.mktemp("pictures")
    folder.mkdir(parents=True, exist_ok=True)
    return folder
