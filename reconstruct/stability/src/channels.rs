//! Cases of Gaussians with more than one colour: harmonics of degrees 1 to 3, and feature channels such as the
//! maps that masks supervise. Activated Gaussians are judged, on every device.

use glam::{DQuat, DVec3, dvec3};
use omnilife_schemas::{
    camera::{ErpCamera, PinholeCamera},
    records::{StabilityMeasures, StabilityRow, StabilityStatus},
};

use crate::{Limits, NO_PARAMETERIZATION, devices::Device};
use omnilife_engine::{
    camera::Camera,
    gaussians::{ActivatedGaussians, sh_rest_count},
    render::{
        reference::{self, Gaussian, RefView, instant, parameter_arrays},
        settings::{Footprint, RenderSettings},
    },
};
use omnilife_training::error::ReconstructError;

/// A case.
#[derive(Debug, Clone, Copy)]
pub struct ChannelCase {
    /// Id, unique among all cases.
    pub id: &'static str,
    /// Title in words.
    pub title: &'static str,
    sh_degree: usize,
    features: usize,
    footprint: Footprint,
    camera: fn() -> Camera,
    gaussians: fn() -> Vec<Shape>,
    limits: Limits,
}

/// Position and shape of a Gaussian: direction, distance, standard deviations, opacity.
pub(super) type Shape = (DVec3, f64, [f64; 3], f64);

/// Ten times the measured errors, on the CPU and on a software adapter alike.
const LIMITS: Limits = Limits {
    forward: 5e-6,
    gradient: 1e-4,
};

const PLAIN: ChannelCase = ChannelCase {
    id: "",
    title: "",
    sh_degree: 3,
    features: 2,
    footprint: Footprint::Projected,
    camera: erp,
    gaussians: around,
    limits: LIMITS,
};

pub(super) const CASES: &[ChannelCase] = &[
    ChannelCase {
        id: "harmonics-1",
        title: "harmonics of degree 1, two feature channels",
        sh_degree: 1,
        ..PLAIN
    },
    ChannelCase {
        id: "harmonics-2",
        title: "harmonics of degree 2, no feature channels",
        sh_degree: 2,
        features: 0,
        ..PLAIN
    },
    ChannelCase {
        id: "harmonics-3-poles",
        title: "harmonics of degree 3 and two feature channels on both poles and beside them",
        gaussians: at_the_poles,
        ..PLAIN
    },
    ChannelCase {
        id: "harmonics-3-ray",
        title: "harmonics of degree 3 and two feature channels, footprint along the ray",
        footprint: Footprint::Ray,
        ..PLAIN
    },
    ChannelCase {
        id: "features-needle",
        title: "feature channels of needles a million times as long as thick",
        sh_degree: 0,
        gaussians: needles,
        ..PLAIN
    },
    ChannelCase {
        id: "features-layers",
        title: "feature channels of 300 translucent layers in one direction",
        sh_degree: 0,
        features: 1,
        gaussians: layers,
        camera: small,
        ..PLAIN
    },
    ChannelCase {
        id: "harmonics-3-pinhole",
        title: "harmonics of degree 3 and two feature channels through a pinhole of 100 degrees",
        camera: pinhole,
        ..PLAIN
    },
];

/// Returns a panorama of Gaussians of one colour each.
pub(super) fn setup_of(shapes: Vec<Shape>) -> (RefView, Vec<Gaussian>) {
    let case = ChannelCase {
        sh_degree: 0,
        features: 0,
        ..PLAIN
    };
    case.setup_of(shapes)
}

impl ChannelCase {
    /// Judges the case on a device.
    ///
    /// # Errors
    /// When the device fails.
    pub fn row(&self, device: &Device) -> Result<StabilityRow, ReconstructError> {
        let (view, gaussians) = self.setup();
        let measures = measure(&view, &gaussians, device, self.limits)?;
        let fault = super::fault(super::cases::Expectation::Agrees, &measures, &self.limits);
        Ok(StabilityRow {
            case: self.id.to_owned(),
            title: self.title.to_owned(),
            parameterization: NO_PARAMETERIZATION.to_owned(),
            backend: device.kind().id().to_owned(),
            action: format!("drew {} of {}", measures.drawn, measures.gaussians),
            measured: Some(measures),
            status: if fault.is_none() {
                StabilityStatus::Pass
            } else {
                StabilityStatus::Fail
            },
            reason: fault
                .unwrap_or_else(|| super::cases::Expectation::Agrees.in_words(&self.limits)),
        })
    }

