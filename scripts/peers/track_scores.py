"""MOTA, IDF1, switches and fragmentations of boxes by PyPI motmetrics and trackeval, as JSON.

usage: track_scores.py TRUTH FOUND THRESHOLD       # boxes as MOT text: frame,id,left,top,width,height

THRESHOLD is the least intersection over union of a match.
"""

import json
import sys
from collections import defaultdict

import numpy as np


def frames_of(path):
    frames = defaultdict(list)
    for line in open(path):
        frame, key, *box = line.split(",")[:6]
        frames[int(frame)].append((int(key), np.array(box, float)))
    return frames


def overlaps(here, there):
    table = np.zeros((len(here), len(there)))
    for row, (_, a) in enumerate(here):
        for column, (_, b) in enumerate(there):
            low, high = np.maximum(a[:2], b[:2]), np.minimum(a[:2] + a[2:], b[:2] + b[2:])
            common = np.prod(np.maximum(high - low, 0))
            table[row, column] = common / (a[2] * a[3] + b[2] * b[3] - common)
    return table


def by_motmetrics(frames, threshold):
    if not hasattr(np, "asfarray"):
        # NumPy 2 has it no longer, and motmetrics 1.4 asks for it.
        np.asfarray = lambda values, dtype=float: np.asarray(values, dtype)
    import motmetrics
    gathered = motmetrics.MOTAccumulator(auto_id=True)
    for here, there, table in frames:
        costs = np.where(table >= threshold, 1 - table, np.nan)
        gathered.update([key for key, _ in here], [key for key, _ in there], costs)
    names = ["mota", "idf1", "num_switches", "num_fragmentations", "num_misses", "num_false_positives"]
    scores = motmetrics.metrics.create().compute(gathered, metrics=names)
    return {name: float(scores[name].iloc[0]) for name in names}


def by_trackeval(frames, threshold):
    import builtins
    import contextlib
    import io
    for name in ("float", "int", "bool"):
        if name not in np.__dict__:
            # Names that NumPy had before 1.24, and that trackeval 1.3 asks for.
            setattr(np, name, getattr(builtins, name))
    with contextlib.redirect_stdout(io.StringIO()):
        import trackeval
        measures = [kind({"THRESHOLD": threshold, "PRINT_CONFIG": False})
                    for kind in (trackeval.metrics.CLEAR, trackeval.metrics.Identity)]
    number = [{}, {}]
    ids = [[], []]
    for here, there, _ in frames:
        for side, boxes in enumerate((here, there)):
            ids[side].append(np.array([number[side].setdefault(key, len(number[side])) for key, _ in boxes], int))
    data = {"gt_ids": ids[0], "tracker_ids": ids[1], "similarity_scores": [table for _, _, table in frames],
            "num_gt_ids": len(number[0]), "num_tracker_ids": len(number[1]), "num_timesteps": len(frames),
            "num_gt_dets": sum(map(len, ids[0])), "num_tracker_dets": sum(map(len, ids[1]))}
    clear, identity = (measure.eval_sequence(data) for measure in measures)
    return {"mota": float(clear["MOTA"]), "idf1": float(identity["IDF1"]), "num_switches": float(clear["IDSW"]),
            "num_fragmentations": float(clear["Frag"]), "num_misses": float(clear["CLR_FN"]),
            "num_false_positives": float(clear["CLR_FP"])}


def main():
    truth, found = (frames_of(path) for path in sys.argv[1:3])
    threshold = float(sys.argv[3])
    frames = [(truth[frame], found[frame], overlaps(truth[frame], found[frame]))
              for frame in sorted({*truth, *found})]
    print(json.dumps({"motmetrics": by_motmetrics(frames, threshold), "trackeval": by_trackeval(frames, threshold)}))


if __name__ == "__main__":
    main()
