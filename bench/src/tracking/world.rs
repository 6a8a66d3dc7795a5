//! The world of tracks beside that of their truth.
//!
//! Poses that were given are taken to be in the world of the truth. Those found from the images are in a world of
//! their own. The similarity between the cameras of both brings the paths together: rotation and scale are those of
//! the centres by least squares, as for the trajectory error of poses.

use glam::{DQuat, DVec3};
use omnilife_schemas::{
    Pose,
    pose::angle_between,
    records::{PoseAlignment, PoseSource, Scene, Tracks},
    statistics::median,
};
use serde::Serialize;

use crate::poses::align::{Alignment, Degeneracy, align, mean_turn};

/// Cameras that must have a pose in both worlds at least.
const LEAST_FRAMES: usize = 3;
/// Largest angle between the turn of the centres and that of the cameras, degrees. Along a nearly straight path, noise
/// of the centres alone decides the turn about it.
const MOST_TURN_DEGREES: f64 = 1.0;

/// True poses of a scene's frames.
#[derive(Debug, Clone, Copy)]
pub struct TruePoses<'a> {
    /// Name of their file or folder.
    pub name: &'a str,
    /// A pose for each frame of the scene, where there is one.
    pub poses: &'a [Option<Pose>],
}

/// Similarity of the cameras of two worlds, with its residuals.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct WorldAlignment {
    /// Name of the file or folder of the true poses.
    pub true_poses: String,
    /// Cameras with a pose in both worlds.
    pub frames: u32,
    /// Units of the true world in a unit of that of the tracks.
    pub scale: f64,
    /// Root of the mean squared distance of the centres after the alignment, metres.
    pub centre_rmse_metres: f64,
    /// Largest distance of two centres, metres.
    pub largest_centre_metres: f64,
    /// Median angle between the cameras, degrees.
    pub rotation_degrees: f64,
    /// Ratio of the metres that the tracks state for a unit and those of the aligned truth.
    pub metres_ratio: f64,
}

/// Change from the world of tracks to that of their truth.
#[derive(Debug, Clone, Copy)]
pub struct World {
    alignment: Alignment,
    /// Metres in a unit of the true world.
    pub metres_per_unit: f64,
}

impl World {
    /// Returns the change of tracks whose world is that of the truth.
    pub fn shared(found: &Tracks) -> Self {
        let alignment = Alignment {
            scale: 1.0,
            rotation: DQuat::IDENTITY,
            offset: DVec3::ZERO,
        };
        Self {
            alignment,
            metres_per_unit: found.metres_per_unit,
        }
    }