    fn setup(&self) -> (RefView, Vec<Gaussian>) {
        self.setup_of((self.gaussians)())
    }

    fn setup_of(&self, shapes: Vec<Shape>) -> (RefView, Vec<Gaussian>) {
        let settings = RenderSettings {
            background: [0.1, 0.3, 0.2],
            sh_degree: self.sh_degree,
            footprint: self.footprint,
            ..RenderSettings::new(0.01)
        };
        let turn = DQuat::from_euler(glam::EulerRot::XYZ, 0.1, -0.2, 0.05);
        let view = RefView::new((self.camera)(), turn, dvec3(0.02, -0.01, 0.03), settings);
        let gaussians = shapes
            .into_iter()
            .enumerate()
            .map(|(number, shape)| self.gaussian(number, shape))
            .collect();
        (view, gaussians)
    }

    /// Returns a Gaussian with coefficients and features that depend on its number.
    fn gaussian(&self, number: usize, (direction, distance, scale, opacity): Shape) -> Gaussian {
        let wave = |index: usize| (1.3 * number as f64 + 0.9 * index as f64).sin();
        let bands = sh_rest_count(self.sh_degree) + 1;
        let strength = |band: usize| if band == 0 { 0.9 } else { 0.25 };
        let length =
            (0.8_f64.powi(2) + 0.3_f64.powi(2) + 0.4_f64.powi(2) + 0.33_f64.powi(2)).sqrt();
        Gaussian {
            position: (direction.normalize() * distance).to_array(),
            scale,
            quaternion: [0.8, 0.3, -0.4, 0.33].map(|part| part / length),
            opacity,
            sh: (0..bands)
                .map(|band| [0, 1, 2].map(|channel| strength(band) * wave(3 * band + channel)))
                .collect(),
            features: (0..self.features)
                .map(|feature| wave(50 + feature))
                .collect(),
        }
        .rounded()
    }
}

fn erp() -> Camera {
    Camera::Erp(ErpCamera {
        width: 48,
        height: 24,
    })
}

fn small() -> Camera {
    Camera::Erp(ErpCamera {
        width: 12,
        height: 6,
    })
}

fn pinhole() -> Camera {
    Camera::Pinhole(PinholeCamera::with_horizontal_field_of_view(36, 24, 1.745))
}

pub(super) fn around() -> Vec<Shape> {
    (0..8)
        .map(|index| {
            let y = 1.0 - (f64::from(index) + 0.5) / 4.0;
            let (sin, cos) = (2.399_963 * f64::from(index)).sin_cos();
            let rho = (1.0 - y * y).sqrt();
            let direction = dvec3(rho * cos, 0.8 * y, rho * sin);
            (
                direction,
                2.0 + 0.3 * f64::from(index),
                [0.2, 0.3, 0.25],
                0.5,
            )
        })
        .collect()
}

pub(super) fn at_the_poles() -> Vec<Shape> {
    let mut shapes = vec![
        (dvec3(0.0, -1.0, 0.0), 2.0, [0.2, 0.1, 0.3], 0.6),
        (dvec3(0.0, 1.0, 0.0), 1.5, [0.1, 0.2, 0.15], 0.5),
        (dvec3(1e-6, -1.0, 0.0), 3.0, [0.5, 0.2, 0.25], 0.4),
    ];
    shapes.extend(around().into_iter().take(4));
    shapes
}

pub(super) fn needles() -> Vec<Shape> {
    let thin = 9e-7;
    let mut shapes = vec![
        (dvec3(-1.0, 0.2, 0.7), 3.0, [0.9, thin, thin], 0.7),
        (dvec3(0.3, 0.6, 1.0), 2.7, [thin, 0.9, thin], 0.6),
    ];
    shapes.extend(around().into_iter().take(4));
    shapes
}

pub(super) fn layers() -> Vec<Shape> {
    (0..300)
        .map(|index| {
            let jitter = 0.02 * (f64::from(index) * 0.7).sin();
            let distance = 2.0 + f64::from(index) / 100.0;
            let direction = dvec3(0.3 + jitter, 0.2 - jitter, 1.0);
            (
                direction,
                distance,
                [0.3, 0.25, 0.2].map(|share| share * distance),
                1.0 / 64.0,
            )
        })
        .collect()
}

