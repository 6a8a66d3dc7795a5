//! A scene on disk whose images are stripes that move, and predictions of them.

use std::{
    fs,
    path::{Path, PathBuf},
};

use omnilife_bench::{BenchError, Predictions, ScoreRequest, protocols, score, split};
use omnilife_schemas::{
    Classified, ErrorKind, RgbImage,
    progress::Silent,
    records::{ResultRecord, Scene, Split},
    store,
};

use crate::scenes::{HEIGHT, WIDTH, scene};

/// The image of a frame; `error` is added to every byte of it.
pub(crate) fn image(frame: usize, error: u8) -> RgbImage {
    let bytes: Vec<u8> = (0..WIDTH * HEIGHT * 3)
        .map(|index| ((index / 3 + frame) * 7 % 200) as u8 + error)
        .collect();
    RgbImage::from_rgb8(WIDTH, HEIGHT, &bytes)
}

/// Writes a scene with its images; returns the `scene.json`.
pub(crate) fn write_scene(folder: &Path, scene: &Scene) -> PathBuf {
    fs::create_dir_all(folder.join("frames")).unwrap();
    for (frame, entry) in scene.frames.iter().enumerate() {
        image(frame, 0)
            .write_png(&folder.join(&entry.image))
            .unwrap();
    }
    let path = folder.join("scene.json");
    store::write_record(&path, scene).unwrap();
    path
}

/// A scene on disk with predictions and a request to score them.
pub(crate) struct Bench {
    pub(crate) folder: tempfile::TempDir,
    pub(crate) request: ScoreRequest,
    pub(crate) split: Split,
}

impl Bench {
    /// A scene of 10 frames (novel views 4 and 9) whose predictions are off by one byte in input
    /// views and by two in novel views.
    pub(crate) fn new() -> Self {
        Self::of(&scene(10, &[]))
    }

    pub(crate) fn of(scene: &Scene) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        let scene_file = write_scene(&at("scene"), scene);
        // Two metrics of the many: networks would take most of a test's time.
        let mut protocol = protocols::protocol("per-scene").unwrap();
        protocol.metrics = ["psnr", "ssim"].map(str::to_owned).to_vec();
        let split = split(scene, &protocol).unwrap();
        store::write_record(&at("split.json"), &split).unwrap();
        for (kind, frames, error) in [
            ("input", &split.input_views, 1),
            ("novel", &split.novel_views, 2),
        ] {
            fs::create_dir(at(kind)).unwrap();
            for &frame in frames {
                let file = at(kind).join(format!("{frame:06}.png"));
                image(frame as usize, error).write_png(&file).unwrap();
            }
        }
        let request = ScoreRequest {
            scene: scene_file,
            split: at("split.json"),
            predictions: Predictions::Folders {
                input_views: Some(at("input")),
                novel_views: Some(at("novel")),
            },
            method: "stripes".to_owned(),
            statement: omnilife_bench::Statement::default(),
            out: at("out"),
            memory_bytes: omnilife_bench::DEFAULT_MEMORY_BYTES,
            metrics: omnilife_bench::MetricChoice::All,
        };
        Self {
            folder,
            request,
            split,
        }
    }

    pub(crate) fn at(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    pub(crate) fn score(&self) -> Result<ResultRecord, BenchError> {
        score(&self.request, &Silent)
    }

    pub(crate) fn refusal(&self) -> String {
        let error = self.score().unwrap_err();
        assert_eq!(error.error_kind(), ErrorKind::User, "{error}");
        assert!(!error.to_string().contains('\n'), "{error}");
        error.to_string()
    }
}
