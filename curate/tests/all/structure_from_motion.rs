//! Structure from motion on the sample clip, judged by its exact poses.
//! Skipped, with the reason, where structure from motion is not installed.

use std::path::Path;

use glam::{DQuat, DVec3};
use omnilife_curate::{
    CurateSettings, PoseRequest, SfmSettings, curate_video, pose_sequence, poses::sfm,
};
use omnilife_schemas::{
    progress::Silent,
    records::{Poses, Sampling, Scale, ValidationStatus},
    store,
};

#[test]
fn the_sample_clip_is_posed_to_a_tenth_of_a_degree() {
    if let Err(reason) = sfm::installation() {
        omnilife_schemas::testing::skip(reason);
        return;
    }
    let sample = Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests/data/street");
    let temp = tempfile::tempdir().unwrap();
    let settings = CurateSettings {
        enforce: false,
        sampling: Sampling::MaxFrames(30),
        ..CurateSettings::default()
    };
    let out = temp.path().join("street");
    curate_video(&sample.join("street.mp4"), &out, &settings, &Silent).unwrap();
    let request = PoseRequest::Sfm(SfmSettings::default());
    let scene = pose_sequence(&out.join("seq-000"), &request, &Silent).unwrap();
    assert_eq!(
        scene.validation.status,
        ValidationStatus::Valid,
        "{:?}",
        scene.validation
    );
    assert_eq!(scene.scale, Scale::Arbitrary);
    assert!(out.join("seq-000/points.ply").is_file());

    let truth: Poses = store::read_record(&sample.join("poses.json")).unwrap();
    let pairs: Vec<(DQuat, DQuat)> = scene
        .frames
        .iter()
        .filter_map(|frame| {
            let exact = truth
                .frames
                .iter()
                .find(|other| (other.time_seconds - frame.time_seconds).abs() < 1e-3)?;
            Some((frame.pose?.rotation()?, exact.pose.rotation()?))
        })
        .collect();
    assert_eq!(pairs.len(), 30);
    // Worlds differ by a rotation: rotations between frames do not see it.
    for (index, (found, exact)) in pairs.iter().enumerate().skip(1) {
        let turned = pairs[0].0.inverse() * *found;
        let should = pairs[0].1.inverse() * *exact;
        let error = turned.angle_between(should).to_degrees();
        assert!(error < 0.1, "frame {index}: {error} degrees");
    }
    // Levelled: the camera was held upright.
    let up: DVec3 = pairs.iter().map(|(found, _)| *found * DVec3::NEG_Y).sum();
    assert!(up.normalize().dot(DVec3::NEG_Y) > 0.999);
}
