//! A scene with poses and without points, or with points on a part of its surfaces. Points of a sweep lie on the
//! rest, and training on them matches training on measured points.

use glam::{DMat3, DQuat, DVec3, Vec3, dvec2, dvec3};
use novel_views::novel_psnr;
use omnilife_engine::{camera::View, step::settings::TrainSettings, training_view::TrainingView};
use omnilife_reconstruct::{
    components::{self, Supported, denser_points, swept_points},
    evidence::pilot::PilotFit,
    methods::{self, group::CameraPose},
    options::Options,
    request::{BackendChoice, MethodRequest},
    scene::TrainingScene,
    train::Session,
};
use omnilife_schemas::{
    Similarity,
    camera::{CameraModel, ErpCamera},
    points::PointCloud,
    progress::Silent,
    records::ComponentDecision,
};
use painted_room::{room, seen};

use crate::support::{novel_views, painted_room};

const CAMERA: ErpCamera = ErpCamera::new(128, 64);
const ITERATIONS: u64 = 200;

fn camera_pose(frame: u32) -> CameraPose {
    let along = 0.3 * f64::from(frame);
    let turn = DQuat::from_euler(glam::EulerRot::YXZ, 0.6 + 0.1 * along, 0.05 * along, -0.05);
    CameraPose {
        to_world: DMat3::from_quat(turn),
        centre: dvec3(0.25 * along - 0.5, 0.05 * along, 0.2 * along - 0.4),
        time_seconds: f64::from(frame),
    }
}

/// Returns a path through the room, every fifth view a novel one, without points.
fn walk() -> TrainingScene {
    let (mut input_views, mut novel_views) = (Vec::new(), Vec::new());
    for frame in 0..15 {
        let pose = camera_pose(frame);
        let views = if frame % 5 == 4 {
            &mut novel_views
        } else {
            &mut input_views
        };
        views.push(TrainingView {
            frame,
            view: View {
                camera: CAMERA.into(),
                rotation: pose.to_world.transpose().as_mat3(),
                centre: pose.centre.as_vec3(),
                time_seconds: pose.time_seconds,
            },
            pixels: seen(CAMERA, &pose).0.to_rgb8(),
            mask: None,
            ignored: None,
        });
    }
    TrainingScene {
        novel_views,
        ..TrainingScene::new(
            "room",
            CAMERA.into(),
            input_views,
            Similarity::new([0.0; 3], 1.0),
        )
    }
}

/// Returns points of the room's surfaces as a laser at a view would measure them.
fn measured() -> PointCloud<f32> {
    let pose = camera_pose(6);
    let mut points = PointCloud::default();
    for row in 0..CAMERA.height {
        for column in (row % 2..CAMERA.width).step_by(2) {
            let pixel = dvec2(f64::from(column) + 0.5, f64::from(row) + 0.5);
            let direction = pose.to_world * CAMERA.unproject(pixel);
            let (colour, distance) = room(pose.centre, direction);
            let place = pose.centre + distance * direction;
            points.positions.push(place.as_vec3().to_array());
            let colour = (colour * 255.0).round().as_u8vec3();
            points.colours.push(colour.to_array());
        }
    }
    points
}

fn completed(request: &MethodRequest) -> (TrainingScene, Option<ComponentDecision>) {
    let supported = Supported {
        default: &[swept_points::ID],
        optional: &[],
    };
    let mut scene = walk();
    let decision = components::complete_points(&mut scene, supported, request);
    (scene, decision)
}

fn psnr_after_training(scene: &TrainingScene) -> f64 {
    let request = MethodRequest::new(ITERATIONS, 3);
    let mut outcome = methods::find("odgs")
        .unwrap()
        .train(scene, &request, &Session::without_files(&Silent))
        .unwrap();
    novel_psnr(&mut outcome, scene)
}

