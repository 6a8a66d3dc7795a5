"""Puts the tables and images of scripts/results/uav into docs/results/uav.md, between its two markers.

    python3 uav_page.py FOLDER SCENE RENDERING PAGE [EMPTY]

FOLDER is what scripts/results/uav filled, SCENE the scene that was trained on, RENDERING what
uav_scene.py was given, EMPTY the same without what moves. Needs NumPy and Pillow.
"""

import json
import sys
from pathlib import Path

import aids
import numpy as np
from PIL import Image, ImageFilter

BEGIN, END = "<!-- measured: begin -->", "<!-- measured: end -->"
# A view whose emptied region is smaller has no score of its own, pixels.
LEAST_PIXELS = 50
# Frames that show what is behind a vehicle.
OTHERS = 9
# Around what covers a vehicle, pixels: its shadow falls there.
MARGIN = 4
# Shown: a given frame and two novel ones.
SHOWN = [16, 17, 25]


def read(path):
    return json.loads(Path(path).read_text())


def spread(values, digits=2):
    """The mean, and half of the range where there are several."""
    values = [value for value in values if value is not None]
    if not values:
        return "-"
    half = (max(values) - min(values)) / 2
    return f"{np.mean(values):.{digits}f}" + (f" ± {half:.{digits}f}" if len(values) > 1 else "")


def of_geometry(folder):
    dense, poses = read(folder / "dense.json"), read(folder / "poses.json")
    cpu = sum(float(part) for part in (folder / "dense-cpu.txt").read_text().split()[-2:])
    percent = lambda key: f"{100 * dense[key]:.1f} %"
    return [
        "| Stereo | Frames | Known | Within 1 % | Known and wrong by 5 % | Points | CPU s |",
        "|---" + "|---:" * 6 + "|",
        f"| exact poses, 640x360 | {dense['frames']} | {percent('known')} | {percent('within_1_percent')} | "
        f"{percent('wrong_of_known')} | {dense['points']} | {cpu:.0f} |",
        "",
        "| Structure from motion | Posed | Centres, m | Rotations, degrees | Focal length, of the width | Wall s |",
        "|---" + "|---:" * 5 + "|",
        f"| video alone, 1 frame a second | {poses['posed']} of {poses['frames']} | {poses['metres']:.3f} | "
        f"{poses['degrees']:.3f} | {poses['focal']:.4f} (true {poses['true_focal']:.4f}) | "
        f"{poses['wall_seconds']} |"]


def of_tracks(folder):
    lines = ["| Detections | Frames a second | Recall | Precision | IDF1 | MOTA | Switches | Ground, m | "
             "Heading, degrees | Speed, % | Length, m |", "|---" * 2 + "|---:" * 9 + "|"]
    kinds = [("`motion`", "motion-1", 1), ("`motion`, after `path-alignment`", "refit-1", 1),
             ("`motion`", "motion-2", 2),
             ("`motion`, points by stereo", "stereo-1", 1),
             ("true boxes, 15 % missing", "boxes-1-*", 1), ("true boxes, 15 % missing", "boxes-2-*", 2)]
    for title, pattern, rate in kinds:
        found = [read(path) for path in sorted((folder / "tracks").glob(f"{pattern}.json"))]
        cell = lambda part, key, digits=2: spread([(one[part] or {}).get(key) for one in found], digits)
        is_found = title.startswith("`")
        lines.append("| " + " | ".join([
            title, str(rate), cell("detections", "recall") if is_found else "-",
            cell("detections", "precision") if is_found else "-", cell("boxes", "idf1"),
            cell("boxes", "mota"), cell("boxes", "switches", 1), cell("paths", "ground_metres"),
            cell("paths", "heading_degrees", 1), cell("paths", "speed_percent", 1), cell("paths", "length_metres", 1)]) + " |")
    return lines


def of_runs(folder, kinds):
    lines = ["| Run | Given: dynamic | Given: static | Novel: whole | Novel: SSIM | Novel: dynamic | "
             "Novel: static | CPU s | Gaussians | Memory, MB |", "|---" + "|---:" * 9 + "|"]
    rows = []
    for title, name in kinds:
        found = [path.parent for path in sorted((folder / "runs").glob(f"{name}-[0-9]/run.json"))]
        if not found:
            continue
        runs = [read(path / "run.json") for path in found]
        scores = [read(path / "score/result.json") for path in found]
        cell = lambda views, metric, digits=2: spread([one[views][metric]["mean"] for one in scores], digits)
        lines.append("| " + " | ".join([
            title, cell("input_views", "psnr-dynamic"), cell("input_views", "psnr-static"),
            cell("novel_views", "psnr"), cell("novel_views", "ssim", 3), cell("novel_views", "psnr-dynamic"),
            cell("novel_views", "psnr-static"),
            spread([run["training_cpu_seconds"] for run in runs], 0),
            spread([run["primitives"] for run in runs], 0),
            spread([run["peak_memory_bytes"] / 1e6 for run in runs], 0)]) + " |")
        rows += [(title, run) for run in runs]
    return lines + aids.lines(rows)


