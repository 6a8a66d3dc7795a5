"""Golden values for curate/tests/all/deepsort.rs, by PyPI deep-sort-realtime 1.3.2 itself.

    python3 scripts/golden/deepsort.py WHEEL >curate/tests/golden/deepsort.json

WHEEL is the package's (`pip download --no-deps deep-sort-realtime==1.3.2`); its classes are imported from
there. Needs PyTorch, SciPy and OpenCV (`opencv-python-headless`). Two things are made: embeddings of ten crops that are
made by a formula, so that both sides have them, and the chains of its tracker on boxes that move by a
formula, with embeddings of four numbers.
"""

import io
import json
import math
import sys
import zipfile

import cv2
import numpy
import torch

# Width and height of the crops, pixels.
SIZES = [(38, 21), (40, 40), (12, 30), (224, 224), (300, 150), (7, 5), (64, 33), (1, 1), (90, 17), (25, 61)]
# Every so many numbers of an embedding are kept.
STEP = 16


def crop(number, width, height):
    """Stripes, a disc and a ramp whose colours are another one's from crop to crop: RGB."""
    y, x = numpy.mgrid[0:height, 0:width]
    red = (x * (7 + number) + y * 3) % 256
    green = ((x - width // 2) ** 2 + (y - height // 2) ** 2) * (1 + number) // 7 % 256
    blue = numpy.where((x // 5 + y // 4 + number) % 2 == 0, 210, 20 + 9 * number)
    return numpy.stack([red, green, blue], axis=-1).astype(numpy.uint8)


def embeddings(archive):
    from deep_sort_realtime.embedder.mobilenetv2_bottle import MobileNetV2_bottle

    weights = archive.read("deep_sort_realtime/embedder/weights/mobilenetv2_bottleneck_wts.pt")
    network = MobileNetV2_bottle(input_size=224, width_mult=1.0)
    network.load_state_dict(torch.load(io.BytesIO(weights), map_location="cpu"))
    network.eval()
    mean, deviation = torch.tensor([0.485, 0.456, 0.406]), torch.tensor([0.229, 0.224, 0.225])
    found = []
    for number, (width, height) in enumerate(SIZES):
        # As MobileNetv2_Embedder.preprocess: resize, ToTensor, Normalize.
        image = torch.from_numpy(cv2.resize(crop(number, width, height), (224, 224))).float() / 255
        image = ((image - mean) / deviation).permute(2, 0, 1)[None]
        with torch.no_grad():
            found.append(network(image)[0].numpy().tolist())
    return found


def clip():
    """Boxes (left, top, width, height) by frame, with embeddings: five vehicles that cross, turn, wait and hide."""
    frames = []
    for frame in range(40):
        boxes = []
        for vehicle in range(5):
            if (frame * 7 + vehicle * 5) % 11 == 3 or (vehicle == 3 and 12 <= frame < 19):
                continue
            x = 40 + 60 * vehicle + (9 - 4 * vehicle) * frame
            y = 60 + 30 * vehicle + 20 * math.sin(0.2 * frame + vehicle)
            width, height = 34 + 3 * vehicle + frame % 3, 20 + vehicle + frame % 2
            direction = [math.cos(vehicle), math.sin(vehicle), 0.3 * vehicle, 0.1 * (frame % 4)]
            boxes.append((vehicle, [x, y, width, height], direction))
        frames.append(boxes)
    return frames


def chains():
    """The package's track of every box; None where it belongs to none that is ever confirmed."""
    from deep_sort_realtime.deep_sort import nn_matching
    from deep_sort_realtime.deep_sort.detection import Detection
    from deep_sort_realtime.deep_sort.tracker import Tracker

    # Those that DeepSort of the package has by default.
    tracker = Tracker(nn_matching.NearestNeighborDistanceMetric("cosine", 0.2, None),
                      max_iou_distance=0.7, max_age=30, n_init=3)
    ids, confirmed = [], set()
    for boxes in clip():
        given = [Detection(box, 1.0, numpy.array(direction)) for _, box, direction in boxes]
        tracker.predict()
        tracker.update(given)
        of_frame = [None] * len(given)
        for track in tracker.tracks:
            if track.is_confirmed():
                confirmed.add(track.track_id)
            for number, one in enumerate(given):
                if track.time_since_update == 0 and track.features[-1] is one.feature:
                    of_frame[number] = track.track_id
        ids.append(of_frame)
    return [[int(key) if key in confirmed else None for key in of_frame] for of_frame in ids]


def main():
    (wheel,) = sys.argv[1:]
    sys.path.insert(0, wheel)
    with zipfile.ZipFile(wheel) as archive:
        found = embeddings(archive)
    record = {
        "torch": torch.__version__, "step": STEP,
        "crops": [{"width": width, "height": height,
                   "norm": math.sqrt(sum(value * value for value in one)),
                   "values": [round(value, 7) for value in one[::STEP]]}
                  for (width, height), one in zip(SIZES, found)],
        "chains": chains(),
    }
    json.dump(record, sys.stdout, separators=(",", ":"))
    print()


if __name__ == "__main__":
    main()
