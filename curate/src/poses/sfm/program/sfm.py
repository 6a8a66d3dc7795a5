"""Structure from motion of video frames with COLMAP (pycolmap >= 4.1, CPU only).

One attempt per process: some COLMAP failures end the process that they happen in. Reads frames in
order of name, writes the largest model as COLMAP text to --out/sparse, with the camera of the frames,
and, of panoramas, tracks that its mapper did not see to --out/held_out.txt. Speaks to its caller in lines:
    begin <stage>       a stage of the work begins
    models <n>          the mapper returned n models
    loops <n>           n pairs of frames far apart in time were matched
    failed <reason>     there is no model; the exit code is 4
"""

import argparse
import sys
from pathlib import Path

import pycolmap

import faces
import held_out
import loops


def say(*words):
    print(*words, flush=True)


def fail(reason):
    say("failed", reason)
    sys.exit(4)


def extract(args, database, images, masks, model, parameters, mode, features):
    reader = pycolmap.ImageReaderOptions(camera_model=model, camera_params=parameters)
    if masks:
        # <image file name>.png, black where features are ignored.
        reader.mask_path = masks
    options = pycolmap.FeatureExtractionOptions(use_gpu=False, num_threads=args.threads)
    options.sift.max_num_features = features
    pycolmap.extract_features(
        database,
        images,
        reader_options=reader,
        camera_mode=mode,
        extraction_options=options,
    )


def extract_on_faces(args, database, rig):
    """Finds features on rendered faces. One face may have twice its share of a panorama's."""
    say("begin faces")
    rig.render(args.frames, args.masks)
    say("begin features")
    of_one_face = 2 * args.features // rig.count
    single = pycolmap.CameraMode.PER_FOLDER
    model, parameters = rig.camera.model_name, rig.camera.params_to_string()
    extract(args, database, rig.images, rig.masks, model, parameters, single, of_one_face)


def match(args, database, rig):
    matching = pycolmap.FeatureMatchingOptions(use_gpu=False, num_threads=args.threads)
    # guided_matching stays off: it aborts the process on EQUIRECTANGULAR cameras (4.2.1).
    matching.rig_verification = matching.skip_image_pairs_in_same_frame = rig is not None
    pairing = pycolmap.SequentialPairingOptions()
    pairing.overlap = args.overlap
    pycolmap.match_sequential(database, pairing_options=pairing, matching_options=matching)
    pairs = loops.pairs_of_frames(database, faces.frame_name, args.overlap, args.seed)
    if pairs:
        listed = args.out / "loops.txt"
        images = loops.pairs_of_images(database, faces.frame_name, pairs)
        listed.write_text("".join(f"{a} {b}\n" for a, b in images))
        options = pycolmap.ImportedPairingOptions(match_list_path=listed)
        pycolmap.match_image_pairs(database, pairing_options=options, matching_options=matching)
    say("loops", len(pairs))


def has_lens(args):
    """Returns true if the camera has a focal length and a distortion to be found."""
    return args.camera_model != "EQUIRECTANGULAR"


def map_globally(args, database, images, models):
    options = pycolmap.GlobalPipelineOptions(num_threads=args.threads, random_seed=args.seed)
    options.mapper.num_threads = args.threads
    options.mapper.random_seed = args.seed
    options.mapper.refine_sensor_from_rig = False
    adjustment = options.mapper.bundle_adjustment
    adjustment.refine_focal_length = has_lens(args)
    adjustment.refine_extra_params = has_lens(args)
    adjustment.refine_principal_point = False
    adjustment.refine_sensor_from_rig = False
    return pycolmap.global_mapping(database, images, models, options)


def map_incrementally(args, database, images, models):
    options = pycolmap.IncrementalPipelineOptions(
        num_threads=args.threads,
        random_seed=args.seed,
        ba_refine_focal_length=has_lens(args),
        ba_refine_principal_point=False,
        ba_refine_extra_params=has_lens(args),
        ba_refine_sensor_from_rig=False,
    )
    # Neighbouring frames of a video have little parallax.
    options.mapper.init_min_tri_angle = 4.0
    if not has_lens(args):
        # An ERP camera sees sideways, so moving forward is not a degenerate start for it.
        options.mapper.init_max_forward_motion = 1.0
    return pycolmap.incremental_mapping(database, images, models, options)


MAPPERS = {"global": map_globally, "incremental": map_incrementally}


def reconstruct_frames(args, database):
    """Maps from features of the frames themselves."""
    say("begin features")
    single = pycolmap.CameraMode.SINGLE
    extract(args, database, args.frames, args.masks, args.camera_model, "", single, args.features)
    return finish(args, database, args.frames, None)


def reconstruct_mixed(args, database):
    """Maps panoramas from features that were found on faces and put back on the sphere."""
    rig = faces.Faces(args.out, args.frames, faces.CUBE, 100.0)
    on_faces = args.out / "faces.db"
    extract_on_faces(args, on_faces, rig)
    rig.put_back(on_faces, database)
    return finish(args, database, args.frames, None)


def reconstruct_faces(args, database):
    """Maps faces as cameras of a rig with known rotations."""
    rig = faces.Faces(args.out, args.frames, faces.ROWS, 90.0)
    extract_on_faces(args, database, rig)
    with pycolmap.Database.open(database) as opened:
        pycolmap.apply_rig_config([rig.config()], opened)
    return finish(args, database, rig.images, rig)


def finish(args, database, images, rig):
    """Matches, holds tracks out and maps; returns the models, and the rig that their images belong to."""
    say("begin matching")
    match(args, database, rig)
    if not has_lens(args):
        # Rays of a lens are known after mapping alone.
        held_out.hold_out(database, args.out / "held_out.txt", faces.rays_of(rig), args.seed)
    say("begin mapping")
    models = args.out / "models"
    models.mkdir()
    return MAPPERS[args.mapper](args, database, images, models), rig


ROADS = {"spherical": reconstruct_frames, "mixed": reconstruct_mixed, "faces": reconstruct_faces}


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--frames", type=Path, required=True)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--masks", type=Path)
    parser.add_argument("--camera-model", choices=("EQUIRECTANGULAR", "SIMPLE_RADIAL"), required=True)
    parser.add_argument("--road", choices=ROADS, required=True)
    parser.add_argument("--mapper", choices=MAPPERS, required=True)
    parser.add_argument("--features", type=int, required=True)
    parser.add_argument("--overlap", type=int, required=True)
    parser.add_argument("--threads", type=int, required=True)
    parser.add_argument("--seed", type=int, required=True)
    args = parser.parse_args()

    pycolmap.set_random_seed(args.seed)
    args.out.mkdir(exist_ok=True)
    found, rig = ROADS[args.road](args, args.out / "database.db")
    say("models", len(found))
    if not found:
        fail("the mapper registered no frames")
    largest = max(found.values(), key=lambda model: model.num_reg_frames())
    text = args.out / "sparse"
    text.mkdir()
    if rig is None:
        largest.write_text(text)
    else:
        rig.write_text(largest, text)


if __name__ == "__main__":
    main()
