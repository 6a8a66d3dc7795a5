//! A short static training, and input views beside its renders: what a plan's evidence is found in.
//!
//! [`crate::evidence::motion`]: whether anything moves; [`omnilife_engine::model::exposure`]: how bright the views are;
//! [`crate::evidence::poses`]: how far their poses are off; [`crate::evidence::view_dependence`]: whether colours
//! depend on the direction.

use glam::{Vec3, dvec2, vec2};
use omnilife_schemas::{camera::CameraModel, progress::Silent};
use rayon::prelude::*;

use crate::{
    error::ReconstructError,
    evidence::{
        motion::{ChangingPoints, MotionEvidence, transients},
        poses::{Clue, PoseEvidence},
        view_dependence::{FLAT, Seen, ViewDependence},
    },
    learner::{Learner, gaussians::GaussianLearner},
    methods::odgs,
    options::Options,
    request::{BackendChoice, MethodRequest},
    scene::TrainingScene,
    seeds::points,
    train::{self, Session},
};
use omnilife_engine::{
    camera::{View, erp, horizontal},
    gaussians::{InstantGaussians, static_gaussians},
    model::exposure::Exposure,
    render::cpu::Renderer,
    training_view::TrainingView,
};

/// Iterations of the warm-up: enough for colours and coarse shapes.
pub const WARM_UP_ITERATIONS: u64 = 150;
/// Gaussians of the warm-up, at most.
const WARM_UP_GAUSSIANS: u64 = 12_000;
/// Views of the warm-up are no wider than they have to be to show what moves, pixels.
const WARM_UP_WIDTH: u32 = 256;
/// Points and views that are looked at, evenly from all.
const POINTS: usize = 4_000;
const VIEWS: usize = 30;
/// Pixels between those at which flat surfaces are looked for.
const GRID_STEP: usize = 8;
/// A point is visible when it is no farther than this over the rendered depth,
const DEPTH_SLACK: f32 = 1.05;
/// where at least this much of the pixel is covered.
const LEAST_OPACITY: f32 = 0.5;
/// Half of the window, in turns, over which a sample is averaged to tell whether anything moves: what
/// moves is wrong all over, an edge that the warm-up blurs is wrong on both sides, with both signs.
const MOTION_REACH_TURNS: f32 = 4.0 / 256.0;
/// Distance from the vertical axis, over that from the camera, below which a point says nothing of a
/// pose: there the neighbours in a row of pixels hardly differ.
const LEAST_HORIZONTAL: f32 = 0.2;

/// Input views beside the renders of a short static training.
#[derive(Debug)]
pub struct WarmUp {
    /// The scene at the size that it was looked at.
    scene: TrainingScene,
    views: Vec<Compared>,
    /// What the views are compared with.
    gaussians: InstantGaussians,
    renderer: Renderer,
    exposure: Option<Exposure>,
    is_normalized: bool,
    poses: Option<PoseEvidence>,
    is_corrected: bool,
}

impl WarmUp {
    /// Trains static Gaussians for a short while and renders views.
    ///
    /// # Errors
    /// When the training diverges.
    pub fn of(scene: &TrainingScene, seed: u64) -> Result<Self, ReconstructError> {
        let mut scene = scene.reduced(WARM_UP_WIDTH);
        // Nobody asks how they look.
        scene.novel_views.clear();
        let request = MethodRequest {
            options: Options::at_most(WARM_UP_GAUSSIANS),
            trace_every: Some(WARM_UP_ITERATIONS),
            ..MethodRequest::new(WARM_UP_ITERATIONS, seed)
        };
        let session = Session::without_files(&Silent);
        let mut gaussians = InstantGaussians::default();
        let prepared = odgs::prepare(&scene, &request, BackendChoice::Cpu)?;
        let (settings, length) = (prepared.settings.clone(), (&prepared.settings).into());
        let mut renderer = Renderer::new(settings.rendering);
        let mut learner =
            GaussianLearner::new(&scene, prepared.model, settings, BackendChoice::Cpu)?;
        train::train(&scene, &mut learner, length, &session)?;
        for part in learner.gaussians()?.iter().flat_map(|model| &model.parts) {
            static_gaussians::instantiate(&part.table, &mut gaussians);
        }
        drop(learner);
        let all = scene.input_views.len();
        let views = (0..all.min(VIEWS))
            .map(|step| {
                let number = step * all / all.min(VIEWS);
                let view = &scene.input_views[number];
                Compared::new(number, view, &mut gaussians, &mut renderer)
            })
            .collect();
        let mut warm_up = Self {
            scene,
            views,
            gaussians,
            renderer,
            exposure: None,
            is_normalized: false,
            poses: None,
            is_corrected: false,
        };
        warm_up.exposure = warm_up.estimated_exposure();
        Ok(warm_up)
    }

