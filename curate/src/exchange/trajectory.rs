//! Camera poses in the forms of other tools, for the frames of a scene.

use std::{
    collections::{BTreeMap, BTreeSet},
    path::Path,
};

use omnilife_schemas::{
    Pose,
    layout::SCENE_FILE,
    plain_text,
    records::{PoseConvention, Scene},
    store,
};

use super::{nerfstudio, stem};
use crate::{
    error::CurateError,
    poses::{colmap, poses_of_scene},
};

const TRANSFORMS_FILE: &str = "transforms.json";

/// Camera poses of a scene's frames.
#[derive(Debug, Clone, PartialEq)]
pub struct Trajectory {
    /// A pose for each frame of the scene, where there is one.
    pub poses: Vec<Option<Pose>>,
    /// Lines on problems: missing poses, times that look like another unit, poses of no frame, further models.
    pub notes: Vec<String>,
}

/// Reads the poses of a scene's frames, one entry for each of them.
///
/// Frames are matched by the names of their images, without folder and ending, in a `scene.json`, nerfstudio's
/// `transforms.json` and COLMAP's `images.txt`, and by their full names in a COLMAP model (a folder). They are matched
/// by time in a `poses.json` and in a TUM trajectory (`.txt` or `.tum`), and by order in an array of matrices
/// (`.npy`), whose direction is `convention`. A folder with a `scene.json` or a `transforms.json` stands for it.
///
/// # Errors
/// When the files are missing or malformed, fit no frame, or name two images alike; and when a convention is missing
/// for matrices or given for other poses.
pub fn read_trajectory(
    path: &Path,
    convention: Option<PoseConvention>,
    scene: &Scene,
) -> Result<Trajectory, CurateError> {
    for name in [SCENE_FILE, TRANSFORMS_FILE] {
        let file = path.join(name);
        if file.is_file() {
            return read_trajectory(&file, convention, scene);
        }
    }
    let named: Vec<(String, Pose)> = match path.file_name().and_then(|name| name.to_str()) {
        Some(SCENE_FILE) => {
            let other: Scene = store::read_record(path)?;
            let frames = other.frames.into_iter();
            frames
                .filter_map(|frame| Some((frame.image, frame.pose?)))
                .collect()
        }
        Some(TRANSFORMS_FILE) => nerfstudio::poses(path)?,
        Some("images.txt") => {
            let images = colmap::text_images(path)?.into_iter();
            images
                .map(|image| (image.name.clone(), image.pose()))
                .collect()
        }
        _ => {
            let (poses, notes) = poses_of_scene(path, convention, scene)?;
            return Ok(Trajectory { poses, notes });
        }
    };
    if convention.is_some() {
        let reason = "must be a .npy with matrices: other files take no convention";
        return Err(CurateError::input(path, reason));
    }
    by_name(path, &named, scene)
}

/// Matches poses to frames by the stems of their images.
fn by_name(
    path: &Path,
    named: &[(String, Pose)],
    scene: &Scene,
) -> Result<Trajectory, CurateError> {
    let mut poses = BTreeMap::new();
    for (image, pose) in named {
        if poses.insert(stem_of(image), *pose).is_some() {
            let reason = format!(
                "has two images named {}; frames are matched by name",
                stem_of(image)
            );
            return Err(CurateError::input(path, reason));
        }
    }
    let of_frames = scene
        .frames
        .iter()
        .map(|frame| poses.get(stem_of(&frame.image)).copied());
    let of_frames: Vec<Option<Pose>> = of_frames.collect();
    if of_frames.iter().all(Option::is_none) {
        let reason = format!(
            "fits no frame of {}: its images are named like {}, those of the scene like {}",
            scene.id,
            named.first().map_or("-", |(image, _)| image.as_str()),
            scene
                .frames
                .first()
                .map_or("-", |frame| frame.image.as_str()),
        );
        return Err(CurateError::input(path, reason));
    }
    let known: BTreeSet<&str> = scene
        .frames
        .iter()
        .map(|frame| stem_of(&frame.image))
        .collect();
    let strays: Vec<String> = named
        .iter()
        .filter(|(image, _)| !known.contains(stem_of(image)))
        .map(|(image, _)| image.clone())
        .collect();
    let note = (!strays.is_empty()).then(|| {
        format!(
            "{} of {} poses are of images of no frame: {}",
            strays.len(),
            named.len(),
            plain_text::first_of(&strays)
        )
    });
    Ok(Trajectory {
        poses: of_frames,
        notes: note.into_iter().collect(),
    })
}

/// Returns the name of an image without its folder and ending.
fn stem_of(image: &str) -> &str {
    stem(image.rsplit(['/', '\\']).next().unwrap_or(image))
}

#[cfg(test)]
mod tests {
    use std::{error::Error, fs};

    use glam::{DQuat, DVec3};
    use omnilife_schemas::{camera::ErpCamera, records::SceneFrame};

    use super::*;

