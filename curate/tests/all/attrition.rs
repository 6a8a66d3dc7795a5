//! Every second that goes in is kept or accounted for.

use std::{fs, path::Path};

use omnilife_curate::{
    CurateSettings, Place, attrition::Attrition, curate_dataset, curate_dataset_in, expand_inputs,
    ledger::merge::Evidence, left_out_of_folders,
};
use omnilife_schemas::{
    progress::Silent,
    records::{
        AuditDecision, AuditDecisions, LedgerAction, PersonRole, SegmentLabel, TimeRange,
        VideoStatus,
    },
    testing::Notes,
};
use support::{Clip, erp_clip, erp_direction, world_colour};

use crate::support;

#[test]
fn rejects_and_sequences_add_up_to_what_went_in() {
    let temp = tempfile::tempdir().unwrap();
    let walk = erp_clip(temp.path(), "walk.mp4", &[1, 3], 40, 20);
    let copy = temp.path().join("copy.mp4");
    fs::copy(&walk, &copy).unwrap();
    let text = temp.path().join("text.mp4");
    fs::write(&text, "dear diary").unwrap();
    let flat = temp.path().join("flat.mp4");
    Clip::steady(320, 180, 40, 20).write(&flat, |frame, x, y| {
        let (u, v) = (x as f64 / 160.0 - 1.0, y as f64 / 160.0 - 0.56);
        world_colour(1, [1.7 * u, 2.3 * v, 0.3 * u * v + 0.01 * frame as f64])
    });
    let short = temp.path().join("short.mp4");
    Clip::steady(256, 128, 60, 20).write(&short, |frame, x, y| {
        let world = if frame < 48 { 1 } else { 3 };
        world_colour(world, erp_direction(x, y, 256, 128, 0.01 * frame as f64))
    });
    let videos = [walk, copy, text, flat, short];
    let out = temp.path().join("out");
    let settings = CurateSettings {
        profile: "none".to_owned(),
        ..CurateSettings::default()
    };
    let notes = Notes::default();
    let curated = curate_dataset(&videos, &out, &settings, &notes).unwrap();
    assert!(
        matches!(&curated.record.videos[1].status, VideoStatus::Duplicate { of } if of.ends_with("walk.mp4"))
    );
    let said = notes.take().join("|");
    assert!(said.contains("copy.mp4: the same content as"), "{said}");
    assert!(
        said.contains("2 of 5 videos: 3 sequences, 6.4 of 13.0 s"),
        "{said}"
    );

    let attrition = Attrition::of(&curated.record, &out).unwrap();
    let counted: Vec<(&str, f64)> = attrition
        .rejects
        .iter()
        .map(|reject| (reject.check.as_str(), reject.seconds.unwrap_or(0.0)))
        .collect();
    assert_eq!(
        counted.iter().map(|(check, _)| *check).collect::<Vec<_>>(),
        ["duplicate", "readable", "projection", "shot-length"]
    );
    for ((_, seconds), expected) in counted.iter().zip([4.0, 0.0, 2.0, 0.6]) {
        assert!((seconds - expected).abs() < 1e-3, "{counted:?}");
    }
    let removed: f64 = attrition
        .funnel
        .iter()
        .map(|step| step.removed_seconds)
        .sum();
    let raw = attrition.funnel[0].left_seconds;
    assert!((raw - 13.0).abs() < 1e-3 && (raw - removed - attrition.kept_seconds).abs() < 1e-9);
    let kept = attrition.funnel.last().unwrap();
    assert_eq!((kept.step.as_str(), kept.left_videos), ("kept", 2));

    // The tables say the same, and the same again.
    let table = fs::read_to_string(out.join("attrition.csv")).unwrap();
    assert!(
        table
            .starts_with("video,check,value,threshold,begin_seconds,end_seconds,seconds,counted\n")
    );
    assert!(
        table.contains("projection,rectilinear,erp or erp-squeezed,,,2"),
        "{table}"
    );
    let funnel = fs::read_to_string(out.join("funnel.csv")).unwrap();
    assert!(
        funnel.starts_with("step,removed_videos,removed_seconds,"),
        "{funnel}"
    );
    curate_dataset(&videos, &out, &settings, &Silent).unwrap();
    assert_eq!(
        fs::read_to_string(out.join("attrition.csv")).unwrap(),
        table
    );
}

