//! Runs of the binary on the sample, and readers of its files.

use std::{
    fs,
    path::{Path, PathBuf},
    process::{Command, Stdio},
    sync::LazyLock,
    time::{Duration, SystemTime},
};

use assert_cmd::cargo::cargo_bin_cmd;
use glam::dvec3;
use image::RgbImage;
use omnilife_schemas::{
    elapsed::Elapsed,
    records::{ResultRecord, Scene, Track, TrackStage, Tracks, check_file},
    store,
    trajectory::{BSpline, ObjectPath},
};
use tempfile::TempDir;

/// Settings that reduce a run of the sample to seconds.
pub(crate) const SMALL: [&str; 6] = ["--max-frames", "10", "--width", "128", "--iterations", "30"];
/// Image size of the sample with [`SMALL`].
pub(crate) const SMALL_SIZE: (u32, u32) = (128, 64);
/// Input views of 10 frames.
pub(crate) const INPUT_VIEWS: [u32; 8] = [0, 1, 2, 3, 5, 6, 7, 8];
/// Novel views of 10 frames.
pub(crate) const NOVEL_VIEWS: [u32; 2] = [4, 9];
/// Folder of the sample's only sequence in an output folder.
pub(crate) const SEQUENCE: &str = "videos/street/seq-000";
/// Folder of the method's run and scores in an output folder.
pub(crate) const METHOD: &str = "videos/street/seq-000/per-scene/odgs";

pub(crate) fn sample(file: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("tests/data/street")
        .join(file)
}

/// Returns a file of the real footage beside the checkout; where it is missing, the test reports that and skips.
pub(crate) fn footage(file: &str) -> Option<PathBuf> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("../shared/data")
        .join(file);
    if path.is_file() {
        return Some(path);
    }
    omnilife_schemas::testing::skip(format_args!("{} is not here", path.display()));
    None
}

/// End of a run of the binary.
pub(crate) struct Ended {
    pub(crate) code: Option<i32>,
    pub(crate) stdout: String,
    pub(crate) stderr: String,
}

impl Ended {
    #[track_caller]
    pub(crate) fn succeeded(self) -> Self {
        assert_eq!(self.code, Some(0), "{}\n{}", self.stdout, self.stderr);
        self
    }

    /// Checks the exit code and that the error is one line, the last on stderr and (in a quiet run) the only one.
    /// Returns the message.
    #[track_caller]
    pub(crate) fn failed_quietly(&self, code: i32) -> &str {
        let lines: Vec<&str> = self.stderr.lines().collect();
        assert_eq!(self.code, Some(code), "{}\n{}", self.stdout, self.stderr);
        assert_eq!(lines.len(), 1, "{}", self.stderr);
        let message = lines[0].strip_prefix("omnilife: ").unwrap();
        assert!(!message.contains("panicked"), "{message}");
        // A cause that is part of the message must not be appended to it again.
        let parts: Vec<&str> = message.split(": ").collect();
        let repeats = parts.windows(2).any(|pair| pair[0] == pair[1]);
        assert!(!repeats, "repeats itself: {message}");
        message
    }
}

/// Runs the binary, which does not find an installation of structure from motion.
pub(crate) fn omnilife<S: AsRef<std::ffi::OsStr>>(arguments: impl IntoIterator<Item = S>) -> Ended {
    let output = cargo_bin_cmd!("omnilife")
        .env_remove("OMNILIFE_SFM_PYTHON")
        .env("OMNILIFE_DATA", "/nonexistent")
        .args(arguments)
        .output()
        .unwrap();
    Ended {
        code: output.status.code(),
        stdout: String::from_utf8(output.stdout).unwrap(),
        stderr: String::from_utf8(output.stderr).unwrap(),
    }
}

/// Runs `omnilife run` on one video with the sample's poses.
pub(crate) fn run(video: &Path, out: &Path, further: &[&str]) -> Ended {
    let poses = sample("poses.json");
    let mut arguments = vec!["run".as_ref(), video.as_os_str(), "--poses".as_ref()];
    arguments.extend([poses.as_os_str(), "--out".as_ref(), out.as_os_str()]);
    arguments.extend(further.iter().map(std::ffi::OsStr::new));
    omnilife(arguments)
}

