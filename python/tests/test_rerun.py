"""Recordings of runs for the viewer Rerun, read back; Gaussians of checkpoints and models held against plain numbers."""

from __future__ import annotations

import contextlib
import hashlib
import io
import json
import os
import socket
import subprocess
import sys
import unittest
from pathlib import Path
from typing import Any
from unittest import mock

import extras
import numpy as np
from small import ERP, PINHOLE, Small
from street import write_png

import omnilife.rerun
from omnilife import InputError, MachineError
from omnilife._gaussians import joined, of_arrays, read_checkpoint, read_ply
from omnilife._recording import Recording, error_image, spline_points

#: Degree 1.
REST = 3
NORMALIZATION = {"offset": [10.0, 20.0, 30.0], "scale": 0.5}


def model(count: int = 5) -> dict[str, Any]:
    generator = np.random.default_rng(count)
    widths = {"positions": 3, "log_scales": 3, "quaternions": 4, "opacity_logits": 1, "sh_constant": 3}
    arrays = {name: generator.normal(size=(count, width)) for name, width in widths.items()}
    return {**arrays, "sh_rest": generator.normal(size=(count, 3 * REST))}


def write_checkpoint(path: Path, arrays: dict[str, Any], **changes: Any) -> None:
    count = len(arrays["positions"])
    body = b""
    for name, values in arrays.items():
        frozen = name == "opacity_logits"
        for columns in (values,) if frozen else (values, values + 1, values + 2):
            body += columns.astype("<f4").tobytes()
    # Sums and numbers of views, and shared values with moments.
    body += np.full(2 * count + 6, 7.0, "<f4").tobytes()
    described = [
        {"name": name, "width": values.shape[1], **({"frozen": True} if name == "opacity_logits" else {})}
        for name, values in arrays.items()
    ]
    part = {"parameterization": "static", "gaussians": count, "arrays": described}
    # A second part whose Gaussians rest in coordinates of their own.
    own = {**part, "arrays": [{"name": "object_positions", "width": 3}], "parameterization": "tracked"}
    own_body = np.zeros(3 * 3 * count + 3 * count, "<f4").tobytes()
    parts = [
        {**part, "with_times": False, "shared": {"values": 2, "steps": 9}},
        {**own, "with_times": True, "shared": None},
    ]
    header = {
        "state": {"iteration": 40, "training": {"secs": 3, "nanos": 500_000_000}},
        "normalization": NORMALIZATION,
        "learner": json.dumps({"model": {"parts": parts}}),
        "body_sha256": hashlib.sha256(body + own_body).hexdigest(),
        **changes,
    }
    head = b"omnilife/checkpoint/3\n" + json.dumps(header).encode() + b"\n"
    path.write_bytes(head + body + own_body)


def write_ply(path: Path, arrays: dict[str, Any]) -> None:
    rest = arrays["sh_rest"].reshape(-1, REST, 3).transpose(0, 2, 1).reshape(-1, 3 * REST)
    names = ["nx", "ny", "nz", *(f"f_dc_{at}" for at in range(3)), *(f"f_rest_{at}" for at in range(3 * REST))]
    names += ["opacity", *(f"scale_{at}" for at in range(3)), *(f"rot_{at}" for at in range(4))]
    columns = [np.zeros((len(rest), 3)), arrays["sh_constant"], rest, arrays["opacity_logits"]]
    columns += [arrays["log_scales"], arrays["quaternions"]]
    head = f"ply\nformat binary_little_endian 1.0\nelement vertex {len(rest)}\n"
    head += "".join(f"property double {name}\n" for name in "xyz")
    head += "".join(f"property float {name}\n" for name in names) + "end_header\n"
    rows = zip(arrays["positions"].astype("<f8"), np.hstack(columns).astype("<f4"))
    path.write_bytes(head.encode() + b"".join(place.tobytes() + row.tobytes() for place, row in rows))


