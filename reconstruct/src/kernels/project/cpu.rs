//! The projection on the processor.

use glam::{Vec2, Vec3, vec3};
use rayon::prelude::*;

use super::{Splat, SplatGradient, axes, sh};
use crate::{
    camera::{Projection, View},
    gaussians::{InstantGaussians, SH_C0, sh_rest_count},
    kernels::{ALPHA_MIN, LOW_PASS, RenderSettings},
};

/// Gaussians per parallel piece of work.
const BATCH: usize = 1024;

/// Projects all Gaussians; `splats` receives the visible ones in order of their index.
pub fn forward(
    view: &View,
    gaussians: &InstantGaussians,
    settings: &RenderSettings,
    splats: &mut Vec<Splat>,
) {
    let batches: Vec<Vec<Splat>> = (0..gaussians.len().div_ceil(BATCH))
        .into_par_iter()
        .map(|batch| {
            (batch * BATCH..((batch + 1) * BATCH).min(gaussians.len()))
                .filter_map(|index| project_one(view, gaussians, settings, index))
                .collect()
        })
        .collect();
    splats.clear();
    splats.extend(batches.into_iter().flatten());
}

/// The intermediate values that forward and backward share.
struct Linearization {
    /// Centre in the camera frame.
    point: Vec3,
    distance: f32,
    projection: Projection,
    /// Rows of `J W`, in world coordinates.
    to_u: Vec3,
    to_v: Vec3,
    axes: [Vec3; 3],
    /// Rows of `V = J W M`.
    v_u: Vec3,
    v_v: Vec3,
}

impl Linearization {
    fn new(
        view: &View,
        gaussians: &InstantGaussians,
        settings: &RenderSettings,
        index: usize,
    ) -> Option<Self> {
        let centre = Vec3::from_array(gaussians.positions[index]);
        let scale = gaussians.scales[index];
        let point = view.rotation * (centre - view.centre);
        let distance = point.length();
        let largest = scale[0].max(scale[1]).max(scale[2]);
        // Written so that NaN culls; what `max` hides of it is caught with the determinant.
        let visible = view.camera.sees(point, distance, settings.near) && largest < distance;
        if !visible {
            return None;
        }
        let projection = view.camera.project(point, distance);
        let world_from_camera = view.rotation.transpose();
        let to_u = world_from_camera * projection.jacobian_u;
        let to_v = world_from_camera * projection.jacobian_v;
        let axes = axes(gaussians.rotations[index], scale);
        Some(Self {
            point,
            distance,
            projection,
            to_u,
            to_v,
            axes,
            v_u: vec3(to_u.dot(axes[0]), to_u.dot(axes[1]), to_u.dot(axes[2])),
            v_v: vec3(to_v.dot(axes[0]), to_v.dot(axes[1]), to_v.dot(axes[2])),
        })
    }

    /// Unit direction from the camera to the centre, in world coordinates.
    fn direction(&self, view: &View) -> Vec3 {
        view.rotation.transpose() * (self.point / self.distance)
    }
}

/// The degree of harmonics that is drawn.
fn degree(gaussians: &InstantGaussians, settings: &RenderSettings) -> usize {
    gaussians.sh_degree.min(settings.sh_degree)
}

/// Coefficients of one Gaussian beside the constant ones.
fn rest_of(gaussians: &InstantGaussians, index: usize) -> &[[f32; 3]] {
    let count = sh_rest_count(gaussians.sh_degree);
    &gaussians.sh_rest[index * count..(index + 1) * count]
}

