//! Layers of the large crates: a top-level module imports modules of lower layers alone. Unit tests may import any
//! module.

use std::{
    collections::BTreeSet,
    fs,
    path::{Component, Path, PathBuf},
};

/// Layers from the ground up; modules of one layer do not import each other.
const BASE: &[&[&str]] = &[
    &[
        "assignment",
        "band_matrix",
        "elapsed",
        "error_kind",
        "foreign_code",
        "names",
        "natural_order",
        "placeholders",
        "plain_text",
        "process",
        "progress",
        "provenance",
        "statistics",
    ],
    &["store"],
    &["npy", "testing", "toml_file"],
    &["child", "lock", "ownership", "staging"],
    &["stage"],
];
const SCHEMAS: &[&[&str]] = &[
    &[
        "absolute_orientation",
        "camera",
        "colour_profile",
        "frame_scores",
        "layout",
        "object_scores",
        "pose",
        "srgb",
        "trajectory",
    ],
    &["ground_plane", "mask", "padded_frame", "points"],
    &["image_file", "oriented_box"],
    &["mask_file", "records"],
    &[
        "bootstrap",
        "distances",
        "mask_survey",
        "object_regions",
        "posed_view",
        "rgb",
        "scene_points",
        "split_rules",
    ],
    &["interpolation", "rgba", "tracked_regions"],
];
const ENGINE: &[&[&str]] = &[
    &["device", "kernels"],
    &["error"],
    &["camera"],
    &["clock", "training_view", "trajectories"],
    &["parameters"],
    &["schedule"],
    &["fields"],
    &["surfaces"],
    &["gaussians"],
    &["losses"],
    &["render"],
    &["model"],
    &["density"],
    &["step"],
];
const TRAINING: &[&[&str]] = &[
    &["aids", "alignment", "error", "random"],
    &["options"],
    &["request"],
    &["process"],
    &["scene"],
    &["stereo"],
    &["seeds"],
    &["formats"],
    &["learner", "models"],
    &["train"],
    &["baseline"],
    &["evidence"],
    &["components"],
    &["method"],
];
const METHODS: &[&[&str]] = &[
    &["dynamic", "feed_forward", "object_graph", "odgs", "panogs"],
    &[
        "deformable",
        "odgs_published",
        "omni4dgs",
        "periodic",
        "tracked_objects",
    ],
    &["omni4dgs_plus"],
];
const RECONSTRUCT: &[&[&str]] = &[&["registry"], &["backends", "variant"], &["jobs"]];
const CURATE: &[&[&str]] = &[
    &[
        "edited_frames",
        "error",
        "frame_order",
        "jpeg",
        "libraries",
        "motion",
        "opencv_images",
        "parquet_pages",
        "projection",
        "repetitions",
        "sharpness",
        "video_names",
    ],
    &[
        "boundaries",
        "criteria",
        "decoding_notes",
        "origins",
        "overlays",
        "video_folder",
    ],
    &["sphere_layouts"],
    &["slicing"],
    &["ledger", "near_duplicates", "settings"],
    &["admission", "frames", "poses", "shots"],
    &["analysis", "masks", "sequences"],
    &["stills"],
    &["exchange", "inputs", "pipeline"],
    &["annotation", "attrition", "worker"],
    &["publish"],
    &["audit", "overview"],
    &["dataset"],
];
const BENCH: &[&[&str]] = &[
    &["error", "lpips", "prediction"],
    &[
        "adapters",
        "curve",
        "poses",
        "protocols",
        "stability_report",
        "video_consistency",
    ],
    &["metrics", "split", "tracking"],
    &["availability", "scene_identity"],
    &["external"],
    &["run_facts"],
    &["statement"],
    &["job"],
    &["frames_table", "memory", "side_by_side", "summary", "truth"],
    &["diagnosis", "loaded_view", "paired"],
    &["scoring", "split_notes", "validate"],
];
const LEADERBOARD: &[&[&str]] = &[
    &[
        "assets",
        "class",
        "description",
        "error",
        "quantity",
        "variants",
    ],
    &["collect", "format", "numbers", "outputs", "validate"],
    &["group", "submission"],
    &["aids", "budget", "remarks", "repeats", "table"],
    &["published", "render"],
    &["datasets", "layouts", "results_csv"],
    &["questions", "tables"],
    &["readme", "site"],
    &["figure", "leaderboard"],
];

/// Returns the Rust files below a folder.
fn sources(folder: &Path) -> Vec<PathBuf> {
    let mut found = Vec::new();
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            found.extend(sources(&path));
        } else if path.extension().is_some_and(|extension| extension == "rs") {
            found.push(path);
        }
    }
    found
}

/// Returns the module of a file; `None` for the root of the crate and for files outside of `root`.
fn room_of(root: &Path, file: &Path) -> Option<String> {
    let first = file.strip_prefix(root).ok()?.components().next()?;
    let Component::Normal(name) = first else {
        return None;
    };
    let name = name.to_str().unwrap().trim_end_matches(".rs").to_owned();
    (name != "lib").then_some(name)
}

/// Returns the text without comments and without unit tests, which stand at the end.
fn code(text: &str) -> String {
    let is_comment = |line: &&str| line.trim_start().starts_with("//");
    let lines: Vec<&str> = text.lines().collect();
    let tests = lines
        .windows(2)
        .position(|pair| pair[0] == "#[cfg(test)]" && pair[1].contains("mod tests {"));
    let lines = &lines[..tests.unwrap_or(lines.len())];
    let kept: Vec<&str> = lines
        .iter()
        .copied()
        .filter(|line| !is_comment(line))
        .collect();
    kept.join("\n")
}

