//! Equirectangular (ERP) camera.
//!
//! `lon = atan2(x, z)`, `lat = asin(-y / |p|)` (north up),
//! `u = (lon / 2pi + 1/2) W`, `v = (1/2 - lat / pi) H`. The direction +z is the image centre;
//! `u` wraps at the seam (lon = +-pi), `v` does not. This is COLMAP's EQUIRECTANGULAR and the grid
//! of OmniGS (`cuda_rasterizer/forward.cu`, `ndc2Pix`).

use std::f64::consts::{PI, TAU};

use glam::{DVec2, DVec3, dvec2, dvec3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::CameraModel;

/// An equirectangular image of the whole sphere, `width` x `height` pixels.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize, JsonSchema)]
pub struct ErpCamera {
    /// Pixels around the equator (360 degrees).
    pub width: u32,
    /// Pixels from the north pole to the south pole (180 degrees).
    pub height: u32,
}

impl ErpCamera {
    /// Makes a camera of this many columns and rows.
    pub const fn new(width: u32, height: u32) -> Self {
        Self { width, height }
    }

    /// Returns longitude in (-pi, pi] and latitude in [-pi/2, pi/2], radians, of a non-zero direction.
    ///
    /// The latitude is computed as `atan2(-y, hypot(x, z))`, which equals `asin(-y/|p|)` and keeps
    /// its precision at the poles, where the arc sine loses half of its digits.
    pub fn longitude_latitude(direction: DVec3) -> DVec2 {
        let rho = direction.x.hypot(direction.z);
        dvec2(direction.x.atan2(direction.z), (-direction.y).atan2(rho))
    }

    /// Returns the unit direction of a longitude and latitude in radians.
    pub fn direction(longitude: f64, latitude: f64) -> DVec3 {
        let (sin_lon, cos_lon) = longitude.sin_cos();
        let (sin_lat, cos_lat) = latitude.sin_cos();
        dvec3(cos_lat * sin_lon, -sin_lat, cos_lat * cos_lon)
    }

    /// Returns the signed distance in pixels from column `from` to column `to` the short way around the seam, in
    /// [-W/2, W/2].
    pub fn wrapped_column_distance(&self, from: f64, to: f64) -> f64 {
        let width = f64::from(self.width);
        let distance = to - from;
        distance - width * (distance / width).round()
    }

    /// Returns the solid angle of a pixel of row `row` (0 at the north pole), steradians, to first order:
    /// `2pi/W * pi/H * cos(lat)` at the pixel centre.
    pub fn pixel_solid_angle(&self, row: u32) -> f64 {
        let latitude = (0.5 - (f64::from(row) + 0.5) / f64::from(self.height)) * PI;
        TAU / f64::from(self.width) * PI / f64::from(self.height) * latitude.cos()
    }
}

impl CameraModel for ErpCamera {
    /// Returns `u` in [0, W) and `v` in [0, H]; `None` for the zero vector and non-finite input only.
    fn project(&self, point_camera: DVec3) -> Option<DVec2> {
        if !point_camera.is_finite() || point_camera == DVec3::ZERO {
            return None;
        }
        let angles = Self::longitude_latitude(point_camera);
        let width = f64::from(self.width);
        let u = (angles.x / TAU + 0.5) * width;
        let u = if u >= width { u - width } else { u };
        Some(dvec2(u, (0.5 - angles.y / PI) * f64::from(self.height)))
    }

    fn unproject(&self, pixel: DVec2) -> DVec3 {
        let longitude = (pixel.x / f64::from(self.width) - 0.5) * TAU;
        let latitude = (0.5 - pixel.y / f64::from(self.height)) * PI;
        Self::direction(longitude, latitude)
    }
}
