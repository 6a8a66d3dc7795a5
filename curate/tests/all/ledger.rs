//! The boundary ledger: its chain, its rules, its formats and its agreement.

use std::{fs, path::Path};

use omnilife_curate::ledger::{
    Ledger, Statement, Status,
    agreement::{compare, matches, of_ledger},
    candidates,
    formats::{FORMATS, Frames, read_any},
    labels, resolve,
};
use omnilife_schemas::records::{
    AuditDecision, AuditDecisions, Author, Boundary, BoundaryKind, LedgerAction, PersonRole,
    SegmentLabel, SourceVideo, TimeRange,
};
use proptest::prelude::*;

const FPS: f64 = 25.0;

fn range() -> TimeRange {
    TimeRange::new(0.0, 40.0)
}

fn source() -> SourceVideo {
    SourceVideo {
        file_name: "walk.mp4".to_owned(),
        sha256: "ab".repeat(32),
        bytes: 1,
    }
}

fn times() -> Vec<f64> {
    (0..1000).map(|frame| f64::from(frame) / FPS).collect()
}

/// A boundary between two frames.
fn between(last: usize, first: usize) -> Boundary {
    Boundary {
        begin_seconds: last as f64 / FPS,
        end_seconds: first as f64 / FPS,
        kind: if first == last + 1 {
            BoundaryKind::Cut
        } else {
            BoundaryKind::Gradual
        },
        score: 1.0,
    }
}

fn detector() -> Author {
    Author::Detector("histogram: settings".to_owned())
}

fn annotator(name: &str) -> Author {
    Author::Annotator(name.to_owned())
}

fn ledger(path: &Path) -> Ledger {
    Ledger::open_new(path, source(), range()).unwrap()
}

fn decisions(actions: Vec<LedgerAction>) -> AuditDecisions {
    AuditDecisions {
        source_sha256: source().sha256,
        author: "Kim".to_owned(),
        role: PersonRole::Expert,
        decisions: actions
            .into_iter()
            .enumerate()
            .map(|(second, action)| AuditDecision {
                time: format!("2026-01-01T00:00:{second:02}Z"),
                reason: Some("looked at it".to_owned()),
                action,
            })
            .collect(),
    }
}

#[test]
fn lines_are_only_ever_appended_and_a_changed_one_shows() {
    let temp = tempfile::tempdir().unwrap();
    let path = temp.path().join("ledger.jsonl");
    let mut first = ledger(&path);
    first
        .propose(&detector(), None, None, vec![between(100, 101)])
        .unwrap();
    first.write().unwrap();
    let before = fs::read_to_string(&path).unwrap();

    let mut second = Ledger::read(&path).unwrap();
    assert_eq!(second, first);
    let again = vec![between(100, 101), between(200, 210)];
    assert_eq!(second.propose(&detector(), None, None, again).unwrap(), 1);
    second.write().unwrap();
    let after = fs::read_to_string(&path).unwrap();
    assert!(after.starts_with(&before) && after.lines().count() == 3);

    // The first one does not know the third line: it must not take it away.
    first
        .propose(&annotator("Ada"), None, None, vec![between(300, 301)])
        .unwrap();
    let message = first.write().unwrap_err().to_string();
    assert!(message.contains("has changed since"), "{message}");
    assert_eq!(fs::read_to_string(&path).unwrap(), after);

    for (old, new) in [("\"score\":1.0", "\"score\":0.5"), ("walk.mp4", "talk.mp4")] {
        fs::write(&path, after.replacen(old, new, 1)).unwrap();
        let message = Ledger::read(&path).unwrap_err().to_string();
        assert!(
            message.contains("line") && message.contains("does not follow"),
            "{message}"
        );
    }
    let removed: Vec<&str> = after
        .lines()
        .filter(|line| !line.contains("\"id\":1,"))
        .collect();
    fs::write(&path, removed.join("\n")).unwrap();
    assert!(Ledger::read(&path).is_err());
}

#[test]
fn boundaries_outside_the_video_and_overlapping_ones_are_refused() {
    let mut ledger = ledger(Path::new("ledger.jsonl"));
    let mut backwards = between(10, 12);
    backwards.end_seconds = 0.1;
    let cases = [
        (vec![between(990, 1100)], "lies outside the video"),
        (vec![between(10, 20), between(15, 30)], "overlap"),
        (vec![backwards], "does not last"),
    ];
    for (list, reason) in cases {
        let error = ledger
            .propose(&annotator("Ada"), None, None, list)
            .unwrap_err();
        let message = error.to_string();
        assert!(
            message.contains(reason) && message.contains("ledger.jsonl"),
            "{message}"
        );
        assert_eq!(ledger.entries().len(), 1);
    }
    let of_nothing = Statement {
        author: Author::Expert("Kim".to_owned()),
        time: None,
        reason: None,
        action: LedgerAction::Accept(0),
    };
    assert!(ledger.append(of_nothing).is_err());
    let mut foreign = decisions(vec![]);
    foreign.source_sha256 = "cd".repeat(32);
    assert!(ledger.decide(&foreign).is_err());
}

