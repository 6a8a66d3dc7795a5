//! PanoGS in a room in closed form: first samples, decisions, moving parameters, and refusals.

use std::{fs, path::Path};

use crate::{
    depth::room,
    support::trained::{arrays_with_growth, files},
};
use omnilife_engine::{
    camera::rays::Rays,
    gaussians::static_gaussians::{LOG_SCALES, OPACITY_LOGITS, POSITIONS, QUATERNIONS},
    training_view::TrainingView,
};
use omnilife_reconstruct::{
    methods::{self, Prepared},
    options::Options,
    request::{BackendChoice, MethodRequest, PlanChoice},
    scene::{TrainingScene, depth::PriorFile},
    train::Session,
};
use omnilife_schemas::{
    Similarity,
    camera::ErpCamera,
    npy,
    points::PointCloud,
    progress::Silent,
    records::{DepthPrior, DistanceConvention, Scale, SurfaceFaults},
};

pub(crate) const CAMERA: ErpCamera = ErpCamera::new(128, 64);
/// Normalized units per metre.
pub(crate) const UNIT: f64 = 0.25;

/// Returns the room with files of distances in metres, after `change`.
pub(crate) fn scene(
    folder: &Path,
    count: usize,
    change: impl Fn(usize, usize, f32) -> f32,
) -> TrainingScene {
    let normalization = Similarity::new([0.0; 3], UNIT);
    let (mut input_views, mut depth_priors) = (Vec::new(), Vec::new());
    for number in 0..count {
        let view = room::view_of(number, CAMERA.into(), &normalization);
        let path = folder.join(format!("{number}.npy"));
        let metres = view.distances.values.iter().enumerate();
        let metres: Vec<f32> = metres
            .map(|(pixel, distance)| change(number, pixel, distance / UNIT as f32))
            .collect();
        npy::write_f32(&path, &[64, 128], &metres).unwrap();
        depth_priors.push(Some(PriorFile {
            path,
            prior: DepthPrior {
                file: format!("{number}.npy"),
                unit: 1.0,
                width: 128,
                height: 64,
                convention: DistanceConvention::Ray,
                source: "closed form".to_owned(),
            },
        }));
        input_views.push(TrainingView {
            frame: number as u32,
            view: view.view,
            pixels: view.pixels,
            mask: None,
            ignored: None,
        });
    }
    TrainingScene {
        scale: Scale::Metres,
        depth_priors,
        ..TrainingScene::new("room", CAMERA.into(), input_views, normalization)
    }
}

pub(crate) fn as_given(_: usize, _: usize, metres: f32) -> f32 {
    metres
}

pub(crate) fn prepared<'a>(scene: &'a TrainingScene, request: &MethodRequest) -> Prepared<'a> {
    let method = methods::find("panogs").unwrap();
    method.prepare(scene, request, BackendChoice::Cpu).unwrap()
}

fn refusal(scene: &TrainingScene) -> String {
    let method = methods::find("panogs").unwrap();
    let request = MethodRequest::new(10, 0);
    let refused = method.prepare(scene, &request, BackendChoice::Cpu);
    let message = refused.map(drop).unwrap_err().to_string();
    assert!(!message.contains('\n'));
    message
}

pub(crate) fn is_used(prepared: &Prepared<'_>, component: &str) -> bool {
    let mut plan = prepared.findings.plan.iter();
    let decision = plan.find(|decision| decision.component == component);
    decision.unwrap_or_else(|| panic!("no {component}")).used
}

#[test]
fn exact_distances_of_several_views_need_a_choice_and_nothing_else() {
    let folder = tempfile::tempdir().unwrap();
    let scene = scene(folder.path(), 5, as_given);
    let prepared = prepared(&scene, &MethodRequest::new(10, 0));
    for (component, expected) in [
        ("pole-thinning", true),
        ("redundant-samples", true),
        ("warm-start", true),
        ("shape-refinement", true),
        ("centre-refinement", true),
        ("scaffold", false),
        ("depth-scale", false),
        ("depth-refinement", false),
    ] {
        assert_eq!(is_used(&prepared, component), expected, "{component}");
    }
    let size = prepared.learner.size();
    let kept = size.primitives as f64 / (5.0 * 128.0 * 64.0);
    assert!((0.05..0.5).contains(&kept), "{kept}");
}

