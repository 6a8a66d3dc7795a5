//! Definition of the renderer in plain f64 loops: no tiles, no extents, no culling beyond the definition in
//! `project/mod.rs` and `raster/mod.rs`. It is the reference for the kernels, in tests and in the stability
//! catalogue.

use std::f64::consts::{PI, TAU};

use crate::{
    camera::{Camera, View},
    gaussians::{ActivatedGaussians, MAX_SH_DEGREE, sh_rest_count},
    render::settings::{Footprint, RenderSettings},
};
use glam::{DMat2, DMat3, DQuat, DVec2, DVec3, dvec2, dvec3};
use omnilife_schemas::camera::CameraModel;

/// One activated Gaussian.
#[derive(Debug, Clone, PartialEq)]
pub struct Gaussian {
    /// Centre in normalized world units.
    pub position: [f64; 3],
    /// Standard deviations along the axes.
    pub scale: [f64; 3],
    /// (w, x, y, z), axes to world. It need not have length 1: the definition normalizes it, and takes zero
    /// for the identity.
    pub quaternion: [f64; 4],
    /// Opacity in [0, 1].
    pub opacity: f64,
    /// Harmonics of colour: the constant coefficients first, then those of
    /// [`ActivatedGaussians::sh_rest`].
    pub sh: Vec<[f64; 3]>,
    /// Feature channels.
    pub features: Vec<f64>,
}

/// Returns names and lengths of a Gaussian's parameter arrays, in the order of [`Gaussian::parameters`].
pub fn parameter_arrays(gaussian: &Gaussian) -> Vec<(&'static str, usize)> {
    vec![
        ("positions", 3),
        ("scales", 3),
        ("rotations", 4),
        ("opacities", 1),
        ("sh_constant", 3),
        ("sh_rest", gaussian.sh.len() * 3 - 3),
        ("features", gaussian.features.len()),
    ]
}

impl Gaussian {
    /// Returns all parameters, array by array.
    pub fn parameters(&self) -> Vec<f64> {
        let mut all = Vec::new();
        all.extend(self.position);
        all.extend(self.scale);
        all.extend(self.quaternion);
        all.push(self.opacity);
        all.extend(self.sh.as_flattened());
        all.extend(&self.features);
        all
    }

    /// Returns a Gaussian of the same shape with other parameters.
    pub fn with_parameters(&self, all: &[f64]) -> Self {
        let sh = self.sh.len() * 3;
        Self {
            position: [all[0], all[1], all[2]],
            scale: [all[3], all[4], all[5]],
            quaternion: [all[6], all[7], all[8], all[9]],
            opacity: all[10],
            sh: all[11..11 + sh].as_chunks().0.to_vec(),
            features: all[11 + sh..].to_vec(),
        }
    }

    /// Returns the Gaussian rounded to f32: the reference must have the same inputs as the kernels.
    pub fn rounded(&self) -> Self {
        let rounded: Vec<f64> = self
            .parameters()
            .iter()
            .map(|&value| f64::from(value as f32))
            .collect();
        self.with_parameters(&rounded)
    }
}

/// Converts Gaussians for the kernels; quaternions are normalized.
pub fn instant(gaussians: &[Gaussian]) -> ActivatedGaussians {
    let degree = (0..=MAX_SH_DEGREE)
        .find(|&degree| sh_rest_count(degree) + 1 == gaussians[0].sh.len())
        .unwrap_or(MAX_SH_DEGREE);
    let narrow = |values: &[f64; 3]| values.map(|value| value as f32);
    ActivatedGaussians {
        positions: gaussians.iter().map(|g| narrow(&g.position)).collect(),
        scales: gaussians.iter().map(|g| narrow(&g.scale)).collect(),
        rotations: gaussians
            .iter()
            .map(|g| {
                let length = g.quaternion.iter().map(|q| q * q).sum::<f64>().sqrt();
                g.quaternion.map(|q| (q / length) as f32)
            })
            .collect(),
        opacities: gaussians.iter().map(|g| g.opacity as f32).collect(),
        sh_constant: gaussians.iter().map(|g| narrow(&g.sh[0])).collect(),
        sh_degree: degree,
        sh_rest: gaussians
            .iter()
            .flat_map(|g| g.sh[1..].iter().map(narrow))
            .collect(),
        feature_count: gaussians[0].features.len(),
        features: gaussians
            .iter()
            .flat_map(|g| g.features.iter().map(|&value| value as f32))
            .collect(),
    }
}

/// A view and its settings in f64, rounded as the kernels' are.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RefView {
    /// Image size and model.
    pub camera: Camera,
    /// World-to-camera rotation.
    pub rotation: DMat3,
    /// Camera centre in normalized world units.
    pub centre: DVec3,
    /// Render settings.
    pub settings: RenderSettings,
}

