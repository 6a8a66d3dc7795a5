//! Readers of folders: models and scenes of other tools, runs, scores, submissions, sweeps. The binary itself makes
//! the files of runs.

use std::{
    ffi::OsStr,
    fs,
    path::{Path, PathBuf},
    sync::LazyLock,
};

use assert_cmd::cargo::cargo_bin_cmd;
use omnilife_bench::curve::{Clock, Region, read_run};
use omnilife_curate::{
    exchange::{self, ImportRequest},
    poses::{colmap::ColmapModel, matrices},
};
use omnilife_leaderboard::{LeaderboardRequest, build_leaderboard, submission::verify};
use omnilife_reconstruct::jobs::{
    camera_words::CameraWords,
    render::{RenderCamera, RenderRequest, render_poses},
};
use omnilife_schemas::{npy, progress::Silent, records::PoseConvention, store};
use omnilife_sweep::Sweep;
use tempfile::TempDir;

use crate::{
    datasets,
    samples::{names, write_omniphotos, write_roam360, write_scene},
    targets::{Input, Reader::Folder, Seed, Target},
};

/// Readers of folders.
pub(crate) const FOLDERS: &[Target] = &[
    Target {
        id: "colmap",
        words: &["EQUIRECTANGULAR", "PINHOLE", "#", "\n", "1 2 3"],
        cost: 2,
        seeds: |folder| {
            let frames = "0 1 1 0 0 0 0 0 0 2 CAMERA 1 1 CAMERA 2 2\n";
            with_rig(
                folder,
                "colmap",
                "in/sparse/0/frames.txt",
                frames.as_bytes(),
            )
        },
        reader: Folder(read_colmap),
    },
    Target {
        id: "nerfstudio",
        words: &["null", "[]", "\"transform_matrix\"", "\"file_path\"", "../"],
        cost: 10,
        seeds: |folder| exported(folder, "nerfstudio"),
        reader: Folder(|input, _| import(input, "nerfstudio")),
    },
    Target {
        id: "openmvg",
        words: &[
            "null",
            "[]",
            "\"extrinsics\"",
            "\"key\"",
            "\"ptr_wrapper\"",
            "2147483649",
        ],
        cost: 10,
        seeds: |folder| exported(folder, "openmvg"),
        reader: Folder(|input, _| import(input, "openmvg")),
    },
    Target {
        id: "hm3d",
        words: &["'descr'", "'<f4'", "(3, 3, 3)"],
        cost: 10,
        seeds: |folder| exported(folder, "hm3d"),
        reader: Folder(|input, _| import(input, "hm3d")),
    },
    Target {
        id: "frames",
        words: &[
            "null",
            "[]",
            "\"objects\"",
            "\"classes\"",
            "\"depth\"",
            "../",
        ],
        cost: 10,
        seeds: |folder| exported(folder, "frames"),
        reader: Folder(|input, _| import(input, "frames")),
    },
    Target {
        id: "360roam",
        words: &["null", "[]", "\"rgb_file\"", "\"test\"", "NaN", "../"],
        cost: 10,
        seeds: write_roam360,
        reader: Folder(|input, _| import(input, "360roam")),
    },
    Target {
        id: "omniphotos",
        words: &["#", "-1 ", "nan", "../", "\r\n", "pos_w", "EQUIRECTANGULAR"],
        cost: 10,
        seeds: write_omniphotos,
        reader: Folder(|input, _| import(input, "omniphotos")),
    },
    Target {
        id: "pose-matrices",
        words: &["'descr'", "'<f4'", "'<f8'", "(2, 3, 4)", "(1, 4, 4)", "\n"],
        cost: 1,
        seeds: |folder| {
            let rows = [1, 0, 0, 5, 0, 1, 0, 6, 0, 0, 1, 7, 0, 0, 0, 1_u8].map(f32::from);
            npy::write_f32(&folder.join("a.npy"), &[1, 4, 4], &rows).unwrap();
            let two = rows[..12].repeat(2);
            npy::write_f32(&folder.join("b.npy"), &[2, 3, 4], &two).unwrap();
            names(&["a.npy", "b.npy"])
        },
        reader: Folder(|input, seed| {
            for convention in [PoseConvention::CameraToWorld, PoseConvention::WorldToCamera] {
                drop(matrices::read(&input.path(seed), convention));
            }
        }),
    },
    Target {
        id: "colmap-binary",
        words: &["frames/000000.png"],
        cost: 2,
        seeds: |folder| {
            // One frame of two images: count, frame and rig, pose, and two triples.
            let mut frames = vec![1, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 1, 0, 0, 0];
            frames.extend([0; 56]);
            frames.extend([2, 0, 0, 0]);
            for image in [1, 2] {
                frames.extend([0, 0, 0, 0, image, 0, 0, 0, image, 0, 0, 0, 0, 0, 0, 0]);
            }
            with_rig(folder, "colmap-binary", "in/sparse/0/frames.bin", &frames)
        },
        reader: Folder(read_colmap),
    },
    Target {
        id: "omniblender",
        words: &["null", "[]", "\"transform_matrix\"", "NaN", "../"],
        cost: 10,
        seeds: datasets::write_omniblender,
        reader: Folder(|input, _| import(input, "omniblender")),
    },
    Target {
        id: "ricoh360",
        words: &["#", "\n", "nan", "../", "1e999"],
        cost: 10,
        seeds: datasets::write_ricoh360,
        reader: Folder(|input, _| import(input, "ricoh360")),
    },
    Target {
        id: "ob3d",
        words: &["null", "[]", "\"extrinsics\"", "NaN", "../", "4294967295"],
        cost: 10,
        seeds: datasets::write_ob3d,
        reader: Folder(|input, _| import(input, "ob3d")),
    },
    Target {
        id: "tartanair",
        words: &["#", "\n", "nan", "1e999", "-0"],
        cost: 10,
        seeds: datasets::write_tartanair,
        reader: Folder(|input, _| import(input, "tartanair")),
    },
    Target {
        id: "run",
        words: RUN_WORDS,
        cost: 20,
        seeds: |folder| copied("odgs", folder),
        reader: Folder(|input, _| render(input)),
    },
    Target {
        id: "moving-run",
        words: RUN_WORDS,
        cost: 20,
        seeds: |folder| copied("omni4dgs", folder),
        reader: Folder(|input, _| render(input)),
    },
    Target {
        id: "deformable-run",
        words: RUN_WORDS,
        cost: 20,
        seeds: |folder| copied("deformable", folder),
        reader: Folder(|input, _| render(input)),
    },
    Target {
        id: "atlas-run",
        words: RUN_WORDS,
        cost: 20,
        seeds: |folder| copied("nag", folder),
        reader: Folder(|input, _| render(input)),
    },
    Target {
        id: "scores",
        words: RUN_WORDS,
        cost: 2,
        seeds: |folder| copied("score", folder),
        reader: Folder(|input, _| {
            let folder = input.folder.join("in");
            drop(read_run(&folder, Clock::Wall, Region::Whole));
        }),
    },
    Target {
        id: "hostile-names",
        words: HOSTILE_NAMES,
        cost: 20,
        seeds: |folder| {
            copied("score", folder);
            vec!["in/result.json".to_owned()]
        },
        reader: Folder(|input, _| read_hostile_names(input)),
    },
    Target {
        id: "submission",
        words: RUN_WORDS,
        cost: 5,
        seeds: |folder| copied("submission", folder),
        reader: Folder(|input, _| drop(verify(&input.folder.join("in")))),
    },
    Target {
        id: "sweep",
        words: RUN_WORDS,
        cost: 2,
        seeds: |folder| copied("sweep", folder),
        reader: Folder(|input, _| {
            let sweep = Sweep::open(&input.folder.join("in"));
            drop(sweep.and_then(|sweep| sweep.states()));
        }),
    },
];