#[test]
fn steps_grow_in_short_schedules_and_are_the_published_ones_on_request() {
    let folder = tempfile::tempdir().unwrap();
    let scene = scene(folder.path(), 2, as_given);
    let request = |without: &[&str]| MethodRequest {
        with: vec!["centre-refinement".to_owned()],
        without: without.iter().map(|&name| name.to_owned()).collect(),
        ..MethodRequest::new(300, 0)
    };
    let short = prepared(&scene, &request(&[]));
    assert!(is_used(&short, "short-schedule"));
    let arrays = arrays_with_growth(&short);
    assert!(arrays.contains(&"positions") && arrays.contains(&"log_scales"));
    let published = prepared(&scene, &request(&["aids"]));
    assert!(!is_used(&published, "short-schedule"));
    assert!(published.configuration["short_schedule"].is_null());
    assert!(!short.configuration["short_schedule"].is_null());
}

#[test]
fn one_panorama_needs_no_scale_no_choice_and_no_scaffold() {
    let folder = tempfile::tempdir().unwrap();
    let scene = scene(folder.path(), 1, as_given);
    let full = MethodRequest {
        plan: PlanChoice::Full,
        ..MethodRequest::new(10, 0)
    };
    let prepared = prepared(&scene, &full);
    for component in ["depth-scale", "redundant-samples", "scaffold"] {
        assert!(!is_used(&prepared, component), "{component}");
    }
    assert!(is_used(&prepared, "centre-refinement"));
}

#[test]
fn views_of_different_scales_are_brought_together() {
    let folder = tempfile::tempdir().unwrap();
    let scene = scene(folder.path(), 5, |view, _, metres| {
        metres * (1.0 + 0.01 * view as f32)
    });
    let prepared = prepared(&scene, &MethodRequest::new(10, 0));
    assert!(is_used(&prepared, "depth-scale"));
}

#[test]
fn the_record_of_the_lift_accounts_for_every_pixel() {
    let folder = tempfile::tempdir().unwrap();
    let mut scene = scene(folder.path(), 4, |view, pixel, metres| {
        if pixel < 300 {
            0.0
        } else {
            metres * (1.0 + 0.01 * view as f32)
        }
    });
    scene.input_views[1].mask = Some(vec![255; 128 * 64]);
    let prepared = prepared(&scene, &MethodRequest::new(10, 0));
    let lift = prepared.findings.lift.as_ref().unwrap();
    assert!(lift.distances.contains("closed form"));
    assert_eq!(lift.views.len(), 4);
    for (number, view) in lift.views.iter().enumerate() {
        let refused = view.unknown + view.masked + view.thinned + view.flying + view.redundant;
        assert_eq!((view.frame, view.pixels), (number as u32, 128 * 64));
        assert_eq!(refused + view.kept, view.pixels, "{view:?}");
        assert_eq!(view.unknown, 300);
    }
    assert_eq!(
        (lift.views[1].kept, lift.views[1].masked),
        (0, 128 * 64 - 300)
    );
    assert!(lift.views[0].redundant > 0 && lift.views[0].thinned > 0);
    // Relative errors of the files are corrected; a masked view gives no evidence.
    let ratio = lift.views[0].factor / lift.views[3].factor;
    assert!((ratio - 1.03).abs() < 3e-3, "{ratio}");
    assert!(lift.disagreement.unwrap() < 0.3 * lift.disagreement_before.unwrap());
    let kept: u64 = lift.views.iter().map(|view| view.kept).sum();
    assert_eq!(lift.samples, kept);
    assert_eq!(lift.gaussians, lift.samples + lift.sky);
    assert_eq!(lift.gaussians, prepared.learner.size().primitives);
    let [least, greatest] = lift.bounds;
    for axis in 0..3 {
        let length = greatest[axis] - least[axis];
        assert!((1.0..20.0).contains(&length), "{length} m");
    }
    assert!((1e-3..0.5).contains(&lift.median_radius));
}

