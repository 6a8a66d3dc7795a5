//! Streams of output.

use std::{
    ffi::OsStr,
    process::{Command, Stdio},
};

use crate::support::{
    SMALL, copy_of_small_run, omnilife, read_image, run, sample, scratch, small_run,
};

#[test]
fn stderr_is_plain_lines_where_it_is_no_terminal() {
    let stderr = &small_run().ended.stderr;
    let is_plain = |line: &str| !line.chars().any(char::is_control);
    assert!(stderr.lines().all(is_plain), "{stderr:?}");
    for stage in [
        "analysing",
        "extracting frames",
        "training",
        "rendering",
        "scoring",
    ] {
        let done = |line: &str| line.trim().starts_with(stage) && line.contains("done in");
        assert!(stderr.lines().any(done), "{stage}: {stderr}");
    }
}

#[test]
fn quiet_leaves_stderr_empty_and_stdout_as_it_is() {
    let copy = copy_of_small_run();
    let quiet: Vec<&str> = SMALL.iter().chain(&["--quiet"]).copied().collect();
    let ended = run(&sample("street.mp4"), copy.path(), &quiet).succeeded();
    assert_eq!(ended.stderr, "");
    let without_paths = |text: &str| -> Vec<String> {
        // Paths follow the tables.
        text.lines()
            .take_while(|line| !line.starts_with("Table:"))
            .map(str::to_owned)
            .collect()
    };
    assert_eq!(
        without_paths(&ended.stdout),
        without_paths(&small_run().ended.stdout)
    );
}

#[test]
fn a_reader_that_goes_away_causes_no_panic() {
    let copy = copy_of_small_run();
    let out = copy.path().to_str().unwrap();
    let (video, poses) = (sample("street.mp4"), sample("poses.json"));
    let mut main_job = vec!["run", video.to_str().unwrap(), "--out", out];
    main_job.extend(["--poses", poses.to_str().unwrap()]);
    main_job.extend(SMALL);
    for arguments in [
        vec!["--help"],
        vec!["bench", "list"],
        vec!["reconstruct", "methods"],
        vec!["doctor"],
        main_job,
    ] {
        let (reader, writer) = std::io::pipe().unwrap();
        drop(reader);
        let output = Command::new(env!("CARGO_BIN_EXE_omnilife"))
            .args(&arguments)
            .stdout(writer)
            .stderr(Stdio::piped())
            .output()
            .unwrap();
        let stderr = String::from_utf8(output.stderr).unwrap();
        assert!(!stderr.contains("panicked"), "{arguments:?}: {stderr}");
        assert!(output.status.code().is_some(), "{arguments:?}");
    }
}

#[test]
fn a_table_of_datasets_has_own_and_published_rows() {
    let dataset = &small_run().out;
    let print = |format: &str| {
        let words = ["leaderboard", "datasets", "--format", format].map(OsStr::new);
        let ended = omnilife(words.into_iter().chain([dataset.as_os_str()])).succeeded();
        ended.stdout
    };
    let name = dataset.file_name().unwrap().to_str().unwrap();
    let csv = print("csv");
    assert!(csv.contains(&format!("{name},records,")), "{csv}");
    assert!(
        csv.contains("HM3D,") && csv.contains(",512x256,1,"),
        "{csv}"
    );
    assert!(print("table").contains("unknown"));
    assert!(print("markdown").contains("### OmniLife360, Table 1"));
    assert!(print("latex").starts_with("% Needs"));
}

#[test]
fn a_gallery_shows_the_sequences_of_a_dataset_once() {
    let dataset = &small_run().out;
    let folder = scratch();
    let figure = folder.path().join("gallery");
    let draw = || {
        omnilife([
            "leaderboard".as_ref(),
            "gallery".as_ref(),
            dataset.as_os_str(),
            "--out".as_ref(),
            figure.as_os_str(),
            "--panel-width".as_ref(),
            "96".as_ref(),
        ])
    };
    let drawn = draw().succeeded();
    assert!(
        drawn.stdout.contains("1 of 1 sequence: street/seq-000"),
        "{}",
        drawn.stdout
    );
    let image = read_image(&figure.with_extension("png"));
    assert_eq!(image.width(), 96);
    let text = std::fs::read_to_string(figure.with_extension("svg")).unwrap();
    assert!(text.contains("street/seq-000</text>"), "{text:.400}");
    // The same plot again is not a loss; another image of that name is.
    draw().succeeded();
    std::fs::write(figure.with_extension("png"), "another").unwrap();
    assert!(draw().failed_quietly(2).contains("is there already"));
}

#[test]
fn colours_are_for_terminals_and_on_request() {
    let escape = '\u{1b}';
    let wrong = ["curate", "verify", "/nonexistent"];
    for words in [&wrong[..], &["nonsense"][..]] {
        let of = |colour: &[&str]| omnilife(words.iter().chain(colour)).stderr;
        assert!(!of(&[]).contains(escape), "{words:?}: no terminal");
        assert!(!of(&["--color", "never"]).contains(escape), "{words:?}");
        assert!(of(&["--color", "always"]).contains(escape), "{words:?}");
    }
}
