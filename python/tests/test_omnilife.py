"""The package as it is installed, held against the command and against plain formulas."""

from __future__ import annotations

import contextlib
import csv
import io
import os
import re
import signal
import subprocess
import sys
import threading
import time
import unittest

import numpy as np
from street import ROOT, Street, expect_success, omnilife_command

import omnilife
from omnilife import Camera, InputError, OmnilifeError, UndefinedScore
from omnilife.metrics import METRICS, compute, psnr, psnr_dynamic, ssim_static

SAMPLE: Street


def setUpModule() -> None:
    global SAMPLE
    SAMPLE = Street()


def tearDownModule() -> None:
    SAMPLE.remove()


def weights_are_there(metric: omnilife.Metric) -> bool:
    image = np.zeros((64, 64, 3), np.uint8)
    try:
        compute(image, image, [metric.id])
    except InputError:
        return False
    return True


class Scores(unittest.TestCase):
    def test_numbers_are_those_of_the_command_to_the_bit(self) -> None:
        out = SAMPLE.folder / "by-command"
        expect_success(
            *("bench", "score", "--scene", SAMPLE.scene.path, "--split", SAMPLE.split.path),
            *("--novel-views", SAMPLE.views, "--method", "noisy", "--out", out),
        )
        by_command = omnilife.read_result(out)
        here = omnilife.score(
            SAMPLE.scene, SAMPLE.split, novel_views=SAMPLE.views, method="noisy"
        )
        self.assertEqual(here.views, by_command.views)
        # The program may have been built from an earlier commit than the module.
        for result in (here, by_command):
            self.assertRegex(result.record["versions"].pop("omnilife commit"), "^(unknown|[0-9a-f]{40}.*)$")
        # The views lie elsewhere as seen from another folder of scores.
        for result in (here, by_command):
            self.assertTrue(result.record["predictions"].pop("novel_views").endswith("views"))
        self.assertEqual(here.record, by_command.record)
        self.assertEqual(here.failures, [])
        self.assertTrue(here.is_complete)
        # And every metric as a function of arrays, against the text of the command's own table.
        with open(out / "frames.csv", newline="") as file:
            table = list(csv.DictReader(file))
        self.assertEqual([int(row["frame"]) for row in table], SAMPLE.split.novel_views)
        ids = [id for id, metric in METRICS.items() if weights_are_there(metric)]
        self.assertGreaterEqual(len(ids), 20)
        before = None
        for row in table:
            self.assertEqual(row["view"], "novel")
            prediction, truth, given = self.view(int(row["frame"]))
            found = compute(prediction, truth, ids, previous=before, **given)
            expected = {id: float(row[id]) if row[id] else None for id in ids}
            self.assertEqual(found, expected)
            before = prediction, truth
        self.assertEqual(sum(value is None for value in found.values()), 0, found)

    def view(self, index: int):  # type: ignore[no-untyped-def]
        size = SAMPLE.split.scored_size(SAMPLE.scene)
        frame = SAMPLE.scene.frames[index]
        assert frame.depth is not None
        predicted = np.load(SAMPLE.views / f"depth/{index:06}.npy")
        given = {
            "mask": frame.mask(size),
            "classes": frame.classes(size),
            "objects": frame.objects(size),
            "depth": (predicted, frame.depth.read(size)),
        }
        return np.load(SAMPLE.views / f"{index:06}.npy"), frame.image(size), given

    def test_one_metric_is_the_same_as_several(self) -> None:
        prediction, truth, given = self.view(SAMPLE.split.novel_views[0])
        several = compute(prediction, truth, METRICS.keys() - networks(), **given)
        for id, value in several.items():
            metric = METRICS[id]
            kinds = dict(metric.needs)
            mask = None
            if "dynamic-mask" in kinds:
                mask = given["mask"]
            elif "class-mask" in kinds:
                mask = given["classes"][kinds["class-mask"]]
            elif "object-masks" in kinds:
                mask = given["objects"]
            depth = given["depth"] if "depth" in kinds else None
            self.assertEqual(metric(prediction, truth, mask=mask, depth=depth), value, id)
            attribute = getattr(omnilife.metrics, id.replace("-", "_"))
            self.assertIs(attribute, metric)

    def test_images_of_all_kinds_are_the_same_image(self) -> None:
        _, truth, _ = self.view(SAMPLE.split.novel_views[0])
        other = np.roll(truth, 1, axis=0)
        expected = psnr(other, truth)
        for kind in (np.float16, np.float32, np.float64):
            self.assertEqual(psnr((other / 255).astype(kind), truth / 255), expected)
        flipped = psnr(other[:, ::-1], truth[:, ::-1])
        self.assertEqual(flipped, expected)
        error = (other.astype(float) - truth) / 255
        self.assertAlmostEqual(expected, -10 * np.log10((error**2).mean()), places=9)
        self.assertEqual(psnr(truth, truth), 100.0)

    def test_a_run_and_its_trace_are_read(self) -> None:
        run, scores = SAMPLE.folder / "run", SAMPLE.folder / "run-scores"
        split = omnilife.split_scene(SAMPLE.scene.path, SAMPLE.folder / "plain/split.json")
        expect_success(
            *("reconstruct", "train", SAMPLE.sequence, "--split", split.path, "--method", "odgs"),
            *("--iterations", 20, "--out", run),
        )
        result = omnilife.score(SAMPLE.scene, split, run=run, out=scores, without_lpips=True)
        self.assertEqual((result.method, result.record["iterations"]), ("odgs", 20))
        trace, curve = omnilife.read_trace(run), omnilife.read_trace(scores)
        self.assertEqual(trace["iteration"][-1], 20)
        self.assertIsInstance(trace["train_loss"][-1], float)
        self.assertEqual(curve["iteration"], trace["iteration"])
        self.assertAlmostEqual(curve["novel_psnr_db"][-1], result.mean("psnr"), places=9)

        table = omnilife.read_results(SAMPLE.folder)
        lengths = {len(column) for column in table.values()}
        self.assertEqual(len(lengths), 1)
        rows = zip(table["method"], table["view"], table["metric"], table["mean"])
        self.assertIn(("odgs", "novel", "psnr", result.mean("psnr")), list(rows))
        self.assertEqual(set(result.means()["view"]), {"input", "novel"})

        answer = omnilife.query(scores, by=["seed"], where=["view=novel", "region=whole"])
        self.assertEqual(answer["psnr"][answer["method"].index("odgs")], result.mean("psnr"))
        thirds = omnilife.query(scores, "views", by=["third"], where=["view=novel"])
        self.assertLessEqual(set(thirds["third"]), {1, 2, 3})
        with self.assertRaisesRegex(omnilife.InputError, "ego_motion"):
            omnilife.query(scores, by=["colour"])


