//! Record of a lift: counts of the pixels of each view by their use.

use glam::{DVec3, Vec3};
use omnilife_schemas::{
    Similarity,
    records::{Lift, LiftedView},
};

use super::samples::{SampleChoice, Samples, ScaleAgreement};
use omnilife_training::{
    scene::TrainingScene,
    seeds::depth::{SurfaceSamples, tolerance},
};

/// Returns the record without the numbers that [`completed`] fills in.
pub(super) fn begun(
    scene: &TrainingScene,
    origin: &str,
    agreed: &ScaleAgreement,
    chosen: &SampleChoice,
) -> Lift {
    let views = scene.input_views.iter().zip(&agreed.factors);
    let views = views.zip(&chosen.lifted).map(|((view, &factor), lifted)| {
        let (counts, kept) = (&lifted.counts, lifted.len() as u64);
        let refused = counts.unknown + counts.masked + counts.thinned + counts.flying;
        LiftedView {
            frame: view.frame,
            factor,
            pixels: counts.pixels,
            unknown: counts.unknown,
            masked: counts.masked,
            thinned: counts.thinned,
            flying: counts.flying,
            redundant: counts.pixels - refused - kept,
            kept,
            without_normal: counts.without_normal,
        }
    });
    Lift {
        scene: scene.id.clone(),
        distances: origin.to_owned(),
        disagreement_before: agreed.before,
        disagreement: agreed.disagreement,
        tolerance: tolerance(agreed.disagreement),
        ghost_share: chosen.ghost_share,
        tangential_radii: f64::from(chosen.shape.tangential),
        normal_radii: f64::from(chosen.shape.normal),
        opacity: f64::from(chosen.shape.opacity),
        median_radius: 0.0,
        bounds: bounds(&chosen.lifted, &scene.normalization),
        samples: chosen.lifted.iter().map(|lifted| lifted.len() as u64).sum(),
        gaussians: 0,
        sky: 0,
        views: views.collect(),
    }
}

/// Completes the record with a run's first samples.
pub(super) fn completed(mut lift: Lift, scene: &TrainingScene, samples: &Samples) -> Lift {
    lift.median_radius = f64::from(samples.median_radius) / scene.normalization.scale;
    lift.gaussians = samples.gaussians.len() as u64;
    lift.sky = samples.sky as u64;
    lift
}

/// Returns the corners of the smallest box around all samples, world.
fn bounds(lifted: &[SurfaceSamples], normalization: &Similarity) -> [[f64; 3]; 2] {
    let places = lifted.iter().flat_map(|lifted| &lifted.gaussians.positions);
    let (least, greatest) = places.fold(
        (Vec3::INFINITY, Vec3::NEG_INFINITY),
        |(least, greatest), &position| {
            let place = Vec3::from_array(position);
            (least.min(place), greatest.max(place))
        },
    );
    [least, greatest].map(|corner| {
        let world: DVec3 = normalization.restore(corner.as_dvec3());
        world.to_array()
    })
}
