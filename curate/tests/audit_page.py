"""Uses an audit page in headless Chromium as people would.

    python3 audit_page.py expert|annotator PAGE DOWNLOADS [SCREENSHOTS]

The expert accepts the first boundary, rejects the second, moves the third by one frame with the
keyboard, adds one, undoes and redoes, and opens the page again. The annotator scrubs the video by
keys, marks a segment from 2.4 s to the end of the frame at 4.0 s, cuts and labels it, leaves out what
begins at 4.8 s, and cannot touch what others proposed. DOWNLOADS/decisions.json is then what the page saved. With SCREENSHOTS, a
folder, images of the page at 1,400 and 390 pixels go there.
"""

import pathlib
import sys

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[2] / "scripts/browser"))
from webdriver import browser, expect, wait_for  # noqa: E402

SHIFT, LEFT, RIGHT = "\ue008", "\ue012", "\ue014"
STATES = "return [...document.querySelectorAll('#boundaries li')].filter(li => !li.hidden).map(li => li.dataset.state)"
UNNAMED = """return [...document.querySelectorAll('input,select,button,img,video')]
    .filter(e => !(e.labels?.length || e.ariaLabel || e.textContent.trim() || e.alt || e.querySelector('img[alt]')))
    .map(e => e.outerHTML.slice(0, 80))"""


def click(page, selector):
    page.script("document.querySelector(arguments[0]).click()", selector)


def fill(page, selector, value):
    page.script("""const field = document.querySelector(arguments[0]);
        field.value = arguments[1]; field.dispatchEvent(new Event('change', { bubbles: true }))""", selector, value)


def held(page, modifier, key):
    strokes = [("keyDown", modifier), ("keyDown", key), ("keyUp", key), ("keyUp", modifier)]
    actions = [{"type": kind, "value": value} for kind, value in strokes]
    page.do("POST", "/actions", {"actions": [{"type": "key", "id": "keyboard", "actions": actions}]})


def text(page, selector):
    return page.script("return document.querySelector(arguments[0]).textContent", selector)


def shows_frame(page, frame):
    """The video stands at a frame: asked for, decoded, and its image drawn."""
    at = "return [shown, player.seeking ? 'seeking' : frameAt(player.currentTime + data.times[0])]"
    wait_for(f"frame {frame} shown and reached", lambda: page.script(at) == [frame, frame],
             found=lambda: page.script(at))


def look_at(page, screenshots, name):
    if screenshots:
        for width, height, phone in ((1400, 900, False), (390, 844, True)):
            page.size(width, height, phone)
            page.screenshot(screenshots / f"{name}-{width}.png")
        page.size(1280, 1400)


def check_page(page):
    expect("outside requests", page.script(
        "return performance.getEntriesByType('resource').filter(e => /^http/.test(e.name)).length"), 0)
    expect("elements without a name", page.script(UNNAMED), [])
    expect("images", page.script(
        "return [...document.images].every(i => i.src.startsWith('data:image/jpeg;base64,'))"), True)
    for width, phone in ((1400, False), (390, True)):
        page.size(width, 844, phone)
        expect(f"pixels that hang over at {width}", page.script(
            "return document.documentElement.scrollWidth - document.documentElement.clientWidth"), 0)
    page.size(1280, 1400)
    # What files are called is text, never markup.
    expect("elements out of a name", page.script("return document.querySelectorAll('b.injected').length"), 0)
    expect("the file's name", page.script("return document.querySelector('#video').textContent.split(': ')[0]"),
           page.script("return data.source.file_name"))
    wait_for("playable video", lambda: page.script("return player.readyState >= 2 && player.videoWidth > 0"))


def expert(page, screenshots):
    count = len(page.script(STATES))
    # Without a name nothing is saved.
    click(page, "#save")
    expect("a hint", "name" in text(page, "#status"), True)
    fill(page, "#author", "Kim")
    fill(page, "#reason", "sharp")
    page.script("document.querySelector('#boundaries li').focus()")
    page.press("a", "n", "r", "n", ".")
    expect("states", page.script(STATES)[:3], ["accepted", "rejected", "moved"])
    # A cut before the frame at 0.48 s.
    page.script("seek(12)")
    page.press("1")
    expect("boundaries", len(page.script(STATES)), count + 1)
    times = page.script("return rows.map(row => row.begin)")
    expect("rows in order of time", times, sorted(times))
    page.press("u")
    expect("boundaries after undo", len(page.script(STATES)), count)
    held(page, SHIFT, "u")
    expect("boundaries after redo", len(page.script(STATES)), count + 1)
    page.script("rows.find(row => row.added).item.querySelectorAll('button')[1].click()")
    expect("boundaries after removing what was added", len(page.script(STATES)), count)
    page.press("u")
    expect("boundaries after undoing that", len(page.script(STATES)), count + 1)
    look_at(page, screenshots, "expert")


