"""The page that plays Gaussians in time, in headless Chromium, from disk and without a network.

usage: player_in_browser.py PAGE [--splats N] [--view VIEW.ppm --time SECONDS] [--screenshots FOLDER] [--bare]

The page has to draw alike with WebGL and in workers, differently at other times, and play by button and by key. VIEW
is the first view of the page at a time by the project's own renderer (binary PPM, 640 x 480, 75 degrees high).
--bare measures frames a second alone, at 1280 x 720, without a graphics card and with OpenGL in software.
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
parser.add_argument("page", type=pathlib.Path)
parser.add_argument("--splats", type=int)
parser.add_argument("--view", type=pathlib.Path)
parser.add_argument("--time", type=float)
parser.add_argument("--screenshots", type=pathlib.Path)
parser.add_argument("--bare", action="store_true")
asked = parser.parse_args()


def open_page(browser, draws):
    browser.do("POST", "/url", {"url": f"{asked.page.resolve().as_uri()}#{draws}"})
    # The address of a place within a page does not load it again.
    browser.do("POST", "/refresh", {})
    ready = "return window.omnilife && (omnilife.error || omnilife.ready)"
    webdriver.wait_for("Gaussians", lambda: browser.script(ready))
    webdriver.expect("error", browser.script("return omnilife.error"), None)
    webdriver.expect("drawn by", browser.script("return omnilife.draws"), draws)


def picture(browser):
    """Returns the image of the page once it is stable."""
    frames = None
    while frames != (frames := browser.script("return omnilife.frames")):
        time.sleep(1)
    # An image of WebGL is there until the page has been composed.
    url = browser.script("""omnilife.repaint();
        return document.querySelector('canvas').toDataURL('image/png')""")
    return blocks(pixels_of_png(base64.b64decode(url.split(",")[1])))


def at_time(browser, seconds):
    browser.script("omnilife.seek(arguments[0])", seconds)
    return picture(browser)


def look(browser):
    length = browser.script("return omnilife.length")
    times = [0, 0.4 * length, 0.9 * length]
    drawn = {}
    for draws in ("webgl", "worker"):
        open_page(browser, draws)
        if asked.splats is not None:
            webdriver.expect("Gaussians", browser.script("return omnilife.splats"), asked.splats)
        drawn[draws] = [at_time(browser, seconds) for seconds in times]
    for seconds, one, other in zip(times, drawn["webgl"], drawn["worker"]):
        alike = likeness(one, other)
        if alike < 0.98:
            sys.exit(f"at {seconds:.2f} s WebGL and workers draw with a likeness of {alike:.3f}")
    changed = max(abs(a - b) for a, b in zip(drawn["worker"][0], drawn["worker"][1]))
    if changed < 2:
        sys.exit(f"nothing moves: a change of {changed:.1f} levels")
    if asked.view:
        alike = likeness(at_time(browser, asked.time), expected_blocks(asked.view))
        print(f"a likeness of {alike:.3f} to the renderer")
        if alike < 0.98:
            sys.exit("the page draws another view than the renderer")
    for number, seconds in enumerate(times if asked.screenshots else []):
        at_time(browser, seconds)
        browser.screenshot(asked.screenshots / f"in-time-{number}.png")
    state = lambda: browser.script("return [omnilife.seconds, document.getElementById('play').textContent]")
    browser.script("omnilife.seek(0); document.querySelector('canvas').focus()")
    browser.press(" ")
    webdriver.wait_for("time that runs", lambda: state()[0] > 0.05)
    browser.press(" ")
    webdriver.expect("button", state()[1], "Play")
    browser.press(".")
    before = state()[0]
    browser.press(".")
    webdriver.wait_for("a step in time", lambda: state()[0] != before)


def frame_rate(browser):
    """Returns a line with frames a second while time runs."""
    browser.script("omnilife.play(true)")
    time.sleep(2)
    begun, frames = time.monotonic(), browser.script("return omnilife.frames")
    time.sleep(3)
    rate = (browser.script("return omnilife.frames") - frames) / (time.monotonic() - begun)
    share = browser.script("return omnilife.share")
    webdriver.expect("console", browser.console_errors(), [])
    return f"{rate:.1f} frames a second at {share:.2f} of the page's pixels along each side"


def offline(browser):
    browser.devtools("Network.enable")
    browser.devtools("Network.emulateNetworkConditions", offline=True, latency=0, downloadThroughput=0,
                     uploadThroughput=0)


if asked.bare:
    # Chromium puts pages together by itself without a graphics card, and by OpenGL in software where it is told to.
    for name, choose in [("no graphics card", lambda: None), ("software OpenGL", webdriver.draw_without_graphics_card)]:
        choose()
        with webdriver.browser(1300, 800) as browser:
            offline(browser)
            browser.size(1280, 720)
            open_page(browser, "worker")
            print(f"{name}: {frame_rate(browser)}")
    sys.exit()

webdriver.draw_without_graphics_card()
with webdriver.browser(1300, 800) as browser:
    offline(browser)
    browser.size(640, 480)
    open_page(browser, "worker")
    look(browser)
    # One who wants no motion is shown none unasked.
    still = {"name": "prefers-reduced-motion", "value": "reduce"}
    browser.devtools("Emulation.setEmulatedMedia", features=[still])
    open_page(browser, "worker")
    webdriver.expect("button", browser.script("return document.getElementById('play').textContent"), "Play")
    print(frame_rate(browser))