CHILD = """
import os, subprocess, sys, time
from pathlib import Path
from unittest import mock
import omnilife.rerun
from small import ERP, Small

small = Small(ERP)

def show(**options):
    try:
        omnilife.rerun.show(sys.argv[1], small.scene, small.split, follow=True, **options)
    except omnilife.OmnilifeError as error:
        assert "\\n" not in str(error)
        print(type(error).__name__, next(name for name in ("run.rrd", "/proxy") if f"{name}: cannot be" in str(error)))
    sys.stdout.flush()
    small.remove()
    os._exit(0)
"""
#: Files may have 20,000 bytes.
LIMITED = """
import resource, signal
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, resource.RLIM_INFINITY))
omnilife.rerun._SEND_SECONDS = 1.0
show(save=sys.argv[2])
"""
#: A viewer that is killed at the second look at the run.
LEFT_ALONE = """
import socket
with socket.socket() as unused:
    unused.bind(("127.0.0.1", 0))
    port = unused.getsockname()[1]
serve = "import rerun, sys, time; stream = rerun.RecordingStream('viewer'); "
serve += "stream.serve_grpc(grpc_port=int(sys.argv[1])); print(flush=True); time.sleep(60)"
viewer = subprocess.Popen([sys.executable, "-c", serve, str(port)], stdout=subprocess.PIPE)
viewer.stdout.readline()
looks = []

def look(_):
    looks.append(0)
    if len(looks) == 2:
        viewer.kill()
        viewer.wait()
    # What is lost shows itself at the next thing that is sent.
    lines = ["iteration,wall_seconds", *(f"{at},{at}.5" for at in range(len(looks) + 1))]
    Path(sys.argv[1], "trace.csv").write_text("\\n".join(lines) + "\\n")
    assert len(looks) < 20

with mock.patch("time.sleep", look):
    show(connect=f"rerun+http://127.0.0.1:{port}/proxy")
"""


class Scenes(unittest.TestCase):
    def setUp(self) -> None:
        self.small = Small(ERP)
        self.addCleanup(self.small.remove)
        self.folder = self.small.folder
        self.run_ = self.folder / "run"
        self.run_.mkdir()