/// Makes a temporary folder.
pub(crate) fn scratch() -> TempDir {
    tempfile::tempdir().unwrap()
}

/// Finished run of the sample with [`SMALL`] settings.
pub(crate) struct SmallRun {
    pub(crate) out: PathBuf,
    pub(crate) ended: Ended,
}

static SMALL_RUN: LazyLock<SmallRun> = LazyLock::new(|| {
    let out = kept_folder(Path::new(env!("CARGO_TARGET_TMPDIR")));
    let ended = run(&sample("street.mp4"), &out, &SMALL).succeeded();
    SmallRun { out, ended }
});

/// Makes a folder of a static, which several tests read. Statics are never dropped: it stays until a later test run
/// removes it.
pub(crate) fn kept_folder(within: &Path) -> PathBuf {
    remove_old(within, Duration::from_secs(3600));
    let kept = tempfile::Builder::new()
        .prefix("small-run-")
        .tempdir_in(within);
    kept.unwrap().keep()
}

fn remove_old(folder: &Path, age: Duration) {
    for entry in fs::read_dir(folder).unwrap().filter_map(Result::ok) {
        let is_ours = entry
            .file_name()
            .to_string_lossy()
            .starts_with("small-run-");
        let modified = entry.metadata().and_then(|metadata| metadata.modified());
        if is_ours && modified.is_ok_and(|time| time < SystemTime::now() - age) {
            fs::remove_dir_all(entry.path()).unwrap();
        }
    }
}

/// Returns the finished run that all tests read.
pub(crate) fn small_run() -> &'static SmallRun {
    &SMALL_RUN
}

/// Returns a copy of the finished run, to be changed.
pub(crate) fn copy_of_small_run() -> TempDir {
    let copy = scratch();
    for file in files(&small_run().out) {
        let target = copy.path().join(&file);
        fs::create_dir_all(target.parent().unwrap()).unwrap();
        fs::copy(small_run().out.join(&file), target).unwrap();
    }
    copy
}

/// Writes the sample's split into a folder, with the track of one object that passes ahead of the first camera.
pub(crate) fn write_tracked_split(folder: &Path) {
    let sequence = small_run().out.join(SEQUENCE);
    fs::create_dir_all(folder).unwrap();
    fs::copy(
        sequence.join("per-scene/split.json"),
        folder.join("split.json"),
    )
    .unwrap();
    let scene: Scene = store::read_record(&sequence.join("scene.json")).unwrap();
    let times = scene.frames.iter().map(|frame| frame.time_seconds);
    let (begin, end) = (
        times.clone().fold(f64::MAX, f64::min),
        times.fold(f64::MIN, f64::max),
    );
    let pose = scene.frames[0].pose.unwrap();
    let ahead =
        |side: f64| (pose.centre() + pose.rotation().unwrap() * dvec3(side, 0.5, 4.0)).to_array();
    let path = ObjectPath {
        centre: BSpline {
            degree: 1,
            knots: BSpline::uniform_knots(1, 2, begin, end),
            coefficients: vec![ahead(-1.0), ahead(1.0)],
        },
        heading_seconds: vec![begin],
        headings: vec![0.0],
    };
    let tracks = Tracks {
        scene: scene.id.clone(),
        frames: Vec::new(),
        image_size: scene.camera.size().map(|side| side as u32),
        up: [0.0, 0.0, 1.0],
        metres_per_unit: 1.0,
        stages: vec![TrackStage {
            stage: Tracks::DETECTOR_STAGE.to_owned(),
            method: "exact".to_owned(),
            reason: "it was made up".to_owned(),
            took: Elapsed::default(),
        }],
        detections: Vec::new(),
        tracks: vec![Track {
            id: 1,
            class: "vehicle".to_owned(),
            dimensions: [1.5, 1.0, 1.0],
            path,
            detections: 8,
            displacement: 2.0,
        }],
        warnings: Vec::new(),
    };
    store::write_record(&folder.join("tracks.json"), &tracks).unwrap();
}

