//! Cases of the photometric loss: images that are dark, flat, far too bright or nearly equal, and masks with
//! almost no weight. The kernel in f32 is judged by loops in f64. [`maps`] and [`motion`] have the cases of the
//! losses of dynamic scenes.

mod maps;
mod motion;

use omnilife_engine::losses::photometric::{Columns, cpu::Loss, reference::ReferencePair};
use omnilife_schemas::records::StabilityMeasures;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

use crate::{
    Limits,
    devices::{Device, DeviceKind},
    largest_or_nan,
    special::{CaseResult, HostOnly, Runs, SpecialCase},
};

/// Size with rows that end inside of a vector and of a strip.
const SIZE: [usize; 2] = [37, 19];
const LAMBDA: f32 = 0.2;

pub(super) fn all() -> impl Iterator<Item = &'static SpecialCase> {
    CASES.iter().chain(maps::CASES).chain(motion::CASES)
}

const CASES: &[SpecialCase] = &[
    SpecialCase {
        id: "loss-noise",
        title: "the loss of noise against noise, for comparison",
        runs: Runs::OnBoth,
        judge: |device| judge(device, &images(0.0, 1.0, 1.0), LIMITS),
    },
    SpecialCase {
        id: "loss-dark",
        title: "the loss of images of a thousandth of full brightness",
        runs: Runs::OnBoth,
        judge: |device| judge(device, &images(0.0, 1e-3, 1.0), LIMITS),
    },
    SpecialCase {
        id: "loss-flat",
        title: "the loss of white images with noise of a millionth",
        runs: Runs::OnBoth,
        judge: |device| judge(device, &images(1.0, 1e-6, 1.0), CANCELLING),
    },
    SpecialCase {
        id: "loss-checkerboard",
        title: "the loss of black and white squares of one pixel against their negative",
        runs: Runs::OnBoth,
        judge: |device| judge(device, &checkerboard(), LIMITS),
    },
    SpecialCase {
        id: "loss-almost-equal",
        title: "the loss of images that differ in the last bit of some values",
        runs: Runs::OnBoth,
        judge: |device| judge(device, &almost_equal(), LIMITS),
    },
    SpecialCase {
        id: "loss-light-mask",
        title: "the loss under a mask of one pixel with a weight of a millionth",
        runs: Runs::OnCpu(HostOnly::Bytes),
        judge: |device| judge(device, &light_mask(), LIMITS),
    },
    SpecialCase {
        id: "loss-bright",
        title: "the loss of a render ten times as bright as white",
        runs: Runs::OnBoth,
        judge: |device| judge(device, &images(10.0, 1.0, 1.0), CANCELLING),
    },
];

/// Ten times the measured errors.
const LIMITS: Limits = Limits {
    forward: 1e-7,
    gradient: 5e-6,
};
/// The same where variances are far smaller than the rounding of the squares whose difference they are.
const CANCELLING: Limits = Limits {
    forward: 1e-7,
    gradient: 1.5e-3,
};
/// Least limits on a GPU, which adds up in f32.
const IN_F32: Limits = Limits {
    forward: 3e-6,
    gradient: 5e-6,
};

/// A render, a target and a mask.
struct Images {
    render: Vec<f32>,
    target: Vec<f32>,
    mask: Vec<f32>,
}

/// Returns a render of a level with noise on it, and a target with other noise: of the same level, or white for
/// levels above white.
fn images(level: f32, noise: f32, weight: f32) -> Images {
    let mut random = Pcg64Mcg::seed_from_u64(8);
    let [width, height] = SIZE;
    // No more values than the bytes of a device's images.
    let mut image = |level: f32| -> Vec<f32> {
        (0..3 * width * height)
            .map(|_| level + noise * f32::from(random.random_range(0..=127_u8)) / 127.0)
            .collect()
    };
    Images {
        render: image(level),
        target: image(level.min(1.0)),
        mask: vec![weight; width * height],
    }
}

