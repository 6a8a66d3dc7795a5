"""Reads the shards of a dataset and compares them with its files: read_shards.py DATASET [webdataset]

Prints the number of shards, of samples, and the endings of their files.
"""

import json
import pathlib
import sys
import tarfile

dataset = pathlib.Path(sys.argv[1])
shards = sorted(dataset.glob("shards/*.tar"))
samples = {}
if "webdataset" in sys.argv[2:]:
    import webdataset

    for sample in webdataset.WebDataset([str(shard) for shard in shards], shardshuffle=False):
        samples[sample["__key__"]] = {
            ending: content for ending, content in sample.items() if not ending.startswith("__")
        }
else:
    for shard in shards:
        with tarfile.open(shard) as archive:
            for member in archive:
                assert (member.mtime, member.uid, member.gid, member.mode) == (0, 0, 0, 0o644), member
                key, ending = member.name.split(".", 1)
                samples.setdefault(key, {})[ending] = archive.extractfile(member).read()
for key, files in samples.items():
    told = json.loads(files["json"])
    folder = dataset / "videos" / told["sequence"]
    sequence = json.loads((folder / "sequence.json").read_text())
    scene = json.loads((folder / "scene.json").read_text())
    entry, frame = sequence["frames"]["entries"][told["frame"]], scene["frames"][told["frame"]]
    assert key == f"{told['sequence']}/{told['frame']:06}", key
    assert files["png"] == (folder / entry["file"]).read_bytes(), key
    assert files.get("mask.png") == (frame["mask"] and (folder / frame["mask"]).read_bytes()), key
    assert (told["time_seconds"], told["pose"]) == (entry["time_seconds"], frame["pose"]), key
    assert told["camera"] == scene["camera"], key
print(len(shards), len(samples), sorted({ending for files in samples.values() for ending in files}))
