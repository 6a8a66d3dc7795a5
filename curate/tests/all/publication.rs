//! Tables, metadata, card and datasheet of a published dataset, and the statements of its makers.

use std::{
    collections::BTreeSet,
    fs,
    path::{Path, PathBuf},
};

use omnilife_curate::{
    CurateSettings,
    annotation::{AnnotateSettings, annotate_dataset},
    curate_dataset,
    publish::{PublishSettings, publish, unstated, verify, working_files},
    slicing::SliceSettings,
};
use omnilife_schemas::{
    progress::Silent,
    records::{Sampling, Sequence, VideoProjection},
    store,
};
use serde_json::Value;
use support::erp_clip;
use tempfile::TempDir;

use crate::support;

const ABOUT: &str = r#"
name = "Streets"
licence = "CC-BY-4.0"
description = "Walks."
[statements]
creators = ["Ada Example"]
url = "https://example.org/streets"
version = "1.0.0"
date_published = "2026-05-01"
citation = "@misc{streets}"
purpose = "Comparisons."
funding = "None."
limitations = "Daylight only."
biases = "One country."
personal_information = "Faces are blurred."
synthetic_data = false
sources = ["https://example.org/footage", "own capture"]
consent = "Signs."
ethical_review = "Not required."
uses = "Research."
social_impact = "Surveillance is a risk."
contact = "streets@example.org"
maintenance = "Until 2031."
"#;

/// Returns a dataset of one video with slices and an annotation.
fn dataset() -> (TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let video = erp_clip(folder.path(), "walk.mp4", &[1], 20, 10);
    let out = folder.path().join("set");
    let settings = CurateSettings {
        enforce: false,
        sampling: Sampling::MaxFrames(10),
        slices: Some(SliceSettings { audio: false }),
        ..CurateSettings::default()
    };
    let curated = curate_dataset(&[video], &out, &settings, &Silent).unwrap();
    assert!(curated.errors.is_empty(), "{:?}", curated.errors);
    drop(curated);
    let tags = folder.path().join("tags.csv");
    fs::write(
        &tags,
        "sequence,author,scene,action\nwalk/seq-000,Ada,beach,walking\n",
    )
    .unwrap();
    let settings = AnnotateSettings {
        tags: vec![tags],
        ..AnnotateSettings::default()
    };
    annotate_dataset(&out, &settings, &Silent).unwrap();
    (folder, out)
}

fn publish_with(out: &Path, about: &str, is_strict: bool) -> Result<(), String> {
    let file = out.with_file_name("about.toml");
    fs::write(&file, about).unwrap();
    let settings = PublishSettings {
        about: Some(file),
        is_strict,
        ..PublishSettings::default()
    };
    let published = publish(out, &settings, &Silent);
    published.map(drop).map_err(|error| error.to_string())
}

fn croissant(out: &Path) -> Value {
    serde_json::from_str(&fs::read_to_string(out.join("croissant.json")).unwrap()).unwrap()
}

fn names(list: &Value) -> Vec<&str> {
    let list = list.as_array().unwrap().iter();
    list.map(|entry| entry["name"].as_str().unwrap()).collect()
}

