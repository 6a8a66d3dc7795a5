//! A short static training, and input views next to its renders: the source of a plan's evidence.

use glam::{Vec3, dvec2};
use omnilife_schemas::{camera::CameraModel, progress::Silent, statistics::median};
use rayon::prelude::*;

use crate::{
    baseline::{self, SHORT_SCHEDULE},
    error::ReconstructError,
    evidence::{
        PILOT_ITERATIONS,
        changing_light::ChangingLight,
        coverage::Coverage,
        exposure::{ExposureEvidence, ViewBlocks},
        flat_surfaces::{FlatSurfaces, Observation},
        motion::{ChangingPoints, MotionEvidence, transients},
        poses::PoseEvidence,
        rendered_view::{Patch, RenderedView},
        view_dependence::ViewDependence,
    },
    learner::{Learner, gaussians::GaussianLearner},
    options::Options,
    request::{BackendChoice, MethodRequest},
    scene::TrainingScene,
    seeds::points,
    train::{self, Session},
};
use omnilife_engine::{
    camera::{Camera, View},
    gaussians::{ActivatedGaussians, static_gaussians},
    model::{Model, exposure::Exposure},
    render::cpu::Renderer,
    step::settings::TrainSettings,
};

/// Maximum number of Gaussians of the pilot fit.
const MAXIMUM_GAUSSIANS: u64 = 10_000;
/// Maximum width of examined views, enough to show moving objects, pixels.
pub(super) const WIDTH: u32 = 256;
/// Iterations in views of half that width, which show colours and coarse shapes as well, and cost less,
const COARSE_ITERATIONS: u64 = 80;
/// and after these in views of the whole width.
const FINE_ITERATIONS: u64 = PILOT_ITERATIONS - COARSE_ITERATIONS;
/// Arrays whose steps are a share of those of a short schedule. Colours that follow the tone of the last view,
/// and Gaussians that grow over local differences, would absorb gains into the fit.
const SLOWER: &[(&str, f32)] = &[("sh_constant", 1.0 / 7.0), ("log_scales", 0.25)];
/// Maximum number of examined points and views, evenly from all.
const POINTS: usize = 4_000;
const VIEWS: usize = 30;
/// Pixels between candidates for flat surfaces.
const GRID_STEP: usize = 8;
/// Half of the averaging window for motion, as a share of the images' width. A moving object is wrong all over;
/// an edge that the fit blurs is wrong on both sides, with both signs.
const MOTION_REACH_SHARE: f32 = 4.0 / 256.0;

/// Input views next to the renders of a short static training.
#[derive(Debug)]
pub struct PilotFit {
    /// The scene at the examined size, with its own points: the limits of the evidence were measured with those.
    scene: TrainingScene,
    /// Camera of the images of the training.
    trained: Camera,
    /// All points, including added ones.
    places: Vec<[f32; 3]>,
    views: Vec<RenderedView>,
    gaussians: ActivatedGaussians,
    renderer: Renderer,
    /// Gains that were removed from the views.
    taken_out: Option<Exposure>,
}

impl PilotFit {
    /// Trains static Gaussians for a short while and renders views.
    ///
    /// # Errors
    /// When the training diverges.
    pub fn of(scene: &TrainingScene, seed: u64) -> Result<Self, ReconstructError> {
        let trained = scene.camera;
        let mut scene = scene.reduced(WIDTH);
        // The trace's scores of novel views are not needed.
        scene.novel_views.clear();
        let places = scene.points.positions.clone();
        scene.leave_added_points_out();
        let settings = pilot_settings(&scene, COARSE_ITERATIONS, seed);
        let mut model = baseline::static_model(&scene, &settings);
        let coarse = scene.reduced(WIDTH / 2);
        fit(&coarse, &mut model, settings)?;
        let settings = pilot_settings(&scene, FINE_ITERATIONS, seed);
        let mut renderer = Renderer::new(settings.rendering);
        fit(&scene, &mut model, settings)?;
        let mut gaussians = ActivatedGaussians::default();
        for part in &model.parts {
            static_gaussians::activate(&part.table, &mut gaussians);
        }
        let all = scene.input_views.len();
        let views = (0..all.min(VIEWS))
            .map(|step| {
                let number = step * all / all.min(VIEWS);
                let view = &scene.input_views[number];
                RenderedView::new(number, view, &mut gaussians, &mut renderer)
            })
            .collect();
        Ok(Self {
            scene,
            trained,
            places,
            views,
            gaussians,
            renderer,
            taken_out: None,
        })
    }

