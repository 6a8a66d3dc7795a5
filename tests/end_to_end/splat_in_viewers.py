"""Shows a .splat in external web viewers, in headless Chromium.

usage: splat_in_viewers.py VIEWER NODE_MODULES SPLAT VIEW.ppm [--screenshot FILE]

VIEWER is gaussian-splats-3d (npm, @mkkellogg/gaussian-splats-3d, with three) or gsplat (npm). VIEW is
the file rendered by the project's own renderer from its origin along z, y down (binary PPM, 640 x 480, 75 degrees
high). The viewer has to show the same, and not its mirror image. Exit code 3 where NODE_MODULES lacks the viewer.
"""

import argparse
import functools
import http.server
import math
import pathlib
import sys
import threading

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[2] / "scripts/browser"))
import webdriver  # noqa: E402
from pictures import blocks, expected_blocks, likeness, pixels_of_png  # noqa: E402

WIDTH, HEIGHT, DEGREES_HIGH = 640, 480, 75
FOCAL_PIXELS = HEIGHT / 2 / math.tan(math.radians(DEGREES_HIGH / 2))
PAGE = """<!doctype html><meta charset="utf-8">
<style>html, body { margin: 0; overflow: hidden; background: #000 } #view { width: %dpx; height: %dpx }</style>
<script type="importmap">{"imports": {"three": "/node_modules/three/build/three.module.js",
  "gaussian-splats-3d": "/node_modules/@mkkellogg/gaussian-splats-3d/build/gaussian-splats-3d.module.js",
  "gsplat": "/node_modules/gsplat/dist/index.es.js"}}</script>
<div id="view"></div>
<script type="module">%s</script>"""
VIEWERS = {
    "gaussian-splats-3d": """
import * as GaussianSplats3D from "gaussian-splats-3d";
const viewer = new GaussianSplats3D.Viewer({
  rootElement: document.getElementById("view"), cameraUp: [0, -1, 0], initialCameraPosition: [0, 0, 0],
  initialCameraLookAt: [0, 0, 1], sharedMemoryForWorkers: false, useBuiltInControls: false, ignoreDevicePixelRatio: true,
});
viewer.camera.fov = %(degrees)s;
viewer.camera.updateProjectionMatrix();
await viewer.addSplatScene("/scene.splat", { format: GaussianSplats3D.SceneFormat.Splat, showLoadingUI: false,
  splatAlphaRemovalThreshold: 1 });
viewer.start();
window.splats = viewer.getSplatMesh().getSplatCount();
""",
    "gsplat": """
import * as SPLAT from "gsplat";
const canvas = document.createElement("canvas");
canvas.style.cssText = "display: block; width: %(width)spx; height: %(height)spx";
document.getElementById("view").append(canvas);
const renderer = new SPLAT.WebGLRenderer(canvas), scene = new SPLAT.Scene(), camera = new SPLAT.Camera();
const loaded = await SPLAT.Loader.LoadAsync("/scene.splat", scene, () => {});
camera.data.fx = camera.data.fy = %(focal)s;
camera.position = new SPLAT.Vector3(0, 0, 0);
camera.rotation = new SPLAT.Quaternion(0, 0, 0, 1);
renderer.setSize(%(width)s, %(height)s);
const draw = () => { renderer.render(scene, camera); requestAnimationFrame(draw); };
draw();
window.splats = loaded.data.vertexCount;
""",
}

parser = argparse.ArgumentParser()
parser.add_argument("viewer", choices=VIEWERS)
parser.add_argument("node_modules", type=pathlib.Path)
parser.add_argument("splat", type=pathlib.Path)
parser.add_argument("view", type=pathlib.Path)
parser.add_argument("--screenshot", type=pathlib.Path)
asked = parser.parse_args()
package = {"gaussian-splats-3d": "@mkkellogg/gaussian-splats-3d"}.get(asked.viewer, asked.viewer)
if not (asked.node_modules / package).is_dir():
    sys.exit(3)


class Files(http.server.SimpleHTTPRequestHandler):
    """Serves the page, the file and the viewer's modules alone."""

    def translate_path(self, path):
        if path.startswith("/node_modules/"):
            return super().translate_path(path.removeprefix("/node_modules"))
        return str(asked.splat) if path == "/scene.splat" else str(asked.node_modules / "nothing")

    def do_GET(self):
        if self.path != "/":
            return super().do_GET()
        script = VIEWERS[asked.viewer] % {"degrees": DEGREES_HIGH, "focal": FOCAL_PIXELS, "width": WIDTH,
                                          "height": HEIGHT}
        text = (PAGE % (WIDTH, HEIGHT, script)).encode()
        self.send_response(200)
        self.send_header("Content-Type", "text/html")
        self.send_header("Content-Length", str(len(text)))
        self.end_headers()
        self.wfile.write(text)

    def log_message(self, *_):
        pass


expected, said = expected_blocks(asked.view), None
server = http.server.ThreadingHTTPServer(
    ("127.0.0.1", 0), functools.partial(Files, directory=str(asked.node_modules)))
threading.Thread(target=server.serve_forever, daemon=True).start()
webdriver.draw_without_graphics_card()
with webdriver.browser(700, 600) as browser:
    browser.size(WIDTH, HEIGHT)
    browser.open(f"http://127.0.0.1:{server.server_port}/")
    webdriver.wait_for("Gaussians", lambda: browser.script("return window.splats"),
                       lambda: browser.console_errors(), seconds=120)
    webdriver.expect("Gaussians", browser.script("return window.splats"), asked.splat.stat().st_size // 32)

    def shows():
        global said
        drawn = pixels_of_png(browser.picture())
        straight = likeness(blocks(drawn), expected)
        mirrored = likeness(blocks([row[::-1] for row in drawn]), expected)
        said = f"likeness {straight:.3f}, mirrored {mirrored:.3f}"
        return straight >= 0.8 and mirrored <= straight - 0.1
    try:
        webdriver.wait_for("view as the renderer draws it", shows, lambda: said, seconds=120)
    finally:
        if asked.screenshot:
            browser.screenshot(asked.screenshot)
print(f"{asked.viewer}: {said}")
