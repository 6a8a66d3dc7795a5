//! Reconstruction of a posed sequence: trained models and rendered views.
//!
//! Rendering, differentiation and optimization are in [`omnilife_engine`]; scenes, evidence and the training loop
//! in [`omnilife_training`]; methods in [`omnilife_methods`] and [`omnilife_atlas`].
//!
//! Modules here, from the top down. A module imports only from those below it; a test checks that.
//!
//! * [`jobs`]: one method on one scene, from `scene.json` and `split.json` to `run.json` and images; a model
//!   along given poses; the cost of a plan.
//! * [`backends`]: methods and their backends.
//! * [`variant`]: names of methods with other components than their own.
//! * [`registry`]: all methods, found by name.
#![cfg_attr(not(test), warn(clippy::disallowed_methods))]

pub mod backends;
pub mod jobs;
pub mod registry;
pub mod variant;

#[doc(no_inline)]
pub use omnilife_training::{
    baseline, components, error, error::ReconstructError, evidence, formats, learner, models,
    options, process, random, request, scene, seeds, stereo, train,
};

/// Methods of all crates with their registry.
pub mod methods {
    #[doc(no_inline)]
    pub use omnilife_atlas as neural_atlas;
    #[doc(no_inline)]
    pub use omnilife_methods::{
        deformable, feed_forward, object_graph, odgs, odgs_published, omni4dgs, omni4dgs_plus,
        panogs, periodic,
    };
    #[doc(no_inline)]
    pub use omnilife_training::method::*;

    pub use crate::{
        registry::{METHODS, OpenedRun, find, model_files, open_run},
        variant,
    };
}