def annotator(page, screenshots):
    fill(page, "#author", "Ada")
    fill(page, "#role", "annotator")
    before = page.script(STATES)
    page.press("a")
    expect("states that an annotator cannot change", page.script(STATES), before)
    # By seconds, then by frames: 60 frames of 25 a second are 2.4 s.
    held(page, SHIFT, RIGHT)
    held(page, SHIFT, RIGHT)
    shows_frame(page, 50)
    page.press(*[RIGHT] * 11, LEFT)
    shows_frame(page, 60)
    page.press("i")
    # Playing forwards and backwards moves the video.
    page.press("l")
    wait_for("playing", lambda: page.script("return shown") > 62)
    page.press("k")
    stood = page.script("return shown")
    page.press("j")
    wait_for("playing backwards", lambda: page.script("return shown") < stood - 1)
    page.press("k")
    expect("paused", page.script("return player.paused && !backwards"), True)
    page.script("seek(100)")
    shows_frame(page, 100)
    page.press("o")
    fill(page, "#scene", "night-market")
    fill(page, "#action", "walking")
    look_at(page, screenshots, "annotator")
    page.press("g")
    expect("a label", "night-market, walking" in text(page, "#labels"), True)
    expect("cuts at its ends", page.script(STATES).count("added"), 2)
    # The last part is left out.
    for frame, key in ((120, "i"), (159, "o")):
        page.script("seek(arguments[0])", frame)
        shows_frame(page, frame)
        page.press(key)
    fill(page, "#scene", "")
    fill(page, "#action", "")
    click(page, "#leave-out")
    page.press("g")
    expect("a segment left out", "left out" in text(page, "#labels"), True)
    expect("the next one is not", page.script("return document.querySelector('#leave-out').checked"), False)
    # The timeline is dragged by a finger, too.
    box = page.script("const b = timeline.getBoundingClientRect(); return [b.left, b.top + b.height / 2, b.width]")
    page.drag((box[0] + 5, box[1]), (box[0] + box[2] / 2, box[1]), "touch")
    wait_for("dragged position", lambda: abs(page.script("return shown") - 80) <= 2)


def keeper(page, screenshots):
    """What was left out is kept after all."""
    fill(page, "#author", "Ada")
    fill(page, "#role", "annotator")
    expect("a segment left out", "left out" in text(page, "#labels"), True)
    buttons = "return [...document.querySelectorAll('#labels button')].map(button => button.textContent)"
    expect("one can be kept", page.script(buttons).count("Keep after all"), 1)
    page.script("[...document.querySelectorAll('#labels button')]"
                ".find(button => button.textContent === 'Keep after all').click()")
    expect("it is kept", "kept after all" in text(page, "#labels"), True)
    expect("no other can be kept", page.script(buttons).count("Keep after all"), 0)
    look_at(page, screenshots, "keeper")


def reopen(page, address):
    """What was decided is there again when the page is opened again."""
    state = "return [[...document.querySelectorAll('#boundaries li')].map(li => [li.hidden, li.dataset.state]), " \
            "document.querySelector('#labels').textContent]"
    before = page.script(state)
    page.script("unsaved = false")
    page.open(address)
    expect("what was decided, opened again", page.script(state), before)


def main():
    role, address, downloads = sys.argv[1], *map(pathlib.Path, sys.argv[2:4])
    screenshots = pathlib.Path(sys.argv[4]) if len(sys.argv) > 4 else None
    if screenshots:
        screenshots.mkdir(parents=True, exist_ok=True)
    with browser() as page:
        page.devtools("Browser.setDownloadBehavior", behavior="allow", downloadPath=str(downloads.resolve()))
        page.open(address)
        check_page(page)
        {"expert": expert, "annotator": annotator, "keeper": keeper}[role](page, screenshots)
        reopen(page, address)
        fill(page, "#author", "Kim" if role == "expert" else "Ada")
        fill(page, "#role", "expert" if role == "expert" else "annotator")
        look_at(page, screenshots, f"{role}-reopened")
        page.press("s")
        wait_for("saved file", (downloads / "decisions.json").exists)
        expect("errors in the console", page.console_errors(), [])


if __name__ == "__main__":
    main()
