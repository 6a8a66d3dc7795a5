"""Headless Chromium through its WebDriver, with Python's standard library alone.

Tests of pages import this; `scripts/setup --browser` installs Chromium and its driver.
"""

import base64
import contextlib
import json
import pathlib
import socket
import subprocess
import sys
import tempfile
import time
import urllib.request

ARGUMENTS = [
    "--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run",
    "--disable-background-networking", "--disable-component-update", "--disable-sync",
]


def draw_without_graphics_card():
    """Browsers that are opened from here on have WebGL, in software."""
    ARGUMENTS[:] = [argument for argument in ARGUMENTS if argument != "--disable-gpu"] + [
        "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--ignore-gpu-blocklist"]


class Browser:
    """A session of the WebDriver protocol (W3C), and Chromium's extensions of it."""

    def __init__(self, port, profile, width, height):
        self.address = f"http://127.0.0.1:{port}"
        options = {"args": [*ARGUMENTS, f"--user-data-dir={profile}", f"--window-size={width},{height}"]}
        wanted = {"browserName": "chrome", "goog:chromeOptions": options,
                  "goog:loggingPrefs": {"browser": "ALL"}}
        session = self.call("POST", "/session", {"capabilities": {"alwaysMatch": wanted}})
        self.session = f"/session/{session['sessionId']}"

    def call(self, method, path, body=None):
        request = urllib.request.Request(self.address + path, method=method)
        request.add_header("Content-Type", "application/json")
        data = None if body is None else json.dumps(body).encode()
        with urllib.request.urlopen(request, data, timeout=120) as answer:
            return json.load(answer)["value"]

    def do(self, method, path, body=None):
        return self.call(method, self.session + path, body)

    def open(self, page):
        """A file, or what an address on this machine has."""
        is_address = str(page).startswith("http://127.0.0.1:")
        address = str(page) if is_address else pathlib.Path(page).resolve().as_uri()
        self.do("POST", "/url", {"url": address})
        # On a busy machine the driver returns while a long page is still being read.
        loaded = "return document.readyState === 'complete' && decodeURI(location) === decodeURI(arguments[0])"
        wait_for("loaded page", lambda: self.script(loaded, address))

    def script(self, text, *arguments):
        return self.do("POST", "/execute/sync", {"script": text, "args": list(arguments)})

    def press(self, *keys):
        strokes = [{"type": kind, "value": key} for key in keys for kind in ("keyDown", "keyUp")]
        self.do("POST", "/actions", {"actions": [{"type": "key", "id": "keyboard", "actions": strokes}]})

    def drag(self, begin, end, kind="mouse"):
        """From one place of the viewport to another, with a pointer or a finger."""
        at = lambda place: {"type": "pointerMove", "duration": 50, "x": round(place[0]), "y": round(place[1])}
        middle = [(a + b) / 2 for a, b in zip(begin, end)]
        strokes = [at(begin), {"type": "pointerDown", "button": 0}, at(middle), at(end), {"type": "pointerUp", "button": 0}]
        pointer = {"type": "pointer", "id": kind, "parameters": {"pointerType": kind}, "actions": strokes}
        self.do("POST", "/actions", {"actions": [pointer]})

    def devtools(self, command, **parameters):
        return self.do("POST", "/goog/cdp/execute", {"cmd": command, "params": parameters})

    def colours(self, scheme):
        feature = {"name": "prefers-color-scheme", "value": scheme}
        self.devtools("Emulation.setEmulatedMedia", features=[feature])

    def size(self, width, height, phone=False):
        self.devtools("Emulation.setDeviceMetricsOverride", width=width, height=height,
                      deviceScaleFactor=1, mobile=phone)

    def picture(self):
        """The viewport, a PNG."""
        return base64.b64decode(self.do("GET", "/screenshot"))

    def screenshot(self, path):
        pathlib.Path(path).write_bytes(self.picture())

    def console_errors(self):
        """What the console holds since the last call."""
        lines = self.do("POST", "/se/log", {"type": "browser"})
        return [line for line in lines if line["level"] == "SEVERE"]


@contextlib.contextmanager
def browser(width=1280, height=1400):
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    driver = subprocess.Popen(["chromedriver", f"--port={port}"], stdout=subprocess.DEVNULL)
    try:
        wait_for("chromedriver", lambda: is_listening(port))
        with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as profile:
            session = Browser(port, profile, width, height)
            try:
                yield session
            finally:
                session.do("DELETE", "")
    finally:
        driver.terminate()
        driver.wait()


def is_listening(port):
    with socket.socket() as probe:
        return probe.connect_ex(("127.0.0.1", port)) == 0


def wait_for(what, condition, found=None, seconds=300):
    end = time.monotonic() + seconds
    while not condition():
        if time.monotonic() > end:
            sys.exit(f"no {what} within {seconds} s{f', but {found()}' if found else ''}")
        time.sleep(0.05)


def expect(what, found, wanted):
    if found != wanted:
        sys.exit(f"{what}: {found!r}, expected {wanted!r}")
