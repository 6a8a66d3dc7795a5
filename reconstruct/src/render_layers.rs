//! A model taken apart: what is static, what is dynamic, where it moves, how far it is.

use glam::Vec3;
use omnilife_schemas::RgbImage;

use crate::{
    camera::View,
    gaussians::{InstantGaussians, static_gaussians, subset, temporal::TemporalFeatures},
    render::{RenderSettings, Renderer},
    train::{dynamic_settings::DynamicSettings, dynamic_step, step::Model},
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

/// Renders layers of one model.
#[derive(Debug)]
pub struct LayerRenderer<'a> {
    model: &'a Model,
    dynamics: Option<&'a DynamicSettings>,
    renderer: Renderer,
    all: InstantGaussians,
    part: InstantGaussians,
    median_distance: f32,
    largest_speed: f32,
}

impl<'a> LayerRenderer<'a> {
    /// For a model; `dynamics` are those that it was trained with.
    pub fn new(
        model: &'a Model,
        dynamics: Option<&'a DynamicSettings>,
        settings: RenderSettings,
    ) -> Self {
        let mut distances: Vec<f32> = (0..model.table.len())
            .map(|index| Vec3::from_slice(model.table.row(static_gaussians::POSITIONS, index)))
            .map(Vec3::length)
            .collect();
        distances.sort_by(f32::total_cmp);
        let median = distances.get(distances.len() / 2).copied();
        Self {
            model,
            dynamics,
            renderer: Renderer::new(settings),
            all: InstantGaussians::default(),
            part: InstantGaussians::default(),
            median_distance: median.unwrap_or(1.0).max(f32::MIN_POSITIVE),
            largest_speed: largest_speed(model, dynamics),
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
        match self.dynamics {
            Some(dynamics) => {
                let look = dynamics.look(view, 0.0);
                dynamic_step::instantiate(self.model, dynamics, &look, features, &mut self.all);
            }
            None => {
                static_gaussians::instantiate(&self.model.table, &mut self.all);
                self.all.feature_count = features.count();
                self.all.features = vec![0.0; features.count() * self.all.len()];
            }
        }
    }

    /// The dynamic or the static Gaussians.
    fn members(&self, view: &View, dynamic: bool) -> Vec<usize> {
        let fixed = self.model.table.len();
        let mut members: Vec<usize> = if dynamic {
            Vec::new()
        } else {
            (0..fixed).collect()
        };
        if let (Some(moving), Some(dynamics)) = (&self.model.moving, self.dynamics) {
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
