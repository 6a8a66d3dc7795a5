//! The audit page: written from a curated video, used in a real browser, merged into the ledger.
#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

mod support;

use std::{
    fs,
    path::{Path, PathBuf},
    process::Command,
};

use omnilife_curate::{CurateSettings, audit, curate_video, ledger};
use omnilife_schemas::{
    progress::Silent,
    records::{BoundaryKind, BoundaryLedger, Sampling},
    store,
};

fn settings() -> CurateSettings {
    CurateSettings {
        profile: "none".to_owned(),
        sampling: Sampling::MaxFrames(2),
        width: Some(64),
        minimum_shot_seconds: 0.5,
        ..CurateSettings::default()
    }
}

/// A curated clip of four shots of 1.6 s.
fn curated(folder: &Path) -> (PathBuf, PathBuf) {
    let video = support::erp_clip(folder, "walk.mp4", &[1, 3, 2, 5], 40, 25);
    let curated = folder.join("walk");
    curate_video(&video, &curated, &settings(), &Silent).unwrap();
    (video, curated)
}

fn cuts(curated: &Path) -> BoundaryLedger {
    store::read_record(&curated.join("boundaries.json")).unwrap()
}

#[test]
fn the_page_holds_all_it_needs() {
    let temp = tempfile::tempdir().unwrap();
    let (video, curated) = curated(temp.path());
    let page = temp.path().join("audit.html");
    assert_eq!(
        audit::write_page(&curated, &video, &page, &Silent).unwrap(),
        3
    );
    let html = fs::read_to_string(&page).unwrap();
    for placeholder in ["/*DATA*/", "/*STYLE*/", "/*SCRIPT*/"] {
        assert!(!html.contains(placeholder), "{placeholder}");
    }
    assert!(html.contains("data:image/jpeg;base64,/9j/"));
    assert!(
        !html.contains("http:") && !html.contains("https:"),
        "no network"
    );
    assert!(html.len() < 2_000_000, "{} bytes", html.len());

    let other = support::erp_clip(temp.path(), "other.mp4", &[1, 2], 20, 25);
    let message = audit::write_page(&curated, &other, &page, &Silent)
        .unwrap_err()
        .to_string();
    assert!(message.contains("other.mp4: is not walk.mp4"), "{message}");
}

#[test]
fn an_expert_audits_in_a_browser() {
    let found = |program: &str| Command::new(program).arg("--version").output().is_ok();
    if !(found("chromium") && found("chromedriver") && found("python3")) {
        omnilife_schemas::testing::skip(
            "no Chromium with its driver, scripts/setup --browser installs them",
        );
        return;
    }
    let temp = tempfile::tempdir().unwrap();
    let (video, curated) = curated(temp.path());
    let before = cuts(&curated);
    assert_eq!((before.boundaries.len(), before.ledger_sha256), (3, None));
    let page = temp.path().join("audit.html");
    audit::write_page(&curated, &video, &page, &Silent).unwrap();
    let downloads = temp.path().join("downloads");
    fs::create_dir(&downloads).unwrap();
    let mut browser = Command::new("python3");
    browser
        .arg(Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/audit_page.py"))
        .args([&page, &downloads]);
    if let Some(screenshot) = std::env::var_os("OMNILIFE_AUDIT_SCREENSHOT") {
        browser.arg(screenshot);
    }
    let output = browser.output().unwrap();
    assert!(
        output.status.success(),
        "{}",
        String::from_utf8_lossy(&output.stderr)
    );

    let decisions = downloads.join("decisions.json");
    let merged = ledger::merge(&curated, &[decisions], None, &Silent).unwrap();
    let holding = ledger::resolve(merged.entries());
    // Accepted at 1.6 s, rejected at 3.2 s, moved one frame later at 4.8 s, added at 0.5 s.
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
    curate_video(&video, &curated, &settings(), &Silent).unwrap();
    let after = cuts(&curated);
    assert_eq!(after.boundaries, holding);
    assert_eq!(after.ledger_sha256, Some(merged.sha256()));
}
