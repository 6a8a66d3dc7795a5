//! Dynamic masks on their way into a scene.

use std::{fs, path::Path};

use omnilife_schemas::{
    records::{Masks, ResultRecord, Scene},
    rgb::Mask,
    store,
};

use crate::support::{SEQUENCE, SMALL, copy_of_small_run, omnilife, sample, scratch};

/// Returns the sample's poses without masks and points.
fn poses_without_masks() -> String {
    let mut record: serde_json::Value =
        serde_json::from_slice(&fs::read(sample("poses.json")).unwrap()).unwrap();
    for frame in record["frames"].as_array_mut().unwrap() {
        frame.as_object_mut().unwrap().remove("mask");
    }
    record.as_object_mut().unwrap().remove("points");
    record.to_string()
}

/// Masks that are made after the poses enter the scene, nothing is posed again, and scores use them.
#[test]
fn masks_that_are_made_after_the_poses_enter_the_scene() {
    let copy = copy_of_small_run();
    let sequence = copy.path().join(SEQUENCE);
    let text = |path: &Path| path.to_str().unwrap().to_owned();
    let seq = text(&sequence);
    let poses = copy.path().join("poses.json");
    fs::write(&poses, poses_without_masks()).unwrap();
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
    omnilife(format!("bench score --scene {seq} --split {split} --novel-views {frames} --method truth --out {scores}").split(' '))
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

/// The main job takes the masks of a program; one that fails in any way leaves the sequence without masks, in a line.
#[cfg(unix)]
#[test]
fn the_main_job_goes_on_without_the_masks_of_a_program_that_fails() {
    let folder = scratch();
    let at = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    fs::write(at("poses.json"), poses_without_masks()).unwrap();
    let (video, masks) = (sample("street.mp4"), sample("masks"));
    let (video, masks) = (video.to_str().unwrap(), masks.to_str().unwrap());
    let run = |script: &str, further: &[&str]| {
        fs::write(at("net.sh"), script).unwrap();
        let command = format!("sh {} {{frames}} {{out}}", at("net.sh"));
        let (poses, out) = (at("poses.json"), at("out"));
        let mut words = vec!["run", video, "--poses", &poses, "--out", &out];
        words.extend(["--masks-command", &command]);
        words.extend(SMALL.iter().chain(further));
        let ended = omnilife(words).succeeded();
        let sequence = folder.path().join("out").join(SEQUENCE);
        let scene: Scene = store::read_record(&sequence.join("scene.json")).unwrap();
        let has_masks = scene.frames.iter().all(|frame| frame.mask.is_some());
        (ended.stderr, has_masks)
    };
    let square = Mask::new(2, 2, vec![0; 4]);
    square.write_png(&folder.path().join("square.png")).unwrap();
    let squares = format!(
        "for frame in $1/*; do cp {} $2/$(basename $frame); done",
        at("square.png")
    );
    let none: &[&str] = &[];
    for (script, further, reason) in [
        ("echo no weights >&2; exit 3", none, "no weights"),
        ("sleep 300", &["--command-timeout", "1"][..], "time limit"),
        ("true", none, "0 of 10 frames"),
        (squares.as_str(), none, "shape of its frame"),
    ] {
        let (stderr, has_masks) = run(script, further);
        let mut lines = stderr.lines();
        let line = lines.find(|line| line.contains("goes on without masks"));
        let line = line.unwrap_or_else(|| panic!("{stderr}"));
        assert!(line.contains("seq-000") && line.contains(reason), "{line}");
        assert!(!has_masks, "{script}");
    }
    let good = format!("for frame in $1/*; do cp {masks}/$(basename $frame) $2/; done");
    let (stderr, has_masks) = run(&good, &[]);
    assert!(has_masks, "{stderr}");
    let record = Path::new(&at("out"))
        .join(SEQUENCE)
        .join("dynamic-masks/masks.json");
    let record: Masks = store::read_record(&record).unwrap();
    assert_eq!(record.method, "command");
    assert!(record.settings.contains("net.sh"), "{}", record.settings);
}

/// A detector below its bar is off, in a line that names the option that turns it on.
#[test]
fn the_main_job_says_which_detectors_are_off() {
    let folder = scratch();
    let at = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    fs::write(at("poses.json"), poses_without_masks()).unwrap();
    let video = sample("street.mp4");
    let (poses, out) = (at("poses.json"), at("out"));
    let mut words = vec!["run", video.to_str().unwrap(), "--poses", &poses];
    words.extend(["--out", &out, "--method", "omni4dgs"]);
    words.extend(SMALL);
    let ended = omnilife(&words).succeeded();
    if omnilife_curate::masks::default_method().is_none() {
        assert!(ended.stderr.contains("--masks-method"), "{}", ended.stderr);
    }
    words.extend(["--masks", "none"]);
    let ended = omnilife(&words).succeeded();
    assert!(!ended.stderr.contains("--masks-method"), "{}", ended.stderr);
}

/// Without a detector that reaches its bar, `curate masks` has to be given one.
#[test]
fn masks_without_a_method_name_the_scores_of_all() {
    if omnilife_curate::masks::default_method().is_some() {
        return;
    }
    let copy = copy_of_small_run();
    let sequence = copy.path().join(SEQUENCE);
    let ended = omnilife(["curate", "masks", sequence.to_str().unwrap()]);
    assert_eq!(ended.code, Some(2), "{}", ended.stderr);
    assert_eq!(ended.stderr.lines().count(), 1, "{}", ended.stderr);
    for method in omnilife_curate::masks::METHODS {
        assert!(ended.stderr.contains(method.id), "{}", ended.stderr);
    }
    assert!(ended.stderr.contains("--method"), "{}", ended.stderr);
    assert!(!sequence.join("dynamic-masks/masks.json").exists());
}
