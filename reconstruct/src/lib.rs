//! From a posed sequence to Gaussians and rendered panoramas.
//!
//! * [`gaussians`]: parameter tables and parameterizations; [`camera`]: Jacobians and VJPs.
//! * [`kernels`]: project, sort, bin, raster, loss, adam; [`render`] chains them.
//! * [`clock`]: time in frames; [`losses`]: what dynamic scenes are held to beside their images;
//!   [`mlp`]: the network that deforms Gaussians.
//! * [`densify`], [`optim`]: when Gaussians are added and removed, and how fast they move.
//! * [`methods`]: one file per published method; [`train`] orders the calls.
//! * [`plan`]: what a scene gives a method reason for; [`warm_up`]: a short static training, and what
//!   is seen in it: [`motion_evidence`]: whether anything moves; [`exposure`]: how bright the views are;
//!   [`pose_evidence`]: how far their poses are off.
//! * [`interpolation`]: methods that learn nothing: a spherical sweep, and baselines;
//! * [`job`]: one method on one scene, from `scene.json` and `split.json` to `run.json` and images;
//!   [`render_job`]: Gaussians along given poses, whole or in the layers of [`render_layers`];
//! * [`mod@reference`]: the renderer's definition in f64, the judge; [`stability`]: stiff and extreme
//!   cases, judged by it.

pub mod backend;
pub mod camera;
pub mod clock;
pub mod densify;
pub mod error;
pub mod exposure;
pub mod gaussians;
pub mod gpu;
pub mod initialize;
pub mod interpolation;
pub mod job;
pub mod kernels;
pub mod losses;
pub mod mask_seeds;
pub mod memory;
pub mod methods;
pub mod mlp;
pub mod motion_evidence;
pub mod optim;
pub mod plan;
pub mod pose_evidence;
pub mod process;
pub mod reference;
pub mod render;
pub mod render_job;
pub mod render_layers;
pub mod scene;
pub mod stability;
pub mod train;
pub mod view_dependence;
pub mod warm_up;

pub use error::ReconstructError;