def of_stages(folder):
    """What the way from the video took: structure from motion and stereo as they were run for their own tables, then
    the stages that the record of the first run of object-graph tells."""
    others = [("structure from motion, the video alone", folder / "alone/videos/flight/seq-000/.done/poses.json"),
              ("dense points by stereo, exact poses", folder / "stereo/dense/.done/dense.json")]
    rows = [(title, read(path)) for title, path in others if path.exists()]
    for stage in read(folder / "runs/object-graph-0/run.json").get("stages", []):
        way = f" (`{stage['method']}`)" if stage.get("method") else ""
        rows.append((stage["stage"] + way, stage))
    seconds = lambda one, key: f"{one[key]:.2f}" if one.get(key) is not None else "-"
    return ["| Stage | Wall s | CPU s |", "|---|---:|---:|",
            *(f"| {title} | {seconds(took, 'wall_seconds')} | {seconds(took, 'cpu_seconds')} |"
              for title, took in rows)]


class Road:
    """What is behind vehicles: the same places of the road in other frames."""

    def __init__(self, scene, rendering):
        self.truth = read(rendering / "tracks.json")
        camera, self.frames = self.truth["camera"], self.truth["frames"]
        self.images = [self.image(scene / f"frames/{number:06}.png") for number in range(len(self.frames))]
        self.height, self.width = self.images[0].shape[:2]
        self.scale = self.width / camera["width"]
        self.focal = camera["fx"] * self.scale
        size = (self.width, self.height)
        self.instances = [np.asarray(Image.open(rendering / frame["inst"]).resize(size, Image.NEAREST))
                          for frame in self.frames]
        self.distances = [np.asarray(Image.open(rendering / frame["depth"]).resize(size, Image.NEAREST)) /
                          self.truth["depth_scale"] for frame in self.frames]
        vehicles = {}
        for frame in self.frames:
            for one in frame["objects"]:
                if one["class"] == "vehicle":
                    vehicles.setdefault(one["id"], []).append(one["centre"])
        self.moving = [key for key, places in vehicles.items() if np.ptp(np.array(places), axis=0).max() > 1]

    @staticmethod
    def image(path):
        return np.asarray(Image.open(path).convert("RGB"), float) / 255

    def behind(self, number):
        """Rows, columns and colours of the road behind the vehicles of a frame, where others show it."""
        rows, columns = np.nonzero(np.isin(self.instances[number], self.moving))
        matrix = np.array(self.frames[number]["c2w"])
        rays = np.stack([(columns + 0.5 - self.width / 2) / self.focal,
                         (rows + 0.5 - self.height / 2) / self.focal, np.ones(len(rows))])
        rays = matrix[:3, :3] @ rays
        points = matrix[:3, 3:] + rays * (-matrix[2, 3] / rays[2])
        seen = np.full((len(self.frames), len(rows), 3), np.nan)
        for other, frame in enumerate(self.frames):
            to = np.array(frame["c2w"])
            local = to[:3, :3].T @ (points - to[:3, 3:])
            column = local[0] / local[2] * self.focal + self.width / 2
            row = local[1] / local[2] * self.focal + self.height / 2
            inside = (local[2] > 0) & (column >= 1) & (row >= 1) & (column < self.width - 1) & (row < self.height - 1)
            at = (row[inside].astype(int), column[inside].astype(int))
            length = np.linalg.norm(points - to[:3, 3:], axis=0)[inside]
            clear = (self.instances[other][at] == 0) & (np.abs(self.distances[other][at] / length - 1) < 0.01)
            index = np.nonzero(inside)[0][clear]
            seen[other, index] = self.images[other][row[index].astype(int), column[index].astype(int)]
        order = sorted(range(len(self.frames)), key=lambda other: abs(other - number))
        nearest = np.full((OTHERS, len(rows), 3), np.nan)
        count = np.zeros(len(rows), int)
        for other in order:
            takes = ~np.isnan(seen[other, :, 0]) & (count < OTHERS)
            nearest[count[takes], takes] = seen[other, takes]
            count[takes] += 1
        known = count >= 3
        return rows[known], columns[known], np.nanmedian(nearest[:, known], axis=0)

    def score(self, views, skip=None):
        """PSNR of the emptied regions of all views, dB, pooled over their pixels; and how many pixels."""
        squares = []
        for number in range(len(self.frames)):
            rows, columns, colours = self.behind(number)
            if len(rows) >= LEAST_PIXELS:
                shown = self.image(views / f"{number:06}.png")[rows, columns]
                squares.append(((shown - colours) ** 2).reshape(-1))
        squares = np.concatenate(squares)
        return -10 * np.log10(squares.mean()), len(squares) // 3

    def score_against(self, views, empty):
        """The same against a rendering without what moves; and with a margin, where shadows were."""
        scores = []
        for margin in (0, MARGIN):
            squares = []
            for number, frame in enumerate(self.frames):
                mask = Image.fromarray(np.isin(self.instances[number], self.moving).astype(np.uint8) * 255)
                region = np.asarray(mask.filter(ImageFilter.MaxFilter(2 * margin + 1)) if margin else mask) > 0
                if region.sum() >= LEAST_PIXELS:
                    truth = Image.open(empty / frame["rgb"]).convert("RGB").resize((self.width, self.height), Image.BOX)
                    shown = self.image(views / f"{number:06}.png")
                    squares.append(((shown - np.asarray(truth, float) / 255) ** 2)[region].reshape(-1))
            scores.append(-10 * np.log10(np.concatenate(squares).mean()))
        return scores