const RUN_WORDS: &[&str] = &[
    "null",
    "[]",
    "{}",
    "\"\"",
    "true",
    "../",
    "omnilife/run/1",
    "-",
];
/// Names with a meaning in the formats of tables and pages. Each must be escaped.
const HOSTILE_NAMES: &[&str] = &[
    "<script>alert(1)</script>",
    "<img src=x onerror=alert(1)>",
    "](javascript:alert(1))",
    "![](https://evil.invalid/p.png)",
    "\\u003cscript>alert(1)\\u003c/script>",
    "=cmd|' /C calc'!A0",
    "\\\\input{/etc/passwd}",
    "| |",
    "&amp;",
];

fn read_colmap(input: &Input, seed: &Seed) {
    if let Some(folder) = input.path(seed).parent() {
        drop(ColmapModel::read(folder).map(|model| model.cloud()));
    }
    // An import opens every image; one of sixteen is enough.
    if input.files_read.is_multiple_of(16) {
        import(input, "colmap");
    }
}

/// Exports a scene to another tool's format, in the folder `in`; the files except images are changed.
fn exported(folder: &Path, format: &str) -> Vec<String> {
    let (scene, out) = (folder.join("scene"), folder.join("in"));
    write_scene(&scene);
    let request = exchange::ExportRequest::new(&scene, format, &out);
    exchange::export(&request, &Silent).unwrap();
    let mut found = Vec::new();
    let mut folders = vec!["in".to_owned()];
    while let Some(next) = folders.pop() {
        for name in store::names_in(&folder.join(&next)).unwrap() {
            let name = format!("{next}/{name}");
            if folder.join(&name).is_dir() {
                folders.push(name);
            } else if !name.ends_with(".png") {
                found.push(name);
            }
        }
    }
    found.sort();
    found
}

/// Returns an exported model with a file of the frames of a rig.
fn with_rig(folder: &Path, format: &str, name: &str, frames: &[u8]) -> Vec<String> {
    let mut files = exported(folder, format);
    fs::write(folder.join(name), frames).unwrap();
    files.push(name.to_owned());
    files.sort();
    files
}

