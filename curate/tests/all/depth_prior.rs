//! Depth priors of frames: brought in on the project's grid, refused in one line.

use std::{
    fs,
    path::{Path, PathBuf},
};

use image::{ImageBuffer, Luma};
use omnilife_curate::{
    CurateSettings, GivenDepth, GivenPrior, GivenTruth, PoseRequest, curate_video,
    pose_sequence_with,
};
use omnilife_schemas::{
    Pose, npy,
    progress::Silent,
    records::{DistanceConvention, DistanceGrid, PosedFrame, Poses, Scale, Scene},
    store,
    testing::Notes,
};
use support::erp_clip;
use tempfile::TempDir;

use crate::support;

/// Returns a sequence in a temporary folder, the request for poses of all of its frames, and an empty folder for
/// distances.
fn sequence() -> (TempDir, PathBuf, PoseRequest, PathBuf) {
    let temp = tempfile::tempdir().unwrap();
    let folder = temp.path();
    let video = erp_clip(folder, "walk.mp4", &[1], 12, 10);
    let settings = CurateSettings {
        enforce: false,
        ..CurateSettings::default()
    };
    curate_video(&video, &folder.join("walk"), &settings, &Silent).unwrap();
    let poses = Poses::new(
        Scale::Metres,
        None,
        (0..12)
            .map(|frame| {
                PosedFrame::new(
                    0.1 * f64::from(frame),
                    Pose {
                        rotation_wxyz: [1.0, 0.0, 0.0, 0.0],
                        centre: [f64::from(frame), 0.0, 0.0],
                    },
                )
            })
            .collect(),
    );
    let path = folder.join("poses.json");
    store::write_record(&path, &poses).unwrap();
    let (sequence, distances) = (folder.join("walk/seq-000"), folder.join("depth"));
    fs::create_dir(&distances).unwrap();
    (temp, sequence, PoseRequest::Given(path), distances)
}

fn prior(folder: &Path, grid: DistanceGrid) -> GivenTruth {
    GivenTruth {
        prior: Some(GivenPrior {
            folder: folder.to_owned(),
            unit: 0.5,
            grid,
            convention: DistanceConvention::Ray,
            source: "some network".to_owned(),
        }),
        ..GivenTruth::default()
    }
}

#[test]
fn distances_are_brought_to_the_projects_grid_and_some_may_be_missing() {
    let (_temp, sequence, request, folder) = sequence();
    let ramp = |column: usize| 100.0 + column as f32;
    let values: Vec<f32> = (0..32 * 16).map(|at| ramp(at % 32)).collect();
    for frame in [0, 2] {
        npy::write_f32(&folder.join(format!("{frame:06}.npy")), &[16, 32], &values).unwrap();
    }
    let notes = Notes::default();
    let pose = |grid| -> Scene {
        pose_sequence_with(&sequence, &request, &prior(&folder, grid), &notes).unwrap()
    };
    let scene = pose(DistanceGrid::HalfPixel);
    let lines = notes.take().join("\n");
    assert!(
        lines.contains("10 of 12 frames have no distances"),
        "{lines}"
    );
    assert!(scene.frames[1].depth_prior.is_none() && scene.frames[0].depth.is_none());
    let found = scene.frames[2].depth_prior.clone().unwrap();
    assert_eq!((found.width, found.height, found.unit), (32, 16, 1.0));
    assert_eq!(found.source, "some network");
    let staged = npy::read(&sequence.join(&found.file)).unwrap().values;
    assert!((staged[5] - 0.5 * 105.0).abs() < 1e-6);
    // The middle of the first of 32 columns is 31/64 of a column right of the first end.
    let scene = pose(DistanceGrid::Endpoint);
    let file = scene.frames[0].depth_prior.clone().unwrap().file;
    let staged = npy::read(&sequence.join(file)).unwrap().values;
    assert!(
        (staged[0] - 0.5 * (100.0 + 31.0 / 64.0)).abs() < 0.01,
        "{}",
        staged[0]
    );
    // Without them the scene has none, and the files of earlier ones are gone.
    let none = pose_sequence_with(&sequence, &request, &GivenTruth::default(), &notes).unwrap();
    assert!(none.frames.iter().all(|frame| frame.depth_prior.is_none()));
    assert!(!sequence.join("depth-prior/000000.npy").exists());
}

/// Programs write the largest value for the sky, where 0 is expected.
#[test]
fn distances_at_the_end_of_sixteen_bits_are_reported() {
    let (_temp, sequence, request, folder) = sequence();
    let write = |frame: u32, sky_rows: u32| {
        let image = ImageBuffer::from_fn(32, 16, |_, y| {
            Luma([if y < sky_rows { u16::MAX } else { 900 }])
        });
        image.save(folder.join(format!("{frame:06}.png"))).unwrap();
    };
    (0..12).for_each(|frame| write(frame, 0));
    let both = GivenTruth {
        depth: Some(GivenDepth {
            folder: folder.clone(),
            unit: 0.5,
        }),
        ..prior(&folder, DistanceGrid::HalfPixel)
    };
    let notes = Notes::default();
    let reported = || {
        pose_sequence_with(&sequence, &request, &both, &notes).unwrap();
        let mut lines = notes.take();
        lines.retain(|line| line.contains("65535"));
        lines
    };
    assert_eq!(reported(), [""; 0]);
    write(3, 4);
    let lines = reported();
    assert_eq!(lines.len(), 2, "true ones and estimated ones");
    for line in lines {
        assert!(
            line.starts_with("1 file of distances") && line.contains("32767.5"),
            "{line}"
        );
        assert!(line.contains("000003.png"), "{line}");
    }
}

#[test]
fn distances_that_cannot_be_used_are_refused_in_one_line_and_leave_nothing() {
    let (_temp, sequence, request, folder) = sequence();
    let refusal = |given: &GivenTruth| {
        let refused = pose_sequence_with(&sequence, &request, given, &Silent);
        let message = refused.map(drop).unwrap_err().to_string();
        assert!(
            !message.contains('\n') && !sequence.join("scene.json").exists(),
            "{message}"
        );
        message
    };
    let given = prior(&folder, DistanceGrid::HalfPixel);
    assert!(refusal(&given).contains("has no distances of any of the 12 frames"));
    let file = folder.join("000001.npy");
    for (shape, values, expected) in [
        (
            [16, 20],
            vec![1.0; 320],
            "000001.npy: is 20x16, of another shape than the frames",
        ),
        (
            [2, 4],
            vec![0.0; 8],
            "000001.npy: no distance in it is known",
        ),
        (
            [2, 4],
            vec![-1.0; 8],
            "000001.npy: the distance at row 0, column 0 is -1",
        ),
        (
            [2, 4],
            vec![f32::NAN; 8],
            "000001.npy: the distance at row 0, column 0 is NaN",
        ),
    ] {
        npy::write_f32(&file, &shape, &values).unwrap();
        let message = refusal(&given);
        assert!(message.contains(expected), "{message}");
    }
    fs::write(&file, b"no array").unwrap();
    assert!(refusal(&given).contains("000001.npy: not a NumPy array"));
    let mut without_unit = given.clone();
    if let Some(prior) = &mut without_unit.prior {
        prior.unit = 0.0;
    }
    assert!(refusal(&without_unit).contains("must be positive, got 0"));
    let missing = prior(&folder.join("nowhere"), DistanceGrid::HalfPixel);
    assert!(refusal(&missing).contains("nowhere"));
}
