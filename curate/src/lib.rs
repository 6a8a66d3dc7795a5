//! From raw 360-degree video to verified, cut and posed sequences.
//!
//! [`pipeline::curate_video`] runs the chain of one video: probe ([`omnilife_video::probe()`]), one analysis
//! pass ([`analysis`]), ERP [`projection`], admission [`criteria`], shot [`boundaries`], [`slicing`],
//! judgement of single [`shots`], sampled [`frames`]. [`poses::pose_sequence`] then turns a sequence
//! into a scene, from given poses or by structure from motion. Every stage is skipped while its inputs
//! have not changed.
#![cfg_attr(not(test), warn(clippy::disallowed_methods))]

mod admission;
pub mod analysis;
pub mod annotation;
pub mod attrition;
pub mod audit;
pub mod boundaries;
pub mod criteria;
pub mod dataset;
mod decoding_notes;
mod edited_frames;
pub mod error;
pub mod exchange;
mod frame_order;
pub mod frames;
pub mod inputs;
mod jpeg;
pub mod ledger;
mod libraries;
pub mod masks;
pub mod motion;
pub mod near_duplicates;
mod opencv_images;
pub mod origins;
pub mod overlays;
pub mod overview;
mod parquet_pages;
pub mod pipeline;
pub mod poses;
pub mod projection;
pub mod publish;
mod repetitions;
mod sequences;
mod settings;
mod sharpness;
pub mod shots;
pub mod slicing;
mod sphere_layouts;
mod stills;
mod video_folder;
mod video_names;
pub mod worker;

pub use dataset::{CuratedDataset, Place, curate_dataset, curate_dataset_in};
pub use error::CurateError;
pub use inputs::{InputsLeftOut, expand_inputs, left_out_of_folders};
pub use libraries::libraries;
pub use pipeline::curate_video;
pub use poses::{
    AttachRequest, FrameCommand, FramePrograms, GivenDepth, GivenPrior, GivenTruth, GroundScale,
    IgnoredRegion, MaskProgram, MasksEntry, PoseRequest, PriorProgram, SfmSettings, attach,
    enter_masks, pose_sequence, pose_sequence_with,
};
pub use settings::{CurateSettings, FrameSelection, LayoutChoice};
pub use video_names::video_names;
pub use worker::Worker;
