"""Structure from motion of video frames with COLMAP (pycolmap >= 4.1, CPU only).

One attempt per process: some COLMAP failures end the process that they happen in. Reads frames in
order of name, writes the largest model as COLMAP text to --out. Speaks to its caller in lines:
    begin <stage>       a stage of the work begins
    models <n>          the mapper returned n models
    failed <reason>     there is no model; the exit code is 4
"""

import argparse
import sys
from pathlib import Path

import pycolmap


def say(*words):
    print(*words, flush=True)


def extract(args, database):
    reader = pycolmap.ImageReaderOptions(camera_model=args.camera_model)
    if args.masks:
        # <image file name>.png, black where features are ignored.
        reader.mask_path = args.masks
    options = pycolmap.FeatureExtractionOptions(use_gpu=False, num_threads=args.threads)
    options.sift.max_num_features = args.features
    pycolmap.extract_features(
        database,
        args.frames,
        reader_options=reader,
        camera_mode=pycolmap.CameraMode.SINGLE,
        extraction_options=options,
    )


def match(args, database):
    # guided_matching stays off: it aborts the process on EQUIRECTANGULAR cameras (4.2.1).
    matching = pycolmap.FeatureMatchingOptions(use_gpu=False, num_threads=args.threads)
    pairing = pycolmap.SequentialPairingOptions()
    pairing.overlap = args.overlap
    pycolmap.match_sequential(database, pairing_options=pairing, matching_options=matching)


def has_lens(args):
    """Whether the camera has a focal length and a distortion to be found: an equirectangular one has neither."""
    return args.camera_model != "EQUIRECTANGULAR"


def map_globally(args, database, models):
    options = pycolmap.GlobalPipelineOptions(num_threads=args.threads, random_seed=args.seed)
    options.mapper.num_threads = args.threads
    options.mapper.random_seed = args.seed
    options.mapper.refine_sensor_from_rig = False
    adjustment = options.mapper.bundle_adjustment
    adjustment.refine_focal_length = has_lens(args)
    adjustment.refine_extra_params = has_lens(args)
    adjustment.refine_principal_point = False
    adjustment.refine_sensor_from_rig = False
    return pycolmap.global_mapping(database, args.frames, models, options)


def map_incrementally(args, database, models):
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
        # An ERP camera sees sideways, so moving forward is no degenerate start for it.
        options.mapper.init_max_forward_motion = 1.0
    return pycolmap.incremental_mapping(database, args.frames, models, options)


MAPPERS = {"global": map_globally, "incremental": map_incrementally}


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--frames", required=True)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--masks")
    parser.add_argument("--camera-model", choices=("EQUIRECTANGULAR", "SIMPLE_RADIAL"), required=True)
    parser.add_argument("--mapper", choices=MAPPERS, required=True)
    parser.add_argument("--features", type=int, required=True)
    parser.add_argument("--overlap", type=int, required=True)
    parser.add_argument("--threads", type=int, required=True)
    parser.add_argument("--seed", type=int, required=True)
    args = parser.parse_args()

    pycolmap.set_random_seed(args.seed)
    models = args.out / "models"
    models.mkdir(parents=True)
    database = args.out / "database.db"
    say("begin features")
    extract(args, database)
    say("begin matching")
    match(args, database)
    say("begin mapping")
    found = MAPPERS[args.mapper](args, database, models)
    say("models", len(found))
    if not found:
        say("failed the mapper registered no frames")
        sys.exit(4)
    largest = max(found.values(), key=lambda model: model.num_reg_images())
    text = args.out / "sparse"
    text.mkdir()
    largest.write_text(text)


if __name__ == "__main__":
    main()
