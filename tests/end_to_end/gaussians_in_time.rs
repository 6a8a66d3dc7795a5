//! Dynamic runs exported as Gaussians in time: rendered again, as a sequence, and played in a browser.

use std::{path::Path, process::Command};

use crate::{
    assets::{asset, moving_run, no_browser},
    support::{SEQUENCE, omnilife, read_image, scratch, small_run},
};

/// Exports a run or a file; returns what the program said.
fn export(source: &Path, out: &Path, arguments: &[&str]) -> crate::support::Ended {
    let mut words = vec!["reconstruct", "export", source.to_str().unwrap(), "--out"];
    words.push(out.to_str().unwrap());
    words.extend(arguments);
    omnilife(words)
}

#[test]
fn a_dynamic_run_is_one_file_that_is_rendered_as_the_run_is() {
    let folder = scratch();
    let run = moving_run();
    let out = folder.path().join("asset");
    export(run, &out, &["--format", "gtime", "--page"]).succeeded();
    let record = asset(&out);
    let file = out.join("full.gtime");
    let level = &record["levels"][0];
    let bytes = std::fs::metadata(&file).unwrap().len();
    assert_eq!(level["bytes"].as_u64(), Some(bytes));
    assert_eq!(record["page"]["holds_moments"], true);
    let scene = small_run().out.join(SEQUENCE).join("scene.json");
    let views = folder.path().join("views");
    let words = [
        "reconstruct".as_ref(),
        "render".as_ref(),
        file.as_os_str(),
        "--poses".as_ref(),
        scene.as_os_str(),
        "--out".as_ref(),
        views.as_os_str(),
    ];
    omnilife(words).succeeded();
    let predicted = read_image(&run.join("predictions/novel/000004.png"));
    let rendered = read_image(&views.join("000004.png"));
    let pairs = predicted.iter().zip(rendered.iter());
    let squares = pairs.map(|(a, b)| f64::from(a.abs_diff(*b)).powi(2));
    let mean = squares.sum::<f64>() / predicted.len() as f64;
    let decibels = 10.0 * (255.0 * 255.0 / mean.max(1e-9)).log10();
    assert!(decibels > 30.0, "{decibels}");
    // The file is a source of other formats too.
    let again = folder.path().join("again");
    export(&file, &again, &["--format", "spz"]).succeeded();
    // A page can be made of a file of another program, which stays as it is.
    let copied = folder.path().join("copied");
    export(&file, &copied, &["--format", "gtime", "--page"]).succeeded();
    let same = |name: &str| {
        let read = |folder: &Path| std::fs::read(folder.join(name)).unwrap();
        assert_eq!(read(&copied), read(&out), "{name}");
    };
    same("full.gtime");
    assert_eq!(asset(&copied)["placement"], record["placement"]);
    assert_eq!(asset(&copied)["splats"], record["splats"]);
    let up = ["--format", "gtime", "--up", "0,1,0"];
    let ended = export(&file, &folder.path().join("turned"), &up);
    assert_eq!(ended.code, Some(2));
    assert!(ended.stderr.contains("--up"), "{}", ended.stderr);
    if let Some(reason) = no_browser() {
        omnilife_schemas::testing::skip(reason);
        return;
    }
    let splats = level["splats"].to_string();
    let script =
        Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/end_to_end/player_in_browser.py");
    let mut browser = Command::new("python3");
    browser.arg(script).arg(out.join("index.html"));
    browser.args(["--splats", &splats]);
    if let Some(folder) = std::env::var_os("OMNILIFE_SCREENSHOTS") {
        browser.arg("--screenshots").arg(folder);
    }
    let output = browser.output().unwrap();
    print!("{}", String::from_utf8_lossy(&output.stdout));
    let stderr = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{stderr}");
}

#[test]
fn a_sequence_has_a_file_at_each_time_and_others_options_are_refused() {
    let folder = scratch();
    let run = moving_run();
    let out = folder.path().join("sequence");
    export(run, &out, &["--format", "spz-sequence", "--moments", "3"]).succeeded();
    let record = asset(&out);
    let sequence = record["sequence"].as_array().unwrap();
    assert_eq!(sequence.len(), 3);
    let seconds = |at: usize| sequence[at]["time_seconds"].as_f64().unwrap();
    assert!(seconds(0) < seconds(1) && seconds(1) < seconds(2));
    for moment in sequence {
        let file = out.join(moment["moving"]["file"].as_str().unwrap());
        let bytes = std::fs::metadata(file).unwrap().len();
        assert_eq!(moment["moving"]["bytes"].as_u64(), Some(bytes));
    }
    for (arguments, expected) in [
        (
            &["--format", "gtime", "--lod", "100"][..],
            "leave out --lod",
        ),
        (
            &["--format", "gtime", "--moments", "3"],
            "leave out --moments",
        ),
        (&["--format", "gtime", "--time", "1"], "leave out --time"),
        (
            &["--format", "spz-sequence", "--page"],
            "leave out the page",
        ),
    ] {
        let none = folder.path().join("none");
        let ended = export(run, &none, arguments);
        assert!(ended.stderr.contains(expected), "{}", ended.stderr);
        assert!(!none.exists());
    }
    let still = small_run().out.join(crate::support::METHOD).join("run");
    let none = folder.path().join("none");
    let ended = export(&still, &none, &["--format", "spz-sequence"]);
    assert!(ended.stderr.contains("does not move"), "{}", ended.stderr);
}
