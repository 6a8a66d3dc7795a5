//! Vehicles with tracks: Gaussians that rest in their boxes and move along their paths, beside those with times of
//! their own.
//!
//! A Gaussian with a lifespan is learnt from the views in its life, and moves nearly straight. One of a vehicle is
//! learnt from all views, and is where its path is between them. So vehicles gain where views are far apart in time.

use omnilife_engine::{
    gaussians::tracked::{self, OBJECT_POSES, OBJECT_POSITIONS, TrackedGaussians},
    model::Part,
    parameters::{
        decay::Decay,
        short_schedule::{Growth, LearningRate},
    },
};
use omnilife_schemas::records::Tracks;
use omnilife_training::{
    components::{Decision, Draft},
    method::PreparedGaussians,
    request::BackendChoice,
    scene::TrainingScene,
};

use crate::object_graph::{
    LEAST_POSE_RATE, POSITION_RATE,
    initial::{self, FirstObjects},
};

/// Component: vehicles with tracks have Gaussians of their own.
pub(crate) const ID: &str = "tracked-objects";

/// Decides on the component, and reserves room for its Gaussians; none where it is not used.
pub(crate) fn drafted(
    draft: &mut Draft<'_>,
    scene: &TrainingScene,
    backend: BackendChoice,
) -> FirstObjects {
    let tracks = scene.tracks.as_ref();
    let missing = match tracks {
        Some(tracks) if !tracks.tracks.is_empty() => {
            (backend != BackendChoice::Cpu).then_some("the CPU: a GPU has no features of objects")
        }
        _ => Some("tracks of what moves"),
    };
    let decision = tracks.map_or_else(|| Decision::new(false, "no tracks"), by_tracks);
    let used = draft.decide(ID, decision.unless(missing));
    let Some(tracks) = tracks.filter(|_| used) else {
        return FirstObjects::default();
    };
    let limit = draft.settings.densify.maximum_gaussians;
    let first = initial::objects(scene, tracks, limit);
    draft.reserved = first.gaussians.len() as u64;
    first
}

fn by_tracks(tracks: &Tracks) -> Decision {
    Decision::new(true, format!("{} objects have tracks", tracks.tracks.len()))
}

/// Adds the Gaussians to a model.
pub(crate) fn add(prepared: &mut PreparedGaussians, first: FirstObjects, scene: &TrainingScene) {
    prepared.findings.warnings.extend(first.warnings);
    if first.objects.is_empty() {
        return;
    }
    prepared.findings.warnings.extend(scene.held_out_tracks());
    prepared.settings.objects = true;
    let positions = LearningRate::new(POSITION_RATE, Growth::LASTING);
    let rates = &mut prepared.settings.learning_rates;
    rates.insert(OBJECT_POSITIONS.to_owned(), positions);
    // Paths are not corrected, and a model has rates of all its arrays.
    let poses = LearningRate::unchanged(Decay::constant(LEAST_POSE_RATE));
    rates.insert(OBJECT_POSES.to_owned(), poses);
    let table = tracked::table(&first.gaussians, &first.numbers);
    let objects = TrackedGaussians::new(first.objects, false);
    prepared.model.parts.push(Part::new(objects, table));
}
