//! Poses as matrices of a `.npy`.

use omnilife_schemas::{
    npy,
    records::{PoseConvention, PoseSource},
};

use super::*;

/// The rows of matrices that lead from the camera to the world.
fn to_world(poses: &[Pose]) -> Vec<f32> {
    let rows = |pose: &Pose| -> Vec<f32> {
        let rotation = DMat3::from_quat(pose.rotation().unwrap()).transpose();
        let row = |number: usize| {
            let [x, y, z] = rotation.col(number).to_array();
            [x, y, z, pose.centre[number]].map(|value| value as f32)
        };
        [row(0), row(1), row(2), [0.0, 0.0, 0.0, 1.0]].concat()
    };
    poses.iter().flat_map(rows).collect()
}

fn pose_by(
    sequence: &Path,
    file: &Path,
    convention: Option<PoseConvention>,
) -> Result<Scene, String> {
    let truth = GivenTruth {
        pose_convention: convention,
        ..GivenTruth::default()
    };
    let request = PoseRequest::Given(file.to_owned());
    pose_sequence_with(sequence, &request, &truth, &Silent).map_err(|error| error.to_string())
}

#[test]
fn matrices_are_those_of_the_frames_in_their_order() {
    let temp = tempfile::tempdir().unwrap();
    let sequence = sequence_of_twenty(temp.path());
    let file = temp.path().join("all_poses.npy");
    let truth: Vec<Pose> = (0..20).map(|step| pose_at(f64::from(step))).collect();
    npy::write_f32(&file, &[20, 4, 4], &to_world(&truth)).unwrap();
    let convention = Some(PoseConvention::CameraToWorld);
    let scene = pose_by(&sequence, &file, convention).unwrap();
    assert_eq!(scene.validation.registered_frames, 20);
    for (frame, truth) in scene.frames.iter().zip(&truth) {
        let pose = frame.pose.unwrap();
        assert!(pose.centre().distance(truth.centre()) < 1e-5);
        let turn = pose.rotation().unwrap();
        assert!(turn.angle_between(truth.rotation().unwrap()) < 1e-5);
    }
    let source = PoseSource::Matrices {
        file: "all_poses.npy".to_owned(),
        convention: PoseConvention::CameraToWorld,
    };
    assert_eq!(scene.pose_source, source);

    // The same numbers the other way round are other poses.
    let other = pose_by(&sequence, &file, Some(PoseConvention::WorldToCamera)).unwrap();
    let centre = other.frames[7].pose.unwrap().centre();
    let expected = -(truth[7].rotation().unwrap().inverse() * truth[7].centre());
    assert!(centre.distance(expected) < 1e-5, "{centre}");

    // A forgotten convention does not cost existing files.
    let message = pose_by(&sequence, &file, None).unwrap_err();
    assert!(
        message.contains("all_poses.npy") && !message.contains('\n'),
        "{message}"
    );
    let kept: Scene = store::read_record(&sequence.join("scene.json")).unwrap();
    assert_eq!(kept, other);
    npy::write_f32(&file, &[19, 4, 4], &to_world(&truth[1..])).unwrap();
    let message = pose_by(&sequence, &file, convention).unwrap_err();
    assert!(message.contains("19 matrices for 20 frames"), "{message}");
}
