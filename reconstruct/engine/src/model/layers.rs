//! Layers of a model: static and dynamic Gaussians, objects, velocities, depth.

use glam::Vec3;
use omnilife_schemas::{RgbImage, statistics};
use rayon::prelude::*;

use crate::{
    camera::{Camera, CameraKernels, LOW_PASS, View},
    gaussians::{
        ActivatedGaussians, parameterization::Viewpoint, static_gaussians, subset,
        temporal::TemporalFeatures,
    },
    model::{Model, Part},
    render::{cpu::Renderer, settings::RenderSettings},
};

/// Layer of a model to render.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Layer {
    /// All Gaussians: the image.
    #[default]
    All,
    /// Static Gaussians alone: those without temporal parameters, and those whose staticness reaches the
    /// method's threshold.
    Static,
    /// Dynamic Gaussians alone, on black.
    Dynamic,
    /// Gaussians of the object with this id alone, on black; its opacity is [`LayerRenderer::opacity`].
    Object(u32),
    /// Mean velocities along the world's axes as red, green and blue, from minus to plus
    /// [`LayerRenderer::largest_speed`]: grey is at rest.
    Velocity,
    /// Radial depth `d` as `m / (m + d)` with the median distance `m` of the Gaussians: white is near, black
    /// is far.
    Depth,
}

/// Added to the accumulated opacity before maps are divided by it.
const OPACITY_EPSILON: f32 = 1e-5;
/// Share of the dynamic Gaussians with a speed within the range of velocity maps.
const SLOWER_SHARE: f32 = 0.99;

impl Layer {
    /// Returns true if the layer needs temporal parameters, which deformed Gaussians lack.
    pub fn is_of_time(self) -> bool {
        matches!(self, Self::Static | Self::Dynamic | Self::Velocity)
    }
}

/// Returns true for Gaussians without temporal parameters that belong to no moving object.
fn is_static(part: &Part) -> bool {
    let parameterization = &part.parameterization;
    parameterization.temporal().is_none() && parameterization.tracked().is_none()
}

/// Renders layers of one model.
#[derive(Debug)]
pub struct LayerRenderer {
    model: Model,
    renderer: Renderer,
    all: ActivatedGaussians,
    part: ActivatedGaussians,
    median_distance: f32,
    largest_speed: f32,
    /// Angle of a pixel of the trained views, radians, if it is known.
    trained_radians: Option<f32>,
}

impl LayerRenderer {
    /// Creates a renderer of a model with the settings of its training.
    pub fn new(model: Model, settings: RenderSettings) -> Self {
        let of_static = model.parts.iter().filter(|part| is_static(part));
        let distances: Vec<f32> = of_static
            .flat_map(|part| {
                (0..part.table.len()).map(|index| {
                    Vec3::from_slice(part.table.row(static_gaussians::POSITIONS, index)).length()
                })
            })
            .collect();
        let median = statistics::median(&distances);
        Self {
            renderer: Renderer::new(settings),
            all: ActivatedGaussians::default(),
            part: ActivatedGaussians::default(),
            median_distance: median.unwrap_or(1.0).max(f32::MIN_POSITIVE),
            largest_speed: largest_speed(&model),
            trained_radians: None,
            model,
        }
    }

    /// Draws views of finer pixels than the trained ones with the low-pass filter of those. Gaussians below a trained
    /// pixel were only ever seen through it: a finer one shows needles, and gaps between them.
    pub fn trained_with(mut self, camera: &Camera) -> Self {
        self.trained_radians = Some(camera.pixel_radians());
        self
    }

    /// Returns the model.
    pub fn model(&self) -> &Model {
        &self.model
    }

    /// Returns true if no Gaussian can move, so that dynamic layers show nothing.
    pub fn is_static(&self) -> bool {
        self.model.parts.iter().all(is_static)
    }

