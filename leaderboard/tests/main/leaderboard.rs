//! A whole leaderboard: layouts, site, check.
use std::{
    fs,
    path::{Path, PathBuf},
    time::{Duration, Instant},
};

use crate::support::{request, result, summary, write};
use omnilife_leaderboard::{LeaderboardRequest, build, build_leaderboard, check_leaderboard};
use omnilife_schemas::{
    records::{
        Asset, AssetChanges, AssetLevel, AssetPlacement, AssetSource, Direction, Failure,
        InvalidGaussians, ResultRecord, Summary,
    },
    store,
};

#[test]
fn assets_stand_beside_the_published_ones_and_their_levels_are_no_methods() {
    let place = Place::with(&[result("hall", "panogs", 27.0, 0.9)]);
    let folder = place.request.results.join("hall/asset");
    let level = |name: &str, splats: u64| AssetLevel {
        name: name.to_owned(),
        file: format!("{}.splat", name.to_lowercase()),
        splats,
        bytes: 32 * splats,
        sha256: String::new(),
        growth: 1.5,
    };
    let asset = Asset {
        source: AssetSource {
            sha256: String::new(),
            method: Some("panogs".to_owned()),
            scene: Some("hall".to_owned()),
            time_seconds: None,
        },
        splats: 5_366_446,
        levels: vec![level("1M", 1_000_000), level("full", 5_366_446)],
        moments: None,
        sequence: Vec::new(),
        left_out: Vec::new(),
        placement: AssetPlacement {
            offset: [0.0; 3],
            scale: 1.0,
            rotation_wxyz: [1.0, 0.0, 0.0, 0.0],
        },
        changes: AssetChanges::default(),
        invalid: InvalidGaussians::default(),
        page: None,
        wall_seconds: 1.25,
    };
    let scores = folder.join("scores/1m");
    fs::create_dir_all(&scores).unwrap();
    store::write_record(&folder.join("asset.json"), &asset).unwrap();
    let scored = result("hall", "of a level", 25.5, 0.8);
    store::write_record(&scores.join("result.json"), &scored).unwrap();
    place.build();
    let tables = place.read("tables/assets.md");
    let has = |cells: &[&str]| {
        let mut rows = tables.lines();
        rows.any(|row| {
            let found: Vec<&str> = row.split('|').map(str::trim).collect();
            found.get(1..=cells.len()) == Some(cells)
        })
    };
    // As in the paper's Table 2: 32 bytes a Gaussian, 171.73 MB.
    let (scene, method) = ("hall", "panogs");
    assert!(
        has(&[
            scene,
            method,
            "5,366,446",
            "1,000,000",
            "–",
            "5,366,446",
            "171.73",
            "1.250"
        ]),
        "{tables}"
    );
    assert!(
        has(&[
            r"Replica apartment\_1\_rand",
            "PanoGS (authors)",
            "5,366,446",
            "1,000,000",
            "5,000,000",
            "5,366,446",
            "171.73",
            "0.974"
        ]),
        "{tables}"
    );
    assert!(
        has(&[
            "HM3D test",
            "PanoGS (authors)",
            "4,481,177",
            "1,000,000",
            "4,305,084"
        ]),
        "{tables}"
    );
    assert!(
        has(&[
            scene,
            method,
            "1M",
            "1,000,000",
            "32.00",
            "1.50",
            "25.500",
            "0.8000"
        ]),
        "{tables}"
    );
    assert!(
        has(&[
            scene,
            method,
            "full",
            "5,366,446",
            "171.73",
            "1.50",
            "–",
            "–"
        ]),
        "{tables}"
    );
    assert!(!place.read("table.md").contains("of a level"));
    assert!(
        place
            .read("site/index.html")
            .contains("Assets for web viewers")
    );
    check_leaderboard(&place.request).unwrap();

    fs::write(folder.join("asset.json"), "{}").unwrap();
    let error = build_leaderboard(&place.request).unwrap_err().to_string();
    assert!(
        error.contains("asset.json") && !error.contains('\n'),
        "{error}"
    );
}