def networks() -> set[str]:
    needs = {"network", "previous-view"}
    return {id for id, metric in METRICS.items() if needs & set(dict(metric.needs))}


class Cameras(unittest.TestCase):
    def test_rays_of_a_panorama_are_those_of_its_definition(self) -> None:
        camera = Camera("erp", 64, 32)
        u, v = np.meshgrid(np.arange(64) + 0.5, np.arange(32) + 0.5)
        longitude, latitude = (u / 64 - 0.5) * 2 * np.pi, (0.5 - v / 32) * np.pi
        x, z = np.cos(latitude) * np.sin(longitude), np.cos(latitude) * np.cos(longitude)
        expected = np.stack([x, -np.sin(latitude), z], axis=-1)
        np.testing.assert_allclose(camera.rays(), expected, atol=1e-14)
        np.testing.assert_allclose(camera.project(5 * expected), np.stack([u, v], -1), atol=1e-11)
        np.testing.assert_allclose(camera.unproject(np.stack([u, v], -1)), expected, atol=1e-14)

    def test_rays_of_a_photograph_are_those_of_its_definition(self) -> None:
        camera = Camera("pinhole", 40, 30, fx=31.0, fy=33.0, cx=20.5, cy=14.0)
        u, v = np.meshgrid(np.arange(40) + 0.5, np.arange(30) + 0.5)
        expected = np.stack([(u - 20.5) / 31, (v - 14) / 33, np.ones_like(u)], axis=-1)
        expected /= np.linalg.norm(expected, axis=-1, keepdims=True)
        np.testing.assert_allclose(camera.rays(), expected, atol=1e-14)
        self.assertTrue(np.isnan(camera.project([0.0, 0.0, -1.0])).all())
        half = camera.resized(20, 15)
        self.assertEqual((half.fx, half.cy, half.size), (15.5, 7.0, (20, 15)))

    def test_rays_on_the_axes_of_the_world(self) -> None:
        frame = SAMPLE.scene.frames[3]
        assert frame.pose is not None
        w, x, y, z = frame.pose.rotation_wxyz
        # Forward, (0, 0, 1), turned by the quaternion.
        forward = [2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)]
        np.testing.assert_allclose(frame.pose.rotation @ [0, 0, 1], forward, atol=1e-12)
        origin, directions = frame.rays((64, 32))
        of_camera = frame.camera.resized(64, 32).rays()
        np.testing.assert_allclose(directions, of_camera @ frame.pose.rotation.T, atol=1e-12)
        np.testing.assert_array_equal(origin, frame.pose.centre)
        both = frame.pose.world_to_camera @ frame.pose.camera_to_world
        np.testing.assert_allclose(both, np.eye(4), atol=1e-12)
        directions[0, 0] = 0.0  # What is returned belongs to the caller.

    def test_points_are_where_images_show_their_colours(self) -> None:
        """A mirrored or shifted camera would tell other colours than the points have."""
        positions, colours = SAMPLE.scene.points()
        frame = SAMPLE.scene.frames[0]
        assert frame.pose is not None
        image = frame.image()

        def correlation(axes: list[float]) -> float:
            assert frame.pose is not None
            points = (positions - frame.pose.centre) @ frame.pose.rotation * axes
            u, v = np.moveaxis(frame.camera.project(points).astype(int), -1, 0)
            height, width, _ = image.shape
            seen = image[v.clip(0, height - 1), u % width]
            return float(np.corrcoef(seen.ravel(), colours.ravel())[0, 1])

        upright, mirrored = correlation([1, 1, 1]), correlation([-1, 1, 1])
        self.assertGreater(upright, 0.6)
        self.assertGreater(upright, mirrored + 0.15)