fn checkerboard() -> Images {
    let [width, height] = SIZE;
    let square = |index: usize| {
        let pixel = index / 3;
        ((pixel % width + pixel / width) % 2) as f32
    };
    let values = 3 * width * height;
    Images {
        render: (0..values).map(square).collect(),
        target: (0..values).map(|index| 1.0 - square(index)).collect(),
        mask: vec![1.0; width * height],
    }
}

fn almost_equal() -> Images {
    let mut images = images(0.0, 1.0, 1.0);
    images.target.clone_from(&images.render);
    for value in images.target.iter_mut().step_by(5) {
        *value = value.next_up();
    }
    images
}

fn light_mask() -> Images {
    let mut images = images(0.0, 1.0, 0.0);
    let middle = images.mask.len() / 2;
    images.mask[middle] = 1e-6;
    images
}

/// Judges errors of the value, absolute, and of the gradient, relative to its largest value.
fn judge(device: &Device, images: &Images, limits: Limits) -> CaseResult {
    let [width, height] = SIZE;
    let Images {
        render,
        target,
        mask,
    } = images;
    let widen = |values: &[f32]| -> Vec<f64> { values.iter().copied().map(f64::from).collect() };
    let (found, limits) = match device.kind() {
        DeviceKind::Cpu => {
            let mut loss = Loss::new(width, height, Columns::Wrap);
            let (value, gradient) = loss.masked_forward_backward(render, target, mask, LAMBDA);
            ((value.total, widen(gradient)), limits)
        }
        DeviceKind::Gpu => match device.photometric_loss(SIZE, [render, target], LAMBDA) {
            Ok((value, gradient)) => {
                let limits = Limits {
                    forward: limits.forward.max(IN_F32.forward),
                    gradient: limits.gradient.max(IN_F32.gradient),
                };
                ((value, widen(&gradient)), limits)
            }
            Err(error) => return CaseResult::failed(error),
        },
    };
    let pair = ReferencePair {
        width,
        height,
        columns: Columns::Wrap,
        render: &widen(render),
        target: &widen(target),
        mask: &widen(mask),
    };
    let (expected, by_render) = pair.value_and_gradient(f64::from(LAMBDA));
    compared(&found, &(expected.total, by_render), limits)
}

/// Compares a value and its gradient with the expected ones: the error of the value, absolute, and those of the
/// gradient, relative to its largest value.
fn compared(
    (value, gradient): &(f64, Vec<f64>),
    (expected, by_input): &(f64, Vec<f64>),
    limits: Limits,
) -> CaseResult {
    let largest = by_input.iter().map(|g| g.abs()).fold(0.0, largest_or_nan);
    let errors = gradient
        .iter()
        .zip(by_input)
        .map(|(found, expected)| (found - expected).abs());
    let measures = StabilityMeasures {
        forward_error: Some((value - expected).abs()),
        forward_share: Some(0.0),
        forward_limit: Some(limits.forward),
        gradient_error: Some(errors.fold(0.0, largest_or_nan) / largest.max(f64::MIN_POSITIVE)),
        gradient_limit: Some(limits.gradient),
        is_finite: value.is_finite() && gradient.iter().all(|g| g.is_finite()),
        drawn: 0,
        gaussians: 0,
    };
    let fault = match (measures.forward_error, measures.gradient_error) {
        _ if !measures.is_finite => Some("some values are not finite".to_owned()),
        (Some(error), _) if error.is_nan() || error > limits.forward => Some(format!(
            "the loss is off by {error:.1e}, the limit is {:.0e}",
            limits.forward
        )),
        (_, Some(error)) if error.is_nan() || error > limits.gradient => Some(format!(
            "the gradient is off by {error:.1e}, the limit is {:.0e}",
            limits.gradient
        )),
        _ => None,
    };
    CaseResult {
        action: "the loss and its gradient, against f64".to_owned(),
        fault,
        measured: Some(measures),
    }
}
