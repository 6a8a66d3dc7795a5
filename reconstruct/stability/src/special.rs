//! Cases without rendering: training on pixels and gradients that are NaN, infinite or nearly 0.

use omnilife_schemas::records::{StabilityMeasures, StabilityRow, StabilityStatus};

use crate::{
    NO_PARAMETERIZATION, atlas, clips, control, depth,
    devices::{Device, DeviceKind},
    gradients, large, losses, networks, objects,
    parameterizations::STATIC,
    poses,
    setup::{Setup, mild},
};
use omnilife_engine::{
    losses::photometric::{Columns, cpu::Loss},
    parameters::ParameterTable,
};

/// A case with a judgement of its own.
#[derive(Debug, Clone, Copy)]
pub struct SpecialCase {
    /// Id, unique among all cases.
    pub id: &'static str,
    /// Title in words.
    pub title: &'static str,
    /// Devices that judge it.
    pub runs: Runs,
    pub(super) judge: fn(&Device) -> CaseResult,
}

/// Devices of a case.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Runs {
    /// The CPU and a GPU.
    OnBoth,
    /// The CPU alone, for a reason that its row on a GPU has.
    OnCpu(HostOnly),
}

/// Reason for a case without a row of its own on a GPU.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum HostOnly {
    /// Its part prepares training.
    Preparation,
    /// Its part works in f64 between the steps.
    HostWork,
    /// Its values do not fit into a device's images.
    Bytes,
    /// Its kernel has no entry but a step.
    WithinSteps,
    /// It has too many steps for a software device.
    Duration,
}

impl HostOnly {
    /// Returns the reason as a row has it.
    pub fn in_words(self) -> &'static str {
        match self {
            Self::Preparation => "CPU alone: it prepares training, on the CPU for both backends",
            Self::HostWork => {
                "CPU alone: the host computes it in f64 between the steps of both backends"
            }
            Self::Bytes => {
                "CPU alone: images and masks of a device are bytes, which cannot have these values"
            }
            Self::WithinSteps => {
                "CPU alone: the kernel runs within a step or its own test, which compare it with the CPU"
            }
            Self::Duration => "CPU alone: hundreds of steps take a software device too long",
        }
    }
}

/// Result of a case.
pub(super) struct CaseResult {
    pub(super) action: String,
    /// Fault of the case; `None` passes.
    pub(super) fault: Option<String>,
    pub(super) measured: Option<StabilityMeasures>,
}

impl CaseResult {
    /// Returns the result of a case that failed to run.
    pub(super) fn failed(reason: impl ToString) -> Self {
        Self {
            action: String::new(),
            fault: Some(reason.to_string()),
            measured: None,
        }
    }

    /// Judges the errors of a value and of a gradient, each with its limit; `None` without such an error. NaN is
    /// beyond every limit.
    pub(super) fn of_errors(
        action: &str,
        value: Option<[f64; 2]>,
        gradient: Option<[f64; 2]>,
    ) -> Self {
        let fault = [("value", value), ("gradient", gradient)]
            .into_iter()
            .filter_map(|(name, errors)| Some((name, errors?)))
            .find(|(_, [error, limit])| error.is_nan() || error > limit)
            .map(|(name, [error, limit])| {
                format!("the {name} is off by {error:.1e}, the limit is {limit:.0e}")
            });
        let error = |errors: Option<[f64; 2]>| errors.map(|[error, _]| error);
        let finite = |errors| error(errors).filter(|error| error.is_finite());
        let limit = |errors: Option<[f64; 2]>| errors.map(|[_, limit]| limit);
        let mut all = [value, gradient].into_iter().filter_map(error);
        Self {
            action: action.to_owned(),
            fault,
            measured: Some(StabilityMeasures {
                forward_error: finite(value),
                forward_share: value.map(|_| 0.0),
                forward_limit: limit(value),
                gradient_error: finite(gradient),
                gradient_limit: limit(gradient),
                is_finite: all.all(f64::is_finite),
                drawn: 0,
                gaussians: 0,
            }),
        }
    }
}

/// Returns all cases without rendering.
pub fn all() -> impl Iterator<Item = &'static SpecialCase> {
    let further = clips::CASES.iter().chain(depth::CASES).chain(atlas::CASES);
    let own = SPECIAL_CASES
        .iter()
        .chain(losses::all())
        .chain(networks::CASES);
    own.chain(further)
        .chain(objects::CASES)
        .chain(poses::CASES)
        .chain(gradients::CASES)
        .chain(control::CASES)
        .chain(large::CASES)
}

const SPECIAL_CASES: &[SpecialCase] = &[
    SpecialCase {
        id: "non-finite-pixels",
        title: "pixels of a training image that are NaN or infinite",
        runs: Runs::OnCpu(HostOnly::Bytes),
        judge: |_| non_finite_pixels(),
    },
    SpecialCase {
        id: "non-finite-gradient",
        title: "gradients of the image that are NaN or infinite",
        runs: Runs::OnBoth,
        judge: non_finite_gradient,
    },
    SpecialCase {
        id: "flat-images",
        title: "the loss of images of one colour, equal and different",
        runs: Runs::OnBoth,
        judge: flat_images,
    },
    SpecialCase {
        id: "tiny-gradients",
        title: "gradients whose squares f32 cannot hold",
        runs: Runs::OnBoth,
        judge: tiny_gradients,
    },
];

