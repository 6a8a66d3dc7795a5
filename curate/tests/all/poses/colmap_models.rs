//! Models of COLMAP as given poses.

use super::*;

fn write_model(folder: &Path, images: &str) {
    fs::create_dir_all(folder).unwrap();
    fs::write(
        folder.join("cameras.txt"),
        "# cameras\n1 EQUIRECTANGULAR 256 128 256 128\n",
    )
    .unwrap();
    fs::write(folder.join("images.txt"), images).unwrap();
    fs::write(
        folder.join("points3D.txt"),
        "3 0.5 1 2 255 0 9 0.2 1 0 2 1\n",
    )
    .unwrap();
}

/// The numbers were worked out by hand: a half turn about y puts the centre at (1, -2, 3).
#[test]
fn colmap_models_are_read_by_their_format() {
    let temp = tempfile::tempdir().unwrap();
    let folder = temp.path().join("model");
    write_model(
        &folder,
        "# images\n1 0 0 1 0 1 2 3 1 some/000000.png\n10 20 3 1.5 2.5 -1\n2 1 0 0 0 -1 0 0 1 000001.png\n\n",
    );
    let model = ColmapModel::read(&folder).unwrap();
    let first = &model.images[&1];
    assert_eq!(first.name, "some/000000.png");
    assert!((first.centre - DVec3::new(1.0, -2.0, 3.0)).length() < 1e-12);
    assert!((first.rotation * DVec3::Z - DVec3::NEG_Z).length() < 1e-12);
    assert_eq!(first.observations, [(glam::DVec2::new(10.0, 20.0), 3)]);
    assert!(model.images[&2].observations.is_empty());
    assert_eq!(model.images[&2].centre, DVec3::X);
    assert_eq!(model.points[&3].track, [1, 2]);
    assert_eq!(model.cloud().colours, [[255, 0, 9]]);

    let sequence = sequence_of_twenty(temp.path());
    let scene = pose_sequence(&sequence, &PoseRequest::Given(folder.clone()), &Silent).unwrap();
    assert_eq!(
        scene
            .frames
            .iter()
            .filter(|frame| frame.pose.is_some())
            .count(),
        2
    );
    assert_eq!(scene.frames[1].pose.unwrap().centre, [1.0, 0.0, 0.0]);

    write_model(
        &folder,
        "1 1 0 0 0 0 0 0 1 left/000000.png\n\n2 1 0 0 0 -1 0 0 1 right/000000.png\n\n",
    );
    let error = pose_sequence(&sequence, &PoseRequest::Given(folder.clone()), &Silent).unwrap_err();
    assert_eq!(error.error_kind(), ErrorKind::User);
    assert!(
        error.to_string().contains("two images named 000000.png"),
        "{error}"
    );

    for (images, reason) in [
        ("1 0 0 1 0 1 2 3 1\n\n", "line 1: no image name"),
        ("1 0 0 2 0 1 2 3 1 a.png\n\n", "must be a unit quaternion"),
        ("1 0 0 1 0 1 2 nan 1 a.png\n\n", "line 1: no image pose"),
        ("1 0 0 1 0 1 2 3 1 a.png\n5 5\n", "line 2: features"),
        (
            "1 0 0 1 0 1 2 3 1 a.png\n\n1 0 0 1 0 1 2 3 1 b.png\n\n",
            "line 3: a second image has the id 1",
        ),
    ] {
        write_model(&folder, images);
        let message = ColmapModel::read(&folder).unwrap_err().to_string();
        assert!(message.contains(reason), "{message}");
    }
    for (points, reason) in [
        (
            "3 1e39 1 2 255 0 9 0.2 1 0\n",
            "line 1: the point is too far",
        ),
        (
            "3 1 1 2 255 0 9 0.2 1 0\n3 0 1 2 255 0 9 0.2 1 0\n",
            "line 2: a second point has the id 3",
        ),
    ] {
        write_model(&folder, "1 0 0 1 0 1 2 3 1 a.png\n\n");
        fs::write(folder.join("points3D.txt"), points).unwrap();
        let message = ColmapModel::read(&folder).unwrap_err().to_string();
        assert!(message.contains(reason), "{message}");
    }
    write_model(&folder, "1 0 0 1 0 1 2 3 1 a.png\n\n");
    fs::write(folder.join("points3D.txt"), "").unwrap();
    fs::write(
        folder.join("cameras.txt"),
        "1 ORTHOPHOTO 256 128 9 9 9 9 0 0 0 0\n",
    )
    .unwrap();
    let message = ColmapModel::read(&folder).unwrap_err().to_string();
    assert!(
        message.contains("ORTHOPHOTO; known are EQUIRECTANGULAR, SIMPLE_PINHOLE"),
        "{message}"
    );
}

/// FFmpeg numbers images from 1, frames are numbered from 0: each would get the pose of the one before it.
#[test]
fn images_of_a_model_that_are_no_frames_are_told() {
    let temp = tempfile::tempdir().unwrap();
    let folder = temp.path().join("model");
    let sequence = sequence_of_twenty(temp.path());
    let model = |names: &[String]| {
        let lines = names.iter().zip(1..).map(|(name, id)| {
            let place = -id;
            format!("{id} 1 0 0 0 {place} 0 0 1 {name}\n\n")
        });
        write_model(&folder, &lines.collect::<String>());
        let notes = Notes::default();
        let posed = pose_sequence(&sequence, &PoseRequest::Given(folder.clone()), &notes);
        (posed, notes.take())
    };
    let numbered = |first: u32, ending: &str| -> Vec<String> {
        (first..first + 20)
            .map(|number| format!("{number:06}.{ending}"))
            .collect()
    };
    let is_told = |line: &String| line.contains("are no frames");
    let (posed, notes) = model(&numbered(0, "png"));
    assert!(!posed.unwrap().validation.problems.iter().any(is_told));
    assert!(!notes.iter().any(is_told), "{notes:?}");
    let (posed, notes) = model(&numbered(1, "png"));
    let problems = posed.unwrap().validation.problems;
    for lines in [&problems, &notes] {
        let line = lines.iter().find(|line| is_told(line)).unwrap();
        for part in ["1 of 20", "(000020.png)", "000000.png to 000019.png"] {
            assert!(line.contains(part), "{line}");
        }
    }
    // Without a single frame, the refusal has the names of both.
    let (posed, _) = model(&numbered(0, "jpg"));
    let message = posed.unwrap_err().to_string();
    for part in ["fits no frame", "000000.jpg", "000000.png"] {
        assert!(message.contains(part), "{message}");
    }
}
