//! Adapters of published methods, each against a stand-in of its authors' code (`tests/data/adapters`): programs that
//! parse their arguments and read the data set as that code does, and leave the true images as their views.

use std::{
    fs,
    os::unix::fs::PermissionsExt,
    path::{Path, PathBuf},
};

use omnilife_bench::{ADAPTERS, Adapter, AdapterScenes};
use omnilife_schemas::{
    records::{ExternalRun, ResultRecord},
    store,
};
use tempfile::TempDir;

use crate::support::{SEQUENCE, SMALL_SIZE, files, omnilife, scratch, small_run};

/// A checkout with an adapter and the stand-in of its code.
struct Checkout {
    folder: TempDir,
    scene: String,
}

impl Checkout {
    fn new(adapter: &Adapter) -> Self {
        let folder = scratch();
        let sequence = small_run().out.join(SEQUENCE);
        let scene = match adapter.scenes {
            AdapterScenes::Panoramas => sequence,
            AdapterScenes::Perspective => perspective(&sequence, folder.path()),
            AdapterScenes::Traffic => drive(folder.path(), "kitti"),
            AdapterScenes::OneCamera => drive(folder.path(), "kitti/0003/image_02"),
        };
        let this = Self {
            folder,
            scene: text(&scene.join("scene.json")),
        };
        omnilife(["bench", "adapter", adapter.id, "--out", &this.at("code")]).succeeded();
        for part in ["common", adapter.id] {
            this.copy(part);
        }
        this.command("python", "exec python3 \"$@\"");
        let commands = PathBuf::from(this.at("code/commands"));
        for name in commands
            .is_dir()
            .then(|| files(&commands))
            .into_iter()
            .flatten()
        {
            this.command(
                &name,
                &format!("exec python3 \"{}/{name}\" \"$@\"", commands.display()),
            );
        }
        let (width, height) = SMALL_SIZE;
        let manifest = environment(adapter.manifest, &this.at("python"))
            .replace("1024x512", &format!("{width}x{height}"))
            .replace("[512,1024]", &format!("[{height},{width}]"));
        this.write_manifest(&manifest);
        omnilife([
            "bench",
            "split",
            &this.scene,
            "--protocol",
            adapter.protocol,
            "--out",
            &this.at("split.json"),
        ])
        .succeeded();
        this
    }

    fn at(&self, name: &str) -> String {
        text(&self.folder.path().join(name))
    }

    /// Copies a folder of stand-ins into the checkout, after the one that it names in `includes.txt`.
    fn copy(&self, part: &str) {
        let from = Path::new(env!("CARGO_MANIFEST_DIR"))
            .join("tests/data/adapters")
            .join(part);
        if let Ok(included) = fs::read_to_string(from.join("includes.txt")) {
            self.copy(included.trim());
        }
        for file in files(&from) {
            let target = PathBuf::from(self.at("code")).join(&file);
            fs::create_dir_all(target.parent().unwrap()).unwrap();
            fs::copy(from.join(&file), target).unwrap();
        }
    }

    /// Makes a program of the environment.
    fn command(&self, name: &str, body: &str) {
        let file = PathBuf::from(self.at("python/bin")).join(name);
        fs::create_dir_all(file.parent().unwrap()).unwrap();
        fs::write(&file, format!("#!/bin/sh\n{body}\n")).unwrap();
        fs::set_permissions(&file, fs::Permissions::from_mode(0o755)).unwrap();
    }

    fn manifest(&self) -> String {
        fs::read_to_string(self.at("code/method.toml")).unwrap()
    }

    fn write_manifest(&self, manifest: &str) {
        fs::write(self.at("code/method.toml"), manifest).unwrap();
    }

    /// Runs the adapter; returns its record and the log of the last command.
    fn run(&self) -> (ExternalRun, String) {
        omnilife([
            "--quiet",
            "bench",
            "external",
            &self.at("code/method.toml"),
            "--scene",
            &self.scene,
            "--split",
            &self.at("split.json"),
            "--out",
            &self.at("run"),
        ]);
        let record: ExternalRun =
            store::read_record(Path::new(&self.at("run/external-run.json"))).unwrap();
        let last = record.phases.last().unwrap();
        let log = fs::read_to_string(self.at("run") + "/" + &last.log).unwrap();
        (record, log)
    }

    fn score(&self) -> ResultRecord {
        omnilife([
            "--quiet",
            "bench",
            "score",
            "--scene",
            &self.scene,
            "--split",
            &self.at("split.json"),
            "--run",
            &self.at("run/external-run.json"),
            "--without-lpips",
            "--out",
            &self.at("scores"),
        ])
        .succeeded();
        store::read_record(Path::new(&self.at("scores/result.json"))).unwrap()
    }
}

fn text(path: &Path) -> String {
    path.to_str().unwrap().to_owned()
}

/// Makes a scene of the front faces of a panoramic one.
fn perspective(sequence: &Path, folder: &Path) -> PathBuf {
    let (faces, scene) = (folder.join("faces"), folder.join("front"));
    let (from, exported, to) = (text(sequence), text(&faces), text(&scene));
    let format = ["--format", "nerfstudio"];
    let export = ["--quiet", "curate", "export", &from, "--cube-faces", "40"];
    omnilife(export.into_iter().chain(format).chain(["--out", &exported])).succeeded();
    for face in ["right", "back", "left", "up", "down"] {
        fs::remove_dir_all(faces.join("images").join(face)).unwrap();
    }
    let import = ["--quiet", "curate", "import", &exported, "--id", "front"];
    omnilife(import.into_iter().chain(format).chain(["--out", &to])).succeeded();
    scene
}