class Errors(unittest.TestCase):
    def one_line(self, kind: type[Exception], *words: str):  # type: ignore[no-untyped-def]
        pattern = "^[^\n]*" + "[^\n]*".join(re.escape(word) for word in words) + "[^\n]*$"
        return self.assertRaisesRegex(kind, pattern)

    def test_bad_images_are_told(self) -> None:
        image = np.zeros((32, 64, 3), np.uint8)
        with self.one_line(InputError, "truth is of shape (32, 32, 3)", "(32, 64, 3)"):
            psnr(image, image[:, :32])
        with self.one_line(InputError, "prediction is of shape (32, 64)"):
            psnr(image[..., 0], image)
        with self.one_line(InputError, "truth is of int64"):
            psnr(image, image.astype(np.int64))
        with self.one_line(InputError, "truth", "mean of 255.0", "[0, 1]"):
            psnr(image, np.full(image.shape, 255.0))
        with self.one_line(InputError, "prediction", "NaN", "row 0, column 0"):
            psnr(np.full(image.shape, np.nan), image)

    def test_what_is_ignored_does_not_count(self) -> None:
        random = np.random.default_rng(3)
        truth = random.integers(0, 256, (32, 64, 3), np.uint8)
        prediction = random.integers(0, 256, (32, 64, 3), np.uint8)
        ignored = np.zeros((32, 64), bool)
        ignored[24:] = True
        errors = (prediction[:24] / 255.0 - truth[:24] / 255.0) ** 2
        expected = -10 * np.log10(errors.mean())
        self.assertAlmostEqual(psnr(prediction, truth, ignored=ignored), expected, places=9)
        other = prediction.copy()
        other[ignored] = 0
        ids = ["psnr", "ssim", "ws-psnr", "ws-ssim", "cube-psnr"]
        found = [compute(p, truth, ids, ignored=ignored) for p in (prediction, other)]
        self.assertEqual(found[0], found[1])
        with self.one_line(InputError, "nothing is left to score"):
            psnr(prediction, truth, ignored=np.ones((32, 64), bool))

    def test_masks_that_are_missing_or_too_many_are_told(self) -> None:
        image = np.zeros((32, 64, 3), np.uint8)
        mask = np.zeros((32, 64), bool)
        with self.one_line(InputError, "psnr does not take a mask", "psnr-dynamic"):
            psnr(image, image, mask=mask)
        with self.one_line(InputError, "psnr-dynamic needs a mask"):
            psnr_dynamic(image, image)
        with self.one_line(UndefinedScore, "psnr-dynamic is undefined: no pixel"):
            psnr_dynamic(image, image, mask=mask)
        with self.one_line(InputError, "nothing above 1", "0 and 255"):
            psnr_dynamic(image, image, mask=np.ones((32, 64), np.uint8))
        self.assertEqual(ssim_static(image, image, mask=mask), 1.0)

    def test_what_is_not_there_is_told(self) -> None:
        with self.one_line(InputError, "/nowhere/scene.json", "cannot be read"):
            omnilife.load_scene("/nowhere/scene.json")
        with self.one_line(InputError, "no metric", "psrn", "did you mean", "psnr"):
            compute(np.zeros((8, 8, 3)), np.zeros((8, 8, 3)), ["psrn"])
        with self.one_line(InputError, "split.json", "schema"):
            omnilife.load_scene(SAMPLE.split.path)
        with self.one_line(InputError, "is not a folder"):
            omnilife.score(SAMPLE.scene, SAMPLE.split, novel_views="/nowhere", method="m")
        with self.assertRaises(AttributeError):
            omnilife.metrics.psrn
        for kind in (InputError, UndefinedScore, omnilife.MachineError):
            self.assertTrue(issubclass(kind, OmnilifeError))
        self.assertTrue(issubclass(InputError, ValueError))
        self.assertTrue(issubclass(omnilife.MachineError, OSError))

    def test_a_missing_prediction_is_a_row(self) -> None:
        empty = SAMPLE.folder / "empty"
        empty.mkdir()
        result = omnilife.score(SAMPLE.scene, SAMPLE.split, novel_views=empty, method="m")
        self.assertEqual(len(result.failures), len(SAMPLE.split.novel_views))
        self.assertIn("is missing", result.failures[0]["reason"])
        self.assertFalse(result.is_complete)
        self.assertIsNone(result.run_failure)


