//! Shots are judged one by one: those without content or of another projection become no sequence.

use std::{
    fs,
    path::{Path, PathBuf},
};

use omnilife_curate::{
    CurateSettings, attrition::Attrition, curate_dataset, curate_video, ledger::merge::Evidence,
};
use omnilife_schemas::{
    progress::Silent,
    records::{
        AuditDecision, AuditDecisions, BoundaryLedger, LedgerAction, PersonRole, SegmentLabel,
        SegmentOutcome, Sequence, Slices, TimeRange, VideoAnalysis, VideoProjection, VideoStatus,
    },
    store,
    testing::Notes,
};
use support::{Clip, erp_direction, world_colour};

use crate::support;

const WIDTH: usize = 256;
const HEIGHT: usize = 128;
const FRAMES_PER_SECOND: usize = 20;

/// Content of a part of a clip.
#[derive(Clone, Copy)]
enum Part {
    /// A world around a camera that turns.
    Sphere(usize),
    /// The same at a tenth of its brightness.
    Dark(usize),
    /// The same without any change.
    Still(usize),
    /// A world as an ordinary camera sees it.
    Flat(usize),
    Black,
    /// Letters in the middle of a dark card.
    Card,
}

fn colour(part: Part, frame: usize, x: usize, y: usize) -> [f64; 3] {
    let around =
        |world: usize, yaw: f64| world_colour(world, erp_direction(x, y, WIDTH, HEIGHT, yaw));
    let yaw = 0.01 * frame as f64;
    match part {
        Part::Sphere(world) => around(world, yaw),
        Part::Dark(world) => around(world, yaw).map(|level| 0.1 * level),
        Part::Still(world) => around(world, 0.0),
        Part::Flat(world) => {
            let (u, v) = (x as f64 / 128.0 - 1.0, y as f64 / 128.0 - 0.5);
            world_colour(world, [1.7 * u, 2.3 * v, 0.3 * u * v + yaw])
        }
        Part::Black => [0.0; 3],
        Part::Card => {
            let is_line = (96..160).contains(&x) && (56..72).contains(&y);
            [if is_line && (x / 4 + y / 4).is_multiple_of(2) {
                0.95
            } else {
                0.02
            }; 3]
        }
    }
}

/// Writes a clip of some parts with how many frames each has.
fn clip(folder: &Path, parts: &[(Part, usize)]) -> PathBuf {
    let path = folder.join("clip.mp4");
    let by_frame: Vec<Part> = parts
        .iter()
        .flat_map(|&(part, frames)| std::iter::repeat_n(part, frames))
        .collect();
    let clip = Clip::steady(WIDTH, HEIGHT, by_frame.len(), FRAMES_PER_SECOND as i64);
    clip.write(&path, |frame, x, y| colour(by_frame[frame], frame, x, y));
    path
}

fn lenient() -> CurateSettings {
    CurateSettings {
        profile: "none".to_owned(),
        ..CurateSettings::default()
    }
}

/// A dataset of one clip.
struct Outcome {
    folder: PathBuf,
    status: VideoStatus,
    attrition: Attrition,
    notes: Vec<String>,
}

fn curate(video: &Path, out: &Path, settings: &CurateSettings) -> Outcome {
    let notes = Notes::default();
    let videos = [video.to_owned()];
    let curated = curate_dataset(&videos, out, settings, &notes).unwrap();
    Outcome {
        folder: out.join("videos/clip"),
        status: curated.record.videos[0].status.clone(),
        attrition: Attrition::of(&curated.record, out).unwrap(),
        notes: notes.take(),
    }
}

impl Outcome {
    fn boundaries(&self) -> BoundaryLedger {
        store::read_record(&self.folder.join("boundaries.json")).unwrap()
    }

    /// Outcomes of all segments, with the check of those that are rejected.
    fn outcomes(&self) -> Vec<String> {
        let slices: Slices = store::read_record(&self.folder.join("slices.json")).unwrap();
        let named = |outcome: &SegmentOutcome| match outcome {
            SegmentOutcome::Kept { sequence, .. } => sequence.clone(),
            SegmentOutcome::Rejected { check, .. } => check.clone(),
            other => format!("{other:?}"),
        };
        let segments = slices.segments.iter();
        segments.map(|segment| named(&segment.outcome)).collect()
    }

    fn sequence(&self, name: &str) -> Sequence {
        store::read_record(&self.folder.join(name).join("sequence.json")).unwrap()
    }

    /// The checks of `attrition.csv` with their seconds.
    fn rejects(&self) -> Vec<(&str, f64)> {
        let rows = self.attrition.rejects.iter();
        rows.map(|row| (row.check.as_str(), row.seconds.unwrap()))
            .collect()
    }

    /// Seconds that a step of the funnel takes out.
    fn removed_seconds(&self, step: &str) -> f64 {
        let mut steps = self.attrition.funnel.iter();
        steps.find(|row| row.step == step).unwrap().removed_seconds
    }
}

