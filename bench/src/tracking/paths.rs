//! Scores of paths in space.

use glam::DVec3;
use omnilife_schemas::{
    records::{Scene, Tracks},
    statistics::{median, quantile},
    trajectory::{GroundAxes, ObjectPath, nearest_turn},
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
    /// Median error of the speed while it moves by a metre per second, percent of the true one, over half a second.
    pub speed_percent: Option<f64>,
    /// The error that nine of ten of them do not exceed, percent.
    pub speed_percent_of_nine_in_ten: Option<f64>,
    /// Median error of the length, metres.
    pub length_metres: f64,
}

/// Largest distance of a path from its true object, the nearest one, metres.
pub const REACH_METRES: f64 = 3.0;
/// Speed below which an object stands, metres per second.
const LEAST_SPEED: f64 = 0.5;

/// The same for an error relative to its speed.
const LEAST_COMPARED_SPEED: f64 = 1.0;
/// Time before a sighting and after it over which its speed is measured, seconds.
const SPEED_REACH_SECONDS: f64 = 0.25;
/// Shortest time for a speed: paths end, seconds.
const LEAST_SPEED_SECONDS: f64 = 0.1;

/// Returns the speeds of two paths around a time, over the time that both have, in units of their worlds per second.
fn speeds_around(paths: [&ObjectPath; 2], seconds: f64) -> Option<[f64; 2]> {
    let ranges = paths.map(|path| path.centre.range());
    let begin = ranges
        .iter()
        .map(|range| range[0])
        .fold(seconds - SPEED_REACH_SECONDS, f64::max);
    let end = ranges
        .iter()
        .map(|range| range[1])
        .fold(seconds + SPEED_REACH_SECONDS, f64::min);
    let span = end - begin;
    (span >= LEAST_SPEED_SECONDS).then(|| {
        paths.map(|path| {
            let way = path.centre.position(end) - path.centre.position(begin);
            way.length() / span
        })
    })
}

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
    let mut speeds = Vec::new();
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
        if let Some([own, of_found]) = speeds_around([&object.path, &track.path], seconds)
            && own * metres > LEAST_COMPARED_SPEED
        {
            speeds.push(100.0 * (world.length(of_found) / own - 1.0).abs());
        }
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
        speed_percent: median(&speeds),
        speed_percent_of_nine_in_ten: quantile(&speeds, 0.9),
        length_metres: median(&lengths)?,
    })
}

#[cfg(test)]
mod tests {
    use omnilife_schemas::trajectory::BSpline;

    use super::*;

    fn straight(speed: f64, range: [f64; 2]) -> ObjectPath {
        let [begin, end] = range;
        ObjectPath {
            centre: BSpline {
                degree: 1,
                knots: vec![begin, begin, end, end],
                coefficients: range.map(|seconds| [speed * seconds, 0.0, 0.0]).to_vec(),
            },
            headings: vec![0.0],
            heading_seconds: vec![begin],
        }
    }

    /// A path that is 10 % too fast, at its middle, at its end and after it.
    #[test]
    fn speeds_are_measured_over_the_time_that_both_paths_have() {
        let (truth, found) = (straight(5.0, [0.0, 10.0]), straight(5.5, [2.0, 8.0]));
        for seconds in [4.0, 2.0, 8.0] {
            let speeds = speeds_around([&truth, &found], seconds);
            let are_right = |[own, of_found]: [f64; 2]| {
                (own - 5.0).abs() < 1e-9 && (of_found - 5.5).abs() < 1e-9
            };
            assert!(speeds.is_some_and(are_right), "{seconds} s: {speeds:?}");
        }
        assert_eq!(speeds_around([&truth, &found], 8.2), None);
    }
}