impl SpecialCase {
    /// Judges the case on a device.
    pub fn row(&self, device: &Device) -> StabilityRow {
        let row = StabilityRow {
            case: self.id.to_owned(),
            title: self.title.to_owned(),
            parameterization: NO_PARAMETERIZATION.to_owned(),
            backend: device.kind().id().to_owned(),
            measured: None,
            action: String::new(),
            status: StabilityStatus::NotRun,
            reason: String::new(),
        };
        if let (DeviceKind::Gpu, Runs::OnCpu(reason)) = (device.kind(), self.runs) {
            return StabilityRow {
                reason: reason.in_words().to_owned(),
                ..row
            };
        }
        let judgement = (self.judge)(device);
        StabilityRow {
            measured: judgement.measured,
            action: judgement.action,
            status: match &judgement.fault {
                None => StabilityStatus::Pass,
                Some(_) => StabilityStatus::Fail,
            },
            reason: judgement.fault.unwrap_or_default(),
            ..row
        }
    }
}

const SIDE: usize = 24;

fn image(value: impl Fn(usize) -> f32) -> Vec<f32> {
    (0..SIDE * SIDE * 3).map(value).collect()
}

/// Checks that a loss that is not finite ends training with an error: nothing is learned from such an image.
fn non_finite_pixels() -> CaseResult {
    let rendered = image(|index| (index % 7) as f32 / 7.0);
    let survivors = [f32::NAN, f32::INFINITY, f32::NEG_INFINITY]
        .into_iter()
        .filter(|&bad| {
            let target = image(|index| if index == 100 { bad } else { 0.5 });
            let mut loss = Loss::new(SIDE, SIDE, Columns::Wrap);
            loss.forward_backward(&rendered, &target, 0.2)
                .0
                .total
                .is_finite()
        })
        .count();
    CaseResult {
        action: "refused: the loss is not finite, and training ends with the frame's name"
            .to_owned(),
        fault: (survivors > 0).then(|| format!("{survivors} of 3 kinds give a finite loss")),
        measured: None,
    }
}

/// Checks that gradients that are not finite are not applied, and are counted.
fn non_finite_gradient(device: &Device) -> CaseResult {
    let setup = Setup::new(mild());
    let camera = setup.view.camera;
    let values = camera.width() as usize * camera.height() as usize * 3;
    let mut weights = Device::weights(values);
    weights[0] = f32::NAN;
    weights[values / 2] = f32::INFINITY;
    weights[values - 1] = f32::NEG_INFINITY;
    let parameterization = &STATIC;
    let table = (parameterization.table)(&setup);
    let mut table: ParameterTable =
        match device.round_trip_with(&setup, parameterization, table, &weights) {
            Ok(made) => made.table,
            Err(error) => return CaseResult::failed(error),
        };
    let all: usize = table.arrays.iter().map(|array| array.gradients.len()).sum();
    for array in &mut table.arrays {
        array.learning_rate = 0.01;
    }
    let refused = match device.adam_step(&mut table) {
        Ok(refused) => refused,
        Err(error) => return CaseResult::failed(error),
    };
    let is_finite = table
        .arrays
        .iter()
        .flat_map(|array| array.values.iter().chain(&array.second_moments))
        .all(|value| value.is_finite());
    CaseResult {
        action: format!(
            "refused {refused} of {all} gradient values; they are counted in the trace"
        ),
        fault: if !is_finite {
            Some("parameters or moments are not finite after the step".to_owned())
        } else if refused == 0 {
            Some("nothing was refused".to_owned())
        } else {
            None
        },
        measured: None,
    }
}

/// Judges flat images, whose variance is zero; SSIM's constants bound the quotient.
fn flat_images(device: &Device) -> CaseResult {
    let flat = image(|_| 0.5);
    let mut is_finite = true;
    let mut of_equal = [0.0_f64; 2];
    for (value, is_equal) in [(0.5, true), (0.7, false), (0.0, false), (1.0, false)] {
        let target = image(|_| value);
        let found = device.photometric_loss([SIDE; 2], [&flat, &target], 0.2);
        let (value, gradient) = match found {
            Ok(found) => found,
            Err(error) => return CaseResult::failed(error),
        };
        is_finite &= value.is_finite() && gradient.iter().all(|g| g.is_finite());
        if is_equal {
            let largest = gradient.iter().fold(0.0_f32, |most, g| most.max(g.abs()));
            of_equal = [value.abs(), f64::from(largest)];
        }
    }
    if !is_finite {
        return CaseResult::failed("a loss or its gradient is not finite");
    }
    let [value, gradient] = of_equal.map(|error| Some([error, 7e-8]));
    CaseResult::of_errors("quotients held by SSIM's constants", value, gradient)
}

/// Checks that Adam's step shrinks for a gradient of 1e-25, whose second moment is zero in f32.
fn tiny_gradients(device: &Device) -> CaseResult {
    let mut table = ParameterTable::new(3);
    table.add("values", 1, vec![1.0; 3], 0.01);
    table.arrays[0].gradients = vec![1e-25, -1e-30, 1e-40];
    if let Err(error) = device.adam_step(&mut table) {
        return CaseResult::failed(error);
    }
    let array = &table.arrays[0];
    let largest = array
        .values
        .iter()
        .map(|value| (value - 1.0).abs())
        .fold(0.0, f32::max);
    let is_finite = array.values.iter().all(|value| value.is_finite());
    CaseResult {
        action: "the second moment underflows and the step with it; f64 would take the full step"
            .to_owned(),
        fault: (!is_finite || largest > 0.01)
            .then(|| format!("a step of {largest} where the rate is 0.01")),
        measured: None,
    }
}
