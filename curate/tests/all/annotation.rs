//! Annotations by people and programs, and refusals.

use std::{
    fs,
    os::unix::fs::PermissionsExt,
    path::{Path, PathBuf},
    time::{Duration, Instant},
};

use omnilife_curate::{
    CurateSettings,
    annotation::{AnnotateSettings, CaptionCommand, annotate_dataset},
    curate_dataset,
    publish::{PublishSettings, publish, verify},
};
use omnilife_schemas::{
    layout::ANNOTATION_FILE,
    progress::Silent,
    records::{Annotation, Sampling, Sequence, VideoProjection},
    store,
    testing::Notes,
};
use support::{Clip, erp_clip, erp_direction, world_colour};
use tempfile::TempDir;

use crate::support;

/// A dataset of one video.
fn dataset() -> (TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let video = erp_clip(folder.path(), "walk.mp4", &[1], 20, 10);
    let out = folder.path().join("set");
    let settings = CurateSettings {
        enforce: false,
        sampling: Sampling::MaxFrames(10),
        ..CurateSettings::default()
    };
    let curated = curate_dataset(&[video], &out, &settings, &Silent).unwrap();
    assert!(curated.errors.is_empty(), "{:?}", curated.errors);
    (folder, out)
}

fn annotation(out: &Path, sequence: &str) -> Annotation {
    store::read_record(&out.join("videos/walk").join(sequence).join(ANNOTATION_FILE)).unwrap()
}

fn program(folder: &Path, name: &str, script: &str) -> CaptionCommand {
    let path = folder.join(name);
    fs::write(&path, format!("#!/bin/sh\n{script}\n")).unwrap();
    fs::set_permissions(&path, fs::Permissions::from_mode(0o755)).unwrap();
    CaptionCommand {
        program: path.display().to_string(),
        arguments: vec!["--style".to_owned(), "plain words".to_owned()],
        timeout: Duration::from_secs(20),
    }
}

#[test]
fn people_and_programs_annotate_and_motion_is_measured() {
    let (folder, out) = dataset();
    let table = folder.path().join("tags.csv");
    fs::write(
        &table,
        "sequence,author,scene,action,traversal,caption\n\
         walk/seq-000,Ada,night-market,walking,true,\"Stalls, lights.\"\n",
    )
    .unwrap();
    // Answers with how many frames and which arguments it got.
    let script = r#"frames=$(grep -o '"file"' | wc -l)
printf '{"caption": "%s frames, %s", "scene": "beach"}' "$frames" "$2""#;
    let settings = AnnotateSettings {
        tags: vec![table.clone()],
        ..AnnotateSettings::default()
    };
    assert_eq!(annotate_dataset(&out, &settings, &Silent).unwrap(), 1);
    let first = annotation(&out, "seq-000");
    assert_eq!(first.group.as_deref(), Some("urban-outdoor"));
    assert_eq!(first.scene.as_ref().unwrap().author, "Ada");
    assert!(first.traversal);
    assert_eq!(first.captions[0].text, "Stalls, lights.");
    // 0.2 radians per second, without parallax: the action's class stands beside the measured one.
    assert_eq!(
        first.ego_motion.of_action.as_deref(),
        Some("walking-and-daily")
    );
    let measured = first.ego_motion.measured.as_ref().unwrap();
    let turn = measured
        .evidence
        .iter()
        .find(|e| e.test == "turn_median_degrees_per_second")
        .unwrap();
    assert!((turn.value - 11.46).abs() < 0.5, "{turn:?}");
    assert_eq!(first.dynamics.as_ref().unwrap().class, "low");

    let command = program(folder.path(), "captioner", script);
    let settings = AnnotateSettings {
        command: Some(command),
        ..AnnotateSettings::default()
    };
    annotate_dataset(&out, &settings, &Silent).unwrap();
    annotate_dataset(&out, &settings, &Silent).unwrap();
    let second = annotation(&out, "seq-000");
    // Ada's other statements stay; the program is named without its folder, and once.
    assert_eq!(second.action, first.action);
    assert_eq!(second.captions.len(), 2);
    assert_eq!(second.captions[1].author, "captioner");
    assert_eq!(second.captions[1].text, "8 frames, plain words");
    assert_eq!(second.group.as_deref(), Some("natural-outdoor"));

    let statistics = publish(&out, &PublishSettings::default(), &Silent).unwrap();
    assert_eq!(statistics.rows[0].scene, "beach");
    assert_eq!(statistics.rows[0].ego_motion, "walking-and-daily");
    assert_eq!(verify(&out, &Silent).unwrap(), [""; 0]);
    if let Some(keep) = std::env::var_os("OMNILIFE_KEEP_FIGURES") {
        for entry in fs::read_dir(out.join("statistics")).unwrap() {
            let path = entry.unwrap().path();
            fs::copy(&path, Path::new(&keep).join(path.file_name().unwrap())).unwrap();
        }
    }
}

