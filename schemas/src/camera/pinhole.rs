//! Pinhole camera: `u = fx x/z + cx`, `v = fy y/z + cy`.

use glam::{DVec2, DVec3, dvec2, dvec3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::CameraModel;

/// A perspective camera without distortion. All lengths are in pixels.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct PinholeCamera {
    /// Image width in pixels.
    pub width: u32,
    /// Image height in pixels.
    pub height: u32,
    /// Horizontal focal length.
    pub fx: f64,
    /// Vertical focal length.
    pub fy: f64,
    /// Principal point, horizontal.
    pub cx: f64,
    /// Principal point, vertical.
    pub cy: f64,
}

impl PinholeCamera {
    /// Makes a camera from its image size (width, height), focal lengths and principal point, pixels.
    pub const fn new([width, height]: [u32; 2], [fx, fy]: [f64; 2], [cx, cy]: [f64; 2]) -> Self {
        Self {
            width,
            height,
            fx,
            fy,
            cx,
            cy,
        }
    }

    /// Makes a camera with square pixels, a centred principal point and the given horizontal field of view in
    /// radians, in (0, pi).
    pub fn with_horizontal_field_of_view(width: u32, height: u32, radians: f64) -> Self {
        let focal = 0.5 * f64::from(width) / (0.5 * radians).tan();
        Self {
            width,
            height,
            fx: focal,
            fy: focal,
            cx: 0.5 * f64::from(width),
            cy: 0.5 * f64::from(height),
        }
    }
}

impl CameraModel for PinholeCamera {
    /// Returns `None` for points on or behind the plane through the centre that is parallel to the image plane
    /// (`z <= 0`). Points so close to it that their coordinates overflow give `None` too.
    fn project(&self, point_camera: DVec3) -> Option<DVec2> {
        if !point_camera.is_finite() || point_camera.z <= 0.0 {
            return None;
        }
        let pixel = dvec2(
            self.fx * point_camera.x / point_camera.z + self.cx,
            self.fy * point_camera.y / point_camera.z + self.cy,
        );
        pixel.is_finite().then_some(pixel)
    }

    fn unproject(&self, pixel: DVec2) -> DVec3 {
        dvec3(
            (pixel.x - self.cx) / self.fx,
            (pixel.y - self.cy) / self.fy,
            1.0,
        )
        .normalize()
    }
}