/// They are rows, and take no second out of what went in.
#[test]
fn files_of_a_folder_that_are_not_taken_are_in_both_records() {
    let temp = tempfile::tempdir().unwrap();
    let card = temp.path().join("card");
    fs::create_dir_all(card.join("trip")).unwrap();
    let video = erp_clip(&card, "walk.mp4", &[1], 40, 20);
    for file in ["front.360", "trip/ride.mp4"] {
        fs::copy(&video, card.join(file)).unwrap();
    }
    let inputs = [card];
    let videos = expand_inputs(&inputs).unwrap();
    let left_out = left_out_of_folders(&inputs, &videos).unwrap();
    let out = temp.path().join("out");
    let settings = CurateSettings {
        profile: "none".to_owned(),
        ..CurateSettings::default()
    };
    let place = Place::ThisProcess;
    let curated = curate_dataset_in(&place, &videos, &left_out.files, &out, &settings, &Silent);
    let record = curated.unwrap().record;
    let files: Vec<&str> = record
        .not_taken
        .iter()
        .map(|file| file.file.as_str())
        .collect();
    assert_eq!(files, ["front.360", "trip/ride.mp4"]);
    let attrition = Attrition::of(&record, &out).unwrap();
    let rows: Vec<_> = attrition
        .rejects
        .iter()
        .map(|row| (row.video.as_str(), row.check.as_str(), row.counted))
        .collect();
    assert_eq!(
        rows,
        [
            ("front.360", "input", false),
            ("trip/ride.mp4", "input", false)
        ]
    );
    let raw = &attrition.funnel[0];
    assert_eq!(raw.left_videos, 1);
    assert!((raw.left_seconds - attrition.kept_seconds).abs() < 1e-9);
    let table = fs::read_to_string(out.join("attrition.csv")).unwrap();
    assert!(table.contains("\ntrip/ride.mp4,input,"), "{table}");
    // Another run, of the video alone, has none of them.
    let curated = curate_dataset(&videos, &out, &settings, &Silent).unwrap();
    assert!(curated.record.not_taken.is_empty());
}

/// Says in a video's ledger that a part of it is left out.
fn leave_out(folder: &Path, [begin_seconds, end_seconds]: [f64; 2]) {
    let mut ledger = Evidence::read(folder).unwrap().ledger(folder).unwrap();
    let action = LedgerAction::Label(SegmentLabel {
        range: TimeRange::new(begin_seconds, end_seconds),
        scene: None,
        action: None,
        traversal: None,
        leave_out: Some(true),
    });
    let time = format!("2026-01-01T00:00:{:02}Z", begin_seconds.round());
    let decisions = AuditDecisions {
        source_sha256: ledger.source().sha256.clone(),
        author: "Ada".to_owned(),
        role: PersonRole::Annotator,
        decisions: vec![AuditDecision {
            time,
            reason: None,
            action,
        }],
    };
    assert_eq!(ledger.decide(&decisions).unwrap(), 1);
    ledger.write().unwrap();
}

#[test]
fn what_a_ledger_leaves_out_is_a_step_of_the_funnel() {
    let temp = tempfile::tempdir().unwrap();
    // Two shots of two seconds.
    let video = erp_clip(temp.path(), "walk.mp4", &[1, 3], 40, 20);
    let out = temp.path().join("out");
    let settings = CurateSettings {
        profile: "none".to_owned(),
        ..CurateSettings::default()
    };
    let curate = || {
        let curated = curate_dataset(std::slice::from_ref(&video), &out, &settings, &Silent);
        let record = curated.unwrap().record;
        let attrition = Attrition::of(&record, &out).unwrap();
        (record, attrition)
    };
    let (_, all) = curate();
    assert_eq!((all.kept_sequences, all.rejects.len()), (2, 0));
    let folder = out.join("videos/walk");

    leave_out(&folder, [0.0, 2.0]);
    let (_, one) = curate();
    let left_out = |attrition: &Attrition| {
        let step = attrition.funnel.iter().find(|step| step.step == "left-out");
        step.map(|step| (step.removed_videos, step.removed_seconds))
    };
    assert_eq!(one.kept_sequences, 1);
    let (videos, seconds) = left_out(&one).unwrap();
    assert!(videos == 0 && (seconds - 2.0).abs() < 1e-3, "{seconds}");
    assert!((one.kept_seconds - 2.0).abs() < 1e-3);
    let checks: Vec<&str> = one.rejects.iter().map(|row| row.check.as_str()).collect();
    assert_eq!(checks, ["left-out"]);

    // A video of which nothing is left is rejected, and counted as a whole.
    leave_out(&folder, [2.0, 4.0]);
    let (record, none) = curate();
    assert!(
        matches!(&record.videos[0].status, VideoStatus::Rejected { .. }),
        "{:?}",
        record.videos[0].status
    );
    let (videos, seconds) = left_out(&none).unwrap();
    assert!(videos == 1 && (seconds - 4.0).abs() < 1e-3, "{seconds}");
    assert_eq!((none.kept_sequences, none.kept_seconds), (0, 0.0));
}

/// The paper's criteria: every failed check with value and threshold, the first one counted.
#[test]
fn the_default_criteria_reject_with_value_and_threshold() {
    let temp = tempfile::tempdir().unwrap();
    let video = erp_clip(temp.path(), "walk.mp4", &[1], 40, 20);
    let out = temp.path().join("out");
    let settings = CurateSettings::default();
    let curated = curate_dataset(&[video], &out, &settings, &Silent).unwrap();
    let attrition = Attrition::of(&curated.record, &out).unwrap();
    let rows: Vec<_> = attrition
        .rejects
        .iter()
        .map(|row| {
            (
                row.check.as_str(),
                row.value.as_str(),
                row.threshold.as_str(),
                row.counted,
            )
        })
        .collect();
    assert_eq!(
        rows,
        [
            (
                "resolution",
                "256x128 pixels",
                "a width of at least 3840 pixels",
                true
            ),
            ("frame-rate", "20.000 fps", "at least 29.969 fps", false),
            ("duration", "2.00 s", "more than 30 s", false),
        ]
    );
    assert_eq!(attrition.kept_sequences, 0);
    assert!(attrition.funnel.last().unwrap().left_seconds.abs() < 1e-9);
}
