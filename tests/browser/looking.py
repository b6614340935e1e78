"""What is seen on a report's page."""


def state(page):
    return page.evaluate("() => qsmoothReport.state()")


def settled(page):
    page.evaluate("() => new Promise(r => requestAnimationFrame(() => requestAnimationFrame(r)))")


def landed(page):
    """Wait until a flight is over."""
    page.wait_for_function("() => !qsmoothReport.state().isFlying")


def pane_centre(page, side):
    box = page.locator("#stage").bounding_box()
    share = 0.25 if side == "left" else 0.75
    return box["x"] + box["width"] * share, box["y"] + box["height"] / 2


def five_states(page, pictures, prefix=""):
    """Screenshots: whole, by quantiles, flown to one of the worst left, filtered, in print."""

    def picture(name, **how):
        settled(page)
        page.screenshot(path=pictures / f"{prefix}{name}.png", **how)

    picture("1-whole")
    page.select_option("#menu-metric", "aspect_ratio")
    page.select_option("#menu-scale", "quantiles")
    page.wait_for_function("() => qsmoothReport.state().metric === 'aspect_ratio'")
    picture("2-quantiles")
    page.select_option("#menu-metric", "max_angle")
    page.select_option("#menu-scale", "range")
    page.wait_for_function("() => qsmoothReport.state().metric === 'max_angle'")
    page.locator(".worst-list").nth(1).get_by_role("button").nth(1).click()
    landed(page)
    picture("3-flown")
    page.locator("#stage").press("0")
    page.locator("#histogram g.bin").nth(9).dispatch_event("pointerdown")
    picture("4-filtered", full_page=True)
    page.emulate_media(media="print")
    picture("5-print", full_page=True)
    (pictures / f"{prefix}5-print.pdf").write_bytes(page.pdf())
    page.emulate_media(media="screen")
