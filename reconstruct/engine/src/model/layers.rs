//! A model taken apart: what is static, what is dynamic, where it moves, how far it is.

use glam::Vec3;
use omnilife_schemas::RgbImage;

use crate::{
    camera::View,
    gaussians::{
        InstantGaussians, deformable::Deformation, static_gaussians, subset,
        temporal::TemporalFeatures,
    },
    model::{Model, deformation_settings::DeformationSettings, dynamic_settings::DynamicSettings},
    render::{cpu::Renderer, settings::RenderSettings},
};

/// What of a model is shown.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Layer {
    /// Everything: the image.
    #[default]
    All,
    /// Static Gaussians alone: those without temporal parameters, and those whose staticness is not
    /// below the method's threshold.
    Static,
    /// Dynamic Gaussians alone, on black.
    Dynamic,
    /// Mean velocities along the world's axes as red, green and blue: grey is still, and 0 and 1 are
    /// minus and plus [`LayerRenderer::largest_speed`].
    Velocity,
    /// Radial depth `d` as `m / (m + d)` with the median distance `m` of the Gaussians: near is
    /// white, far is black.
    Depth,
}

/// Added to the accumulated opacity before maps are divided by it.
const OPACITY_EPSILON: f32 = 1e-5;
/// Share of the dynamic Gaussians that are not faster than what velocity maps show at most.
const SLOWER_SHARE: f32 = 0.99;

impl Layer {
    /// Whether it tells Gaussians by their temporal parameters, which deformed ones do not have.
    pub fn is_of_time(self) -> bool {
        matches!(self, Self::Static | Self::Dynamic | Self::Velocity)
    }
}

/// What a model was trained with of time.
#[derive(Debug, Clone, Copy, Default)]
pub enum TimeSettings<'a> {
    /// Nothing.
    #[default]
    None,
    /// Gaussians of its own parameters.
    Dynamic(&'a DynamicSettings),
    /// A network.
    Deformation(&'a DeformationSettings),
}

impl<'a> TimeSettings<'a> {
    /// Those of a run's settings.
    pub fn new(
        dynamics: Option<&'a DynamicSettings>,
        deformation: Option<&'a DeformationSettings>,
    ) -> Self {
        match (dynamics, deformation) {
            (Some(dynamics), _) => Self::Dynamic(dynamics),
            (None, Some(deformation)) => Self::Deformation(deformation),
            (None, None) => Self::None,
        }
    }

    fn dynamics(&self) -> Option<&'a DynamicSettings> {
        match self {
            Self::Dynamic(dynamics) => Some(dynamics),
            _ => None,
        }
    }
}

/// Renders layers of one model.
#[derive(Debug)]
pub struct LayerRenderer<'a> {
    model: &'a Model,
    time: TimeSettings<'a>,
    deformation: Deformation,
    renderer: Renderer,
    all: InstantGaussians,
    part: InstantGaussians,
    median_distance: f32,
    largest_speed: f32,
}

impl<'a> LayerRenderer<'a> {
    /// For a model, with what it was trained with.
    pub fn new(model: &'a Model, time: TimeSettings<'a>, settings: RenderSettings) -> Self {
        let mut distances: Vec<f32> = (0..model.table.len())
            .map(|index| Vec3::from_slice(model.table.row(static_gaussians::POSITIONS, index)))
            .map(Vec3::length)
            .collect();
        distances.sort_by(f32::total_cmp);
        let median = distances.get(distances.len() / 2).copied();
        Self {
            model,
            time,
            deformation: Deformation::without_gradients(),
            renderer: Renderer::new(settings),
            all: InstantGaussians::default(),
            part: InstantGaussians::default(),
            median_distance: median.unwrap_or(1.0).max(f32::MIN_POSITIVE),
            largest_speed: largest_speed(model, time.dynamics()),
        }
    }

    /// What velocity maps show at most, normalized units per frame; 1 where nothing moves.
    pub fn largest_speed(&self) -> f32 {
        self.largest_speed
    }

