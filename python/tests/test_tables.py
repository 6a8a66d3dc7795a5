"""Tables, views of objects for notebooks, and plots."""

from __future__ import annotations

import os
import tempfile
import unittest
from pathlib import Path

import extras
import numpy as np
from small import ERP, Small

import omnilife
from omnilife import InputError, Result, Table

LONG = Table(
    method=["a", "a", "a", "b"],
    seed=[1, 1, 1, None],
    view=["input", "novel", "novel", "novel"],
    metric=["psnr", "psnr", "ssim", "psnr"],
    mean=[30.0, 25.5, 0.5, 24.0],
    standard_deviation=[1.0, None, 0.1, 2.0],
    views=[2, 1, 1, 3],
    undefined_views=[0, 0, 0, 0],
    direction=["higher-is-better"] * 4,
)
CURVE = "wall_seconds,iteration,novel_psnr_db,novel_ssim\n0,0,,\n1.5,10,20.25,0.5\n3,20,21,0.625\n"


def result(folder: Path) -> Result:
    summary = {
        "mean": 25.5,
        "standard_deviation": None,
        "views": 1,
        "undefined_views": 0,
        "direction": None,
    }
    return Result(
        path=folder / "result.json",
        method="<mine>",
        scene="small",
        protocol="per-scene/2",
        protocol_hash="hash",
        run_failure=None,
        failures=[],
        warnings=["a word"],
        views=Table(view=["novel"], frame=[1], psnr=[25.5]),
        record={"input_views": {}, "novel_views": {"psnr": summary}},
    )


class Tables(unittest.TestCase):
    def test_a_long_table_becomes_wide(self) -> None:
        expected = {
            "method": ["a", "a", "b"],
            "seed": [1, 1, None],
            "view": ["input", "novel", "novel"],
            "psnr": [30.0, 25.5, 24.0],
            "ssim": [None, 0.5, None],
        }
        self.assertEqual(LONG.wide(), expected)
        self.assertEqual(LONG.wide().wide(), expected)
        self.assertEqual(LONG.wide("views")["psnr"], [2, 1, 3])
        with self.assertRaisesRegex(InputError, "^the table has no column median, only method, "):
            LONG.wide("median")
        twice = Table({name: column + column for name, column in LONG.items()})
        with self.assertRaisesRegex(InputError, "two rows of psnr that differ in no other column"):
            twice.wide()

    def test_a_wide_table_becomes_long(self) -> None:
        wide = Table(frame=[4, 9], psnr=[20.0, 21.0], psnr_sd=[1.0, None], ssim=[0.5, None])
        long = wide.long()
        self.assertEqual(
            long,
            {
                "frame": [4, 4, 9, 9],
                "metric": ["psnr", "ssim", "psnr", "ssim"],
                "value": [20.0, 0.5, 21.0, None],
                "standard_deviation": [1.0, None, None, None],
            },
        )
        self.assertEqual(long.long(), long)
        self.assertEqual(long.wide(), {"frame": [4, 9], "psnr": [20.0, 21.0], "ssim": [0.5, None]})
        self.assertEqual(wide.long(["ssim"])["value"], [0.5, None])
        for metrics, reason in ((None, "no column of a metric"), (["snr"], "no column snr")):
            with self.assertRaisesRegex(InputError, reason):
                Table(frame=[1]).long(metrics)

    @extras.needs("polars")
    def test_tables_become_frames_of_polars(self) -> None:
        import polars

        frame = LONG.wide().to_polars()
        self.assertEqual(frame.schema["seed"], polars.Int64)
        self.assertEqual(frame.to_dict(as_series=False), LONG.wide())
        mixed = Table(a=[1, 2.5, None], b=[None, None, None]).to_polars()
        self.assertEqual(mixed["a"].to_list(), [1.0, 2.5, None])
        self.assertEqual(polars.DataFrame(LONG).shape, (4, 9))

    @extras.needs("pandas")
    def test_tables_become_frames_of_pandas(self) -> None:
        import pandas

        frame = LONG.to_pandas()
        self.assertEqual(list(frame.columns), list(LONG))
        self.assertEqual(str(frame["seed"].dtype), "Int64")
        self.assertEqual(str(frame["mean"].dtype), "float64")
        self.assertEqual(LONG.wide().to_pandas()["psnr"].tolist(), [30.0, 25.5, 24.0])
        self.assertEqual(Table(a=[1, 2.5]).to_pandas()["a"].tolist(), [1.0, 2.5])
        self.assertEqual(pandas.DataFrame(LONG).shape, (4, 9))


class Notebooks(unittest.TestCase):
    def test_objects_have_views(self) -> None:
        small = Small(ERP)
        self.addCleanup(small.remove)
        scored = result(small.folder)
        for shown, *words in (
            (small.scene, "Scene small", "erp, 8 x 4", "4, 3 with a pose"),
            (small.split, "Split per-scene/2", "<td>2</td>"),
            (
                small.scene.frames[0],
                "Frame 0",
                "mask.png",
                '<img width="8" height="4" src="data:image/png',
            ),
            (scored, "&lt;mine&gt; on small", "<th>psnr</th>", "<td>25.5</td>"),
            (LONG, "<th>method</th>", "4 rows"),
            (Table(a=list(range(50))), "20 of 50 rows"),
            (omnilife.METRICS["psnr"], "higher-is-better", "dB"),
        ):
            html = shown._repr_html_()
            for word in words:
                self.assertIn(word, html)
        os.remove(small.folder / "0.png")
        self.assertIn("0.png", small.scene.frames[0]._repr_html_())

    @extras.needs("matplotlib")
    def test_a_curve_is_plotted(self) -> None:
        import matplotlib

        matplotlib.use("Agg")
        with tempfile.TemporaryDirectory() as name:
            folder = Path(name)
            with self.assertRaisesRegex(InputError, "curve.csv: there is no curve"):
                omnilife.plot_curve(result(folder))
            (folder / "curve.csv").write_text(CURVE)
            axes = omnilife.plot_curve(result(folder)).axes[0]
            np.testing.assert_array_equal(axes.lines[0].get_xydata(), [[1.5, 20.25], [3.0, 21.0]])
            self.assertEqual(axes.get_xlabel(), "wall-clock time (s)")
            self.assertIn("(dB) of novel views", axes.get_ylabel())
            figure = omnilife.plot_curve(folder, "ssim", "iteration")
            points = figure.axes[0].lines[0].get_xydata()
            np.testing.assert_array_equal(points, [[10, 0.5], [20, 0.625]])
            figure.savefig(folder / "curve.png")
            for metric, against in (("lpips-alex", "iteration"), ("psnr", "cpu_seconds")):
                with self.assertRaisesRegex(InputError, "has no (lpips-alex|cpu_seconds)$"):
                    omnilife.plot_curve(folder, metric, against)  # type: ignore[arg-type]


if __name__ == "__main__":
    unittest.main()