fn assert_range(range: TimeRange, begin_seconds: f64, end_seconds: f64) {
    let is_close = (range.begin_seconds - begin_seconds).abs() < 1e-3
        && (range.end_seconds - end_seconds).abs() < 1e-3;
    assert!(
        is_close,
        "{range:?}, and not {begin_seconds} to {end_seconds}"
    );
}

#[test]
fn black_between_two_programmes_is_no_sequence_and_a_step_of_the_funnel() {
    let temp = tempfile::tempdir().unwrap();
    let parts = [
        (Part::Sphere(1), 40),
        (Part::Black, 60),
        (Part::Sphere(3), 40),
    ];
    let video = clip(temp.path(), &parts);
    let out = temp.path().join("out");
    let first = curate(&video, &out, &lenient());
    assert_eq!(first.outcomes(), ["seq-000", "blank", "seq-001"]);
    assert_range(first.sequence("seq-000").range, 0.0, 2.0);
    assert_range(first.sequence("seq-001").range, 5.0, 7.0);
    let rejected = &first.boundaries().rejected;
    assert_eq!(rejected.len(), 1);
    assert_range(rejected[0].range, 2.0, 5.0);
    assert!(rejected[0].value < 3.0 && rejected[0].value < rejected[0].limit);
    let rejects = first.rejects();
    assert!(
        rejects.len() == 1 && rejects[0].0 == "blank" && (rejects[0].1 - 3.0).abs() < 1e-3,
        "{rejects:?}"
    );
    assert!((first.removed_seconds("blank") - 3.0).abs() < 1e-3);
    assert!((first.attrition.kept_seconds - 4.0).abs() < 1e-3);
    let said = |outcome: &Outcome| {
        let lines = outcome.notes.iter();
        lines.filter(|line| line.contains("(blank, ")).count()
    };
    assert_eq!(said(&first), 1, "{:?}", first.notes);

    // The same again, of the samples that are kept.
    let names = ["boundaries.json", "slices.json", "samples.parquet"];
    let bytes = || names.map(|name| fs::read(first.folder.join(name)).unwrap());
    let before = bytes();
    let again = curate(&video, &out, &lenient());
    assert!(before == bytes());
    assert_eq!(again.rejects(), first.rejects());
    assert_eq!(said(&again), 1, "{:?}", again.notes);
    let skipped = again.notes.iter().filter(|line| line.contains("skipped"));
    assert_eq!(skipped.count(), 2, "{:?}", again.notes);
}

#[test]
fn a_title_card_is_no_sequence_and_no_end_of_one() {
    let temp = tempfile::tempdir().unwrap();
    let parts = [
        (Part::Sphere(1), 40),
        (Part::Card, 40),
        (Part::Sphere(3), 40),
    ];
    let video = clip(temp.path(), &parts);
    let curated = curate(&video, &temp.path().join("out"), &lenient());
    assert_eq!(curated.outcomes(), ["seq-000", "title-card", "seq-001"]);
    let rejected = &curated.boundaries().rejected[0];
    assert_range(rejected.range, 2.0, 4.0);
    assert!(
        rejected.value > rejected.limit && rejected.value < 1.0,
        "{rejected:?}"
    );
    assert!((curated.removed_seconds("title-card") - 2.0).abs() < 1e-3);
}

#[test]
fn a_flat_insert_is_no_sequence_unless_the_user_states_the_projection() {
    let temp = tempfile::tempdir().unwrap();
    let parts = [
        (Part::Sphere(1), 60),
        (Part::Flat(4), 40),
        (Part::Black, 40),
        (Part::Sphere(3), 60),
    ];
    let video = clip(temp.path(), &parts);
    let out = temp.path().join("out");
    let of_evidence = ["seq-000", "shot-projection", "blank", "seq-001"];
    let curated = curate(&video, &out, &lenient());
    assert_eq!(curated.outcomes(), of_evidence);
    let rejected = &curated.boundaries().rejected[0];
    assert_range(rejected.range, 3.0, 5.0);
    assert!(rejected.value > rejected.limit, "{rejected:?}");
    assert!((curated.removed_seconds("shot-projection") - 2.0).abs() < 1e-3);
    assert_eq!(curated.removed_seconds("projection"), 0.0);

    // A stated projection holds for all of the video; black stays black.
    for accepted in [VideoProjection::Erp, VideoProjection::Rectilinear] {
        let accepting = CurateSettings {
            accept: Some(accepted),
            ..lenient()
        };
        let curated = curate(&video, &out, &accepting);
        assert_eq!(
            curated.outcomes(),
            ["seq-000", "seq-001", "blank", "seq-002"]
        );
        assert_range(curated.sequence("seq-001").range, 3.0, 5.0);
    }
    let curated = curate(&video, &out, &lenient());
    assert_eq!(curated.outcomes(), of_evidence);
    assert!(!curated.folder.join("seq-002").exists());
}

#[test]
fn dark_and_still_and_short_shots_of_a_sphere_stay() {
    let temp = tempfile::tempdir().unwrap();
    let parts = [
        (Part::Dark(1), 40),
        (Part::Still(3), 40),
        (Part::Sphere(2), 22),
    ];
    let video = clip(temp.path(), &parts);
    let curated = curate(&video, &temp.path().join("out"), &lenient());
    assert_eq!(curated.outcomes(), ["seq-000", "seq-001", "seq-002"]);
    assert!(curated.boundaries().rejected.is_empty());
    assert!(curated.rejects().is_empty(), "{:?}", curated.rejects());
}

