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
    parameters::{ParameterTable, adam},
};

/// A case with a judgement of its own; on a GPU, clips of atlases alone.
#[derive(Debug, Clone, Copy)]
pub struct SpecialCase {
    /// Id, unique among all cases.
    pub id: &'static str,
    /// Title in words.
    pub title: &'static str,
    pub(super) judge: fn() -> Judgement,
}

/// Result of a case.
pub(super) struct Judgement {
    pub(super) action: String,
    /// Fault of the case; `None` passes.
    pub(super) fault: Option<String>,
    pub(super) measured: Option<StabilityMeasures>,
    /// Reason for a case that did not run.
    pub(super) missing: Option<&'static str>,
}

impl Judgement {
    /// Returns the judgement of a case that failed to run.
    pub(super) fn failed(reason: String) -> Self {
        Self {
            action: String::new(),
            fault: Some(reason),
            measured: None,
            missing: None,
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
            missing: None,
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
        judge: non_finite_pixels,
    },
    SpecialCase {
        id: "non-finite-gradient",
        title: "gradients of the image that are NaN or infinite",
        judge: non_finite_gradient,
    },
    SpecialCase {
        id: "flat-images",
        title: "the loss of images of one colour, equal and different",
        judge: flat_images,
    },
    SpecialCase {
        id: "tiny-gradients",
        title: "gradients whose squares f32 cannot hold",
        judge: tiny_gradients,
    },
];

impl SpecialCase {
    /// Judges the case.
    pub fn row(&self, kind: DeviceKind) -> StabilityRow {
        let judgement = match kind {
            DeviceKind::Cpu => (self.judge)(),
            DeviceKind::Gpu => atlas::on_gpu(self.id).unwrap_or_else(|| Judgement {
                action: String::new(),
                fault: None,
                measured: None,
                missing: Some("judged on the CPU"),
            }),
        };
        let status = match (&judgement.fault, judgement.missing) {
            (_, Some(_)) => StabilityStatus::NotRun,
            (None, None) => StabilityStatus::Pass,
            (Some(_), None) => StabilityStatus::Fail,
        };
        StabilityRow {
            case: self.id.to_owned(),
            title: self.title.to_owned(),
            parameterization: NO_PARAMETERIZATION.to_owned(),
            backend: kind.id().to_owned(),
            measured: judgement.measured,
            action: judgement.action,
            status,
            reason: judgement
                .fault
                .or(judgement.missing.map(str::to_owned))
                .unwrap_or_default(),
        }
    }
}

const SIDE: usize = 24;

fn image(value: impl Fn(usize) -> f32) -> Vec<f32> {
    (0..SIDE * SIDE * 3).map(value).collect()
}

/// Checks that a loss that is not finite ends training with an error: nothing is learned from such an image.
fn non_finite_pixels() -> Judgement {
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
    Judgement {
        action: "refused: the loss is not finite, and training ends with the frame's name"
            .to_owned(),
        fault: (survivors > 0).then(|| format!("{survivors} of 3 kinds give a finite loss")),
        measured: None,
        missing: None,
    }
}

/// Checks that gradients that are not finite are not applied, and are counted.
fn non_finite_gradient() -> Judgement {
    let setup = Setup::new(mild());
    let camera = setup.view.camera;
    let values = camera.width() as usize * camera.height() as usize * 3;
    let mut weights = Device::weights(values);
    weights[0] = f32::NAN;
    weights[values / 2] = f32::INFINITY;
    weights[values - 1] = f32::NEG_INFINITY;
    let parameterization = &STATIC;
    let table = (parameterization.table)(&setup);
    let made = Device::open(DeviceKind::Cpu)
        .map_err(|reason| reason.clone())
        .and_then(|device| {
            device
                .round_trip_with(&setup, parameterization, table, &weights)
                .map_err(|error| error.to_string())
        });
    let mut table: ParameterTable = match made {
        Ok(made) => made.table,
        Err(reason) => return Judgement::failed(reason),
    };
    let all: usize = table.arrays.iter().map(|array| array.gradients.len()).sum();
    let mut refused = 0;
    for array in &mut table.arrays {
        array.learning_rate = 0.01;
        refused += adam::cpu::step(array, 1, adam::SecondMomentDecay::PUBLISHED);
    }
    let is_finite = table
        .arrays
        .iter()
        .flat_map(|array| array.values.iter().chain(&array.second_moments))
        .all(|value| value.is_finite());
    Judgement {
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
        missing: None,
    }
}

/// Judges flat images, whose variance is zero; SSIM's constants bound the quotient.
fn flat_images() -> Judgement {
    let mut loss = Loss::new(SIDE, SIDE, Columns::Wrap);
    let flat = image(|_| 0.5);
    let mut is_finite = true;
    let mut of_equal = [0.0_f64; 2];
    for (value, is_equal) in [(0.5, true), (0.7, false), (0.0, false), (1.0, false)] {
        let target = image(|_| value);
        let (value, gradient) = loss.forward_backward(&flat, &target, 0.2);
        is_finite &= value.total.is_finite() && gradient.iter().all(|g| g.is_finite());
        if is_equal {
            let largest = gradient.iter().fold(0.0_f32, |most, g| most.max(g.abs()));
            of_equal = [value.total.abs(), f64::from(largest)];
        }
    }
    if !is_finite {
        return Judgement::failed("a loss or its gradient is not finite".to_owned());
    }
    let [value, gradient] = of_equal.map(|error| Some([error, 1e-6]));
    Judgement::of_errors("quotients held by SSIM's constants", value, gradient)
}

/// Checks that Adam's step shrinks for a gradient of 1e-25, whose second moment is zero in f32.
fn tiny_gradients() -> Judgement {
    let mut table = ParameterTable::new(3);
    table.add("values", 1, vec![1.0; 3], 0.01);
    let array = &mut table.arrays[0];
    array.gradients = vec![1e-25, -1e-30, 1e-40];
    adam::cpu::step(array, 1, adam::SecondMomentDecay::PUBLISHED);
    let largest = array
        .values
        .iter()
        .map(|value| (value - 1.0).abs())
        .fold(0.0, f32::max);
    let is_finite = array.values.iter().all(|value| value.is_finite());
    Judgement {
        action: "the second moment underflows and the step with it; f64 would take the full step"
            .to_owned(),
        fault: (!is_finite || largest > 0.01)
            .then(|| format!("a step of {largest} where the rate is 0.01")),
        measured: None,
        missing: None,
    }
}
