//! Footage that is there twice in different files is told, and nothing is dropped for it.

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
    testing::Notes,
};
use support::{Clip, erp_direction, world_colour};

use crate::support;

/// The world at a moment, in light that changes by the second in no order; `take` says in which.
fn lit(seconds: f64, direction: [f64; 3], take: u64) -> [f64; 3] {
    // The mixing steps of SplitMix64.
    let knot = |at: u64, number: u64| {
        let mut bits = (at + 1000 * take) * 7 + number + 1;
        for factor in [0xbf58_476d_1ce4_e5b9_u64, 0x94d0_49bb_1331_11eb] {
            bits = (bits ^ (bits >> 30)).wrapping_mul(factor) ^ (bits << 7);
            bits ^= bits >> 29;
        }
        (bits >> 40) as f64 / f64::from(1 << 24) - 0.5
    };
    let light = |number: u64| {
        let (at, share) = (seconds.floor() as u64, seconds.fract());
        knot(at, number) * (1.0 - share) + knot(at + 1, number) * share
    };
    let colour = world_colour(2, direction);
    std::array::from_fn(|channel| {
        let change = light(channel as u64) + direction[1] * light(channel as u64 + 3);
        colour[channel] * (1.0 + 0.6 * change)
    })
}

#[test]
fn encoded_again_cropped_and_turned_footage_is_told_and_kept() {
    let temp = tempfile::tempdir().unwrap();
    let clip = |name: &str,
                (width, height, fps): (usize, usize, i64),
                span: [f64; 2],
                yaw: f64,
                take: u64| {
        let path = temp.path().join(name);
        let frames = ((span[1] - span[0]) * fps as f64) as usize;
        Clip::steady(width, height, frames, fps).write(&path, |frame, x, y| {
            let seconds = span[0] + frame as f64 / fps as f64;
            lit(seconds, erp_direction(x, y, width, height, yaw), take)
        });
        path
    };
    let videos = [
        clip("first.mp4", (256, 128, 25), [0.0, 8.0], 0.0, 0),
        clip("again.mp4", (192, 96, 20), [2.0, 8.0], TAU * 0.3, 0),
        // The same place at another time.
        clip("later.mp4", (256, 128, 25), [0.0, 6.0], 0.0, 1),
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
