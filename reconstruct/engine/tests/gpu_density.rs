//! Density control on a GPU against that in memory: the same Gaussians are cloned, split and removed, whole
//! rows come out the same, and nothing of the Gaussians is read back.
#![expect(clippy::unwrap_used, reason = "a device that fails is a failed test")]

#[path = "../../tests/support/device.rs"]
#[expect(dead_code, reason = "gradients are judged elsewhere")]
mod device;
#[path = "support/same_gaussians.rs"]
mod same_gaussians;

use std::{collections::BTreeMap, sync::Arc};

use device::device;
use glam::{Mat3, Vec3};
use omnilife_engine::{
    camera::View,
    clock::Clock,
    density::{
        Densification, Densified, DensifySettings, DensityContext, LatitudeOf, SizeUnit, Threshold,
        reset_opacities,
    },
    device::Gpu,
    gaussians::{
        deformable::{Deformable, DeformationModel, settings::DeformationSettings},
        omni4dgs::{Decomposition, DirectionOrigin, VelocityForm},
        static_gaussians::{
            self, InitialGaussians, LOG_SCALES, OPACITY_LOGITS, POSITIONS, StaticGaussians,
        },
        temporal::{InitialTimes, LifespanRange, TemporalFeatures, TimeModel, VelocityModel},
    },
    model::{
        Model, Part,
        dynamic_settings::{DynamicSettings, TemporalDensity},
    },
    render::settings::{RenderSettings, RendererChoice},
    schedule::StepSchedule,
    step::{Stepper, gpu::GpuStepper, settings::TrainSettings},
    training_view::{InputViews, TrainingView},
};
use omnilife_schemas::camera::{Camera, ErpCamera};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use same_gaussians::assert_same_gaussians;

/// Bytes that the host reads of each part: how many clones, how many copies, how many that are left.
const BYTES_OF_PART: u64 = 12;
const SHORTEN_FROM: u64 = 100;

/// Views along a path, of noise.
struct Scene {
    clock: Clock,
    camera: Camera,
    input_views: Vec<TrainingView>,
}

impl Scene {
    fn new() -> Self {
        let camera = Camera::Erp(ErpCamera {
            width: 32,
            height: 16,
        });
        let random = &mut Pcg64Mcg::seed_from_u64(9);
        let view = |number: u16| {
            let at = f32::from(number);
            TrainingView {
                frame: u32::from(number),
                view: View {
                    camera,
                    rotation: Mat3::from_rotation_y(0.3 * at) * Mat3::from_rotation_x(0.1 * at),
                    centre: Vec3::new(0.4 * at - 1.0, 0.1 * at, 0.2),
                    time_seconds: f64::from(number),
                },
                pixels: (0..32 * 16 * 3).map(|_| random.random()).collect(),
                mask: None,
                ignored: None,
            }
        };
        Self {
            clock: Clock {
                origin_seconds: 3.0,
                frame_seconds: 1.0,
                duration_frames: 7.0,
            },
            camera,
            input_views: (0..7).map(view).collect(),
        }
    }

    fn inputs(&self) -> InputViews<'_> {
        InputViews {
            camera: self.camera,
            views: &self.input_views,
        }
    }
}

fn dynamics(scene: &Scene) -> DynamicSettings {
    DynamicSettings {
        clock: scene.clock,
        time: TimeModel {
            cycle_frames: 10.0,
            lifespans: Some(LifespanRange {
                least_frames: 0.25,
                largest_frames: 1e6,
            }),
            velocity: VelocityModel::Decomposed(Decomposition {
                gamma: 0.5,
                form: VelocityForm::Literal,
                origin: DirectionOrigin::Camera,
            }),
            least_marginal: 0.0,
        },
        down: [0.0, 1.0, 0.0],
        dynamic_below_staticness: 1.0,
        dynamic_loss: None,
        velocity_loss: None,
        lifespan_weight: 0.0,
        features: TemporalFeatures::default(),
        motion_weight: 0.0,
        smoothing: None,
        density: Some(TemporalDensity {
            gradient_threshold: 1.0,
            clone_lifespan_frames: 3.0,
            shorten_from_iteration: SHORTEN_FROM,
        }),
    }
}

fn train_settings(scene: &Scene) -> TrainSettings {
    TrainSettings {
        iterations: 100,
        budget_seconds: None,
        seed: 0,
        ssim_weight: 0.2,
        renderer: RendererChoice::Exact,
        rendering: RenderSettings::new(0.01),
        sh_interval_iterations: 1,
        learning_rates: BTreeMap::new(),
        short_schedule: None,
        densify: density(),
        dynamics: Some(dynamics(scene)),
        deformation: None,
        exposure: None,
        dropout: None,
        pose_refinement: None,
        shards: None,
        trace_every: 100,
    }
}

