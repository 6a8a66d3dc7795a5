//! A small scene on disk whose images are stripes that move.

use std::{
    fs,
    path::{Path, PathBuf},
    sync::Mutex,
};

use omnilife_schemas::{
    Pose, RgbImage,
    camera::ErpCamera,
    progress::Progress,
    records::{PoseSource, PoseValidation, Scale, Scene, SceneFrame, ValidationStatus},
    store,
};

pub const WIDTH: usize = 32;
pub const HEIGHT: usize = 16;

/// A scene of `frames` frames; those in `unposed` have no pose.
pub fn scene(frames: usize, unposed: &[usize]) -> Scene {
    Scene {
        id: "stripes/seq-000".to_owned(),
        camera: ErpCamera {
            width: WIDTH as u32,
            height: HEIGHT as u32,
        },
        scale: Scale::Metres,
        frames: (0..frames)
            .map(|frame| SceneFrame {
                image: format!("frames/{frame:06}.png"),
                time_seconds: 0.1 * frame as f64,
                pose: (!unposed.contains(&frame)).then_some(Pose {
                    rotation_wxyz: [1.0, 0.0, 0.0, 0.0],
                    centre: [frame as f64, 0.0, 0.0],
                }),
                mask: None,
            })
            .collect(),
        points: None,
        pose_source: PoseSource::Given {
            file: "poses.json".to_owned(),
        },
        validation: PoseValidation {
            status: ValidationStatus::Valid,
            registered_frames: (frames - unposed.len()) as u32,
            total_frames: frames as u32,
            measures: [].into(),
            problems: Vec::new(),
        },
    }
}

/// The image of a frame; `error` is added to every byte of it.
#[allow(dead_code, reason = "shared by tests that use different parts")]
pub fn image(frame: usize, error: u8) -> RgbImage {
    let bytes: Vec<u8> = (0..WIDTH * HEIGHT * 3)
        .map(|index| ((index / 3 + frame) * 7 % 200) as u8 + error)
        .collect();
    RgbImage::from_rgb8(WIDTH, HEIGHT, &bytes)
}

/// Writes a scene with its images; returns the `scene.json`.
#[allow(dead_code, reason = "shared by tests that use different parts")]
pub fn write_scene(folder: &Path, scene: &Scene) -> PathBuf {
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

/// Keeps what is reported.
#[derive(Default)]
#[allow(dead_code, reason = "shared by tests that use different parts")]
pub struct Recorder {
    pub notes: Mutex<Vec<String>>,
    pub steps: Mutex<u64>,
}

impl Progress for Recorder {
    fn begin(&self, _: &str, _: Option<u64>) {}
    fn advance(&self, steps: u64) {
        *self.steps.lock().unwrap() += steps;
    }
    fn remark(&self, _: &str) {}
    fn end(&self) {}
    fn note(&self, line: &str) {
        self.notes.lock().unwrap().push(line.to_owned());
    }
}
