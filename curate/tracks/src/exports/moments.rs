//! State of vehicles at the times of frames.

use std::collections::BTreeSet;

use glam::DVec3;
use omnilife_schemas::{records::Track, trajectory::GroundAxes};

use super::TrackExport;

/// Evidence of a vehicle's state at a frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Evidence {
    /// A detection in the frame.
    Seen,
    /// Detections before and after it.
    Interpolated,
    /// Detections on one side alone.
    Extrapolated,
}

impl Evidence {
    /// Name in files.
    pub(super) fn name(self) -> &'static str {
        match self {
            Self::Seen => "seen",
            Self::Interpolated => "interpolated",
            Self::Extrapolated => "extrapolated",
        }
    }

    /// Returns the evidence at a frame, from the frames of detections.
    fn at(frame: u32, seen: &BTreeSet<u32>) -> Self {
        if seen.contains(&frame) {
            return Self::Seen;
        }
        let is_between =
            seen.range(..frame).next().is_some() && seen.range(frame..).next().is_some();
        if is_between {
            Self::Interpolated
        } else {
            Self::Extrapolated
        }
    }
}

/// State of a vehicle.
pub(super) struct Moment {
    pub(super) frame: u32,
    /// Presentation timestamp in seconds.
    pub(super) seconds: f64,
    /// Metres: east, north and up of the origin, or along the axes of the ground.
    pub(super) place: DVec3,
    /// Speed along the ground, metres per second.
    pub(super) speed: f64,
    /// Degrees in [0, 360): clockwise from north, or counterclockwise from the ground's first axis.
    pub(super) heading: f64,
    pub(super) evidence: Evidence,
}

impl TrackExport<'_> {
    /// Returns the states of a vehicle at the frames within its time.
    pub(super) fn moments(&self, track: &Track) -> Vec<Moment> {
        let own = self.tracks.detections.iter();
        let own = own.filter(|one| one.track == Some(track.id) && one.confidence > 0.0);
        let seen: BTreeSet<u32> = own.map(|one| one.frame).collect();
        let frames = self.tracks.frames.iter();
        frames
            .filter_map(|&frame| self.moment(track, frame, Evidence::at(frame, &seen)))
            .collect()
    }

    fn moment(&self, track: &Track, frame: u32, evidence: Evidence) -> Option<Moment> {
        let seconds = self.scene.frames.get(frame as usize)?.time_seconds;
        let (centre, heading) = track.path.at(seconds)?;
        let up = DVec3::from_array(self.tracks.up);
        let axes = GroundAxes::new(up);
        let velocity = track.path.centre.velocity(seconds);
        let along = velocity - up * velocity.dot(up);
        let (place, metres, degrees) = match self.georeference {
            Some(georeference) => {
                let forward = georeference.direction(axes.rotation(heading) * DVec3::X);
                let degrees = forward.x.atan2(forward.y).to_degrees();
                (
                    georeference.enu(centre),
                    georeference.metres_per_unit,
                    degrees,
                )
            }
            None => {
                let metres = self.tracks.metres_per_unit;
                let own = axes.to_world.transpose() * centre;
                (metres * own, metres, heading.to_degrees())
            }
        };
        Some(Moment {
            frame,
            seconds,
            place,
            speed: along.length() * metres,
            // A tiny negative angle would round to 360.
            heading: degrees.rem_euclid(360.0) % 360.0,
            evidence,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn evidence_is_a_detection_or_those_around_or_on_one_side() {
        let seen = BTreeSet::from([3, 5]);
        let found = [2, 3, 4, 5, 6].map(|frame| Evidence::at(frame, &seen).name());
        let expected = [
            "extrapolated",
            "seen",
            "interpolated",
            "seen",
            "extrapolated",
        ];
        assert_eq!(found, expected);
    }
}
