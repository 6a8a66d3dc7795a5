//! Camera models in f64: the reference for every faster implementation.
//!
//! To add a model: one file with a struct, its [`CameraModel`] and property tests for the round trip, and a variant
//! of [`Camera`].
//!
//! **Pixel convention, for every model:** continuous image coordinates `(u, v)` have their origin at the top-left
//! corner of the top-left pixel; the centre of pixel `(i, j)` is `(i + 1/2, j + 1/2)`.

mod any;
pub mod cube;
pub mod erp;
pub mod pinhole;

pub use any::Camera;
pub use erp::ErpCamera;
pub use pinhole::PinholeCamera;

use glam::{DVec2, DVec3};

/// Central cameras: pixels and directions of the camera frame (x right, y down, z forward).
pub trait CameraModel {
    /// Returns the image coordinates in pixels of a point in the camera frame, or `None` where the model does not
    /// image it (behind a pinhole, at the camera centre).
    fn project(&self, point_camera: DVec3) -> Option<DVec2>;

    /// Returns the unit direction in the camera frame of image coordinates in pixels.
    fn unproject(&self, pixel: DVec2) -> DVec3;
}