#[test]
fn record_sets_are_those_of_the_tables() {
    let (_folder, out) = dataset();
    publish_with(&out, ABOUT, true).unwrap();
    assert_eq!(verify(&out, &Silent).unwrap(), [""; 0]);
    let metadata = croissant(&out);
    assert_eq!(
        metadata["conformsTo"][0],
        "http://mlcommons.org/croissant/1.1"
    );
    assert_eq!(
        names(&metadata["recordSet"]),
        ["sequences", "frames", "annotations"]
    );
    for resource in metadata["distribution"].as_array().unwrap() {
        if let Some(file) = resource["contentUrl"].as_str() {
            let head = fs::read_to_string(out.join(file)).unwrap();
            let head: Vec<&str> = head.lines().next().unwrap().split(',').collect();
            let sets = metadata["recordSet"].as_array().unwrap().iter();
            let found = sets
                .map(|set| names(&set["field"]))
                .find(|fields| fields.starts_with(&head));
            assert!(found.is_some(), "{file}: {head:?}");
        }
    }
    let frames = &metadata["distribution"][2];
    assert_eq!(frames["includes"][0], "videos/walk/seq-000/frames/*.png");
    let image = &metadata["recordSet"][1]["field"][5];
    assert_eq!(image["dataType"][0], "sc:ImageObject");
    assert_eq!(metadata["rai:hasSyntheticData"], false);
    assert_eq!(
        metadata["prov:wasDerivedFrom"][0]["@id"],
        "https://example.org/footage"
    );
    assert_eq!(metadata["creator"][0]["name"], "Ada Example");

    let videos = fs::read_to_string(out.join("videos/walk/slices/metadata.csv")).unwrap();
    assert!(
        videos.starts_with("file_name,sequence,") && videos.contains("\nseq-000.mp4,walk/seq-000,"),
        "{videos}"
    );
    let annotations = fs::read_to_string(out.join("tables/annotations.csv")).unwrap();
    assert!(
        annotations.contains("walk/seq-000,scene,beach,Ada\n"),
        "{annotations}"
    );
    let card = fs::read_to_string(out.join("README.md")).unwrap();
    assert!(
        card.contains("- config_name: videos\n") && !card.contains("Not stated"),
        "{card}"
    );
    assert!(!card.contains("omnilife curate"), "{card}");
    // The card lists the files that there are.
    for file in [
        "analysis.json",
        "slices/*.mp4",
        "annotation.json",
        "tables/frames.csv",
    ] {
        assert!(card.contains(file), "{file}: {card}");
    }
    for file in ["scene.json", "points.ply", "masks/", "depth/", "shards/"] {
        assert!(!card.contains(file), "{file}: {card}");
    }
    let sheet = fs::read_to_string(out.join("DATASHEET.md")).unwrap();
    assert!(
        sheet.contains("generated?** No.") && !sheet.contains("Not stated"),
        "{sheet}"
    );

    // The same records and statements give the same bytes.
    let sums = fs::read(out.join("SHA256SUMS")).unwrap();
    publish(&out, &PublishSettings::default(), &Silent).unwrap();
    assert_eq!(fs::read(out.join("SHA256SUMS")).unwrap(), sums);
}

/// Returns the number of a card's charts, and its lines on statistics without any class.
fn charts(out: &Path) -> (usize, Vec<String>) {
    let card = fs::read_to_string(out.join("README.md")).unwrap();
    let missing = card
        .lines()
        .filter(|line| line.starts_with("Not annotated"));
    let charts = card.lines().filter(|line| line.starts_with("!["));
    (charts.count(), missing.map(str::to_owned).collect())
}

#[test]
fn statistics_without_any_class_share_a_line_instead_of_charts() {
    let (_folder, out) = dataset();
    publish_with(&out, ABOUT, true).unwrap();
    assert_eq!(charts(&out), (6, Vec::new()));

    let (_folder, out) = dataset();
    fs::remove_file(out.join("videos/walk/seq-000/annotation.json")).unwrap();
    publish_with(&out, ABOUT, true).unwrap();
    let (drawn, missing) = charts(&out);
    assert_eq!((drawn, missing.len()), (1, 1));
    for property in ["group", "scene", "action", "ego-motion", "dynamics"] {
        assert!(missing[0].contains(property), "{property}: {missing:?}");
    }
    assert!(!missing[0].contains("duration"), "{missing:?}");
    let files = fs::read_dir(out.join("statistics")).unwrap();
    let names = files.map(|entry| entry.unwrap().file_name());
    let figures: Vec<_> = names
        .filter(|name| name.to_string_lossy().ends_with(".svg"))
        .collect();
    assert_eq!(figures, ["durations.svg"]);
    let card = fs::read_to_string(out.join("README.md")).unwrap();
    assert!(
        card.contains("| duration |") && !card.contains("| group |"),
        "{card}"
    );
}