/// Returns all files in a folder and below, relative to it, sorted.
pub(crate) fn files(folder: &Path) -> Vec<String> {
    let mut found = Vec::new();
    let mut folders = vec![folder.to_owned()];
    while let Some(next) = folders.pop() {
        for entry in fs::read_dir(next).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                folders.push(path);
            } else {
                let relative = path.strip_prefix(folder).unwrap();
                found.push(relative.to_str().unwrap().to_owned());
            }
        }
    }
    found.sort();
    found
}

/// Checks that every file in a folder is whole: records match their schemas, images decode, tables end properly, and
/// nothing temporary is left.
#[track_caller]
pub(crate) fn assert_all_whole(folder: &Path) {
    assert!(!temporary_left(folder), "{:?}", files(folder));
    for file in files(folder) {
        let path = folder.join(&file);
        let extension = path.extension().unwrap_or_default().to_str().unwrap();
        match extension {
            // External format, which its own test reads.
            "json" if file.ends_with("croissant.json") => {
                let text = fs::read_to_string(&path).unwrap();
                serde_json::from_str::<serde_json::Value>(&text).unwrap();
            }
            "json" => check_file(&path).unwrap(),
            "png" => drop(image::open(&path).unwrap()),
            "parquet" => assert!(fs::read(&path).unwrap().ends_with(b"PAR1"), "{file}"),
            "ply" => assert!(fs::read(&path).unwrap().starts_with(b"ply\n"), "{file}"),
            "bib" | "csv" | "md" | "svg" | "tex" | "txt" | "css" | "js" => {
                assert!(fs::read_to_string(&path).unwrap().ends_with('\n'), "{file}");
            }
            "html" => {
                let page = fs::read_to_string(&path).unwrap();
                assert!(page.trim_end().ends_with("</html>"), "{file}");
            }
            _ if file.ends_with("SHA256SUMS") => assert!(path.is_file()),
            _ => panic!("{file} is of no kind that is documented"),
        }
    }
}

fn temporary_left(folder: &Path) -> bool {
    let mut folders = vec![folder.to_owned()];
    while let Some(next) = folders.pop() {
        for entry in fs::read_dir(next).unwrap() {
            let entry = entry.unwrap();
            if entry.file_name().to_string_lossy().starts_with(".tmp-") {
                return true;
            }
            if entry.path().is_dir() {
                folders.push(entry.path());
            }
        }
    }
    false
}

/// Returns the scores in an output folder of the sample.
pub(crate) fn result(out: &Path) -> ResultRecord {
    store::read_record(&out.join(METHOD).join("score/result.json")).unwrap()
}

/// Reads an image, 8 bits per channel.
pub(crate) fn read_image(path: &Path) -> RgbImage {
    image::open(path).unwrap().into_rgb8()
}

pub(crate) struct SmallDisk(TempDir);

impl SmallDisk {
    /// Mounts a disk; `None` where mounting is not permitted.
    pub(crate) fn mount(kibibytes: u32) -> Option<Self> {
        let folder = scratch();
        mount(&format!("size={kibibytes}k"), folder.path()).then(|| Self(folder))
    }

    pub(crate) fn grow(&self) {
        assert!(mount("remount,size=64m", self.0.path()));
    }

    pub(crate) fn folder(&self) -> &Path {
        self.0.path()
    }

    /// Returns a folder on it that does not exist yet.
    pub(crate) fn out(&self) -> PathBuf {
        self.folder().join("out")
    }
}

impl Drop for SmallDisk {
    fn drop(&mut self) {
        if !quietly(Command::new("umount").arg(self.0.path())) {
            println!("nothing to unmount at {}", self.0.path().display());
        }
    }
}

fn mount(options: &str, folder: &Path) -> bool {
    let mut command = Command::new("mount");
    command.args(["-t", "tmpfs", "-o", options, "tmpfs"]);
    quietly(command.arg(folder))
}

fn quietly(command: &mut Command) -> bool {
    let status = command.stdout(Stdio::null()).stderr(Stdio::null()).status();
    status.is_ok_and(|status| status.success())
}