    /// Returns the similarity that brings a scene's cameras to true ones, with its residuals.
    ///
    /// # Errors
    /// One line where there are too few cameras, those of one side stand in one place, or the turns of centres and
    /// cameras differ by more than a degree.
    pub fn by_cameras(
        scene: &Scene,
        true_poses: &TruePoses<'_>,
        [truth, found]: [&Tracks; 2],
    ) -> Result<(Self, WorldAlignment), String> {
        let usable = |pose: &Option<Pose>| pose.filter(Pose::is_valid);
        let pairs: Vec<(Pose, Pose)> = (scene.frames.iter().zip(true_poses.poses))
            .filter_map(|(frame, reference)| Some((usable(&frame.pose)?, usable(reference)?)))
            .collect();
        if pairs.len() < LEAST_FRAMES {
            return Err(format!(
                "{} frames of the scene have a pose in {}, {LEAST_FRAMES} must have one",
                pairs.len(),
                true_poses.name
            ));
        }
        let found_alignment = align(&pairs, PoseAlignment::Similarity);
        let Some((alignment, degeneracy)) = found_alignment else {
            return Err(format!("the poses of {} must be valid", true_poses.name));
        };
        let stands = match degeneracy {
            Some(Degeneracy::EstimateStands) => Some("the scene"),
            Some(Degeneracy::ReferenceStands) => Some(true_poses.name),
            // Rotations of the cameras settle the turn about a line.
            Some(Degeneracy::Line) | None => None,
        };
        if let Some(side) = stands {
            return Err(format!(
                "the cameras of {side} stand in one place, which gives no scale"
            ));
        }
        if alignment.scale <= 0.0 {
            return Err("the cameras run against the true ones: no scale above 0 fits".to_owned());
        }
        let turn = mean_turn(&pairs).map(|turn| angle_between(turn, alignment.rotation));
        if let Some(degrees) = turn.map(f64::to_degrees)
            && degrees > MOST_TURN_DEGREES
        {
            return Err(format!(
                "the centres of the cameras turn the scene by {degrees:.1} degrees more than their rotations do, at \
                 most {MOST_TURN_DEGREES} may be: along a nearly straight path, noise decides the turn about it"
            ));
        }
        let metres = truth.metres_per_unit;
        let aligned = pairs.iter().filter_map(|(own, reference)| {
            let own = alignment.apply(own)?;
            let angle = angle_between(own.rotation()?, reference.rotation()?);
            let distance = own.centre().distance(reference.centre()) * metres;
            Some((distance, angle.to_degrees()))
        });
        let (distances, angles): (Vec<f64>, Vec<f64>) = aligned.unzip();
        let squared: f64 = distances.iter().map(|one| one * one).sum();
        let record = WorldAlignment {
            true_poses: true_poses.name.to_owned(),
            frames: pairs.len() as u32,
            scale: alignment.scale,
            centre_rmse_metres: (squared / pairs.len() as f64).sqrt(),
            largest_centre_metres: distances.iter().copied().fold(0.0, f64::max),
            rotation_degrees: median(&angles).unwrap_or(0.0),
            metres_ratio: found.metres_per_unit / (alignment.scale * metres),
        };
        let world = Self {
            alignment,
            metres_per_unit: metres,
        };
        Ok((world, record))
    }

    /// Returns a place of the tracks in the true world.
    pub fn place(&self, place: DVec3) -> DVec3 {
        self.alignment.scale * self.direction(place) + self.alignment.offset
    }

    /// Returns a direction of the tracks in the true world.
    pub fn direction(&self, direction: DVec3) -> DVec3 {
        self.alignment.rotation * direction
    }

    /// Returns a length of the tracks in units of the true world.
    pub fn length(&self, length: f64) -> f64 {
        self.alignment.scale * length
    }
}

/// Returns why paths in a scene cannot be compared without true poses; `None` where its poses were given.
pub fn own_world(scene: &Scene) -> Option<String> {
    let of = match &scene.pose_source {
        PoseSource::Given { .. } | PoseSource::Matrices { .. } => return None,
        PoseSource::Program { command, .. } => format!("the program {command}"),
        PoseSource::Registered { .. } => "registered images".to_owned(),
        PoseSource::Sfm { tool, .. } => format!("structure from motion ({tool})"),
    };
    Some(format!(
        "paths are left out: the poses of {} are by {of}, in a world of their own, and \
         --true-poses FILE must bring it to that of the truth",
        scene.id
    ))
}

#[cfg(test)]
mod tests {
    use omnilife_schemas::{
        records::{Detection, Track},
        trajectory::{BSpline, GroundAxes, ObjectPath},
    };

    use super::*;
    use crate::{
        poses::tests::{scene, walk},
        tracking::paths::score_paths,
    };

    /// Returns tracks with one object along the first axis of the ground, 4 m in a second.
    fn tracks() -> Tracks {
        let path = ObjectPath {
            centre: BSpline {
                degree: 1,
                knots: BSpline::uniform_knots(1, 2, 0.0, 10.0),
                coefficients: vec![[1.0, 2.0, 0.5], [41.0, 2.0, 0.5]],
            },
            heading_seconds: vec![0.0],
            headings: vec![0.0],
        };
        let detection = |frame| Detection {
            frame,
            box_pixels: [1.0, 2.0, 3.0, 4.0],
            confidence: 1.0,
            class: "vehicle".to_owned(),
            distance: None,
            position: None,
            track: Some(1),
        };
        Tracks {
            scene: "walk/seq-000".to_owned(),
            frames: (0..20).collect(),
            image_size: [320, 180],
            up: [0.0, 0.0, 1.0],
            metres_per_unit: 1.0,
            stages: Vec::new(),
            detections: (0..20).map(detection).collect(),
            tracks: vec![Track {
                id: 1,
                class: "vehicle".to_owned(),
                dimensions: [4.5, 1.8, 1.5],
                path,
                detections: 20,
                displacement: 40.0,
            }],
            warnings: Vec::new(),
        }
    }

