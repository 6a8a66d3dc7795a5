//! Submitted results: packed, checked, scored again, and detected where they were changed.

use std::{
    ffi::OsStr,
    fs,
    path::{Path, PathBuf},
};

use omnilife_schemas::{
    records::{QUICK_LOOK, ResultRecord, Submission, Unavailable},
    store,
};
use tempfile::TempDir;

use crate::support::{Ended, INPUT_VIEWS, METHOD, SEQUENCE, omnilife, scratch, small_run};

const CARD: &str = "method = \"odgs\"\ntitle = \"ODGS\"\nauthors = [\"A. Author\", \"B. Author\"]\n\
                    licence = \"MIT\"\nhardware = \"two cores\"\n";

fn submit(card: &str, out: &Path) -> Ended {
    let file = out.with_extension("toml");
    fs::write(&file, card).unwrap();
    omnilife([
        "--quiet".as_ref(),
        "leaderboard".as_ref(),
        "submit".as_ref(),
        small_run().out.as_os_str(),
        "--card".as_ref(),
        file.as_os_str(),
        "--out".as_ref(),
        out.as_os_str(),
    ])
}

fn add(submission: &Path, results: &Path, audit: &str) -> Ended {
    omnilife([
        "--quiet".as_ref(),
        "leaderboard".as_ref(),
        "add".as_ref(),
        submission.as_os_str(),
        "--results".as_ref(),
        results.as_os_str(),
        "--audit".as_ref(),
        audit.as_ref(),
        "--scenes".as_ref(),
        small_run().out.as_os_str(),
    ])
}

fn submitted() -> (TempDir, PathBuf) {
    let folder = scratch();
    let submission = folder.path().join("submission");
    submit(CARD, &submission).succeeded();
    (folder, submission)
}

/// Updates size and hash of a changed file in the record, as a careful forger would.
fn repack(submission: &Path, file: &str) {
    let path = submission.join("submission.json");
    let mut record: Submission = store::read_record(&path).unwrap();
    let folder = submission.join(&record.results[0].folder);
    let packed = record.results[0].files.iter_mut();
    let entry = packed.into_iter().find(|entry| entry.file == file).unwrap();
    entry.sha256 = store::sha256_file(&folder.join(file)).unwrap();
    entry.bytes = fs::metadata(folder.join(file)).unwrap().len();
    store::write_record(&path, &record).unwrap();
}

#[test]
fn an_honest_submission_is_added_once() {
    let (folder, submission) = submitted();
    let results = folder.path().join("results");
    let added = add(&submission, &results, "1").succeeded();
    assert!(
        added
            .stdout
            .contains("1 result of odgs added, 1 of them scored again")
    );
    let files = crate::support::files(&results);
    assert_eq!(
        files
            .iter()
            .filter(|name| name.ends_with("result.json"))
            .count(),
        1
    );
    assert!(
        !files.iter().any(|name| name.ends_with(".png")),
        "{files:?}"
    );
    let board = folder.path().join("board");
    omnilife([
        "leaderboard".as_ref(),
        "build".as_ref(),
        results.as_os_str(),
        "--out".as_ref(),
        board.as_os_str(),
    ])
    .succeeded();
    let message = add(&submission, &results, "0").failed_quietly(2).to_owned();
    assert!(message.contains("was added before"), "{message}");

    // The same rows from elsewhere.
    let again = scratch();
    let other = again.path().join("other");
    submit(&CARD.replace("two cores", "three cores"), &other).succeeded();
    let message = add(&other, &results, "0").failed_quietly(2).to_owned();
    assert!(message.contains("is also scored in"), "{message}");

    // Another method of the same name, which would be the same row.
    let theirs = again.path().join("theirs");
    let card = CARD.replace("A. Author", "C. Other");
    submit(&card.replace("B. Author", "D. Other"), &theirs).succeeded();
    let message = add(&theirs, &results, "0").failed_quietly(2).to_owned();
    assert!(
        message.contains("is by C. Other, D. Other")
            && message.contains("another method needs another name"),
        "{message}"
    );
}

