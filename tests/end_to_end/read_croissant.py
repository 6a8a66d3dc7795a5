"""Reads every record set of a dataset with mlcroissant: read_croissant.py CROISSANT

Prints the number of records of each except the annotations, and compares frames and poses with the scene.
"""

import json
import pathlib
import sys

import mlcroissant

dataset = mlcroissant.Dataset(jsonld=sys.argv[1])
folder = pathlib.Path(sys.argv[1]).parent
records = {}
for record_set in dataset.metadata.record_sets:
    records[record_set.id] = list(dataset.records(record_set.id))
    first = records[record_set.id][0]
    types = {field.id: type(first[field.id]).__name__ for field in record_set.fields}
    expected = {"frame": "int", "time_seconds": "float", "rotation_w": "float", "centre_x": "float"}
    for field, kind in types.items():
        assert kind == expected.get(field.split("/")[1], kind), types
scene = json.loads((folder / "videos/street/seq-000/scene.json").read_text())
for index, frame in enumerate(scene["frames"]):
    image, mask, pose = (records[name][index] for name in ("frames", "masks", "poses"))
    assert image["frames/file"].decode() == f"videos/street/seq-000/{frame['image']}", image
    assert image["frames/image"].size == (128, 64) == mask["masks/image"].size, image
    assert image["frames/time_seconds"] == frame["time_seconds"], image
    assert pose["poses/centre_x"] == frame["pose"]["centre"][0], pose
    assert pose["poses/rotation_w"] == frame["pose"]["rotation_wxyz"][0], pose
splits = {record["splits/split"].decode() for record in records["splits"]}
assert splits == {"input-view", "novel-view"}, splits
counts = {name: "" if name == "annotations" else f" {len(found)}" for name, found in records.items()}
print(", ".join(f"{name}{count}" for name, count in counts.items()))