impl RefView {
    /// Creates a view with rotation and centre rounded to f32.
    pub fn new(
        camera: impl Into<Camera>,
        rotation: DQuat,
        centre: DVec3,
        settings: RenderSettings,
    ) -> Self {
        Self {
            camera: camera.into(),
            rotation: DMat3::from_quat(rotation).as_mat3().as_dmat3(),
            centre: centre.as_vec3().as_dvec3(),
            settings,
        }
    }

    /// Converts the view for the kernels.
    pub fn view(&self) -> View {
        View {
            camera: self.camera,
            rotation: self.rotation.as_mat3(),
            centre: self.centre.as_vec3(),
            time_seconds: 0.0,
        }
    }
}

/// Discrete decisions of a render: shapes, order, and the Gaussians that contribute to each pixel. Finite
/// differences keep them fixed, because the definition jumps where they change.
#[derive(Debug, Clone)]
pub struct Decisions {
    /// Indices of the Gaussians that are drawn, from near to far.
    pub order: Vec<usize>,
    /// Per Gaussian, true if its footprint is a cone.
    pub is_cone: Vec<bool>,
    /// Per pixel and entry of `order`, true if the Gaussian contributes.
    pub contributes: Vec<bool>,
    /// Per pixel and entry of `order`, the excess of the opacity over its clamp. The gradient ignores the
    /// clamp; differences therefore keep the excess fixed.
    pub excess: Vec<f64>,
}

/// A rendered view.
#[derive(Debug, Clone)]
pub struct Image {
    /// Colour, HWC.
    pub colour: Vec<f64>,
    /// Feature planes, one after another.
    pub features: Vec<f64>,
}

enum Shape {
    /// Centre and inverse covariance, pixels.
    Ellipse(DVec2, DMat2),
    /// Direction, tangent directions and inverse covariance, radians.
    Flat(DVec3, [DVec3; 2], DMat2),
    /// Centre in the camera frame and inverse covariance.
    Ray(DVec3, DMat3),
}

struct Footprint64 {
    shape: Shape,
    distance: f64,
    colour: [f64; 3],
}

fn erp_jacobian(width: u32, height: u32, p: DVec3) -> [DVec3; 2] {
    let (kx, ky) = (f64::from(width) / TAU, f64::from(height) / PI);
    let (d2, rho) = (p.length_squared(), p.x.hypot(p.z));
    [
        dvec3(p.z, 0.0, -p.x) * (kx / (rho * rho)),
        dvec3(-p.x * p.y / rho, rho, -p.y * p.z / rho) * (ky / d2),
    ]
}

fn pinhole_jacobian(camera: &omnilife_schemas::camera::PinholeCamera, p: DVec3) -> [DVec3; 2] {
    let slope = |slope: f64, size: u32, focal: f64, centre: f64| {
        let (size, margin) = (f64::from(size), 0.15 * f64::from(size));
        slope.clamp((-margin - centre) / focal, (size + margin - centre) / focal)
    };
    let x = slope(p.x / p.z, camera.width, camera.fx, camera.cx);
    let y = slope(p.y / p.z, camera.height, camera.fy, camera.cy);
    [
        dvec3(camera.fx, 0.0, -camera.fx * x) / p.z,
        dvec3(0.0, camera.fy, -camera.fy * y) / p.z,
    ]
}

fn shape(
    view: &RefView,
    p: DVec3,
    covariance: DMat3,
    largest: f64,
    is_cone: Option<bool>,
) -> Option<(Shape, bool)> {
    let d = p.length();
    let low_pass_angle = 0.3
        * match &view.camera {
            Camera::Erp(camera) => (PI / f64::from(camera.height)).powi(2),
            Camera::Pinhole(camera) => 1.0 / (camera.fx * camera.fy),
        };
    if view.settings.footprint == Footprint::Ray {
        let widened = covariance + DMat3::from_diagonal(DVec3::splat(low_pass_angle * d * d));
        return Some((Shape::Ray(p, widened.inverse()), true));
    }
    if largest >= d && is_cone.is_none() {
        return None;
    }
    let jacobian = match &view.camera {
        Camera::Erp(camera) => erp_jacobian(camera.width, camera.height, p),
        Camera::Pinhole(camera) => pinhole_jacobian(camera, p),
    };
    let image = jacobian.map(|row| jacobian.map(|other| row.dot(covariance * other)));
    let image = DMat2::from_cols_array_2d(&image) + DMat2::from_diagonal(DVec2::splat(0.3));
    let is_cone = is_cone.unwrap_or_else(|| match &view.camera {
        Camera::Erp(camera) => {
            p.x.hypot(p.z) < 85.0_f64.to_radians().cos() * d
                || image.x_axis.x.sqrt() > f64::from(camera.width) / 24.0
        }
        Camera::Pinhole(_) => false,
    });
    if !is_cone {
        return Some((
            Shape::Ellipse(view.camera.project(p)?, image.inverse()),
            false,
        ));
    }
    let n = p / d;
    let east = if n.x.hypot(n.z) > 0.0 {
        dvec3(n.z, 0.0, -n.x).normalize()
    } else {
        DVec3::X
    };
    let frame = [east, n.cross(east)];
    let angles = frame.map(|row| frame.map(|other| row.dot(covariance * other) / (d * d)));
    let angles =
        DMat2::from_cols_array_2d(&angles) + DMat2::from_diagonal(DVec2::splat(low_pass_angle));
    Some((Shape::Flat(n, frame, angles.inverse()), true))
}

