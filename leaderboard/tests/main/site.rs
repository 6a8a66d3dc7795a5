//! The site in a real browser.
use std::{
    fs,
    path::{Path, PathBuf},
    process::Command,
};

use crate::support::{request, result, summary, write};
use omnilife_leaderboard::{
    LeaderboardRequest, MethodDescription, OptionDescription, build_leaderboard,
};
use omnilife_schemas::{
    records::{
        Backend, Dataset, Origin, OriginKind, Protocol, ScoredViews, Split, SplitRule, VideoEntry,
        VideoStatus,
    },
    rgb, store,
};

const METHODS: [(&str, f64); 5] = [
    ("odgs", 0.0),
    ("odgs-published", -1.0),
    ("periodic", 0.7),
    ("omni4dgs", 2.0),
    ("<img src=x onerror='window.alerted=1'>", 0.2),
];

/// An image as scoring leaves it: prediction, white line, ground truth.
fn image(path: &Path, [width, height]: [u32; 2], error: u8) {
    let wide = 2 * width + 4;
    let mut bytes = Vec::new();
    for row in 0..height {
        for column in 0..wide {
            let pixel = match column {
                _ if (width..width + 4).contains(&column) => [255; 3],
                _ => {
                    let (x, is_truth) = (column % (width + 4), column > width);
                    let shade = (x * 255 / width) as u8;
                    let off = if is_truth || x < width / 2 { 0 } else { error };
                    [shade, (row * 255 / height) as u8, off]
                }
            };
            bytes.extend(pixel);
        }
    }
    rgb::write_rgb8_png(path, wide as usize, height as usize, &bytes).unwrap();
}

/// Results of five methods on three scenes, one of which has images, and one unscored method.
pub(crate) fn small_site(folder: &Path) -> LeaderboardRequest {
    let input = folder.join("results");
    let protocol = Protocol {
        largest_width: Some(512),
        metrics: ["psnr", "ssim"].map(str::to_owned).to_vec(),
        ..Protocol::new(
            "per-scene",
            SplitRule::EveryNth {
                period: 5,
                offset: 4,
            },
            ScoredViews::InputAndNovel,
        )
    };
    let scenes = [
        ("street/seq-000", 20.0),
        ("hall/seq-000", 24.0),
        ("lake/seq-000", 27.0),
    ];
    for (scene, psnr) in scenes {
        for (position, (method, gain)) in METHODS.into_iter().enumerate() {
            let mut record = result(scene, method, psnr + gain, 0.6 + 0.02 * gain);
            record.protocol_hash = protocol.hash();
            record.training_seconds = Some(30.0 * (position + 1) as f64);
            record.scored_size = [64, 32];
            record
                .novel_views
                .insert("ws-psnr".to_owned(), summary(psnr, 12));
            let score = write(&input, &record);
            if scene == "street/seq-000" && position < 2 {
                let folder = score.join("comparisons");
                fs::create_dir(&folder).unwrap();
                for frame in [4, 9, 14] {
                    let file = format!("novel-{frame:06}.png");
                    image(&folder.join(file), [64, 32], 60);
                }
                fs::write(folder.join("novel-000019.png"), "no image").unwrap();
            }
        }
        let mut unscored = result(scene, "unscored", psnr, 0.5);
        unscored.protocol_hash = protocol.hash();
        unscored.novel_views.clear();
        unscored.warnings = vec!["novel views were not scored: no predictions given".to_owned()];
        write(&input, &unscored);
        let split = Split::new(scene, protocol.clone(), vec![0], vec![4]);
        store::write_record(&input.join(scene).join("split.json"), &split).unwrap();
    }
    LeaderboardRequest {
        dataset: Some(dataset(folder)),
        ..request(&input, &folder.join("out"))
    }
}