#[test]
fn annotations_predictions_and_decisions_are_merged() {
    let mut ledger = ledger(Path::new("ledger.jsonl"));
    let found = vec![
        between(100, 101),
        between(300, 301),
        between(500, 512),
        between(700, 701),
    ];
    ledger.propose(&detector(), None, None, found).unwrap();
    // A little late, another place, and one that the detector missed.
    let mut doorway = between(305, 306);
    doorway.kind = BoundaryKind::IndoorOutdoor;
    let seen = vec![between(104, 105), doorway, between(900, 901)];
    ledger.propose(&annotator("Ada"), None, None, seen).unwrap();
    assert_eq!(resolve(ledger.entries()).len(), 5);
    assert_eq!(
        resolve(ledger.entries())[0],
        between(100, 101),
        "the detector's time"
    );
    assert_eq!(
        resolve(ledger.entries())[1].kind,
        BoundaryKind::IndoorOutdoor
    );
    assert_eq!(resolve(ledger.entries())[1].begin_seconds, 300.0 / FPS);

    let audit = decisions(vec![
        LedgerAction::Reject(3),
        LedgerAction::Move {
            id: 4,
            boundary: between(695, 696),
        },
        // By the annotator's line of the first boundary.
        LedgerAction::Accept(5),
        LedgerAction::Propose(between(800, 801)),
    ]);
    assert_eq!(ledger.decide(&audit).unwrap(), 4);
    assert_eq!(ledger.decide(&audit).unwrap(), 0, "once");
    let holding: Vec<f64> = resolve(ledger.entries())
        .iter()
        .map(|boundary| boundary.begin_seconds * FPS)
        .collect();
    assert_eq!(holding, [100.0, 300.0, 695.0, 800.0, 900.0]);
    let states: Vec<Status> = candidates(ledger.entries(), 0.5)
        .iter()
        .map(|candidate| candidate.status)
        .collect();
    assert_eq!(
        states,
        [
            Status::Accepted,
            Status::Proposed,
            Status::Rejected,
            Status::Accepted,
            Status::Accepted,
            Status::Proposed
        ]
    );
}

#[test]
fn seamless_traversals_are_kept_whole() {
    let mut ledger = ledger(Path::new("ledger.jsonl"));
    let found = vec![between(100, 110), between(300, 301)];
    ledger.propose(&detector(), None, None, found).unwrap();
    let mut traversal = between(90, 150);
    traversal.kind = BoundaryKind::SeamlessTraversal;
    ledger
        .propose(&annotator("Ada"), None, None, vec![traversal])
        .unwrap();
    assert_eq!(resolve(ledger.entries()), [between(300, 301)]);
    // An expert who saw the cut inside says so.
    ledger
        .decide(&decisions(vec![LedgerAction::Accept(1)]))
        .unwrap();
    assert_eq!(resolve(ledger.entries()).len(), 2);
    // And one who says that it is not a traversal lets everything hold.
    let mut other = ledger.clone();
    other
        .decide(&decisions(vec![LedgerAction::Reject(3)]))
        .unwrap();
    assert_eq!(resolve(other.entries()).len(), 2);
}

#[test]
fn agreement_counts_each_boundary_once() {
    let truth = [between(100, 101), between(300, 301), between(500, 510)];
    let found = [
        between(98, 99),
        between(101, 102),
        between(505, 506),
        between(800, 801),
    ];
    assert_eq!(matches(&truth, &found, 0.1), [(0, 0), (2, 2)]);
    let agreement = compare(&truth, &found, range(), 0.1);
    assert_eq!(
        (agreement.matched, agreement.reference, agreement.found),
        (2, 3, 4)
    );
    assert!((agreement.precision - 0.5).abs() < 1e-12);
    assert!((agreement.recall - 2.0 / 3.0).abs() < 1e-12);
    assert!((agreement.f1 - 4.0 / 7.0).abs() < 1e-12);
    // 200 segments of 0.2 s: 2 both, 1 and 2 alone, 195 neither.
    let observed = 197.0 / 200.0;
    let chance = 0.015 * 0.02 + 0.985 * 0.98;
    assert!((agreement.kappa - (observed - chance) / (1.0 - chance)).abs() < 1e-12);

    let same = compare(&truth, &truth, range(), 0.1);
    assert_eq!(
        (same.precision, same.recall, same.f1, same.kappa),
        (1.0, 1.0, 1.0, 1.0)
    );
    let none = compare(&[], &[], range(), 0.1);
    assert_eq!((none.f1, none.kappa), (1.0, 1.0));
    assert_eq!(compare(&truth, &[], range(), 0.1).f1, 0.0);
}