fn project_one(
    view: &View,
    gaussians: &InstantGaussians,
    settings: &RenderSettings,
    index: usize,
) -> Option<Splat> {
    let opacity = gaussians.opacities[index];
    // Written so that NaN is left out.
    let is_seen = opacity >= ALPHA_MIN;
    if !is_seen {
        return None;
    }
    let linear = Linearization::new(view, gaussians, settings, index)?;
    let (uu, vv) = (linear.v_u.length_squared(), linear.v_v.length_squared());
    let covariance = [uu + LOW_PASS, linear.v_u.dot(linear.v_v), vv + LOW_PASS];
    let determinant =
        linear.v_u.cross(linear.v_v).length_squared() + LOW_PASS * (uu + vv) + LOW_PASS * LOW_PASS;
    let q_max = 2.0 * (opacity / ALPHA_MIN).ln();
    let extent = [
        (q_max * covariance[0]).sqrt(),
        (q_max * covariance[2]).sqrt(),
    ];
    let [x, y] = linear.projection.pixel.to_array();
    let usable = determinant.is_finite() && extent[0].is_finite() && extent[1].is_finite();
    let height = view.camera.height() as f32;
    if !usable || y + extent[1] < 0.5 || y - extent[1] > height - 0.5 {
        return None;
    }
    Some(Splat {
        centre: [x, y],
        conic: [
            covariance[2] / determinant,
            -covariance[1] / determinant,
            covariance[0] / determinant,
        ],
        covariance,
        extent,
        q_max,
        opacity,
        colour: sh::colour(
            degree(gaussians, settings),
            linear.direction(view),
            gaussians.sh_constant[index],
            rest_of(gaussians, index),
        ),
        distance: linear.distance,
        gaussian: index as u32,
    })
}

/// VJP of [`forward`]: writes the gradients of the visible Gaussians into `out`, which must be zero
/// and of the Gaussians' length. `gradients` has one entry per splat.
pub fn backward(
    view: &View,
    gaussians: &InstantGaussians,
    settings: &RenderSettings,
    splats: &[Splat],
    gradients: &[SplatGradient],
    out: &mut InstantGaussians,
) {
    let pieces: Vec<Vec<OneGradient>> = splats
        .par_chunks(BATCH)
        .zip(gradients.par_chunks(BATCH))
        .map(|(splats, gradients)| {
            splats
                .iter()
                .zip(gradients)
                .map(|(splat, gradient)| backward_one(view, gaussians, settings, splat, gradient))
                .collect()
        })
        .collect();
    for (splat, one) in splats.iter().zip(pieces.into_iter().flatten()) {
        let index = splat.gaussian as usize;
        out.positions[index] = one.position.to_array();
        out.scales[index] = one.scale;
        out.rotations[index] = one.rotation;
        out.opacities[index] = one.opacity;
        out.sh_constant[index] = one.colour.map(|gradient| SH_C0 * gradient);
        let degree = degree(gaussians, settings);
        if degree > 0 {
            let direction =
                (Vec3::from_array(gaussians.positions[index]) - view.centre).normalize();
            let count = sh_rest_count(gaussians.sh_degree);
            let rest = &mut out.sh_rest[index * count..];
            for (rest, value) in rest
                .iter_mut()
                .zip(&sh::basis(degree, direction)[..sh_rest_count(degree)])
            {
                *rest = one.colour.map(|gradient| gradient * value);
            }
        }
    }
}

#[derive(Default)]
struct OneGradient {
    position: Vec3,
    scale: [f32; 3],
    rotation: [f32; 4],
    opacity: f32,
    /// By the colour before the clamp.
    colour: [f32; 3],
}

