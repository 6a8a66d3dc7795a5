//! Training as a whole, on views rendered from Gaussians that are known.
#![expect(
    clippy::unwrap_used,
    reason = "a failure to build a test scene is a failed test"
)]

use glam::{DQuat, DVec3};
use omnilife_reconstruct::{
    camera::View,
    gaussians::{
        InstantGaussians,
        static_gaussians::{self, InitialGaussians},
    },
    methods::{self, MethodOutcome, MethodRequest},
    render::{RenderSettings, Renderer},
    scene::{SceneView, TrainingScene},
};
use omnilife_schemas::{Pose, Similarity, camera::ErpCamera, points::PointCloud, progress::Silent};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

const CAMERA: ErpCamera = ErpCamera {
    width: 96,
    height: 48,
};

/// Opaque balls all around a camera that walks past them; every fifth view is a novel one.
fn scene() -> TrainingScene {
    let mut random = Pcg64Mcg::seed_from_u64(21);
    let mut truth = InitialGaussians::default();
    let mut points = PointCloud::default();
    for direction in 0..900 {
        let y = 1.0 - (f64::from(direction) + 0.5) / 450.0;
        let angle = 2.399_963 * f64::from(direction);
        let rho = (1.0 - y * y).sqrt();
        let distance = random.random_range(4.0..6.0);
        let position = DVec3::new(rho * angle.cos(), y, rho * angle.sin()) * distance;
        let colour: [f32; 3] = [0; 3].map(|_| random.random_range(0.1..0.9));
        truth.positions.push(position.as_vec3().to_array());
        truth.scales.push(0.25);
        truth.colours.push(colour);
        truth.opacities.push(0.95);
        let jitter = DVec3::from_array([0; 3].map(|_| random.random_range(-0.1..0.1)));
        points
            .positions
            .push((position + jitter).as_vec3().to_array());
        points.colours.push([128; 3]);
    }
    let mut instant = InstantGaussians::default();
    static_gaussians::instantiate(&static_gaussians::table(&truth), &mut instant);
    let mut renderer = Renderer::new(RenderSettings::new(0.01));
    let normalization = Similarity {
        offset: [0.0; 3],
        scale: 1.0,
    };
    let (mut input_views, mut novel_views) = (Vec::new(), Vec::new());
    for frame in 0..15_u32 {
        let along = f64::from(frame) / 7.0 - 1.0;
        let turn = DQuat::from_rotation_y(0.3 * along);
        let pose = Pose {
            rotation_wxyz: [turn.w, turn.x, turn.y, turn.z],
            centre: [0.2 * along, 0.0, along],
        };
        let view = View::new(CAMERA, &pose, &normalization, f64::from(frame)).unwrap();
        let pixels = renderer.image(&view, &instant).to_rgb8();
        let views = if frame % 5 == 4 {
            &mut novel_views
        } else {
            &mut input_views
        };
        views.push(SceneView {
            frame,
            view,
            pixels,
        });
    }
    TrainingScene {
        id: "balls".to_owned(),
        camera: CAMERA,
        input_views,
        novel_views,
        normalization,
        is_normalized_by_points: false,
        points,
    }
}

fn train(scene: &TrainingScene, iterations: u64) -> MethodOutcome {
    let request = MethodRequest {
        iterations,
        budget_seconds: None,
        seed: 7,
        maximum_gaussians: None,
    };
    (methods::find("odgs").unwrap().train)(scene, &request, &Silent).unwrap()
}

#[test]
fn grey_points_become_the_scene() {
    let scene = scene();
    let outcome = train(&scene, 300);
    let trace = &outcome.trained.trace;
    let (first, last) = (trace.first().unwrap(), trace.last().unwrap());
    let (before, after) = (first.novel_psnr_db.unwrap(), last.novel_psnr_db.unwrap());
    assert!(
        after > 24.0 && after > before + 4.0,
        "novel views: {before} then {after} dB"
    );
    assert!(last.train_loss < 0.5 * first.train_loss);
    assert!(
        trace
            .windows(2)
            .all(|pair| pair[0].wall_seconds <= pair[1].wall_seconds)
    );
    assert_eq!(last.iteration, 300);
    assert_eq!(outcome.trained.refused_gradients, 0);
    // Points in every direction: there is no sky.
    assert!(!outcome.plan[0].used, "{:?}", outcome.plan[0]);
}

#[test]
fn training_does_not_depend_on_the_number_of_threads() {
    let scene = scene();
    let tables = [1, 3].map(|threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads);
        pool.build()
            .unwrap()
            .install(|| train(&scene, 40).trained.table)
    });
    assert_eq!(tables[0].len(), tables[1].len());
    for (one, three) in tables[0].arrays.iter().zip(&tables[1].arrays) {
        assert!(one.values == three.values, "{} differ", one.name);
    }
}

#[test]
fn a_scene_without_points_gets_a_shell_of_sky() {
    let mut scene = scene();
    scene.points = PointCloud::default();
    let outcome = train(&scene, 60);
    assert!(outcome.plan[0].used, "{:?}", outcome.plan[0]);
    let psnr = outcome.trained.trace.last().unwrap().novel_psnr_db.unwrap();
    assert!(psnr > 14.0, "novel views at {psnr} dB");
}

#[test]
fn a_budget_ends_training() {
    let request = MethodRequest {
        iterations: 1_000_000,
        budget_seconds: Some(0.5),
        seed: 7,
        maximum_gaussians: None,
    };
    let scene = scene();
    let outcome = (methods::find("odgs").unwrap().train)(&scene, &request, &Silent).unwrap();
    assert!(outcome.trained.stopped_by_budget);
    assert!(outcome.trained.iterations < 1_000_000);
    assert_eq!(
        outcome.trained.trace.last().unwrap().iteration,
        outcome.trained.iterations
    );
}
