//! Motion of the camera and of the scene on the sphere: the rotation between two frames, the flow left after it, and
//! the part of that flow which a moving camera in a static scene cannot explain.
//!
//! Everything works with directions instead of pixels, so there is no seam and no pole: images
//! are sampled on tangent planes wherever a point lies.

pub mod camera;
pub mod flow;
pub mod grey;
pub mod pinhole_turns;
pub mod residual;
pub mod rotation;

pub use camera::{CameraMotion, camera_motion};
pub use flow::{Flow, flow};
pub use grey::GreySphere;
pub use residual::{PairMotion, explain};
pub use rotation::align;
