//! State of vehicles at the times of frames.

use glam::DVec3;
use omnilife_schemas::{records::Track, trajectory::GroundAxes};

use super::TrackExport;

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
}

impl TrackExport<'_> {
    /// Returns the states of a vehicle at the frames within its time.
    pub(super) fn moments(&self, track: &Track) -> Vec<Moment> {
        let frames = self.tracks.frames.iter();
        frames
            .filter_map(|&frame| self.moment(track, frame))
            .collect()
    }

    fn moment(&self, track: &Track, frame: u32) -> Option<Moment> {
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
        })
    }
}