#[test]
fn a_scene_without_points_trains_as_one_with_points() {
    let (swept, decision) = completed(&MethodRequest::new(ITERATIONS, 3));
    assert!(decision.unwrap().used);
    let mut with_points = walk();
    with_points.points = measured();
    let [without, given, found] = [&walk(), &with_points, &swept].map(psnr_after_training);
    assert!(
        found > given - 0.5 && found > without + 3.0,
        "{without:.2} dB without points, {given:.2} with measured ones, {found:.2} with swept ones"
    );
}

#[test]
fn swept_points_lie_on_the_surfaces() {
    let points = completed(&MethodRequest::new(ITERATIONS, 3)).0.points;
    assert!(points.len() > 1_000, "{} points", points.len());
    let mut errors: Vec<f64> = points
        .positions
        .iter()
        .map(|&position| {
            let origin = camera_pose(6).centre;
            let offset = Vec3::from_array(position).as_dvec3() - origin;
            let nearest =
                |direction: DVec3| (room(origin, direction).1 / offset.length() - 1.0).abs();
            // A place behind a pillar from here may be visible from elsewhere.
            let beside = camera_pose(0).centre - origin;
            let again = Vec3::from_array(position).as_dvec3() - (origin + beside);
            let from_beside =
                (room(origin + beside, again.normalize()).1 / again.length() - 1.0).abs();
            nearest(offset.normalize()).min(from_beside)
        })
        .collect();
    errors.sort_by(f64::total_cmp);
    let [median, most] = [errors.len() / 2, errors.len() * 9 / 10].map(|at| errors[at]);
    assert!(
        median < 0.04 && most < 0.2,
        "median error {median:.3}, nine in ten below {most:.3}"
    );
}

/// An operator, a constant colour or noise under a mask of ignored pixels give the same points and the same evidence.
#[test]
fn ignored_pixels_neither_match_nor_count() {
    let found = |under: Option<fn(usize) -> u8>| {
        let mut scene = walk();
        let hidden = CAMERA.width as usize * 44;
        for view in &mut scene.input_views {
            let pixels = (0..view.pixels.len() / 3).map(|pixel| u8::from(pixel >= hidden));
            view.ignored = Some(pixels.collect());
            for (at, value) in view.pixels.iter_mut().enumerate().skip(3 * hidden) {
                *value = under.map_or(*value, |under| under(at + 7919 * view.frame as usize));
            }
        }
        let supported = Supported {
            default: &[swept_points::ID],
            optional: &[],
        };
        let request = MethodRequest::new(ITERATIONS, 3);
        let decision = components::complete_points(&mut scene, supported, &request).unwrap();
        (decision.reason, scene.points.positions)
    };
    let as_it_is = found(None);
    assert!(as_it_is.1.len() > 500, "{}", as_it_is.0);
    for under in [
        |_: usize| 200,
        |at: usize| ((at * 2_654_435_761) >> 7) as u8,
    ] {
        let other = found(Some(under));
        assert_eq!(other.0, as_it_is.0);
        assert_eq!(other.1, as_it_is.1);
    }
}

#[test]
fn they_can_be_left_out_and_need_parallax() {
    let request = MethodRequest {
        without: vec![swept_points::ID.to_owned()],
        ..MethodRequest::new(ITERATIONS, 3)
    };
    let (scene, decision) = completed(&request);
    assert!(scene.points.is_empty() && !decision.unwrap().used);
    let mut still = walk();
    for view in &mut still.input_views {
        view.view.centre = Vec3::ZERO;
    }
    let supported = Supported {
        default: &[swept_points::ID],
        optional: &[],
    };
    let request = MethodRequest::new(ITERATIONS, 3);
    let decision = components::complete_points(&mut still, supported, &request).unwrap();
    assert!(still.points.is_empty() && !decision.used, "{decision:?}");
    assert!(
        decision.reason.contains("far enough apart"),
        "{}",
        decision.reason
    );
}

