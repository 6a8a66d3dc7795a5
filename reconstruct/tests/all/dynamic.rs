//! Methods for dynamic scenes as a whole: a ball that passes, its masks, and awkward clips.

use glam::Vec3;
use omnilife_engine::{
    camera::View,
    gaussians::{
        ActivatedGaussians,
        deformable::{DEFORMATION_WEIGHTS, Deformation, DeformationModel},
        static_gaussians::{self, InitialGaussians},
    },
    model::layers::{Layer, LayerRenderer},
    parameters::{SharedParameters, adam},
    training_view::TrainingView,
};
use omnilife_reconstruct::{
    evidence::once::PilotOnce,
    methods::{self, MethodOutcome},
    options::Options,
    request::{MethodRequest, PlanChoice},
    scene::TrainingScene,
    train::Session,
};
use omnilife_schemas::{points::PointCloud, progress::Silent};

use crate::support::trained::{request, settings, train, whole_and_resumed};

use crate::support::moving_ball;

/// Returns a request with few Gaussians: a network takes time for every Gaussian.
fn few_gaussians(iterations: u64) -> MethodRequest {
    MethodRequest {
        options: Options::at_most(600),
        ..request(iterations)
    }
}

/// Returns the PSNR of the novel views' masked pixels.
fn dynamic_psnr(scene: &TrainingScene, outcome: &mut MethodOutcome<'_>) -> f64 {
    let (mut sum, mut count) = (0.0, 0.0);
    for view in &scene.novel_views {
        let image = outcome.learner.image(&view.view).unwrap();
        let mut truth = Vec::new();
        view.write_image(&mut truth);
        let pixels = image
            .data
            .as_chunks::<3>()
            .0
            .iter()
            .zip(truth.as_chunks::<3>().0);
        for ((rgb, truth), covered) in pixels.zip(view.mask.as_ref().unwrap()) {
            if *covered > 127 {
                let errors = rgb.iter().zip(truth).map(|(a, b)| f64::from(a - b).powi(2));
                sum += errors.sum::<f64>();
                count += 3.0;
            }
        }
    }
    -10.0 * (sum / count).log10()
}

/// Returns the mean colour of a view's layer inside and outside its mask.
fn colours(image: &[f32], view: &TrainingView) -> [[f32; 3]; 2] {
    let (mut sums, mut counts) = ([[0.0; 3]; 2], [0.0_f32; 2]);
    for (rgb, covered) in image
        .as_chunks::<3>()
        .0
        .iter()
        .zip(view.mask.as_ref().unwrap())
    {
        let side = usize::from(*covered < 128);
        counts[side] += 1.0;
        for (sum, value) in sums[side].iter_mut().zip(rgb) {
            *sum += value;
        }
    }
    [0, 1].map(|side| sums[side].map(|sum| sum / counts[side]))
}

#[test]
fn a_passing_ball_is_dynamic_and_predicted_better_than_by_static_gaussians() {
    let scene = moving_ball::scene();
    let mut still = train(&scene, "odgs", &request(200));
    let mut moving = train(&scene, "omni4dgs-plus", &request(200));
    let (without, with) = (
        dynamic_psnr(&scene, &mut still),
        dynamic_psnr(&scene, &mut moving),
    );
    assert!(
        with > without + 2.0 && with > 15.0,
        "odgs {without:.2} dB, omni4dgs-plus {with:.2} dB"
    );

    let rendering = settings(&moving).rendering;
    let model = moving.learner.gaussians().unwrap().unwrap();
    let mut layers = LayerRenderer::new(model.clone(), rendering);
    let view = &scene.input_views[5];
    let mut layer = |layer| layers.image(&view.view, layer).data;
    let [inside, outside] = colours(&layer(Layer::Dynamic), view);
    assert!(inside[0] > 0.5 && inside[1] < 0.3, "{inside:?}");
    assert!(outside.iter().all(|&value| value < 0.05), "{outside:?}");
    let [inside, outside] = colours(&layer(Layer::Static), view);
    assert!(
        inside[0] < 0.7 && outside[1] > 0.2,
        "{inside:?} {outside:?}"
    );
    // The ball is nearer than the background.
    let [inside, outside] = colours(&layer(Layer::Depth), view);
    assert!(inside[0] > outside[0], "{inside:?} {outside:?}");
    let velocities = layer(Layer::Velocity);
    assert!(velocities.iter().all(|value| value.is_finite()));
}

