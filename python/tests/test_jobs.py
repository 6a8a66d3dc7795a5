"""Long work through the command: progress, errors, and the whole way from a video to a run."""

from __future__ import annotations

import json
import logging
import os
import signal
import stat
import sys
import tempfile
import textwrap
import threading
import unittest
from pathlib import Path
from unittest import mock

import extras
import numpy as np
from event_file import Event, read_events
from street import STREET

import omnilife
from omnilife import InputError, MachineError, Progress

#: Stands for the command: what it does is Python after these lines.
HEAD = f"#!{sys.executable}\nimport json, os, signal, sys, time\nwords = sys.argv[1:]\n"


def event(kind: str, done: int) -> str:
    count = {"depth": 0, "label": "training", "done": done, "total": 60, "status": "loss 1"}
    return json.dumps({"event": kind, **count})


class Commands(unittest.TestCase):
    def setUp(self) -> None:
        folder = tempfile.TemporaryDirectory(prefix="omnilife-tests-")
        self.addCleanup(folder.cleanup)
        self.folder = Path(folder.name)

    def play(self, text: str) -> None:
        """Lets a script answer in place of the command."""
        script = self.folder / "omnilife"
        script.write_text(HEAD + textwrap.dedent(text))
        script.chmod(script.stat().st_mode | stat.S_IXUSR)
        patched = mock.patch("omnilife.jobs._program", return_value=str(script))
        patched.start()
        self.addCleanup(patched.stop)

    def test_words_and_progress(self) -> None:
        self.play(
            f"""
            print({event("progress", 20)!r}, file=sys.stderr)
            print(json.dumps({{"event": "note", "line": "a decision"}}), file=sys.stderr)
            print({event("end", 60)!r}, file=sys.stderr)
            print("\\u00fc " + " ".join(words))
            """
        )
        found: list[Progress] = []
        with self.assertLogs("omnilife", logging.INFO) as logs:
            said = omnilife.command("bench", Path("a b"), 3, progress=found.append)
        self.assertEqual(said, "\u00fc --progress json bench a b 3\n")
        self.assertEqual(logs.output, ["INFO:omnilife:a decision"])
        self.assertEqual([(one.done, one.has_ended) for one in found], [(20, False), (60, True)])
        self.assertEqual(str(found[0]), "training: 20 of 60, loss 1")
        self.assertEqual(str(Progress("hash", 0, None, "", 0, False)), "hash: ")

    def test_failures_are_exceptions_with_the_line_of_the_command(self) -> None:
        for code, lines, kind, message in (
            (2, ["odd", "omnilife: a.mp4: is empty"], InputError, "a.mp4: is empty"),
            (2, ["error: no option --x", "", "Usage: y"], InputError, "no option --x"),
            (1, ["omnilife: the disk is full"], MachineError, "the disk is full"),
            (1, ["{half", "killed"], MachineError, "killed"),
            (3, [], MachineError, "omnilife bench list ended with 3"),
        ):
            self.play(f"for line in {lines!r}: print(line, file=sys.stderr)\nsys.exit({code})")
            with self.assertRaises(kind) as caught:
                omnilife.command("bench", "list")
            self.assertEqual(str(caught.exception), message)
        os.remove(self.folder / "omnilife")
        with self.assertRaisesRegex(MachineError, "omnilife: cannot be started: "):
            omnilife.command("bench", "list")

    def test_options_become_words(self) -> None:
        self.play("open(__file__ + '.words', 'w').write('\\n'.join(words)); sys.exit(2)")
        with self.assertRaises(InputError):
            omnilife.reconstruct(
                self.folder,
                Path("split.json"),
                "run",
                method="odgs",
                iterations=5,
                trace_views=None,
                with_=["a", "b"],
                set={"max-gaussians": 10, "flat": True},
            )
        with open(self.folder / "omnilife.words") as file:
            words = file.read().splitlines()[2:]
        expected = ["reconstruct", "train", "--method=odgs", "--iterations=5", "--with=a,b"]
        expected += ["--set=max-gaussians=10", "--set=flat=true", "--split=split.json", "--out=run"]
        self.assertEqual(words, [*expected, "--", str(self.folder / "scene.json")])
        with self.assertRaises(InputError):
            omnilife.curate("-walk.mp4", "out", slices=True, audio=False, fps=2)
        with open(self.folder / "omnilife.words") as file:
            words = file.read().splitlines()[2:]
        self.assertEqual(words, ["curate", "build", "--slices", "--fps=2", "--out=out", "--", "-walk.mp4"])

    @unittest.skipUnless(os.name == "posix", "signals of POSIX")
    def test_an_interrupted_call_ends_the_command_first(self) -> None:
        self.play(
            f"""
            def end(*_):
                open(__file__ + ".ended", "w").close()
                sys.exit(75)
            signal.signal(signal.SIGTERM, end)
            print({event("progress", 1)!r}, file=sys.stderr, flush=True)
            time.sleep(60)
            """
        )

        # A shell ignores the signal for what it runs in the background, and Python leaves that so.
        before = signal.signal(signal.SIGINT, signal.default_int_handler)
        self.addCleanup(signal.signal, signal.SIGINT, before)

        def interrupt(_: Progress) -> None:
            threading.Timer(0.1, os.kill, (os.getpid(), signal.SIGINT)).start()

        with self.assertRaises(KeyboardInterrupt):
            omnilife.command("run", progress=interrupt)
        self.assertTrue((self.folder / "omnilife.ended").exists())

        def fail(_: Progress) -> None:
            raise RuntimeError("no more")

        os.remove(self.folder / "omnilife.ended")
        with self.assertRaisesRegex(RuntimeError, "no more"):
            omnilife.command("run", progress=fail)
        self.assertTrue((self.folder / "omnilife.ended").exists())