/// Returns the path with measured points on one side of the room, and a method that can complete them.
fn half_measured(with: &[&str]) -> (TrainingScene, Option<ComponentDecision>) {
    let mut scene = walk();
    let all = measured();
    for (position, colour) in all.positions.iter().zip(&all.colours) {
        if position[0] < 0.0 {
            scene.points.positions.push(*position);
            scene.points.colours.push(*colour);
        }
    }
    let request = MethodRequest {
        with: with.iter().map(|&name| name.to_owned()).collect(),
        ..MethodRequest::new(ITERATIONS, 3)
    };
    let supported = Supported {
        default: &[],
        optional: &[denser_points::ID],
    };
    let decision = components::complete_points(&mut scene, supported, &request);
    (scene, decision)
}

#[test]
fn surfaces_without_points_get_some_where_that_is_asked_for() {
    let (half, decision) = half_measured(&[]);
    assert!(decision.is_none() && half.added_points == 0);
    let (completed, decision) = half_measured(&[denser_points::ID]);
    let reason = decision.unwrap().reason;
    let given = half.points.len();
    let added = &completed.points.positions[given..];
    assert!(
        added.len() > 300 && added.len() == completed.added_points,
        "{reason}"
    );
    assert!(completed.points.positions[..given] == half.points.positions[..]);
    let beside = added.iter().filter(|position| position[0] > 0.0).count();
    assert!(beside * 10 > added.len() * 8, "{beside} of {reason}");
    let [without, with] = [&half, &completed].map(psnr_after_training);
    assert!(with > without + 1.0, "{without:.2} dB, {with:.2}: {reason}");
}

#[test]
fn added_points_leave_the_limit_on_gaussians_where_it_was() {
    let maximum = |scene: &TrainingScene| {
        let odgs = methods::find("odgs").unwrap();
        let request = MethodRequest::new(ITERATIONS, 3);
        let prepared = odgs.prepare(scene, &request, BackendChoice::Cpu).unwrap();
        let settings: TrainSettings = serde_json::from_value(prepared.configuration).unwrap();
        settings.densify.maximum_gaussians
    };
    let [half, completed] = [&[][..], &[denser_points::ID]].map(|with| half_measured(with).0);
    assert!(completed.points.len() > half.points.len());
    assert_eq!(maximum(&completed), maximum(&half));
}

/// With no room for a Gaussian more, the component is asked for, adds nothing, and does not count as used.
#[test]
fn a_component_that_adds_no_point_is_not_used() {
    let (mut scene, _) = half_measured(&[]);
    let given = scene.points.len();
    let mut request = MethodRequest {
        with: vec![denser_points::ID.to_owned()],
        ..MethodRequest::new(ITERATIONS, 3)
    };
    request.options = Options::at_most(given as u64);
    let supported = Supported {
        default: &[],
        optional: &[denser_points::ID],
    };
    let decision = components::complete_points(&mut scene, supported, &request).unwrap();
    assert!(!decision.used, "{}", decision.reason);
    assert_eq!((scene.points.len(), scene.added_points), (given, 0));
}

#[test]
fn a_scene_whose_surfaces_have_points_gets_no_more() {
    let mut scene = walk();
    scene.points = completed(&MethodRequest::new(ITERATIONS, 3)).0.points;
    let supported = Supported {
        default: &[denser_points::ID],
        optional: &[],
    };
    let before = scene.points.len();
    let request = MethodRequest::new(ITERATIONS, 3);
    let decision = components::complete_points(&mut scene, supported, &request).unwrap();
    assert!(
        !decision.used && scene.points.len() == before,
        "{}",
        decision.reason
    );
}

/// Checks that added points give no evidence except changes at them: limits were measured on scenes' own points.
#[test]
fn added_points_are_no_evidence_but_are_asked_whether_they_change() {
    let [half, completed] = [&[][..], &[denser_points::ID]].map(|with| half_measured(with).0);
    let of = |scene: &TrainingScene| {
        let fit = PilotFit::of(scene, 3).unwrap();
        let (changing, coverage) = fit.points();
        (
            fit.motion(),
            coverage,
            fit.colours(),
            changing.changes.len(),
        )
    };
    let (before, after) = (of(&half), of(&completed));
    assert!(before.0 == after.0 && before.1 == after.1 && before.2 == after.2);
    assert_eq!(before.3, half.points.len());
    assert_eq!(after.3, completed.points.len());
}
