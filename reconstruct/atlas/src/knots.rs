//! Number of knots of trajectories.
//!
//! Published: as many as frames for driving scenes, half as many for hand-held clips (Neural Atlas Graphs, supplement
//! A.4). Half as many cannot follow a camera that shakes from frame to frame. They are the default, as no real clip has
//! shown a gain of others.

use glam::{DQuat, DVec3};
use omnilife_engine::{camera::Camera, trajectories::rigid_spline::RigidSpline};
use omnilife_schemas::{records::ComponentDecision, statistics::quantile};
use omnilife_training::options::{MethodOption, OptionValues};

use super::clip::Clip;

/// Option of the knots of trajectories.
pub const KNOTS: MethodOption = MethodOption {
    id: "knots",
    doc: "knots of trajectories: half as many as frames, all (as many as frames), or auto: all where half as many \
          miss the camera's directions by more than half a pixel",
    values: OptionValues::Word(&["auto", "half", "all"]),
    default: "half",
    constant: None,
    cpu_only: &[],
};

/// Maximum miss of the camera's directions, pixels.
const MOST_MISSED: f64 = 0.5;
/// Share of the frames that are missed by less.
const SHARE: f64 = 0.9;

/// Returns the number of knots for a word of [`KNOTS`], with a line for the record.
pub fn of(clip: &Clip, word: Option<&str>) -> (usize, ComponentDecision) {
    let frames = clip.frames.len().max(1);
    let half = frames.div_ceil(2);
    let missed = missed_pixels(clip, half);
    let evidence = format!("{half} knots miss the camera's directions by {missed:.2} pixels");
    let (count, reason) = match word {
        Some("all") => (frames, format!("asked for; {evidence}")),
        Some("auto") if missed > MOST_MISSED => (frames, evidence),
        _ => (half, evidence),
    };
    let decision = ComponentDecision {
        component: "knots".to_owned(),
        used: true,
        reason: format!("{count} for {frames} frames: {reason}"),
    };
    (count, decision)
}

/// Returns the angle by which a spline of so many knots misses the rotations of nine cameras of ten, pixels.
fn missed_pixels(clip: &Clip, knots: usize) -> f64 {
    let per_radian = match clip.camera {
        Camera::Pinhole(camera) => camera.fx,
        Camera::Erp(camera) => f64::from(camera.width) / std::f64::consts::TAU,
    };
    let samples: Vec<(f64, DVec3, DQuat)> = clip
        .frames
        .iter()
        .map(|frame| {
            let rotation = DQuat::from_mat3(&frame.pose.rotation).normalize();
            (frame.time, frame.pose.centre, rotation)
        })
        .collect();
    let spline = RigidSpline::fitted(knots, &samples);
    let missed: Vec<f64> = samples
        .iter()
        .map(|&(time, _, rotation)| {
            let found = DQuat::from_mat3(&spline.pose(time).rotation);
            let apart = found.conjugate() * rotation;
            2.0 * per_radian * apart.xyz().length().atan2(apart.w.abs())
        })
        .collect();
    quantile(&missed, SHARE).unwrap_or(0.0)
}

#[cfg(test)]
mod tests {
    use glam::DMat3;
    use omnilife_engine::trajectories::rigid_spline::RigidPose;
    use omnilife_schemas::camera::PinholeCamera;

    use super::*;
    use crate::clip::{ClipFrame, UnitClock};

    /// Returns frames of a camera that turns, and shakes by some pixels.
    fn clip(shake_pixels: f64) -> Clip {
        let frame = |number: u32| {
            let shake = if number.is_multiple_of(2) { 1.0 } else { -1.0 };
            let turn = 0.01 * f64::from(number) + shake * shake_pixels / 100.0;
            ClipFrame {
                number,
                time: f64::from(number) / 23.0,
                pose: RigidPose {
                    centre: DVec3::ZERO,
                    rotation: DMat3::from_rotation_y(turn),
                },
                pixels: vec![0; 3 * 16],
                masks: Vec::new(),
                ignored: None,
            }
        };
        Clip {
            camera: PinholeCamera {
                width: 4,
                height: 4,
                fx: 100.0,
                fy: 100.0,
                cx: 2.0,
                cy: 2.0,
            }
            .into(),
            frames: (0..24).map(frame).collect(),
            objects: Vec::new(),
            clock: UnitClock {
                begin_seconds: 0.0,
                length_seconds: 1.0,
            },
            warnings: Vec::new(),
        }
    }

    #[test]
    fn a_camera_that_shakes_has_a_knot_for_each_frame_on_request() {
        assert_eq!(of(&clip(0.0), Some("auto")).0, 12);
        assert_eq!(of(&clip(2.0), Some("auto")).0, 24);
        assert_eq!(of(&clip(2.0), Some("half")).0, 12);
        assert_eq!(of(&clip(2.0), None).0, 12);
        assert_eq!(of(&clip(0.0), Some("all")).0, 24);
        assert!(missed_pixels(&clip(0.0), 12) < 0.05);
        // The shake itself, which half of the knots average out.
        let missed = missed_pixels(&clip(2.0), 12);
        assert!((1.0..4.0).contains(&missed), "{missed}");
    }
}
