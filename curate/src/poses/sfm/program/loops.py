"""Loop closing: pairs of frames that look alike though they are far apart in time.

The wheel brings no vocabulary, so words are made of the sequence's own features. A frame is the sum of the
differences between its descriptors and their nearest words (VLAD), with signed square roots and length 1.
"""

import numpy as np
import pycolmap

WORDS = 32
# Features of the words' training and rounds of it.
SAMPLES = 8000
ROUNDS = 6
# Every PERIOD-th frame asks for its NEAREST most alike frames.
PERIOD = 5
NEAREST = 2
# Features of a frame that are looked at.
FEATURES = 2000


def pairs_of_frames(database, frame_name, overlap, seed):
    """Returns pairs of names of frames more than two overlaps apart."""
    random = np.random.default_rng(seed)
    with pycolmap.Database.open(database) as opened:
        of_frame = {}
        for image in opened.read_all_images():
            of_frame.setdefault(frame_name(image.name), []).append(image.image_id)
        names = sorted(of_frame)
        if len(names) <= 2 * overlap:
            return []
        descriptors = []
        for name in names:
            rows = np.concatenate([opened.read_descriptors(id).data for id in of_frame[name]])
            taken = random.permutation(len(rows))[:FEATURES]
            descriptors.append(rows[taken].astype(np.float32))
    every = np.concatenate(descriptors)
    if len(every) < WORDS:
        return []
    words = train(every[random.permutation(len(every))[:SAMPLES]], random)
    frames = np.array([describe(rows, words) for rows in descriptors])
    alike = frames @ frames.T
    pairs = set()
    for index in range(0, len(names), PERIOD):
        far = np.flatnonzero(np.abs(np.arange(len(names)) - index) > 2 * overlap)
        for other in far[np.argsort(-alike[index, far], kind="stable")[:NEAREST]]:
            a, b = sorted((index, int(other)))
            pairs.add((names[a], names[b]))
    return sorted(pairs)


def pairs_of_images(database, frame_name, pairs):
    """Returns pairs of names of images, one for a panorama and many for its faces."""
    with pycolmap.Database.open(database) as opened:
        of_frame = {}
        for image in opened.read_all_images():
            of_frame.setdefault(frame_name(image.name), []).append(image.name)
    return [(a, b) for one, other in pairs for a in of_frame[one] for b in of_frame[other]]


def nearest_word(rows, words):
    return np.argmax(rows @ words.T - 0.5 * (words**2).sum(1), 1)


def train(rows, random):
    words = rows[random.permutation(len(rows))[:WORDS]].copy()
    for _ in range(ROUNDS):
        nearest = nearest_word(rows, words)
        for index in range(WORDS):
            mine = rows[nearest == index]
            if len(mine):
                words[index] = mine.mean(0)
    return words


def describe(rows, words):
    sums = np.zeros_like(words)
    if len(rows):
        nearest = nearest_word(rows, words)
        np.add.at(sums, nearest, rows - words[nearest])
    sums = np.sign(sums) * np.sqrt(np.abs(sums))
    length = np.linalg.norm(sums)
    return (sums / length if length else sums).ravel()
