//! A detector of components without an effect: every component of every method in a run with all of them, without
//! it, and with a hundred times its weight if it has one. Images must differ by more than last bits.
//!
//! A component that fails may be in no default plan, price or table: its row loses it, or it gets a form that acts.

use std::{
    cell::{OnceCell, RefCell},
    collections::{BTreeSet, HashMap},
    path::Path,
};

use glam::{DMat3, DQuat, DVec3, dvec2, dvec3};
use omnilife_engine::{
    camera::{Camera, View},
    schedule::Position,
    training_view::TrainingView,
};
use omnilife_reconstruct::{
    components::{self, denser_points, short_schedule, swept_points},
    evidence::once::PilotOnce,
    methods::{self, METHODS, Method, Prepared},
    options::{Constant, MethodOption, OptionValues},
    request::{BackendChoice, MethodRequest, PlanChoice},
    scene::{TrainingScene, depth::PriorFile},
};
use omnilife_schemas::{
    Pose, RgbImage, Similarity,
    camera::{CameraModel, ErpCamera},
    npy,
    points::PointCloud,
    records::{ComponentDecision, DepthPrior, DistanceConvention, Scale},
};

use crate::{
    components::spoilt,
    depth::room,
    object_graph,
    support::{flight, post, trained::small_options},
};

/// Least relative difference of images, root mean square. Last bits make less than a tenth of it in so few steps.
const LIMIT: f64 = 2e-6;
/// Steps of a run.
const STEPS: u64 = 24;
/// A schedule in which there are resets of opacities; a run takes steps that are evenly spread over it.
const LONG_SCHEDULE: u64 = 250 * STEPS;
/// Largest number of Gaussians.
const MAX_GAUSSIANS: usize = 600;

/// A scene with a schedule.
struct Case {
    name: &'static str,
    scene: TrainingScene,
    iterations: u64,
    /// The scene with added points, by the request for them: a sweep takes longer than a run.
    completed: RefCell<HashMap<String, CompletedScene>>,
}

/// A scene with added points, and the decision on them.
type CompletedScene = (TrainingScene, Option<ComponentDecision>);

impl Case {
    fn new(name: &'static str, scene: TrainingScene, iterations: u64) -> Self {
        Self {
            name,
            scene,
            iterations,
            completed: RefCell::default(),
        }
    }

    /// Returns the scene with the points that a run of a method adds.
    fn completed(&self, method: &Method, request: &MethodRequest) -> CompletedScene {
        let supported = method.supported();
        let asked = [denser_points::ID, swept_points::ID].map(|id| {
            let lists = [supported.default, supported.optional];
            let is_listed = lists.map(|list| list.contains(&id));
            (is_listed, request.asks_for(id), request.leaves_out(id))
        });
        let maximum = request.options.maximum_gaussians();
        let key = format!("{asked:?} {:?} {maximum:?}", request.plan);
        let complete = || {
            let mut scene = self.scene.clone();
            let decision = components::complete_points(&mut scene, supported, request);
            (scene, decision)
        };
        let mut completed = self.completed.borrow_mut();
        completed.entry(key).or_insert_with(complete).clone()
    }
}

/// A run of a method on a case.
struct Trial {
    /// Names of the used components.
    used: BTreeSet<String>,
    images: Vec<RgbImage>,
}

/// Returns the cases, of which a component must act in one.
fn cases(folder: &Path) -> Vec<Case> {
    let clip = clip();
    let mut without_points = clip.clone();
    without_points.points = PointCloud::default();
    // Two corners of the room, far from each other: few surfaces that one camera is near to are near to all.
    let corners = [
        dvec3(-5.0, -7.0, 0.5),
        dvec3(-4.6, -6.6, 0.9),
        dvec3(5.0, 7.0, 0.5),
        dvec3(4.6, 6.6, 0.9),
    ];
    let walk = [0, 1, 2, 3, 4].map(|number| room::camera_pose(number).1);
    vec![
        Case::new("clip", clip.clone(), STEPS),
        Case::new("long schedule", clip, LONG_SCHEDULE),
        Case::new("clip without points", without_points, STEPS),
        Case::new("room", furnished(&folder.join("walk"), &walk), STEPS),
        Case::new(
            "corners",
            furnished(&folder.join("corners"), &corners),
            STEPS,
        ),
        Case::new("flight", flight::scene(flight::path_beside(0.5)), STEPS),
        Case::new("post", post::scene(), STEPS),
    ]
}

