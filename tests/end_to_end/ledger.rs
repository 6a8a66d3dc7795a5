//! `omnilife curate ledger` and `curate audit`: an annotator finds a boundary, an expert moves it,
//! and curation cuts there.

use std::{fs, path::Path};

use omnilife_schemas::{
    records::{AuditDecisions, BoundaryLedger, Slices, VideoAnalysis},
    store,
};
use serde_json::{Value, json};

use crate::support::{Ended, omnilife, sample, scratch};

/// Curates the sample, 2 s in one shot, into a dataset. Shots may be short.
fn curate(out: &Path) -> Ended {
    let video = sample("street.mp4");
    omnilife([
        "curate".as_ref(),
        video.as_os_str(),
        "--out".as_ref(),
        out.as_os_str(),
        "--criteria".as_ref(),
        "none".as_ref(),
        "--max-frames".as_ref(),
        "4".as_ref(),
        "--width".as_ref(),
        "128".as_ref(),
        "--min-shot".as_ref(),
        "0.5".as_ref(),
    ])
}

fn ledger(words: &[&str]) -> Ended {
    omnilife(
        ["curate", "ledger"]
            .iter()
            .chain(words)
            .chain(&["--quiet"])
            .copied(),
    )
}

fn json_of(ended: Ended) -> Value {
    serde_json::from_str(&ended.succeeded().stdout).unwrap()
}

#[test]
fn a_boundary_goes_from_an_annotator_over_an_expert_into_the_cut() {
    let folder = scratch();
    let set = folder.path().join("set");
    curate(&set).succeeded();
    let video = set.join("videos/street");
    let video_folder = video.to_str().unwrap();
    let slices: Slices = store::read_record(&video.join("slices.json")).unwrap();
    assert_eq!(slices.segments.len(), 1);

    // The annotator: at 0.8 s.
    let table = folder.path().join("anna.csv");
    fs::write(&table, "begin_seconds,kind\n0.8,cut\n").unwrap();
    let table = table.to_str().unwrap();
    let merge = ["merge", video_folder, table, "--author", "anna"];
    let ended = ledger(&merge).succeeded();
    assert!(
        ended
            .stdout
            .ends_with("ledger.jsonl: 2 lines, boundaries that hold: 1\n"),
        "{}",
        ended.stdout
    );
    let shown = json_of(ledger(&["show", video_folder]));
    assert_eq!(shown.as_array().map(Vec::len), Some(1), "{shown}");
    let agreement = json_of(ledger(&["agreement", video_folder, "--tolerance", "0.05"]));
    assert!(agreement.to_string().contains("anna"), "{agreement}");

    // The page for the expert.
    let page = folder.path().join("audit.html");
    let original = sample("street.mp4");
    let audit = omnilife([
        "curate".as_ref(),
        "audit".as_ref(),
        video.as_os_str(),
        "--video".as_ref(),
        original.as_os_str(),
        "--out".as_ref(),
        page.as_os_str(),
    ]);
    assert!(
        audit
            .succeeded()
            .stdout
            .ends_with("audit.html: 1 boundary\n"),
        "one boundary"
    );
    assert!(
        fs::read_to_string(&page)
            .unwrap()
            .contains("data:image/jpeg;base64,")
    );

    // Statement of the page: the boundary is two frames later.
    let analysis: VideoAnalysis = store::read_record(&video.join("analysis.json")).unwrap();
    let moved = json!({
        "begin_seconds": 25.0 / 30.0, "end_seconds": 26.0 / 30.0, "kind": "cut", "score": 1.0
    });
    let decisions: AuditDecisions = serde_json::from_value(json!({
        "source_sha256": analysis.source.sha256,
        "author": "kim",
        "decisions": [{
            "time": "2026-01-01T00:00:00Z",
            "reason": "two frames later",
            "action": { "move": { "id": 1, "boundary": moved } },
        }],
    }))
    .unwrap();
    let file = folder.path().join("decisions.json");
    store::write_record(&file, &decisions).unwrap();
    ledger(&["merge", video_folder, file.to_str().unwrap()]).succeeded();
    // A repeated statement is entered once.
    let again = ledger(&["merge", video_folder, file.to_str().unwrap()]).succeeded();
    assert!(
        again.stdout.contains("3 lines, boundaries that hold: 1"),
        "{}",
        again.stdout
    );
    let exported = ledger(&["export", video_folder, "--format", "transnetv2"]).succeeded();
    assert_eq!(exported.stdout, "0 25\n26 59\n");

    // Curation cuts by the ledger.
    let ended = curate(&set).succeeded();
    assert!(
        ended.stdout.contains("street.mp4: 2 sequences"),
        "{}",
        ended.stdout
    );
    let after: BoundaryLedger = store::read_record(&video.join("boundaries.json")).unwrap();
    assert!(after.ledger_sha256.is_some());
    assert!((after.boundaries[0].end_seconds - 26.0 / 30.0).abs() < 1e-3);
    let verified = omnilife(["curate".as_ref(), "verify".as_ref(), set.as_os_str()]);
    verified.succeeded();
}

#[test]
fn what_a_ledger_cannot_hold_is_refused_in_one_line_and_leaves_it_as_it_was() {
    let folder = scratch();
    let set = folder.path().join("set");
    curate(&set).succeeded();
    let video = set.join("videos/street");
    let video = video.to_str().unwrap();
    let refused = |content: &str, said: &str| {
        let table = folder.path().join("table.csv");
        fs::write(&table, content).unwrap();
        let table = table.to_str().unwrap();
        let ended = ledger(&["merge", video, table, "--author", "anna"]);
        let message = ended.failed_quietly(2);
        assert!(
            message.contains("table.csv") && message.contains(said),
            "{message}"
        );
    };
    refused("begin_seconds\n7.5\n", "7.5");
    refused("begin_seconds,end_seconds\n1.5,1.2\n", "before it begins");
    refused("begin_seconds,end_seconds\n0.5,1.0\n0.8,1.2\n", "overlap");
    refused("seconds\n0.5\n", "");
    let unsigned = folder.path().join("table.csv");
    fs::write(&unsigned, "begin_seconds\n0.5\n").unwrap();
    let ended = ledger(&["merge", video, unsigned.to_str().unwrap()]);
    let message = ended.failed_quietly(2);
    assert!(message.contains("--author"), "{message}");
    assert!(!Path::new(video).join("ledger.jsonl").exists());
}