/// The paper's average sequence: 98 s at 30 frames a second, of which 120 are sampled.
#[test]
fn motion_of_a_long_sequence_is_known_by_default() {
    let folder = tempfile::tempdir().unwrap();
    let video = folder.path().join("walk.mp4");
    let (width, height) = (128, 64);
    Clip::steady(width, height, 98 * 30, 30).write(&video, |frame, x, y| {
        let yaw = 0.2 * frame as f64 / 30.0;
        world_colour(1, erp_direction(x, y, width, height, yaw))
    });
    let out = folder.path().join("set");
    let settings = CurateSettings {
        enforce: false,
        accept: Some(VideoProjection::Erp),
        ..CurateSettings::default()
    };
    let notes = Notes::default();
    let curated = curate_dataset(&[video], &out, &settings, &notes).unwrap();
    assert!(curated.errors.is_empty(), "{:?}", curated.errors);
    let place = out.join("videos/walk/seq-000");
    let sequence: Sequence = store::read_record(&place.join("sequence.json")).unwrap();
    let entries = &sequence.frames.entries;
    assert!(entries[1].time_seconds - entries[0].time_seconds > 0.8);
    assert_eq!(sequence.motion_frames.len(), 48);
    assert!(
        (sequence.motion_frames.iter()).all(|entry| place.join(&entry.file).is_file()),
        "{:?}",
        sequence.motion_frames
    );
    let curated = notes.take().join("\n");
    assert!(!curated.contains("not measured"), "{curated}");
    annotate_dataset(&out, &AnnotateSettings::default(), &notes).unwrap();
    let said = notes.take().join("\n");
    assert!(
        !said.contains("unknown") && !said.contains("not measured"),
        "{said}"
    );
    let annotation = annotation(&out, "seq-000");
    let motion = annotation.ego_motion.measured.unwrap();
    assert_eq!(motion.class, "walking-and-daily");
    let turn = &motion.evidence[1];
    assert_eq!(turn.test, "turn_median_degrees_per_second");
    assert!((turn.value - 11.46).abs() < 1.5, "{turn:?}");
    assert_eq!(annotation.dynamics.unwrap().class, "low");
    // A second run finds everything in place.
    let video = folder.path().join("walk.mp4");
    curate_dataset(&[video], &out, &settings, &notes).unwrap();
    let said = notes.take().join("\n");
    assert!(said.contains("frames of 1 sequence unchanged"), "{said}");
    let kept: Sequence = store::read_record(&place.join("sequence.json")).unwrap();
    assert_eq!(kept, sequence);
}

#[test]
fn what_is_wrong_with_an_annotation_is_said_in_one_line() {
    let (folder, out) = dataset();
    let message = |settings: &AnnotateSettings| {
        let message = annotate_dataset(&out, settings, &Silent)
            .unwrap_err()
            .to_string();
        assert!(!message.contains('\n'), "{message}");
        message
    };
    let with_table = |content: &str| {
        let table = folder.path().join("tags.csv");
        fs::write(&table, content).unwrap();
        message(&AnnotateSettings {
            tags: vec![table],
            ..AnnotateSettings::default()
        })
    };
    let head = "sequence,author,scene,action\n";
    let said = with_table(&format!("{head}walk/seq-000,Ada,night-marked,\n"));
    assert!(
        said.contains("night-marked is not among the scenes of taxonomy 1.0"),
        "{said}"
    );
    let said = with_table(&format!("{head}walk/seq-007,Ada,beach,\n"));
    assert!(
        said.contains("walk/seq-007 is not a sequence of this dataset"),
        "{said}"
    );
    let said = with_table("sequence,writer\nwalk/seq-000,Ada\n");
    assert!(
        said.contains("tags.csv") && said.contains("writer"),
        "{said}"
    );

    let with_command = |command: CaptionCommand| {
        message(&AnnotateSettings {
            command: Some(command),
            ..AnnotateSettings::default()
        })
    };
    let missing = CaptionCommand {
        program: "/nonexistent/captioner".to_owned(),
        ..program(folder.path(), "unused", "true")
    };
    assert!(
        with_command(missing)
            .contains("/nonexistent/captioner: captioning walk/seq-000: cannot be run")
    );
    let said = with_command(program(folder.path(), "chatty", "echo a market at night"));
    assert!(
        said.contains("its answer is not the JSON asked for"),
        "{said}"
    );
    let said = with_command(program(
        folder.path(),
        "broken",
        "echo no model >&2; exit 3",
    ));
    assert!(
        said.contains("exit status: 3") && said.ends_with("no model"),
        "{said}"
    );
    let said = with_command(program(
        folder.path(),
        "wrong",
        "echo '{\"action\": \"napping\"}'",
    ));
    assert!(said.contains("napping is not among the actions"), "{said}");
    let slow = CaptionCommand {
        timeout: Duration::from_millis(300),
        ..program(folder.path(), "slow", "exec sleep 30")
    };
    let started = Instant::now();
    let said = with_command(slow);
    assert!(said.contains("took longer than 0.3 s"), "{said}");
    // Its child process holds the pipes open, and ends with it.
    let parent = CaptionCommand {
        timeout: Duration::from_millis(300),
        ..program(folder.path(), "parent", "sleep 30 & wait")
    };
    let said = with_command(parent);
    assert!(said.contains("took longer than 0.3 s"), "{said}");
    let endless = with_command(program(folder.path(), "endless", "exec yes"));
    assert!(
        endless.contains("answers more than 1048576 bytes"),
        "{endless}"
    );
    assert!(started.elapsed() < Duration::from_secs(20));
}
