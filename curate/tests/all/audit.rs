//! The audit page: written from a curated video, used in a real browser, merged into the ledger, and its effects.

use std::{
    fs,
    path::{Path, PathBuf},
    process::Command,
};

use omnilife_curate::{
    CurateError, CurateSettings,
    annotation::{AnnotateSettings, annotate_dataset},
    audit::{self, EMBEDDED_BYTES, PageRequest},
    curate_dataset, ledger,
    slicing::SliceSettings,
    video,
};
use omnilife_schemas::{
    progress::Silent,
    records::{Annotation, BoundaryKind, BoundaryLedger, Sampling, SegmentOutcome, Slices},
    store,
    testing::Notes,
};

use crate::support;

fn settings() -> CurateSettings {
    CurateSettings {
        profile: "none".to_owned(),
        sampling: Sampling::MaxFrames(2),
        width: Some(64),
        minimum_shot_seconds: 0.5,
        slices: Some(SliceSettings { audio: false }),
        ..CurateSettings::default()
    }
}

/// A dataset of one clip of four shots of 1.6 s; the clip and its folder. The name is one that would
/// be markup.
struct Curated {
    set: PathBuf,
    video: PathBuf,
    folder: PathBuf,
}

impl Curated {
    fn make(temp: &Path) -> Self {
        let name = "<b class=injected>walk & co.mp4";
        let video = support::erp_clip(temp, name, &[1, 3, 2, 5], 40, 25);
        let set = temp.join("set");
        let folder = set.join("videos").join(video.file_stem().unwrap());
        let made = Self { set, video, folder };
        made.curate();
        made
    }

    fn curate(&self) {
        let videos = [self.video.clone()];
        let curated = curate_dataset(&videos, &self.set, &settings(), &Silent).unwrap();
        assert!(curated.errors.is_empty(), "{:?}", curated.errors);
    }

    fn page(&self, page: &Path, embedded_bytes: u64, notes: &Notes) -> Result<usize, CurateError> {
        let request = PageRequest {
            folder: &self.folder,
            video: &self.video,
            page,
            taxonomy: None,
            embedded_bytes,
        };
        audit::write_page(&request, notes)
    }

    fn cuts(&self) -> BoundaryLedger {
        store::read_record(&self.folder.join("boundaries.json")).unwrap()
    }
}

#[test]
fn the_page_holds_all_it_needs() {
    let temp = tempfile::tempdir().unwrap();
    let mut curated = Curated::make(temp.path());
    let (page, notes) = (temp.path().join("audit.html"), Notes::default());
    assert_eq!(curated.page(&page, EMBEDDED_BYTES, &notes).unwrap(), 3);
    assert_eq!(notes.take(), [""; 0]);
    let html = fs::read_to_string(&page).unwrap();
    for placeholder in ["/*DATA*/", "/*STYLE*/", "/*SCRIPT*/", "/*PROXY*/"] {
        assert!(!html.contains(placeholder), "{placeholder}");
    }
    assert!(html.contains("data:image/jpeg;base64,/9j/"));
    assert!(!html.contains("<b class"), "a file's name is no markup");
    assert!(
        !html.contains("http:") && !html.contains("https:"),
        "no network"
    );
    assert!(html.len() < 2_000_000, "{} bytes", html.len());
    let left: Vec<String> = store::names_in(temp.path()).unwrap();
    assert!(!left.iter().any(|name| name.contains("tmp")), "{left:?}");

    let other = support::erp_clip(temp.path(), "other.mp4", &[1, 2], 20, 25);
    curated.video = other;
    let message = curated
        .page(&page, EMBEDDED_BYTES, &notes)
        .unwrap_err()
        .to_string();
    assert!(
        message.contains("other.mp4: is not <b class=injected>walk & co.mp4"),
        "{message}"
    );
}

#[test]
fn a_large_video_lies_beside_its_page() {
    let temp = tempfile::tempdir().unwrap();
    let curated = Curated::make(temp.path());
    let (page, notes) = (temp.path().join("my audit.html"), Notes::default());
    // Twice: an existing file is used.
    for _ in 0..2 {
        curated.page(&page, 100, &notes).unwrap();
        let said = notes.take();
        assert_eq!(said.len(), 1, "{said:?}");
        assert!(said[0].contains("too large to stand in the page"));
    }
    let folder = temp.path().join("my audit-proxy");
    let files = store::paths_in(&folder).unwrap();
    assert_eq!(files.len(), 1, "{files:?}");
    let probe = video::probe(&files[0]).unwrap();
    assert_eq!((probe.width, probe.height), (256, 128));
    assert!((probe.duration_seconds - 6.4).abs() < 0.05, "{probe:?}");
    let html = fs::read_to_string(&page).unwrap();
    let name = files[0].file_name().unwrap().to_str().unwrap();
    assert!(html.contains(&format!("my audit-proxy/{name}")));

    // Another file under the name of the video's content is not replaced.
    fs::write(&files[0], "mine").unwrap();
    let message = curated.page(&page, 100, &notes).unwrap_err().to_string();
    assert!(message.contains("is in the way"), "{message}");
    assert_eq!(fs::read_to_string(&files[0]).unwrap(), "mine");
}