#[test]
fn a_changed_number_is_found() {
    let (folder, submission) = submitted();
    let results = folder.path().join("results");
    let path = submission.join("results/0000/result.json");
    let mut record: ResultRecord = store::read_record(&path).unwrap();
    record.novel_views.get_mut("psnr").unwrap().mean += 1.0;
    store::write_record(&path, &record).unwrap();
    let message = add(&submission, &results, "0").failed_quietly(2).to_owned();
    assert!(
        message.contains("result.json: is not what was packed"),
        "{message}"
    );
    repack(&submission, "result.json");
    let message = add(&submission, &results, "0").failed_quietly(2).to_owned();
    assert!(
        message.contains("psnr of the novel views is") && message.contains("its table gives"),
        "{message}"
    );
    assert!(!results.exists() || store::names_in(&results).unwrap().is_empty());
}

/// Scores of a failed run would be neither shown nor compared.
#[test]
fn scores_of_a_run_that_failed_are_refused() {
    let (folder, submission) = submitted();
    let path = submission.join("results/0000/result.json");
    let mut record: ResultRecord = store::read_record(&path).unwrap();
    record.run_failure = Some("train ended with exit 1".to_owned());
    store::write_record(&path, &record).unwrap();
    repack(&submission, "result.json");
    let refused = add(&submission, &folder.path().join("results"), "0");
    let message = refused.failed_quietly(2);
    assert!(
        message.contains("its run failed, and it has scores"),
        "{message}"
    );
}

/// Numbers that agree with each other, but not with the images.
#[test]
fn scores_of_other_images_are_found_by_scoring_again() {
    let (folder, submission) = submitted();
    let results = folder.path().join("results");
    let image = "predictions/novel/000004.png";
    let path = submission.join("results/0000").join(image);
    let other = small_run()
        .out
        .join(METHOD)
        .join("run/predictions/novel/000009.png");
    fs::copy(other, &path).unwrap();
    repack(&submission, image);
    let message = add(&submission, &results, "1").failed_quietly(2).to_owned();
    assert!(
        message.contains("of the novel views, scoring gives"),
        "{message}"
    );
    // Without an audit the change is not detected.
    add(&submission, &results, "0").succeeded();
}

/// Scores of two metrics do not stand for the protocol.
#[test]
fn a_quick_look_is_packed_only_as_a_row_without_a_rank() {
    let folder = scratch();
    let sequence = small_run().out.join(SEQUENCE);
    let at = |name: &str| folder.path().join(name);
    let [split, run] = [
        sequence.join("per-scene/split.json"),
        small_run().out.join(METHOD).join("run"),
    ];
    let card = at("card.toml");
    fs::write(&card, CARD).unwrap();
    let words = ["--quiet", "bench", "score", "--metrics", "psnr,ssim"];
    let words = words.iter().map(OsStr::new);
    omnilife(words.chain([
        "--scene".as_ref(),
        sequence.as_os_str(),
        "--split".as_ref(),
        split.as_os_str(),
        "--run".as_ref(),
        run.as_os_str(),
        "--out".as_ref(),
        at("scores").as_os_str(),
    ]))
    .succeeded();
    let submit = |further: &[&str], out: &Path| {
        let words = ["--quiet", "leaderboard", "submit"].iter().chain(further);
        omnilife(words.map(OsStr::new).chain([
            at("scores").as_os_str(),
            "--card".as_ref(),
            card.as_os_str(),
            "--out".as_ref(),
            out.as_os_str(),
        ]))
    };
    let refused = submit(&[], &at("refused"));
    let message = refused.failed_quietly(2);
    assert!(message.contains(QUICK_LOOK), "{message}");
    assert!(!at("refused").join("submission.json").exists());
    submit(&["--with-failures"], &at("packed")).succeeded();
    add(&at("packed"), &at("results"), "1").succeeded();
}