#[test]
fn what_is_frozen_keeps_its_bits_and_centres_stay_near() {
    let folder = tempfile::tempdir().unwrap();
    let scene = scene(folder.path(), 4, as_given);
    let table_without = |without: &[&str], iterations: u64, with: &[&str]| {
        let owned = |names: &[&str]| names.iter().map(|&name| name.to_owned()).collect();
        let request = MethodRequest {
            with: owned(with),
            without: owned(without),
            ..MethodRequest::new(iterations, 0)
        };
        let method = methods::find("panogs").unwrap();
        let session = Session::without_files(&Silent);
        let mut outcome = method.train(&scene, &request, &session).unwrap();
        outcome.learner.gaussians().unwrap().unwrap().parts[0]
            .table
            .clone()
    };
    let as_published = |iterations, with: &[&str]| {
        let without = ["shape-refinement", "centre-refinement"];
        let without = without.iter().copied().filter(|name| !with.contains(name));
        table_without(&without.collect::<Vec<_>>(), iterations, with)
    };
    let (short, long) = (as_published(1, &[]), as_published(12, &[]));
    for frozen in [POSITIONS, LOG_SCALES, QUATERNIONS] {
        assert!(short.arrays[frozen].values == long.arrays[frozen].values);
        assert!(long.arrays[frozen].first_moments.is_empty());
    }
    assert!(short.arrays[OPACITY_LOGITS].values != long.arrays[OPACITY_LOGITS].values);
    let shaped = table_without(&["centre-refinement"], 12, &[]);
    assert!(shaped.arrays[POSITIONS].values == long.arrays[POSITIONS].values);
    for learnt in [LOG_SCALES, QUATERNIONS] {
        assert!(shaped.arrays[learnt].values != long.arrays[learnt].values);
    }
    let moved = as_published(40, &["centre-refinement", "scaffold"]);
    let before = short.arrays[POSITIONS].values.as_chunks::<3>().0;
    let after = moved.arrays[POSITIONS].values.as_chunks::<3>().0;
    let scales = short.arrays[LOG_SCALES].values.as_chunks::<3>().0;
    let mut farthest = 0.0_f32;
    for ((before, after), scale) in before.iter().zip(after).zip(scales) {
        let squares = before.iter().zip(after).map(|(a, b)| (a - b) * (a - b));
        let reach = 0.5 * scale[0].exp() / 0.6;
        farthest = farthest.max(squares.sum::<f32>().sqrt() / reach);
    }
    assert!(farthest > 1e-3 && farthest < 1.001, "{farthest}");
    assert!(short.arrays[LOG_SCALES].values == moved.arrays[LOG_SCALES].values);
}

/// Returns ghosts and holes of a method after a request's iterations.
fn faults(scene: &TrainingScene, method: &str, request: &MethodRequest) -> SurfaceFaults {
    let folder = tempfile::tempdir().unwrap();
    let files = files(folder.path(), 0);
    let trace = files.trace.clone();
    let session = Session {
        files: Some(files),
        ..Session::without_files(&Silent)
    };
    let method = methods::find(method).unwrap();
    let outcome = method.train(scene, request, &session).unwrap();
    let header = fs::read_to_string(&trace).unwrap();
    let header = header.lines().next().unwrap();
    assert!(header.contains(",ghost_share,input_hole_share,novel_hole_share,refused_"));
    let trace = &outcome.training.state.trace;
    trace.last().and_then(|row| row.surfaces).unwrap()
}

#[test]
fn ghosts_and_holes_are_found_where_distances_are_known() {
    let folder = tempfile::tempdir().unwrap();
    let mut room = scene(folder.path(), 6, as_given);
    room.novel_views.extend(room.input_views.pop());
    room.novel_depth_priors.extend(room.depth_priors.pop());
    let once = MethodRequest::new(1, 0);
    let lifted = faults(&room, "panogs", &once);
    // Pixels of three degrees are coarse: at edges of depth, views see past some samples of the near side.
    assert!(lifted.ghost_share < 0.1, "{lifted:?}");
    assert!(lifted.input_hole_share.unwrap() < 0.05, "{lifted:?}");
    let few = MethodRequest {
        options: Options::at_most(100),
        ..once.clone()
    };
    let few = faults(&room, "panogs", &few);
    assert!(few.input_hole_share.unwrap() > 0.2, "{few:?}");
    assert!(few.novel_hole_share.unwrap() > 0.2, "{few:?}");

    // Points between a camera and a visible surface, and on it.
    let first = &room.input_views[0].view;
    let distances = room.distances(0).unwrap().unwrap();
    let rays = Rays::new(first.camera);
    let along = |share: f32| {
        let place = |pixel: usize| {
            let ray = rays.ray(pixel % 128, pixel / 128).normalize() * distances.values[pixel];
            (first.centre + first.rotation.transpose() * ray * share).to_array()
        };
        let positions: Vec<[f32; 3]> = (0..128 * 64).step_by(7).map(place).collect();
        PointCloud::of_colour(positions, [128; 3])
    };
    // A shell of the sky is not a ghost, and would outweigh the points.
    let points_alone = MethodRequest {
        without: vec!["sky-shell".to_owned()],
        ..once.clone()
    };
    let [there, half_way] = [1.0, 0.5].map(|share| {
        let scene = TrainingScene {
            points: along(share),
            ..room.clone()
        };
        faults(&scene, "odgs", &points_alone).ghost_share
    });
    assert!(
        there < 0.05 && half_way > 0.5,
        "{there}, half way {half_way}"
    );

    room.depth_priors.clear();
    let session = Session::without_files(&Silent);
    let outcome = methods::find("odgs").unwrap();
    let outcome = outcome.train(&room, &once, &session).unwrap();
    assert_eq!(outcome.training.state.trace[0].surfaces, None);
}