/// Uses the page in a browser and returns what it saved; `None` where there is no browser.
fn used(role: &str, page: &Path) -> Option<PathBuf> {
    let found = |program: &str| Command::new(program).arg("--version").output().is_ok();
    if !(found("chromium") && found("chromedriver") && found("python3")) {
        omnilife_schemas::testing::skip(
            "no Chromium with its driver, scripts/setup --browser installs them",
        );
        return None;
    }
    let downloads = page.with_file_name("downloads");
    fs::create_dir(&downloads).unwrap();
    let mut browser = Command::new("python3");
    browser
        .arg(Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/audit_page.py"))
        .arg(role)
        .args([page, &downloads]);
    if let Some(images) = std::env::var_os("OMNILIFE_SCREENSHOTS") {
        browser.arg(images);
    }
    let output = browser.output().unwrap();
    assert!(
        output.status.success(),
        "{}",
        String::from_utf8_lossy(&output.stderr)
    );
    Some(downloads.join("decisions.json"))
}

#[test]
fn an_expert_audits_in_a_browser() {
    let temp = tempfile::tempdir().unwrap();
    let curated = Curated::make(temp.path());
    let before = curated.cuts();
    assert_eq!((before.boundaries.len(), before.ledger_sha256), (3, None));
    let page = temp.path().join("audit.html");
    let notes = Notes::default();
    curated.page(&page, EMBEDDED_BYTES, &notes).unwrap();
    let Some(decisions) = used("expert", &page) else {
        return;
    };
    let merged = ledger::merge(&curated.folder, &[decisions], None, &Silent).unwrap();
    let holding = ledger::resolve(merged.entries());
    // Accepted at 1.6 s, rejected at 3.2 s, moved one frame later at 4.8 s, added at 0.48 s.
    let starts: Vec<f64> = holding
        .iter()
        .map(|boundary| (boundary.end_seconds * 25.0).round())
        .collect();
    assert_eq!(starts, [12.0, 40.0, 121.0]);
    assert!(
        holding
            .iter()
            .all(|boundary| boundary.kind == BoundaryKind::Cut)
    );
    let accepted = merged
        .entries()
        .iter()
        .find(|entry| entry.reason.is_some())
        .unwrap();
    assert_eq!(accepted.reason.as_deref(), Some("sharp"));
    assert!(accepted.time.is_some());

    // Curation then cuts by the ledger.
    curated.curate();
    let after = curated.cuts();
    assert_eq!(after.boundaries, holding);
    assert_eq!(after.ledger_sha256, Some(merged.sha256()));
}

#[test]
fn an_annotator_cuts_and_labels_in_a_browser_and_slices_follow() {
    let temp = tempfile::tempdir().unwrap();
    let curated = Curated::make(temp.path());
    let page = temp.path().join("audit.html");
    let notes = Notes::default();
    // With its video beside it, the page works as well.
    curated.page(&page, 100, &notes).unwrap();
    let Some(decisions) = used("annotator", &page) else {
        return;
    };
    ledger::merge(&curated.folder, &[decisions], None, &Silent).unwrap();
    curated.curate();
    let slices: Slices = store::read_record(&curated.folder.join("slices.json")).unwrap();
    let kept: Vec<(f64, f64, String, PathBuf)> = slices
        .segments
        .iter()
        .filter_map(|segment| match &segment.outcome {
            SegmentOutcome::Kept {
                sequence,
                slice: Some(slice),
            } => Some((
                segment.range.begin_seconds,
                segment.range.end_seconds,
                sequence.clone(),
                curated.folder.join(&slice.file),
            )),
            _ => None,
        })
        .collect();
    // The segment from 2.4 s to the end of the frame at 4.0 s is cut in two by the detector's boundary
    // at 3.2 s.
    let frames = |seconds: f64| (seconds * 25.0).round() as i64;
    let spans: Vec<(i64, i64)> = kept.iter().map(|k| (frames(k.0), frames(k.1))).collect();
    assert_eq!(spans, [(0, 40), (40, 60), (60, 80), (80, 101), (101, 120)]);
    let left_out: Vec<i64> = slices
        .segments
        .iter()
        .filter(|segment| segment.outcome == SegmentOutcome::LeftOut)
        .map(|segment| frames(segment.range.begin_seconds))
        .collect();
    assert_eq!(left_out, [120], "a segment that is left out");
    for (begin, end, _, file) in &kept {
        let probe = video::probe(file).unwrap();
        let duration = probe.duration_seconds;
        assert!((duration - (end - begin)).abs() < 0.01, "{duration}");
    }

    // Labels belong to the sequences inside them, and to no others.
    annotate_dataset(&curated.set, &AnnotateSettings::default(), &Silent).unwrap();
    for (begin, _, sequence, _) in &kept {
        let path = curated.folder.join(sequence).join("annotation.json");
        let annotation: Annotation = store::read_record(&path).unwrap();
        let said = [&annotation.scene, &annotation.action].map(|tag| {
            tag.as_ref()
                .map(|tag| (tag.name.as_str(), tag.author.as_str()))
        });
        let expected = match frames(*begin) {
            60 | 80 => [Some(("night-market", "Ada")), Some(("walking", "Ada"))],
            _ => [None, None],
        };
        assert_eq!(said, expected, "{sequence}");
    }

    // Another page on the same ledger takes the segment back that is left out.
    let again = temp.path().join("again");
    fs::create_dir(&again).unwrap();
    let page = again.join("audit.html");
    curated.page(&page, 100, &notes).unwrap();
    let Some(decisions) = used("keeper", &page) else {
        return;
    };
    ledger::merge(&curated.folder, &[decisions], None, &Silent).unwrap();
    curated.curate();
    let slices: Slices = store::read_record(&curated.folder.join("slices.json")).unwrap();
    let is_left_out = |outcome: &SegmentOutcome| *outcome == SegmentOutcome::LeftOut;
    assert!(
        !slices
            .segments
            .iter()
            .any(|segment| is_left_out(&segment.outcome))
    );
}
