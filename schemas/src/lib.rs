//! Data contracts of OmniLife360 and the camera conventions they rest on.
//!
//! Every other crate of the workspace depends on this one and on no sibling, so whatever two of
//! them must agree about lives here: [`camera`] (which pixel is which direction), [`pose`],
//! [`records`] (the JSON files), [`points`] and [`rgb`] (clouds and images), [`split_rules`] (what methods are given), [`store`] (how a file
//! reaches the disk), [`npy`] (arrays), [`stage`] (when work can be skipped), [`ownership`] (whose a file is),
//! [`lock`] (who writes into a folder), [`bootstrap`] (how far
//! scores can be trusted), [`provenance`] (what made a record), [`process`], [`progress`] and
//! [`blame`].
//!
//! # Conventions
//! * Camera frame: x right, y down, z forward. World to camera: `x_c = R x_w + t`; poses store the
//!   camera-to-world rotation and the camera centre in f64.
//! * Equirectangular (ERP) images: see [`camera::erp`].
//! * Time is in seconds of the source's presentation timestamps.
//! * Images are `[0, 1]` f32, row-major, three interleaved channels, as decoded (sRGB).

pub mod blame;
pub mod bootstrap;
pub mod camera;
pub mod lock;
pub mod names;
pub mod npy;
pub mod ownership;
pub mod points;
pub mod pose;
pub mod process;
pub mod progress;
pub mod provenance;
pub mod records;
pub mod rgb;
pub mod split_rules;
pub mod stage;
pub mod store;
mod temporary;

pub use blame::{Blame, Blamed};
pub use pose::{Pose, Similarity};
pub use rgb::RgbImage;