    /// The world of the tracks: `x_own = R (x_true - offset) / scale`.
    const SCALE: f64 = 2.5;

    fn turn() -> DQuat {
        DQuat::from_euler(glam::EulerRot::XYZ, 0.4, -0.3, 1.1)
    }

    fn own_place(place: DVec3) -> DVec3 {
        turn() * (place - DVec3::new(3.0, -7.0, 1.0)) / SCALE
    }

    /// Returns the same tracks in a world of their own.
    fn moved(truth: &Tracks) -> Tracks {
        let mut found = truth.clone();
        let up = turn() * DVec3::from_array(truth.up);
        found.up = up.to_array();
        found.metres_per_unit = SCALE;
        let track = &mut found.tracks[0];
        let ends = track.path.centre.coefficients.iter_mut();
        ends.for_each(|place| *place = own_place(DVec3::from_array(*place)).to_array());
        let forward = turn() * GroundAxes::new(DVec3::Z).rotation(0.0).x_axis;
        track.path.headings = vec![GroundAxes::new(up).heading(forward)];
        track.dimensions = track.dimensions.map(|side| side / SCALE);
        found
    }

    /// Returns true poses, and those of a scene in a world of its own.
    fn poses() -> [Vec<Option<Pose>>; 2] {
        let truth = walk();
        let own = truth.iter().map(|pose| {
            let pose = (*pose)?;
            Some(Pose::new(
                turn() * pose.rotation()?,
                own_place(pose.centre()),
            ))
        });
        let own = own.collect();
        [truth, own]
    }

    #[test]
    fn paths_of_another_world_are_compared_by_the_cameras() {
        let truth = tracks();
        let found = moved(&truth);
        let [true_poses, own] = poses();
        let scene = scene(&own);
        let unaligned = score_paths(&truth, &found, &scene, &World::shared(&found));
        assert!(unaligned.is_none_or(|scores| scores.missing > 0));
        let given = TruePoses {
            name: "poses.json",
            poses: &true_poses,
        };
        let aligned = World::by_cameras(&scene, &given, [&truth, &found]);
        let (world, record) = aligned.unwrap_or_else(|reason| panic!("{reason}"));
        assert!((record.scale - SCALE).abs() < 1e-9, "{record:?}");
        assert!(record.largest_centre_metres < 1e-9 && record.rotation_degrees < 1e-6);
        assert!((record.metres_ratio - 1.0).abs() < 1e-9);
        assert_eq!(record.frames, 24);
        let scores = score_paths(&truth, &found, &scene, &world);
        let scores = scores.unwrap_or_else(|| panic!("the paths are near"));
        assert_eq!((scores.samples, scores.missing), (20, 0));
        assert!(scores.ground_metres < 1e-9 && scores.length_metres < 1e-9);
        assert!(
            scores.heading_degrees.is_some_and(|degrees| degrees < 1e-6),
            "{scores:?}"
        );
        let speeds = [scores.speed_percent, scores.speed_percent_of_nine_in_ten];
        assert!(
            speeds.map(|error| error.is_some_and(|error| error < 1e-6)) == [true; 2],
            "{scores:?}"
        );
    }

