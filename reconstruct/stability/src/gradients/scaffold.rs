//! Gradient of the loss on a scaffold.

use glam::{DVec3, Mat3, Vec3, vec3};
use omnilife_engine::{
    camera::View,
    losses::scaffold::{Scaffold, fuse::FusedView},
};
use omnilife_schemas::{camera::ErpCamera, distances::DistanceImage};

use super::{difference, relative_error};
use crate::{devices::Device, special::CaseResult};

const SIZE: [usize; 2] = [64, 32];
const VOXEL: f64 = 0.1;
/// Part of a voxel within which the loss is quadratic.
const HUBER_VOXELS: f64 = 0.5;

/// Returns the field of a sphere of radius 1 with a bump, seen from its middle.
fn field() -> Scaffold {
    let [width, height] = SIZE;
    let distance = |at: usize| 1.0 + 0.1 * (0.3 * (at % width) as f32).sin();
    let distances = DistanceImage {
        width,
        height,
        wraps: true,
        values: (0..width * height).map(distance).collect(),
    };
    let view = View {
        camera: ErpCamera {
            width: width as u32,
            height: height as u32,
        }
        .into(),
        rotation: Mat3::IDENTITY,
        centre: Vec3::ZERO,
        time_seconds: 0.0,
    };
    let incidence = vec![0.9; width * height];
    let fused = FusedView {
        view: &view,
        distances: &distances,
        incidence: &incidence,
    };
    Scaffold::fuse(&[fused], VOXEL as f32, Vec3::ZERO)
}

/// Returns the loss of a centre by the definition in f64: Huber of the field between eight voxels, whose values the
/// field has at their middles.
fn loss(field: &Scaffold, base: DVec3, centre: DVec3) -> Option<f64> {
    let fraction = centre / VOXEL - 0.5 - base;
    let mut distance = 0.0;
    for number in 0..8_i32 {
        let upper = [number & 1, number >> 1 & 1, number >> 2];
        let corner = base + DVec3::from_array(upper.map(f64::from));
        let value = field.value(((corner + 0.5) * VOXEL).as_vec3())?;
        let weights = (0..3).map(|axis| {
            if upper[axis] == 1 {
                fraction[axis]
            } else {
                1.0 - fraction[axis]
            }
        });
        distance += f64::from(value.distance) * weights.product::<f64>();
    }
    let width = HUBER_VOXELS * VOXEL;
    Some(if distance.abs() <= width {
        0.5 * distance * distance / width
    } else {
        distance.abs() - 0.5 * width
    })
}

/// Judges directions and ratios of the gradients: the loss's weight is a common factor.
pub(super) fn judge(device: &Device) -> CaseResult {
    let field = field();
    let mut centres = Vec::new();
    let mut expected = Vec::new();
    for index in 0..200 {
        let angle = 2.399_963 * index as f32;
        let ray = vec3(angle.sin(), 0.6 * (0.7 * angle).cos(), angle.cos()).normalize();
        let centre = ray * (0.9 + 0.3 * (1.7 * index as f32).sin().abs());
        let place = centre.as_dvec3();
        let scaled = place / VOXEL - 0.5;
        let base = scaled.floor();
        // Steps stay within the cell.
        let is_inside =
            (scaled - base).min_element() > 0.01 && (scaled - base).max_element() < 0.99;
        let value = |along: DVec3, shift: f64| loss(&field, base, place + shift * along);
        if !is_inside || value(DVec3::ZERO, 0.0).is_none() {
            continue;
        }
        let by_axis = DVec3::AXES.map(|along| {
            difference(
                |shift| value(along, shift).unwrap_or(f64::NAN),
                1e-4 * VOXEL,
            )
        });
        centres.push(centre.to_array());
        expected.extend(by_axis);
    }
    if centres.len() < 50 {
        return CaseResult::failed(format!("{} of 200 places have a value", centres.len()));
    }
    let gradient = match device.scaffold_gradient(&field, &centres) {
        Ok(gradient) => gradient,
        Err(error) => return CaseResult::failed(error),
    };
    let found: Vec<f64> = gradient.into_iter().map(f64::from).collect();
    let length = |values: &[f64]| values.iter().map(|value| value * value).sum::<f64>().sqrt();
    let factor = length(&expected) / length(&found);
    let pairs: Vec<[f64; 2]> = found
        .iter()
        .zip(&expected)
        .map(|(found, expected)| [factor * found, *expected])
        .collect();
    CaseResult::of_errors(
        "compared with differences of the definition in f64, up to the weight",
        None,
        Some([relative_error(&pairs), device.limit(2e-5)]),
    )
}