#[test]
fn fewer_are_spread_evenly_and_the_sky_gets_a_shell() {
    let folder = tempfile::tempdir().unwrap();
    // No ceiling.
    let scene = scene(folder.path(), 3, |_, pixel, metres| {
        if pixel / 128 < 24 { 0.0 } else { metres }
    });
    let request = MethodRequest {
        options: Options::at_most(500),
        ..MethodRequest::new(10, 0)
    };
    let prepared = prepared(&scene, &request);
    assert_eq!(prepared.learner.size().primitives, 500);
    assert!(is_used(&prepared, "sky-shell"));
}

#[test]
fn distances_that_cannot_be_used_are_refused_in_one_line() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    let mut missing = scene(path, 3, as_given);
    missing.depth_priors[1] = None;
    assert!(refusal(&missing).contains("input view 1 has no distances, 2 of 3 have"));

    let mut still = scene(path, 3, as_given);
    still.depth_priors.clear();
    for view in &mut still.input_views {
        view.view.centre = glam::Vec3::ZERO;
    }
    assert!(refusal(&still).contains("cameras that stand in one place"));

    let nan = scene(path, 3, |view, pixel, metres| {
        if view == 2 && pixel == 130 {
            f32::NAN
        } else {
            metres
        }
    });
    let message = refusal(&nan);
    assert!(
        message.contains("2.npy") && message.contains("row 1, column 2 is NaN"),
        "{message}"
    );
    let negative = scene(
        path,
        3,
        |_, pixel, metres| if pixel == 0 { -1.0 } else { metres },
    );
    assert!(refusal(&negative).contains("0.npy: the distance at row 0, column 0 is -1"));
    let nothing = scene(
        path,
        3,
        |view, _, metres| if view == 1 { 0.0 } else { metres },
    );
    assert!(refusal(&nothing).contains("1.npy: no distance in it is known"));

    let mut shape = scene(path, 3, as_given);
    if let Some(Some(file)) = shape.depth_priors.get_mut(0) {
        file.prior.width = 64;
    }
    assert!(refusal(&shape).contains("0.npy: is 128x64, the scene says 64x64"));

    let mut convention = scene(path, 5, as_given);
    for file in convention.depth_priors.iter_mut().flatten() {
        file.prior.convention = DistanceConvention::Z;
    }
    assert!(refusal(&convention).contains("its distances are not along z"));

    let mut mirrored = scene(path, 5, |_, _, metres| metres);
    for (number, view) in mirrored.input_views.iter_mut().enumerate() {
        let pixels = view.pixels.as_chunks_mut::<3>().0;
        pixels.chunks_exact_mut(128).for_each(<[[u8; 3]]>::reverse);
        let file = path.join(format!("{number}.npy"));
        let mut array: Vec<f32> = npy::read(&file)
            .unwrap()
            .values
            .iter()
            .map(|&v| v as f32)
            .collect();
        array.chunks_exact_mut(128).for_each(<[f32]>::reverse);
        npy::write_f32(&file, &[64, 128], &array).unwrap();
    }
    let message = refusal(&mirrored);
    assert!(message.contains("its poses are of a mirrored world") && message.contains(" dB"));
}
