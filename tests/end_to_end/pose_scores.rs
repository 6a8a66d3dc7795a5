//! `bench poses` on the sample: its own poses, a trajectory of another tool, and refusals.

use std::fs;

use omnilife_schemas::{
    records::{PoseScores, Scene},
    store,
};

use crate::support::{SEQUENCE, omnilife, sample, scratch, small_run};

#[test]
fn trajectories_are_scored_against_the_scene() {
    let sequence = small_run().out.join(SEQUENCE);
    let folder = scratch();
    let score = |trajectory: &str, further: &[&str]| {
        let mut arguments = vec!["bench", "poses", trajectory, "--scene"];
        arguments.push(sequence.to_str().unwrap());
        arguments.extend(further);
        omnilife(arguments)
    };
    let poses = sample("poses.json");
    let own = score(poses.to_str().unwrap(), &[]).succeeded().stdout;
    assert!(
        own.contains("registered      10 of 10 frames (100.0 %)"),
        "{own}"
    );
    assert!(own.contains("AUC@0.5         1.0000"), "{own}");

    // Half of the frames, in a world of twice the size.
    let scene: Scene = store::read_record(&sequence.join("scene.json")).unwrap();
    let lines: Vec<String> = scene.frames[..5]
        .iter()
        .map(|frame| {
            let pose = frame.pose.unwrap();
            let [w, x, y, z] = pose.rotation_wxyz;
            let [a, b, c] = pose.centre.map(|value| 2.0 * value);
            format!("{} {a} {b} {c} {x} {y} {z} {w}\n", frame.time_seconds)
        })
        .collect();
    let trajectory = folder.path().join("walk.txt");
    fs::write(&trajectory, lines.concat()).unwrap();
    let record = folder.path().join("pose-scores.json");
    let trajectory = trajectory.to_str().unwrap();
    score(trajectory, &["--out", record.to_str().unwrap()]).succeeded();
    let scores: PoseScores = store::read_record(&record).unwrap();
    assert_eq!((scores.frames, scores.registered_frames), (10, 5));
    assert!((scores.scale - 0.5).abs() < 1e-6, "{scores:?}");
    assert!(scores.ate_rmse.unwrap() < 1e-6 * scores.path_length);
    assert!((scores.auc[1].auc - 10.0 / 45.0).abs() < 1e-6, "{scores:?}");

    fs::write(folder.path().join("two.txt"), lines[..2].concat()).unwrap();
    let two = folder.path().join("two.txt");
    let ended = score(two.to_str().unwrap(), &[]);
    let line = ended.failed_quietly(2);
    assert!(line.contains("2 of 10 frames"), "{line}");
    let ended = score(trajectory, &["--poses-convention", "camera-to-world"]);
    let line = ended.failed_quietly(2);
    assert!(line.contains("no .npy is given"), "{line}");
}