    /// Returns the evidence of motion, by some of the scene's points.
    pub fn motion(&self) -> MotionEvidence {
        let points = self.some_points();
        let reach = (self.scene.camera.width() as f32 * MOTION_REACH_SHARE).round() as usize;
        transients(&self.residuals(&points, reach.max(1)), self.median_level())
    }

    /// Returns the points of all that change outside the masks, and the numbers of views that see the scene's own
    /// points.
    pub fn points(&self) -> (ChangingPoints, Coverage) {
        let residuals = self.residuals(&self.places, 1);
        let given = self.scene.points.len();
        let seen: Vec<usize> = residuals[..3 * given]
            .iter()
            .step_by(3)
            .map(Vec::len)
            .collect();
        let input_views = self.scene.input_views.len();
        let coverage = Coverage::of(&seen, self.views.len(), input_views);
        (
            ChangingPoints::of(&residuals, self.median_level()),
            coverage,
        )
    }

    /// Returns the evidence of view-dependent colours, and of changing light.
    pub fn colours(&self) -> (ViewDependence, ChangingLight) {
        let flat = self.flat_colours();
        (ViewDependence::of(&flat), ChangingLight::of(&flat))
    }

    fn flat_colours(&self) -> FlatSurfaces {
        let surfaces = self.flat_surfaces();
        let mut series: Vec<Vec<Observation>> = vec![Vec::new(); surfaces.len()];
        for rendered in &self.views {
            let view = self.view(rendered);
            let seen: Vec<Option<Observation>> = surfaces
                .par_iter()
                .map(|&surface| rendered.flat_colour(&self.scene, view, surface))
                .collect();
            for (series, seen) in series.iter_mut().zip(seen) {
                series.extend(seen);
            }
        }
        FlatSurfaces::of(series)
    }