fn density() -> DensifySettings {
    DensifySettings {
        begin_iteration: 1,
        end_iteration: 100,
        interval_iterations: 1,
        opacity_reset_iterations: 0,
        opacity_recovery_iterations: 0,
        gradient_threshold: Threshold::constant(1.0),
        size_unit: SizeUnit::Distance,
        clone_size: 0.05,
        prune_size: 0.6,
        prune_size_begin_iteration: 50,
        prune_opacity: 0.02,
        maximum_gaussians: 100_000,
    }
}

fn initial(len: usize, random: &mut Pcg64Mcg) -> InitialGaussians {
    let mut three = |low: f32, high: f32| -> Vec<[f32; 3]> {
        let row = |_| [0; 3].map(|_| random.random_range(low..high));
        (0..len).map(row).collect()
    };
    let (positions, logarithms) = (three(-6.0, 6.0), three(-4.0, 0.5));
    let (colours, others) = (three(0.0, 1.0), three(-1.0, 1.0));
    InitialGaussians {
        scales: logarithms.iter().map(|row| row.map(f32::exp)).collect(),
        rotations: positions
            .iter()
            .zip(&others)
            .map(|(&[a, _, _], &[b, c, d])| [a, b, c, d])
            .collect(),
        opacities: colours.iter().map(|row| 0.004 + 0.99 * row[0]).collect(),
        positions,
        colours,
    }
}

/// Two parts, everything about which is random: parameters, moments and statistics.
fn random_model(scene: &Scene, lens: [usize; 2], seed: u64) -> Model {
    let random = &mut Pcg64Mcg::seed_from_u64(seed);
    let dynamics = dynamics(scene);
    let fixed = static_gaussians::table(&initial(lens[0], random), 1);
    let times = InitialTimes {
        peaks: (0..lens[1])
            .map(|_| random.random_range(-9.0..9.0))
            .collect(),
        lifespans: (0..lens[1])
            .map(|_| random.random_range(-1.0..4.0_f32).exp())
            .collect(),
        velocities: vec![[0.02, -0.01, 0.03]; lens[1]],
    };
    let moving = dynamics.time.table(&initial(lens[1], random), &times, 1);
    let mut model = Model::new(vec![
        Part::new(StaticGaussians, fixed),
        Part::new(dynamics.parameterization(), moving),
    ]);
    make_random(&mut model, random);
    model
}

/// Gaussians that a network deforms, everything about which is random, and the network's weights.
fn random_deformed(scene: &Scene, len: usize, seed: u64) -> Model {
    let random = &mut Pcg64Mcg::seed_from_u64(seed);
    let model = DeformationModel {
        depth: 2,
        width: 20,
        skip_after: 0,
        ..DeformationModel::published(3.0)
    };
    let settings = DeformationSettings {
        clock: scene.clock,
        model,
        warm_up_iterations: 0,
        time_noise: None,
    };
    let weights = (0..model.network().weight_count())
        .map(|_| random.random_range(-0.1..0.1))
        .collect();
    let table = static_gaussians::table(&initial(len, random), 1);
    let mut model = Model::new(vec![Part::new(Deformable::new(settings, weights), table)]);
    make_random(&mut model, random);
    model
}

/// Moments and statistics.
fn make_random(model: &mut Model, random: &mut Pcg64Mcg) {
    for part in &mut model.parts {
        let statistics = &mut part.statistics;
        for views in &mut statistics.views {
            *views = random.random_range(0..4);
        }
        for sum in statistics
            .sums
            .iter_mut()
            .chain(&mut statistics.time_gradients)
        {
            *sum = random.random_range(0.0..3.0);
        }
        for array in &mut part.table.arrays {
            for moment in array
                .first_moments
                .iter_mut()
                .chain(&mut array.second_moments)
            {
                *moment = random.random_range(0.1..1.0);
            }
        }
    }
}

/// Makes some of it no number.
fn spoil(model: &mut Model) {
    for part in &mut model.parts {
        part.statistics.sums[3] = f32::NAN;
        part.statistics.sums[5] = f32::INFINITY;
        let arrays = &mut part.table.arrays;
        arrays[OPACITY_LOGITS].values[7] = f32::NAN;
        arrays[POSITIONS].values[3 * 11 + 1] = f32::NAN;
        arrays[LOG_SCALES].values[3 * 13..3 * 14].fill(f32::NAN);
        arrays[LOG_SCALES].values[3 * 15] = f32::NAN;
    }
}

