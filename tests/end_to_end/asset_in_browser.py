"""The page of an asset in headless Chromium, from disk and without a network.

usage: asset_in_browser.py PAGE VIEW.ppm [--splats N] [--moments N] [--screenshot FILE]

PAGE shows as many Gaussians, at the middle one of as many moments; VIEW is what the project's own renderer makes
of what the page shows at first (binary PPM, 640 x 480, 75 degrees high). The page has to show the same, and not
its mirror image.
"""

import argparse
import base64
import pathlib
import struct
import sys
import time
import zlib

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[2] / "scripts/browser"))
import webdriver  # noqa: E402

parser = argparse.ArgumentParser()
parser.add_argument("page")
parser.add_argument("view", type=pathlib.Path)
parser.add_argument("--splats", type=int)
parser.add_argument("--moments", type=int)
parser.add_argument("--screenshot")
asked = parser.parse_args()
webdriver.ARGUMENTS[:] = [argument for argument in webdriver.ARGUMENTS if argument != "--disable-gpu"] + [
    "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--ignore-gpu-blocklist"]


def pixels_of_png(data):
    """Rows of (red, green, blue) of an 8-bit PNG without interlacing."""
    at, body, size = 8, b"", None
    while at < len(data):
        length, kind = struct.unpack(">I4s", data[at:at + 8])
        chunk = data[at + 8:at + 8 + length]
        if kind == b"IHDR":
            size = struct.unpack(">IIBBBBB", chunk)
        elif kind == b"IDAT":
            body += chunk
        at += 12 + length
    width, height, _, colour = size[:4]
    step = {2: 3, 6: 4}[colour]
    raw, rows, before = zlib.decompress(body), [], bytes(width * step)
    for row in range(height):
        start = row * (width * step + 1)
        kind, line = raw[start], bytearray(raw[start + 1:start + 1 + width * step])
        for index in range(len(line)):
            left = line[index - step] if index >= step else 0
            above = before[index]
            corner = before[index - step] if index >= step else 0
            if kind == 1:
                line[index] = (line[index] + left) & 255
            elif kind == 2:
                line[index] = (line[index] + above) & 255
            elif kind == 3:
                line[index] = (line[index] + (left + above) // 2) & 255
            elif kind == 4:
                guess = left + above - corner
                near = min((abs(guess - left), 0, left), (abs(guess - above), 1, above),
                           (abs(guess - corner), 2, corner))
                line[index] = (line[index] + near[2]) & 255
        before = bytes(line)
        rows.append([tuple(line[at:at + 3]) for at in range(0, len(line), step)])
    return rows


def blocks(rows, side=16):
    """Mean grey of squares."""
    out = []
    for top in range(0, len(rows) - side + 1, side):
        for left in range(0, len(rows[0]) - side + 1, side):
            some = [sum(rows[y][x]) for y in range(top, top + side, 2) for x in range(left, left + side, 2)]
            out.append(sum(some) / len(some) / 3)
    return out


def likeness(a, b):
    """Correlation."""
    mean_a, mean_b = sum(a) / len(a), sum(b) / len(b)
    over = sum((x - mean_a) * (y - mean_b) for x, y in zip(a, b))
    spread = sum((x - mean_a) ** 2 for x in a) * sum((y - mean_b) ** 2 for y in b)
    return over / max(spread, 1e-9) ** 0.5


def picture(browser):
    """What is drawn, once nothing changes any more."""
    frames = None
    while frames != (frames := browser.script("return omnilife.frames")):
        time.sleep(1)
    url = browser.script("return document.querySelector('canvas').toDataURL('image/png')")
    return pixels_of_png(base64.b64decode(url.split(",")[1]))


def change(before, after):
    """The largest, in levels in a square."""
    return max(abs(a - b) for a, b in zip(before, after))


def wait_for_change(browser, what, before):
    """Squares of the first picture that differs. A moment that is chosen is seen after a sort in a worker and two
    drawings, for which a busy machine without a graphics card may need many seconds: no pause tells that they are
    over."""
    drawn = before

    def differs():
        nonlocal drawn
        drawn = blocks(picture(browser))
        return change(before, drawn) >= 2
    webdriver.wait_for(what, differs)
    return drawn


def look_at_moments(browser, moments):
    """The slider goes through all of them, each looks different, and time can be played."""
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


def expected_blocks(path):
    """Squares of a binary PPM."""
    data = path.read_bytes()
    width, height = (int(size) for size in data.split(maxsplit=4)[1:3])
    data = data[-3 * width * height:]
    return blocks([[tuple(data[3 * (y * width + x):3 * (y * width + x) + 3]) for x in range(width)]
                   for y in range(height)])


def wait_for_view(browser, expected):
    """What is drawn is what is expected, and not its mirror image; a line on how well."""
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


expected = expected_blocks(asked.view)
with webdriver.browser(700, 600) as browser:
    browser.devtools("Network.enable")
    browser.devtools("Network.emulateNetworkConditions", offline=True, latency=0, downloadThroughput=0,
                     uploadThroughput=0)
    browser.size(640, 480)
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
    webdriver.expect("console", browser.console_errors(), [])
print(f"first drawing after {seconds:.1f} s; {shown}")
