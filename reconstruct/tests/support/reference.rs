//! The renderer's definition in plain f64 loops: no tiles, no extents, no culling beyond the
//! definition in `kernels/project/mod.rs` and `kernels/raster/mod.rs`. It judges the kernels.

use std::f64::consts::{PI, TAU};

use glam::{DMat3, DQuat, DVec2, DVec3, dvec3};
use omnilife_schemas::camera::{CameraModel, ErpCamera};

/// Raw parameters of one static Gaussian, in the order of the table's arrays.
#[derive(Debug, Clone, Copy)]
pub(crate) struct RawGaussian {
    pub(crate) position: [f64; 3],
    pub(crate) log_scale: [f64; 3],
    pub(crate) quaternion: [f64; 4],
    pub(crate) opacity_logit: f64,
    pub(crate) sh: [f64; 3],
}

impl RawGaussian {
    /// All 14 parameters, array by array.
    pub(crate) fn parameters(&self) -> [f64; 14] {
        let mut all = [0.0; 14];
        all[0..3].copy_from_slice(&self.position);
        all[3..6].copy_from_slice(&self.log_scale);
        all[6..10].copy_from_slice(&self.quaternion);
        all[10] = self.opacity_logit;
        all[11..14].copy_from_slice(&self.sh);
        all
    }

    pub(crate) fn from_parameters(all: [f64; 14]) -> Self {
        Self {
            position: [all[0], all[1], all[2]],
            log_scale: [all[3], all[4], all[5]],
            quaternion: [all[6], all[7], all[8], all[9]],
            opacity_logit: all[10],
            sh: [all[11], all[12], all[13]],
        }
    }
}

/// A camera: world-to-camera rotation and centre.
#[derive(Debug, Clone, Copy)]
pub(crate) struct RefView {
    pub(crate) camera: ErpCamera,
    pub(crate) rotation: DMat3,
    pub(crate) centre: DVec3,
    pub(crate) near: f64,
    pub(crate) background: [f64; 3],
}

/// The discrete decisions of a render: order of the Gaussians, and which of them contribute to
/// which pixel. Finite differences keep them fixed, because the definition jumps where they change.
#[derive(Debug, Clone)]
pub(crate) struct Decisions {
    pub(crate) order: Vec<usize>,
    pub(crate) contributes: Vec<bool>,
}

struct Footprint {
    pixel: DVec2,
    inverse: [f64; 3],
    opacity: f64,
    colour: [f64; 3],
    distance: f64,
}

fn footprint(view: &RefView, gaussian: &RawGaussian) -> Option<Footprint> {
    let p = view.rotation * (DVec3::from_array(gaussian.position) - view.centre);
    let d = p.length();
    let scale = gaussian.log_scale.map(f64::exp);
    let largest = scale.iter().copied().fold(0.0, f64::max);
    if d <= view.near || largest >= d {
        return None;
    }
    let pixel = view.camera.project(p)?;
    let (kx, ky) = (
        f64::from(view.camera.width) / TAU,
        f64::from(view.camera.height) / PI,
    );
    let rho = p.x.hypot(p.z);
    let floored = rho.max(0.005 * d);
    let row_u = dvec3(p.z / rho, 0.0, -p.x / rho) * (kx / floored);
    let row_v = dvec3(-p.x * p.y / (rho * d), rho / d, -p.y * p.z / (rho * d)) * (ky / d);
    let [w, x, y, z] = gaussian.quaternion;
    let rotation = DMat3::from_quat(DQuat::from_xyzw(x, y, z, w).normalize());
    let axes = rotation * DMat3::from_diagonal(DVec3::from_array(scale));
    let covariance = view.rotation * axes * axes.transpose() * view.rotation.transpose();
    let a = row_u.dot(covariance * row_u) + 0.3;
    let b = row_u.dot(covariance * row_v);
    let c = row_v.dot(covariance * row_v) + 0.3;
    let determinant = a * c - b * b;
    Some(Footprint {
        pixel,
        inverse: [c / determinant, -b / determinant, a / determinant],
        opacity: 1.0 / (1.0 + (-gaussian.opacity_logit).exp()),
        colour: gaussian
            .sh
            .map(|sh| (0.5 + 0.282_094_791_773_878_14 * sh).max(0.0)),
        distance: d,
    })
}

/// Renders an HWC image. With `decisions`, those are used instead of made.
pub(crate) fn render(
    view: &RefView,
    gaussians: &[RawGaussian],
    decisions: Option<&Decisions>,
) -> (Vec<f64>, Decisions) {
    let footprints: Vec<Option<Footprint>> = gaussians
        .iter()
        .map(|gaussian| footprint(view, gaussian))
        .collect();
    let order = decisions.map_or_else(
        || {
            let mut order: Vec<usize> = (0..gaussians.len())
                .filter(|&index| footprints[index].is_some())
                .collect();
            let distance = |index: usize| footprints[index].as_ref().map_or(0.0, |f| f.distance);
            order.sort_by(|&a, &b| distance(a).total_cmp(&distance(b)));
            order
        },
        |decisions| decisions.order.clone(),
    );
    let (width, height) = (view.camera.width as usize, view.camera.height as usize);
    let mut image = vec![0.0; width * height * 3];
    let mut contributes = vec![false; width * height * order.len()];
    for row in 0..height {
        for column in 0..width {
            let mut transmittance = 1.0;
            let base = row * width + column;
            for (rank, &index) in order.iter().enumerate() {
                let Some(f) = &footprints[index] else {
                    continue;
                };
                let dx = view
                    .camera
                    .wrapped_column_distance(f.pixel.x, column as f64 + 0.5);
                let dy = row as f64 + 0.5 - f.pixel.y;
                let q =
                    f.inverse[0] * dx * dx + 2.0 * f.inverse[1] * dx * dy + f.inverse[2] * dy * dy;
                let alpha = (f.opacity * (-0.5 * q).exp()).min(0.99);
                let slot = base * order.len() + rank;
                match decisions {
                    Some(decisions) if !decisions.contributes[slot] => continue,
                    None if alpha < 1.0 / 255.0 => continue,
                    None if transmittance * (1.0 - alpha) < 1e-4 => break,
                    _ => {}
                }
                contributes[slot] = true;
                for channel in 0..3 {
                    image[base * 3 + channel] += transmittance * alpha * f.colour[channel];
                }
                transmittance *= 1.0 - alpha;
            }
            for channel in 0..3 {
                image[base * 3 + channel] += transmittance * view.background[channel];
            }
        }
    }
    (image, Decisions { order, contributes })
}
