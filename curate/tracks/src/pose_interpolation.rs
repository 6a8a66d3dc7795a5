//! Camera poses between the samples of a path, and their check.
//!
//! The cubic of Lagrange runs through the four samples around an instant: through their centres, and through their
//! rotations as vectors of the logarithm of SO(3) at the second of them. It is checked by leaving each sample out in
//! turn. The gap is then twice as long as between samples, so that the error between them is smaller: by 2^4 of a
//! smooth path.
//!
//! ```text
//! w_k(t) = prod_(j != k) (t - t_j) / (t_k - t_j)
//! c(t) = sum_k w_k(t) c_k
//! R(t) = R_1 exp(sum_k w_k(t) log(R_1^-1 R_k))
//! ```

use glam::{DMat3, DQuat, DVec2, DVec3, dvec2};
use omnilife_schemas::{
    camera::CameraModel, ground_plane::Plane, posed_view::PosedView, statistics::quantile,
};

/// Samples that a pose between them follows from.
const NODES: usize = 4;
/// Largest error of held-out samples, pixels.
const MOST_PIXELS: f64 = 2.0;
/// Share of the held-out samples below it.
const SHARE: f64 = 0.9;
/// Places across and down an image at which errors are measured.
const PLACES: [f64; 3] = [1.0 / 6.0, 0.5, 5.0 / 6.0];

/// Returns the view at an instant among samples in order of time, with the frame and the camera of the sample before;
/// `None` outside of them, and with fewer than four.
pub(super) fn between(samples: &[PosedView], seconds: f64) -> Option<PosedView> {
    let [first, last] = [samples.first()?.seconds, samples.last()?.seconds];
    if samples.len() < NODES || !(first..=last).contains(&seconds) {
        return None;
    }
    let after = samples.partition_point(|sample| sample.seconds <= seconds);
    let begin = after.saturating_sub(NODES / 2).min(samples.len() - NODES);
    let nodes = samples.get(begin..begin + NODES)?;
    let at = samples.get(after.saturating_sub(1))?;
    let base = DQuat::from_mat3(&nodes.get(1)?.to_world);
    let (mut centre, mut turn) = (DVec3::ZERO, DVec3::ZERO);
    for node in nodes {
        let others = nodes.iter().filter(|other| other.seconds != node.seconds);
        let weight: f64 = others
            .map(|other| (seconds - other.seconds) / (node.seconds - other.seconds))
            .product();
        centre += weight * node.centre;
        turn += weight * logarithm(base.inverse() * DQuat::from_mat3(&node.to_world));
    }
    Some(PosedView {
        seconds,
        to_world: DMat3::from_quat(base * DQuat::from_scaled_axis(turn)),
        centre,
        ..*at
    })
}

/// Returns axis times angle of a rotation, radians, the angle up to half a turn.
fn logarithm(rotation: DQuat) -> DVec3 {
    let short = if rotation.w < 0.0 {
        -rotation
    } else {
        rotation
    };
    short.to_scaled_axis()
}

/// Checks poses between samples against given ones: each inner sample is left out and interpolated from its
/// neighbours. Returns the evidence.
///
/// # Errors
/// One line where there are fewer than five samples, or the places that images show on the ground move by more than
/// two pixels in more than a tenth of them.
pub(super) fn check(samples: &[PosedView], ground: Plane) -> Result<String, String> {
    let errors = held_out_errors(samples, ground);
    let Some(error) = quantile(&errors, SHARE) else {
        return Err(format!(
            "{} frames with poses are too few to interpolate between them: at least {} must be",
            samples.len(),
            NODES + 1
        ));
    };
    let measured = format!(
        "poses of {} samples, left out and interpolated, move the ground by {error:.2} pixels or less in {:.0} % of \
         them",
        errors.len(),
        100.0 * SHARE
    );
    if error <= MOST_PIXELS {
        return Ok(measured);
    }
    Err(format!(
        "{measured}, and at most {MOST_PIXELS} may be: sample more frames of the video (--fps), or leave out \
         --every-frame"
    ))
}

/// Returns the error of each inner sample as interpolated from its neighbours, pixels.
fn held_out_errors(samples: &[PosedView], ground: Plane) -> Vec<f64> {
    if samples.len() <= NODES {
        return Vec::new();
    }
    (1..samples.len() - 1)
        .map(|left_out| {
            let mut others = samples.to_vec();
            let given = others.remove(left_out);
            let found = between(&others, given.seconds);
            found.map_or(f64::INFINITY, |found| displacement(&given, &found, ground))
        })
        .collect()
}

/// Returns the mean distance by which the image moves between two views: of places on the ground, and of directions
/// above the horizon, pixels.
fn displacement(given: &PosedView, found: &PosedView, ground: Plane) -> f64 {
    let [width, height] = given.camera.size().map(|side| side as f64);
    let moved = |pixel: DVec2| {
        let ray = given.ray(pixel);
        let in_camera = match ground.meet(given.centre, ray) {
            Some(distance) => found.in_camera(given.centre + distance * ray),
            None => found.to_world.transpose() * ray,
        };
        let seen = given.camera.project(in_camera);
        seen.map_or(f64::INFINITY, |seen| seen.distance(pixel))
    };
    let rows = PLACES
        .iter()
        .flat_map(|down| PLACES.map(|across| (across, *down)));
    let moved: Vec<f64> = rows
        .map(|(across, down)| moved(dvec2(across * width, down * height)))
        .collect();
    moved.iter().sum::<f64>() / moved.len() as f64
}