    /// Returns the largest speed in velocity maps, normalized units per frame; 1 if nothing moves.
    pub fn largest_speed(&self) -> f32 {
        self.largest_speed
    }

    /// Returns the distance that maps of distances show as half grey, normalized units.
    pub fn middle_distance(&self) -> f32 {
        self.median_distance
    }

    /// Renders one layer of a view, clamped to `[0, 1]`.
    pub fn image(&mut self, view: &View, layer: Layer) -> RgbImage {
        match layer {
            Layer::All => {
                self.activate(view, &TemporalFeatures::default());
                self.renderer.image(view, &self.all)
            }
            Layer::Static | Layer::Dynamic | Layer::Object(_) => {
                self.gather(view, layer);
                self.renderer.image(view, &self.part)
            }
            Layer::Velocity => {
                self.activate(
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
                self.activate(view, &TemporalFeatures::default());
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

    /// Renders the opacity of a view's layer as a grey image: that of its Gaussians, those of all for maps.
    pub fn opacity(&mut self, view: &View, layer: Layer) -> RgbImage {
        self.gather(view, layer);
        let transmittance = &self.renderer.forward(view, &self.part).transmittance;
        let opacity = transmittance.iter().flat_map(|behind| [1.0 - behind; 3]);
        let opacity = opacity.collect();
        self.encode(view, opacity)
    }

    /// Activates the Gaussians of a layer.
    fn gather(&mut self, view: &View, layer: Layer) {
        self.activate(view, &TemporalFeatures::default());
        let members = match layer {
            Layer::Object(id) => self.members_of_object(id),
            Layer::Static | Layer::Dynamic => self.members(view, layer == Layer::Dynamic),
            Layer::All | Layer::Velocity | Layer::Depth => (0..self.all.len()).collect(),
        };
        subset::gather(&self.all, &members, &mut self.part);
    }

    /// Returns the reason why this model has no such layer; `None` if it has.
    pub fn refusal(&self, layer: Layer) -> Option<&'static str> {
        if let Layer::Object(id) = layer
            && self.members_of_object(id).is_empty()
        {
            return Some("has no Gaussians of an object with this id");
        }
        let has_paths = |part: &Part| part.parameterization.tracked().is_some();
        if layer == Layer::Velocity && self.model.parts.iter().any(has_paths) {
            return Some(
                "its objects move along paths, and its Gaussians have no velocities; render dynamic or object:ID",
            );
        }
        let of_all = |part: &Part| !part.parameterization.tells_static_from_dynamic();
        (layer.is_of_time() && self.model.parts.iter().any(of_all)).then_some(
            "a network deforms these Gaussians, or they are of a file in time: none of them is static or dynamic \
             by itself, and none has a velocity; render all or depth",
        )
    }

    fn activate(&mut self, view: &View, features: &TemporalFeatures) {
        let at = Viewpoint::of_image(view);
        self.model.activate(&at, features, &mut self.all);
        let shown = view.camera.pixel_radians();
        if let Some(trained) = self.trained_radians.filter(|&trained| trained > shown) {
            widen(
                &mut self.all,
                view.centre,
                LOW_PASS * (trained * trained - shown * shown),
            );
        }
    }

    /// Returns the indices of the dynamic or of the static Gaussians.
    fn members(&self, view: &View, dynamic: bool) -> Vec<usize> {
        let (mut members, mut first) = (Vec::new(), 0);
        for part in &self.model.parts {
            let of_part = match part.parameterization.temporal() {
                Some(temporal) => {
                    let look = temporal.look(&Viewpoint::of_image(view));
                    temporal.members(&part.table, &look, dynamic)
                }
                // Gaussians of an object move with it.
                None if part.parameterization.tracked().is_some() != dynamic => Vec::new(),
                None => (0..part.table.len()).collect(),
            };
            members.extend(of_part.into_iter().map(|index| first + index));
            first += part.table.len();
        }
        members
    }

    /// Returns the indices of an object's Gaussians.
    fn members_of_object(&self, id: u32) -> Vec<usize> {
        let (mut members, mut first) = (Vec::new(), 0);
        for part in &self.model.parts {
            let ids = part
                .parameterization
                .tracked()
                .map(|tracked| tracked.ids(&part.table));
            let of_part = ids.iter().flatten().enumerate();
            members.extend(
                of_part
                    .filter(|&(_, &of)| of == id)
                    .map(|(index, _)| first + index),
            );
            first += part.table.len();
        }
        members
    }

    /// Renders the first feature maps, divided by the accumulated opacity.
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

/// Adds a variance, squared radians as seen from a place, to Gaussians: in all directions, so that rotations stay.
fn widen(gaussians: &mut ActivatedGaussians, from: Vec3, squared_radians: f32) {
    let places = gaussians.positions.par_iter();
    places
        .zip(&mut gaussians.scales)
        .for_each(|(place, scale)| {
            let variance = squared_radians * Vec3::from_array(*place).distance_squared(from);
            *scale = scale.map(|side| side.mul_add(side, variance).sqrt());
        });
}

/// Returns the speed below which [`SLOWER_SHARE`] of the Gaussians with their own times are; 1 without any.
fn largest_speed(model: &Model) -> f32 {
    let mut speeds = Vec::new();
    for part in &model.parts {
        if let Some(temporal) = part.parameterization.temporal() {
            let temporal_table = temporal
                .time
                .temporal_table(&part.table, temporal.world_observer());
            speeds.extend((0..part.table.len()).map(|index| {
                let temporal_parameters = temporal_table.temporal_parameters(index);
                temporal_parameters.velocity.length()
                    * temporal_parameters.steadiness(temporal.time.cycle_frames)
            }));
        }
    }
    speeds.sort_by(f32::total_cmp);
    let fast = speeds.get((SLOWER_SHARE * speeds.len() as f32) as usize);
    fast.copied().filter(|&speed| speed > 0.0).unwrap_or(1.0)
}

#[cfg(test)]
mod tests {
    use glam::{DQuat, DVec3};
    use omnilife_schemas::{Pose, Similarity, camera::ErpCamera};

    use super::*;
    use crate::gaussians::static_gaussians::{InitialGaussians, table};

    /// Returns the mean opacity of an image of `height` rows that shows a Gaussian far below a pixel, learnt with 32.
    fn mean_opacity(height: u32, is_trained: bool) -> f32 {
        let mut initial = InitialGaussians::default();
        initial.push_isotropic([0.0, 0.0, 2.0], 1e-4, [1.0; 3], 0.9);
        let model = Model::of_static(table(&initial, 0));
        let camera = |height: u32| Camera::Erp(ErpCamera::new(2 * height, height));
        let pose = Pose::new(DQuat::IDENTITY, DVec3::ZERO);
        let identity = Similarity::new([0.0; 3], 1.0);
        let Some(view) = View::new(camera(height), &pose, &identity, 0.0) else {
            panic!("a pose")
        };
        let layers = LayerRenderer::new(model, RenderSettings::new(1e-3));
        let mut layers = if is_trained {
            layers.trained_with(&camera(32))
        } else {
            layers
        };
        let image = layers.opacity(&view, Layer::All);
        image.data.iter().sum::<f32>() / image.data.len() as f32
    }

    #[test]
    fn finer_images_show_gaussians_as_large_as_trained_ones() {
        let trained = mean_opacity(32, true);
        assert_eq!(trained, mean_opacity(32, false));
        for height in [64, 128] {
            let ratio = mean_opacity(height, true) / trained;
            assert!((0.8..1.25).contains(&ratio), "{height}: {ratio}");
            assert!(mean_opacity(height, false) / trained < 0.4, "{height}");
        }
        // Coarser images have the filter of their own pixels.
        assert_eq!(mean_opacity(16, true), mean_opacity(16, false));
    }
}
