"""How well trackers chain boxes, by IDF1 of the vehicles that move: ours, those of PyPI's `trackers`, and `norfair`.

usage: chains.py input FLIGHT SEED RATE BOXES       # true boxes, 15 % missing, at every or every second frame
       chains.py peers FLIGHT BOXES                 # chains of the trackers that this Python has
       chains.py score FLIGHT BOXES TRACKS.json     # those of `curate tracks` of the same boxes

FLIGHT is what scripts/results/uav_scene.py writes. A line of JSON for each tracker: name, IDF1, switches, seconds.

Every chain is a number for each box that was given; IDF1 is over all true boxes of the vehicles that move at the
frames that were looked at, of which a missing one can be in no chain. So 1 is out of reach: where every box that is
left is in the right chain, IDF1 is about 0.92.
"""

import json
import random
import sys
import time
from pathlib import Path

import numpy as np

MISSING = 0.15
FRAMES_PER_SECOND = 2


def rows(path):
    for line in Path(path).read_text().splitlines():
        frame, key, *box = line.split(",")[:6]
        yield int(frame), int(key), tuple(float(value) for value in box)


def make_input(flight, seed, rate, target):
    random.seed(seed)
    lines = []
    for line in (flight / "boxes.txt").read_text().splitlines(keepends=True):
        frame, _, rest = line.split(",", 2)
        if random.random() >= MISSING and (rate == FRAMES_PER_SECOND or int(frame) % 2 == 1):
            lines.append(f"{frame},-1,{rest}")
    Path(target).write_text("".join(lines))


def idf1(flight, boxes, chains):
    """`chains`: the number of each box of the file, or None."""
    moving = {track["id"] for track in json.loads((flight / "truth.json").read_text())["tracks"]}
    looked_at = {frame for frame, _, _ in rows(boxes)}
    truth = {(frame, box): key for frame, key, box in rows(flight / "boxes.txt") if frame in looked_at}
    own = [(frame, truth[frame, box], chain) for (frame, _, box), chain in zip(rows(boxes), chains)]
    of_moving = [(frame, key, chain) for frame, key, chain in own if key in moving and chain is not None]
    true_count = sum(key in moving for key in truth.values())
    keys, numbers = sorted(moving), sorted({chain for _, _, chain in of_moving})
    if not numbers:
        return 0.0, 0
    both = np.zeros((len(keys), len(numbers)))
    for _, key, chain in of_moving:
        both[keys.index(key), numbers.index(chain)] += 1
    from scipy.optimize import linear_sum_assignment
    right = both[linear_sum_assignment(-both)].sum()
    switches, last = 0, {}
    for _, key, chain in sorted(of_moving):
        switches += last.get(key, chain) != chain
        last[key] = chain
    return 2 * right / (true_count + len(of_moving)), int(switches)


def report(name, flight, boxes, chains, seconds):
    value, switches = idf1(flight, boxes, chains)
    frames = len({frame for frame, _, _ in rows(boxes)})
    print(json.dumps({"name": name, "idf1": value, "switches": switches, "seconds": seconds, "frames": frames}))


def of_ours(flight, boxes, tracks):
    record = json.loads(Path(tracks).read_text())
    chains = {}
    for one in record["detections"]:
        chains[one["frame"] + 1, tuple(round(value, 3) for value in one["box_pixels"])] = one["track"]
    found = [chains.get((frame, tuple(round(value, 3) for value in box))) for frame, _, box in rows(boxes)]
    seconds = sum(stage["wall_seconds"] for stage in record["stages"] if stage["stage"] == "association")
    report("omnilife", flight, boxes, found, seconds)


def by_frame(boxes):
    frames = {}
    for number, (frame, _, box) in enumerate(rows(boxes)):
        frames.setdefault(frame, []).append((number, box))
    return [frames.get(frame, []) for frame in range(min(frames), max(frames) + 1)
            if frame in frames or len({f % 2 for f in frames}) == 2]


def of_trackers(flight, boxes):
    """All of `trackers`, told to keep chains over gaps of two seconds and to believe a box at once."""
    import inspect

    import supervision
    import trackers
    frames = by_frame(boxes)
    rate = FRAMES_PER_SECOND if len({frame % 2 for frame, _, _ in rows(boxes)}) == 2 else 1
    for name in sorted(dir(trackers)):
        kind = getattr(trackers, name)
        if not (name.endswith("Tracker") and inspect.isclass(kind)):
            continue
        known = inspect.signature(kind.__init__).parameters
        # Their buffers count frames of a video of 30 a second and are scaled by its rate.
        wanted = {"frame_rate": 30.0, "lost_track_buffer": 2 * rate, "minimum_consecutive_frames": 1,
                  "minimum_iou_threshold": 0.05, "minimum_iou_threshold_first_assoc": 0.05}
        try:
            tracker = kind(**{key: value for key, value in wanted.items() if key in known})
            chains, begun = [None] * sum(map(len, frames)), time.perf_counter()
            for of_frame in frames:
                corners = np.array([(x, y, x + w, y + h) for _, (x, y, w, h) in of_frame]).reshape(-1, 4)
                numbers = np.array([number for number, _ in of_frame], int)
                given = supervision.Detections(xyxy=corners, confidence=np.ones(len(corners)),
                                               class_id=np.zeros(len(corners), int), data={"number": numbers})
                found = tracker.update(given)
                ids = found.tracker_id if found.tracker_id is not None else []
                for number, key in zip(found.data.get("number", []), ids):
                    if key is not None and key >= 0:
                        chains[int(number)] = int(key)
            report(name, flight, boxes, chains, time.perf_counter() - begun)
        except TypeError as error:
            print(f"{name}: left out, it needs more than boxes: {error}", file=sys.stderr)


def of_norfair(flight, boxes):
    import norfair
    frames = by_frame(boxes)
    tracker = norfair.Tracker(distance_function="iou", distance_threshold=0.95, initialization_delay=0, hit_counter_max=3)
    chains, begun = [None] * sum(map(len, frames)), time.perf_counter()
    for of_frame in frames:
        given = [norfair.Detection(np.array([[x, y], [x + w, y + h]]), data=number) for number, (x, y, w, h) in of_frame]
        for thing in tracker.update(detections=given):
            if thing.live_points.any() and thing.last_detection in given:
                chains[thing.last_detection.data] = thing.id
    report("norfair", flight, boxes, chains, time.perf_counter() - begun)


def main():
    what, flight, *rest = sys.argv[1:]
    flight = Path(flight)
    if what == "input":
        make_input(flight, int(rest[0]), int(rest[1]), rest[2])
    elif what == "score":
        of_ours(flight, rest[0], rest[1])
    else:
        for run, name in ((of_trackers, "trackers"), (of_norfair, "norfair")):
            try:
                run(flight, rest[0])
            except ImportError:
                print(f"{name} is not there", file=sys.stderr)


if __name__ == "__main__":
    main()
