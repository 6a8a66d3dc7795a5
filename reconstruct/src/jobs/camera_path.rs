//! Frames along which models are rendered: those of scenes and poses, and paths in files of rows.

use std::path::{Path, PathBuf};

use glam::{DQuat, DVec3};
use omnilife_engine::camera::Camera;
use omnilife_schemas::{
    Pose,
    points::PointCloud,
    posed_view::frames_of,
    records::{PosedFrame, Poses, Scene},
    scene_points::ScenePoints,
    store::{self, StoreError},
};
use serde::Deserialize;

/// Maximum number of poses of a path.
const MOST_ROWS: usize = 100_000;
/// Maximum size of a path's file, bytes.
const MOST_BYTES: u64 = 64 << 20;
/// First line of a path as CSV.
const CSV_HEADER: &str = "time_seconds,x,y,z,qw,qx,qy,qz";

/// Frame of a path.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct PlacedFrame {
    /// Number in the file, from 0 on.
    pub(super) number: usize,
    /// Presentation timestamp in seconds.
    pub(super) seconds: f64,
    /// Camera.
    pub(super) pose: Pose,
}

/// Frames with their times and poses, and the camera if the file has one.
pub(super) struct CameraPath {
    pub(super) camera: Option<Camera>,
    pub(super) frames: Vec<(f64, Option<Pose>)>,
    /// The scene; `None` for poses alone.
    scene: Option<Scene>,
    /// Points of poses alone, relative to their file.
    points: Option<String>,
}

impl CameraPath {
    /// Reads a `poses.json` or `scene.json`.
    ///
    /// # Errors
    /// When it cannot be read as either.
    pub(super) fn read(path: &Path) -> Result<Self, StoreError> {
        let text = store::read_text(path)?;
        let tag = serde_json::from_str::<Tag>(&text).ok();
        let schema = tag.and_then(|tag| tag.schema);
        if schema.is_some_and(|schema| store::is_read_as::<Scene>(&schema)) {
            let scene: Scene = store::read_record(path)?;
            let frames = scene.frames.iter();
            return Ok(Self {
                camera: Some(scene.camera),
                frames: frames
                    .map(|frame| (frame.time_seconds, frame.pose))
                    .collect(),
                scene: Some(scene),
                points: None,
            });
        }
        let poses: Poses = store::read_record(path)?;
        let frames = poses.frames.iter();
        Ok(Self {
            camera: poses.camera,
            frames: frames
                .map(|frame| (frame.time_seconds, Some(frame.pose)))
                .collect(),
            scene: None,
            points: poses.points,
        })
    }

    /// Returns the frames with usable poses.
    pub(super) fn posed(&self) -> Vec<PlacedFrame> {
        let frames = self.frames.iter().enumerate();
        frames
            .filter_map(|(number, &(seconds, pose))| {
                Some(PlacedFrame {
                    number,
                    seconds,
                    pose: pose.filter(Pose::is_valid)?,
                })
            })
            .collect()
    }

    /// Returns the numbers of the input views: those of a split, or all frames without one.
    ///
    /// # Errors
    /// When the split cannot be read, is that of another scene, or `path` is not a scene.
    pub(super) fn input_views(
        &self,
        path: &Path,
        split: Option<&Path>,
    ) -> Result<Vec<u32>, StoreError> {
        match (&self.scene, split) {
            (Some(scene), split) => frames_of(scene, split),
            (None, None) => Ok((0..self.frames.len() as u32).collect()),
            (None, Some(split)) => {
                let reason = format!("is a split of a scene, and {} is not one", path.display());
                Err(StoreError::malformed(split, reason))
            }
        }
    }

    /// Returns the points of the scene, dense ones where they lie beside the split; empty without any.
    ///
    /// # Errors
    /// When their file cannot be read.
    pub(super) fn points(
        &self,
        path: &Path,
        split: Option<&Path>,
    ) -> Result<Vec<DVec3>, StoreError> {
        let folder = path.parent().unwrap_or(Path::new("."));
        let beside = split.and_then(Path::parent).unwrap_or(folder);
        let file: Option<PathBuf> = match &self.scene {
            Some(scene) => ScenePoints::find(scene, folder, beside)?.map(|points| points.file),
            None => self.points.as_ref().map(|file| folder.join(file)),
        };
        let points = file.map(|file| PointCloud::read_ply(&file)).transpose()?;
        let positions = points.unwrap_or_default().positions.into_iter();
        Ok(positions.map(DVec3::from_array).collect())
    }
}

#[derive(Deserialize)]
struct Tag {
    schema: Option<String>,
}