    #[test]
    fn residuals_and_a_wrong_scale_stand_in_the_record() {
        let truth = tracks();
        let mut found = moved(&truth);
        found.metres_per_unit *= 0.9;
        let [true_poses, mut own] = poses();
        // One camera of 24 is off by 1.2 m.
        let off = own[5].map(|pose| {
            let centre = pose.centre() + turn() * DVec3::new(0.0, 1.2, 0.0) / SCALE;
            Pose::new(pose.rotation().unwrap_or(DQuat::IDENTITY), centre)
        });
        own[5] = off;
        let given = TruePoses {
            name: "poses.json",
            poses: &true_poses,
        };
        let aligned = World::by_cameras(&scene(&own), &given, [&truth, &found]);
        let (_, record) = aligned.unwrap_or_else(|reason| panic!("{reason}"));
        let expected = 1.2 / 24.0_f64.sqrt();
        assert!(record.centre_rmse_metres < expected, "{record:?}");
        assert!(record.centre_rmse_metres > 0.7 * expected, "{record:?}");
        assert!((0.9..1.2).contains(&record.largest_centre_metres));
        assert!((record.metres_ratio / 0.9 - 1.0).abs() < 0.05);
    }

    #[test]
    fn cameras_that_give_no_similarity_are_refused() {
        let truth = tracks();
        let [true_poses, own] = poses();
        let refusal = |own: &[Option<Pose>], given: &[Option<Pose>]| {
            let given = TruePoses {
                name: "poses.json",
                poses: given,
            };
            World::by_cameras(&scene(own), &given, [&truth, &truth]).err()
        };
        let few: Vec<Option<Pose>> = own.iter().take(2).copied().collect();
        assert!(refusal(&few, &true_poses).is_some_and(|reason| reason.starts_with("2 frames")));
        let still: Vec<Option<Pose>> = own
            .iter()
            .map(|pose| Some(Pose::new((*pose)?.rotation()?, DVec3::ONE)))
            .collect();
        for sides in [[&still, &true_poses], [&own, &still]] {
            let reason = refusal(sides[0], sides[1]);
            assert!(reason.is_some_and(|reason| reason.contains("one place")));
        }
        assert_eq!(refusal(&own, &true_poses), None);
    }

    /// A walk of 2.3 m along a line, with a centimetre of noise in the centres of both sides.
    #[test]
    fn noise_about_a_straight_walk_gives_no_turn() {
        let truth = tracks();
        let noise = |at: f64, rate: f64| {
            let sines = DVec3::new(
                (rate * at).sin(),
                ((rate + 0.9) * at + 1.0).sin(),
                ((rate + 1.9) * at + 2.0).sin(),
            );
            0.01 * sines
        };
        let refusal = |bend: f64| {
            let sides: Vec<[Option<Pose>; 2]> = (walk().iter().zip(0_u32..))
                .map(|(pose, number)| {
                    let (at, rotation) = (f64::from(number), (*pose)?.rotation()?);
                    let centre = DVec3::new(bend * (0.2 * at).sin(), 0.0, 0.1 * at);
                    Some([
                        Pose::new(rotation, centre + noise(at, 3.3)),
                        Pose::new(turn() * rotation, own_place(centre + noise(at, 7.1))),
                    ])
                })
                .map(|sides| sides.map_or([None; 2], |sides| sides.map(Some)))
                .collect();
            let [true_poses, own] =
                [0, 1].map(|side| sides.iter().map(|both| both[side]).collect::<Vec<_>>());
            let given = TruePoses {
                name: "poses.json",
                poses: &true_poses,
            };
            World::by_cameras(&scene(&own), &given, [&truth, &truth]).err()
        };
        assert!(refusal(0.0).is_some_and(|reason| reason.contains("at most 1 may be")));
        // A bend of two metres settles it.
        assert_eq!(refusal(2.0), None);
    }

    #[test]
    fn poses_from_images_alone_are_in_a_world_of_their_own() {
        let mut scene = scene(&walk());
        assert_eq!(own_world(&scene), None);
        scene.pose_source = PoseSource::Sfm {
            tool: "colmap 3.12".to_owned(),
            configuration: "default".to_owned(),
            wall_seconds: 1,
        };
        let reason = own_world(&scene).unwrap_or_default();
        assert!(reason.contains("colmap 3.12") && reason.contains("--true-poses"));
    }
}