/// Input frames that a split names are part of its rules, by which an audit scores too.
#[test]
fn an_audit_keeps_the_input_frames_that_a_split_names() {
    let folder = scratch();
    let at = |name: &str| folder.path().join(name);
    let sequence = small_run().out.join(SEQUENCE);
    let views = small_run().out.join(METHOD).join("run/predictions/novel");
    let given = INPUT_VIEWS.map(|frame| frame.to_string()).join(",");
    let words = "--quiet bench split --protocol sparse-panoramas --given";
    let words = words.split(' ').map(OsStr::new);
    omnilife(words.chain([
        given.as_ref(),
        sequence.as_os_str(),
        "--out".as_ref(),
        at("split.json").as_os_str(),
    ]))
    .succeeded();
    let words = "--quiet bench score --method odgs --class per-scene";
    let words = words.split(' ').map(OsStr::new);
    omnilife(words.chain([
        "--scene".as_ref(),
        sequence.as_os_str(),
        "--split".as_ref(),
        at("split.json").as_os_str(),
        "--novel-views".as_ref(),
        views.as_os_str(),
        "--out".as_ref(),
        at("scores").as_os_str(),
    ]))
    .succeeded();
    let card = at("card.toml");
    fs::write(&card, CARD).unwrap();
    let words = "--quiet leaderboard submit --card"
        .split(' ')
        .map(OsStr::new);
    omnilife(words.chain([
        card.as_os_str(),
        at("scores").as_os_str(),
        "--out".as_ref(),
        at("packed").as_os_str(),
    ]))
    .succeeded();
    let added = add(&at("packed"), &at("results"), "1").succeeded();
    assert!(
        added.stdout.contains("1 of them scored again"),
        "{}",
        added.stdout
    );
}

#[test]
fn a_card_that_says_too_little_is_refused() {
    let folder = scratch();
    let out = folder.path().join("submission");
    let message = submit("method = \"odgs\"\n", &out)
        .failed_quietly(2)
        .to_owned();
    assert!(message.contains("missing field"), "{message}");
    let message = submit(&CARD.replace("\"odgs\"", "\"other\""), &out);
    let message = message.failed_quietly(2);
    assert!(
        message.contains("no results of the card's method other"),
        "{message}"
    );
}

/// Two links to their own folder lead to 2^40 paths.
#[test]
#[cfg(unix)]
fn links_are_refused_before_anything_is_read() {
    let (folder, submission) = submitted();
    let results = folder.path().join("results");
    for (name, target) in [
        ("results/0000/a", "."),
        ("results/0000/b", "."),
        ("stray", "/etc/passwd"),
    ] {
        let link = submission.join(name);
        std::os::unix::fs::symlink(target, &link).unwrap();
        let message = add(&submission, &results, "0").failed_quietly(2).to_owned();
        assert!(message.contains("is a link"), "{message}");
        fs::remove_file(link).unwrap();
    }
    add(&submission, &results, "0").succeeded();
}

#[test]
fn a_submission_without_results_is_refused() {
    let (folder, submission) = submitted();
    let path = submission.join("submission.json");
    let mut record: Submission = store::read_record(&path).unwrap();
    record.results.clear();
    store::write_record(&path, &record).unwrap();
    let results = folder.path().join("results");
    let message = add(&submission, &results, "0").failed_quietly(2).to_owned();
    assert!(
        message.contains("submission.json: holds no results"),
        "{message}"
    );
}

/// The table is read byte by byte: a changed one gives one line and no crash.
#[test]
fn a_damaged_table_of_views_is_refused() {
    let (folder, submission) = submitted();
    let results = folder.path().join("results");
    let path = submission.join("results/0000/frames.csv");
    fs::write(&path, b"PAR1\x15\x04\x15\xff\xff\xff\x7fPAR1").unwrap();
    repack(&submission, "frames.csv");
    let message = add(&submission, &results, "0").failed_quietly(2).to_owned();
    assert!(
        message.contains("frames.csv: must be a table of views"),
        "{message}"
    );
}

/// A submitter without the weights of a network states so, and the stated metrics alone are checked.
#[test]
fn metrics_that_were_not_available_there_are_not_asked_for() {
    let (folder, submission) = submitted();
    let results = folder.path().join("results");
    let path = submission.join("results/0000/result.json");
    let mut record: ResultRecord = store::read_record(&path).unwrap();
    // Simulates a metric with weights: the verifier can compute it, the submitter could not.
    record.novel_views.remove("ssim").unwrap();
    store::write_record(&path, &record).unwrap();
    repack(&submission, "result.json");
    let message = add(&submission, &results, "1").failed_quietly(2).to_owned();
    assert!(message.contains("states nothing for ssim"), "{message}");
    record.unavailable.push(Unavailable {
        view: "novel".to_owned(),
        metric: "ssim".to_owned(),
        reason: "its weights are missing".to_owned(),
    });
    store::write_record(&path, &record).unwrap();
    repack(&submission, "result.json");
    add(&submission, &results, "1").succeeded();
}
