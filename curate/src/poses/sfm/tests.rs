#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

use std::{fs, os::unix::fs::PermissionsExt};

use omnilife_schemas::{
    progress::Silent,
    records::{FrameEntry, Probe, VideoProjection},
};

use omnilife_schemas::{Classified, ErrorKind};

use super::*;

fn sequence(frames: usize) -> Sequence {
    let entry = |index: usize| FrameEntry {
        file: format!("frames/{index:06}.png"),
        time_seconds: index as f64 * 0.1,
        capture: None,
    };
    sequence_of((0..frames).map(entry).collect())
}

fn nothing_ignored(sequence: &Sequence) -> IgnoredPixels {
    IgnoredPixels::find(None, &FrameList::of_sequence(sequence)).unwrap()
}

/// Returns a sequence of these frames, 64 pixels wide.
fn sequence_of(entries: Vec<FrameEntry>) -> Sequence {
    Sequence {
        probe: Probe {
            frames_per_second: 10.0,
            duration_seconds: 1.0,
            ..Probe::of_size([64, 32])
        },
        ..Sequence::of_panoramas("walk/seq-000", [64, 32], entries)
    }
}

/// Returns an interpreter that ignores the Python script it is given and runs these shell lines instead; `$OUT` is
/// where the model is expected.
fn interpreter(folder: &Path, lines: &str) -> SfmInstallation {
    let python = folder.join("python");
    let script = format!(
        "#!/bin/sh\nwhile [ $# -gt 0 ]; do\n  if [ \"$1\" = --out ]; then OUT=$2; fi\n  shift\ndone\n{lines}\n"
    );
    fs::write(&python, script).unwrap();
    fs::set_permissions(&python, fs::Permissions::from_mode(0o755)).unwrap();
    SfmInstallation {
        python,
        version: "0.0.0".to_owned(),
    }
}

fn report(folder: &Path) -> SfmReport {
    store::read_record(&folder.join("sfm/attempts.json")).unwrap()
}

#[test]
fn every_failed_attempt_is_recorded_and_named() {
    let temp = tempfile::tempdir().unwrap();
    let folder = temp.path().join("seq-000");
    fs::create_dir(&folder).unwrap();
    let settings = SfmSettings::default();
    // Frames without a model are to blame themselves; a killed or broken program is not their fault.
    for (lines, reason, blame) in [
        (
            "printf '\\377\\n'; echo failed no features; exit 4",
            "no features",
            ErrorKind::User,
        ),
        (
            "echo Check failed: rows >&2; kill -ABRT $$",
            "Check failed: rows",
            ErrorKind::Internal,
        ),
        (
            "echo failed half; kill -KILL $$",
            "signal: 9",
            ErrorKind::Internal,
        ),
        ("echo models 1; exit 0", "cameras.txt", ErrorKind::Internal),
        (
            "echo models many; exit 0",
            "models many",
            ErrorKind::Internal,
        ),
    ] {
        let python = interpreter(temp.path(), lines);
        let error = run_with(
            &python,
            &folder,
            &sequence(3),
            (&settings, &nothing_ignored(&sequence(3))),
            &Silent,
        )
        .unwrap_err();
        assert_eq!(error.error_kind(), blame, "{lines}");
        let message = error.to_string();
        assert!(
            message.contains(reason) && message.contains("walk/seq-000"),
            "{message}"
        );
        assert!(!message.contains('\n'), "{message}");
        let report = report(&folder);
        assert_eq!(report.attempts.len(), FALLBACK_CONFIGURATIONS.len());
        assert_eq!(report.chosen, None);
        assert!(
            report
                .attempts
                .iter()
                .all(|attempt| attempt.failure.is_some())
        );
        assert!(!folder.join("sfm/sparse").exists());
    }
}

