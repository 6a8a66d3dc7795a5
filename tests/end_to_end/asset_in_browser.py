"""The page of an asset in headless Chromium, from disk and without a network.

usage: asset_in_browser.py PAGE VIEW.ppm [--splats N] [--moments N] [--screenshot FILE]

PAGE shows N Gaussians, at the middle one of N moments. VIEW is the first view of the page by the project's own
renderer (binary PPM, 640 x 480, 75 degrees high). The page has to show the same, and not its mirror image.
"""

import argparse
import base64
import pathlib
import sys
import time

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[2] / "scripts/browser"))
import webdriver  # noqa: E402
from pictures import blocks, expected_blocks, likeness, pixels_of_png  # noqa: E402

parser = argparse.ArgumentParser()
parser.add_argument("page")
parser.add_argument("view", type=pathlib.Path)
parser.add_argument("--splats", type=int)
parser.add_argument("--moments", type=int)
parser.add_argument("--screenshot")
asked = parser.parse_args()
webdriver.draw_without_graphics_card()


def picture(browser):
    """Returns the image of the page once it is stable."""
    frames = None
    while frames != (frames := browser.script("return omnilife.frames")):
        time.sleep(1)
    url = browser.script("return document.querySelector('canvas').toDataURL('image/png')")
    return pixels_of_png(base64.b64decode(url.split(",")[1]))


def change(before, after):
    """Returns the largest change of a square, in levels."""
    return max(abs(a - b) for a, b in zip(before, after))


def wait_for_change(browser, what, before):
    """Returns the squares of the first image that differs.

    A chosen moment is visible after a sort in a worker and two frames. A busy machine without a graphics card may
    need many seconds for them, so that no fixed pause is long enough.
    """
    drawn = before

    def differs():
        nonlocal drawn
        drawn = blocks(picture(browser))
        return change(before, drawn) >= 2
    webdriver.wait_for(what, differs)
    return drawn


def look_at_moments(browser, moments):
    """Checks that the slider reaches all moments, that each looks different, and that time can be played."""
    webdriver.wait_for("the middle moment", lambda: browser.script("return omnilife.moment") == moments // 2)
    webdriver.expect("moments", browser.script("return omnilife.moments"), moments)
    drawn = blocks(picture(browser))
    for moment in (0, moments - 1):
        browser.script("""const slider = document.getElementById("moment");
            slider.value = arguments[0]; slider.dispatchEvent(new Event("input"))""", moment)
        webdriver.wait_for(f"moment {moment}", lambda: browser.script("return omnilife.moment") == moment)
        before, drawn = drawn, wait_for_change(browser, f"a picture of moment {moment}", drawn)
        print(f"moment {moment} differs by {change(before, drawn):.1f} levels in a square")
    # Keys work while the slider has the focus, as after it was dragged.
    browser.script("document.getElementById('moment').focus()")
    browser.press(",")
    webdriver.wait_for("the moment before", lambda: browser.script("return omnilife.moment") == moments - 2)
    browser.press(" ")
    webdriver.wait_for("another moment", lambda: browser.script("return omnilife.moment") != moments - 2)
    browser.press(" ")
    browser.script("omnilife.seek(arguments[0])", moments // 2)
    webdriver.wait_for("the middle moment", lambda: browser.script("return omnilife.moment") == moments // 2)


def wait_for_view(browser, expected):
    """Waits until the page shows the expected image and not its mirror image; returns a line on the agreement."""
    said = None

    def shows():
        nonlocal said
        drawn = picture(browser)
        straight = likeness(blocks(drawn), expected)
        mirrored = likeness(blocks([row[::-1] for row in drawn]), expected)
        said = f"likeness {straight:.3f}, mirrored {mirrored:.3f}"
        return straight >= 0.8 and mirrored <= straight - 0.1
    webdriver.wait_for("view as the renderer draws it", shows, lambda: said)
    return said


def stands_still(browser):
    frames = browser.script("return omnilife.frames")
    time.sleep(2)
    return browser.script("return omnilife.frames") == frames


def reduce_motion(browser, is_reduced):
    value = "reduce" if is_reduced else "no-preference"
    browser.devtools("Emulation.setEmulatedMedia", features=[{"name": "prefers-reduced-motion", "value": value}])


def moves_unrequested(browser):
    """Checks that the page plays, or turns around, until a key is pressed, and that its panel folds."""
    browser.open(asked.page)
    if asked.moments is not None and asked.moments > 1:
        playing = "return document.getElementById('play').textContent === 'Pause'"
        webdriver.wait_for("moments that play", lambda: browser.script(playing))
        browser.press(" ")
        webdriver.wait_for("the pause", lambda: not browser.script(playing))
    else:
        turned = "return window.omnilife && omnilife.ready && omnilife.frames"
        webdriver.wait_for("Gaussians", lambda: browser.script(turned))
        frames = browser.script(turned)
        webdriver.wait_for("a scene that turns", lambda: browser.script(turned) > frames + 3)
        browser.press("x")
        webdriver.wait_for("end of turning", lambda: stands_still(browser))
    browser.script("document.querySelector('#controls summary').click()")
    webdriver.expect("panel", browser.script("return document.getElementById('controls').open"), False)


expected = expected_blocks(asked.view)
with webdriver.browser(700, 600) as browser:
    browser.devtools("Network.enable")
    browser.devtools("Network.emulateNetworkConditions", offline=True, latency=0, downloadThroughput=0,
                     uploadThroughput=0)
    browser.size(640, 480)
    reduce_motion(browser, True)
    begun = time.monotonic()
    browser.open(asked.page)
    state = "return window.omnilife && (omnilife.error || (omnilife.ready && omnilife.frames > 1))"
    webdriver.wait_for("Gaussians", lambda: browser.script(state))
    seconds = time.monotonic() - begun
    webdriver.expect("error", browser.script("return omnilife.error"), None)
    if asked.splats is not None:
        webdriver.expect("Gaussians", browser.script("return omnilife.splats"), asked.splats)
    # A sort follows the first drawing; after it nothing is drawn until something changes.
    webdriver.wait_for("end of drawing", lambda: stands_still(browser))
    if asked.moments is not None:
        look_at_moments(browser, asked.moments)
    shown = wait_for_view(browser, expected)
    if asked.screenshot:
        browser.screenshot(asked.screenshot)
    reduce_motion(browser, False)
    moves_unrequested(browser)
    webdriver.expect("console", browser.console_errors(), [])
print(f"first drawing after {seconds:.1f} s; {shown}")