/// Samples over the whole of it show more flat images than spheres, and its shots last otherwise.
#[test]
fn a_video_whose_shots_are_mostly_spheres_is_taken_without_the_others() {
    let temp = tempfile::tempdir().unwrap();
    let parts = [
        (Part::Flat(2), 32),
        (Part::Sphere(1), 56),
        (Part::Flat(4), 40),
        (Part::Sphere(3), 72),
    ];
    let video = clip(temp.path(), &parts);
    let curated = curate(&video, &temp.path().join("out"), &lenient());
    assert_eq!(
        curated.outcomes(),
        ["shot-projection", "seq-000", "shot-projection", "seq-001"]
    );
    let record = curated.folder.join("analysis.json");
    let analysis: VideoAnalysis = store::read_record(&record).unwrap();
    let whole = analysis.projection.projection;
    assert!(!whole.is_monoscopic_erp(), "{whole:?}");
    assert!(analysis.overlays.is_some());
    let taken = curated.sequence("seq-000").projection;
    assert_eq!(taken.projection, VideoProjection::Erp);
    assert_eq!(taken.overridden, Some(whole));
    assert_eq!(taken.evidence, analysis.projection.evidence);
    assert!((curated.removed_seconds("shot-projection") - 3.6).abs() < 1e-3);
    assert!((curated.attrition.kept_seconds - 6.4).abs() < 1e-3);
}

#[test]
fn a_video_whose_shots_are_mostly_flat_is_rejected_as_a_whole() {
    let temp = tempfile::tempdir().unwrap();
    let parts = [
        (Part::Flat(2), 60),
        (Part::Flat(4), 60),
        (Part::Sphere(3), 80),
    ];
    let video = clip(temp.path(), &parts);
    let curated = curate(&video, &temp.path().join("out"), &lenient());
    let rejects = curated.rejects();
    assert!(
        rejects.len() == 1 && rejects[0].0 == "projection" && (rejects[0].1 - 10.0).abs() < 1e-3,
        "{rejects:?}"
    );
}

/// Says in a video's ledger that a part of it is kept, whatever it shows.
fn keep(folder: &Path, begin_seconds: f64, end_seconds: f64) {
    let mut ledger = Evidence::read(folder).unwrap().ledger(folder).unwrap();
    let action = LedgerAction::Label(SegmentLabel {
        range: TimeRange::new(begin_seconds, end_seconds),
        scene: None,
        action: None,
        traversal: None,
        leave_out: Some(false),
    });
    let decisions = AuditDecisions {
        source_sha256: ledger.source().sha256.clone(),
        author: "Ada".to_owned(),
        role: PersonRole::Annotator,
        decisions: vec![AuditDecision {
            time: "2026-01-01T00:00:00Z".to_owned(),
            reason: None,
            action,
        }],
    };
    assert_eq!(ledger.decide(&decisions).unwrap(), 1);
    ledger.write().unwrap();
}

#[test]
fn a_video_of_cards_alone_is_rejected_and_a_person_can_keep_one() {
    let temp = tempfile::tempdir().unwrap();
    let video = clip(temp.path(), &[(Part::Card, 60)]);
    let out = temp.path().join("out");
    let accepting = CurateSettings {
        accept: Some(VideoProjection::Erp),
        ..lenient()
    };
    let none = curate(&video, &out, &accepting);
    assert!(matches!(none.status, VideoStatus::Rejected { .. }));
    let rejects = none.rejects();
    assert!(
        rejects.len() == 1 && rejects[0].0 == "title-card" && (rejects[0].1 - 3.0).abs() < 1e-3,
        "{rejects:?}"
    );
    assert_eq!(none.boundaries().rejected.len(), 1, "and they say why");
    let step = none.attrition.funnel.iter();
    let removed: usize = step.map(|step| step.removed_videos).sum();
    assert_eq!(removed, 1);

    keep(&none.folder, 0.0, 3.0);
    let kept = curate(&video, &out, &accepting);
    assert_eq!(kept.outcomes(), ["seq-000"]);
    assert!(kept.rejects().is_empty());
}

/// A shot that is too short is not judged by its content.
#[test]
fn what_is_too_short_is_not_judged() {
    let temp = tempfile::tempdir().unwrap();
    let parts = [
        (Part::Sphere(1), 40),
        (Part::Black, 12),
        (Part::Sphere(3), 40),
    ];
    let video = clip(temp.path(), &parts);
    let out = temp.path().join("out");
    curate_video(&video, &out, &lenient(), &Silent).unwrap();
    let ledger: BoundaryLedger = store::read_record(&out.join("boundaries.json")).unwrap();
    assert!(ledger.rejected.is_empty());
    assert_eq!(ledger.dropped.len(), 1);
    assert_range(ledger.dropped[0], 2.0, 2.6);
}