/// Imports a drive with boxes and distances, or a camera of it.
fn drive(folder: &Path, path: &str) -> PathBuf {
    let scene = folder.join("drive");
    let fixture = Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("tests/data/drive")
        .join(path);
    let (from, to) = (text(&fixture), text(&scene));
    let import = ["--quiet", "curate", "import", &from, "--format"];
    let into = ["kitti-tracking", "--id", "drive", "--out", &to];
    omnilife(import.into_iter().chain(into)).succeeded();
    scene
}

/// Replaces a manifest's environment by a virtual one.
fn environment(manifest: &str, path: &str) -> String {
    let without = match manifest.split_once("[environment]\n") {
        Some((before, rest)) => {
            let (_, after) = rest.split_once("\n\n").unwrap();
            format!("{before}{after}")
        }
        None => manifest.to_owned(),
    };
    let environment = format!("[environment]\nkind = \"venv\"\npath = \"{path}\"\n\n[prepare]");
    without.replacen("[prepare]", &environment, 1)
}

fn adapter(id: &str) -> &'static Adapter {
    ADAPTERS.iter().find(|adapter| adapter.id == id).unwrap()
}

#[test]
fn every_adapter_writes_what_the_loader_of_its_method_reads_and_finds_its_views() {
    for adapter in ADAPTERS {
        let id = adapter.id;
        let checkout = Checkout::new(adapter);
        let (record, log) = checkout.run();
        assert_eq!(record.failure, None, "{id}: {log}");
        let result = checkout.score();
        assert!(result.failures.is_empty(), "{id}: {:?}", result.failures);
        // One Gaussian is not a scene; a video is lossy; faces are sampled twice.
        let least = match id {
            "lichtfeld" => 0.0,
            "layered-neural-atlases" => 24.0,
            _ if adapter.manifest.contains("{face_index") => 24.0,
            _ => 100.0,
        };
        let scored = [&result.novel_views, &result.input_views];
        let psnr = scored.into_iter().find_map(|views| views.get("psnr"));
        let psnr = psnr.unwrap().mean;
        assert!(psnr >= least, "{id}: {psnr}");
    }
}

#[test]
fn a_data_set_that_a_loader_refuses_fails_the_run() {
    for (id, old, new, reason) in [
        ("odgs", "\"openmvg\"", "\"colmap\"", "data_views.json"),
        (
            "gsplat-faces",
            "\\\"$2\\\" --cube-faces \\\"$3\\\" --sky-points 10000",
            "\\\"$2\\\"",
            "has no training images",
        ),
        ("deformable-gs", "--split \\\"$2\\\" ", "", "has no split"),
        (
            "splatter-360",
            "128x64",
            "1024x512",
            "is not of 1024x512 pixels",
        ),
        ("lichtfeld", "\"--given-only\", ", "", "may be a novel view"),
        ("pvg", "lambda_lidar=0", "lambda_lidar=1", "taken for depth"),
        (
            "omnimatte-rf",
            "[flow,mask,blender]",
            "[flow,mask,colmap]",
            "poses_bounds.npy",
        ),
        (
            "omnire",
            "--tracks \\\"$1/tracks.json",
            "--tracks \\\"$1/objects.json",
            "boxes of vehicles",
        ),
        (
            "street-gaussians",
            "['original_size']",
            "['other_size']",
            "would be resized",
        ),
        (
            "nag",
            "\\\"$1/config.yaml\\\"",
            "\\\"$0/config/davis/blackswan.yaml\\\"",
            "DATA_PATH",
        ),
        (
            "4dgf",
            "$(cat \\\"$0/data/street.txt\\\")",
            "--train-split-fraction 1.0 --add-background-points False",
            "need at least one array to concatenate",
        ),
        (
            "emernerf",
            "--intrinsics-of 1280 1920 ",
            "",
            "no middle of a pixel",
        ),
        (
            "layered-neural-atlases",
            "glob('*.png')",
            "glob('*.jpg')",
            "AssertionError",
        ),
    ] {
        let checkout = Checkout::new(adapter(id));
        let manifest = checkout.manifest();
        assert!(manifest.contains(old), "{id}: {old}");
        checkout.write_manifest(&manifest.replace(old, new));
        let (record, log) = checkout.run();
        assert!(record.failure.is_some(), "{id}");
        assert!(log.contains(reason), "{id}: {log}");
    }
}

#[test]
fn the_list_says_of_each_adapter_whether_it_was_run() {
    let listed = omnilife(["bench", "list"]).succeeded().stdout;
    for adapter in ADAPTERS {
        let line = listed
            .lines()
            .find(|line| line.trim_start().starts_with(&format!("{}: ", adapter.id)));
        let said = line.is_some_and(|line| line.ends_with(&adapter.tried.describe()));
        assert!(said, "{}: {line:?}", adapter.id);
    }
}