/// A model that misses limits is used if there is no better one, and is marked unstable.
#[test]
fn an_unstable_model_is_taken_with_its_problems() {
    let temp = tempfile::tempdir().unwrap();
    let folder = temp.path().join("seq-000");
    fs::create_dir(&folder).unwrap();
    let python = interpreter(
        temp.path(),
        "mkdir -p $OUT/sparse; cd $OUT/sparse; echo models 2\n\
         echo '1 EQUIRECTANGULAR 64 32 64 32' > cameras.txt\n\
         printf '1 0 0 0 1 0 0 0 1 000000.png\\n\\n2 0 0 0 1 1 0 0 1 000002.png\\n\\n' > images.txt\n\
         echo '7 1 2 3 10 20 30 0.1 1 0 2 0' > points3D.txt",
    );
    let posed = run_with(
        &python,
        &folder,
        &sequence(3),
        (&SfmSettings::default(), &nothing_ignored(&sequence(3))),
        &Silent,
    )
    .unwrap();
    assert_eq!(posed.validation.status, ValidationStatus::Unstable);
    assert_eq!(posed.validation.registered_frames, 2);
    assert_eq!(posed.validation.total_frames, 3);
    assert!(!posed.validation.problems.is_empty());
    assert!(posed.poses[0].is_some() && posed.poses[1].is_none() && posed.poses[2].is_some());
    assert_eq!(report(&folder).chosen, Some(0));
    assert_eq!(report(&folder).attempts[0].models, 2);
    assert!(folder.join("sfm/sparse/images.txt").is_file());
    // The cameras were upside down: levelling turns the world, and the point with it.
    let pose = posed.poses[0].unwrap();
    let up = pose.rotation().unwrap() * glam::DVec3::NEG_Y;
    assert!((up - level::UP).length() < 1e-12);
    assert_eq!(posed.points.unwrap().colours, [[10, 20, 30]]);
}

/// Everything that may change the poses changes the stage's inputs.
#[test]
fn the_stage_depends_on_masks_by_name_and_on_the_program() {
    let temp = tempfile::tempdir().unwrap();
    let masks = temp.path().join("masks");
    fs::create_dir(&masks).unwrap();
    fs::write(masks.join("000000.png"), "mask").unwrap();
    let settings = SfmSettings {
        masks: Some(masks.clone()),
        ..SfmSettings::default()
    };
    let inputs = |settings: &SfmSettings, version: &str| {
        add_inputs(StagePlan::new(temp.path(), "poses"), settings, version)
            .unwrap()
            .inputs_sha256()
    };
    let before = inputs(&settings, "4.2.1");
    let seeded = SfmSettings {
        seed: 1,
        ..settings.clone()
    };
    let threaded = SfmSettings {
        threads: Some(1),
        ..settings.clone()
    };
    assert_eq!(before, inputs(&threaded, "4.2.1"));
    assert_ne!(before, inputs(&seeded, "4.2.1"));
    assert_ne!(before, inputs(&settings, "4.3.0"));
    fs::rename(masks.join("000000.png"), masks.join("000001.png")).unwrap();
    assert_ne!(before, inputs(&settings, "4.2.1"));
    // Moved as a whole, they are the same masks.
    fs::rename(masks.join("000001.png"), masks.join("000000.png")).unwrap();
    let moved = temp.path().join("elsewhere");
    fs::rename(&masks, &moved).unwrap();
    let settings = SfmSettings {
        masks: Some(moved),
        ..settings
    };
    assert_eq!(before, inputs(&settings, "4.2.1"));
}