    /// Whether anything moves, by some of the scene's points.
    pub fn motion(&self) -> MotionEvidence {
        let points = points::thinned(&self.scene.points, POINTS).positions;
        let reach = (self.scene.camera.width as f32 * MOTION_REACH_TURNS).round() as usize;
        transients(&self.residuals(&points, reach.max(1)))
    }

    /// Tells at which points something changes outside the masks.
    pub fn changing(&self, points: &[[f32; 3]]) -> ChangingPoints {
        ChangingPoints::of(&self.residuals(points, 1))
    }

    /// Whether colours depend on the direction from which they are seen.
    pub fn view_dependence(&self) -> ViewDependence {
        let surfaces = self.flat_surfaces();
        let mut series: Vec<Vec<Seen>> = vec![Vec::new(); surfaces.len()];
        for compared in &self.views {
            let view = self.view(compared);
            let seen: Vec<Option<Seen>> = surfaces
                .par_iter()
                .map(|&surface| compared.flat_colour(&self.scene, view, surface))
                .collect();
            for (series, seen) in series.iter_mut().zip(seen) {
                series.extend(seen);
            }
        }
        ViewDependence::of(&series)
    }

    /// Where every other view shows something flat, on a grid of its pixels.
    fn flat_surfaces(&self) -> Vec<Vec3> {
        let mut surfaces = Vec::new();
        for compared in self.views.iter().step_by(2) {
            let view = self.view(compared);
            for row in (GRID_STEP..compared.height.saturating_sub(GRID_STEP)).step_by(GRID_STEP) {
                for column in (0..compared.width).step_by(GRID_STEP) {
                    let depth = compared.depth[row * compared.width + column];
                    if depth.is_finite() && compared.is_flat([column, row]) {
                        let middle = dvec2(column as f64 + 0.5, row as f64 + 0.5);
                        let direction = self.scene.camera.unproject(middle).as_vec3();
                        let offset = view.rotation.transpose() * direction * depth;
                        surfaces.push(view.centre + offset);
                    }
                }
            }
        }
        surfaces
    }

    /// How bright the views are; `None` where too few points are seen.
    pub fn exposure(&self) -> Option<&Exposure> {
        self.exposure.as_ref()
    }

    fn estimated_exposure(&self) -> Option<Exposure> {
        let points = points::thinned(&self.scene.points, POINTS).positions;
        let views: Vec<(f64, Vec<[[f32; 3]; 2]>)> = self
            .views
            .iter()
            .map(|compared| {
                let pairs = self.samples(compared, &points, 1).into_iter().flatten();
                let pairs = pairs.map(|sample| [sample.shown, sample.rendered()]);
                (self.view(compared).time_seconds, pairs.collect())
            })
            .collect();
        Exposure::estimate(&views)
    }

    /// How far the views' poses are off, by what some of the scene's points show beside where they
    /// should; as it was when they were looked at first.
    pub fn poses(&mut self) -> PoseEvidence {
        if let Some(found) = &self.poses {
            return found.clone();
        }
        let points = points::thinned(&self.scene.points, POINTS).positions;
        let views = self.views.iter().map(|compared| {
            let view = self.view(compared);
            let clues = points
                .par_iter()
                .map(|&point| compared.clue(&self.scene, view, Vec3::from_array(point)));
            (view.centre, clues.collect())
        });
        let found = PoseEvidence::of(views.collect(), self.scene.camera.width);
        self.poses.insert(found).clone()
    }

    /// Compares the views with renders from where they were taken, where their poses are off, once: an
    /// edge beside its place is no change of the scene.
    pub fn correct_poses(&mut self) {
        let found = self.poses();
        if self.is_corrected || !found.are_off() {
            return;
        }
        self.is_corrected = true;
        for (compared, correction) in self.views.iter_mut().zip(found.corrections) {
            let Some(correction) = correction else {
                continue;
            };
            let view = &mut self.scene.input_views[compared.number];
            view.view = correction.apply(&view.view);
            let (gaussians, renderer) = (&mut self.gaussians, &mut self.renderer);
            *compared = Compared::new(compared.number, view, gaussians, renderer);
            if let Some(exposure) = self.exposure.as_ref().filter(|_| self.is_normalized) {
                compared.normalize(exposure, view.view.time_seconds);
            }
        }
    }