/// Three methods and two variants on four scenes of three videos, two seeds of one of them.
pub(crate) fn study() -> Vec<ResultRecord> {
    let mut results = Vec::new();
    let scenes = [
        ("market/seq-000", 20.0),
        ("market/seq-001", 21.0),
        ("lake/seq-000", 23.0),
        ("urban-street/seq-000", 24.0),
    ];
    for (position, (scene, psnr)) in scenes.into_iter().enumerate() {
        let wave = [0.4, -0.3, 0.1, -0.2][position];
        for (method, gain) in [
            ("odgs", 0.0),
            ("periodic", 0.5 + wave),
            ("omni4dgs", 2.0),
            ("omni4dgs-without-motion", 1.5),
            ("omni4dgs-without-temporal-opacity", 1.0),
        ] {
            let mut result = result(scene, method, psnr + gain, 0.6 + 0.01 * gain);
            let lpips = Summary {
                mean: 0.4 - 0.05 * gain,
                views: 12,
                direction: Some(Direction::LowerIsBetter),
                ..summary(0.0, 1)
            };
            result.novel_views.insert("lpips-vgg".to_owned(), lpips);
            result.peak_memory_bytes = Some(1_250_000_000);
            result.seed = Some(1);
            results.push(result);
        }
    }
    let mut again = results[0].clone();
    again.seed = Some(2);
    again
        .novel_views
        .insert("psnr".to_owned(), summary(22.0, 12));
    results.push(again);
    results
}

pub(crate) struct Place {
    _folder: tempfile::TempDir,
    pub(crate) request: LeaderboardRequest,
}

impl Place {
    pub(crate) fn with(results: &[ResultRecord]) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let (input, out) = (folder.path().join("results"), folder.path().join("out"));
        for result in results {
            write(&input, result);
        }
        Self {
            request: request(&input, &out),
            _folder: folder,
        }
    }

    pub(crate) fn build(&self) {
        build_leaderboard(&self.request).unwrap();
    }

    pub(crate) fn read(&self, path: &str) -> String {
        fs::read_to_string(self.request.out.join(path)).unwrap()
    }

    /// A file of the layouts of the only protocol.
    pub(crate) fn layout(&self, file: &str) -> String {
        self.read(&format!("tables/per-scene-1-a34df006b285/{file}"))
    }
}

#[test]
fn layouts_of_the_paper() {
    let place = Place::with(&study());
    place.build();
    for file in [
        "views.md",
        "views.tex",
        "dynamic-scenes.md",
        "4dgs.md",
        "ablation.md",
    ] {
        insta::assert_snapshot!(file, place.layout(file));
    }
    insta::assert_snapshot!("ablation.csv", place.layout("ablation.csv"));
}

/// Published tables are of a protocol, whatever kinds of view were scored under it.
#[test]
fn published_figures_are_chosen_by_protocol() {
    for (protocol, with_input_views, number) in [
        ("per-scene/1", true, Some(2)),
        ("per-scene/2", false, Some(2)),
        ("sparse-interpolation/1", false, Some(3)),
        ("sparse-panoramas/1", false, None),
    ] {
        let mut results = study();
        for result in &mut results {
            result.protocol = protocol.to_owned();
            if !with_input_views {
                result.input_views.clear();
            }
        }
        let place = Place::with(&results);
        place.build();
        for table in [2, 3] {
            let source = format!("OmniLife360, Table {table}");
            let mut files = files(&place.request.out);
            files.retain(|(_, bytes)| String::from_utf8_lossy(bytes).contains(&source));
            // Markdown, LaTeX and CSV of one layout, LaTeX among the downloads, and the first page.
            let expected = if number == Some(table) { 5 } else { 0 };
            assert_eq!(files.len(), expected, "{protocol}: {source}");
        }
        let index = place.read("site/index.html");
        assert!(!index.contains("<details class=\"published\" open"));
        let closed = index.matches("<details class=\"published\">").count();
        assert_eq!(closed > 0, number.is_some(), "{protocol}");
        assert_eq!(index.matches("not comparable").count(), closed);
    }
}

