"""Matches that the mapper does not see, by which its poses are judged.

A track is a set of features that verified matches connect. One of EVERY, or twice as many of a short sequence, is
taken out of the matches before mapping and written down: a line of `<frame> <x> <y> <z>` for every feature, the unit
ray in its camera's axes.
"""

import numpy as np
import pycolmap

import faces

EVERY = 20
# Tracks below which twice as many are held out.
ENOUGH = 400
LEAST_FRAMES = 3


def hold_out(database, path, rays_of, seed):
    """Takes tracks out of a database's verified matches and writes them."""
    with pycolmap.Database.open(database) as opened:
        names = {image.image_id: image for image in opened.read_all_images()}
        cameras = {camera.camera_id: camera for camera in opened.read_all_cameras()}
        ids = sorted(names)
        counts = [opened.num_keypoints_for_image(id) for id in ids]
        first = dict(zip(ids, np.concatenate([[0], np.cumsum(counts)])[:-1].astype(int)))
        pairs, geometries = opened.read_two_view_geometries()
        pairs = [pycolmap.pair_id_to_image_pair(pair) for pair in pairs]
        track = connected(pairs, geometries, first, int(sum(counts)))
        chosen = pick(track, ids, counts, names, seed)
        lines = []
        rays = {}
        for root, members in chosen.items():
            words = []
            for id, index in members:
                if id not in rays:
                    image = names[id]
                    pixels = opened.read_keypoints(id)[:, :2].astype(np.float64)
                    rays[id] = rays_of(cameras[image.camera_id], image.name, pixels)
                ray = " ".join(repr(float(value)) for value in rays[id][index])
                words.append(f"{faces.frame_name(names[id].name)} {ray}")
            lines.append(" ".join(words))
        path.write_text("".join(f"{line}\n" for line in lines))
        for (a, b), geometry in zip(pairs, geometries):
            matches = geometry.inlier_matches
            if not len(matches):
                continue
            kept = ~np.isin(track[first[a] + matches[:, 0].astype(int)], list(chosen))
            if not kept.all():
                geometry.inlier_matches = matches[kept]
                opened.update_two_view_geometry(a, b, geometry)


def connected(pairs, geometries, first, count):
    """Returns the smallest feature that each is connected with; each feature is itself where nothing matches it."""
    ends = [
        geometry.inlier_matches.astype(int).T + np.array([[first[a]], [first[b]]])
        for (a, b), geometry in zip(pairs, geometries)
        if len(geometry.inlier_matches)
    ]
    label = np.arange(count)
    if not ends:
        return label
    a, b = np.concatenate(ends, 1)
    while True:
        least = np.minimum(label[a], label[b])
        before = label.copy()
        np.minimum.at(label, a, least)
        np.minimum.at(label, b, least)
        label = label[label]
        if np.array_equal(before, label):
            return label


def pick(track, ids, counts, names, seed):
    """Returns features (image, index) by track of those that are held out: without two of one frame in a track."""
    sizes = np.bincount(track, minlength=len(track))
    roots = np.flatnonzero(sizes >= LEAST_FRAMES)
    wanted = max(len(roots) // EVERY, min(2 * len(roots) // EVERY, ENOUGH))
    roots = np.random.default_rng(seed).permutation(roots)[:wanted]
    members = {int(root): [] for root in roots}
    image_of = np.repeat(ids, counts)
    index_of = np.concatenate([np.arange(count) for count in counts]) if counts else np.zeros(0, int)
    for feature in np.flatnonzero(np.isin(track, roots)):
        members[int(track[feature])].append((int(image_of[feature]), int(index_of[feature])))
    return {root: of_track for root, of_track in members.items() if are_of_different_frames(of_track, names)}


def are_of_different_frames(members, names):
    frames = [faces.frame_name(names[id].name) for id, _ in members]
    return len(set(frames)) == len(frames)
