//! Paths that are refit to the images before training, against true ones.

use glam::DVec2;
use omnilife_engine::{gaussians::tracked::TrackedObject, model::Model};
use omnilife_reconstruct::{
    methods::{self, Prepared},
    request::{BackendChoice, MethodRequest},
    scene::TrainingScene,
};
use omnilife_schemas::{
    records::ComponentDecision,
    statistics::median,
    trajectory::{GroundAxes, ObjectPath},
};

use crate::support::flight;

/// Error of the given path, metres.
const SWAY: f64 = 0.5;

fn prepared<'a>(scene: &'a TrainingScene, request: &MethodRequest) -> Prepared<'a> {
    let method = methods::find("object-graph").unwrap();
    method.prepare(scene, request, BackendChoice::Cpu).unwrap()
}

/// Returns the path of the only object, world units.
fn path_of(scene: &TrainingScene, prepared: &mut Prepared<'_>) -> ObjectPath {
    let model: &Model = prepared.learner.gaussians().unwrap().unwrap();
    let tracked = model.parts[1].parameterization.tracked().unwrap();
    let object: &TrackedObject = &tracked.objects()[0];
    object.path.in_world(&scene.normalization)
}

fn decision<'a>(prepared: &'a Prepared<'_>, component: &str) -> &'a ComponentDecision {
    let mut plan = prepared.findings.plan.iter();
    plan.find(|one| one.component == component).unwrap()
}

/// Returns the median distance from the true path (metres) and the median difference of headings (radians) in the
/// input views. One offset and turn in the vehicle's own axes is free: no image tells its origin.
fn errors(scene: &TrainingScene, path: &ObjectPath) -> [f64; 2] {
    let (truth, axes) = (flight::true_path(), GroundAxes::new(glam::DVec3::Z));
    let offsets = scene.input_views.iter().map(|view| {
        let at = view.view.time_seconds;
        let (centre, heading) = path.at(at).unwrap();
        let (true_centre, true_heading) = truth.at(at).unwrap();
        let own = axes.rotation(true_heading).transpose() * (centre - true_centre);
        (own.truncate(), heading - true_heading)
    });
    let offsets: Vec<(DVec2, f64)> = offsets.collect();
    let middle = |part: fn(&(DVec2, f64)) -> f64| {
        median(&offsets.iter().map(part).collect::<Vec<f64>>()).unwrap()
    };
    let shared = DVec2::new(middle(|one| one.0.x), middle(|one| one.0.y));
    let turned = middle(|one| one.1);
    let distances: Vec<f64> = offsets.iter().map(|one| one.0.distance(shared)).collect();
    let turns: Vec<f64> = offsets.iter().map(|one| (one.1 - turned).abs()).collect();
    [median(&distances).unwrap(), median(&turns).unwrap()]
}

/// Returns a request for refit paths.
fn aligning() -> MethodRequest {
    MethodRequest {
        with: vec!["path-alignment".to_owned()],
        ..MethodRequest::new(250, 3)
    }
}

#[test]
fn a_path_beside_its_vehicle_is_brought_to_it() {
    let scene = flight::scene(flight::path_beside(SWAY));
    let request = aligning();
    let mut aligned = prepared(&scene, &request);
    assert!(decision(&aligned, "path-alignment").used);
    let given = errors(&scene, &flight::path_beside(SWAY));
    let path = path_of(&scene, &mut aligned);
    let found = errors(&scene, &path);
    assert!(given[0] > 0.25 && given[1] > 0.06, "{given:?}");
    assert!(
        found[0] < 0.3 * given[0] && found[1] < 0.5 * given[1],
        "{found:?} of {given:?}"
    );
    assert_eq!(path.fault(), None);

    let mut left = prepared(&scene, &MethodRequest::new(250, 3));
    assert!(!decision(&left, "path-alignment").used);
    let kept = errors(&scene, &path_of(&scene, &mut left));
    assert!((kept[0] - given[0]).abs() < 1e-6, "{kept:?} of {given:?}");
}

#[test]
fn a_true_path_stays_true() {
    let scene = flight::scene(flight::true_path());
    let mut aligned = prepared(&scene, &aligning());
    let path = path_of(&scene, &mut aligned);
    let [place, heading] = errors(&scene, &path);
    assert!(
        place < 0.05 && heading < 0.01,
        "{place} m, {heading} radians"
    );
}

#[test]
fn a_path_whose_vehicle_few_views_show_stays() {
    let given = flight::path_beside(SWAY);
    let mut scene = flight::scene(given.clone());
    for view in scene.input_views.iter_mut().step_by(2) {
        view.pixels.fill(128);
    }
    let mut kept = prepared(&scene, &aligning());
    let line = decision(&kept, "path-alignment");
    assert!(
        !line.used && line.reason.contains("0 of 1 paths") && line.reason.contains(" views"),
        "{line:?}"
    );
    let [place, _] = errors(&scene, &path_of(&scene, &mut kept));
    let [expected, _] = errors(&scene, &given);
    assert!((place - expected).abs() < 1e-6, "{place} {expected}");
}

/// Sum of the steps of a run, metres.
fn reach(scene: &TrainingScene, prepared: &Prepared<'_>, iterations: f64) -> f64 {
    let rate = &prepared.configuration["learning_rates"]["object_poses"];
    let [begin, end] = ["begin", "end"].map(|name| rate[name].as_f64().unwrap());
    iterations * (begin - end) / (begin / end).ln() / scene.normalization.scale
}

#[test]
fn steps_of_paths_reach_as_far_as_these_are_off() {
    let request = |others: &[&str]| MethodRequest {
        with: [&["object-poses"], others]
            .concat()
            .iter()
            .map(|&name| name.to_owned())
            .collect(),
        ..MethodRequest::new(250, 3)
    };
    let way = |length: f64, others: &[&str]| {
        let mut scene = flight::scene(flight::path_beside(SWAY));
        for track in scene.tracks.iter_mut().flat_map(|all| &mut all.tracks) {
            track.dimensions[0] = length;
        }
        let prepared = prepared(&scene, &request(others));
        assert!(decision(&prepared, "object-poses").used);
        reach(&scene, &prepared, 250.0)
    };
    // Twice what is left of the error after the refit.
    let refit = way(4.5, &["path-alignment"]);
    assert!(refit > 0.0 && refit < 0.3, "{refit}");
    // Twice a tenth of the vehicle's length where nothing is measured, and never for more than half a metre.
    let unmeasured = [4.5, 9.0].map(|length| way(length, &[]));
    assert!((unmeasured[0] - 0.9).abs() < 1e-3, "{unmeasured:?}");
    assert!((unmeasured[1] - 1.0).abs() < 1e-3, "{unmeasured:?}");
}
