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
use omnilife_schemas::records::{ObjectClass, Tracks};
use omnilife_training::{
    components::{Decision, Draft},
    method::PreparedGaussians,
    scene::TrainingScene,
};

use crate::object_graph::{
    LEAST_POSE_RATE, POSITION_RATE,
    initial::{self, FirstObjects},
};

/// Component: vehicles with tracks have Gaussians of their own.
pub(crate) const ID: &str = "tracked-objects";

/// Maximum number of a vehicle's first Gaussians for each pixel of the view that shows it largest. More of them took
/// the room of all others where vehicles are far (docs/results/quality.md).
const PER_PIXEL: f64 = 1.0;

/// Decides on the component, and reserves room for its Gaussians; none where it is not used.
pub(crate) fn drafted(draft: &mut Draft<'_>, scene: &TrainingScene) -> FirstObjects {
    let vehicles = scene.tracks.as_ref().and_then(vehicles);
    let decision = match &vehicles {
        None => Decision::without("tracks of vehicles"),
        Some(tracks) => by_tracks(tracks),
    };
    let used = draft.decide(ID, decision);
    let Some(tracks) = vehicles.filter(|_| used) else {
        return FirstObjects::default();
    };
    let limit = draft.settings.densify.maximum_gaussians;
    let first = initial::objects(scene, &tracks, limit, PER_PIXEL);
    draft.reserved = first.gaussians.len() as u64;
    draft.explained = initial::covered(scene, &first.objects);
    first
}

/// Returns the tracks of vehicles; `None` without vehicles. People bend as they walk, and a rigid box of them was
/// worse than Gaussians with lifespans (docs/results/quality.md).
fn vehicles(tracks: &Tracks) -> Option<Tracks> {
    let mut vehicles = tracks.clone();
    let class = ObjectClass::Vehicle.name();
    vehicles.tracks.retain(|track| track.class == class);
    (!vehicles.tracks.is_empty()).then_some(vehicles)
}

fn by_tracks(tracks: &Tracks) -> Decision {
    let count = format!("{} vehicles have paths", tracks.tracks.len());
    if tracks.are_exact() {
        Decision::new(true, format!("{count}, which are exact"))
    } else {
        Decision::on_request(&format!(
            "{count} from detections, and no scene was measured with such"
        ))
    }
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