class FromVideoToRun(unittest.TestCase):
    folder: Path
    dataset: omnilife.Dataset
    split: omnilife.Split
    run_: omnilife.Run
    progress: list[Progress]

    @classmethod
    def setUpClass(cls) -> None:
        holder = tempfile.TemporaryDirectory(prefix="omnilife-tests-")
        cls.addClassCleanup(holder.cleanup)
        cls.folder = Path(holder.name)
        cls.progress = []
        cls.dataset = omnilife.curate(
            STREET / "street.mp4", cls.folder / "data", fps=5, criteria="none", progress=cls.progress.append
        )
        scene = omnilife.find_poses(cls.dataset.sequences[0], poses=STREET / "poses.json")
        cls.split = omnilife.split_scene(scene.path, cls.folder / "split.json")
        cls.run_ = omnilife.reconstruct(
            *(scene, cls.split, cls.folder / "run"),
            iterations=30,
            trace=10,
            tensorboard=cls.folder / "events",
            set={"max-gaussians": 2000},
            progress=cls.progress.append,
        )

    def test_records_are_read(self) -> None:
        dataset = self.dataset
        self.assertEqual(dataset.videos["outcome"], ["curated"])
        self.assertEqual(dataset.videos["reason"], [None])
        self.assertEqual([folder.name for folder in dataset.sequences], ["seq-000"])
        self.assertEqual((self.run_.method, self.run_.record["iterations"]), ("odgs", 30))
        self.assertEqual(list(self.run_.novel_views()), self.split.novel_views)
        self.assertEqual(self.run_.trace()["iteration"], [0, 10, 20, 30])
        self.assertIn("street.mp4", dataset._repr_html_())
        self.assertIn("data:image/png", self.run_._repr_html_())
        with self.assertRaisesRegex(InputError, "run.json"):
            omnilife.load_run(self.folder)

    def test_progress_of_all_work_arrives(self) -> None:
        last = [one for one in self.progress if one.label == "training" and one.has_ended]
        self.assertEqual([(one.done, one.total) for one in last], [(30, 30)])

    def test_the_page_shows_the_run_at_its_end(self) -> None:
        page = (self.folder / "run/progress.html").read_text()
        self.assertIn("Ended after iteration 30.", page)
        self.assertNotIn("location.reload", page)
        frame = self.split.novel_views[len(self.split.novel_views) // 2]
        self.assertIn(f'src="predictions/novel/{frame:06}.png"', page)

    def events(self) -> list[Event]:
        (file,) = (self.folder / "events").iterdir()
        return read_events(file)

    def test_event_files_hold_the_trace(self) -> None:
        version, start, *rows = self.events()
        self.assertEqual((version.version, start.starts_session, start.step), ("brain.Event:2", True, 0))
        trace = self.run_.trace()
        self.assertEqual([row.step for row in rows], trace["iteration"])
        for at, row in enumerate(rows):
            for column in ("train_loss", "train_psnr_db", "primitives"):
                found, expected = row.scalars.get(f"trace/{column}"), trace[column][at]
                self.assertEqual(found, None if expected is None else np.float32(expected))
        for row in (rows[0], rows[-1]):
            self.assertEqual(sorted(row.images), ["views/input", "views/novel"])
            for width, height, png in row.images.values():
                self.assertEqual(width, 2 * height)
                self.assertEqual(png[:8], b"\x89PNG\r\n\x1a\n")

    @extras.needs("tensorboard")
    def test_tensorboard_reads_them(self) -> None:
        from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

        accumulator = EventAccumulator(str(self.folder / "events"), {"scalars": 0, "images": 0})
        accumulator.Reload()
        trace = self.run_.trace()
        found = [scalar.value for scalar in accumulator.Scalars("trace/train_psnr_db")]
        np.testing.assert_allclose(found, trace["train_psnr_db"][1:], rtol=1e-6)
        steps = [scalar.step for scalar in accumulator.Scalars("trace/wall_seconds")]
        self.assertEqual(steps, trace["iteration"])
        image = accumulator.Images("views/novel")[-1]
        self.assertEqual((image.step, image.width), (30, 2 * image.height))

    @extras.needs("rerun")
    def test_rerun_shows_the_run_and_its_scores(self) -> None:
        import omnilife.rerun
        from rerun.chunk import RrdReader

        scores, file = self.folder / "scores", self.folder / "run.rrd"
        scene = omnilife.load_scene(self.dataset.sequences[0])
        omnilife.score(scene, self.split, run=self.folder / "run", out=scores)
        for follow in (False, True):
            notes = omnilife.rerun.show(
                *(self.folder / "run", scene, self.split),
                save=file,
                follow=follow,
                scores=scores,
                max_gaussians=100,
            )
            self.assertEqual(len(notes), 1)
            self.assertIn("shows 100 of", notes[0])
            chunks = RrdReader(file).stream().to_chunks()
            places = {chunk.entity_path for chunk in chunks}
            novel = [place for place in places if place.startswith("/views/novel/") and place.endswith("/rendered")]
            self.assertEqual(len(novel), min(3, len(self.split.novel_views)))
            for place in ("/world/points", "/world/gaussians", "/world/cameras/path", "/trace/train_loss"):
                self.assertIn(place, places)
            self.assertTrue(any(place.startswith("/scores/curve/novel_psnr") for place in places), places)
            iterations: list[int] = []
            for chunk in chunks:
                if chunk.entity_path == novel[0]:
                    iterations += chunk.to_record_batch().column("iteration").to_pylist()
            self.assertEqual(sorted(iterations), [0, 10, 20, 30])
        self.assertEqual(list(self.folder.glob(".*.part")), [])

    @extras.needs("matplotlib")
    def test_a_trace_is_plotted(self) -> None:
        import matplotlib

        matplotlib.use("Agg")
        figure = omnilife.plot_trace(self.run_, ["train_loss", "primitives"], "iteration")
        self.assertEqual([len(np.asarray(axes.lines[0].get_ydata())) for axes in figure.axes], [3, 4])
        for columns, reason in ((["nothing"], "has no nothing"), ([], "no columns")):
            with self.assertRaisesRegex(InputError, reason):
                omnilife.plot_trace(self.folder / "run", columns)


if __name__ == "__main__":
    unittest.main()