    /// Takes the gains out of what the views show, once.
    pub fn normalize(&mut self) {
        if let Some(exposure) = self.exposure.as_ref().filter(|_| !self.is_normalized) {
            for compared in &mut self.views {
                let view = &self.scene.input_views[compared.number].view;
                compared.normalize(exposure, view.time_seconds);
            }
            self.is_normalized = true;
        }
    }

    fn view(&self, compared: &Compared) -> &View {
        &self.scene.input_views[compared.number].view
    }

    fn samples(
        &self,
        compared: &Compared,
        points: &[[f32; 3]],
        reach: usize,
    ) -> Vec<Option<Sample>> {
        let view = self.view(compared);
        points
            .par_iter()
            .map(|&point| compared.sample(&self.scene, view, Vec3::from_array(point), reach))
            .collect()
    }

    /// Residuals of the views in which a point is seen: one series per point and channel.
    fn residuals(&self, points: &[[f32; 3]], reach: usize) -> Vec<Vec<f32>> {
        let mut residuals: Vec<Vec<f32>> = vec![Vec::new(); 3 * points.len()];
        for compared in &self.views {
            let samples = self.samples(compared, points, reach).into_iter();
            for (point, sample) in samples.enumerate() {
                for (channel, residual) in sample.iter().flat_map(|s| s.residual).enumerate() {
                    residuals[3 * point + channel].push(residual);
                }
            }
        }
        residuals
    }
}

/// What a view shows at a point: means over a window.
#[derive(Debug, Clone, Copy)]
struct Sample {
    shown: [f32; 3],
    /// Shown minus rendered.
    residual: [f32; 3],
}

impl Sample {
    fn rendered(&self) -> [f32; 3] {
        [0, 1, 2].map(|channel| self.shown[channel] - self.residual[channel])
    }
}

/// A view beside its render.
#[derive(Debug)]
struct Compared {
    /// Its number among the input views.
    number: usize,
    width: usize,
    height: usize,
    /// The image.
    shown: Vec<[f32; 3]>,
    /// Image minus render; not a number where a mask says that something else is seen.
    difference: Vec<[f32; 3]>,
    /// Radial depth, infinite where little is rendered.
    depth: Vec<f32>,
}

impl Compared {
    fn new(
        number: usize,
        view: &TrainingView,
        gaussians: &mut InstantGaussians,
        renderer: &mut Renderer,
    ) -> Self {
        let centre = view.view.centre;
        gaussians.feature_count = 1;
        gaussians.features = gaussians
            .positions
            .iter()
            .map(|&position| (Vec3::from_array(position) - centre).length())
            .collect();
        let raster = renderer.forward(&view.view, gaussians);
        let (mut image, mut mask) = (Vec::new(), Vec::new());
        view.write_image(&mut image);
        view.write_mask(&mut mask);
        let pixels = image
            .as_chunks::<3>()
            .0
            .iter()
            .zip(raster.colour.as_chunks::<3>().0);
        Self {
            number,
            shown: image.as_chunks::<3>().0.to_vec(),
            width: raster.width,
            height: raster.height,
            difference: pixels
                .zip(&mask)
                .map(|((truth, render), &masked)| {
                    let hole = if masked > 0.0 { f32::NAN } else { 0.0 };
                    [0, 1, 2].map(|channel| truth[channel] - render[channel] + hole)
                })
                .collect(),
            depth: raster
                .features
                .iter()
                .zip(&raster.transmittance)
                .map(|(depth, transmittance)| {
                    let opacity = 1.0 - transmittance;
                    if opacity > LEAST_OPACITY {
                        depth / opacity
                    } else {
                        f32::INFINITY
                    }
                })
                .collect(),
        }
    }

    /// Takes a gain out of the image.
    fn normalize(&mut self, exposure: &Exposure, seconds: f64) {
        let gain = exposure.gain(seconds);
        for (shown, difference) in self.shown.iter_mut().zip(&mut self.difference) {
            for channel in 0..3 {
                let normalized = shown[channel] / gain[channel];
                difference[channel] += normalized - shown[channel];
                shown[channel] = normalized;
            }
        }
    }