fn harmonics(degree: usize, direction: DVec3) -> Vec<f64> {
    let [x, y, z] = direction.to_array();
    let all = [
        0.282_094_791_773_878_14,
        -0.488_602_511_902_919_9 * y,
        0.488_602_511_902_919_9 * z,
        -0.488_602_511_902_919_9 * x,
        1.092_548_430_592_079_2 * x * y,
        -1.092_548_430_592_079_2 * y * z,
        0.315_391_565_252_520_05 * (2.0 * z * z - x * x - y * y),
        -1.092_548_430_592_079_2 * x * z,
        0.546_274_215_296_039_6 * (x * x - y * y),
        -0.590_043_589_926_643_5 * y * (3.0 * x * x - y * y),
        2.890_611_442_640_554 * x * y * z,
        -0.457_045_799_464_465_8 * y * (4.0 * z * z - x * x - y * y),
        0.373_176_332_590_115_4 * z * (2.0 * z * z - 3.0 * x * x - 3.0 * y * y),
        -0.457_045_799_464_465_8 * x * (4.0 * z * z - x * x - y * y),
        1.445_305_721_320_277 * z * (x * x - y * y),
        -0.590_043_589_926_643_5 * x * (x * x - 3.0 * y * y),
    ];
    all[..(degree + 1) * (degree + 1)].to_vec()
}

fn footprint(
    view: &RefView,
    gaussian: &Gaussian,
    is_cone: Option<bool>,
) -> Option<(Footprint64, bool)> {
    let offset = DVec3::from_array(gaussian.position) - view.centre;
    let p = view.rotation * offset;
    let distance = p.length();
    let near = f64::from(view.settings.near);
    let is_near = distance <= near || (matches!(view.camera, Camera::Pinhole(_)) && p.z <= near);
    // The decision is given: a finite difference must not cross the limit.
    if is_near && is_cone.is_none() {
        return None;
    }
    let largest = gaussian.scale.iter().copied().fold(0.0, f64::max);
    let [w, x, y, z] = gaussian.quaternion;
    let quaternion = DQuat::from_xyzw(x, y, z, w);
    let rotation = if quaternion.length() > 0.0 {
        DMat3::from_quat(quaternion.normalize())
    } else {
        DMat3::IDENTITY
    };
    let axes = view.rotation * rotation * DMat3::from_diagonal(DVec3::from_array(gaussian.scale));
    let (shape, is_cone) = shape(view, p, axes * axes.transpose(), largest, is_cone)?;
    let stored = (1..=4)
        .find(|n| n * n == gaussian.sh.len())
        .map_or(0, |n| n - 1);
    let values = harmonics(stored.min(view.settings.sh_degree), offset / distance);
    let colour = std::array::from_fn(|channel| {
        let sum: f64 = values
            .iter()
            .zip(&gaussian.sh)
            .map(|(value, coefficient)| value * coefficient[channel])
            .sum();
        (0.5 + sum).max(0.0)
    });
    let footprint = Footprint64 {
        shape,
        distance,
        colour,
    };
    Some((footprint, is_cone))
}

/// Returns the exponent `q` of the falloff in a pixel; infinite behind the camera.
fn exponent(view: &RefView, shape: &Shape, pixel: DVec2) -> f64 {
    match shape {
        Shape::Ellipse(centre, inverse) => {
            let mut offset = pixel - *centre;
            if let Camera::Erp(camera) = &view.camera {
                offset.x = camera.wrapped_column_distance(centre.x, pixel.x);
            }
            offset.dot(*inverse * offset)
        }
        Shape::Flat(n, frame, inverse) => {
            let ray = view.camera.unproject(pixel);
            let along = ray.dot(*n);
            if along <= 0.0 {
                return f64::INFINITY;
            }
            let offset = dvec2(ray.dot(frame[0]), ray.dot(frame[1])) / along;
            offset.dot(*inverse * offset)
        }
        Shape::Ray(centre, inverse) => {
            let ray = view.camera.unproject(pixel);
            let nearest = (ray.dot(*inverse * *centre) / ray.dot(*inverse * ray)).max(0.0);
            let offset = ray * nearest - *centre;
            offset.dot(*inverse * offset)
        }
    }
}

