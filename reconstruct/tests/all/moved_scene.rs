//! A scene whose world lies far from the origin and is rotated, through the files of its run: every result keeps
//! its place.

use std::path::{Path, PathBuf};

use glam::{DQuat, DVec3, Vec3, dvec3};
use omnilife_engine::training_view::TrainingView;
use omnilife_reconstruct::{
    jobs::{
        camera_words::CameraWords,
        export::{self, ExportRequest, levels::Level},
        reconstruct::{ReconstructRequest, reconstruct},
        render::{RenderCamera, RenderRequest, render_poses},
    },
    request::{BackendChoice, MethodRequest},
};
use omnilife_schemas::{
    Pose, RgbImage, Similarity,
    points::PointCloud,
    progress::Silent,
    records::{Protocol, RunRecord, Scale, Scene, SceneFrame, ScoredViews, SplitRule},
    split_rules, store,
};
use tempfile::TempDir;

use crate::support::balls;

/// Too few for density control, which draws positions along the axes of the world.
const ITERATIONS: u64 = 20;

/// Compared views of a run: one input view, one novel view.
const VIEWS: [&str; 2] = ["input/000002.png", "novel/000004.png"];

/// Rotation and offset of the scene's world.
struct World {
    turn: DQuat,
    offset: DVec3,
}

const AS_MADE: World = World {
    turn: DQuat::IDENTITY,
    offset: DVec3::ZERO,
};

/// Returns a world with a quarter rotation, which maps axes to axes: steps of the optimizer, taken along each,
/// stay the same.
fn far_away() -> World {
    World {
        turn: DQuat::from_rotation_x(std::f64::consts::FRAC_PI_2),
        offset: dvec3(5e5, 5e6, 0.0),
    }
}

/// A trained scene and its files.
struct Trained {
    folder: TempDir,
    record: RunRecord,
}

