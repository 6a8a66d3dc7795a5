//! Names of the files and folders of a dataset, and of the scores.
//!
//! ```text
//! dataset.json, attrition.csv, funnel.csv, index.html, status.json
//! videos/NAME/
//!   analysis.json, signals.parquet, signature.parquet, boundaries.json, ledger.jsonl, slices.json, slices/
//!   seq-NNN/
//!     sequence.json, frames/NNNNNN.png, motion/NNNNNN.png, annotation.json
//!     scene.json, points.ply, masks/, depth/, depth-prior/, classes/NAME/, frames-straight/
//!     sfm/attempts.json
//!     dynamic-masks/masks.json, dynamic-masks/NNNNNN.png, dynamic-masks/classes/NAME/NNNNNN.png
//!     operator/operator.json, operator/mask.png, operator/image.png
//!     PROTOCOL/split.json, PROTOCOL/tracks.json, PROTOCOL/georeference.json
//!     PROTOCOL/dense/dense.json, PROTOCOL/dense/points.ply, PROTOCOL/dense/NNNNNN.npy, .png
//! about.json, README.md, DATASHEET.md, SHA256SUMS, statistics/, tables/
//! ```

/// Record of views with cameras by words, in their folder.
pub const CAMERAS_FILE: &str = "cameras.json";
/// Record of an asset for web viewers, in its folder.
pub const ASSET_FILE: &str = "asset.json";
/// Folder of the scores of an asset's levels, beside [`ASSET_FILE`]: `scores/<LEVEL>/result.json`.
pub const LEVEL_SCORES_FOLDER: &str = "scores";

/// Record of the dataset.
pub const DATASET_FILE: &str = "dataset.json";
/// Table of everything that was rejected, beside [`DATASET_FILE`].
pub const ATTRITION_FILE: &str = "attrition.csv";
/// Table of what each step of curation leaves, beside [`DATASET_FILE`].
pub const FUNNEL_FILE: &str = "funnel.csv";
/// Page to look at a dataset, beside [`DATASET_FILE`].
pub const PAGE_FILE: &str = "index.html";
/// Record of the parts that each sequence has and lacks, beside [`PAGE_FILE`].
pub const STATUS_FILE: &str = "status.json";
/// Folder of the videos' folders.
pub const VIDEOS_FOLDER: &str = "videos";

/// Description of a published dataset.
pub const ABOUT_FILE: &str = "about.json";
/// Dataset card.
pub const CARD_FILE: &str = "README.md";
/// Datasheet.
pub const DATASHEET_FILE: &str = "DATASHEET.md";
/// SHA-256 of every published file, in the format of `sha256sum`.
pub const CHECKSUMS_FILE: &str = "SHA256SUMS";
/// Folder of the statistics and their figures.
pub const STATISTICS_FOLDER: &str = "statistics";
/// Folder of the tables of frames, masks, poses, points, annotations and splits.
pub const TABLES_FOLDER: &str = "tables";

/// Analysis of a video, in its folder.
pub const ANALYSIS_FILE: &str = "analysis.json";
/// Per-frame signals of the boundary detector, in a video's folder.
pub const SIGNALS_FILE: &str = "signals.parquet";
/// Samples of a video by which its shots are judged, in the video's folder.
pub const SAMPLES_FILE: &str = "samples.parquet";
/// Compact description of a video over time, in the video's folder.
pub const SIGNATURE_FILE: &str = "signature.parquet";
/// Boundaries at which a video was cut, in its folder.
pub const BOUNDARIES_FILE: &str = "boundaries.json";
/// Statements of detectors and people on boundaries, in a video's folder.
pub const LEDGER_FILE: &str = "ledger.jsonl";
/// Record of the sequences that were written as video, in a video's folder.
pub const SLICES_FILE: &str = "slices.json";
/// Folder of those videos, in a video's folder.
pub const SLICES_FOLDER: &str = "slices";

