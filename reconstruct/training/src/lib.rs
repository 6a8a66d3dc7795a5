//! Scenes, evidence, components and the training loop: everything that a reconstruction method builds on.
//!
//! Modules from the top down; a module imports only from those below it, and a test holds that:
//!
//! * [`method`]: the row that describes a method.
//! * [`components`]: what a scene may give a method reason for, decided by [`evidence`].
//! * [`baseline`]: the schedule and first Gaussians that every Gaussian method starts from.
//! * [`train`]: the loop, its checkpoint and trace.
//! * [`models`]: what trained methods leave: files, layers, edits, exports. [`learner`]: all that the loop knows of a model.
//! * [`seeds`]: first Gaussians. [`formats`]: files of a model.
//! * [`stereo`]: depth from two panoramas. [`scene`]: a scene in memory.
//! * [`request`]: what a user asks of a method; [`options`]: what only some methods understand.

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
