//! Errors of a case against the f64 reference.

use std::sync::{Arc, Mutex, PoisonError};

use omnilife_schemas::records::StabilityMeasures;

use crate::{
    Limits,
    devices::Device,
    parameterizations::{Parameterization, STATIC_VALUES},
    setup::Setup,
};
use omnilife_engine::{
    camera::Camera,
    parameters::ParameterTable,
    render::reference::{self, Decisions, Gaussian},
};
use omnilife_training::error::ReconstructError;

/// A case as a device rendered it, with its errors against the reference.
#[derive(Debug)]
pub struct MeasuredCase {
    /// The measures.
    pub measures: StabilityMeasures,
    /// The image, HWC.
    pub colour: Vec<f32>,
}

/// Step of the finite differences, relative to the change of a parameter that visibly changes the image.
const STEP: f64 = 1e-3;

/// Renders a setup on a device and compares image and gradients with the reference. The reference lacks the last
/// `degenerate` Gaussians: only Adam, which refuses them, sees their gradients. Colour values that differ by more
/// than their limit are counted.
///
/// # Errors
/// When the device fails.
pub fn measure(
    setup: &Setup,
    parameterization: &Parameterization,
    device: &Device,
    degenerate: usize,
    limits: Limits,
) -> Result<MeasuredCase, ReconstructError> {
    let table = (parameterization.table)(setup);
    let sound = setup.gaussians.len() - degenerate;
    let expected = expected(setup, parameterization, &table, sound);
    let made = device.round_trip(setup, parameterization, table)?;
    let differences: Vec<f64> = made
        .colour
        .iter()
        .zip(&expected.colour)
        .map(|(value, expected)| (f64::from(*value) - expected).abs())
        .collect();
    let largest = differences.iter().copied().fold(0.0, f64::max);
    let beyond = differences
        .iter()
        .filter(|&&difference| difference > limits.forward)
        .count();
    let gradients = made
        .table
        .arrays
        .iter()
        .flat_map(|array| &array.gradients[..sound * array.width]);
    let is_finite = made.colour.iter().chain(gradients).all(|v| v.is_finite());
    let finite = |value: f64| value.is_finite().then_some(value);
    let measures = StabilityMeasures {
        forward_error: finite(largest),
        forward_share: finite(beyond as f64 / differences.len() as f64),
        forward_limit: Some(limits.forward),
        gradient_error: finite(expected.gradient_error(&made.table)),
        gradient_limit: Some(limits.gradient),
        is_finite,
        drawn: made.drawn as u64,
        gaussians: setup.gaussians.len() as u64,
    };
    Ok(MeasuredCase {
        measures,
        colour: made.colour,
    })
}

/// Image and gradients of the reference, the same for every device.
#[derive(Debug)]
struct Expected {
    /// HWC.
    colour: Vec<f64>,
    /// By array of the table, the derivatives by the components of the judged Gaussians, with the index of each value.
    derivatives: Vec<Vec<(usize, f64)>>,
}

/// Expectations of earlier setups. A second device is judged by the same numbers, which take longer than its own.
static KNOWN: Mutex<Vec<Known>> = Mutex::new(Vec::new());

/// A setup with what is expected of it.
#[derive(Debug)]
struct Known {
    setup: Setup,
    parameterization: &'static str,
    sound: usize,
    expected: Arc<Expected>,
}

impl Known {
    fn is_of(&self, setup: &Setup, parameterization: &Parameterization, sound: usize) -> bool {
        self.parameterization == parameterization.id && self.sound == sound && self.setup == *setup
    }
}

/// Returns image and gradients of the reference for a setup's first `sound` Gaussians.
fn expected(
    setup: &Setup,
    parameterization: &Parameterization,
    table: &ParameterTable,
    sound: usize,
) -> Arc<Expected> {
    // A panic elsewhere leaves whole entries.
    let known = || KNOWN.lock().unwrap_or_else(PoisonError::into_inner);
    let equal = |known: &Known| {
        let is_equal = known.is_of(setup, parameterization, sound);
        is_equal.then(|| Arc::clone(&known.expected))
    };
    if let Some(expected) = known().iter().find_map(equal) {
        return expected;
    }
    let expected = Arc::new(Reference::new(setup, parameterization, table, sound).expected(table));
    known().push(Known {
        setup: setup.clone(),
        parameterization: parameterization.id,
        sound,
        expected: Arc::clone(&expected),
    });
    expected
}

impl Expected {
    /// Returns the largest error of a gradient value of the judged Gaussians, relative to its size or to the root
    /// mean square of its array.
    fn gradient_error(&self, table: &ParameterTable) -> f64 {
        let mut worst = 0.0_f64;
        for (array, derivatives) in table.arrays.iter().zip(&self.derivatives) {
            let squares = derivatives.iter().map(|(_, g)| g * g);
            let mean_square = squares.sum::<f64>() / derivatives.len().max(1) as f64;
            // An array without effect here (rounding noise of the differences) has no error.
            let typical = mean_square.sqrt().max(1e-6);
            for &(index, expected) in derivatives {
                let found = f64::from(array.gradients[index]);
                worst = worst.max((found - expected).abs() / expected.abs().max(typical));
                if found.is_nan() {
                    return f64::NAN;
                }
            }
        }
        worst
    }
}

