//! Scenes of a pinhole camera: every method trains on them or gives a reason.

use novel_views::novel_psnr;
use omnilife_reconstruct::{
    evidence::once::PilotOnce,
    methods::{self, METHODS, MethodKind},
    request::{BackendChoice, MethodRequest},
    scene::TrainingScene,
    seeds::sky::OpenSky,
    train::Session,
};
use omnilife_schemas::{
    camera::{Camera, PinholeCamera},
    progress::Silent,
};
use rand::RngExt;

use crate::support::{balls, novel_views};

/// Returns a pinhole's view of the balls. Its pixels are not square and its axis is off the middle.
fn scene() -> TrainingScene {
    let camera = Camera::Pinhole(PinholeCamera::new([64, 48], [40.0, 42.0], [30.5, 25.0]));
    let colour = |random: &mut rand_pcg::Pcg64Mcg, _| [0; 3].map(|_| random.random_range(0.1..0.9));
    balls::scene_with(camera, colour, 0.25, 0.0)
}

#[test]
fn every_trained_method_learns_a_pinhole_scene_or_refuses_it() {
    let _once = PilotOnce::begin();
    let scene = scene();
    for method in METHODS {
        let MethodKind::Trained { .. } = method.kind else {
            continue;
        };
        let request = |iterations| MethodRequest::new(iterations, 3);
        // Without distances panogs sweeps for them, and an object graph needs tracks.
        if let "odgs-published" | "panogs" | "object-graph" = method.id {
            let refused = method.prepare(&scene, &request(10), BackendChoice::Cpu);
            let message = refused.map(drop).unwrap_err().to_string();
            assert!(
                ["pinhole", "takes panoramas", "has no tracks"]
                    .iter()
                    .any(|reason| message.contains(reason)),
                "{message}"
            );
            continue;
        }
        let session = Session::without_files(&Silent);
        let [before, after] = [5, 120].map(|iterations| {
            let mut outcome = method
                .train(&scene, &request(iterations), &session)
                .unwrap();
            novel_psnr(&mut outcome, &scene)
        });
        assert!(
            after > before + 2.0,
            "{}: {before} then {after} dB",
            method.id
        );
    }
}

#[test]
fn a_pinhole_scene_comes_near_its_truth() {
    let scene = scene();
    let method = methods::find("odgs").unwrap();
    let session = Session::without_files(&Silent);
    let request = MethodRequest::new(300, 7);
    let mut outcome = method.train(&scene, &request, &session).unwrap();
    let psnr = novel_psnr(&mut outcome, &scene);
    assert!(psnr > 24.0, "{psnr} dB");
}

#[test]
fn no_sky_is_looked_for_where_no_view_looks() {
    let everywhere = OpenSky::of(&balls::scene(), 100_000);
    assert_eq!(everywhere.seen, everywhere.directions);
    let mut scene = scene();
    scene.points = Default::default();
    let sky = OpenSky::of(&scene, 100_000);
    // About the solid angle of the image, a sixth of the sphere, and no direction behind the camera.
    let share = sky.seen as f32 / sky.directions as f32;
    assert!((0.1..0.3).contains(&share), "{share}");
    assert_eq!(sky.open.len(), sky.seen);
    assert!(sky.open.iter().all(|direction| direction.z > 0.0));
}