fn dataset(folder: &Path) -> PathBuf {
    let video = |file: &str, status: VideoStatus| VideoEntry {
        file: file.to_owned(),
        sha256: None,
        duration_seconds: None,
        origin: file.starts_with("hall").then(|| Origin {
            url: Some("https://e.org/<i>hall</i>".to_owned()),
            licence: Some("CC-BY-4.0".to_owned()),
            kind: Some(OriginKind::Web),
            ..Origin::default()
        }),
        status,
    };
    let curated = |sequences: &[&str]| VideoStatus::Curated {
        sequences: sequences.iter().map(|&id| format!("videos/{id}")).collect(),
    };
    let record = Dataset {
        videos: vec![
            video("street.mp4", curated(&["street/seq-000", "street/seq-001"])),
            video("hall.mp4", curated(&["hall/seq-000"])),
            video(
                "<b>short</b>.mp4",
                VideoStatus::Rejected {
                    reason: "duration 12.0 s is below 30 s".to_owned(),
                    failed: Vec::new(),
                },
            ),
            video(
                "broken.mp4",
                VideoStatus::Failed {
                    reason: "cannot be read".to_owned(),
                },
            ),
        ],
        not_taken: Vec::new(),
    };
    let file = folder.join("dataset.json");
    store::write_record(&file, &record).unwrap();
    file
}

/// One scene and 1,000 methods.
fn wide_site(folder: &Path) -> LeaderboardRequest {
    let input = folder.join("wide/results");
    for number in 0..1000 {
        let psnr = 20.0 + f64::from(number * 37 % 1000) / 100.0;
        let record = result("street/seq-000", &format!("method-{number:04}"), psnr, 0.8);
        write(&input, &record);
    }
    request(&input, &folder.join("wide/out"))
}

#[test]
fn the_pages_say_what_the_results_say() {
    let folder = tempfile::tempdir().unwrap();
    let request = small_site(folder.path());
    build_leaderboard(&request).unwrap();
    let page = |name: &str| fs::read_to_string(request.out.join("site").join(name)).unwrap();
    let index = page("index.html");
    assert!(
        index.contains("Of every 5 posed frames"),
        "the protocol is explained"
    );
    assert!(
        index.contains("omni4dgs: 25.667 dB after 120.0 s of training"),
        "the chart's points"
    );
    let dataset = page("dataset.html");
    assert!(dataset.contains("duration 12.0 s is below 30 s"));
    assert!(
        dataset.contains(
            "Videos given: 4; Videos read and processed: 3; Videos that gave sequences: 2"
        )
    );
    assert!(dataset.contains("Sequences cut: 3; Sequences scored: 2"));
    assert!(
        dataset.contains("https://e.org/&lt;i&gt;hall&lt;/i&gt;") && !dataset.contains("<i>hall"),
        "where a video came from, as text"
    );
    assert!(dataset.contains("1 of 4 videos"), "how many say so");
    let scenes: Vec<_> = fs::read_dir(request.out.join("site/scenes"))
        .unwrap()
        .map(|entry| entry.unwrap().path())
        .collect();
    let street = scenes
        .iter()
        .find(|path| path.to_string_lossy().contains("street") && !path.is_dir())
        .unwrap();
    let street = fs::read_to_string(street).unwrap();
    assert!(
        street.contains("2 of 3 views"),
        "no more than asked for, and it says so"
    );
    assert!(street.contains("novel-000019: is not a PNG image"));
    assert!(street.contains("novel views were not scored: no predictions given"));
    let images = fs::read_dir(scenes.iter().find(|path| path.is_dir()).unwrap()).unwrap();
    assert_eq!(images.count(), 4, "two views of two methods");
}