/// A setup's raw parameters in f64, with the table's values.
struct Reference<'a> {
    setup: &'a Setup,
    parameterization: &'a Parameterization,
    rows: Vec<Vec<f64>>,
    weights: Vec<f32>,
}

impl<'a> Reference<'a> {
    fn new(
        setup: &'a Setup,
        parameterization: &'a Parameterization,
        table: &ParameterTable,
        sound: usize,
    ) -> Self {
        let rows = (0..sound)
            .map(|index| {
                (0..table.arrays.len())
                    .flat_map(|array| table.row(array, index))
                    .map(|&value| f64::from(value))
                    .collect()
            })
            .collect();
        let camera = setup.view.camera;
        let values = camera.width() as usize * camera.height() as usize * 3;
        Self {
            setup,
            parameterization,
            rows,
            weights: Device::weights(values),
        }
    }

    /// Returns the Gaussian of a row that differs from the table's row `index`.
    fn gaussian(&self, row: &[f64], index: usize) -> Gaussian {
        (self.parameterization.definition)(row, &self.rows[index], self.setup)
    }

    fn gaussians(&self) -> Vec<Gaussian> {
        let rows = self.rows.iter().enumerate();
        rows.map(|(index, row)| self.gaussian(row, index)).collect()
    }

    /// Returns its image, and the derivatives by the judged Gaussians' values in a table.
    fn expected(&self, table: &ParameterTable) -> Expected {
        let mut gaussians = self.gaussians();
        let (image, decisions) = reference::render(&self.setup.exact, &gaussians, None);
        let mut derivatives = Vec::new();
        let mut begin = 0;
        for array in &table.arrays {
            let mut of_array = Vec::new();
            let judged = self.setup.judged.iter();
            for &index in judged.filter(|&&index| index < self.rows.len()) {
                for component in 0..array.width {
                    let derivative =
                        self.derivative(&mut gaussians, &decisions, index, begin + component);
                    of_array.push((index * array.width + component, derivative));
                }
            }
            begin += array.width;
            derivatives.push(of_array);
        }
        Expected {
            colour: image.colour,
            derivatives,
        }
    }

    /// Returns the five-point difference of the weighted image by one raw parameter, with the decisions of the
    /// unchanged render.
    fn derivative(
        &self,
        gaussians: &mut [Gaussian],
        decisions: &Decisions,
        index: usize,
        parameter: usize,
    ) -> f64 {
        let step = self.step(&gaussians[index], &self.rows[index], parameter);
        let unchanged = gaussians[index].clone();
        let mut at = |steps: f64| {
            let mut row = self.rows[index].clone();
            row[parameter] += steps * step;
            gaussians[index] = self.gaussian(&row, index);
            let (image, _) = reference::render(&self.setup.exact, gaussians, Some(decisions));
            let weighted = image.colour.iter().zip(&self.weights);
            weighted
                .map(|(value, &weight)| value * f64::from(weight))
                .sum::<f64>()
        };
        let near = at(1.0) - at(-1.0);
        let far = at(2.0) - at(-2.0);
        gaussians[index] = unchanged;
        let derivative = (8.0 * near - far) / (12.0 * step);
        match parameter.checked_sub(STATIC_VALUES) {
            None => derivative,
            Some(further) => {
                let scale = self.parameterization.gradient_scale;
                derivative * scale(&self.rows[index], further, self.setup)
            }
        }
    }

    /// Returns the step size. Positions (the first three values of every parameterization) step by a share of the
    /// Gaussian's apparent width, its smallest axis or a pixel. A quaternion steps by a share of its length,
    /// parameters of single parameterizations by a share of their unit. All others have a unit of 1.
    fn step(&self, gaussian: &Gaussian, row: &[f64], parameter: usize) -> f64 {
        let offset = glam::DVec3::from_array(gaussian.position) - self.setup.exact.centre;
        let pixel = match self.setup.exact.camera {
            Camera::Erp(camera) => std::f64::consts::PI / f64::from(camera.height),
            Camera::Pinhole(camera) => 1.0 / camera.fy,
        };
        let smallest = gaussian.scale.iter().copied().fold(f64::INFINITY, f64::min);
        let size = smallest.max(0.5 * pixel * offset.length());
        let unit = match parameter {
            0..3 => size,
            6..10 => {
                let length = row[6..10].iter().map(|q| q * q).sum::<f64>().sqrt();
                length.max(1e-12)
            }
            _ if parameter < STATIC_VALUES => 1.0,
            _ => (self.parameterization.unit)(row, parameter - STATIC_VALUES, size, self.setup),
        };
        STEP * unit
    }
}