struct Case<'a> {
    what: &'a str,
    settings: DensifySettings,
    scheduled: u64,
    last_view: usize,
}

/// Densifies a model on a device and in memory; returns what was done and the device's model.
fn compare(gpu: &Arc<Gpu>, scene: &Scene, model: &Model, case: &Case<'_>) -> (Densified, Model) {
    let what = case.what;
    let settings = train_settings(scene);
    let asked = Densification {
        settings: &case.settings,
        scheduled: case.scheduled,
        context: DensityContext {
            views: &scene.input_views,
            last_view: case.last_view,
            temporal: settings.dynamics.as_ref().unwrap().density,
        },
    };
    let mut expected = model.clone();
    let mut randoms = [0; 2].map(|_| Pcg64Mcg::seed_from_u64(4));
    let done = asked.run(&mut expected, &mut randoms[0]);
    let mut stepper =
        GpuStepper::new(Arc::clone(gpu), scene.inputs(), model.clone(), &settings).unwrap();
    let begun = gpu.bytes_read();
    let found = stepper.densify(&asked, &mut randoms[1]).unwrap();
    let parts = model.parts.len() as u64;
    assert_eq!(gpu.bytes_read() - begun, BYTES_OF_PART * parts, "{what}");
    assert_eq!(found, done, "{what}");
    assert_eq!(stepper.gaussians(), expected.len(), "{what}");
    assert_eq!(randoms[0], randoms[1], "{what}: other numbers were drawn");
    let found = stepper.model().unwrap().clone();
    for (found, expected) in found.parts.iter().zip(&expected.parts) {
        assert_same_gaussians(what, found, expected);
    }
    println!("{what}: {done:?}, {} left", found.len());
    (done, found)
}

fn cases() -> Vec<Case<'static>> {
    let case = |what, settings| Case {
        what,
        settings,
        scheduled: 10,
        last_view: 3,
    };
    let by_latitude = |latitude| Threshold {
        equator: 0.4,
        pole: 1.6,
        latitude,
    };
    vec![
        case("some", density()),
        Case {
            scheduled: 60,
            ..case("large ones pruned", density())
        },
        Case {
            scheduled: SHORTEN_FROM,
            ..case("three children", density())
        },
        case(
            "one unit of length",
            DensifySettings {
                size_unit: SizeUnit::Length(3.0),
                ..density()
            },
        ),
        case(
            "latitude of the last view",
            DensifySettings {
                gradient_threshold: by_latitude(LatitudeOf::LastView),
                ..density()
            },
        ),
        case(
            "latitude of all views",
            DensifySettings {
                gradient_threshold: by_latitude(LatitudeOf::AllViews),
                ..density()
            },
        ),
        case(
            "room for a few",
            DensifySettings {
                maximum_gaussians: 3_700 + 25,
                ..density()
            },
        ),
        Case {
            scheduled: SHORTEN_FROM,
            ..case(
                "room for a few with three children",
                DensifySettings {
                    maximum_gaussians: 3_700 + 301,
                    ..density()
                },
            )
        },
        case(
            "no room",
            DensifySettings {
                // What is pruned makes none.
                maximum_gaussians: 1_000,
                ..density()
            },
        ),
    ]
}

#[test]
fn the_device_decides_as_the_host_does() {
    let Some(gpu) = device() else { return };
    let scene = Scene::new();
    let mut model = random_model(&scene, [2_200, 1_500], 1);
    spoil(&mut model);
    for case in cases() {
        let (done, found) = compare(&gpu, &scene, &model, &case);
        assert!(done.pruned > 0, "{}", case.what);
        assert_eq!(done.cloned + done.split > 0, case.what != "no room");
        if case.what == "three children" {
            // One device gives the same bits again.
            let (_, again) = compare(&gpu, &scene, &model, &case);
            let bits = |model: &Model| -> Vec<u32> {
                let arrays = model.parts.iter().flat_map(|part| &part.table.arrays);
                let values = arrays.flat_map(|array| &array.values);
                values.map(|value| value.to_bits()).collect()
            };
            assert!(bits(&found) == bits(&again));
        }
    }
}

