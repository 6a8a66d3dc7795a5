//! What the way from a video to a model took, as the records of its stages tell it.

use std::path::Path;

use omnilife_schemas::{
    elapsed::Elapsed,
    layout::{DENSE_FOLDER, TRACKS_FILE},
    records::{PLANNING, PoseSource, RENDERING, Scene, StageTime, TRAINING, Tracks},
    scene_points::ScenePoints,
    stage::StagePlan,
    store::{self, StoreError},
};

use crate::{
    jobs::reconstruct::ReconstructRequest,
    methods::{Method, requirement::Requirement},
};

/// Stages that a scene's folder knows of: frames, and their poses.
const FRAMES: &str = "frames";
const POSES: &str = "poses";
/// The stage of a folder of dense points.
const DENSE: &str = "dense";

/// What the scene, its points and, where the method takes them, its tracks took.
pub(super) fn of_request(
    request: &ReconstructRequest,
    method: &Method,
    scene: &Scene,
) -> Result<Vec<StageTime>, StoreError> {
    let folder = |file: &Path| file.parent().unwrap_or(Path::new(".")).to_owned();
    let (scene_folder, split_folder) = (folder(&request.scene), folder(&request.split));
    let points = ScenePoints::find(scene, &scene_folder, &split_folder)?;
    let tracks: Option<Tracks> = method
        .needs(Requirement::Tracks)
        .then(|| store::read_record(&request.split.with_file_name(TRACKS_FILE)))
        .transpose()?;
    Ok(of_inputs(
        scene,
        [&scene_folder, &split_folder],
        points.as_ref(),
        tracks.as_ref(),
    ))
}

/// Stages of what a run is given, as far as their records are there. Poses that a user gave, and tracks that others
/// wrote, took what nobody knows.
fn of_inputs(
    scene: &Scene,
    [scene_folder, split_folder]: [&Path; 2],
    points: Option<&ScenePoints>,
    tracks: Option<&Tracks>,
) -> Vec<StageTime> {
    let recorded = |folder: &Path, stage: &str, method: Option<&str>| {
        Some(StageTime {
            stage: stage.to_owned(),
            method: method.map(str::to_owned),
            took: StagePlan::new(folder, stage).took()?,
        })
    };
    let poses = match scene.pose_source {
        PoseSource::Given { .. } | PoseSource::Matrices { .. } => "given",
        PoseSource::Program { .. } => "program",
        PoseSource::Registered { .. } => "registered",
        PoseSource::Sfm { .. } => "sfm",
    };
    let mut stages = Vec::new();
    stages.extend(recorded(scene_folder, FRAMES, None));
    stages.extend(recorded(scene_folder, POSES, Some(poses)));
    if points.is_some_and(|points| !points.dense_frames.is_empty()) {
        stages.extend(recorded(&split_folder.join(DENSE_FOLDER), DENSE, None));
    }
    let of_tracks = tracks.iter().flat_map(|tracks| &tracks.stages);
    stages.extend(of_tracks.map(|stage| StageTime {
        stage: stage.stage.clone(),
        method: Some(stage.method.clone()),
        took: stage.took,
    }));
    stages
}

/// Stages of a run itself, as far as it has them: planning is a part of its training time, and told apart here.
pub(super) fn of_run(planning: Elapsed, training: Elapsed, rendering: Elapsed) -> Vec<StageTime> {
    let left = |all: f64, part: f64| (all - part).max(0.0);
    let steps = Elapsed {
        wall_seconds: left(training.wall_seconds, planning.wall_seconds),
        cpu_seconds: training
            .cpu_seconds
            .map(|all| left(all, planning.cpu_seconds.unwrap_or(0.0))),
    };
    let stage = |(stage, took): (&str, Elapsed)| StageTime {
        stage: stage.to_owned(),
        method: None,
        took,
    };
    [
        (PLANNING, planning),
        (TRAINING, steps),
        (RENDERING, rendering),
    ]
    .map(stage)
    .into_iter()
    .filter(|stage| stage.took.wall_seconds > 0.0)
    .collect()
}

#[cfg(test)]
mod tests {
    use omnilife_schemas::{
        camera::ErpCamera,
        records::{PoseValidation, Scale, TrackStage, ValidationStatus},
    };

    use super::*;

    fn scene() -> Scene {
        Scene {
            id: "flight".to_owned(),
            camera: ErpCamera {
                width: 4,
                height: 2,
            }
            .into(),
            frames: Vec::new(),
            points: None,
            scale: Scale::Metres,
            pose_source: PoseSource::Sfm {
                tool: "pycolmap".to_owned(),
                configuration: "default".to_owned(),
                wall_seconds: 3,
            },
            validation: PoseValidation {
                status: ValidationStatus::Unchecked,
                registered_frames: 0,
                total_frames: 0,
                measures: [].into(),
                problems: Vec::new(),
            },
            published_split: None,
        }
    }

    #[test]
    fn stages_are_told_as_far_as_there_are_records() {
        let folder = tempfile::tempdir().expect("a folder");
        let took = Elapsed {
            wall_seconds: 31.5,
            cpu_seconds: Some(50.0),
        };
        let none: [&str; 0] = [];
        let finish = |folder: &Path, stage: &str, took: Elapsed| {
            StagePlan::new(folder, stage)
                .finish(none, took)
                .expect("finished");
        };
        finish(folder.path(), POSES, took);
        finish(&folder.path().join("split/dense"), DENSE, 80.0.into());
        let tracks = Tracks {
            scene: "flight".to_owned(),
            frames: Vec::new(),
            image_size: [4, 2],
            up: [0.0, 0.0, 1.0],
            metres_per_unit: 1.0,
            stages: vec![TrackStage {
                stage: "detector".to_owned(),
                method: "motion".to_owned(),
                reason: String::new(),
                took: 4.0.into(),
            }],
            detections: Vec::new(),
            tracks: Vec::new(),
            warnings: Vec::new(),
        };
        let split = folder.path().join("split");
        let stages = |dense_frames: Vec<u32>, tracks: Option<&Tracks>| {
            let points = ScenePoints {
                file: "points.ply".into(),
                name: "points.ply".to_owned(),
                dense_frames,
            };
            of_inputs(&scene(), [folder.path(), &split], Some(&points), tracks)
        };
        let names = |stages: &[StageTime]| -> Vec<String> {
            stages.iter().map(|stage| stage.stage.clone()).collect()
        };
        let all = stages(vec![0, 2], Some(&tracks));
        assert_eq!(names(&all), [POSES, DENSE, "detector"]);
        assert_eq!((all[0].method.as_deref(), all[0].took), (Some("sfm"), took));
        assert_eq!(all[2].method.as_deref(), Some("motion"));
        assert!(all.iter().all(|stage| !stage.is_of_run()));
        // Points that came with the poses, and a method without tracks.
        assert_eq!(names(&stages(Vec::new(), None)), [POSES]);
    }

    #[test]
    fn planning_is_no_part_of_the_steps() {
        let took = |wall_seconds: f64, cpu_seconds: f64| Elapsed {
            wall_seconds,
            cpu_seconds: Some(cpu_seconds),
        };
        let stages = of_run(took(2.0, 3.0), took(12.0, 21.0), 1.5.into());
        let expected = [took(2.0, 3.0), took(10.0, 18.0), 1.5.into()];
        assert_eq!(
            stages.iter().map(|stage| stage.took).collect::<Vec<_>>(),
            expected
        );
        assert!(stages.iter().all(StageTime::is_of_run));
    }
}
