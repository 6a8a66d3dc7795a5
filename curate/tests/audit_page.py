"""Uses an audit page as an expert would, in headless Chromium through its WebDriver.

    python3 audit_page.py PAGE DOWNLOADS [SCREENSHOT]

Accepts the first boundary, rejects the second, moves the third by one frame with the keyboard, adds
one, and saves. DOWNLOADS/decisions.json is then what the page saved. Only Python's standard library
is used; `scripts/setup --browser` installs Chromium and its driver.
"""

import base64
import json
import pathlib
import socket
import subprocess
import sys
import tempfile
import time
import urllib.request


class Browser:
    """The few commands of the WebDriver protocol that are needed."""

    def __init__(self, port, downloads, profile):
        self.address = f"http://127.0.0.1:{port}"
        arguments = [
            "--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run",
            "--disable-background-networking", "--disable-component-update", "--disable-sync",
            f"--user-data-dir={profile}", "--window-size=1280,1400",
        ]
        options = {
            "args": arguments,
            "prefs": {"download.default_directory": str(downloads)},
        }
        capabilities = {"browserName": "chrome", "goog:chromeOptions": options,
                        "goog:loggingPrefs": {"browser": "ALL"}}
        session = self.call("POST", "/session", {"capabilities": {"alwaysMatch": capabilities}})
        self.session = f"/session/{session['sessionId']}"

    def call(self, method, path, body=None):
        request = urllib.request.Request(self.address + path, method=method)
        data = None if body is None else json.dumps(body).encode()
        request.add_header("Content-Type", "application/json")
        with urllib.request.urlopen(request, data, timeout=60) as answer:
            return json.load(answer)["value"]

    def do(self, method, path, body=None):
        return self.call(method, self.session + path, body)

    def script(self, text, *arguments):
        return self.do("POST", "/execute/sync", {"script": text, "args": list(arguments)})

    def find(self, selector):
        found = self.do("POST", "/element", {"using": "css selector", "value": selector})
        return next(iter(found.values()))

    def click(self, selector):
        self.do("POST", f"/element/{self.find(selector)}/click", {})

    def write(self, selector, text):
        self.do("POST", f"/element/{self.find(selector)}/value", {"text": text})

    def press(self, *keys):
        actions = []
        for key in keys:
            actions += [{"type": "keyDown", "value": key}, {"type": "keyUp", "value": key}]
        keyboard = {"type": "key", "id": "keyboard", "actions": actions}
        self.do("POST", "/actions", {"actions": [keyboard]})

    def states(self):
        return self.script(
            "return [...document.querySelectorAll('#boundaries li')].map(li => li.dataset.state)")


def free_port():
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


def wait_for(what, condition, seconds=60):
    end = time.monotonic() + seconds
    while not condition():
        if time.monotonic() > end:
            sys.exit(f"no {what} within {seconds} s")
        time.sleep(0.1)


def is_listening(port):
    with socket.socket() as probe:
        return probe.connect_ex(("127.0.0.1", port)) == 0


def expect(what, found, wanted):
    if found != wanted:
        sys.exit(f"{what}: {found!r}, expected {wanted!r}")


def audit(browser, page, downloads, screenshot):
    browser.do("POST", "/url", {"url": page.resolve().as_uri()})
    expect("outside requests", browser.script(
        "return performance.getEntriesByType('resource').filter(e => /^http/.test(e.name)).length"), 0)
    unlabelled = browser.script("""return [...document.querySelectorAll('input,select,button,img')]
        .filter(e => !(e.labels?.length || e.textContent.trim() || e.alt || e.querySelector('img[alt]')))
        .map(e => e.outerHTML.slice(0, 80))""")
    expect("elements without a name", unlabelled, [])
    expect("images", browser.script(
        "return [...document.images].every(i => i.src.startsWith('data:image/jpeg;base64,'))"), True)
    expect("pixels that hang over the side", browser.script(
        "return document.documentElement.scrollWidth - document.documentElement.clientWidth"), 0)
    count = len(browser.states())

    # Without a name nothing is saved.
    browser.click("#save")
    expect("a hint", "name" in browser.script(
        "return document.getElementById('status').textContent"), True)
    browser.write("#author", "Kim")
    browser.write("#reason", "sharp")
    browser.script("document.querySelector('#boundaries li').focus()")
    right = "\ue014"
    browser.press("a", "j", "r", "j", right)
    expect("states", browser.states()[:3], ["accepted", "rejected", "moved"])
    browser.write("#add-time", "0.5")
    browser.click("#add button")
    expect("boundaries", len(browser.states()), count + 1)
    times = browser.script("return rows.map(row => row.begin)")
    expect("rows in order of time", times, sorted(times))
    browser.script("document.querySelector('#boundaries li').focus()")
    browser.press("u")
    expect("boundaries after undoing", len(browser.states()), count)
    browser.click("#add button")
    browser.script("rows.find(row => row.decision).item.querySelector('button').click()")
    expect("boundaries after removing what was added", len(browser.states()), count)
    browser.click("#add button")
    # What was decided is there again when the page is opened again.
    before = sorted(browser.states())
    browser.script("window.onbeforeunload = null; document.getElementById('status').textContent = ''")
    browser.do("POST", "/refresh", {})
    wait_for("page", lambda: browser.script("return document.readyState") == "complete")
    expect("states of a page that was opened again", sorted(browser.states()), before)
    browser.write("#author", "Kim")
    if screenshot:
        for scheme in ("light", "dark"):
            browser.do("POST", "/goog/cdp/execute", {
                "cmd": "Emulation.setEmulatedMedia",
                "params": {"features": [{"name": "prefers-color-scheme", "value": scheme}]}})
            image = base64.b64decode(browser.do("GET", "/screenshot"))
            screenshot.with_name(f"{screenshot.stem}-{scheme}.png").write_bytes(image)
    browser.script("document.querySelector('#boundaries li').focus()")
    browser.press("s")
    wait_for("saved file", (downloads / "decisions.json").exists)
    severe = [line for line in browser.do("POST", "/se/log", {"type": "browser"})
              if line["level"] == "SEVERE"]
    expect("errors in the console", severe, [])


def main():
    page, downloads = map(pathlib.Path, sys.argv[1:3])
    screenshot = pathlib.Path(sys.argv[3]) if len(sys.argv) > 3 else None
    port = free_port()
    driver = subprocess.Popen(["chromedriver", f"--port={port}"], stdout=subprocess.DEVNULL)
    try:
        wait_for("driver", lambda: is_listening(port))
        with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as profile:
            browser = Browser(port, downloads.resolve(), profile)
            try:
                audit(browser, page, downloads, screenshot)
            finally:
                browser.do("DELETE", "")
    finally:
        driver.terminate()
        driver.wait()


if __name__ == "__main__":
    main()
