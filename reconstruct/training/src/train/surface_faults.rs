//! Ghosts and holes: errors of a model of Gaussians against a scene's known distances.
//!
//! A ghost lies where cameras see free space: its centre is in the free space of two input views or more. A hole
//! is a pixel with a known surface that is more than half transparent. Both are measured at the rows of the trace
//! and count as evaluation. They are neither loss nor score: a method that lifts the same distances starts with
//! hardly any of both.

use glam::Vec3;
use omnilife_engine::{
    camera::nearest::Projector,
    gaussians::ActivatedGaussians,
    render::{cpu::Renderer, settings::RenderSettings},
    training_view::TrainingView,
};
use omnilife_schemas::records::SurfaceFaults;
use rayon::prelude::*;

use super::trace_views::spread;
use crate::{
    error::ReconstructError,
    learner::Learner,
    scene::{TrainingScene, depth::PriorFile},
    seeds::depth::{SourceView, fit_scales, scaled, sees_past, tolerance},
};

/// Maximum number of input views for finding ghosts; evenly spread.
const MOST_GHOST_VIEWS: usize = 20;
/// Maximum number of views of a kind for finding holes; evenly spread.
const MOST_HOLE_VIEWS: usize = 4;
/// Minimum number of views with a ghost in their free space.
const GHOST_VIEWS: u16 = 2;
/// Opacity below which a pixel is a hole.
const HOLE_OPACITY: f32 = 0.5;

/// The views of a scene with known distances.
#[derive(Debug)]
pub(super) struct KnownSurfaces {
    /// Input views, with the factors of their best agreement.
    inputs: Vec<SourceView>,
    /// Novel views, for holes alone.
    novel: Vec<SourceView>,
    /// Maximum difference of two views' distances to one surface, as a share.
    tolerance: f32,
}

impl KnownSurfaces {
    /// Reads those of a scene; `None` if no input view has distances.
    ///
    /// # Errors
    /// When a file of distances is not usable.
    pub(super) fn of(scene: &TrainingScene) -> Result<Option<Self>, ReconstructError> {
        let known = |views: &[TrainingView], files: &[Option<PriorFile>], most: usize| {
            let with_file: Vec<_> = views
                .iter()
                .zip(files)
                .filter_map(|(view, file)| Some((view, file.as_ref()?)))
                .collect();
            spread(&with_file, most)
                .map(|(view, file)| {
                    let camera = view.view.camera;
                    let distances = file.read(&camera, &scene.normalization)?;
                    Ok(SourceView::on_one_grid(view, distances))
                })
                .collect::<Result<Vec<SourceView>, ReconstructError>>()
        };
        let mut inputs = known(&scene.input_views, &scene.depth_priors, MOST_GHOST_VIEWS)?;
        if inputs.is_empty() {
            return Ok(None);
        }
        let given: Vec<_> = inputs.iter().map(SourceView::as_given).collect();
        let fit = fit_scales(&given);
        scaled(&mut inputs, &fit);
        Ok(Some(Self {
            inputs,
            novel: known(
                &scene.novel_views,
                &scene.novel_depth_priors,
                MOST_HOLE_VIEWS,
            )?,
            tolerance: tolerance(fit.disagreement_after) as f32,
        }))
    }

    /// Measures a model's ghosts and holes; `None` for a model without Gaussians.
    pub(super) fn faults(
        &self,
        learner: &mut dyn Learner,
    ) -> Result<Option<SurfaceFaults>, ReconstructError> {
        let mut gaussians = ActivatedGaussians::default();
        let Some(ghost_share) = self.ghost_share(learner, &mut gaussians)? else {
            return Ok(None);
        };
        let inputs: Vec<&SourceView> = spread(&self.inputs, MOST_HOLE_VIEWS).collect();
        let novel: Vec<&SourceView> = self.novel.iter().collect();
        Ok(Some(SurfaceFaults {
            ghost_share,
            input_hole_share: hole_share(&inputs, learner, &mut gaussians)?,
            novel_hole_share: hole_share(&novel, learner, &mut gaussians)?,
        }))
    }

    /// Returns the share of the Gaussians, weighted by opacity, that lie in the free space of two views or more.
    /// Moving ones are compared with each view at its own time, with the mean of their opacities.
    fn ghost_share(
        &self,
        learner: &mut dyn Learner,
        gaussians: &mut ActivatedGaussians,
    ) -> Result<Option<f64>, ReconstructError> {
        let mut free: Vec<u16> = Vec::new();
        let mut opacities: Vec<f32> = Vec::new();
        for source in &self.inputs {
            if learner.activated(&source.view.view, gaussians)?.is_none() {
                return Ok(None);
            }
            free.resize(gaussians.positions.len(), 0);
            opacities.resize(gaussians.positions.len(), 0.0);
            let view = source.as_given();
            let projector = Projector::new(view.view);
            let of_gaussians = free.par_iter_mut().zip(&gaussians.positions);
            of_gaussians.for_each(|(free, &position)| {
                let place = Vec3::from_array(position);
                *free += u16::from(sees_past(&view, &projector, place, self.tolerance));
            });
            for (sum, opacity) in opacities.iter_mut().zip(&gaussians.opacities) {
                *sum += opacity;
            }
        }
        let (mut ghosts, mut all) = (0.0, 0.0);
        for (&free, &opacity) in free.iter().zip(&opacities) {
            all += f64::from(opacity);
            if free >= GHOST_VIEWS {
                ghosts += f64::from(opacity);
            }
        }
        Ok(Some(if all > 0.0 { ghosts / all } else { 0.0 }))
    }
}

/// Returns the share of the pixels with a known distance, masked ones left out, whose opacity is below a half;
/// `None` without such pixels.
fn hole_share(
    views: &[&SourceView],
    learner: &mut dyn Learner,
    gaussians: &mut ActivatedGaussians,
) -> Result<Option<f64>, ReconstructError> {
    let (mut holes, mut known) = (0_u64, 0_u64);
    for source in views {
        let Some(near) = learner.activated(&source.view.view, gaussians)? else {
            return Ok(None);
        };
        let mut renderer = Renderer::new(RenderSettings::new(near));
        let raster = renderer.forward(&source.view.view, gaussians);
        let view = source.as_given();
        let pixels = raster.transmittance.iter().zip(&view.distances.values);
        for (pixel, (transmittance, distance)) in pixels.enumerate() {
            if *distance > 0.0 && !view.hides(pixel) {
                known += 1;
                holes += u64::from(1.0 - transmittance < HOLE_OPACITY);
            }
        }
    }
    Ok((known > 0).then(|| holes as f64 / known as f64))
}
