//! Basis of reconstruction methods: scenes, evidence, components and the training loop.
//!
//! Modules from the top down. A module imports only from those below it, and a test checks that.
//!
//! * [`method`]: the row that describes a method.
//! * [`components`]: optional parts of a run, decided by [`evidence`].
//! * [`baseline`]: the schedule and first Gaussians of every Gaussian method.
//! * [`train`]: the loop, its checkpoint and trace.
//! * [`models`]: files, layers, edits and exports of trained models. [`learner`]: the model's interface for the
//!   loop.
//! * [`seeds`]: first Gaussians. [`formats`]: files of a model.
//! * [`stereo`]: depth from two panoramas. [`scene`]: a scene in memory.
//! * [`alignment`]: motion of a patch from image to image.
//! * [`request`]: a user's request; [`options`]: options of single methods; [`aids`]: components that help any method.
#![cfg_attr(not(test), warn(clippy::disallowed_methods))]

pub mod aids;
pub mod alignment;
pub mod baseline;
pub mod components;
pub mod error;
pub mod evidence;
pub mod formats;
pub mod learner;
pub mod method;
pub mod models;
pub mod options;
pub mod process;
pub mod random;
pub mod request;
pub mod scene;
pub mod seeds;
pub mod stereo;
pub mod train;