    /// Renders one layer of a view, clamped to `[0, 1]`.
    pub fn image(&mut self, view: &View, layer: Layer) -> RgbImage {
        match layer {
            Layer::All => {
                self.instantiate(view, &TemporalFeatures::default());
                self.renderer.image(view, &self.all)
            }
            Layer::Static | Layer::Dynamic => {
                self.instantiate(view, &TemporalFeatures::default());
                let members = self.members(view, layer == Layer::Dynamic);
                subset::gather(&self.all, &members, &mut self.part);
                self.renderer.image(view, &self.part)
            }
            Layer::Velocity => {
                self.instantiate(
                    view,
                    &TemporalFeatures {
                        velocity_unit: Some(self.largest_speed),
                        lifespan: None,
                    },
                );
                let [red, green, blue] = self.maps(view);
                let both = |value: f32| 0.5 + 0.5 * value;
                let rgb = red.into_iter().zip(green).zip(blue);
                let data = rgb.flat_map(|((r, g), b)| [both(r), both(g), both(b)]);
                self.encode(view, data.collect())
            }
            Layer::Depth => {
                self.instantiate(view, &TemporalFeatures::default());
                let positions = &self.all.positions;
                self.all.feature_count = 1;
                self.all.features = positions
                    .iter()
                    .map(|&position| (Vec3::from_array(position) - view.centre).length())
                    .collect();
                let [depth] = self.maps(view);
                let nearness = depth.into_iter().flat_map(|depth| {
                    let grey = self.median_distance / (self.median_distance + depth);
                    [if depth > 0.0 { grey } else { 0.0 }; 3]
                });
                self.encode(view, nearness.collect())
            }
        }
    }

    fn instantiate(&mut self, view: &View, features: &TemporalFeatures) {
        let (table, all) = (&self.model.table, &mut self.all);
        match (self.time, &self.model.deformation) {
            (TimeSettings::Dynamic(dynamics), _) => {
                let look = dynamics.look(view, 0.0);
                super::instantiate(self.model, dynamics, &look, features, all);
                return;
            }
            (TimeSettings::Deformation(settings), Some(weights)) => {
                let time = settings.unit_time(view.time_seconds, 0.0);
                let weights = &weights.array.values;
                self.deformation
                    .instantiate(&settings.model, weights, table, time, all);
            }
            _ => static_gaussians::instantiate(table, all),
        }
        all.feature_count = features.count();
        all.features = vec![0.0; features.count() * all.len()];
    }

    /// The dynamic or the static Gaussians.
    fn members(&self, view: &View, dynamic: bool) -> Vec<usize> {
        let fixed = self.model.table.len();
        let mut members: Vec<usize> = if dynamic {
            Vec::new()
        } else {
            (0..fixed).collect()
        };
        if let (Some(moving), Some(dynamics)) = (&self.model.moving, self.time.dynamics()) {
            let observer = dynamics.look(view, 0.0).observer;
            let pulses = dynamics.time.pulses(&moving.table, observer);
            let threshold = dynamics.dynamic_below_staticness;
            members.extend(
                (0..moving.table.len())
                    .filter(|&index| (pulses.staticness(index) < threshold) == dynamic)
                    .map(|index| fixed + index),
            );
        }
        members
    }

    /// The first feature maps over the accumulated opacity.
    fn maps<const N: usize>(&mut self, view: &View) -> [Vec<f32>; N] {
        let raster = self.renderer.forward(view, &self.all);
        let pixels = raster.transmittance.len();
        std::array::from_fn(|map| {
            let plane = &raster.features[map * pixels..(map + 1) * pixels];
            let values = plane.iter().zip(&raster.transmittance);
            values
                .map(|(value, transmittance)| value / (1.0 - transmittance + OPACITY_EPSILON))
                .collect()
        })
    }

    fn encode(&self, view: &View, data: Vec<f32>) -> RgbImage {
        RgbImage {
            width: view.camera.width() as usize,
            height: view.camera.height() as usize,
            data: data
                .into_iter()
                .map(|value| value.clamp(0.0, 1.0))
                .collect(),
        }
    }
}

/// The speed below which [`SLOWER_SHARE`] of the moving Gaussians are; 1 where nothing moves.
fn largest_speed(model: &Model, dynamics: Option<&DynamicSettings>) -> f32 {
    let (Some(moving), Some(dynamics)) = (&model.moving, dynamics) else {
        return 1.0;
    };
    let observer = crate::gaussians::omni4dgs::Observer {
        centre: Vec3::ZERO,
        down: Vec3::from_array(dynamics.down),
    };
    let pulses = dynamics.time.pulses(&moving.table, observer);
    let mut speeds: Vec<f32> = (0..moving.table.len())
        .map(|index| pulses.pulse(index))
        .map(|pulse| pulse.velocity.length() * pulse.steadiness(dynamics.time.cycle_frames))
        .collect();
    speeds.sort_by(f32::total_cmp);
    let fast = speeds.get((SLOWER_SHARE * speeds.len() as f32) as usize);
    fast.copied().filter(|&speed| speed > 0.0).unwrap_or(1.0)
}