/// Figures for public datasets are below the results under the published splits, in no row of theirs.
#[test]
fn anchors_are_closed_and_apart() {
    let mut results = study();
    for result in &mut results {
        result.protocol = "published/1".to_owned();
    }
    let place = Place::with(&results);
    place.build();
    let views = place.read("tables/published-1-a34df006b285/views.md");
    let (measured, published) = views.split_once("Published figures: OmniBlender").unwrap();
    for anchor in ["LichtFeld", "PFGS360", "PaD-GS"] {
        assert!(!measured.contains(anchor), "{measured}");
        assert!(published.contains(anchor), "{published}");
    }
    let mut rows = published.lines();
    let row = rows.find(|row| row.starts_with("| LichtFeld Studio, LOU "));
    let cells: Vec<&str> = row.unwrap().split('|').map(str::trim).collect();
    let printed = ["LichtFeld Studio, LOU", "37.8208", "0.972434", "0.097461"];
    assert_eq!(cells[1..5], printed);
    assert!(published.contains("Source: https://github.com/MrNeRF/LichtFeld-Studio/pull/495"));
    assert!(!published.contains("**"), "{published}");
    assert!(!views.contains("OmniLife360, Table"), "{views}");
    let index = place.read("site/index.html");
    assert!(!index.contains("<details class=\"published\" open"));
    let closed = index.matches("<details class=\"published\">").count();
    assert!(closed > 0 && closed.is_multiple_of(6), "{closed}");
}

/// All files with their bytes.
pub(crate) fn files(folder: &Path) -> Vec<(PathBuf, Vec<u8>)> {
    let mut found = Vec::new();
    let mut folders = vec![folder.to_owned()];
    while let Some(next) = folders.pop() {
        for entry in fs::read_dir(next).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                folders.push(path);
            } else {
                let bytes = fs::read(&path).unwrap();
                found.push((path.strip_prefix(folder).unwrap().to_owned(), bytes));
            }
        }
    }
    found.sort();
    found
}

/// All files but tables of values, which are not text.
pub(crate) fn texts(folder: &Path) -> Vec<(PathBuf, String)> {
    let is_text = |(path, _): &(PathBuf, Vec<u8>)| path.extension() != Some("parquet".as_ref());
    let files = files(folder).into_iter().filter(is_text);
    files
        .map(|(path, bytes)| (path, String::from_utf8(bytes).unwrap()))
        .collect()
}

#[test]
fn the_same_results_give_the_same_bytes() {
    let (first, second) = (Place::with(&study()), Place::with(&study()));
    first.build();
    second.build();
    second.build();
    let (left, right) = (files(&first.request.out), files(&second.request.out));
    assert!(left.len() > 20);
    assert!(left == right);
}

#[test]
fn the_site_asks_the_network_for_nothing() {
    let place = Place::with(&study());
    place.build();
    for (path, text) in texts(&place.request.out.join("site")) {
        // Downloads are for other programs; their sources may have addresses.
        if path.starts_with("downloads") {
            continue;
        }
        for word in ["http:", "https:", "src=\"//", "@import", "fetch("] {
            assert!(!text.contains(word), "{}: {word}", path.display());
        }
    }
}

#[test]
fn names_are_text_and_never_markup() {
    let hostile = "<script>window.alerted = 1</script>\"'&|\\$_%{}";
    let mut results = study();
    for result in &mut results {
        if result.method == "odgs" {
            result.method = hostile.to_owned();
            result.warnings = vec![format!("remark {hostile}")];
            result
                .novel_views
                .insert(hostile.to_owned(), summary(1.0, 12));
        }
        result.scene = format!("{hostile}/{}", result.scene);
        result.protocol = format!("{hostile}/1");
    }
    let folder = tempfile::tempdir().unwrap();
    let input = folder.path().join("results");
    for (number, result) in results.iter().enumerate() {
        // Where a result lies says nothing about its names.
        let path = input.join(number.to_string());
        fs::create_dir_all(&path).unwrap();
        store::write_record(&path.join("result.json"), result).unwrap();
    }
    let out = folder.path().join("out");
    build_leaderboard(&request(&input, &out)).unwrap();
    let mut escaped = 0;
    for (path, text) in texts(&out) {
        let name = path.to_string_lossy();
        assert!(
            name.is_ascii() && !name.contains(['<', '"', '\'', '&']),
            "{name}"
        );
        if name.ends_with(".html") {
            assert!(!text.contains("<script>"), "{name}");
            escaped += text.matches("&lt;script&gt;").count();
        }
        if name.ends_with(".md") {
            let raw = text.replace("\\<", "");
            assert!(!raw.contains("<script"), "{name}");
        }
    }
    assert!(escaped > 20, "{escaped}");
}

