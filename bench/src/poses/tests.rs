//! Properties of the scores of poses.

use glam::{DQuat, DVec3};
use omnilife_schemas::{camera::ErpCamera, records::SceneFrame};
use proptest::prelude::*;

use super::*;

pub(crate) fn scene(poses: &[Option<Pose>]) -> Scene {
    let frame = |(number, &pose): (usize, &Option<Pose>)| {
        SceneFrame::new(format!("frames/{number:06}.png"), 0.5 * number as f64, pose)
    };
    Scene {
        scale: Scale::Metres,
        ..Scene::given(
            "walk/seq-000",
            ErpCamera::new(64, 32),
            poses.iter().enumerate().map(frame).collect(),
        )
    }
}

/// Returns the poses of a walk along a curve in space.
pub(crate) fn walk() -> Vec<Option<Pose>> {
    let pose = |number: u32| {
        let at = f64::from(number);
        let rotation =
            DQuat::from_euler(glam::EulerRot::YXZ, 0.15 * at, 0.05 * at.sin(), 0.02 * at);
        let centre = DVec3::new((0.2 * at).sin() * 4.0, 0.1 * at.cos(), 0.5 * at);
        Some(Pose::new(rotation, centre))
    };
    (0..24).map(pose).collect()
}

fn scored(
    reference: &[Option<Pose>],
    poses: &[Option<Pose>],
    alignment: PoseAlignment,
) -> PoseScores {
    let estimate = PoseEstimate {
        name: "estimated",
        poses,
        truth: None,
        alignment,
    };
    score_poses(&scene(reference), &estimate).expect("enough frames")
}

/// Returns poses in another world.
fn moved(poses: &[Option<Pose>], scale: f64, turn: DQuat, offset: DVec3) -> Vec<Option<Pose>> {
    let moved = |pose: &Pose| {
        let rotation = turn * pose.rotation().expect("valid");
        Pose::new(rotation, scale * (turn * pose.centre()) + offset)
    };
    poses.iter().map(|pose| pose.as_ref().map(moved)).collect()
}

/// Returns poses with deterministic errors of about `degrees` and `length`.
fn disturbed(poses: &[Option<Pose>], degrees: f64, length: f64) -> Vec<Option<Pose>> {
    let change = |(number, pose): (usize, &Option<Pose>)| {
        let at = number as f64;
        let axis = DVec3::new(at.sin(), (1.7 * at).cos(), (2.3 * at).sin());
        let pose = pose.as_ref()?;
        let turn = DQuat::from_scaled_axis(degrees.to_radians() * axis.normalize());
        let offset = DVec3::new((3.1 * at).cos(), (4.7 * at).sin(), (5.9 * at).cos());
        let rotation = turn * pose.rotation()?;
        Some(Pose::new(rotation, pose.centre() + length * offset))
    };
    poses.iter().enumerate().map(change).collect()
}

#[test]
fn the_truth_has_no_error() {
    let scores = scored(&walk(), &walk(), PoseAlignment::Similarity);
    assert_eq!((scores.frames, scores.registered_frames), (24, 24));
    assert!(scores.ate_rmse.is_some_and(|ate| ate < 1e-9), "{scores:?}");
    assert!((scores.scale - 1.0).abs() < 1e-12);
    let relative = scores.relative.expect("neighbours");
    assert!(relative.rotation_rmse_degrees < 1e-9 && relative.translation_rmse < 1e-9);
    for area in &scores.auc {
        assert!(area.auc > 1.0 - 1e-9, "{area:?}");
    }
    assert_eq!(scores.drift.len(), 4);
    for row in &scores.drift {
        assert!(row.translation_share < 1e-9 && row.rotation_degrees < 1e-9);
    }
    assert!(scores.notes.is_empty());
}

#[test]
fn known_errors_come_back() {
    let truth = walk();
    // A rigid alignment cannot undo a scale: the error is that of the spread.
    let larger = moved(&truth, 1.1, DQuat::IDENTITY, DVec3::ZERO);
    let rigid = scored(&truth, &larger, PoseAlignment::Rigid);
    let centres: Vec<DVec3> = truth.iter().flatten().map(Pose::centre).collect();
    let mean = centres.iter().sum::<DVec3>() / centres.len() as f64;
    let squared: f64 = centres.iter().map(|c| c.distance_squared(mean)).sum();
    let expected = 0.1 * (squared / centres.len() as f64).sqrt();
    assert!(
        rigid
            .ate_rmse
            .is_some_and(|ate| (ate - expected).abs() < 1e-9)
    );
    let last = rigid.drift.last().expect("the whole path");
    assert!(last.parts == 1 && last.translation_share > 0.05, "{last:?}");

    let half: Vec<Option<Pose>> = (truth.iter().enumerate())
        .map(|(number, pose)| pose.filter(|_| number % 2 == 0))
        .collect();
    let scores = scored(&truth, &half, PoseAlignment::Similarity);
    assert_eq!(scores.relative, None);
    assert!(scores.notes.iter().any(|note| note.contains("RPE")));

    // Cameras that are turned about their own viewing axis in every other frame.
    let rolled: Vec<Option<Pose>> = (truth.iter().enumerate())
        .map(|(number, pose)| {
            let pose = pose.as_ref()?;
            let roll = DQuat::from_rotation_z(0.3_f64.to_radians() * (number % 2) as f64);
            Some(Pose::new(pose.rotation()? * roll, pose.centre()))
        })
        .collect();
    let scores = scored(&truth, &rolled, PoseAlignment::Similarity);
    let relative = scores.relative.expect("neighbours");
    assert!((relative.rotation_rmse_degrees - 0.3).abs() < 1e-9);
    assert!(scores.ate_rmse.is_some_and(|ate| ate < 1e-9));
    // Pairs of two straight cameras, 66 of 276, have no error; the 144 mixed ones have 0.3 degrees, and two rolled
    // cameras at most 0.6.
    let [of_half, _, of_five] = [0, 1, 2].map(|number: usize| scores.auc[number].auc);
    assert!(of_five > 1.0 - 0.6 / 5.0 && of_five < 1.0, "{of_five}");
    let least = (66.0 + 144.0 * 0.4) / 276.0;
    assert!(
        of_half > least - 1e-6 && of_half < least + 66.0 / 276.0,
        "{of_half}"
    );
}