#[test]
fn none_or_all_may_grow_and_none_or_all_may_go() {
    let Some(gpu) = device() else { return };
    let scene = Scene::new();
    let case = |what, prune_opacity| Case {
        what,
        settings: DensifySettings {
            prune_opacity,
            ..density()
        },
        scheduled: 10,
        last_view: 0,
    };
    // Fewer than a workgroup, and none of what moves.
    let mut model = random_model(&scene, [37, 0], 2);
    for part in &mut model.parts {
        part.statistics.sums.fill(0.0);
        part.statistics.time_gradients.fill(0.0);
    }
    let (done, _) = compare(&gpu, &scene, &model, &case("nothing happens", 0.001));
    assert_eq!(done, Densified::default());
    for part in &mut model.parts {
        part.statistics.sums.fill(9.0);
        part.statistics.views.fill(1);
    }
    let (done, _) = compare(&gpu, &scene, &model, &case("all grow", 0.001));
    assert_eq!((done.cloned + done.split, done.pruned), (37, 0));
    let (done, found) = compare(&gpu, &scene, &model, &case("all go", 0.9999));
    assert_eq!(
        (done.pruned, found.len()),
        (37 + done.cloned + done.split, 0)
    );
}

#[test]
fn densifications_within_a_training_read_nothing_of_the_gaussians() {
    let Some(gpu) = device() else { return };
    let scene = Scene::new();
    let settings = train_settings(&scene);
    densify_within_a_training(&gpu, &scene, &settings, random_model(&scene, [300, 200], 3));
    let settings = TrainSettings {
        dynamics: None,
        ..settings
    };
    densify_within_a_training(&gpu, &scene, &settings, random_deformed(&scene, 500, 5));
}

/// Training goes on from what the device decided: the first time into larger buffers, then within them.
fn densify_within_a_training(
    gpu: &Arc<Gpu>,
    scene: &Scene,
    settings: &TrainSettings,
    begin: Model,
) {
    let parts = begin.parts.len() as u64;
    let has_times = settings.dynamics.is_some();
    let rates: Vec<f32> = begin.trained_arrays().iter().map(|_| 1e-3).collect();
    let made_of =
        |model: Model| GpuStepper::new(Arc::clone(gpu), scene.inputs(), model, settings).unwrap();
    let mut stepper = made_of(begin);
    let steps = |stepper: &mut GpuStepper<'_>, first: u64| {
        for iteration in first..first + 3 {
            let schedule = StepSchedule {
                iteration,
                scheduled: iteration,
                sh_degree: 1,
                learning_rates: rates.clone(),
                ..StepSchedule::default()
            };
            let view = iteration as usize % scene.input_views.len();
            stepper.step(view, &schedule).unwrap();
        }
        stepper.wait().unwrap();
    };
    let room = stepper.most_gaussians();
    steps(&mut stepper, 1);
    for (first, growing) in [(4, 120), (7, 30), (10, 30)] {
        let before = stepper.model().unwrap().clone();
        let settings = DensifySettings {
            gradient_threshold: Threshold::constant(1e-6),
            maximum_gaussians: before.len() as u64 + growing,
            // Below what opacities are set down to.
            prune_opacity: 0.003,
            ..density()
        };
        let asked = Densification {
            settings: &settings,
            scheduled: first,
            context: DensityContext {
                views: &scene.input_views,
                last_view: 3,
                temporal: has_times.then_some(TemporalDensity {
                    gradient_threshold: 1e-7,
                    clone_lifespan_frames: 3.0,
                    shorten_from_iteration: 0,
                }),
            },
        };
        let random = &mut Pcg64Mcg::seed_from_u64(first);
        let mut expected = before.clone();
        let done = asked.run(&mut expected, &mut random.clone());
        assert!(done.cloned > 0 && done.split > 0, "{done:?}");
        let (begun, made) = (gpu.bytes_read(), gpu.buffers_and_bind_groups_made());
        assert_eq!(stepper.densify(&asked, random).unwrap(), done);
        assert_eq!(gpu.bytes_read() - begun, parts * BYTES_OF_PART);
        if first > 4 {
            assert_eq!(gpu.buffers_and_bind_groups_made(), made, "within its room");
        }
        let what = format!("before step {first}");
        let found = stepper.model().unwrap();
        for (found, expected) in found.parts.iter().zip(&expected.parts) {
            assert_same_gaussians(&what, found, expected);
        }
        let mut expected = found.clone();
        reset_opacities(&mut expected);
        let begun = gpu.bytes_read();
        stepper.reset_opacities().unwrap();
        assert_eq!(gpu.bytes_read(), begun);
        assert!(*stepper.model().unwrap() == expected, "{what}");
        steps(&mut stepper, first);
        // As in buffers without further room.
        let mut anew = made_of(expected);
        steps(&mut anew, first);
        assert!(
            anew.model().unwrap() == stepper.model().unwrap(),
            "after {what}"
        );
    }
    assert_eq!(stepper.take_statistics().unwrap().steps, 12);
    assert_eq!(stepper.most_gaussians(), room);
}
