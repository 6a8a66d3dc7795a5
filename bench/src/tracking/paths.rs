//! Scores of paths in space.

use glam::DVec3;
use omnilife_schemas::{
    records::{Scene, Tracks},
    statistics::median,
    trajectory::{GroundAxes, nearest_turn},
};
use serde::Serialize;

use super::world::World;

/// Errors of paths in space; `None` if no true object is near any.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct PathScores {
    /// Number of compared sightings.
    pub samples: u32,
    /// Sightings of true moving objects without a path within [`REACH_METRES`].
    pub missing: u32,
    /// Median distance on the ground, metres.
    pub ground_metres: f64,
    /// Median error of the heading while it moves, degrees; `None` if no true object moves.
    pub heading_degrees: Option<f64>,
    /// Median error of the length, metres.
    pub length_metres: f64,
}

/// Largest distance of a path from its true object, the nearest one, metres.
pub const REACH_METRES: f64 = 3.0;
/// Speed below which an object stands, metres per second.
const LEAST_SPEED: f64 = 0.5;

/// Scores paths at the times of the true objects' sightings, in the world of the truth.
pub fn score_paths(
    truth: &Tracks,
    found: &Tracks,
    scene: &Scene,
    world: &World,
) -> Option<PathScores> {
    let up = DVec3::from_array(found.up);
    let axes = [
        GroundAxes::new(DVec3::from_array(truth.up)),
        GroundAxes::new(up),
    ];
    let up = world.direction(up);
    let metres = world.metres_per_unit;
    let (mut ground, mut headings, mut lengths, mut missing) =
        (Vec::new(), Vec::new(), Vec::new(), 0);
    for sighting in &truth.detections {
        let seconds = scene.frames.get(sighting.frame as usize)?.time_seconds;
        let object = truth
            .tracks
            .iter()
            .find(|track| Some(track.id) == sighting.track);
        let Some((object, (centre, true_heading))) =
            object.and_then(|object| Some((object, object.path.at(seconds)?)))
        else {
            continue;
        };
        let near = found.tracks.iter().filter_map(|track| {
            let (place, heading) = track.path.at(seconds)?;
            let offset = world.place(place) - centre;
            let on_ground = (offset - up * offset.dot(up)).length() * metres;
            (on_ground <= REACH_METRES).then_some((on_ground, heading, track))
        });
        let Some((distance, heading, track)) = near.min_by(|a, b| a.0.total_cmp(&b.0)) else {
            missing += 1;
            continue;
        };
        ground.push(distance);
        let length = world.length(track.dimensions[0]);
        lengths.push((length - object.dimensions[0]).abs() * metres);
        if object.path.centre.velocity(seconds).length() * metres > LEAST_SPEED {
            let forward = world.direction(axes[1].rotation(heading).x_axis);
            let error = nearest_turn(axes[0].heading(forward) - true_heading, 0.0);
            headings.push(error.abs().to_degrees());
        }
    }
    Some(PathScores {
        samples: ground.len() as u32,
        missing,
        ground_metres: median(&ground)?,
        heading_degrees: median(&headings),
        length_metres: median(&lengths)?,
    })
}
