//! Motion of the camera and of the scene on the sphere: the rotation between two frames, and the flow left after it.
//! Part of that flow cannot be explained by a moving camera in a static scene.
//!
//! Everything works with directions instead of pixels, so there is no seam and no pole: images are sampled on tangent
//! planes at each point.

pub mod camera;
pub mod flow;
pub mod grey;
pub mod pairs;
pub mod pinhole_turns;
pub mod registration;
pub mod residual;
pub mod rotation;

pub use camera::{CameraMotion, camera_motion};
pub use flow::{Flow, flow};
pub use grey::GreySphere;
pub use registration::{Registration, register};
pub use residual::{PairMotion, explain};
pub use rotation::align;