    /// Returns the places of flat surfaces in every other view, on a grid of its pixels.
    fn flat_surfaces(&self) -> Vec<Vec3> {
        let mut surfaces = Vec::new();
        for rendered in self.views.iter().step_by(2) {
            let view = self.view(rendered);
            let columns = match self.scene.camera {
                Camera::Erp(_) => 0..rendered.width,
                Camera::Pinhole(_) => GRID_STEP..rendered.width.saturating_sub(GRID_STEP),
            };
            for row in (GRID_STEP..rendered.height.saturating_sub(GRID_STEP)).step_by(GRID_STEP) {
                for column in columns.clone().step_by(GRID_STEP) {
                    let depth = rendered.depth[row * rendered.width + column];
                    if depth.is_finite() && rendered.is_flat([column, row]) {
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

    /// Returns the brightness of the views; `None` where too few of them can be compared. If gains drift, all
    /// input views are examined: one that flickers gives no evidence of the views between.
    pub fn exposure(&mut self) -> Option<ExposureEvidence> {
        let views = self.views.iter();
        let mut views: Vec<_> = views.map(|rendered| self.blocks(rendered)).collect();
        let of_some = ExposureEvidence::of(&views)?;
        if !of_some.is_worth_compensating() {
            return Some(of_some);
        }
        let looked_at: Vec<usize> = self.views.iter().map(|rendered| rendered.number).collect();
        let others = (0..self.scene.input_views.len()).filter(|number| !looked_at.contains(number));
        for number in others {
            let view = &self.scene.input_views[number];
            let (gaussians, renderer) = (&mut self.gaussians, &mut self.renderer);
            let rendered = RenderedView::new(number, view, gaussians, renderer);
            views.push(self.blocks(&rendered));
        }
        Some(of_some.with_gains_of(&views))
    }

    fn blocks(&self, rendered: &RenderedView) -> ViewBlocks {
        let seconds = self.view(rendered).time_seconds;
        (seconds, rendered.blocks(&self.scene.camera))
    }

    /// Removes gains from the views, once.
    pub fn normalize(&mut self, exposure: Exposure) {
        for rendered in &mut self.views {
            let view = &self.scene.input_views[rendered.number].view;
            rendered.normalize(&exposure, view.time_seconds);
        }
        self.taken_out = Some(exposure);
    }

    /// Returns the errors of the views' poses, by the displacements of some of the scene's points.
    pub fn poses(&self) -> PoseEvidence {
        let points = self.some_points();
        let views = self.views.iter().map(|rendered| {
            let view = self.view(rendered);
            let observations = points.par_iter().map(|&point| {
                rendered.pose_observation(&self.scene, view, Vec3::from_array(point))
            });
            (view.centre, observations.collect())
        });
        PoseEvidence::of(views.collect(), &self.scene.camera, &self.trained)
    }

    /// Compares the views with renders from their corrected poses: a displaced edge is not a change of the scene.
    pub fn correct_poses(&mut self, evidence: &PoseEvidence) {
        for (rendered, correction) in self.views.iter_mut().zip(&evidence.corrections) {
            let Some(correction) = correction else {
                continue;
            };
            let view = &mut self.scene.input_views[rendered.number];
            view.view = correction.apply(&view.view);
            let (gaussians, renderer) = (&mut self.gaussians, &mut self.renderer);
            *rendered = RenderedView::new(rendered.number, view, gaussians, renderer);
            if let Some(exposure) = &self.taken_out {
                rendered.normalize(exposure, view.view.time_seconds);
            }
        }
    }

    /// Returns the median of the views' median levels, 0 to 1.
    fn median_level(&self) -> f32 {
        let levels = self.views.iter().map(RenderedView::median_level);
        median(&levels.collect::<Vec<f32>>()).unwrap_or_default()
    }

    fn some_points(&self) -> Vec<[f32; 3]> {
        points::thinned(&self.scene.points, POINTS).positions
    }

    fn view(&self, rendered: &RenderedView) -> &View {
        &self.scene.input_views[rendered.number].view
    }

    fn patches(
        &self,
        rendered: &RenderedView,
        points: &[[f32; 3]],
        reach: usize,
    ) -> Vec<Option<Patch>> {
        let view = self.view(rendered);
        points
            .par_iter()
            .map(|&point| rendered.patch(&self.scene, view, Vec3::from_array(point), reach))
            .collect()
    }

    /// Returns the residuals of the views in which a point is visible: one series per point and channel.
    fn residuals(&self, points: &[[f32; 3]], reach: usize) -> Vec<Vec<f32>> {
        let mut residuals: Vec<Vec<f32>> = vec![Vec::new(); 3 * points.len()];
        for rendered in &self.views {
            let patches = self.patches(rendered, points, reach).into_iter();
            for (point, patch) in patches.enumerate() {
                for (channel, residual) in patch.iter().flat_map(|patch| patch.residual).enumerate()
                {
                    residuals[3 * point + channel].push(residual);
                }
            }
        }
        residuals
    }
}

/// Returns the settings of a part of the pilot fit: steps are as large as in the shortest of schedules, but for
/// [`SLOWER`].
fn pilot_settings(scene: &TrainingScene, iterations: u64, seed: u64) -> TrainSettings {
    let request = MethodRequest {
        options: Options::at_most(MAXIMUM_GAUSSIANS),
        trace_every: Some(iterations),
        ..MethodRequest::new(iterations, seed)
    };
    let mut settings = baseline::settings(scene, &request);
    for (array, share) in SLOWER {
        if let Some(rate) = settings.learning_rates.get_mut(*array) {
            rate.published.begin *= share;
            rate.published.end *= share;
        }
    }
    settings.short_schedule = Some(SHORT_SCHEDULE);
    settings
}

/// Trains Gaussians on a scene's input views.
fn fit(
    scene: &TrainingScene,
    model: &mut Model,
    settings: TrainSettings,
) -> Result<(), ReconstructError> {
    let session = Session::without_files(&Silent);
    let (length, begun) = ((&settings).into(), std::mem::take(model));
    let mut learner = GaussianLearner::new(scene, begun, settings, BackendChoice::Cpu)?;
    train::train(scene, &mut learner, length, &session)?;
    model.clone_from(learner.gaussians()?.unwrap_or(&Model::default()));
    Ok(())
}