/// The output of `scripts/readme-table` is that of the committed results.
#[test]
fn the_readme_shows_its_results() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let results = root.join("docs/leaderboard/results");
    check_leaderboard(&LeaderboardRequest {
        page: Some(root.join("README.md")),
        ..request(&results, &root.join("docs/leaderboard"))
    })
    .unwrap();
}

/// A missing score, a failure, a missing scene: shown, and never ranked.
#[test]
fn what_is_incomplete_is_never_best() {
    let mut results = study();
    let failure = Failure {
        view: "novel".to_owned(),
        frame: 4,
        reason: "000004.png is missing".to_owned(),
    };
    for (number, scene) in ["market/seq-000", "market/seq-001", "lake/seq-000"]
        .iter()
        .enumerate()
    {
        results.push(result(scene, "lacks-a-scene", 60.0, 0.999));
        let mut failed = result(scene, "failed", 70.0, 0.999);
        failed.failures = vec![failure.clone(); usize::from(number == 0)];
        results.push(failed);
        let mut unscored = result(scene, "unscored", 0.0, 0.999);
        unscored.novel_views.clear();
        results.push(unscored);
    }
    results.push(result("urban-street/seq-000", "failed", 70.0, 0.999));
    let mut unscored = result("urban-street/seq-000", "unscored", 0.0, 0.999);
    unscored.novel_views.remove("psnr");
    results.push(unscored);
    let place = Place::with(&results);
    place.build();
    let table = place.layout("views.md");
    let row = |name: &str| {
        table
            .lines()
            .find(|line| line.starts_with(&format!("| {name} ")))
            .unwrap()
    };
    for name in ["lacks-a-scene", "failed †", "unscored"] {
        let row = row(name);
        // Input views of the last one are complete; novel ones are what this is about.
        let novel: Vec<&str> = row.split('|').skip(5).collect();
        assert!(!novel.concat().contains("**"), "{row}");
        assert_eq!(novel[4].trim(), "–", "a rank: {row}");
    }
    assert!(row("omni4dgs").contains("**"), "{table}");
    assert!(table.contains("3 of 4"), "{table}");
}

#[test]
fn an_unknown_metric_is_in_the_csv_and_said_to_be() {
    let mut results = study();
    for result in &mut results {
        result
            .novel_views
            .insert("sparkle".to_owned(), summary(0.5, 12));
    }
    let place = Place::with(&results);
    place.build();
    assert!(
        place
            .layout("views.md")
            .contains("In table.csv alone: sparkle.")
    );
    assert!(place.read("table.csv").contains("novel_sparkle"));
}

/// Ten thousand methods are a wide table, not a square of work.
#[test]
fn ten_thousand_methods_are_built_in_seconds() {
    let results: Vec<(PathBuf, ResultRecord)> = (0..10_000)
        .map(|number| {
            let psnr = 20.0 + f64::from(number % 977) / 100.0;
            let record = result("street/seq-000", &format!("method-{number:05}"), psnr, 0.8);
            (PathBuf::from(format!("{number}/result.json")), record)
        })
        .collect();
    let out = tempfile::tempdir().unwrap();
    let begun = Instant::now();
    let tables = build(&results, out.path()).unwrap();
    assert!(
        begun.elapsed() < Duration::from_secs(60),
        "{:?}",
        begun.elapsed()
    );
    let rows = tables
        .markdown
        .lines()
        .filter(|line| line.starts_with("| street"));
    assert_eq!(rows.count(), 10_000);
}
