//! From a posed sequence to a trained model and rendered views.
//!
//! What renders, differentiates and optimizes is [`omnilife_engine`]. Rooms here, from the top down (a room
//! imports only from those below it; a test holds that):
//!
//! * [`jobs`]: one method on one scene, from `scene.json` and `split.json` to `run.json` and images;
//!   a model along given poses; what a plan would cost.
//! * [`stability`]: stiff and extreme cases, judged by the f64 reference.
//! * [`methods`]: one file or folder for each, trained and feed-forward.
//! * [`components`]: what a scene may give a method reason for, decided by [`evidence`].
//! * [`baseline`]: the schedule and first Gaussians that every Gaussian method starts from.
//! * [`models`]: what trained methods leave: files, layers, edits, exports.
//! * [`train`]: the loop, its checkpoint and trace. [`learner`]: all that the loop knows of a model. [`seeds`]: first Gaussians. [`formats`]: files of a
//!   model. [`stereo`]: depth from two panoramas. [`scene`]: a scene in memory. [`request`]: what a user asks of a method;
//!   [`options`]: what only some methods understand.
#![cfg_attr(not(test), warn(clippy::disallowed_methods))]

pub mod backends;
pub mod baseline;
pub mod components;
pub mod error;
pub mod evidence;
pub mod formats;
pub mod jobs;
pub mod learner;
pub mod methods;
pub mod models;
pub mod options;
pub mod process;
pub mod random;
pub mod request;
pub mod scene;
pub mod seeds;
pub mod stability;
pub mod stereo;
pub mod train;

pub use error::ReconstructError;