/// A flight of a drone is not panoramic, and the release of its frames does not claim it.
#[test]
fn the_card_of_perspective_video_claims_no_panoramas() {
    let (_folder, out) = dataset();
    publish_with(&out, ABOUT, true).unwrap();
    let card = || fs::read_to_string(out.join("README.md")).unwrap();
    assert!(
        card().contains("of equirectangular 360-degree video;")
            && card().contains("\n- equirectangular\n")
    );
    let file = out.join("videos/walk/seq-000/sequence.json");
    let mut sequence: Sequence = store::read_record(&file).unwrap();
    sequence.projection.projection = VideoProjection::Rectilinear;
    store::write_record(&file, &sequence).unwrap();
    publish_with(&out, ABOUT, true).unwrap();
    assert!(
        card().contains("of perspective video;") && !card().contains("equirectangular"),
        "{}",
        card()
    );
    assert_eq!(
        croissant(&out)["keywords"],
        serde_json::json!(["perspective video", "3D reconstruction"])
    );
}

/// Masks of a program that failed lie hidden in a sequence: no part of a release, and named.
#[test]
fn hidden_folders_of_sequences_are_no_part_of_a_release() {
    let (_folder, out) = dataset();
    let hidden = out.join("videos/walk/seq-000/.unfinished-masks");
    fs::create_dir(&hidden).unwrap();
    fs::write(hidden.join("request.txt"), "sh net.sh").unwrap();
    publish(&out, &PublishSettings::default(), &Silent).unwrap();
    assert_eq!(verify(&out, &Silent).unwrap(), [""; 0]);
    let sums = fs::read_to_string(out.join("SHA256SUMS")).unwrap();
    assert!(!sums.contains("unfinished"), "{sums}");
    fs::write(out.join("index.html"), "the page").unwrap();
    let working = working_files(&out).unwrap();
    assert_eq!(working, [".done", ".unfinished-masks", "index.html"]);
}

#[test]
fn an_unknown_licence_is_refused_where_it_is_stated() {
    let (_folder, out) = dataset();
    let refusal = publish_with(&out, "licence = \"GPLX\"\n", false).unwrap_err();
    assert!(
        refusal.contains("about.toml") && refusal.contains("GPLX"),
        "{refusal}"
    );
    assert!(!out.join("croissant.json").exists());
    // One of an earlier publication, beside statements without any.
    publish_with(&out, ABOUT, false).unwrap();
    let about = out.join("about.json");
    let record = fs::read_to_string(&about).unwrap();
    fs::write(&about, record.replace("CC-BY-4.0", "GPLX")).unwrap();
    let refusal = publish_with(&out, "name = \"Streets\"\n", false).unwrap_err();
    assert!(
        refusal.contains("about.json") && refusal.contains("GPLX"),
        "{refusal}"
    );
}

#[test]
fn a_strict_publication_names_everything_that_is_unstated() {
    let (_folder, out) = dataset();
    let refusal = publish_with(&out, "", true).unwrap_err();
    assert!(!out.join("croissant.json").exists());
    publish_with(&out, "", false).unwrap();
    let keys = unstated(&out).unwrap();
    let expected: BTreeSet<&str> = ABOUT
        .lines()
        .filter_map(|line| Some(line.split_once(" = ")?.0))
        .filter(|key| *key != "name")
        .collect();
    assert_eq!(keys.iter().copied().collect::<BTreeSet<_>>(), expected);
    let (card, sheet) = (out.join("README.md"), out.join("DATASHEET.md"));
    let card = fs::read_to_string(card).unwrap();
    for key in &keys {
        assert!(
            refusal.contains(key) && card.contains(key),
            "{key}: {refusal}"
        );
    }
    let sheet = fs::read_to_string(sheet).unwrap();
    assert_eq!(sheet.matches("*Not stated.*").count(), keys.len());
    let metadata = croissant(&out);
    assert_eq!(metadata.get("rai:dataBiases"), None);
    assert_eq!(metadata.get("license"), None);

    // One statement alone is missing.
    let without: String = ABOUT
        .lines()
        .filter(|line| !line.starts_with("biases"))
        .map(|line| format!("{line}\n"))
        .collect();
    let refusal = publish_with(&out, &without, true).unwrap_err();
    assert!(refusal.contains("must state biases;"), "{refusal}");
    let refusal = publish_with(&out, "[statements]\nbias = \"x\"\n", false).unwrap_err();
    assert!(
        refusal.contains("about.toml: line") && refusal.contains("bias"),
        "{refusal}"
    );
}
