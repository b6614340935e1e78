"""The report's page in headless Chromium."""

import numpy as np
import pytest

from browser import made_report
from browser.looking import five_states, pane_centre, state

LAKE_SIDE = 155  # 24K quads


@pytest.fixture(scope="module")
def small(tmp_path_factory):
    path = tmp_path_factory.mktemp("report") / "small.html"
    return path, made_report.make(path, 12)


@pytest.fixture(scope="module")
def large(tmp_path_factory):
    path = tmp_path_factory.mktemp("report") / "large.html"
    return path, made_report.make(path, LAKE_SIDE)


def pixels(page, x, y):
    """The colour of the cells there, without marks, as channels."""
    code = """([x, y]) => {
        const canvas = document.getElementById("cells"), box = canvas.getBoundingClientRect();
        const copy = document.createElement("canvas");
        Object.assign(copy, {width: canvas.width, height: canvas.height});
        const context = copy.getContext("2d");
        context.drawImage(canvas, 0, 0);
        const ratio = canvas.width / box.width;
        return [...context.getImageData((x - box.x) * ratio, (y - box.y) * ratio, 1, 1).data];
    }"""
    return page.evaluate(code, [x, y])


def centre_of(truth, name, shown):
    """The mean of the corners of a cell, by its place in the file."""
    return truth[name]["uv"][truth["quads"][shown]].mean(axis=0)


def test_a_page_of_24k_quads_is_shown_in_five_states(open_page, large, pictures):
    path, truth = large
    page = open_page(path)
    assert state(page)["drawnCells"] == [LAKE_SIDE**2] * 2
    five_states(page, pictures)
    kept = state(page)["filter"]
    for side, name in enumerate(("before", "star")):
        values = truth[name]["figures"]["max_angle"].astype(np.float32)
        assert state(page)["drawnCells"][side] == ((values >= kept[0]) & (values <= kept[1])).sum()


@pytest.mark.parametrize("side", ["left", "right"])
def test_a_click_on_a_worst_cell_lands_on_it(open_page, small, side):
    path, truth = small
    page = open_page(path)
    button = page.locator(".worst-list").nth(int(side == "right")).get_by_role("button").first
    cell = int(button.get_attribute("data-cell"))
    button.click()
    page.wait_for_timeout(900)
    seen, name = state(page), {"left": "before", "right": "star"}[side]
    shown = int(np.flatnonzero(truth["ids"] == cell)[0])
    assert seen["selected"] == cell
    assert seen["centre"] == pytest.approx(centre_of(truth, name, shown).tolist(), abs=1e-5)
    assert seen["zoom"] > 2
    if side == "right":  # convex: its middle lies inside, in its colour of viridis
        share = truth[name]["figures"]["min_angle"][shown] / 90
        colour = page.evaluate("t => colourAt('viridis', t)", float(share))
        assert pixels(page, *pane_centre(page, side))[:3] == pytest.approx(colour, abs=3)


def test_hovering_tells_the_figures_of_the_file(open_page, small):
    path, truth = small
    page = open_page(path)
    page.evaluate("([cell]) => qsmoothReport.flyTo(cell, 'right')", [int(truth["ids"][30])])
    page.mouse.move(*pane_centre(page, "right"))
    page.wait_for_selector("#tip:not([hidden])")
    assert f"Cell {truth['ids'][30]} " in page.inner_text("#tip strong")
    for name in ("min_angle", "max_angle"):
        told = page.locator(f"#tip tr[data-metric={name}] td").all_inner_texts()
        values = [truth[which]["figures"][name][30] for which in ("before", "star")]
        assert [float(text.rstrip("°")) for text in told] == pytest.approx(values, abs=0.051)


def test_everything_by_keyboard(open_page, small):
    path, _ = small
    page = open_page(path)
    reached = set()
    for _ in range(70):
        page.keyboard.press("Tab")
        reached.add(
            page.evaluate(
                "() => document.activeElement.id || document.activeElement.className"
                ".baseVal || document.activeElement.dataset.cell"
            )
        )
    assert {"menu-left", "menu-metric", "menu-edges", "stage", "bin", "log-counts"} <= reached
    stage = page.locator("#stage")
    stage.focus()
    for key in ("+", "+", "ArrowRight", "ArrowUp"):
        page.keyboard.press(key)
    seen = state(page)
    assert seen["zoom"] == pytest.approx(1.25**2)
    assert min(seen["centre"]) > 0.51
    page.keyboard.press("Enter")
    assert state(page)["selected"] is not None
    page.keyboard.press("Escape")
    page.keyboard.press("Home")
    assert state(page)["zoom"] == 1
    assert state(page)["selected"] is None
    page.locator(".worst-list button").first.focus()
    page.keyboard.press("Enter")
    page.wait_for_timeout(900)
    assert state(page)["zoom"] > 2
    page.locator("g.bin[tabindex='0']").focus()
    for key in ("ArrowRight", "Enter"):
        page.keyboard.press(key)
    assert state(page)["filter"] == pytest.approx([3, 6])


def test_text_of_a_file_is_text(open_page, small):
    path, _ = small
    page = open_page(path)
    assert "It stopped <b>here</b>." in page.inner_text("#words")
    assert page.title().endswith("</script>")


def test_a_link_shows_the_place(open_page, small):
    path, truth = small
    cell = int(truth["ids"][5])
    page = open_page(
        path, fragment=f"#metric=max_angle&centre=0.25,0.75&zoom=4&filter=90,120&selected={cell}"
    )
    seen = state(page)
    assert (seen["metric"], seen["selected"], seen["filter"]) == ("max_angle", cell, [90, 120])
    assert seen["centre"] == [0.25, 0.75]
    assert seen["zoom"] == pytest.approx(4)


def test_pictures_without_webgl(open_page, small):
    path, _ = small
    code = """const kept = HTMLCanvasElement.prototype.getContext;
        HTMLCanvasElement.prototype.getContext = function (kind, ...rest) {
            return kind === "webgl2" ? null : kept.call(this, kind, ...rest);
        };"""
    page = open_page(path, before=code)
    assert state(page)["isFlat"]
    assert "no WebGL" in page.inner_text("#notice")
    page.evaluate("() => qsmoothReport.flyTo(0, 'right')")
    assert pixels(page, *pane_centre(page, "right"))[:3] != [255, 255, 255]


def test_narrow_windows_need_no_scrolling_sideways(open_page, small, pictures):
    path, _ = small
    page = open_page(path, width=800)
    assert page.evaluate("() => document.documentElement.scrollWidth") <= 800
    page.screenshot(path=pictures / "6-narrow.png", full_page=True)