/// Renders a view. `decisions`, if given, are used in place of new ones.
pub fn render(
    view: &RefView,
    gaussians: &[Gaussian],
    decisions: Option<&Decisions>,
) -> (Image, Decisions) {
    let footprints: Vec<Option<(Footprint64, bool)>> = gaussians
        .iter()
        .enumerate()
        .map(|(index, gaussian)| {
            footprint(
                view,
                gaussian,
                decisions.map(|decisions| decisions.is_cone[index]),
            )
        })
        .collect();
    let order = decisions.map_or_else(
        || {
            let mut order: Vec<usize> = (0..gaussians.len())
                .filter(|&index| footprints[index].is_some())
                .collect();
            let distance = |index: usize| footprints[index].as_ref().map_or(0.0, |f| f.0.distance);
            order.sort_by(|&a, &b| distance(a).total_cmp(&distance(b)));
            order
        },
        |decisions| decisions.order.clone(),
    );
    let (width, height) = (view.camera.width() as usize, view.camera.height() as usize);
    let feature_count = gaussians
        .first()
        .map_or(0, |gaussian| gaussian.features.len());
    let mut image = Image {
        colour: vec![0.0; width * height * 3],
        features: vec![0.0; width * height * feature_count],
    };
    let mut contributes = vec![false; width * height * order.len()];
    let mut excess = vec![0.0; width * height * order.len()];
    for pixel in 0..width * height {
        let place = dvec2((pixel % width) as f64 + 0.5, (pixel / width) as f64 + 0.5);
        let mut transmittance = 1.0;
        for (rank, &index) in order.iter().enumerate() {
            let slot = pixel * order.len() + rank;
            if decisions.is_some_and(|decisions| !decisions.contributes[slot]) {
                continue;
            }
            let Some((footprint, _)) = &footprints[index] else {
                continue;
            };
            let q = exponent(view, &footprint.shape, place);
            let unclamped = gaussians[index].opacity * (-0.5 * q).exp();
            let above = decisions.map_or((unclamped - 0.99).max(0.0), |d| d.excess[slot]);
            let alpha = unclamped - above;
            if decisions.is_none() {
                if alpha < 1.0 / 255.0 {
                    continue;
                }
                if transmittance * (1.0 - alpha) < 1e-4 {
                    break;
                }
            }
            contributes[slot] = true;
            excess[slot] = above;
            let weight = transmittance * alpha;
            for channel in 0..3 {
                image.colour[pixel * 3 + channel] += weight * footprint.colour[channel];
            }
            for (feature, value) in gaussians[index].features.iter().enumerate() {
                image.features[feature * width * height + pixel] += weight * value;
            }
            transmittance *= 1.0 - alpha;
        }
        for channel in 0..3 {
            image.colour[pixel * 3 + channel] +=
                transmittance * f64::from(view.settings.background[channel]);
        }
    }
    let is_cone = footprints
        .iter()
        .map(|footprint| footprint.as_ref().is_some_and(|(_, is_cone)| *is_cone))
        .collect();
    let decisions = Decisions {
        order,
        is_cone,
        contributes,
        excess,
    };
    (image, decisions)
}

/// Returns central differences of `loss` by every parameter of every Gaussian, with the decisions of the
/// unchanged render: `[gaussian][parameter]` in the order of [`Gaussian::parameters`].
pub fn gradients(
    view: &RefView,
    gaussians: &[Gaussian],
    loss: impl Fn(&Image) -> f64,
) -> Vec<Vec<f64>> {
    const STEP: f64 = 1e-5;
    let (_, decisions) = render(view, gaussians, None);
    let mut changed = gaussians.to_vec();
    gaussians
        .iter()
        .enumerate()
        .map(|(index, gaussian)| {
            let parameters = gaussian.parameters();
            (0..parameters.len())
                .map(|parameter| {
                    let mut shifted = |step: f64| {
                        let mut all = parameters.clone();
                        all[parameter] += step;
                        changed[index] = gaussian.with_parameters(&all);
                        let (image, _) = render(view, &changed, Some(&decisions));
                        changed[index] = gaussian.clone();
                        loss(&image)
                    };
                    (shifted(STEP) - shifted(-STEP)) / (2.0 * STEP)
                })
                .collect()
        })
        .collect()
}