#[test]
fn readers_sort_filter_and_compare_in_a_browser() {
    let found = |program: &str| Command::new(program).arg("--version").output().is_ok();
    if !(found("chromium") && found("chromedriver") && found("python3")) {
        omnilife_schemas::testing::skip(
            "no Chromium with its driver, scripts/setup --browser installs them",
        );
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let (small, wide) = (small_site(folder.path()), wide_site(folder.path()));
    for request in [&small, &wide] {
        build_leaderboard(request).unwrap();
    }
    let mut reader = Command::new("python3");
    reader
        .arg(Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/main/site_in_browser.py"))
        .args([small.out.join("site"), wide.out.join("site")]);
    if let Some(images) = std::env::var_os("OMNILIFE_SCREENSHOTS") {
        reader.arg(images);
    }
    let output = reader.output().unwrap();
    print!("{}", String::from_utf8_lossy(&output.stdout));
    assert!(
        output.status.success(),
        "{}",
        String::from_utf8_lossy(&output.stderr)
    );
}

/// Returns the files that the first page offers, relative to it.
fn downloads_of(site: &Path) -> Vec<String> {
    let index = fs::read_to_string(site.join("index.html")).unwrap();
    let links = index.split("<a href=\"").skip(1);
    links
        .filter_map(|link| link.split_once('"'))
        .filter(|(_, rest)| rest.starts_with(" download"))
        .map(|(file, _)| file.to_owned())
        .collect()
}

/// A failed run has no scores, and a table of none is not written.
#[test]
fn without_scores_no_table_of_them_is_offered() {
    let folder = tempfile::tempdir().unwrap();
    let input = folder.path().join("results");
    let mut failed = result("hall/seq-000", "odgs", 25.0, 0.8);
    failed.run_failure = Some("out of memory".to_owned());
    write(&input, &failed);
    let request = request(&input, &folder.path().join("out"));
    build_leaderboard(&request).unwrap();
    let site = request.out.join("site");
    let offered = downloads_of(&site);
    assert!(
        !offered.iter().any(|file| file.ends_with("parquet")),
        "{offered:?}"
    );
    for file in offered {
        assert!(site.join(&file).is_file(), "{file}");
    }
}

#[test]
fn what_is_offered_for_download_is_there() {
    let folder = tempfile::tempdir().unwrap();
    let request = small_site(folder.path());
    build_leaderboard(&request).unwrap();
    let site = request.out.join("site");
    let offered = downloads_of(&site);
    for ending in ["csv", "parquet", "tex", "bib"] {
        assert!(
            offered.iter().any(|file| file.ends_with(ending)),
            "{ending}"
        );
    }
    for file in offered {
        assert!(fs::metadata(site.join(&file)).unwrap().len() > 0, "{file}");
    }
    let citation = fs::read_to_string(site.join("downloads/citation.bib")).unwrap();
    assert!(citation.starts_with("@misc{"), "{citation}");
    assert_eq!(citation.matches('{').count(), citation.matches('}').count());
}

#[test]
fn a_page_describes_a_method_of_this_program_alone() {
    let folder = tempfile::tempdir().unwrap();
    let input = folder.path().join("results");
    let mut ours = result("hall/seq-000", "odgs-without-sky", 25.0, 0.8);
    ours.backend = Some(Backend::Cpu { threads: 2 });
    write(&input, &ours);
    write(&input, &result("hall/seq-000", "periodic", 26.0, 0.8));
    let description = |method: &str| MethodDescription {
        method: method.to_owned(),
        title: format!("Title of {method}"),
        source: "A <paper>".to_owned(),
        text: "Static Gaussians. With a sky.".to_owned(),
        backends: Vec::new(),
        components: vec!["sky".to_owned()],
        on_request: Vec::new(),
        options: vec![OptionDescription {
            name: "degree".to_owned(),
            text: "degree of colour".to_owned(),
            values: "0 to 3".to_owned(),
            default: "0".to_owned(),
        }],
    };
    let request = LeaderboardRequest {
        project: Some("https://example.org/project".to_owned()),
        descriptions: ["odgs", "periodic"].map(description).into(),
        ..request(&input, &folder.path().join("out"))
    };
    build_leaderboard(&request).unwrap();
    let pages = request.out.join("site/methods");
    let page = |start: &str| {
        let mut files = fs::read_dir(&pages)
            .unwrap()
            .map(|entry| entry.unwrap().path());
        let name = |path: &PathBuf| {
            path.file_name()
                .unwrap()
                .to_string_lossy()
                .starts_with(start)
        };
        fs::read_to_string(files.find(name).unwrap()).unwrap()
    };
    let described = page("odgs-without-sky");
    for text in [
        "Title of odgs",
        "Static Gaussians.",
        "With a sky.",
        "A &lt;paper&gt;",
        "degree of colour",
        "<a href=\"https://example.org/project\" rel=\"noopener noreferrer\">Project</a>",
    ] {
        assert!(described.contains(text), "{text}");
    }
    assert!(!page("periodic").contains("Title of"), "of another program");
}
