//! An image of 4096 x 2048 pixels: columns and rows that f32 holds to a two-thousandth of a pixel.

use glam::dvec3;
use omnilife_engine::{
    gaussians::ActivatedGaussians,
    render::reference::{self, Gaussian},
};
use omnilife_schemas::camera::ErpCamera;

use crate::{
    channels::{self, Shape},
    devices::Device,
    special::{CaseResult, Runs, SpecialCase},
};

pub(super) const CASES: &[SpecialCase] = &[SpecialCase {
    id: "size-4096",
    title: "an image of 4096 x 2048 pixels with Gaussians on the equator, the seam and a pole, and a thin one",
    runs: Runs::OnBoth,
    judge,
}];

/// Limits of the mean difference of a colour value, and of the derivative along one direction.
const LIMITS: [f64; 2] = [3e-8, 8e-6];

fn shapes() -> Vec<Shape> {
    vec![
        (dvec3(0.1, 0.05, 1.0), 2.0, [0.2, 0.3, 0.25], 0.6),
        (dvec3(0.02, -0.3, -1.0), 3.0, [0.3, 0.2, 0.2], 0.7),
        (dvec3(0.05, -1.0, 0.1), 2.5, [0.2, 0.3, 0.2], 0.5),
        (dvec3(1.0, 0.4, 0.3), 2.0, [0.3, 0.005, 0.02], 0.8),
    ]
}

/// Returns the activated Gaussians moved along a direction of positions, sizes and opacities.
fn moved(gaussians: &[Gaussian], step: f64) -> Vec<Gaussian> {
    let along = |place: usize| step * (1.7 * place as f64 + 0.3).sin();
    let move_one = |(index, gaussian): (usize, &Gaussian)| {
        let mut moved = gaussian.clone();
        for axis in 0..3 {
            moved.position[axis] += along(7 * index + axis);
            moved.scale[axis] *= 1.0 + along(7 * index + 3 + axis);
        }
        moved.opacity *= 1.0 + 0.1 * along(7 * index + 6);
        moved
    };
    gaussians.iter().enumerate().map(move_one).collect()
}

/// Returns the derivative of [`moved`] weighted by a gradient.
fn along(gaussians: &[Gaussian], gradient: &ActivatedGaussians) -> f64 {
    const STEP: f64 = 1e-3;
    let [before, after] = [-STEP, STEP].map(|step| moved(gaussians, step));
    let mut sum = 0.0;
    for (index, (before, after)) in before.iter().zip(&after).enumerate() {
        let change = |before: f64, after: f64| (after - before) / (2.0 * STEP);
        for axis in 0..3 {
            let by_place = f64::from(gradient.positions[index][axis]);
            sum += by_place * change(before.position[axis], after.position[axis]);
            let by_scale = f64::from(gradient.scales[index][axis]);
            sum += by_scale * change(before.scale[axis], after.scale[axis]);
        }
        sum += f64::from(gradient.opacities[index]) * change(before.opacity, after.opacity);
    }
    sum
}

fn judge(device: &Device) -> CaseResult {
    let (mut view, gaussians) = channels::setup_of(shapes());
    let camera = ErpCamera {
        width: 4096,
        height: 2048,
    };
    view.camera = camera.into();
    let values = 3 * camera.width as usize * camera.height as usize;
    let weights = Device::weights(values);
    let (drawn, instant) = (view.view(), reference::instant(&gaussians));
    let weighted: [&[f32]; 2] = [&weights, &[]];
    let made = match device.round_trip_activated(&drawn, view.settings, &instant, weighted) {
        Ok(made) => made,
        Err(error) => return CaseResult::failed(error),
    };
    let (expected, decisions) = reference::render(&view, &gaussians, None);
    let differences = made.colour.iter().zip(&expected.colour);
    let differences = differences.map(|(&found, expected)| (f64::from(found) - expected).abs());
    let image = differences.sum::<f64>() / values as f64;
    let loss = |step: f64| -> f64 {
        let (image, _) = reference::render(&view, &moved(&gaussians, step), Some(&decisions));
        let pairs = image.colour.iter().zip(&weights);
        pairs
            .map(|(value, &weight)| value * f64::from(weight))
            .sum()
    };
    let by_direction = (loss(1e-5) - loss(-1e-5)) / 2e-5;
    let error = (along(&gaussians, &made.gradient) / by_direction - 1.0).abs();
    CaseResult::of_errors(
        "the mean of the image, and the derivative along one direction, against f64",
        Some([image, device.limit(LIMITS[0])]),
        Some([error, device.limit(LIMITS[1])]),
    )
}
