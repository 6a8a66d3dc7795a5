//! Published projection and its defective gradient.

use std::f32::consts::{PI, TAU};

use glam::{Mat3, Vec3, vec3};
use omnilife_schemas::camera::ErpCamera;

use crate::{
    camera::{LOW_PASS, View},
    gaussians::{ActivatedGaussians, SH_C0},
    render::{
        Visible,
        project::{Ellipse, Shape, Splat, SplatGradient, axes, axes_vjp, largest_q},
        settings::{ALPHA_MIN, RenderSettings},
    },
};

/// Added to denominators upstream.
const EPSILON: f32 = 1e-7;

/// Values of a Gaussian shared by forward and backward.
struct Linearization {
    /// Centre in the camera frame.
    point: Vec3,
    distance: f32,
    rho: f32,
    latitude: f32,
    longitude: f32,
    /// Unit tangent vectors of growing longitude and falling latitude, in the world.
    tangents: [Vec3; 2],
    /// Pixels per unit along the tangents: the diagonal of `S`.
    stretch: [f32; 2],
    /// Axes times standard deviations, in the world.
    axes: [Vec3; 3],
}

impl Linearization {
    fn new(view: &View, camera: ErpCamera, gaussians: &ActivatedGaussians, index: usize) -> Self {
        let point = view.rotation * (Vec3::from_array(gaussians.positions[index]) - view.centre);
        let distance = point.length() + EPSILON;
        let rho = point.x.hypot(point.z) + EPSILON;
        let latitude = (-point.y).atan2(rho);
        let longitude = point.x.atan2(point.z);
        let (sin_lat, cos_lat) = latitude.sin_cos();
        let (sin_lon, cos_lon) = longitude.sin_cos();
        let world = view.rotation.transpose();
        Self {
            point,
            distance,
            rho,
            latitude,
            longitude,
            tangents: [
                world * vec3(cos_lon, 0.0, -sin_lon),
                world * vec3(sin_lat * sin_lon, cos_lat, sin_lat * cos_lon),
            ],
            stretch: [
                camera.width as f32 / (TAU * (cos_lat + EPSILON) * distance),
                camera.height as f32 / (PI * distance),
            ],
            axes: axes(gaussians.rotations[index], gaussians.scales[index]),
        }
    }

    /// Returns the rows of `M^T` times the tangents: the ellipsoid projected onto the tangent plane.
    fn tangent_rows(&self) -> [Vec3; 2] {
        self.tangents.map(|tangent| {
            vec3(
                tangent.dot(self.axes[0]),
                tangent.dot(self.axes[1]),
                tangent.dot(self.axes[2]),
            )
        })
    }
}

/// Returns the entries A, B, C of the projected covariance `[[A, B], [B, C]]`, square pixels.
fn covariance(linear: &Linearization) -> [f32; 3] {
    let [east, down] = linear.tangent_rows();
    let (v_u, v_v) = (east * linear.stretch[0], down * linear.stretch[1]);
    [
        v_u.length_squared() + LOW_PASS,
        v_u.dot(v_v),
        v_v.length_squared() + LOW_PASS,
    ]
}

/// Returns the splat of one Gaussian and its distance, if it is drawn.
pub(super) fn forward(
    view: &View,
    camera: ErpCamera,
    gaussians: &ActivatedGaussians,
    settings: &RenderSettings,
    index: usize,
) -> Option<(Splat, f32)> {
    let linear = Linearization::new(view, camera, gaussians, index);
    let opacity = gaussians.opacities[index];
    // NaN fails the comparison and is not drawn.
    let is_seen =
        linear.distance > settings.near && linear.distance < f32::MAX && opacity >= ALPHA_MIN;
    if !is_seen {
        return None;
    }
    let [a, b, c] = covariance(&linear);
    let determinant = a * c - b * b;
    let is_regular = determinant > 0.0 && determinant.is_finite();
    if !is_regular {
        return None;
    }
    let log2_opacity = opacity.log2();
    let q_max = largest_q(log2_opacity);
    // Pixel centres are at +1/2 in the other renderer, at the corners in this one.
    let centre = [
        (linear.longitude / PI + 1.0) * 0.5 * camera.width as f32 + 0.5,
        (0.5 - linear.latitude / PI) * camera.height as f32 + 0.5,
    ];
    let splat = Splat {
        centre,
        extent: [(q_max * a).sqrt(), (q_max * c).sqrt()],
        log2_opacity,
        colour: gaussians.sh_constant[index].map(|value| (0.5 + SH_C0 * value).max(0.0)),
        shape: Shape::Ellipse(Ellipse {
            variance: determinant / c,
            inverse_variance: c / determinant,
            slope: b / c,
            inverse_row_variance: 1.0 / c,
        }),
    };
    Some((splat, linear.distance))
}

/// Gradients by one activated Gaussian.
pub(super) struct RowGradient {
    pub(super) visible: Visible,
    pub(super) position: [f32; 3],
    pub(super) scale: [f32; 3],
    pub(super) rotation: [f32; 4],
    pub(super) opacity: f32,
    pub(super) sh_constant: [f32; 3],
}