/// Checks each left-out component of the ablation, and the arrays of its model.
#[test]
fn what_is_left_out_has_no_arrays() {
    let _once = PilotOnce::begin();
    let scene = moving_ball::scene();
    type Names = &'static [&'static str];
    let cases: [(Names, Names, Names); 4] = [
        (&[], &[], &["peak_times", "log_lifespans", "velocities"]),
        (
            &["velocity-decomposition"],
            &[],
            &[
                "peak_times",
                "log_lifespans",
                "radial_velocities",
                "tangential_velocities",
            ],
        ),
        (
            &["velocity-decomposition"],
            &["temporal-motion"],
            &["peak_times", "log_lifespans"],
        ),
        (&[], &["temporal-opacity"], &["peak_times", "velocities"]),
    ];
    for (with, without, arrays) in cases {
        let owned = |names: Names| names.iter().map(|&name| name.to_owned()).collect();
        let request = MethodRequest {
            with: owned(with),
            without: owned(without),
            ..request(6)
        };
        let mut outcome = train(&scene, "omni4dgs-plus", &request);
        let model = outcome.learner.gaussians().unwrap().unwrap();
        let moving = &model.parts[1].table;
        let found: Vec<&str> = moving.arrays[5..].iter().map(|array| array.name).collect();
        assert_eq!(found, arrays, "{without:?}");
        assert_eq!(model.parts[0].table.arrays.len(), 5);
        // Seeds that never vanish would stay for the whole clip.
        let seeded = outcome
            .findings
            .plan
            .iter()
            .any(|part| part.component == "mask-seeds" && part.used);
        assert_eq!(seeded, !without.contains(&"temporal-opacity"));
        for name in without {
            let decision = outcome
                .findings
                .plan
                .iter()
                .find(|part| part.component == *name)
                .unwrap();
            assert!(
                !decision.used && decision.reason.contains("left out"),
                "{decision:?}"
            );
        }
    }
    for name in [
        "dynamic-mask",
        "velocity-regularization",
        "mask-seeds",
        "static-table",
    ] {
        let request = MethodRequest {
            with: vec!["motion-regularization".to_owned()],
            without: vec![name.to_owned()],
            ..request(6)
        };
        let last = train(&scene, "omni4dgs-plus", &request)
            .training
            .state
            .trace
            .pop()
            .unwrap();
        assert!(last.train_loss.is_some_and(f64::is_finite), "{name}");
    }
}

/// Constants of components that are not used would make rows of a name of their own with the numbers of another.
#[test]
fn a_constant_without_its_component_is_told() {
    let _once = PilotOnce::begin();
    let scene = moving_ball::scene();
    let method = methods::find("omni4dgs").unwrap();
    let warnings = |with: &[&str], line: &str| {
        let request = MethodRequest {
            with: with.iter().map(|&name| name.to_owned()).collect(),
            options: Options::parse(method.id, method.options, &[line.to_owned()]).unwrap(),
            ..request(2)
        };
        train(&scene, method.id, &request).training.warnings
    };
    let is_told = |warnings: &[String]| warnings.iter().any(|line| line.contains("has no effect"));
    let told = warnings(&[], "gamma=1");
    let expected = "gamma was set and has no effect: velocity-decomposition is not used";
    assert!(told.iter().any(|line| line == expected), "{told:?}");
    assert!(!is_told(&warnings(&["velocity-decomposition"], "gamma=1")));
    assert!(!is_told(&warnings(&[], "gamma=0.5")) && !is_told(&warnings(&[], "cycle=20")));
}