/// An expert who accepts what a detector found says as much as one who draws it again.
#[test]
fn agreement_counts_what_was_accepted_or_moved() {
    let folder = tempfile::tempdir().unwrap();
    let mut ledger = ledger(&folder.path().join("ledger.jsonl"));
    let found = vec![between(100, 101), between(300, 301), between(500, 501)];
    ledger.propose(&detector(), None, None, found).unwrap();
    let moved = LedgerAction::Move {
        id: 2,
        boundary: between(310, 311),
    };
    let actions = vec![LedgerAction::Accept(1), moved, LedgerAction::Reject(3)];
    ledger.decide(&decisions(actions)).unwrap();
    let table = of_ledger(&ledger, 0.1);
    let kim = Author::Expert("Kim".to_owned());
    let with = |reference: Option<Author>| {
        let entry = table
            .iter()
            .find(|entry| entry.author == kim && entry.reference == reference);
        let agreement = &entry.unwrap().agreement;
        (agreement.matched, agreement.reference, agreement.found)
    };
    assert_eq!(with(Some(detector())), (1, 3, 2));
    assert_eq!(with(None), (2, 2, 2));
}

#[test]
fn other_tools_files_are_read() {
    let times = times();
    let frames = Frames {
        times: &times,
        video: "walk.mp4",
    };
    let scenedetect = "Timecode List:,00:00:04.000\n\
        Scene Number,Start Frame,Start Timecode,Start Time (seconds),End Frame,End Timecode,\
        End Time (seconds),Length (frames),Length (timecode),Length (seconds)\n\
        1,1,00:00:00.000,0.000,100,00:00:04.000,4.000,100,00:00:04.000,4.000\n\
        2,101,00:00:04.000,4.000,1000,00:00:40.000,40.000,900,00:00:36.000,36.000\n";
    let edl = "TITLE: walk\nFCM: NON-DROP FRAME\n\n\
        001  AX       V     C        00:00:00:00 00:00:04:00 00:00:00:00 00:00:04:00\n\
        * FROM CLIP NAME: walk.mp4\n\
        002  AX       V     D    010 00:00:04:00 00:00:40:00 00:00:04:00 00:00:40:00\n";
    let label_studio = r#"[{"data": {"video": "/data/upload/1-walk.mp4"}, "annotations": [{"result":
        [{"type": "timelinelabels", "value": {"ranges": [{"start": 101, "end": 101}],
        "timelinelabels": ["indoor-outdoor"]}}]}]}]"#;
    let mut doorway = between(99, 100);
    doorway.kind = BoundaryKind::IndoorOutdoor;
    let cases = [
        (scenedetect, between(99, 100)),
        (edl, between(99, 110)),
        ("0 99\n100 999\n", between(99, 100)),
        ("begin_seconds\n4.01\n", between(99, 100)),
        ("begin_seconds,kind\n4.0,indoor-outdoor\n", doorway.clone()),
        (label_studio, doorway),
    ];
    for (text, expected) in cases {
        assert_eq!(read_any(text, &frames).unwrap(), [expected], "{text}");
    }
    for (text, reason) in [
        ("0 99\n100 2000\n0 1", "frame"),
        ("0 4000\n4001 4005\n", "outside the video"),
        ("0 99\n100 99999\n", "outside the video"),
        ("0 99\n100 90\n", "has no frames"),
        ("begin_seconds\n99.0\n", "outside the video"),
        ("begin_seconds\nsoon\n", "row 1"),
        ("begin_seconds,kind\n1.0,explosion\n", "not known"),
        ("hello", "none of the formats"),
        ("", "none of the formats"),
    ] {
        let message = read_any(text, &frames).unwrap_err();
        assert!(
            message.contains(reason) && !message.contains('\n'),
            "{text}: {message}"
        );
    }
}

proptest! {
    /// Every format gives back the frames of the boundaries that it was given.
    #[test]
    fn formats_round_trip(steps in proptest::collection::vec((5_usize..90, 1_usize..20), 0..8)) {
        let times = times();
        let frames = Frames { times: &times, video: "walk.mp4" };
        let mut list = Vec::new();
        let mut at = 0;
        for (pause, length) in steps {
            list.push(between(at + pause, at + pause + length));
            at += pause + length;
        }
        for format in FORMATS {
            let text = (format.write)(&list, &frames).unwrap();
            let read = (format.read)(&text, &frames).unwrap();
            prop_assert_eq!(&read, &list, "{}: {}", format.id, text);
            prop_assert!((format.recognises)(&text) || list.is_empty(), "{}", format.id);
            if !list.is_empty() {
                prop_assert_eq!(&read_any(&text, &frames).unwrap(), &list, "{}", format.id);
            }
        }
    }
}