/// Returns the published gradient of [`forward`], including its defects.
pub(super) fn backward(
    view: &View,
    camera: ErpCamera,
    gaussians: &ActivatedGaussians,
    splat: &Splat,
    gradient: &SplatGradient,
    index: usize,
) -> RowGradient {
    let linear = Linearization::new(view, camera, gaussians, index);
    let [by_u, by_v, ..] = gradient.ellipse;
    let [s_uu, s_uv, s_vv] = covariance_gradient(covariance(&linear), gradient);
    let [east, down] = linear.tangent_rows();

    // Covariance to ellipsoid: the published code uses the unit tangents in place of S times the tangents.
    let by_east = 2.0 * (s_uu * east + s_uv * down);
    let by_down = 2.0 * (s_uv * east + s_vv * down);
    let d_axes: [Vec3; 3] = std::array::from_fn(|axis| {
        by_east[axis] * linear.tangents[0] + by_down[axis] * linear.tangents[1]
    });
    let rotation = gaussians.rotations[index];
    let (scale, rotation) = axes_vjp(rotation, gaussians.scales[index], &d_axes);

    let position = position_gradient(view, camera, &linear, [by_u, by_v], [s_uu, s_uv, s_vv]);
    RowGradient {
        visible: Visible {
            gaussian: index,
            centre_gradient: [by_u, by_v],
        },
        position: (view.rotation.transpose() * position).to_array(),
        scale,
        rotation,
        opacity: gradient.log_opacity / gaussians.opacities[index],
        sh_constant: std::array::from_fn(|channel| {
            if splat.colour[channel] > 0.0 {
                SH_C0 * gradient.colour[channel]
            } else {
                0.0
            }
        }),
    }
}

/// Returns the entries uu, uv, vv of the gradient by the covariance `[[A, B], [B, C]]`, from the gradients by
/// `C / det`, `B / C` and `1 / C`.
fn covariance_gradient([a, b, c]: [f32; 3], gradient: &SplatGradient) -> [f32; 3] {
    let [_, _, by_inverse, by_slope, by_row] = gradient.ellipse;
    let determinant = a * c - b * b;
    let ratio = b / c;
    // d(C / det) = -(C / det)^2 (dA - 2 B/C dB + (B/C)^2 dC)
    let by_variance = -by_inverse * (c / determinant) * (c / determinant);
    [
        by_variance,
        -ratio * by_variance + 0.5 * by_slope / c,
        ratio * ratio * by_variance - by_slope * ratio / c - by_row / (c * c),
    ]
}

/// Returns the gradient by the centre in the camera frame: through its image, and through the Jacobian of the
/// covariance.
fn position_gradient(
    view: &View,
    camera: ErpCamera,
    linear: &Linearization,
    [by_u, by_v]: [f32; 2],
    [s_uu, s_uv, s_vv]: [f32; 3],
) -> Vec3 {
    let (width, height) = (camera.width as f32, camera.height as f32);
    let (kx, ky) = (width / TAU, height / PI);
    let (p, rho, d) = (linear.point, linear.rho, linear.distance);
    let (x, y, z, rho2, d2) = (p.x, p.y, p.z, rho * rho, d * d);
    let j_u = vec3(kx * z / rho2, 0.0, -kx * x / rho2);
    let j_v = vec3(
        -ky * x * y / (rho * d2),
        ky * rho / d2,
        -ky * y * z / (rho * d2),
    );
    // The image's gradient per normalized coordinate, times the Jacobian in pixels.
    let through_image = 0.5 * width * by_u * j_u + 0.5 * height * by_v * j_v;

    // Sigma = J A J^T with A the covariance in the camera frame: dL/dJ = 2 G J A.
    let axes = linear.axes.map(|axis| view.rotation * axis);
    let half = Mat3::from_cols(axes[0], axes[1], axes[2]);
    let covariance = half * half.transpose();
    let (a_u, a_v) = (covariance * j_u, covariance * j_v);
    let g_u = 2.0 * (s_uu * a_u + s_uv * a_v);
    let g_v = 2.0 * (s_uv * a_u + s_vv * a_v);
    let (rho3, rho4, d4) = (rho2 * rho, rho2 * rho2, d2 * d2);
    let level = (d2 - 2.0 * y * y) / (rho * d4);
    let mixed = ky * x * y * z * (2.0 * rho2 + d2) / (rho3 * d4);
    let d_u0 = vec3(
        -2.0 * kx * x * z / rho4,
        0.0,
        kx * (rho2 - 2.0 * z * z) / rho4,
    );
    let d_u2 = vec3(
        -kx * (rho2 - 2.0 * x * x) / rho4,
        0.0,
        // Defect: lacks the division by rho^4.
        2.0 * kx * x * z,
    );
    let d_v0 = vec3(
        -ky * y * (z * z * d2 - 2.0 * x * x * rho2) / (rho3 * d4),
        -ky * x * level,
        mixed,
    );
    let d_v1 = vec3(-ky * x * level, -2.0 * ky * y * rho / d4, -ky * z * level);
    let d_v2 = vec3(
        mixed,
        -ky * z * level,
        -ky * y * (x * x * d2 - 2.0 * z * z * rho2) / (rho3 * d4),
    );
    through_image + g_u.x * d_u0 + g_u.z * d_u2 + g_v.x * d_v0 + g_v.y * d_v1 + g_v.z * d_v2
}