/// A name, and a change that makes the scene awkward.
type Variant = (&'static str, fn(&mut TrainingScene));

/// The catalogue of stability has more of these clips, of one frame to ten thousand.
#[test]
fn awkward_clips_train_without_a_panic_or_a_nan() {
    let _once = PilotOnce::begin();
    let variants: [Variant; 4] = [
        ("no masks", |scene| {
            for view in &mut scene.input_views {
                view.mask = None;
            }
        }),
        ("masks of everything", |scene| {
            for mask in scene
                .input_views
                .iter_mut()
                .filter_map(|view| view.mask.as_mut())
            {
                mask.fill(255);
            }
        }),
        ("no points", |scene| scene.points = PointCloud::default()),
        ("some masks", |scene| scene.input_views[0].mask = None),
    ];
    for (name, change) in variants {
        let mut scene = moving_ball::scene();
        change(&mut scene);
        for method in ["deformable", "periodic", "omni4dgs", "omni4dgs-plus"] {
            for plan in [PlanChoice::Auto, PlanChoice::Full] {
                let request = MethodRequest {
                    plan,
                    ..few_gaussians(12)
                };
                let mut outcome = train(&scene, method, &request);
                let state = &outcome.training.state;
                assert!(
                    state.refused.iter().all(|&refused| refused == 0),
                    "{name}, {method}"
                );
                assert!(
                    state.trace[1..]
                        .iter()
                        .all(|point| point.train_loss.is_some_and(f64::is_finite)),
                    "{name}"
                );
                let model = outcome.learner.gaussians().unwrap().unwrap();
                assert_eq!(model.not_finite(), None, "{name}, {method}");
            }
        }
        if name == "masks of everything" {
            let outcome = train(&scene, "omni4dgs", &request(2));
            assert!(
                outcome
                    .training
                    .warnings
                    .iter()
                    .any(|warning| warning.contains("inverted"))
            );
        }
    }
}

#[test]
fn times_that_decrease_are_refused_and_those_of_a_rig_are_not() {
    let mut scene = moving_ball::scene();
    let clock = scene.clock().unwrap();
    scene.input_views[3].view.time_seconds = 1.0;
    let method = methods::find("omni4dgs").unwrap();
    let refused = method.train(&scene, &request(2), &Session::without_files(&Silent));
    let message = refused.map(drop).unwrap_err().to_string();
    assert!(message.contains("frame 3 is at 1 s"), "{message}");
    // Two cameras at each time have the clock of one.
    let mut rig = moving_ball::scene();
    let others: Vec<_> = rig
        .input_views
        .iter()
        .cloned()
        .map(|mut view| {
            view.frame = 2 * view.frame + 1;
            view
        })
        .collect();
    for view in rig.input_views.iter_mut().chain(&mut rig.novel_views) {
        view.frame *= 2;
    }
    rig.input_views.extend(others);
    assert_eq!(rig.clock().unwrap(), clock);
    let trained = method.train(&rig, &request(2), &Session::without_files(&Silent));
    assert!(trained.is_ok());
    let refused =
        methods::find("nag")
            .unwrap()
            .train(&rig, &request(2), &Session::without_files(&Silent));
    let message = refused.map(drop).unwrap_err().to_string();
    assert!(message.contains("an atlas is of one camera"), "{message}");
}

#[test]
fn an_interrupted_run_goes_on_to_the_bit() {
    for method in ["periodic", "deformable"] {
        let (scene, request) = (moving_ball::scene(), few_gaussians(40));
        let [whole, resumed] = whole_and_resumed(&scene, method, &request, |outcome| {
            outcome.learner.gaussians().unwrap().unwrap().clone()
        });
        assert!(whole == resumed, "{method}");
        if let Some(weights) = whole.parts[0].parameterization.shared() {
            // Warm-up takes 3 of 40 iterations.
            assert_eq!(weights.steps, 37);
        }
    }
}

#[test]
fn a_network_takes_part_after_a_warm_up_and_without_it_gaussians_are_those_of_odgs() {
    let scene = moving_ball::scene();
    let request = |without: &[&str]| MethodRequest {
        without: without.iter().map(|&name| name.to_owned()).collect(),
        ..few_gaussians(40)
    };
    let [still, deformed, undeformed] = [
        ("odgs", request(&[])),
        ("deformable", request(&[])),
        ("deformable", request(&["deformation"])),
    ]
    .map(|(method, request)| {
        let mut outcome = train(&scene, method, &request);
        let model = outcome.learner.gaussians().unwrap().unwrap().clone();
        let [first, last] = [0, scene.input_views.len() - 1].map(|view| {
            let view = &scene.input_views[view].view;
            let pose_of_one_time = View {
                time_seconds: view.time_seconds,
                ..scene.input_views[0].view
            };
            outcome.learner.image(&pose_of_one_time).unwrap()
        });
        (model, first == last)
    });
    assert!(still.0 == undeformed.0 && still.1 && undeformed.1);
    // One place at two times: only a network knows the difference.
    let (model, is_same) = deformed;
    let weights = model.parts[0].parameterization.shared().unwrap();
    assert!(!is_same && weights.array.values.iter().all(|value| value.is_finite()));
    assert_eq!(
        model.parts[0].table.arrays.len(),
        still.0.parts[0].table.arrays.len()
    );
}

/// Moves half of some Gaussians: the network's motion at trained times holds at another one between them, and the
/// other half stays.
#[test]
fn a_network_learns_which_gaussians_move_and_when() {
    const TIMES: [f32; 5] = [0.0, 0.25, 0.5, 0.75, 1.0];
    let model = DeformationModel {
        position_octaves: 2,
        time_octaves: 2,
        depth: 3,
        width: 32,
        skip_after: 1,
        length_unit: 2.0,
    };
    let initial = InitialGaussians {
        positions: (0..24)
            .map(|number| {
                let angle = number as f32 * 0.9;
                [
                    2.0 * angle.cos(),
                    0.1 * number as f32 - 1.0,
                    2.0 * angle.sin(),
                ]
            })
            .collect(),
        scales: vec![[0.1; 3]; 24],
        rotations: vec![static_gaussians::NO_ROTATION; 24],
        colours: vec![[0.5; 3]; 24],
        opacities: vec![0.5; 24],
    };
    let mut table = static_gaussians::table(&initial, 0);
    let mut weights =
        SharedParameters::new(DEFORMATION_WEIGHTS, model.network().initial_weights(2));
    let mut deformation = Deformation::default();
    let (mut instant, mut gradient) =
        (ActivatedGaussians::default(), ActivatedGaussians::default());
    let moved = |position: [f32; 3], time: f32| {
        let by = if position[0] > 0.0 { 0.4 * time } else { 0.0 };
        [position[0], position[1] + by, position[2]]
    };
    for step in 1..=600_u64 {
        let time = TIMES[step as usize % TIMES.len()];
        deformation.activate(&model, &weights.array.values, &table, time, &mut instant);
        gradient.clear_to_zero(&instant);
        for (index, position) in initial.positions.iter().enumerate() {
            let target = Vec3::from_array(moved(*position, time));
            let by_position = Vec3::from_array(instant.positions[index]) - target;
            gradient.positions[index] = by_position.to_array();
        }
        let both = (&mut instant, &mut gradient);
        deformation.activate_vjp(&model, &mut weights.array, &mut table, time, both);
        weights.array.learning_rate = 2e-3;
        adam::cpu::step(&mut weights.array, step, adam::SecondMomentDecay::PUBLISHED);
    }
    let between = 0.6;
    deformation.activate(&model, &weights.array.values, &table, between, &mut instant);
    for (position, found) in initial.positions.iter().zip(&instant.positions) {
        let target = Vec3::from_array(moved(*position, between));
        let error = (Vec3::from_array(*found) - target).length();
        assert!(error < 0.1, "{position:?} {found:?} {target}");
    }
}
