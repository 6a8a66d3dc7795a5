//! The projection on the processor.

use glam::{Vec2, Vec3, vec3};
use rayon::prelude::*;

use super::{Culling, Splat, SplatGradient, axes};
use crate::{
    camera::{View, erp},
    gaussians::{InstantGaussians, SH_C0},
    kernels::{ALPHA_MIN, LOW_PASS},
};

/// Gaussians per parallel piece of work.
const BATCH: usize = 1024;

/// Projects all Gaussians; `splats` receives the visible ones in order of their index.
pub fn forward(
    view: &View,
    gaussians: &InstantGaussians,
    culling: &Culling,
    splats: &mut Vec<Splat>,
) {
    let batches: Vec<Vec<Splat>> = (0..gaussians.len().div_ceil(BATCH))
        .into_par_iter()
        .map(|batch| {
            (batch * BATCH..((batch + 1) * BATCH).min(gaussians.len()))
                .filter_map(|index| project_one(view, gaussians, culling, index))
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
    projection: erp::Projection,
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
        culling: &Culling,
        index: usize,
    ) -> Option<Self> {
        let centre = Vec3::from_array(gaussians.positions[index]);
        let scale = gaussians.scales[index];
        let point = view.rotation * (centre - view.centre);
        let distance = point.length();
        let largest = scale[0].max(scale[1]).max(scale[2]);
        // Written so that NaN culls; what `max` hides of it is caught with the determinant.
        let visible = distance > culling.near && distance < f32::MAX && largest < distance;
        if !visible {
            return None;
        }
        let projection = erp::project(&view.camera, point, distance);
        let world_from_camera = view.rotation.transpose();
        let to_u = world_from_camera * projection.jacobian_u;
        let to_v = world_from_camera * projection.jacobian_v;
        let axes = axes(gaussians.rotations[index], scale);
        Some(Self {
            point,
            projection,
            to_u,
            to_v,
            axes,
            v_u: vec3(to_u.dot(axes[0]), to_u.dot(axes[1]), to_u.dot(axes[2])),
            v_v: vec3(to_v.dot(axes[0]), to_v.dot(axes[1]), to_v.dot(axes[2])),
        })
    }
}

fn project_one(
    view: &View,
    gaussians: &InstantGaussians,
    culling: &Culling,
    index: usize,
) -> Option<Splat> {
    let opacity = gaussians.opacities[index];
    // Written so that NaN is left out.
    let is_seen = opacity >= ALPHA_MIN;
    if !is_seen {
        return None;
    }
    let linear = Linearization::new(view, gaussians, culling, index)?;
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
    let height = view.camera.height as f32;
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
        colour: gaussians.sh[index].map(|coefficient| (0.5 + SH_C0 * coefficient).max(0.0)),
        distance: linear.projection.distance,
        gaussian: index as u32,
    })
}

/// VJP of [`forward`]: writes the gradients of the visible Gaussians into `out`, which must be zero
/// and of the Gaussians' length. `gradients` has one entry per splat.
pub fn backward(
    view: &View,
    gaussians: &InstantGaussians,
    culling: &Culling,
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
                .map(|(splat, gradient)| backward_one(view, gaussians, culling, splat, gradient))
                .collect()
        })
        .collect();
    for (splat, one) in splats.iter().zip(pieces.into_iter().flatten()) {
        let index = splat.gaussian as usize;
        out.positions[index] = one.position.to_array();
        out.scales[index] = one.scale;
        out.rotations[index] = one.rotation;
        out.opacities[index] = one.opacity;
        out.sh[index] = one.sh;
    }
}

#[derive(Default)]
struct OneGradient {
    position: Vec3,
    scale: [f32; 3],
    rotation: [f32; 4],
    opacity: f32,
    sh: [f32; 3],
}

fn backward_one(
    view: &View,
    gaussians: &InstantGaussians,
    culling: &Culling,
    splat: &Splat,
    gradient: &SplatGradient,
) -> OneGradient {
    let index = splat.gaussian as usize;
    let Some(linear) = Linearization::new(view, gaussians, culling, index) else {
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
    let d_point = erp::project_vjp(
        &view.camera,
        linear.point,
        linear.projection.distance,
        Vec2::from_array(gradient.centre),
        view.rotation * to_u,
        view.rotation * to_v,
    );
    let (scale, rotation) = axes_vjp(gaussians.rotations[index], gaussians.scales[index], &d_axes);
    // The clamp of the colour at 0 stops the gradient.
    let sh = std::array::from_fn(|channel| {
        if splat.colour[channel] > 0.0 {
            SH_C0 * gradient.colour[channel]
        } else {
            0.0
        }
    });
    OneGradient {
        position: view.rotation.transpose() * d_point,
        scale,
        rotation,
        opacity: gradient.opacity,
        sh,
    }
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