#[test]
fn missing_frames_cost_areas_and_the_share() {
    let truth = walk();
    let mut half = truth.clone();
    half[12..].fill(None);
    let scores = scored(&truth, &half, PoseAlignment::Similarity);
    assert_eq!((scores.frames, scores.registered_frames), (24, 12));
    let expected = (12.0 * 11.0) / (24.0 * 23.0);
    assert!((scores.auc[1].auc - expected).abs() < 1e-9);
    assert!(scores.ate_rmse_of_thirds[0].is_some() && scores.ate_rmse_of_thirds[2].is_none());
    let mut two = truth.clone();
    two[2..].fill(None);
    let estimate = PoseEstimate {
        name: "estimated",
        poses: &two,
        truth: None,
        alignment: PoseAlignment::Similarity,
    };
    let refusal = score_poses(&scene(&truth), &estimate).expect_err("too few");
    assert_eq!(
        refusal.to_string(),
        "scene walk/seq-000: 2 of 24 frames with a reference pose have one in estimated; scores need 3"
    );
    // True poses of their own stand in for those of the scene.
    let estimate = PoseEstimate {
        poses: &truth,
        truth: Some(("truth.txt", &half)),
        ..estimate
    };
    let scores = score_poses(&scene(&two), &estimate).expect("enough frames");
    assert_eq!(
        (scores.frames, scores.truth.as_deref()),
        (12, Some("truth.txt"))
    );
}

#[test]
fn lines_and_standing_cameras_are_told_in_a_line() {
    let along = |step: f64| -> Vec<Option<Pose>> {
        let pose = |number: u32| {
            let at = f64::from(number);
            let rotation = DQuat::from_rotation_x(0.1 * at);
            Some(Pose::new(rotation, step * at * DVec3::new(1.0, 0.5, -0.2)))
        };
        (0..10).map(pose).collect()
    };
    let line = along(0.4);
    let turn = DQuat::from_euler(glam::EulerRot::YXZ, 1.0, 0.4, -2.0);
    let elsewhere = moved(&line, 3.0, turn, DVec3::new(5.0, 1.0, 2.0));
    let scores = scored(&line, &elsewhere, PoseAlignment::Similarity);
    assert!(scores.notes[0].contains("on a line"), "{:?}", scores.notes);
    assert!(scores.ate_rmse.is_some_and(|ate| ate < 1e-9), "{scores:?}");
    assert!((scores.scale - 1.0 / 3.0).abs() < 1e-9);

    let scores = scored(&line, &along(-0.4), PoseAlignment::Similarity);
    assert!(scores.scale == 0.0 && scores.notes[1].contains("runs against"));
    let still = along(0.0);
    let scores = scored(&still, &line, PoseAlignment::Similarity);
    assert!(scores.notes[0].contains("stays in one place"));
    assert_eq!((scores.ate_rmse, scores.drift.len()), (None, 0));
    assert!(scores.auc.iter().all(|area| area.auc > 1.0 - 1e-9));
    let scores = scored(&line, &still, PoseAlignment::Similarity);
    assert!(scores.notes[0].contains("no scale") && scores.auc[2].auc < 1e-9);
    let text = pose_table(&scores);
    assert!(
        text.contains("AUC@0.5") && text.contains("note: "),
        "{text}"
    );
}

proptest! {
    /// No score but the scale depends on the world of the estimate.
    #[test]
    fn scores_do_not_depend_on_a_similarity(
        scale in 0.01_f64..100.0,
        axis in prop::array::uniform3(-3.0_f64..3.0),
        offset in prop::array::uniform3(-50.0_f64..50.0),
        degrees in 0.0_f64..3.0,
        length in 0.0_f64..0.2,
    ) {
        let truth = walk();
        let estimated = disturbed(&truth, degrees, length);
        let turn = DQuat::from_scaled_axis(DVec3::from_array(axis));
        let elsewhere = moved(&estimated, scale, turn, DVec3::from_array(offset));
        let here = scored(&truth, &estimated, PoseAlignment::Similarity);
        let there = scored(&truth, &elsewhere, PoseAlignment::Similarity);
        let near = |a: f64, b: f64| (a - b).abs() <= 1e-6 * (1.0 + a.abs());
        prop_assert!(near(here.ate_rmse.unwrap_or(-1.0), there.ate_rmse.unwrap_or(-2.0)));
        prop_assert!(near(here.scale, there.scale * scale));
        for (a, b) in here.auc.iter().zip(&there.auc) {
            prop_assert!(near(a.auc, b.auc));
        }
        for (a, b) in here.drift.iter().zip(&there.drift) {
            prop_assert!(near(a.translation_share, b.translation_share));
            prop_assert!(near(a.rotation_degrees, b.rotation_degrees));
        }
        // No alignment is better than that of least squares.
        let as_it_is: f64 = truth.iter().flatten().zip(estimated.iter().flatten())
            .map(|(a, b)| a.centre().distance_squared(b.centre()))
            .sum();
        let as_it_is = (as_it_is / truth.len() as f64).sqrt();
        prop_assert!(here.ate_rmse.unwrap_or(f64::MAX) <= as_it_is + 1e-9);
    }
}