/// Returns a clip with all that components look for: a ball that moves, with masks and a track; gains and poses
/// that drift; directions without points, and surfaces with few.
fn clip() -> TrainingScene {
    let mut scene = spoilt(object_graph::scene());
    let all = std::mem::take(&mut scene.points);
    let points = all.positions.into_iter().zip(all.colours);
    // The world's y axis points down.
    let below = points.filter(|(position, _)| position[1] > -2.0);
    for (position, colour) in below.step_by(2) {
        scene.points.positions.push(position);
        scene.points.colours.push(colour);
    }
    scene
}

/// Returns the room without a ceiling as cameras at some places see it, with distances on a coarser grid than the
/// images', which get worse from camera to camera.
fn furnished(folder: &Path, centres: &[DVec3]) -> TrainingScene {
    std::fs::create_dir(folder).unwrap();
    let normalization = Similarity::new([0.0; 3], 0.25);
    let [camera, coarse] = [128, 64].map(|width| ErpCamera::new(width, width / 2));
    let (mut input_views, mut depth_priors) = (Vec::new(), Vec::new());
    for (number, &centre) in centres.iter().enumerate() {
        let to_world = room::camera_pose(number).0;
        let pose = Pose::new(DQuat::from_mat3(&to_world), centre);
        let colours = hits(camera, &to_world, centre);
        let pixels = colours
            .iter()
            .flat_map(|hit| (hit.colour * 255.0).round().as_u8vec3().to_array());
        input_views.push(TrainingView {
            frame: number as u32,
            view: View::new(camera, &pose, &normalization, 0.1 * number as f64).unwrap(),
            pixels: pixels.collect(),
            mask: None,
            ignored: None,
        });
        let metres = hits(coarse, &to_world, centre);
        let metres = metres.iter().enumerate().map(|(pixel, hit)| {
            let is_known = pixel as u32 / coarse.width >= 12;
            let error = 1.0 + 0.01 * number as f64;
            if is_known {
                (hit.distance * error) as f32
            } else {
                0.0
            }
        });
        let path = folder.join(format!("{number}.npy"));
        let shape = [coarse.height as usize, coarse.width as usize];
        npy::write_f32(&path, &shape, &metres.collect::<Vec<_>>()).unwrap();
        depth_priors.push(Some(PriorFile {
            path,
            prior: DepthPrior {
                file: format!("{number}.npy"),
                unit: 1.0,
                width: coarse.width,
                height: coarse.height,
                convention: DistanceConvention::Ray,
                source: "closed form".to_owned(),
            },
        }));
    }
    TrainingScene {
        scale: Scale::Metres,
        depth_priors,
        ..TrainingScene::new("room", Camera::from(camera), input_views, normalization)
    }
}

/// Returns what the pixels of a camera see of the room.
fn hits(camera: ErpCamera, to_world: &DMat3, centre: DVec3) -> Vec<room::Hit> {
    let [width, height] = [camera.width as usize, camera.height as usize];
    let hit = |at: usize| {
        let pixel = dvec2((at % width) as f64 + 0.5, (at / width) as f64 + 0.5);
        room::trace(centre, *to_world * camera.unproject(pixel))
    };
    (0..width * height).map(hit).collect()
}

/// Returns a request for a method with components and options, beside those that make it short, and without others.
fn request(
    method: &Method,
    case: &Case,
    [with, without]: [&[&str]; 2],
    set: &[String],
) -> MethodRequest {
    let owned = |names: &[&str]| names.iter().map(|&name| name.to_owned()).collect();
    MethodRequest {
        with: owned(with),
        without: owned(without),
        options: small_options(method, MAX_GAUSSIANS, set),
        ..MethodRequest::new(case.iterations, 7)
    }
}

