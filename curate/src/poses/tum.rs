//! Trajectories in the format of the TUM RGB-D benchmark
//! (<https://cvg.cit.tum.de/data/datasets/rgbd-dataset/file_formats>).
//!
//! A line has `timestamp tx ty tz qx qy qz qw`: seconds, the camera's centre, and its rotation to the world. The axes of
//! the camera are x right, y down, z forward. Lines that begin with # are comments. The unit of the world is not stated.

use std::path::Path;

use glam::{DQuat, DVec3};
use omnilife_schemas::{
    Pose,
    records::{PosedFrame, Poses, Scale},
    store::{self, StoreError},
};

/// Returns true for the name of a trajectory: one that ends in `.txt` or `.tum`.
pub(super) fn is_trajectory(path: &Path) -> bool {
    let extension = path.extension().unwrap_or_default();
    !path.is_dir()
        && ["txt", "tum"]
            .iter()
            .any(|known| extension.eq_ignore_ascii_case(known))
}

/// Reads a trajectory, in the order of its lines.
///
/// # Errors
/// When the file is missing, or a line has no eight finite numbers or no unit quaternion. Names the line.
pub(super) fn read(path: &Path) -> Result<Poses, StoreError> {
    let text = store::read_text(path)?;
    let mut frames = Vec::new();
    for (index, line) in text.lines().enumerate() {
        let line = line.trim();
        if line.is_empty() || line.starts_with('#') {
            continue;
        }
        let malformed = |reason: &str| {
            let number = index.saturating_add(1);
            StoreError::malformed(path, format!("line {number} {reason}"))
        };
        let mut frame = posed_frame(line)
            .ok_or_else(|| malformed("must be `timestamp tx ty tz qx qy qz qw`"))?;
        let rotation = frame.pose.rotation().filter(|_| frame.pose.is_unit());
        let rotation = rotation.ok_or_else(|| {
            malformed("must end in a unit quaternion qx qy qz qw, got one of another length")
        })?;
        frame.pose = Pose::new(rotation, frame.pose.centre());
        frames.push(frame);
    }
    Ok(Poses::new(Scale::Arbitrary, None, frames))
}

fn posed_frame(line: &str) -> Option<PosedFrame> {
    let numbers: Vec<f64> = line
        .split_whitespace()
        .map(|word| word.parse::<f64>().ok().filter(|number| number.is_finite()))
        .collect::<Option<_>>()?;
    let [time_seconds, tx, ty, tz, qx, qy, qz, qw] = <[f64; 8]>::try_from(numbers).ok()?;
    let rotation = DQuat::from_xyzw(qx, qy, qz, qw);
    let pose = Pose::new(rotation, DVec3::new(tx, ty, tz));
    Some(PosedFrame::new(time_seconds, pose))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_are_poses_and_others_are_named() -> std::io::Result<()> {
        let folder = tempfile::tempdir()?;
        let path = folder.path().join("walk.TXT");
        assert!(is_trajectory(&path) && !is_trajectory(folder.path()));
        std::fs::write(
            &path,
            "# time x y z\n\n1.5 1 2 3 0 0 0 1\n2.5 1 2 4 0 1.004 0 0\n",
        )?;
        let read_frames = || read(&path).map(|poses| poses.frames);
        let frames = read_frames().expect("two poses");
        assert_eq!((frames.len(), frames[0].time_seconds), (2, 1.5));
        assert_eq!(frames[0].pose.centre, [1.0, 2.0, 3.0]);
        assert_eq!(frames[0].pose.rotation_wxyz, [1.0, 0.0, 0.0, 0.0]);
        for broken in ["1 2 3", "1 1 2 3 0 0 0 1 9", "1 1 2 nan 0 0 0 1"] {
            std::fs::write(&path, format!("# a\n{broken}\n"))?;
            let reason = read_frames().expect_err("broken").to_string();
            assert!(reason.contains("line 2 must be"), "{reason}");
        }
        // The last: rotation before place.
        for broken in ["1 1 2 3 0 0 0 0", "1 1 2 3 0 0 0 2", "1 0 0 0 1 4 5 6"] {
            std::fs::write(&path, format!("# a\n{broken}\n"))?;
            let reason = read_frames().expect_err("no unit quaternion").to_string();
            assert!(reason.contains("line 2 must end in a unit"), "{reason}");
        }
        Ok(())
    }
}