/// Reads a path of poses with times: CSV of `time_seconds,x,y,z,qw,qx,qy,qz` (camera to world), a JSON list of the
/// frames of a `poses.json`, a `poses.json` or a `scene.json`. Returns the posed frames, one at least.
///
/// # Errors
/// When the file cannot be read as either, has no or too many poses, or one with numbers that make no pose.
pub fn read_path(path: &Path) -> Result<Vec<(f64, Pose)>, StoreError> {
    let bytes = store::read_limited(path, MOST_BYTES)?;
    let malformed = |reason: String| StoreError::malformed(path, reason);
    let text = std::str::from_utf8(&bytes).map_err(|_| malformed("is not UTF-8".to_owned()))?;
    let text = text.trim_start_matches('\u{feff}').trim_start();
    let rows: Vec<(f64, Pose)> = match text.chars().next() {
        Some('{') => {
            let frames = CameraPath::read(path)?.posed().into_iter();
            frames.map(|frame| (frame.seconds, frame.pose)).collect()
        }
        Some('[') => {
            let frames: Vec<PosedFrame> = serde_json::from_str(text).map_err(|error| {
                malformed(format!("must be a list of poses with times: {error}"))
            })?;
            let frames = frames.into_iter();
            frames
                .map(|frame| (frame.time_seconds, frame.pose))
                .collect()
        }
        _ => rows_of_csv(text).map_err(malformed)?,
    };
    if rows.is_empty() || rows.len() > MOST_ROWS {
        let reason = format!("has {} poses, expected 1 to {MOST_ROWS}", rows.len());
        return Err(malformed(reason));
    }
    let is_unusable = |(seconds, pose): &(f64, Pose)| !seconds.is_finite() || !pose.is_valid();
    if let Some(row) = rows.iter().position(is_unusable) {
        return Err(malformed(format!(
            "pose {row} must have finite numbers and a quaternion that is not zero"
        )));
    }
    let other = rows
        .iter()
        .enumerate()
        .find(|(_, (_, pose))| !pose.is_unit());
    match other {
        Some((row, (_, pose))) => Err(malformed(format!(
            "pose {row} must have a unit quaternion w, x, y, z, got {:?}",
            pose.rotation_wxyz
        ))),
        None => Ok(rows),
    }
}

fn rows_of_csv(text: &str) -> Result<Vec<(f64, Pose)>, String> {
    let mut lines = text.lines().enumerate();
    let header = lines.next().map(|(_, line)| line.trim());
    if header != Some(CSV_HEADER) {
        return Err(format!(
            "is neither JSON nor CSV that begins with {CSV_HEADER}"
        ));
    }
    let rows = lines.filter(|(_, line)| !line.trim().is_empty());
    rows.map(|(number, line)| {
        let values: Option<Vec<f64>> = line
            .split(',')
            .map(|word| word.trim().parse().ok())
            .collect();
        let values = values.and_then(|values| <[f64; 8]>::try_from(values).ok());
        let [seconds, x, y, z, qw, qx, qy, qz] =
            values.ok_or_else(|| format!("line {} must have eight numbers", number + 1))?;
        let pose = Pose::new(DQuat::from_xyzw(qx, qy, qz, qw), DVec3::new(x, y, z));
        Ok((seconds, pose))
    })
    .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn paths_of_both_formats_are_the_same_and_faults_name_their_line() {
        let folder = tempfile::tempdir().expect("a folder");
        let written = |name: &str, text: &str| {
            let path = folder.path().join(name);
            std::fs::write(&path, text).expect("written");
            read_path(&path)
        };
        let csv = "time_seconds,x,y,z,qw,qx,qy,qz\n0.5,1,2,3,1,0,0,0\n\n0.75,1,2,4,0,1,0,0\n";
        let json = r#"[
            {"time_seconds": 0.5, "pose": {"rotation_wxyz": [1, 0, 0, 0], "centre": [1, 2, 3]}},
            {"time_seconds": 0.75, "pose": {"rotation_wxyz": [0, 1, 0, 0], "centre": [1, 2, 4]}}]"#;
        let rows = written("a.csv", csv).expect("a path");
        assert_eq!(rows.len(), 2);
        assert_eq!(rows[1].1.centre, [1.0, 2.0, 4.0]);
        assert_eq!(written("a.json", json).expect("a path"), rows);
        for (text, reason) in [
            ("x,y\n1,2\n", "neither JSON nor CSV"),
            (
                "time_seconds,x,y,z,qw,qx,qy,qz\n0,1,2,3,1,0,0\n",
                "line 2 must have eight numbers",
            ),
            (
                "time_seconds,x,y,z,qw,qx,qy,qz\n0,1,2,3,0,0,0,0\n",
                "pose 0 must have finite numbers",
            ),
            (
                "time_seconds,x,y,z,qw,qx,qy,qz\n0,1,2,3,0,90,0,0\n",
                "pose 0 must have a unit quaternion",
            ),
            ("[]", "has 0 poses"),
        ] {
            let message = written("b", text).expect_err("refused").to_string();
            assert!(message.contains(reason), "{message}");
        }
    }
}