class Process(unittest.TestCase):
    def test_other_threads_go_on_meanwhile(self) -> None:
        image = np.zeros((1024, 2048, 3), np.uint8)
        steps, done = 0, threading.Event()

        def count() -> None:
            nonlocal steps
            while not done.wait(0.005):
                steps += 1

        thread = threading.Thread(target=count)
        thread.start()
        begun = time.monotonic()
        METRICS["ssim"](image, image)
        waited, counted = time.monotonic() - begun, steps
        done.set()
        thread.join()
        self.assertGreater(counted, waited / 0.1, f"{counted} steps in {waited:.2f} s")

    def test_a_forked_process_computes_too(self) -> None:
        image = np.zeros((64, 128, 3), np.uint8)
        expected = METRICS["cube-psnr"](image, image)
        child = os.fork()
        if child == 0:
            signal.alarm(60)
            os._exit(0 if METRICS["cube-psnr"](image, image) == expected else 1)
        self.assertEqual(os.waitpid(child, 0)[1], 0)

    def test_ctrl_c_ends_scoring(self) -> None:
        # Whoever starts the tests in the background of a shell has interrupts ignored, and so have their children.
        program = f"""
import signal
import omnilife
signal.signal(signal.SIGINT, signal.default_int_handler)
print("begun", flush=True)
try:
    while True:
        omnilife.score({str(SAMPLE.scene.path)!r}, {str(SAMPLE.split.path)!r},
            novel_views={str(SAMPLE.views)!r}, method="m")
except KeyboardInterrupt:
    print("interrupted", flush=True)
"""
        words = [sys.executable, "-c", program]
        with subprocess.Popen(words, stdout=subprocess.PIPE, text=True) as child:
            assert child.stdout is not None
            self.assertEqual(child.stdout.readline(), "begun\n")
            time.sleep(0.7)
            child.send_signal(signal.SIGINT)
            sent = time.monotonic()
            # One that goes on must not hold up the others for ever.
            last = threading.Timer(30, child.kill)
            last.start()
            self.addCleanup(last.cancel)
            self.assertEqual(child.stdout.readline(), "interrupted\n")
            self.assertLess(time.monotonic() - sent, 10)
            self.assertEqual(child.wait(20), 0)

    def test_the_command_of_the_wheel_is_the_program(self) -> None:
        ended = omnilife_command("bench", "score", "--scene", "/nowhere", "--split", "/nowhere",
            "--novel-views", "/nowhere", "--method", "m", "--out", SAMPLE.folder / "none")  # fmt: skip
        self.assertEqual(ended.returncode, 2)
        self.assertEqual(len(ended.stderr.splitlines()), 1, ended.stderr)
        listed = expect_success("bench", "list")
        for id, metric in METRICS.items():
            self.assertIn(f"  {id}: {metric.title} (", listed)
        for id in omnilife.protocols():
            self.assertIn(f"  {id}: ", listed)