    const SIDE: f64 = std::f64::consts::FRAC_1_SQRT_2;

    /// Returns a scene of three frames, whose camera walks along z and is turned by 90 degrees about y.
    fn scene() -> Scene {
        let rotation = DQuat::from_xyzw(0.0, SIDE, 0.0, SIDE);
        let frame = |number: u32| {
            SceneFrame::new(
                format!("frames/{number:06}.png"),
                0.5 * f64::from(number),
                Some(Pose::new(rotation, DVec3::new(1.0, 2.0, f64::from(number)))),
            )
        };
        Scene::given(
            "walk/seq-000",
            ErpCamera::new(64, 32),
            (0..3).map(frame).collect(),
        )
    }

    /// Checks that the poses of the first and the last frame are those of the scene, and that the middle has none.
    fn expect_ends(path: &Path) -> Result<(), Box<dyn Error>> {
        let scene = scene();
        let Trajectory { poses, .. } = read_trajectory(path, None, &scene)?;
        assert!(
            poses.len() == 3 && poses[1].is_none(),
            "{}: {poses:?}",
            path.display()
        );
        for number in [0, 2] {
            let (found, expected) = (poses[number], scene.frames[number].pose);
            let (found, expected) = (found.ok_or("no pose")?, expected.ok_or("no pose")?);
            let off = found.centre().distance(expected.centre());
            assert!(off < 1e-9, "{}: {off}", path.display());
            let turns = [found.rotation(), expected.rotation()].map(Option::unwrap_or_default);
            assert!(
                turns[0].angle_between(turns[1]) < 1e-6,
                "{}",
                path.display()
            );
        }
        Ok(())
    }

    #[test]
    fn every_form_of_poses_is_matched_to_the_frames() -> Result<(), Box<dyn Error>> {
        let folder = tempfile::tempdir()?;
        let file = |name: &str| folder.path().join(name);
        let line = |time: f64, z: f64| format!("{time} 1 2 {z} 0 {SIDE} 0 {SIDE}\n");
        // A pose between two frames belongs to neither.
        let text = format!("{}{}{}", line(0.01, 0.0), line(0.76, 9.0), line(1.0, 2.0));
        fs::write(file("walk.txt"), text)?;
        expect_ends(&file("walk.txt"))?;

        // World to camera: R = rotation by -90 degrees, t = -R c = (z, -2, -1).
        let image =
            |id: u32, z: u32| format!("{id} {SIDE} 0 -{SIDE} 0 {z} -2 -1 1 cam/{z:06}.jpg\n\n");
        fs::write(file("images.txt"), image(1, 0) + &image(2, 2))?;
        expect_ends(&file("images.txt"))?;

        // Camera to world with the y and z columns of the other sign.
        let frame = |z: u32| {
            serde_json::json!({
                "file_path": format!("images/{z:06}.jpg"),
                "transform_matrix": [
                    [0.0, 0.0, -1.0, 1.0], [0.0, -1.0, 0.0, 2.0], [-1.0, 0.0, 0.0, z], [0.0, 0.0, 0.0, 1.0],
                ],
            })
        };
        let transforms = serde_json::json!({ "frames": [frame(0), frame(2)] });
        fs::write(file("transforms.json"), transforms.to_string())?;
        expect_ends(&file("transforms.json"))?;
        expect_ends(folder.path())?;

        let mut other = scene();
        other.frames[1].pose = None;
        store::write_record(&file("scene.json"), &other)?;
        expect_ends(folder.path())?;
        // A frame more than the scene has.
        let extra = SceneFrame::new("000003.jpg".to_owned(), 1.5, other.frames[0].pose);
        other.frames.push(extra);
        store::write_record(&file("scene.json"), &other)?;
        let notes = read_trajectory(folder.path(), None, &scene())?.notes;
        assert_eq!(
            notes,
            ["1 of 3 poses are of images of no frame: 000003.jpg"]
        );
        // Milliseconds: one of them is the time of a frame all the same.
        let text: String = [0.0, 500.0, 1000.0]
            .map(|time| line(time, 0.002 * time))
            .concat();
        fs::write(file("ms.txt"), text)?;
        let notes = read_trajectory(&file("ms.txt"), None, &scene())?.notes;
        assert!(
            notes.iter().any(|note| note.contains("another unit")),
            "{notes:?}"
        );
        for (number, frame) in other.frames.iter_mut().enumerate() {
            frame.image = format!("other-{number}.jpg");
        }
        store::write_record(&file("scene.json"), &other)?;
        let refusal = read_trajectory(folder.path(), None, &scene());
        let reason = refusal.expect_err("no frame fits").to_string();
        assert!(reason.contains("fits no frame of walk/seq-000"), "{reason}");
        let convention = Some(PoseConvention::CameraToWorld);
        let refusal = read_trajectory(&file("images.txt"), convention, &scene());
        let reason = refusal.expect_err("no matrices").to_string();
        assert!(reason.contains("must be a .npy"), "{reason}");
        Ok(())
    }
}