fn import(input: &Input, format: &str) {
    let out = input.folder.join("out");
    drop(exchange::import(&ImportRequest {
        frames_per_second: Some(10.0),
        ..ImportRequest::new(&input.folder.join("in"), format, "a", &out)
    }));
    store::remove(&out).unwrap();
}

/// Outputs of the binary for the sample in the repository.
static MADE: LazyLock<TempDir> = LazyLock::new(|| {
    let made = tempfile::tempdir().unwrap();
    let at = |name: &str| made.path().join(name).to_str().unwrap().to_owned();
    let sample = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/street");
    let [video, poses] =
        ["street.mp4", "poses.json"].map(|name| sample.join(name).display().to_string());
    let sequence = at("set/videos/street/seq-000");
    let (scene, split) = (
        format!("{sequence}/scene.json"),
        format!("{sequence}/per-scene/split.json"),
    );
    let run = |words: &str| {
        let mut command = cargo_bin_cmd!("omnilife");
        command.env("OMNILIFE_DATA", "/nonexistent").arg("--quiet");
        let output = command.args(words.split_whitespace()).output().unwrap();
        assert!(output.status.success(), "{words}: {output:?}");
    };
    run(&format!(
        "run {video} --poses {poses} --max-frames 5 --width 32 --iterations 3 --out {}",
        at("set")
    ));
    for (method, options) in [
        ("odgs", "--trace 1 --set max-gaussians=40"),
        ("omni4dgs", "--set max-gaussians=40"),
        ("deformable", "--set max-gaussians=40"),
        ("nag", "--set rays=64"),
    ] {
        run(&format!(
            "reconstruct train {scene} --split {split} --method {method} --iterations 2 {options} --out {}",
            at(method)
        ));
    }
    run(&format!(
        "bench score --scene {scene} --split {split} --run {}/run.json --out {}",
        at("odgs"),
        at("score")
    ));
    fs::write(
        made.path().join("card.toml"),
        "method = \"odgs\"\ntitle = \"ODGS\"\nauthors = [\"A\"]\nlicence = \"MIT\"\nhardware = \"x\"\n",
    )
    .unwrap();
    run(&format!(
        "leaderboard submit {} --card {} --out {}",
        at("set"),
        at("card.toml"),
        at("submission")
    ));
    fs::write(made.path().join("lines.txt"), "true\n").unwrap();
    run(&format!(
        "sweep plan commands {} --out {}",
        at("lines.txt"),
        at("sweep")
    ));
    run(&format!("sweep run {}", at("sweep")));
    made
});

/// Copies a folder that the binary made to `in` and its poses beside it. Returns the files to change: neither images
/// nor records of the folder's making.
fn copied(name: &str, folder: &Path) -> Vec<String> {
    let mut found = Vec::new();
    for file in below(&MADE.path().join(name)) {
        let to = folder.join("in").join(&file);
        fs::create_dir_all(to.parent().unwrap()).unwrap();
        fs::copy(MADE.path().join(name).join(&file), to).unwrap();
        let file = format!("in/{}", file.display());
        if !file.ends_with(".png") && !file.contains("/.done/") && !file.ends_with(".log") {
            found.push(file);
        }
    }
    write_scene(folder);
    found.sort();
    found
}

/// Returns the files below a folder, relative to it.
pub(crate) fn below(folder: &Path) -> Vec<PathBuf> {
    let mut files = Vec::new();
    let mut open = vec![PathBuf::new()];
    while let Some(next) = open.pop() {
        for name in store::names_in(&folder.join(&next)).unwrap() {
            let path = next.join(name);
            if folder.join(&path).is_dir() {
                open.push(path);
            } else {
                files.push(path);
            }
        }
    }
    files
}

fn render(input: &Input) {
    let out = input.folder.join("out");
    drop(render_poses(
        &RenderRequest {
            model: input.folder.join("in"),
            axes: None,
            poses: input.folder.join("scene.json"),
            cameras: CameraWords::default(),
            size: Some([16, 8]),
            camera: RenderCamera::OfPoses,
            layer: "all".to_owned(),
            cube_faces: None,
            out: out.clone(),
        },
        &Silent,
    ));
    store::remove(&out).unwrap();
}

fn read_hostile_names(input: &Input) {
    let out = input.folder.join("out");
    let built = build_leaderboard(&LeaderboardRequest {
        results: input.folder.join("in"),
        out: out.clone(),
        dataset: None,
        page: None,
        site: true,
        views: 0,
        project: None,
        descriptions: Vec::new(),
    });
    if built.is_ok() {
        for file in below(&out) {
            let text = String::from_utf8_lossy(&fs::read(out.join(&file)).unwrap()).into_owned();
            let meant = match file.extension().and_then(OsStr::to_str) {
                Some("html") => &["<script>alert", "<img src=x"][..],
                Some("md") => &["<script>alert", "<img src=x", "](javascript:", "![](https:"],
                _ => &[],
            };
            for words in meant {
                let is_escaped = |(at, _): (usize, &str)| text[..at].ends_with('\\');
                let mut places = text.match_indices(words);
                assert!(places.all(is_escaped), "{} holds {words}", file.display());
            }
        }
    }
    store::remove(&out).unwrap();
}