/// Returns the name of the folder of a video's sequence with this number, in the video's folder.
pub fn sequence_name(index: usize) -> String {
    format!("seq-{index:03}")
}

/// Record of the sequence, in its folder.
pub const SEQUENCE_FILE: &str = "sequence.json";
/// Folder of the sampled frames, in a sequence's folder.
pub const FRAMES_FOLDER: &str = "frames";
/// Folder of small frames in which motion is measured, in a sequence's folder.
pub const MOTION_FOLDER: &str = "motion";
/// Tags and captions, in a sequence's folder.
pub const ANNOTATION_FILE: &str = "annotation.json";
/// Cameras, poses and points, in a sequence's folder.
pub const SCENE_FILE: &str = "scene.json";
/// Points of a scene, beside [`SCENE_FILE`].
pub const POINTS_FILE: &str = "points.ply";
/// Folder of the masks that came with the poses, beside [`SCENE_FILE`].
pub const SCENE_MASKS_FOLDER: &str = "masks";
/// Folder of the masks of the ignored region, beside [`SCENE_FILE`] and in exports.
pub const IGNORE_MASKS_FOLDER: &str = "ignore";
/// Folder of the undistorted frames, beside [`SCENE_FILE`].
pub const STRAIGHT_FRAMES_FOLDER: &str = "frames-straight";
/// Folder of depth images, beside [`SCENE_FILE`].
pub const DEPTH_FOLDER: &str = "depth";
/// Folder of depth priors, beside [`SCENE_FILE`].
pub const DEPTH_PRIOR_FOLDER: &str = "depth-prior";
/// Folder of the folders of class masks, beside [`SCENE_FILE`].
pub const CLASSES_FOLDER: &str = "classes";
/// Folder of everything that structure from motion leaves, in a sequence's folder.
pub const SFM_FOLDER: &str = "sfm";
/// Record of all attempts of structure from motion, in [`SFM_FOLDER`].
pub const ATTEMPTS_FILE: &str = "attempts.json";
/// Folder of the masks that `curate masks` computes, in a sequence's folder.
pub const DYNAMIC_MASKS_FOLDER: &str = "dynamic-masks";
/// Record of the computed masks, in [`DYNAMIC_MASKS_FOLDER`].
pub const DYNAMIC_MASKS_FILE: &str = "masks.json";
/// Folder of what stays in the camera's frame, in a sequence's folder.
pub const OPERATOR_FOLDER: &str = "operator";
/// Record of it, in [`OPERATOR_FOLDER`].
pub const OPERATOR_FILE: &str = "operator.json";

/// Tracks of the dynamic region, as far as a split's input views show it, beside [`SPLIT_FILE`].
pub const TRACKS_FILE: &str = "tracks.json";
/// Place of a scene on the Earth, beside [`TRACKS_FILE`].
pub const GEOREFERENCE_FILE: &str = "georeference.json";
/// Folder of distances by stereo and their points, beside [`SPLIT_FILE`].
pub const DENSE_FOLDER: &str = "dense";
/// Record of stereo, in [`DENSE_FOLDER`].
pub const DENSE_FILE: &str = "dense.json";
/// Input views and scored views of a scene under a protocol.
pub const SPLIT_FILE: &str = "split.json";
/// Record of one method's run on a split, in the run's folder.
pub const RUN_FILE: &str = "run.json";
/// Scores of one method on a split, in the folder of the scores.
pub const RESULT_FILE: &str = "result.json";
/// Scores along a training, beside [`RESULT_FILE`].
pub const CURVE_FILE: &str = "curve.csv";
/// Settings with which the scores beside it were computed.
pub const SCORING_FILE: &str = "scoring.json";
/// Record of a submission of results, in its folder.
pub const SUBMISSION_FILE: &str = "submission.json";
/// Record of an accepted submission's verification, beside [`SUBMISSION_FILE`].
pub const VERIFICATION_FILE: &str = "verified.json";
