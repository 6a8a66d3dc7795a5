//! Folders as other programs leave them, made by small writers.

use super::*;

/// A folder of another program.
pub(crate) struct Foreign {
    folder: TempDir,
    size: [u32; 2],
}

impl Foreign {
    /// Images of one grey, `20 n` for the frame with the number n, by their names below the folder.
    pub(crate) fn new(size: [u32; 2], images: &[(&str, u8)]) -> Self {
        let foreign = Self {
            folder: tempfile::tempdir().unwrap(),
            size,
        };
        for (name, number) in images {
            foreign.paint(name, |_, _| [20 * number; 3]);
        }
        foreign
    }

    pub(crate) fn path(&self) -> &Path {
        self.folder.path()
    }

    /// Writes an image by its colour at (column, row).
    pub(crate) fn paint(&self, name: &str, colour: impl Fn(u32, u32) -> [u8; 3]) {
        let [width, height] = self.size;
        let path = self.path().join("in").join(name);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        let pixels = (0..width * height).flat_map(|at| colour(at % width, at / width));
        let pixels: Vec<u8> = pixels.collect();
        rgb::write_rgb8_png(&path, width as usize, height as usize, &pixels).unwrap();
    }

    pub(crate) fn write(&self, name: &str, content: impl AsRef<[u8]>) {
        let path = self.path().join("in").join(name);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(path, content).unwrap();
    }

    /// Imports the folder, or one below it, at ten frames per second.
    pub(crate) fn import_from(&self, below: &str, format: &str) -> Result<Scene, CurateError> {
        store::remove(&self.path().join("out")).unwrap();
        import(&ImportRequest {
            frames_per_second: Some(10.0),
            ..ImportRequest::new(
                &self.path().join("in").join(below),
                format,
                "foreign",
                &self.path().join("out"),
            )
        })
    }

    pub(crate) fn import(&self, format: &str) -> Result<Scene, CurateError> {
        self.import_from("", format)
    }

    /// The line of a refusal.
    pub(crate) fn refusal(&self, format: &str) -> String {
        let line = self.import(format).unwrap_err().to_string();
        assert!(!line.contains('\n'), "{line}");
        line
    }

    /// Frame numbers of a scene's images, in its order, each with its time in hundredths of a second.
    pub(crate) fn shown(&self, scene: &Scene) -> Vec<(u8, i64)> {
        let frames = scene.frames.iter();
        frames
            .map(|frame| {
                let image = image::open(self.path().join("out").join(&frame.image)).unwrap();
                let grey = image.to_rgb8().get_pixel(0, 0).0[0];
                (grey / 20, (100.0 * frame.time_seconds).round() as i64)
            })
            .collect()
    }
}

/// A pose of its own for every number: camera to world.
pub(crate) fn pose(number: u8) -> Pose {
    let n = f64::from(number);
    let turn = DQuat::from_euler(glam::EulerRot::YXZ, 0.7 * n - 1.0, 0.3 - 0.11 * n, 0.05 * n);
    Pose::new(turn, dvec3(0.4 * n - 1.3, 0.2 + 0.01 * n * n, 2.0 - n))
}

/// The poses of frames are those of these numbers, to 1e-9.
pub(crate) fn assert_poses(scene: &Scene, numbers: &[u8]) {
    assert_eq!(scene.frames.len(), numbers.len());
    for (frame, &number) in scene.frames.iter().zip(numbers) {
        let (found, expected) = (frame.pose.unwrap(), pose(number));
        assert!(
            found.centre().distance(expected.centre()) < 1e-9,
            "{number}: {found:?}"
        );
        let turned = |pose: Pose, axis: DVec3| pose.rotation().unwrap() * axis;
        for axis in [DVec3::X, DVec3::Y, DVec3::Z] {
            let apart = turned(found, axis).distance(turned(expected, axis));
            assert!(apart < 1e-9, "{number}: {apart}");
        }
    }
}

/// Returns true where a line of the record speaks of something.
pub(crate) fn notes(scene: &Scene, words: &str) -> bool {
    let mut problems = scene.validation.problems.iter();
    problems.any(|problem| problem.contains(words))
}

/// An image of a COLMAP model: id, camera, name, and the number of its pose.
pub(crate) type ColmapRow<'a> = (u32, u32, &'a str, u8);

/// Quaternion (w, x, y, z) and translation, world to camera.
fn colmap_pose(number: u8) -> [f64; 7] {
    let pose = pose(number);
    let turn = pose.rotation().unwrap().inverse();
    let shift = -(turn * pose.centre());
    [turn.w, turn.x, turn.y, turn.z, shift.x, shift.y, shift.z]
}

/// `images.txt` and `points3D.txt` as COLMAP writes them.
pub(crate) fn write_colmap_text(
    foreign: &Foreign,
    model: &str,
    cameras: &str,
    rows: &[ColmapRow<'_>],
) {
    let images: String = rows
        .iter()
        .map(|(id, camera, name, number)| {
            let pose = colmap_pose(*number)
                .map(|value| value.to_string())
                .join(" ");
            format!("{id} {pose} {camera} {name}\n10.5 7.25 -1 3 4 9\n")
        })
        .collect();
    let head = "# Image list with two lines of data per image:\n#   IMAGE_ID, QW, ...\n";
    foreign.write(&format!("{model}/images.txt"), format!("{head}{images}"));
    foreign.write(
        &format!("{model}/cameras.txt"),
        format!("# Camera list with one line of data per camera:\n{cameras}"),
    );
    foreign.write(
        &format!("{model}/points3D.txt"),
        "# 3D point list\n9 0.5 -1.25 3 250 3 7 0.4 1 1\n",
    );
}

/// The same model, binary: cameras by id, number of the model, size and parameters.
pub(crate) fn write_colmap_binary(
    foreign: &Foreign,
    model: &str,
    cameras: &[(u32, i32, [u64; 2], &[f64])],
    rows: &[ColmapRow<'_>],
) {
    let mut bytes = (cameras.len() as u64).to_le_bytes().to_vec();
    for (id, number, size, parameters) in cameras {
        bytes.extend(id.to_le_bytes());
        bytes.extend(number.to_le_bytes());
        bytes.extend(size.iter().flat_map(|side| side.to_le_bytes()));
        bytes.extend(parameters.iter().flat_map(|value| value.to_le_bytes()));
    }
    foreign.write(&format!("{model}/cameras.bin"), bytes);
    let mut bytes = (rows.len() as u64).to_le_bytes().to_vec();
    for (id, camera, name, number) in rows {
        bytes.extend(id.to_le_bytes());
        bytes.extend(
            colmap_pose(*number)
                .iter()
                .flat_map(|value| value.to_le_bytes()),
        );
        bytes.extend(camera.to_le_bytes());
        bytes.extend(name.bytes().chain([0]));
        bytes.extend(0_u64.to_le_bytes());
    }
    foreign.write(&format!("{model}/images.bin"), bytes);
    foreign.write(&format!("{model}/points3D.bin"), 0_u64.to_le_bytes());
}

/// Rows of a `transform_matrix` of nerfstudio: camera to world, the camera with y up and z back.
pub(crate) fn transform_matrix(number: u8) -> Value {
    let pose = pose(number);
    let turn = glam::DMat3::from_quat(pose.rotation().unwrap());
    let (x, y, z, c) = (turn.x_axis, -turn.y_axis, -turn.z_axis, pose.centre());
    let row = |n: usize| [x[n], y[n], z[n], c[n]];
    serde_json::json!([row(0), row(1), row(2), [0.0, 0.0, 0.0, 1.0]])
}