class Documentation(unittest.TestCase):
    def test_the_example_of_the_page_prints_what_the_page_says(self) -> None:
        page = (ROOT / "docs/guides/python.md").read_text()
        blocks = re.findall(r"```(python|text)\n(.*?)```", page, re.DOTALL)
        programs = [text for kind, text in blocks if kind == "python"]
        outputs = [text for kind, text in blocks if kind == "text"]
        self.assertEqual((len(programs), len(outputs)), (3, 3))
        names: dict[str, object] = {}
        for program, output in zip(programs, outputs):
            text = program.replace('"SCENE"', repr(str(SAMPLE.sequence)))
            printed = io.StringIO()
            try:
                with contextlib.redirect_stdout(printed):
                    exec(compile(text, "docs/guides/python.md", "exec"), names)
            except ImportError as error:
                # A package of an extra. Its own tests say that they are skipped.
                self.assertIn(error.name, ("torch", "pandas", "polars"))
                continue
            self.assertEqual(printed.getvalue(), output)

    def test_the_example_scores(self) -> None:
        out = SAMPLE.folder / "example"
        words = [sys.executable, str(ROOT / "scripts/examples/score_from_python.py"), str(out)]
        ended = subprocess.run(words, capture_output=True, text=True, check=False)
        self.assertEqual(ended.returncode, 0, ended.stderr)
        lines = ended.stdout.splitlines()
        self.assertEqual(len(lines), 4, ended.stdout)
        scores = omnilife.read_result(out / "scores")
        self.assertEqual(lines[2], f"psnr {scores.mean('psnr'):.2f} over 2 views")
        self.assertGreater(scores.mean("psnr"), 15.0)


if __name__ == "__main__":
    unittest.main()
