//! Data contracts of OmniLife360 and the camera conventions they rest on.
//!
//! Every other crate of the workspace depends on this one and on no sibling, so whatever two of
//! them must agree about lives here: [`camera`] (which pixel is which direction), [`pose`],
//! [`records`] (the JSON files), [`layout`] (their names), [`points`] and [`rgb`] (clouds and images),
//! [`image_file`] (images of others), [`mask_file`] (masks of others), [`mask_survey`] (their oddities),
//! [`store`] (how a file reaches the disk), [`ownership`] (whose
//! a file is), [`lock`] (who writes into a folder), [`split_rules`] (what methods are given), [`npy`] (arrays),
//! [`frame_scores`] (the scores of every view), [`tracked_regions`] (what moves as far as tracks say),
//! [`oriented_box`] (boxes as cameras see them), [`padded_frame`] (images among padding), [`stage`] (when work can be skipped), [`statistics`]
//! (medians), [`bootstrap`] (how far scores can be trusted), [`plain_text`] (text of others where it is
//! shown), [`provenance`] (what made a record), [`elapsed`] (how long work took), [`process`], [`child`] (programs of others), [`progress`],
//! [`error_kind`], [`foreign_code`] (libraries that panic), and [`testing`] (skipped tests).
//!
//! # Conventions
//! * Camera frame: x right, y down, z forward. World to camera: `x_c = R x_w + t`; poses store the
//!   camera-to-world rotation and the camera centre in f64.
//! * Equirectangular (ERP) images: see [`camera::erp`].
//! * Time is in seconds of the source's presentation timestamps.
//! * Images are `[0, 1]` f32, row-major, three interleaved channels, as decoded (sRGB).
#![cfg_attr(not(test), warn(clippy::disallowed_methods))]

pub mod assignment;
pub mod bootstrap;
pub mod camera;
pub mod child;
pub mod distances;
pub mod elapsed;
pub mod error_kind;
pub mod foreign_code;
pub mod frame_scores;
pub mod image_file;
pub mod interpolation;
pub mod layout;
pub mod lock;
pub mod mask_file;
pub mod mask_survey;
pub mod names;
pub mod npy;
pub mod oriented_box;
pub mod ownership;
pub mod padded_frame;
pub mod placeholders;
pub mod plain_text;
pub mod points;
pub mod pose;
pub mod process;
pub mod progress;
pub mod provenance;
pub mod records;
pub mod rgb;
pub mod scene_points;
pub mod split_rules;
pub mod stage;
pub mod statistics;
pub mod store;
mod temporary;
pub mod testing;
pub mod tracked_regions;
pub mod trajectory;

pub use error_kind::{Classified, ErrorKind};
pub use pose::{Pose, Similarity};
pub use rgb::RgbImage;
