//! Times of the stages before a run, from their records.

use std::path::Path;

use omnilife_schemas::{
    layout::{DENSE_FOLDER, TRACKS_FILE},
    records::{PoseSource, Scene, StageTime, Tracks},
    scene_points::ScenePoints,
    stage::StagePlan,
    store::{self, StoreError},
};

use crate::jobs::reconstruct::ReconstructRequest;

/// Stages in a scene's folder: frames, and their poses.
const FRAMES: &str = "frames";
const POSES: &str = "poses";
/// The stage of a folder of dense points.
const DENSE: &str = "dense";

/// Returns the times of the scene, its points and, where the run used them, its tracks.
pub(super) fn of_request(
    request: &ReconstructRequest,
    scene: &Scene,
    used_tracks: bool,
) -> Result<Vec<StageTime>, StoreError> {
    let folder = |file: &Path| file.parent().unwrap_or(Path::new(".")).to_owned();
    let (scene_folder, split_folder) = (folder(&request.scene), folder(&request.split));
    let points = ScenePoints::find(scene, &scene_folder, &split_folder)?;
    let tracks: Option<Tracks> = used_tracks
        .then(|| store::read_record(&request.split.with_file_name(TRACKS_FILE)))
        .transpose()?;
    Ok(of_inputs(
        scene,
        [&scene_folder, &split_folder],
        points.as_ref(),
        tracks.as_ref(),
    ))
}

/// Returns the stages of a run's inputs that have a record: given poses and tracks of other programs have none.
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

#[cfg(test)]
mod tests {
    use omnilife_schemas::{
        camera::ErpCamera,
        elapsed::Elapsed,
        records::{PoseValidation, Scale, TrackStage},
    };

    use super::*;

    fn scene() -> Scene {
        Scene {
            id: "flight".to_owned(),
            camera: ErpCamera::new(4, 2).into(),
            frames: Vec::new(),
            points: None,
            scale: Scale::Metres,
            pose_source: PoseSource::Sfm {
                tool: "pycolmap".to_owned(),
                configuration: "default".to_owned(),
                wall_seconds: 3,
            },
            validation: PoseValidation::unchecked(0, 0),
            published_split: None,
            objects: [].into(),
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
}
