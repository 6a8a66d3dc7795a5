//! From raw 360-degree video to verified, cut and posed sequences.
//!
//! [`pipeline::curate_video`] runs the chain of one video: probe ([`video::probe()`]), one analysis
//! pass ([`analysis`]), ERP [`verdict`], admission [`criteria`], shot [`boundaries`], [`slicing`],
//! sampled [`frames`]. [`poses::pose_sequence`] then turns a sequence into a scene, from given poses
//! or by structure from motion. Every stage is skipped while its inputs have not changed.

mod admission;
pub mod analysis;
pub mod annotation;
pub mod attrition;
pub mod audit;
pub mod boundaries;
pub mod criteria;
pub mod dataset;
pub mod error;
pub mod exchange;
pub mod frames;
pub mod inputs;
pub mod ledger;
mod libraries;
pub mod masks;
pub mod motion;
pub mod overlays;
pub mod pipeline;
pub mod poses;
pub mod publish;
mod sequences;
pub mod slicing;
mod staging;
pub mod statistics;
pub mod verdict;
pub mod video;

pub use dataset::{CuratedDataset, curate_dataset};
pub use error::CurateError;
pub use inputs::expand_inputs;
pub use libraries::libraries;
pub use pipeline::{CurateSettings, curate_video};
pub use poses::{
    GivenDepth, GivenTruth, PoseRequest, SfmSettings, pose_sequence, pose_sequence_with,
};
