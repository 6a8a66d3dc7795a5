//! Gradient by a trained camera pose: a sum over Gaussians that may be far away, near, on the poles or thin. It
//! is judged by finite differences of the reference in f64.

use glam::{DMat3, DQuat, DVec3};
use omnilife_engine::render::reference::{self, Gaussian, RefView, instant};
use omnilife_schemas::records::StabilityMeasures;

use crate::{
    channels::{self, Shape},
    devices::Device,
    special::{CaseResult, Runs, SpecialCase},
};

/// Ten times the measured error, relative to a gradient's length.
const LIMIT: f64 = 6e-5;

pub(super) const CASES: &[SpecialCase] = &[
    SpecialCase {
        id: "pose-plain",
        title: "the gradient by a pose, for comparison",
        runs: Runs::OnBoth,
        judge: |device| judge(device, channels::around(), 1.0),
    },
    SpecialCase {
        id: "pose-poles",
        title: "the gradient by a pose from Gaussians on both poles",
        runs: Runs::OnBoth,
        judge: |device| judge(device, channels::at_the_poles(), 1.0),
    },
    SpecialCase {
        id: "pose-needles",
        title: "the gradient by a pose from needles a million times as long as thick",
        runs: Runs::OnBoth,
        judge: |device| judge(device, channels::needles(), 1.0),
    },
    SpecialCase {
        id: "pose-far",
        title: "the gradient by a pose from Gaussians at a hundred thousand radii",
        runs: Runs::OnBoth,
        judge: |device| judge(device, away(1e5), 1e5),
    },
    SpecialCase {
        id: "pose-near",
        title: "the gradient by a pose from Gaussians at a fiftieth of a radius",
        runs: Runs::OnBoth,
        judge: |device| judge(device, away(0.01), 0.01),
    },
    SpecialCase {
        id: "pose-layers",
        title: "the gradient by a pose from 300 translucent layers in one direction",
        runs: Runs::OnBoth,
        judge: |device| judge(device, channels::layers(), 1.0),
    },
];

/// Returns Gaussians around the camera, so many times as far and as large.
fn away(times: f64) -> Vec<Shape> {
    let shapes = channels::around().into_iter();
    shapes
        .map(|(direction, distance, scale, opacity)| {
            (
                direction,
                times * distance,
                scale.map(|axis| times * axis),
                opacity,
            )
        })
        .collect()
}

/// Returns the view after a rotation of the world about its centre and a shift.
fn moved(view: &RefView, rotation: DVec3, shift: DVec3) -> RefView {
    RefView {
        rotation: view.rotation * DMat3::from_quat(DQuat::from_scaled_axis(-rotation)),
        centre: view.centre + shift,
        ..*view
    }
}

/// Judges the gradient; `size` is about the distance of the Gaussians.
fn judge(device: &Device, shapes: Vec<Shape>, size: f64) -> CaseResult {
    let (view, gaussians) = channels::setup_of(shapes);
    let pixels = view.camera.width() as usize * view.camera.height() as usize;
    let weights = Device::weights(3 * pixels);
    let expected = by_differences(&view, &gaussians, &weights, size);

    let (drawn, instant) = (view.view(), instant(&gaussians));
    let found = match device.pose_gradient(&drawn, view.settings, &instant, &weights) {
        Ok(found) => found,
        Err(error) => return CaseResult::failed(error),
    };
    let limit = device.limit(LIMIT);
    let error = |found: DVec3, expected: DVec3| (found - expected).length() / expected.length();
    let errors = [
        error(found.rotation, expected[0]),
        error(found.centre, expected[1]),
    ];
    let worst = errors[0].max(errors[1]);
    let is_finite = found.rotation.is_finite() && found.centre.is_finite();
    // NaN fails too.
    let agrees = errors.iter().all(|&error| error <= limit);
    CaseResult {
        action: "turns and shifts, against differences in f64".to_owned(),
        fault: (!agrees).then(|| {
            format!(
                "the gradient by the turn is off by {:.1e}, by the place by {:.1e}, the limit is {limit:.0e}",
                errors[0], errors[1]
            )
        }),
        measured: Some(StabilityMeasures {
            forward_error: None,
            forward_share: None,
            forward_limit: None,
            gradient_error: worst.is_finite().then_some(worst),
            gradient_limit: Some(limit),
            is_finite,
            drawn: gaussians.len() as u64,
            gaussians: gaussians.len() as u64,
        }),
    }
}

/// Returns the differences by the rotation and by the position of the camera.
fn by_differences(
    view: &RefView,
    gaussians: &[Gaussian],
    weights: &[f32],
    size: f64,
) -> [DVec3; 2] {
    let (_, decisions) = reference::render(view, gaussians, None);
    let loss = |rotation: DVec3, shift: DVec3| -> f64 {
        let (image, _) =
            reference::render(&moved(view, rotation, shift), gaussians, Some(&decisions));
        let pairs = image.colour.iter().zip(weights);
        pairs
            .map(|(value, &weight)| value * f64::from(weight))
            .sum()
    };
    let difference = |of: &dyn Fn(DVec3) -> f64, step: f64| {
        let along = DVec3::AXES.map(|axis| (of(axis * step) - of(-axis * step)) / (2.0 * step));
        DVec3::from_array(along)
    };
    [
        difference(&|rotation| loss(rotation, DVec3::ZERO), 1e-6),
        difference(&|shift| loss(DVec3::ZERO, shift), 1e-6 * size),
    ]
}
