//! Difficult scenes for rendering, around a camera near the origin.

use glam::{DQuat, DVec3, dvec3};
use omnilife_engine::{
    camera::Camera,
    render::settings::{Footprint, RenderSettings},
};
use omnilife_schemas::camera::{ErpCamera, PinholeCamera};
use rand::{Rng, RngExt};

use super::reference::Gaussian;

/// Richness of a scene's Gaussians.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Richness {
    pub(crate) sh_degree: usize,
    pub(crate) features: usize,
}

impl Richness {
    pub(crate) const fn new(sh_degree: usize, features: usize) -> Self {
        Self {
            sh_degree,
            features,
        }
    }
}

pub(crate) fn at(direction: DVec3, distance: f64, scale: [f64; 3], opacity: f64) -> Gaussian {
    Gaussian {
        position: (direction.normalize() * distance).to_array(),
        scale,
        quaternion: [0.8, 0.3, -0.4, 0.33],
        opacity,
        sh: vec![[0.5, -0.2, 0.3]],
        features: Vec::new(),
    }
}

/// Returns the awkward Gaussians: on the seam, over and near both poles, nearly as large as their distance and
/// larger, needles, one behind a camera that looks along +z, one very wide in longitude.
pub(crate) fn awkward() -> Vec<Gaussian> {
    vec![
        at(dvec3(0.0, 0.1, -1.0), 2.0, [0.2, 0.3, 0.25], 0.6),
        at(dvec3(0.02, -0.2, -1.0), 3.0, [0.5, 0.1, 0.2], 0.5),
        at(dvec3(0.1, -1.0, 0.05), 2.5, [0.2, 0.3, 0.1], 0.6),
        at(dvec3(-0.08, 1.0, -0.09), 1.5, [0.1, 0.2, 0.15], 0.5),
        at(dvec3(0.002, -1.0, 0.001), 3.0, [0.5, 0.2, 0.25], 0.4),
        at(dvec3(0.03, 1.0, -0.02), 2.0, [0.05, 0.6, 0.02], 0.7),
        at(dvec3(1.0, 0.3, 0.4), 1.0, [0.6, 0.5, 0.7], 0.3),
        at(dvec3(-0.4, -0.6, 0.7), 1.5, [0.6, 2.0, 0.9], 0.3),
        at(dvec3(-1.0, 0.2, 0.7), 4.0, [2.0, 0.002, 0.002], 0.7),
        at(dvec3(0.3, 0.1, 1.0), 3.0, [0.4, 0.3, 0.001], 0.8),
        at(dvec3(0.4, 2.0, 0.3), 2.0, [0.9, 0.4, 0.3], 0.5),
    ]
}

/// Returns the awkward Gaussians and random ones all around.
pub(crate) fn scene(random: &mut impl Rng, count: usize, richness: Richness) -> Vec<Gaussian> {
    let mut gaussians = awkward();
    gaussians.truncate(count);
    while gaussians.len() < count {
        let mut uniform = |low: f64, high: f64| random.random_range(low..high);
        let direction = dvec3(uniform(-1.0, 1.0), uniform(-1.0, 1.0), uniform(-1.0, 1.0));
        if direction.length() < 0.2 {
            continue;
        }
        let distance = uniform(1.0, 6.0);
        let scale = [0; 3].map(|_| distance * uniform(0.01, 0.12));
        let opacity = uniform(0.05, 0.8);
        let mut gaussian = at(direction, distance, scale, opacity);
        gaussian.quaternion = [0; 4].map(|_| uniform(-1.0, 1.0));
        gaussians.push(gaussian);
    }
    for gaussian in &mut gaussians {
        let count = (richness.sh_degree + 1) * (richness.sh_degree + 1);
        gaussian.sh = (0..count)
            .map(|k| {
                let range = if k == 0 { -1.0..1.5 } else { -0.25..0.25 };
                [0; 3].map(|_| random.random_range(range.clone()))
            })
            .collect();
        gaussian.features = (0..richness.features)
            .map(|_| random.random_range(-1.0..2.0))
            .collect();
        // A renderer takes unit quaternions.
        let length = gaussian
            .quaternion
            .iter()
            .map(|q| q * q)
            .sum::<f64>()
            .sqrt();
        gaussian.quaternion = gaussian.quaternion.map(|q| q / length);
        *gaussian = gaussian.rounded();
    }
    gaussians
}

/// Returns the orientation of a rotated camera.
pub(crate) fn turned() -> DQuat {
    DQuat::from_euler(glam::EulerRot::XYZ, 0.3, -1.1, 0.2)
}

/// Returns a panorama of `width` columns.
pub(crate) fn erp(width: u32) -> Camera {
    Camera::Erp(ErpCamera::new(width, width / 2))
}

/// Returns a pinhole camera with unequal focal lengths, off its middle.
pub(crate) fn pinhole(width: u32, height: u32) -> Camera {
    let camera = PinholeCamera::with_horizontal_field_of_view(width, height, 1.6);
    Camera::Pinhole(PinholeCamera {
        cx: camera.cx + 1.3,
        fy: camera.fy * 1.1,
        ..camera
    })
}

/// Returns settings with a coloured background.
pub(crate) fn settings(footprint: Footprint) -> RenderSettings {
    RenderSettings {
        background: [0.1, 0.3, 0.2],
        footprint,
        ..RenderSettings::new(0.01)
    }
}