    /// The pixel of a point `offset` from the camera in its frame, at least `margin` pixels from the upper
    /// and lower border; `None` where the point is hidden.
    fn visible_pixel(
        &self,
        scene: &TrainingScene,
        offset: Vec3,
        margin: usize,
    ) -> Option<[usize; 2]> {
        let distance = offset.length();
        if distance <= 0.0 || self.height <= 2 * margin || self.width <= margin {
            return None;
        }
        let pixel = erp::project(&scene.camera, offset, distance).pixel;
        let column = (pixel.x as usize).min(self.width - 1);
        let row = (pixel.y as usize).clamp(margin, self.height - 1 - margin);
        let is_visible = distance <= DEPTH_SLACK * self.depth[row * self.width + column];
        is_visible.then_some([column, row])
    }

    /// Mean of the pixels within `reach` of one, which is as far from the upper and lower border; not a
    /// number where a mask covers one of them.
    fn mean(&self, [column, row]: [usize; 2], reach: usize) -> Sample {
        let (mut shown, mut residual) = ([0.0; 3], [0.0; 3]);
        for row in row - reach..=row + reach {
            for step in self.width - reach..=self.width + reach {
                let pixel = row * self.width + (column + step) % self.width;
                for channel in 0..3 {
                    shown[channel] += self.shown[pixel][channel];
                    residual[channel] += self.difference[pixel][channel];
                }
            }
        }
        let pixels = ((2 * reach + 1) * (2 * reach + 1)) as f32;
        Sample {
            shown: shown.map(|sum| sum / pixels),
            residual: residual.map(|sum| sum / pixels),
        }
    }

    /// Means of the pixels within `reach` of a point's image: a pixel alone has the error of every edge
    /// that it lies on. `None` where the point is hidden, or masked.
    fn sample(
        &self,
        scene: &TrainingScene,
        view: &View,
        point: Vec3,
        reach: usize,
    ) -> Option<Sample> {
        let offset = view.rotation * (point - view.centre);
        let pixel = self.visible_pixel(scene, offset, reach)?;
        let sample = self.mean(pixel, reach);
        (!sample.residual[0].is_nan()).then_some(sample)
    }

    /// Whether next to one colour is shown around a pixel.
    fn is_flat(&self, [column, row]: [usize; 2]) -> bool {
        let (mut least, mut largest) = ([f32::INFINITY; 3], [f32::NEG_INFINITY; 3]);
        for row in row - 1..=row + 1 {
            for step in self.width - 1..=self.width + 1 {
                let shown = self.shown[row * self.width + (column + step) % self.width];
                for channel in 0..3 {
                    least[channel] = least[channel].min(shown[channel]);
                    largest[channel] = largest[channel].max(shown[channel]);
                }
            }
        }
        (0..3).all(|channel| largest[channel] - least[channel] < FLAT)
    }

    /// The colour of a surface, where it is seen and looks flat.
    fn flat_colour(&self, scene: &TrainingScene, view: &View, surface: Vec3) -> Option<Seen> {
        let offset = surface - view.centre;
        let pixel = self.visible_pixel(scene, view.rotation * offset, 1)?;
        let sample = self.mean(pixel, 1);
        (!sample.residual[0].is_nan() && self.is_flat(pixel)).then(|| Seen {
            direction: offset.normalize_or_zero(),
            colour: sample.shown,
        })
    }

    /// What a point says of the view's pose. `None` where it is hidden, masked, or near a pole.
    fn clue(&self, scene: &TrainingScene, view: &View, point: Vec3) -> Option<Clue> {
        let offset = view.rotation * (point - view.centre);
        let distance = offset.length();
        if horizontal(offset) < LEAST_HORIZONTAL * distance {
            return None;
        }
        let [column, row] = self.visible_pixel(scene, offset, 2)?;
        let rendered = |columns: usize, rows: usize| {
            let pixel = [
                (column + self.width + columns - 1) % self.width,
                row + rows - 1,
            ];
            self.mean(pixel, 1).rendered()
        };
        let [left, right, up, down] = [
            rendered(0, 1),
            rendered(2, 1),
            rendered(1, 0),
            rendered(1, 2),
        ];
        let residual = self.mean([column, row], 1).residual;
        let projection = erp::project(&scene.camera, offset, distance);
        let to_world = view.rotation.transpose();
        // How each channel changes towards where the point would be seen if it moved in the world.
        let by_point = [0, 1, 2].map(|channel| {
            let slope = 0.5 * vec2(right[channel] - left[channel], down[channel] - up[channel]);
            to_world * (projection.jacobian_u * slope.x + projection.jacobian_v * slope.y)
        });
        let is_whole = residual[0].is_finite() && by_point.iter().all(|by| by.is_finite());
        is_whole.then(|| Clue::new(point - view.centre, by_point, residual))
    }
}