/// Returns a run; `None` for a scene that lacks an input of the method.
fn trial(method: &Method, case: &Case, request: &MethodRequest) -> Option<Trial> {
    let (scene, points) = case.completed(method, request);
    let prepared = method.prepare(&scene, request, BackendChoice::Cpu);
    let Prepared {
        mut learner,
        findings,
        ..
    } = prepared.ok()?;
    let plan = points.into_iter().chain(findings.plan);
    let used = plan.filter(|decision| decision.used).map(|decision| {
        // A decision on one part of a model.
        let name = decision.component.split(':').next();
        name.unwrap_or_default().to_owned()
    });
    let used = used.collect();
    let views = scene.input_views.len();
    for step in 1..=STEPS {
        let iteration = step * request.iterations / STEPS;
        let at = Position::new(request.iterations, None, iteration, 0.0);
        // All views in turn, far ones one after another.
        learner.step(5 * step as usize % views, &at).unwrap();
        learner.maintain(&at).unwrap();
    }
    let seen = scene.input_views.iter().chain(&scene.novel_views);
    let images = seen
        .step_by(3)
        .map(|view| learner.image(&view.view).unwrap());
    let images = images.collect();
    Some(Trial { used, images })
}

/// Returns the relative difference of two runs' images, root mean square.
fn difference(one: &Trial, other: &Trial) -> f64 {
    let values = |trial: &Trial| -> Vec<f64> {
        let images = trial.images.iter().flat_map(|image| &image.data);
        images.map(|&value| f64::from(value)).collect()
    };
    let [one, other] = [one, other].map(values);
    let squares = one.iter().zip(&other).map(|(a, b)| (a - b).powi(2));
    let of_one: f64 = one.iter().map(|value| value * value).sum();
    (squares.sum::<f64>() / of_one.max(f64::MIN_POSITIVE)).sqrt()
}

/// Returns lines of options that make the weights of a component a hundred times as large, or as large as allowed.
fn heavier(method: &Method, component: &str) -> Vec<String> {
    let weighs = |option: &&MethodOption| {
        let is_weight =
            |constant: Constant| constant.is_weight && constant.component == Some(component);
        option.constant.is_some_and(is_weight)
    };
    let weights = method.options.iter().filter(weighs);
    let line = |option: &MethodOption| {
        let OptionValues::Number { most, .. } = option.values else {
            panic!("{}: a weight is a number", option.id);
        };
        let usual: Option<f64> = option.default.parse().ok();
        let heavy = usual.map_or(most, |usual| (100.0 * usual).min(most));
        format!("{}={heavy}", option.id)
    };
    weights.map(line).collect()
}

/// Components of a run beside the one in question.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum OtherComponents {
    All,
    OfPlanFull,
}

/// The others, and the number of a case.
type Place = (OtherComponents, usize);

struct Walk<'a> {
    method: &'static Method,
    cases: &'a [Case],
    /// With all components, by case.
    whole: Vec<OnceCell<Option<Trial>>>,
}