impl Trained {
    fn file(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn prediction(&self, view: &str) -> PathBuf {
        self.file("run/predictions").join(view)
    }

    /// Returns the folder of the scene's views, rendered from a model.
    fn rendered(&self, model: &Path, out: &str) -> PathBuf {
        let request = RenderRequest {
            model: model.to_owned(),
            axes: None,
            poses: self.file("scene.json"),
            cameras: CameraWords::default(),
            size: None,
            camera: RenderCamera::OfPoses,
            layer: "all".to_owned(),
            cube_faces: None,
            out: self.file(out),
        };
        render_poses(&request, &Silent).unwrap();
        request.out
    }

    /// Returns the complete `.splat` of a model.
    fn exported(&self, gaussians: PathBuf, out: &str) -> PathBuf {
        let request = ExportRequest {
            gaussians,
            format: "splat".to_owned(),
            levels: vec![Level::parse("full").unwrap()],
            with_page: false,
            up: None,
            time_seconds: None,
            moments: None,
            out: self.file(out),
        };
        export::export(&request, &Silent).unwrap();
        request.out.join("full.splat")
    }
}

fn trained(world: &World, change: impl Fn(&mut Scene)) -> Trained {
    let folder = tempfile::tempdir().unwrap();
    let made = balls::scene();
    let in_world = |place: Vec3| world.turn * place.as_dvec3() + world.offset;
    let points = PointCloud {
        positions: made
            .points
            .positions
            .iter()
            .map(|&position| in_world(Vec3::from_array(position)).to_array())
            .collect(),
        colours: made.points.colours.clone(),
    };
    points.write_ply(&folder.path().join("points.ply")).unwrap();
    let mut views: Vec<&TrainingView> = made.input_views.iter().chain(&made.novel_views).collect();
    views.sort_by_key(|view| view.frame);
    let frame = |view: &&TrainingView| {
        let image = format!("{:06}.png", view.frame);
        let [width, height] = balls::CAMERA.size();
        RgbImage::from_rgb8(width, height, &view.pixels)
            .write_png(&folder.path().join(&image))
            .unwrap();
        let to_world = DQuat::from_mat3(&view.view.rotation.transpose().as_dmat3());
        let pose = Pose::new(world.turn * to_world, in_world(view.view.centre));
        SceneFrame::new(image, view.view.time_seconds, Some(pose))
    };
    let mut scene = Scene {
        scale: Scale::Metres,
        points: Some("points.ply".to_owned()),
        ..Scene::given("balls", balls::CAMERA, views.iter().map(frame).collect())
    };
    change(&mut scene);
    let protocol = Protocol::new(
        "fifth",
        SplitRule::EveryNth {
            period: 5,
            offset: 4,
        },
        ScoredViews::Novel,
    );
    let split = split_rules::split(&scene, &protocol).unwrap();
    let [scene_file, split_file] =
        ["scene.json", "split.json"].map(|name| folder.path().join(name));
    store::write_record(&scene_file, &scene).unwrap();
    store::write_record(&split_file, &split).unwrap();
    let request = ReconstructRequest {
        scene: scene_file,
        split: split_file,
        method: "odgs".to_owned(),
        settings: MethodRequest {
            // Larger steps would amplify the last bits.
            without: vec!["aids".to_owned()],
            ..MethodRequest::new(ITERATIONS, 7)
        },
        backend: BackendChoice::Cpu,
        checkpoint_every: 0,
        trace_views: Some(1),
        tensorboard: None,
        out: folder.path().join("run"),
    };
    let record = reconstruct(&request, &Silent).unwrap();
    Trained { folder, record }
}

/// Returns the PSNR between two images, dB; infinite for equal ones.
fn psnr(one: &Path, other: &Path) -> f64 {
    let [one, other] = [one, other].map(|path| RgbImage::read(path).unwrap());
    let values = one.data.iter().zip(&other.data);
    let squares: f64 = values.map(|(a, b)| f64::from(a - b).powi(2)).sum();
    -10.0 * (squares / one.data.len() as f64).log10()
}

fn file_name(view: &str) -> &str {
    view.rsplit('/').next().unwrap()
}

#[test]
fn a_scene_far_from_the_origin_is_learnt_kept_and_exported_as_near_it() {
    let near = trained(&AS_MADE, |_| {});
    let far = trained(&far_away(), |_| {});
    for view in VIEWS {
        let learnt = psnr(&near.prediction(view), &far.prediction(view));
        assert!(learnt > 50.0, "{view}: {learnt} dB");
    }
    for trained in [&near, &far] {
        for model in ["run", "run/gaussians.ply"] {
            let out = trained.rendered(&trained.file(model), "views");
            for view in VIEWS {
                let kept = psnr(&trained.prediction(view), &out.join(file_name(view)));
                // A PLY alone has no near limit.
                let limit = if model == "run" { 60.0 } else { 50.0 };
                assert!(kept > limit, "{model}, {view}: {kept} dB");
            }
        }
    }
    for model in ["run", "run/gaussians.ply"] {
        let exported = [&near, &far].map(|trained| {
            let splat = trained.exported(trained.file(model), "asset");
            let out = trained.rendered(&splat, "of-asset");
            let views = VIEWS.iter();
            let scores =
                views.map(|view| psnr(&trained.prediction(view), &out.join(file_name(view))));
            scores.fold(f64::INFINITY, f64::min)
        });
        let [near, far] = exported;
        // Bytes of rotations round differently in other axes.
        assert!(far > near - 1.5, "{model}: {near} and {far} dB");
    }
}

#[test]
fn a_camera_far_out_is_named_and_does_not_give_the_extent() {
    let wrong = trained(&AS_MADE, |scene| {
        let pose = scene.frames[6].pose.as_mut().unwrap();
        pose.centre = [3e4, -2e4, 0.0];
    });
    let is_told = |line: &&String| line.ends_with("frames 6");
    assert_eq!(wrong.record.warnings.iter().filter(is_told).count(), 1);
    let inputs = balls::scene().input_views;
    let right = inputs.iter().filter(|view| view.frame != 6);
    let centres: Vec<DVec3> = right.map(|view| view.view.centre.as_dvec3()).collect();
    let expected = Similarity::from_cameras(&centres).unwrap();
    let found = wrong.record.normalization;
    assert!((found.scale / expected.scale - 1.0).abs() < 1e-9);
    let offsets = [found.offset, expected.offset].map(DVec3::from_array);
    assert!(offsets[0].distance(offsets[1]) < 1e-9);
    let sound = trained(&AS_MADE, |_| {});
    let mut others = sound.record.warnings.iter();
    assert!(others.all(|line| !line.contains("median camera")));
}