fn backward_one(
    view: &View,
    gaussians: &InstantGaussians,
    settings: &RenderSettings,
    splat: &Splat,
    gradient: &SplatGradient,
) -> OneGradient {
    let index = splat.gaussian as usize;
    let Some(linear) = Linearization::new(view, gaussians, settings, index) else {
        // A splat exists only where the linearization does.
        return OneGradient::default();
    };
    // Conic to covariance: dSigma = -K dK K with K the conic, all symmetric.
    let [ka, kb, kc] = splat.conic;
    let (ga, gb, gc) = (
        gradient.conic[0],
        0.5 * gradient.conic[1],
        gradient.conic[2],
    );
    let (r00, r01) = (ka * ga + kb * gb, ka * gb + kb * gc);
    let (r10, r11) = (kb * ga + kc * gb, kb * gb + kc * gc);
    let s00 = -(r00 * ka + r01 * kb);
    let s01 = -(r00 * kb + r01 * kc);
    let s11 = -(r10 * kb + r11 * kc);
    // Sigma = V V^T + 0.3 I.
    let dv_u = 2.0 * (s00 * linear.v_u + s01 * linear.v_v);
    let dv_v = 2.0 * (s01 * linear.v_u + s11 * linear.v_v);
    // V = (J W) M.
    let mut to_u = Vec3::ZERO;
    let mut to_v = Vec3::ZERO;
    let mut d_axes = [Vec3::ZERO; 3];
    for k in 0..3 {
        to_u += dv_u[k] * linear.axes[k];
        to_v += dv_v[k] * linear.axes[k];
        d_axes[k] = dv_u[k] * linear.to_u + dv_v[k] * linear.to_v;
    }
    let d_point = view.camera.project_vjp(
        linear.point,
        linear.distance,
        Vec2::from_array(gradient.centre),
        view.rotation * to_u,
        view.rotation * to_v,
    );
    let (scale, rotation) = axes_vjp(gaussians.rotations[index], gaussians.scales[index], &d_axes);
    let (colour, direction) = harmonics_vjp(view, gaussians, settings, splat, gradient, &linear);
    OneGradient {
        position: view.rotation.transpose() * d_point + direction,
        scale,
        rotation,
        opacity: gradient.opacity,
        colour,
    }
}

/// The gradient by the unclamped colour, and what of it reaches the position through the direction.
fn harmonics_vjp(
    view: &View,
    gaussians: &InstantGaussians,
    settings: &RenderSettings,
    splat: &Splat,
    gradient: &SplatGradient,
    linear: &Linearization,
) -> ([f32; 3], Vec3) {
    // The clamp of the colour at 0 stops the gradient.
    let colour: [f32; 3] = std::array::from_fn(|channel| {
        if splat.colour[channel] > 0.0 {
            gradient.colour[channel]
        } else {
            0.0
        }
    });
    let degree = degree(gaussians, settings);
    if degree == 0 {
        return (colour, Vec3::ZERO);
    }
    let direction = linear.direction(view);
    let mut by_value = [0.0; 15];
    for (by_value, coefficient) in by_value[..sh_rest_count(degree)]
        .iter_mut()
        .zip(rest_of(gaussians, splat.gaussian as usize))
    {
        *by_value = (0..3)
            .map(|channel| colour[channel] * coefficient[channel])
            .sum();
    }
    let by_direction = sh::basis_vjp(degree, direction, &by_value);
    // d(p/|p|): remove the part along p, divide by the length.
    let along = by_direction.dot(direction);
    (colour, (by_direction - direction * along) / linear.distance)
}

/// VJP of [`axes`]: gradients by the scales and by the unit quaternion.
fn axes_vjp(rotation: [f32; 4], scale: [f32; 3], d_axes: &[Vec3; 3]) -> ([f32; 3], [f32; 4]) {
    let [w, x, y, z] = rotation;
    let unscaled = axes(rotation, [1.0; 3]);
    let d_scale = [
        d_axes[0].dot(unscaled[0]),
        d_axes[1].dot(unscaled[1]),
        d_axes[2].dot(unscaled[2]),
    ];
    let [c0, c1, c2] = [
        d_axes[0] * scale[0],
        d_axes[1] * scale[1],
        d_axes[2] * scale[2],
    ];
    let d_rotation = [
        2.0 * (z * (c0.y - c1.x) + y * (c2.x - c0.z) + x * (c1.z - c2.y)),
        2.0 * (y * (c0.y + c1.x) + z * (c0.z + c2.x) + w * (c1.z - c2.y) - 2.0 * x * (c1.y + c2.z)),
        2.0 * (x * (c0.y + c1.x) + z * (c1.z + c2.y) + w * (c2.x - c0.z) - 2.0 * y * (c0.x + c2.z)),
        2.0 * (x * (c0.z + c2.x) + y * (c1.z + c2.y) + w * (c0.y - c1.x) - 2.0 * z * (c0.x + c1.y)),
    ];
    (d_scale, d_rotation)
}