/// Compares image, features and gradients of a device with the reference.
fn measure(
    view: &RefView,
    gaussians: &[Gaussian],
    device: &Device,
    limits: Limits,
) -> Result<StabilityMeasures, ReconstructError> {
    let values = view.camera.width() as usize * view.camera.height() as usize;
    let weights = Device::weights(values * (3 + gaussians[0].features.len()));
    let (by_colour, by_features) = weights.split_at(values * 3);
    let activated = instant(gaussians);
    let made = device.round_trip_activated(
        &view.view(),
        view.settings,
        &activated,
        [by_colour, by_features],
    )?;
    let (image, _) = reference::render(view, gaussians, None);
    let expected = image.colour.iter().chain(&image.features);
    let differences: Vec<f64> = made
        .colour
        .iter()
        .chain(&made.features)
        .zip(expected)
        .map(|(value, expected)| (f64::from(*value) - expected).abs())
        .collect();
    let beyond = differences.iter().filter(|&&d| d > limits.forward).count();
    let dot = |values: &[f64], weights: &[f32]| -> f64 {
        let pairs = values.iter().zip(weights);
        pairs
            .map(|(value, &weight)| value * f64::from(weight))
            .sum()
    };
    let by_reference = reference::gradients(view, gaussians, |image| {
        dot(&image.colour, by_colour) + dot(&image.features, by_features)
    });
    let found = gradient_rows(&activated, &made.gradient);
    let is_finite = made
        .colour
        .iter()
        .chain(&made.features)
        .all(|v| v.is_finite())
        && found.iter().flatten().all(|value| value.is_finite());
    let finite = |value: f64| value.is_finite().then_some(value);
    Ok(StabilityMeasures {
        forward_error: finite(differences.iter().copied().fold(0.0, f64::max)),
        forward_share: finite(beyond as f64 / differences.len() as f64),
        forward_limit: Some(limits.forward),
        gradient_error: finite(largest_error(&gaussians[0], &found, &by_reference)),
        gradient_limit: Some(limits.gradient),
        is_finite,
        drawn: made.drawn as u64,
        gaussians: gaussians.len() as u64,
    })
}

/// Returns gradients of the kernels in the order of [`Gaussian::parameters`], one row per Gaussian. The reference
/// normalizes quaternions, so only the part orthogonal to them counts.
pub fn gradient_rows(
    gaussians: &ActivatedGaussians,
    gradient: &ActivatedGaussians,
) -> Vec<Vec<f64>> {
    let rest = gaussians.sh_rest.len() / gaussians.len();
    let features = gaussians.feature_count;
    (0..gaussians.len())
        .map(|index| {
            let (unit, by_unit) = (gaussians.rotations[index], gradient.rotations[index]);
            let along: f32 = unit.iter().zip(by_unit).map(|(q, g)| q * g).sum();
            let rotation = [0, 1, 2, 3].map(|axis| by_unit[axis] - unit[axis] * along);
            let mut row = Vec::new();
            row.extend(gradient.positions[index]);
            row.extend(gradient.scales[index]);
            row.extend(rotation);
            row.push(gradient.opacities[index]);
            row.extend(gradient.sh_constant[index]);
            row.extend(gradient.sh_rest[index * rest..(index + 1) * rest].as_flattened());
            row.extend(&gradient.features[index * features..(index + 1) * features]);
            row.into_iter().map(f64::from).collect()
        })
        .collect()
}

/// Returns the largest error of a value, relative to its size or to the root mean square of its array.
fn largest_error(shape: &Gaussian, found: &[Vec<f64>], expected: &[Vec<f64>]) -> f64 {
    let (mut worst, mut begin) = (0.0_f64, 0);
    for (_, width) in parameter_arrays(shape) {
        let range = begin..begin + width;
        begin += width;
        let pairs = || {
            let rows = found.iter().zip(expected);
            rows.flat_map(|(found, expected)| {
                found[range.clone()].iter().zip(&expected[range.clone()])
            })
        };
        let count = pairs().count();
        if count == 0 {
            continue;
        }
        let typical = (pairs().map(|(_, g)| g * g).sum::<f64>() / count as f64).sqrt();
        for (found, expected) in pairs() {
            let error = (found - expected).abs() / expected.abs().max(typical.max(1e-6));
            worst = if error.is_nan() {
                f64::NAN
            } else {
                worst.max(error)
            };
            if worst.is_nan() {
                return worst;
            }
        }
    }
    worst
}