/// Returns the identifier at the start of a text.
fn identifier(text: &str) -> &str {
    let end = text.find(|letter: char| !(letter.is_alphanumeric() || letter == '_'));
    &text[..end.unwrap_or(text.len())]
}

/// Returns the first names of the members of a `{...}`; `text` starts right behind the opening brace.
fn members(text: &str) -> Vec<String> {
    let (mut depth, mut begins, mut found) = (0_usize, true, Vec::new());
    for (at, letter) in text.char_indices() {
        match letter {
            '{' => depth += 1,
            '}' if depth == 0 => break,
            '}' => depth -= 1,
            ',' if depth == 0 => begins = true,
            _ if begins && !letter.is_whitespace() => {
                found.push(identifier(&text[at..]).to_owned());
                begins = false;
            }
            _ => {}
        }
    }
    found
}

/// Returns the modules that a file's code names.
fn imports(text: &str) -> BTreeSet<String> {
    let mut found = BTreeSet::new();
    for (at, prefix) in text.match_indices("crate::") {
        let rest = &text[at + prefix.len()..];
        match rest.strip_prefix('{') {
            Some(group) => found.extend(members(group)),
            None => {
                found.insert(identifier(rest).to_owned());
            }
        }
    }
    found
}

/// Returns the modules of the texts that a file includes.
fn included(root: &Path, file: &Path, text: &str) -> BTreeSet<String> {
    let calls = text.split("include_str!(\"").skip(1);
    calls
        .filter_map(|rest| {
            let mut path = file.parent().unwrap().to_owned();
            for part in rest.split('"').next().unwrap().split('/') {
                match part {
                    ".." => {
                        path.pop();
                    }
                    name => path.push(name),
                }
            }
            room_of(root, &path)
        })
        .collect()
}

/// Returns a line for every import of a crate that does not lead to a lower layer.
fn wrong_arrows(root: &Path, layers: &[&[&str]]) -> Vec<String> {
    let layer = |module: &str| layers.iter().position(|modules| modules.contains(&module));
    let mut wrong = Vec::new();
    for file in sources(root) {
        let name = file.strip_prefix(root).unwrap().display().to_string();
        if name.ends_with("tests.rs") {
            continue;
        }
        let Some(module) = room_of(root, &file) else {
            continue;
        };
        let Some(own) = layer(&module) else {
            wrong.push(format!(
                "{name}: the module {module} has no layer in this test"
            ));
            continue;
        };
        let text = code(&fs::read_to_string(&file).unwrap());
        let mut modules = imports(&text);
        modules.extend(included(root, &file, &text));
        for other in modules.iter().filter(|other| **other != module) {
            if layer(other).is_some_and(|layer| layer >= own) {
                wrong.push(format!("{name} imports {other}"));
            }
        }
    }
    wrong
}

fn root(folder: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join(folder)
}

#[test]
fn arrows_of_base_and_schemas_run_down() {
    for (folder, layers) in [("schemas/base/src", BASE), ("schemas/src", SCHEMAS)] {
        let wrong = wrong_arrows(&root(folder), layers);
        assert!(wrong.is_empty(), "{folder}: {wrong:#?}");
    }
}

#[test]
fn arrows_of_the_engine_run_down() {
    let wrong = wrong_arrows(&root("reconstruct/engine/src"), ENGINE);
    assert!(wrong.is_empty(), "{wrong:#?}");
}

#[test]
fn arrows_of_reconstruct_run_down() {
    for (folder, layers) in [
        ("reconstruct/training/src", TRAINING),
        ("reconstruct/methods/src", METHODS),
        ("reconstruct/src", RECONSTRUCT),
    ] {
        let wrong = wrong_arrows(&root(folder), layers);
        assert!(wrong.is_empty(), "{folder}: {wrong:#?}");
    }
}

#[test]
fn arrows_of_curate_run_down() {
    let wrong = wrong_arrows(&root("curate/src"), CURATE);
    assert!(wrong.is_empty(), "{wrong:#?}");
}

#[test]
fn arrows_of_bench_run_down() {
    let wrong = wrong_arrows(&root("bench/src"), BENCH);
    assert!(wrong.is_empty(), "{wrong:#?}");
}

#[test]
fn arrows_of_the_leaderboard_run_down() {
    let wrong = wrong_arrows(&root("leaderboard/src"), LEADERBOARD);
    assert!(wrong.is_empty(), "{wrong:#?}");
}

#[test]
fn an_arrow_that_runs_up_is_found() {
    let text = "use crate::{\n    camera::View,\n    step::{Stepper, settings::TrainSettings},\n};\n\
                fn f() { crate::density::densify(); }\n// crate::model is only spoken of\n";
    let found = imports(&code(text));
    let expected = ["camera", "density", "step"].map(str::to_owned);
    assert_eq!(found, BTreeSet::from(expected));
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("camera.rs"), text).unwrap();
    fs::write(folder.path().join("attic.rs"), "").unwrap();
    let mut wrong = wrong_arrows(folder.path(), ENGINE);
    wrong.sort();
    assert_eq!(
        wrong,
        [
            "attic.rs: the module attic has no layer in this test",
            "camera.rs imports density",
            "camera.rs imports step",
        ]
    );
}
