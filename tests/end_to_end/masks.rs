//! Dynamic masks on their way into a scene.

use std::fs;

use omnilife_schemas::{
    records::{ResultRecord, Scene},
    store,
};

use crate::support::{SEQUENCE, copy_of_small_run, omnilife, sample};

/// Masks that are made after the poses enter the scene, nothing is posed again, and scores use them.
#[test]
fn masks_that_are_made_after_the_poses_enter_the_scene() {
    let copy = copy_of_small_run();
    let sequence = copy.path().join(SEQUENCE);
    let text = |path: &std::path::Path| path.to_str().unwrap().to_owned();
    let seq = text(&sequence);
    let poses = copy.path().join("poses.json");
    let mut record: serde_json::Value =
        serde_json::from_slice(&fs::read(sample("poses.json")).unwrap()).unwrap();
    for frame in record["frames"].as_array_mut().unwrap() {
        frame.as_object_mut().unwrap().remove("mask");
    }
    record.as_object_mut().unwrap().remove("points");
    fs::write(&poses, record.to_string()).unwrap();
    let pose = ["curate", "poses", &seq, "--poses", &text(&poses)];
    omnilife(pose).succeeded();
    let read = || -> Scene { store::read_record(&sequence.join("scene.json")).unwrap() };
    let before = read();
    assert!(before.frames.iter().all(|frame| frame.mask.is_none()));

    let masks = ["curate", "masks", &seq, "--from", &text(&sample("masks"))];
    let ended = omnilife(masks).succeeded();
    assert!(
        ended.stdout.contains("entered into its scene"),
        "{}",
        ended.stdout
    );
    let after = read();
    assert!(after.frames.iter().all(|frame| frame.mask.is_some()));
    for (before, after) in before.frames.iter().zip(&after.frames) {
        assert_eq!((&before.image, &before.pose), (&after.image, &after.pose));
    }
    // Posed again, the scene is unchanged; so it is where the masks are made again.
    let again = omnilife(pose).succeeded();
    assert!(again.stderr.contains("unchanged"), "{}", again.stderr);
    let again = omnilife(masks).succeeded();
    assert!(
        again.stdout.contains("entered into its scene"),
        "{}",
        again.stdout
    );
    assert_eq!(read(), after);

    let split = text(&copy.path().join("split.json"));
    omnilife(["bench", "split", &seq, "--out", &split]).succeeded();
    let frames = text(&sequence.join("frames"));
    let scores = text(&copy.path().join("scores"));
    omnilife([
        "bench",
        "score",
        "--scene",
        &seq,
        "--split",
        &split,
        "--novel-views",
        &frames,
        "--method",
        "truth",
        "--out",
        &scores,
    ])
    .succeeded();
    let result: ResultRecord = store::read_record(&copy.path().join("scores/result.json")).unwrap();
    assert!(result.novel_views.contains_key("psnr-dynamic"));

    // Other masks do not replace them silently.
    let other = copy.path().join("other");
    fs::create_dir(&other).unwrap();
    for frame in 0..10 {
        let name = format!("{frame:06}.png");
        fs::copy(sample("masks/000033.png"), other.join(name)).unwrap();
    }
    let ended = omnilife(["curate", "masks", &seq, "--from", &text(&other)]).succeeded();
    assert!(
        ended.stdout.contains("has other masks already") && ended.stdout.contains("curate poses"),
        "{}",
        ended.stdout
    );
    assert_eq!(read(), after);
}
