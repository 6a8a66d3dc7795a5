//! Five still panoramas, from a folder to scores.

use std::fs;

use omnilife_schemas::{
    records::{PosedFrame, Poses, Scale, Scene, Sequence, Split},
    store,
};

use crate::support::{SEQUENCE, omnilife, small_run};

/// Frames of the sample that are used as stills.
const CHOSEN: [usize; 5] = [0, 2, 4, 6, 8];

#[test]
fn five_stills_become_a_scored_scene() {
    let folder = tempfile::tempdir().unwrap();
    let stills = folder.path().join("stills");
    fs::create_dir(&stills).unwrap();
    let sequence = small_run().out.join(SEQUENCE);
    let scene: Scene = store::read_record(&sequence.join("scene.json")).unwrap();
    let mut frames = Vec::new();
    for (number, &frame) in CHOSEN.iter().enumerate() {
        let frame = &scene.frames[frame];
        // Natural order differs from that of the letters.
        let name = format!("R{}.png", number + 8);
        fs::copy(sequence.join(&frame.image), stills.join(name)).unwrap();
        frames.push(PosedFrame::new(number as f64, frame.pose.unwrap()));
    }
    let poses = Poses::new(Scale::Metres, None, frames);
    let poses_file = folder.path().join("poses.json");
    store::write_record(&poses_file, &poses).unwrap();
    let out = folder.path().join("out");
    let path = |path: &std::path::Path| path.to_str().unwrap().to_owned();
    let ended = omnilife([
        "run",
        &path(&stills),
        "--poses",
        &path(&poses_file),
        "--method",
        "odgs",
        "--iterations",
        "20",
        "--protocol",
        "alternate-frames",
        "--out",
        &path(&out),
    ])
    .succeeded();
    assert!(ended.stdout.contains("stills/seq-000"), "{}", ended.stdout);
    let made = out.join("videos/stills/seq-000");
    let sequence: Sequence = store::read_record(&made.join("sequence.json")).unwrap();
    assert_eq!(sequence.frames.entries.len(), CHOSEN.len());
    let scene: Scene = store::read_record(&made.join("scene.json")).unwrap();
    assert_eq!(scene.scale, Scale::Metres);
    for (frame, given) in scene.frames.iter().zip(&poses.frames) {
        let apart = frame.pose.unwrap().centre().distance(given.pose.centre());
        assert!(apart < 1e-9, "{apart}");
    }

    // Input views can be named.
    let split_file = folder.path().join("split.json");
    let split = [
        "bench",
        "split",
        &path(&made),
        "--protocol",
        "sparse-panoramas",
        "--out",
        &path(&split_file),
    ];
    let refused = omnilife(split);
    assert_eq!(refused.code, Some(2), "{}", refused.stderr);
    omnilife([&split[..], &["--given", "4,0"]].concat()).succeeded();
    let named: Split = store::read_record(&split_file).unwrap();
    assert_eq!(
        (named.input_views, named.novel_views),
        (vec![0, 4], vec![1, 2, 3])
    );
}