/// Perspective frames come without intrinsics: COLMAP finds them, and the lens is taken out.
#[test]
fn perspective_frames_are_posed_with_a_lens() {
    let temp = tempfile::tempdir().unwrap();
    let folder = temp.path().join("seq-000");
    fs::create_dir(&folder).unwrap();
    let mut sequence = sequence(3);
    sequence.projection.projection = VideoProjection::Rectilinear;
    assert!(sequence.is_pinhole());
    let lines = "mkdir -p $OUT/sparse; echo \"$ALL\" > $OUT/../../asked.txt; \
        echo '1 SIMPLE_RADIAL 64 32 50 32 16 -0.1' > $OUT/sparse/cameras.txt; \
        printf '1 1 0 0 0 0 0 0 1 000000.png\\n\\n2 1 0 0 0 -1 0 0 1 000001.png\\n\\n' > $OUT/sparse/images.txt; \
        echo '3 0.5 1 2 255 0 9 0.2 1 0 2 1' > $OUT/sparse/points3D.txt; echo models 1";
    let python = interpreter(temp.path(), lines);
    let script = fs::read_to_string(&python.python).unwrap();
    fs::write(&python.python, script.replacen('\n', "\nALL=\"$*\"\n", 1)).unwrap();
    let posed = run_with(
        &python,
        &folder,
        &sequence,
        (&SfmSettings::default(), &nothing_ignored(&sequence)),
        &Silent,
    )
    .unwrap();
    let asked = fs::read_to_string(folder.join("sfm/asked.txt")).unwrap();
    assert!(asked.contains("--camera-model SIMPLE_RADIAL"), "{asked}");
    let lens = posed.camera.lens().unwrap();
    assert_eq!(lens.distortion.radial[..2], [-0.1, 0.0]);
    let Camera::Pinhole(camera) = posed.camera.camera() else {
        panic!("{:?}", posed.camera);
    };
    assert!(camera.fx < lens.camera.fx, "{camera:?}");
    assert!(posed.validation.measures["distortion_pixels"] > 0.25);
    assert_eq!(posed.validation.measures["focal_length_pixels"], camera.fx);
}

/// Returns the error or the configurations that ran on three frames, with these lines as the program.
fn configurations_of(
    lines: &str,
    sequence: &Sequence,
    settings: &SfmSettings,
) -> Result<(Vec<String>, Option<usize>), CurateError> {
    let temp = tempfile::tempdir().unwrap();
    let folder = temp.path().join("seq-000");
    fs::create_dir(&folder).unwrap();
    let python = interpreter(temp.path(), lines);
    let ignored = nothing_ignored(sequence);
    run_with(&python, &folder, sequence, (settings, &ignored), &Silent)?;
    let report = report(&folder);
    let attempts = report.attempts.into_iter();
    Ok((
        attempts.map(|attempt| attempt.configuration).collect(),
        report.chosen,
    ))
}

/// A model of three frames of which the last is at 2, by the road of cubes, or at 3; and a track that fits 2.
const THREE_FRAMES: &str = "mkdir -p $OUT/sparse\n\
    case $OUT in *mixed) AT=-2;; *) AT=-3;; esac\n\
    echo '1 EQUIRECTANGULAR 64 32 64 32' > $OUT/sparse/cameras.txt\n\
    printf '1 1 0 0 0 0 0 0 1 000000.png\\n\\n2 1 0 0 0 -1 0 0 1 000001.png\\n\\n' > $OUT/sparse/images.txt\n\
    printf \"3 1 0 0 0 $AT 0 0 1 000002.png\\n\\n\" >> $OUT/sparse/images.txt\n\
    echo '7 0 0 4 10 20 30 0.1 1 0 2 0' > $OUT/sparse/points3D.txt\n\
    echo '000000.png 0 0 4 000001.png -1 0 4 000002.png -2 0 4' > $OUT/held_out.txt\n\
    echo models 1";

#[test]
fn a_comparison_takes_every_road_and_the_one_that_predicts_held_out_matches() {
    let compared = SfmSettings {
        compare: true,
        ..SfmSettings::default()
    };
    let (ran, chosen) = configurations_of(THREE_FRAMES, &sequence(3), &compared).unwrap();
    assert_eq!(ran, ["global", "mixed", "faces"]);
    assert_eq!(chosen, Some(1));
}

#[test]
fn a_road_has_its_own_configurations_and_needs_panoramas() {
    let faces = SfmSettings {
        road: Road::Faces,
        ..SfmSettings::default()
    };
    let (ran, chosen) = configurations_of(THREE_FRAMES, &sequence(3), &faces).unwrap();
    assert_eq!((ran, chosen), (vec!["faces".to_owned()], Some(0)));
    let mut perspective = sequence(3);
    perspective.projection.projection = VideoProjection::Rectilinear;
    let compared = SfmSettings {
        compare: true,
        ..SfmSettings::default()
    };
    for settings in [faces, compared] {
        let error = configurations_of(THREE_FRAMES, &perspective, &settings).unwrap_err();
        assert_eq!(error.error_kind(), ErrorKind::User);
    }
}
