//! Footage that is there twice in different files is told, and nothing is dropped for it.
#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

mod support;

use std::{f64::consts::TAU, fs};

use omnilife_curate::{
    CurateSettings,
    attrition::{Attrition, NEAR_DUPLICATE},
    curate_dataset,
    near_duplicates::find,
    publish::{PublishSettings, publish, verify},
};
use omnilife_schemas::{
    progress::Silent,
    records::{Sampling, VideoStatus},
};
use support::{Clip, Notes, erp_direction, world_colour};

/// The world at a moment, seen by a camera that is turned by `yaw` radians: it is lit by waves that go
/// up and down.
fn lit(seconds: f64, direction: [f64; 3], phase: f64) -> [f64; 3] {
    let light = |number: f64| {
        let beat = (1.3 + 0.4 * number) * seconds + phase * (1.0 + number);
        1.0 + 0.3 * beat.sin() * (1.0 + direction[1] * number)
    };
    let colour = world_colour(2, direction);
    std::array::from_fn(|channel| colour[channel] * light(channel as f64))
}

#[test]
fn encoded_again_cropped_and_turned_footage_is_told_and_kept() {
    let temp = tempfile::tempdir().unwrap();
    let clip = |name: &str,
                (width, height, fps): (usize, usize, i64),
                span: [f64; 2],
                yaw: f64,
                phase: f64| {
        let path = temp.path().join(name);
        let frames = ((span[1] - span[0]) * fps as f64) as usize;
        Clip::steady(width, height, frames, fps).write(&path, |frame, x, y| {
            let seconds = span[0] + frame as f64 / fps as f64;
            lit(seconds, erp_direction(x, y, width, height, yaw), phase)
        });
        path
    };
    let videos = [
        clip("first.mp4", (256, 128, 25), [0.0, 8.0], 0.0, 0.0),
        clip("again.mp4", (192, 96, 20), [2.0, 8.0], TAU * 0.3, 0.0),
        // The same place at another time.
        clip("later.mp4", (256, 128, 25), [40.0, 46.0], 0.0, 1.7),
    ];
    let out = temp.path().join("set");
    let settings = CurateSettings {
        profile: "none".to_owned(),
        sampling: Sampling::MaxFrames(2),
        width: Some(64),
        ..CurateSettings::default()
    };
    let notes = Notes::default();
    let curated = curate_dataset(&videos, &out, &settings, &notes).unwrap();
    for video in &curated.record.videos {
        assert!(
            matches!(video.status, VideoStatus::Curated { .. }),
            "{video:?}"
        );
    }
    let found = find(&curated.record, &out).unwrap();
    assert_eq!(found.len(), 1, "{found:?}");
    let pair = &found[0];
    assert_eq!((pair.video, pair.of), (1, 0));
    assert!((pair.begin_in_other_seconds - 2.0).abs() < 0.3, "{pair:?}");
    assert!(
        pair.begin_seconds < 0.3 && (pair.seconds - 6.0).abs() < 0.6,
        "{pair:?}"
    );
    assert!(!pair.is_still, "{pair:?}");
    let said = notes.take().join("|");
    assert!(
        said.contains("again.mp4: looks like") && said.contains("both are kept"),
        "{said}"
    );

    let attrition = Attrition::of(&curated.record, &out).unwrap();
    let row = attrition.rejects.last().unwrap();
    assert_eq!((row.check.as_str(), row.counted), (NEAR_DUPLICATE, false));
    assert_eq!(attrition.funnel.last().unwrap().left_videos, 3);
    let table = fs::read_to_string(out.join("attrition.csv")).unwrap();
    assert!(table.contains("near-duplicate"), "{table}");
    drop(curated);
    publish(&out, &PublishSettings::default(), &Silent).unwrap();
    assert_eq!(verify(&out, &Silent).unwrap(), [""; 0]);

    // A damaged signature is one line with its name.
    fs::write(out.join("videos/again/signature.parquet"), "x").unwrap();
    let record = omnilife_schemas::store::read_record(&out.join("dataset.json")).unwrap();
    let message = find(&record, &out).unwrap_err().to_string();
    assert!(
        message.contains("signature.parquet") && message.lines().count() == 1,
        "{message}"
    );
}