class OfFiles(Scenes):
    def test_a_model_and_a_checkpoint_hold_the_same_gaussians(self) -> None:
        arrays = model()
        file, checkpoint = self.run_ / "gaussians.ply", self.run_ / "checkpoint.bin"
        write_checkpoint(checkpoint, arrays)
        # x_normalized = scale * (x_world - offset).
        in_world = {**arrays, "positions": 2.0 * arrays["positions"] + [10.0, 20.0, 30.0]}
        write_ply(file, {**in_world, "log_scales": arrays["log_scales"] + np.log(2.0)})
        found, saved = read_ply(file), read_checkpoint(checkpoint)
        self.assertEqual((saved.iteration, saved.wall_seconds), (40, 3.5))
        self.assertEqual(len(saved.left_out), 1)
        self.assertIn("tracked", saved.left_out[0])
        np.testing.assert_allclose(found.centres, in_world["positions"], rtol=1e-6)
        np.testing.assert_allclose(found.scales, 2.0 * np.exp(arrays["log_scales"]), rtol=1e-6)
        for name in ("centres", "scales", "quaternions", "colours", "harmonics"):
            one, other = getattr(found, name), getattr(saved.gaussians, name)
            np.testing.assert_allclose(one, other, rtol=2e-6, atol=1e-6, err_msg=name)
        np.testing.assert_allclose(np.linalg.norm(found.quaternions, axis=1), 1.0, rtol=1e-6)
        # Files have w first, the viewer last.
        w, x = arrays["quaternions"][0, :2]
        np.testing.assert_allclose(found.quaternions[0, 0] / found.quaternions[0, 3], x / w, rtol=1e-5)
        harmonics = found.harmonics
        assert harmonics is not None
        rest = arrays["sh_rest"].reshape(-1, REST, 3)
        np.testing.assert_allclose(harmonics[:, :REST], rest, rtol=1e-6)
        self.assertFalse(harmonics[:, REST:].any())

    def test_colours_are_those_of_3dgs(self) -> None:
        arrays = model(3)
        # The constant harmonic is 1 / (2 sqrt(pi)).
        arrays["sh_constant"] = np.array([[0.0, 0.5, -0.5], [9.0, -9.0, 0.0], [0.0, 0.0, 0.0]]) * 2 * np.sqrt(np.pi)
        arrays["opacity_logits"] = np.array([[0.0], [np.inf], [-np.inf]])
        del arrays["sh_rest"]
        found = of_arrays(arrays)
        expected = [[128, 255, 0, 128], [255, 0, 128, 255], [128, 128, 128, 0]]
        np.testing.assert_array_equal(found.colours, expected)
        self.assertIsNone(found.harmonics)
        both = joined([found, of_arrays({**model(4), "sh_rest": np.ones((4, 3, 3))})])
        assert both.harmonics is not None
        self.assertEqual((len(both), both.harmonics[:3].any()), (7, False))
        self.assertEqual(len(joined([])), 0)
        np.testing.assert_array_equal(both.spread(2).centres, both.centres[[0, 3]])

    def test_damaged_files_are_one_line(self) -> None:
        file, checkpoint = self.run_ / "gaussians.ply", self.run_ / "checkpoint.bin"
        write_ply(file, model())
        write_checkpoint(checkpoint, model())
        whole = {file: file.read_bytes(), checkpoint: checkpoint.read_bytes()}
        for path, read in ((file, read_ply), (checkpoint, read_checkpoint)):
            data = whole[path]
            for damaged in (b"", data[:10], data[:-1], data + b"x", data[: len(data) // 2], data[:60] + data[61:]):
                path.write_bytes(damaged)
                with self.assertRaises(InputError) as caught:
                    read(path)
                self.assertIn(path.name, str(caught.exception))
                self.assertNotIn("\n", str(caught.exception))
        for before, after in ((b"scale_1", b"scale_7"), (b"vertex 5", b"vertex 9"), (b"float f_rest_8", b"float x_rest_8")):
            file.write_bytes(whole[file].replace(before, after))
            with self.assertRaises(InputError):
                read_ply(file)
        bad = model()
        bad["positions"][2, 1] = np.nan
        write_checkpoint(checkpoint, bad)
        with self.assertRaisesRegex(InputError, "positions holds 1 values that are not finite"):
            read_checkpoint(checkpoint)
        for changes, reason in (
            ({"learner": json.dumps({"levels": []})}, "not made of Gaussians"),
            ({"normalization": None}, "normalization"),
        ):
            write_checkpoint(checkpoint, model(), **changes)
            left = read_checkpoint(checkpoint)
            self.assertEqual(len(left.gaussians), 0)
            self.assertIn(reason, left.left_out[0])

    def test_errors_and_splines_are_independent_numbers(self) -> None:
        rendered = np.array([[[10, 200, 30], [0, 0, 0]]], np.uint8)
        truth = np.array([[[20, 100, 31], [0, 0, 255]]], np.uint8)
        np.testing.assert_array_equal(error_image(rendered, truth), [[100, 255]])
        # A cubic without inner knots is a Bezier curve.
        corners = np.array([[0.0, 0.0, 0.0], [1.0, 2.0, 0.0], [3.0, 2.0, 1.0], [4.0, 0.0, 5.0]])
        cubic = {"degree": 3, "knots": [2.0] * 4 + [6.0] * 4, "coefficients": corners.tolist()}
        share = np.linspace(0.0, 1.0, 5)[:, None]
        factors = ((1 - share) ** 3, 3 * share * (1 - share) ** 2, 3 * share**2 * (1 - share), share**3)
        expected = sum(factor * corner for factor, corner in zip(factors, corners))
        np.testing.assert_allclose(spline_points(cubic, 5), expected, atol=1e-12)
        # Of degree 1 it is a polyline through its coefficients at the inner knots.
        line = {"degree": 1, "knots": [0.0, 0.0, 1.0, 4.0, 4.0], "coefficients": corners[:3].tolist()}
        np.testing.assert_allclose(spline_points(line, 5)[1], corners[1], atol=1e-12)
        np.testing.assert_allclose(spline_points(line, 5)[2], corners[1] + (corners[2] - corners[1]) / 3)


@extras.needs("rerun")
class Recordings(Scenes):
    def show(self, **options: Any) -> list[str]:
        return omnilife.rerun.show(self.run_, self.small.scene, self.small.split, **options)

    def learn(self, rows: list[tuple[int, float, float]]) -> None:
        """Leaves the trace of a run that learns, with the novel view of every row."""
        lines = ["iteration,wall_seconds,train_loss", *(f"{at},{seconds},{loss}" for at, seconds, loss in rows)]
        for iteration, _, _ in rows:
            folder = self.run_ / f"trace/{iteration:06}"
            folder.mkdir(parents=True, exist_ok=True)
            write_png(folder / "000001.png", np.full_like(self.small.images[1], iteration))
        (self.run_ / "trace.csv").write_text("\n".join(lines) + "\n")

    def read(self, file: Path) -> dict[str, dict[str, list[Any]]]:
        """Columns by entity of a recording: values in the order of iterations."""
        from rerun.chunk import RrdReader

        rows: dict[str, list[tuple[int, dict[str, Any]]]] = {}
        for chunk in RrdReader(file).stream().to_chunks():
            batch = chunk.to_record_batch()
            names = [name for name in batch.schema.names if ":" in name]
            for at in range(batch.num_rows):
                row = {name: batch.column(name)[at].as_py() for name in names}
                iteration = -1 if chunk.is_static else batch.column("iteration")[at].as_py()
                rows.setdefault(chunk.entity_path, []).append((iteration, row))
        found: dict[str, dict[str, list[Any]]] = {}
        for place, of_place in rows.items():
            columns = found.setdefault(place, {})
            for iteration, row in sorted(of_place, key=lambda pair: pair[0]):
                for name, value in row.items():
                    columns.setdefault(name, []).append(value)
                    columns.setdefault("iteration", []).append(iteration)
        return found

    def news(self, file: Path, *steps: Any) -> tuple[dict[str, dict[str, list[Any]]], Recording]:
        import rerun

        rerun.set_strict_mode(True)
        stream = rerun.RecordingStream("omnilife small")
        recording = Recording(rerun, stream, self.small.scene, self.small.split, self.run_, 3, 4)
        stream.save(file, default_blueprint=recording.layout())
        recording.log_scene()
        for step in steps:
            step()
            recording.log_news()
        stream.flush()
        stream.disconnect()
        return self.read(file), recording

    def test_a_run_that_learns_is_shown_row_by_row(self) -> None:
        rows = [(0, 0.5, 0.75), (10, 1.5, 0.5), (20, 3.0, 0.25)]
        found, recording = self.news(
            self.folder / "run.rrd",
            lambda: None,
            lambda: self.learn(rows[:2]),
            lambda: write_checkpoint(self.run_ / "checkpoint.bin", model(6)),
            # A resumed training repeats rows at other times.
            lambda: self.learn([*rows[:1], (10, 1.75, 0.5), rows[2]]),
            lambda: None,
        )
        loss = found["/trace/train_loss"]
        self.assertEqual(loss["iteration"], [0, 10, 10, 20])
        self.assertEqual(loss["Scalars:scalars"], [[0.75], [0.5], [0.5], [0.25]])
        self.assertEqual(found["/views/novel/000001/rendered"]["iteration"].count(20), 2)
        truth = found["/views/novel/000001/truth"]["Image:buffer"][0][0]
        self.assertEqual(bytes(truth), self.small.images[1].tobytes())
        error = found["/views/novel/000001/error"]["DepthImage:buffer"][-1][0]
        at_20 = error_image(np.full_like(self.small.images[1], 20), self.small.images[1])
        self.assertEqual(bytes(error), at_20.tobytes())
        squared = np.square(self.small.images[1] / 255 - 20 / 255).mean()
        psnr = found["/scores/psnr/novel-000001"]["Scalars:scalars"][-1][0]
        self.assertAlmostEqual(psnr, -10 * np.log10(squared), places=4)
        self.assertEqual(found["/world/cameras/input"]["Points3D:positions"], [[[0.0, 2.0, 3.0], [2.0, 2.0, 3.0]]])
        self.assertEqual(found["/world/cameras/novel"]["Points3D:labels"], [["1"]])
        self.assertIn("/world/shown/000001", found)
        # Four of six Gaussians at the checkpoint's iteration, once though it was looked at three times.
        centres = found["/world/gaussians"]["GaussianSplats3D:centers"]
        expected = 2.0 * model(6)["positions"][[0, 1, 3, 4]] + [10.0, 20.0, 30.0]
        self.assertEqual(len(centres), 1)
        np.testing.assert_allclose(centres[0], expected, rtol=1e-5)
        self.assertEqual(set(found["/world/gaussians"]["iteration"]), {40})
        self.assertTrue(any("4 of 6 Gaussians" in note for note in recording.notes), recording.notes)
        self.assertFalse(any("relative" in note for note in recording.notes))

    def test_pinholes_have_frusta_and_far_scenes_an_origin_of_their_own(self) -> None:
        import dataclasses

        far = Small(PINHOLE)
        self.addCleanup(far.remove)
        moved = []
        for frame in far.scene.frames:
            pose = frame.pose and dataclasses.replace(frame.pose, centre=frame.pose.centre + 5e6)
            moved.append(dataclasses.replace(frame, pose=pose))
        far.scene = dataclasses.replace(far.scene, frames=moved)
        self.small = far
        self.learn([(0, 0.5, 0.75)])
        found, recording = self.news(self.folder / "far.rrd", lambda: None)
        frustum = found["/world/shown/000001"]
        self.assertEqual(frustum["Pinhole:resolution"], [[[6.0, 4.0]]])
        self.assertEqual(found["/world/cameras/novel"]["Points3D:positions"], [[[0.0, 0.0, 0.0]]])
        self.assertTrue(any("relative to [5000001.0, 5000002.0, 5000003.0]" in note for note in recording.notes))

    def test_a_run_that_has_not_ended_needs_to_be_followed(self) -> None:
        file = self.folder / "run.rrd"
        with self.assertRaisesRegex(InputError, "run.json"):
            self.show(save=file)
        self.assertEqual(sorted(path.name for path in self.folder.glob("*.rrd*")), [])
        self.learn([(0, 0.5, 0.75)])

        def interrupt(_: float) -> None:
            raise KeyboardInterrupt

        with mock.patch("time.sleep", interrupt):
            notes = self.show(save=file, follow=True)
        self.assertTrue(any("interrupted" in note for note in notes), notes)
        self.assertEqual(self.read(file)["/trace/train_loss"]["Scalars:scalars"], [[0.75]])

    def test_a_run_that_stands_still_is_noted_once(self) -> None:
        self.learn([(0, 0.5, 0.75)])
        looks: list[float] = []

        def look(seconds: float) -> None:
            looks.append(seconds)
            if len(looks) == 2:
                self.learn([(0, 0.5, 0.75), (1, 1.0, 0.5)])
            if len(looks) == 5:
                raise KeyboardInterrupt

        for quiet, count in ((0.0, 1), (600.0, 0)):
            looks.clear()
            is_quiet = mock.patch.object(omnilife.rerun, "_QUIET_SECONDS", quiet)
            logged = mock.patch.object(omnilife.rerun._LOG, "warning")
            with mock.patch("time.sleep", look), is_quiet, logged as warning:
                self.show(save=self.folder / f"still-{count}.rrd", follow=True)
            self.assertEqual(warning.call_count, count)

    def test_bad_requests_are_refused_before_anything_is_written(self) -> None:
        kept = self.folder / "kept.rrd"
        kept.write_bytes(b"a diary")
        with socket.socket() as unused:
            unused.bind(("127.0.0.1", 0))
            port = unused.getsockname()[1]
        for options, kind, reason in (
            ({"save": kept}, InputError, "not a recording"),
            ({"save": self.folder}, InputError, "is a folder"),
            ({"save": self.folder / "missing/run.rrd"}, MachineError, "No such file"),
            ({}, InputError, "either"),
            ({"save": kept, "connect": omnilife.rerun.VIEWER}, InputError, "either"),
            ({"connect": f"rerun+http://127.0.0.1:{port}/proxy"}, MachineError, "no viewer answers"),
            ({"connect": "127.0.0.1:9876"}, InputError, "not an address"),
            ({"connect": "rerun+http://127.0.0.1:99999/proxy"}, InputError, "not an address"),
            ({"save": kept, "views": 0}, InputError, "views must be at least 1"),
            ({"save": kept, "max_gaussians": 0}, InputError, "at least 1"),
            ({"save": kept, "interval_seconds": 0.0}, InputError, "interval_seconds"),
        ):
            with self.subTest(options), self.assertRaisesRegex(kind, reason) as caught:
                self.show(follow=True, **options)
            self.assertNotIn("\n", str(caught.exception))
        self.assertEqual(kept.read_bytes(), b"a diary")
        self.assertEqual(list(self.folder.glob(".*.part")), [])

    def test_a_damaged_checkpoint_leaves_no_part_of_a_file(self) -> None:
        (self.run_ / "checkpoint.bin").write_bytes(b"omnilife/checkpoint/9\n")
        with self.assertRaisesRegex(InputError, "checkpoint.bin"):
            self.show(save=self.folder / "run.rrd", follow=True)

    @unittest.skipUnless(os.name == "posix", "limits of POSIX")
    def test_a_full_disk_is_one_line(self) -> None:
        self.assertEqual(self.in_a_process(LIMITED, self.folder / "run.rrd"), "MachineError run.rrd")

    def test_a_viewer_that_goes_is_one_line(self) -> None:
        self.assertEqual(self.in_a_process(LEFT_ALONE), "MachineError /proxy")

    def in_a_process(self, code: str, *words: object) -> str:
        """Runs code in a process that ends at once: the SDK would wait at its exit for what is gone."""
        self.learn([(at, float(at), 1.0) for at in range(200)])
        line = [sys.executable, "-c", CHILD + code, str(self.run_), *map(str, words)]
        ended = subprocess.run(line, capture_output=True, text=True, timeout=120, check=False)
        self.assertEqual(ended.returncode, 0, ended.stderr)
        return ended.stdout.strip()

    def test_the_command_line_ends_with_the_codes_of_the_command(self) -> None:
        words = [str(self.run_), "--scene", str(self.folder / "none"), "--split", "none", "--connect"]
        with contextlib.redirect_stderr(io.StringIO()) as said:
            self.assertEqual(omnilife.rerun.main(words), 2)
        self.assertEqual(said.getvalue().count("\n"), 1)
        self.assertIn("none", said.getvalue())


class WithoutRerun(unittest.TestCase):
    def test_the_extra_is_named(self) -> None:
        with mock.patch("importlib.import_module", side_effect=ModuleNotFoundError(name="rerun")):
            with self.assertRaisesRegex(ImportError, r"omnilife\[rerun\]"):
                omnilife.rerun.show("run", "scene", "split", save="run.rrd")
        old = mock.Mock(spec=["__version__"], __version__="0.30.2")
        with mock.patch("omnilife.rerun.extra", return_value=old):
            with self.assertRaisesRegex(ImportError, "0.41 or newer, got 0.30.2"):
                omnilife.rerun.show("run", "scene", "split", save="run.rrd")


if __name__ == "__main__":
    unittest.main()