def of_removal(folder, road, empty):
    head = "| What was taken out | Emptied region, dB | Pixels |"
    lines = [head + (f" Rendered without vehicles, dB | {MARGIN} pixels around too, dB |" if empty else ""),
             "|---|---:|---:|" + ("---:|---:|" if empty else "")]
    for title, name in [("nothing (`odgs`)", "odgs"), ("nothing (`object-graph`, tracks by `motion`)", "object-graph"),
                        ("all, tracks by `motion`", "removed-object-graph"), ("all, exact tracks", "removed-exact")]:
        score, pixels = road.score(folder / "views" / name)
        of_empty = "".join(f" {score:.2f} |" for score in road.score_against(folder / "views" / name, empty)) if empty else ""
        lines.append(f"| {title} | {score:.2f} | {pixels} |{of_empty}")
    return lines


def of_street(folder):
    kinds = [("`odgs`", "street-odgs"), ("`omni4dgs-plus`", "street-omni4dgs-plus"),
             ("`object-graph`, exact tracks", "street-object-graph")]
    rows = of_runs(folder, kinds)
    return ["### Panoramas", "", *rows, ""] if len(rows) > 2 else []


def images(folder, scene, page):
    columns = [scene / "frames", folder / "views/odgs", folder / "views/object-graph",
               folder / "views/removed-object-graph", folder / "views/moved"]
    rows = [[Image.open(column / f"{number:06}.png").convert("RGB") for column in columns] for number in SHOWN]
    width, height = rows[0][0].size
    sheet = Image.new("RGB", (width * len(columns), height * len(rows)))
    for y, row in enumerate(rows):
        for x, image in enumerate(row):
            sheet.paste(image, (x * width, y * height))
    target = page.parent.parent / "images/uav.jpg"
    sheet.save(target, quality=72)
    return [f"![frames 16 (given), 17 and 25 (novel): as filmed, odgs, object-graph on its own tracks, all "
            f"vehicles taken out, one moved and one copied](../images/{target.name})", "",
            "Frames 16 (input), 17 and 25 (novel): as filmed, `odgs`, and `object-graph` on tracks by `motion`. "
            "Then the same without all vehicles, and on exact tracks with one vehicle moved and turned and one "
            "copied."]


def main():
    folder, scene, rendering, page, *empty = map(Path, sys.argv[1:])
    hardware = read(folder / "runs/odgs-0/run.json")["hardware"]
    iterations = read(folder / "runs/odgs-0/run.json")["iterations"]
    road = Road(scene, rendering)
    main_runs = [("`odgs`", "odgs"), ("`object-graph`, tracks by `motion`", "object-graph"),
                 ("`object-graph`, exact tracks", "exact"), ("`periodic`", "periodic"),
                 ("`omni4dgs`", "omni4dgs"), ("`omni4dgs-plus`", "omni4dgs-plus"),
                 ("`periodic`, as long as `odgs`", "periodic-equal"),
                 ("`omni4dgs`, as long as `odgs`", "omni4dgs-equal"),
                 ("`omni4dgs-plus`, as long as `odgs`", "omni4dgs-plus-equal"),
                 ("`odgs` without aids", "odgs-bare"),
                 ("`object-graph` without aids, tracks by `motion`", "object-graph-bare")]
    ablated = [("all", "object-graph"), ("with `object-poses`", "with-object-poses"),
               ("with `path-alignment`", "with-path-alignment"),
               ("with both", "with-both"),
               ("without `sky-shell`", "without-sky-shell"), ("without `object-graph` (is `odgs`)", "odgs")]
    text = [f"{iterations} iterations, images {road.width} wide, tracks from images 640 wide; "
            f"{hardware['threads']} threads of {hardware['processor']}, shared with other work. Where there are "
            "several seeds, the mean and half of the range; PSNR in dB. Runs \"as long as\" another have as many "
            "iterations as fit into its CPU time.", "", "### Geometry", "",
            *of_geometry(folder), "", "### Stages", "", *of_stages(folder), "", "### Tracks", "",
            *of_tracks(folder), "", "### Views", "", *of_runs(folder, main_runs), "", "### Components", "",
            *of_runs(folder, ablated), "", *of_street(folder), "### Removal", "",
            *of_removal(folder, road, empty[0] if empty else None), "",
            *images(folder, scene, page)]
    whole = page.read_text()
    before, rest = whole.split(BEGIN)
    page.write_text(before + BEGIN + "\n" + "\n".join(text) + "\n" + END + rest.split(END)[1])


if __name__ == "__main__":
    main()