impl Walk<'_> {
    fn all(&self) -> Vec<&'static str> {
        [self.method.components, self.method.optional_components].concat()
    }

    fn request(
        &self,
        number: usize,
        (others, component): (OtherComponents, Option<&'static str>),
        is_used: bool,
        set: &[String],
    ) -> MethodRequest {
        let (mut with, plan) = match others {
            OtherComponents::All => (self.all(), PlanChoice::Auto),
            OtherComponents::OfPlanFull => (component.into_iter().collect(), PlanChoice::Full),
        };
        let mut without: Vec<&str> = component.into_iter().filter(|_| !is_used).collect();
        // Larger steps turn last bits into differences that anybody sees.
        if component != Some(short_schedule::ID) && self.all().contains(&short_schedule::ID) {
            without.push(short_schedule::ID);
        }
        with.retain(|name| !without.contains(name));
        MethodRequest {
            plan,
            ..request(self.method, &self.cases[number], [&with, &without], set)
        }
    }

    /// Returns the run with all components.
    fn whole(&self, number: usize) -> Option<&Trial> {
        let run = || {
            let request = self.request(number, (OtherComponents::All, None), true, &[]);
            trial(self.method, &self.cases[number], &request)
        };
        self.whole[number].get_or_init(run).as_ref()
    }

    /// Returns the difference that a component makes in a case beside others, or a weight of it where that makes
    /// less; `None` where it is not used.
    fn effect(
        &self,
        number: usize,
        others: OtherComponents,
        component: &'static str,
    ) -> Option<f64> {
        let (method, case) = (self.method, &self.cases[number]);
        let run = |is_used: bool, set: &[String]| {
            let request = self.request(number, (others, Some(component)), is_used, set);
            trial(method, case, &request)
        };
        let own;
        let whole = match others {
            OtherComponents::All if component != short_schedule::ID => self.whole(number)?,
            OtherComponents::All | OtherComponents::OfPlanFull => {
                own = run(true, &[])?;
                &own
            }
        };
        if !whole.used.contains(component) {
            return None;
        }
        let mut least = difference(whole, &run(false, &[])?);
        for line in heavier(method, component) {
            least = least.min(difference(whole, &run(true, &[line])?));
        }
        println!(
            "{} {component}, {}, {others:?}: {least:.1e}",
            method.id, case.name
        );
        Some(least)
    }

    /// Returns true for a component with an effect in any case, beside any others. `acted` has the case in which a
    /// component acted in an earlier method, which comes first here.
    fn acts(&self, component: &'static str, acted: &mut HashMap<&'static str, Place>) -> bool {
        let first = acted.get(component).copied();
        let places = [OtherComponents::All, OtherComponents::OfPlanFull]
            .into_iter()
            .flat_map(|others| (0..self.cases.len()).map(move |number| (others, number)));
        let others = places.filter(|&place| first != Some(place));
        let found = first.into_iter().chain(others).find(|&(others, number)| {
            let effect = self.effect(number, others, component);
            effect.is_some_and(|effect| effect > LIMIT)
        });
        acted.extend(found.map(|place| (component, place)));
        found.is_some()
    }
}

#[test]
fn every_component_of_every_method_acts() {
    let _once = PilotOnce::begin();
    let folder = tempfile::tempdir().unwrap();
    let cases = cases(folder.path());
    let (mut idle, mut acted) = (Vec::new(), HashMap::new());
    for method in METHODS.iter().filter(|method| method.is_trained()) {
        let walk = Walk {
            method,
            cases: &cases,
            whole: cases.iter().map(|_| OnceCell::new()).collect(),
        };
        let has_case = (0..cases.len()).any(|number| walk.whole(number).is_some());
        assert!(has_case, "{}: no case has its inputs", method.id);
        let all = walk.all().into_iter();
        let without_effect = all.filter(|&component| !walk.acts(component, &mut acted));
        idle.extend(without_effect.map(|component| format!("{}: {component}", method.id)));
    }
    assert_eq!(idle, Vec::<String>::new(), "without an effect in any case");
}

/// Under Adam, two velocities whose weights add up to one are nearly one velocity: the printed form moves images less.
#[test]
fn printed_velocities_act_less_than_projected_ones() {
    let method = methods::find("omni4dgs").unwrap();
    let case = Case::new("clip", clip(), STEPS);
    let run = |with: &[&str], form: &str| {
        let set = [format!("velocity-form={form}")];
        let without = &[short_schedule::ID];
        trial(
            method,
            &case,
            &request(method, &case, [with, without], &set),
        )
        .unwrap()
    };
    let with = &["velocity-decomposition"];
    let without = run(&[], "literal");
    let [literal, projected] = ["literal", "projected"].map(|form| {
        let trial = run(with, form);
        assert!(trial.used.contains(with[0]));
        difference(&without, &trial)
    });
    assert!(
        literal < 0.5 * projected && projected > LIMIT,
        "{literal:.1e} {projected:.1e}"
    );
}
