//! Data contracts of OmniLife360 and its camera conventions.
//!
//! Crates agree here on the data that they exchange. Files, stages and processes are in [`omnilife_base`], whose
//! modules are exported here too. Modules from the top down (each imports only from those below it, which a test
//! checks):
//!
//! * [`tracked_regions`]: dynamic regions as far as tracks tell. [`interpolation`]: values between pixels. [`rgba`]:
//!   layers with an opacity.
//! * [`posed_view`], [`scene_points`], [`distances`], [`rgb`]: views, points, distances and images of a scene.
//!   [`mask_survey`]: oddities of masks of others. [`split_rules`]: the input views of a protocol. [`bootstrap`]:
//!   confidence intervals of scores. [`object_regions`]: moving content as the union of objects.
//! * [`records`]: the JSON files. [`mask_file`]: masks of others.
//! * [`image_file`]: images of others. [`oriented_box`]: boxes as cameras see them. [`ground_plane`],
//!   [`padded_frame`], [`points`]: geometry and clouds. [`srgb`]: light of levels.
//! * [`camera`]: directions of pixels. [`pose`], [`trajectory`]: cameras and objects over time. [`layout`]: names of
//!   files. [`colour_profile`]: profiles of images. [`frame_scores`], [`object_scores`]: the scores of every view, and
//!   of the objects in it. [`absolute_orientation`]: rotations between vectors.
//!
//! # Conventions
//! * Camera frame: x right, y down, z forward. World to camera: `x_c = R x_w + t`; poses store the
//!   camera-to-world rotation and the camera centre in f64.
//! * Equirectangular (ERP) images: see [`camera::erp`].
//! * Time is in seconds of the source's presentation timestamps.
//! * Images are `[0, 1]` f32, row-major, three interleaved channels, as decoded (sRGB).
#![cfg_attr(not(test), warn(clippy::disallowed_methods))]

pub mod absolute_orientation;
pub mod bootstrap;
pub mod camera;
pub mod colour_profile;
pub mod distances;
pub mod frame_scores;
pub mod ground_plane;
pub mod image_file;
pub mod interpolation;
pub mod layout;
mod mask;
pub mod mask_file;
pub mod mask_survey;
pub mod object_regions;
pub mod object_scores;
pub mod oriented_box;
pub mod padded_frame;
pub mod points;
pub mod pose;
pub mod posed_view;
pub mod records;
pub mod rgb;
pub mod rgba;
pub mod scene_points;
pub mod split_rules;
pub mod srgb;
pub mod tracked_regions;
pub mod trajectory;

#[doc(no_inline)]
pub use omnilife_base::{
    Classified, ErrorKind, assignment, band_matrix, child, elapsed, error_kind, foreign_code, lock,
    names, natural_order, npy, ownership, placeholders, plain_text, process, progress, provenance,
    stage, staging, statistics, store, testing, toml_file,
};
pub use pose::{Pose, Similarity};
pub use rgb::RgbImage;