#[cfg(test)]
mod tests {
    use glam::dvec3;
    use omnilife_schemas::camera::PinholeCamera;

    use super::*;

    const GROUND: Plane = Plane {
        normal: DVec3::Z,
        offset: 0.0,
    };

    /// Returns the view of a drone at an instant: along a curve, 40 m above the ground.
    fn view(seconds: f64) -> PosedView {
        let down = DMat3::from_cols(DVec3::X, -DVec3::Y, -DVec3::Z);
        let turn = DQuat::from_euler(
            glam::EulerRot::ZYX,
            0.4 * (0.3 * seconds).sin(),
            0.05 * seconds,
            0.2 * (0.25 * seconds).cos(),
        );
        PosedView {
            frame: 0,
            seconds,
            camera: PinholeCamera::with_horizontal_field_of_view(640, 360, 1.1).into(),
            to_world: DMat3::from_quat(turn) * down,
            centre: dvec3(
                20.0 * (0.2 * seconds).sin(),
                2.0 * seconds,
                40.0 + seconds.sin(),
            ),
        }
    }

    fn path(step: f64, count: u32) -> Vec<PosedView> {
        (0..count)
            .map(|number| view(step * f64::from(number)))
            .collect()
    }

    #[test]
    fn cubic_paths_are_met_exactly() {
        let cubic = |t: f64| PosedView {
            centre: dvec3(t * t * t - 2.0 * t, 3.0 - t * t, 0.5 * t),
            to_world: DMat3::from_rotation_z(0.1 * t * t - 0.02 * t * t * t),
            ..view(t)
        };
        // Samples at uneven distances.
        let samples: Vec<PosedView> = [0.0, 0.9, 2.1, 3.0, 4.2].map(cubic).to_vec();
        for seconds in [0.0, 0.4, 1.5, 2.1, 2.7, 3.9, 4.2] {
            let (found, truth) = (between(&samples, seconds), cubic(seconds));
            let found = found.unwrap_or_else(|| panic!("{seconds} s is inside"));
            assert!(found.centre.distance(truth.centre) < 1e-9, "{seconds} s");
            let apart = (found.to_world - truth.to_world).to_cols_array();
            assert!(apart.iter().all(|entry| entry.abs() < 1e-9), "{seconds} s");
        }
        assert_eq!(between(&samples, -0.1), None);
        assert_eq!(between(&samples, 4.3), None);
        assert_eq!(between(&samples[..3], 1.0), None);
    }

    #[test]
    fn rotations_take_the_short_way() {
        let turn = DQuat::from_rotation_x(0.4);
        assert!(logarithm(turn).distance(logarithm(-turn)) < 1e-12);
        assert!((logarithm(-turn) - 0.4 * DVec3::X).length() < 1e-12);
    }

    #[test]
    fn errors_between_samples_are_below_those_of_held_out_ones() {
        let samples = path(0.5, 30);
        let held_out = held_out_errors(&samples, GROUND);
        assert_eq!(held_out.len(), 28);
        let worst_held_out = held_out[1..27].iter().copied().fold(0.0, f64::max);
        let between_samples = (2..27).map(|number| {
            let seconds = 0.5 * f64::from(number) + 0.25;
            let found = between(&samples, seconds);
            found.map_or(f64::INFINITY, |found| {
                displacement(&view(seconds), &found, GROUND)
            })
        });
        let worst = between_samples.fold(0.0, f64::max);
        assert!(
            worst > 0.0 && 4.0 * worst < worst_held_out,
            "{worst} {worst_held_out}"
        );
        assert!(check(&samples, GROUND).is_ok_and(|said| said.contains("28 samples")));
    }

    #[test]
    fn shaking_cameras_and_few_samples_are_refused() {
        let mut shaking = path(0.5, 30);
        for (number, view) in (0..).zip(&mut shaking) {
            // Half a degree up and down: 4.5 pixels.
            let turn = if number % 2 == 0 { 0.5_f64 } else { -0.5 };
            view.to_world *= DMat3::from_rotation_x(turn.to_radians());
        }
        let refusal = check(&shaking, GROUND).err().unwrap_or_default();
        assert!(refusal.contains("at most 2 may be"), "{refusal}");
        let few = check(&path(0.5, 4), GROUND).err().unwrap_or_default();
        assert!(few.starts_with("4 frames"), "{few}");
    }

    #[test]
    fn displacements_are_those_on_the_ground() {
        let given = PosedView {
            to_world: DMat3::from_cols(DVec3::X, -DVec3::Y, -DVec3::Z),
            centre: dvec3(0.0, 0.0, 40.0),
            ..view(0.0)
        };
        let beside = PosedView {
            centre: given.centre + 0.5 * DVec3::X,
            ..given
        };
        let focal = 320.0 / 0.55_f64.tan();
        let found = displacement(&given, &beside, GROUND);
        assert!((found - focal * 0.5 / 40.0).abs() < 1e-9, "{found}");
    }
}