fn label(begin_seconds: f64, end_seconds: f64, scene: Option<&str>) -> LedgerAction {
    LedgerAction::Label(SegmentLabel {
        range: TimeRange::new(begin_seconds, end_seconds),
        scene: scene.map(str::to_owned),
        action: None,
        traversal: None,
        leave_out: None,
    })
}

#[test]
fn an_expert_says_last_what_is_left_out() {
    let temp = tempfile::tempdir().unwrap();
    let mut ledger = ledger(&temp.path().join("ledger.jsonl"));
    let segment = |leave_out| {
        let LedgerAction::Label(label) = label(0.0, 20.0, None) else {
            panic!("a label");
        };
        LedgerAction::Label(SegmentLabel {
            leave_out: Some(leave_out),
            ..label
        })
    };
    let range = TimeRange::new;
    let mut of_ada = decisions(vec![segment(true)]);
    of_ada.author = "Ada".to_owned();
    of_ada.role = PersonRole::Annotator;
    ledger.decide(&of_ada).unwrap();
    assert!(labels::leaves_out(ledger.entries(), range(2.0, 18.0)));
    assert!(!labels::leaves_out(ledger.entries(), range(12.0, 40.0)));
    assert!(!labels::keeps(ledger.entries(), range(2.0, 18.0)));
    ledger.decide(&decisions(vec![segment(false)])).unwrap();
    assert!(!labels::leaves_out(ledger.entries(), range(2.0, 18.0)));
    assert!(labels::keeps(ledger.entries(), range(2.0, 18.0)));
    assert!(!labels::keeps(ledger.entries(), range(12.0, 40.0)));
}

#[test]
fn labels_are_of_the_segments_that_they_cover_and_an_experts_counts_more() {
    let temp = tempfile::tempdir().unwrap();
    let path = temp.path().join("ledger.jsonl");
    let mut ledger = ledger(&path);
    ledger
        .decide(&decisions(vec![label(0.0, 20.0, Some("beach"))]))
        .unwrap();
    let mut of_ada = decisions(vec![
        label(0.0, 20.0, Some("lake")),
        label(20.0, 40.0, Some("river")),
        label(20.0, 40.0, Some("canal")),
    ]);
    of_ada.author = "Ada".to_owned();
    of_ada.role = PersonRole::Annotator;
    ledger.decide(&of_ada).unwrap();
    assert_eq!(ledger.decide(&of_ada).unwrap(), 0, "once");
    ledger.write().unwrap();
    let read = Ledger::read(&path).unwrap();
    let last = |begin_seconds: f64, end_seconds: f64| {
        let range = TimeRange::new(begin_seconds, end_seconds);
        let found = labels::of_segment(read.entries(), range);
        found.last().map(|(_, label)| label.scene.clone().unwrap())
    };
    assert_eq!(last(2.0, 20.0).as_deref(), Some("beach"));
    assert_eq!(last(15.0, 40.0).as_deref(), Some("canal"));
    assert_eq!(last(10.0, 30.0), None, "half of it is not more than half");
    // Labels are not boundaries, and nothing to agree on.
    assert!(resolve(read.entries()).is_empty());
    assert!(of_ledger(&read, 0.1).is_empty());
}

#[test]
fn what_a_page_may_not_say_is_refused_and_nothing_is_appended() {
    let temp = tempfile::tempdir().unwrap();
    let mut ledger = ledger(&temp.path().join("ledger.jsonl"));
    ledger
        .propose(&detector(), None, None, vec![between(100, 101)])
        .unwrap();
    let lines = ledger.entries().len();
    let mut refused = |role: PersonRole, action: LedgerAction, said: &str| {
        let mut audit = decisions(vec![label(0.0, 20.0, Some("beach")), action]);
        audit.role = role;
        let message = ledger.decide(&audit).unwrap_err().to_string();
        assert!(message.contains(said), "{message}");
        assert_eq!(ledger.entries().len(), lines);
    };
    for action in [
        LedgerAction::Accept(1),
        LedgerAction::Reject(1),
        LedgerAction::Move {
            id: 1,
            boundary: between(101, 102),
        },
    ] {
        refused(PersonRole::Annotator, action, "an annotator cannot");
    }
    let expert = PersonRole::Expert;
    refused(expert, label(0.0, 41.0, Some("beach")), "outside the video");
    refused(expert, label(9.0, 9.0, Some("beach")), "about no segment");
    refused(
        expert,
        label(f64::NAN, 9.0, Some("beach")),
        "about no segment",
    );
    refused(expert, label(0.0, 9.0, None), "says nothing");
    refused(expert, label(0.0, 9.0, Some(" ")), "has the name");
}
