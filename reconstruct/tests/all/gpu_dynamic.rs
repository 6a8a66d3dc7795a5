//! Steps of dynamic methods on a GPU against the CPU, with every kind of velocity and every loss.

use std::sync::Arc;

use device::{assert_gradients_agree, devices};
use glam::DVec3;
use held_camera::scene;
use omnilife_engine::{
    device::Gpu,
    gaussians::{
        dropout::Dropout,
        omni4dgs::{Decomposition, DirectionOrigin, VelocityForm},
        static_gaussians::{self, InitialGaussians, StaticGaussians},
        temporal::{
            InitialTimes, LOG_LIFESPANS, LifespanFeature, PEAK_TIMES, RADIAL_VELOCITIES,
            TANGENTIAL_VELOCITIES, TemporalFeatures, VELOCITIES, VelocityModel,
        },
        tracked::{self, TrackedGaussians, TrackedObject},
    },
    model::{
        Model, Part, Statistics,
        dynamic_settings::{DynamicLoss, DynamicSettings, MotionForm, MotionLoss, VelocityLoss},
        exposure::Exposure,
        pose_corrections::PoseCorrections,
    },
    parameters::ParameterTable,
    render::settings::RenderSettings,
    schedule::StepSchedule,
    step::{
        Stepper, cpu::CpuStepper, gpu::GpuStepper, pose_refinement::PoseRefinement,
        settings::TrainSettings,
    },
    trajectories::rigid_path::RigidPath,
};
use omnilife_reconstruct::{baseline, scene::TrainingScene, seeds::points};
use omnilife_schemas::{
    points::PointCloud,
    records::Backend,
    trajectory::{BSpline, ObjectPath},
};

use crate::support::{device, held_camera, random_models};

fn initial(scene: &TrainingScene, first: usize) -> InitialGaussians {
    let every = |rows: &[[f32; 3]]| rows.iter().skip(first).step_by(8).copied().collect();
    let points = PointCloud {
        positions: every(&scene.points.positions),
        colours: scene
            .points
            .colours
            .iter()
            .skip(first)
            .step_by(8)
            .copied()
            .collect(),
    };
    points::from_points(&points, 3.0)
}

/// Varies values from Gaussian to Gaussian: no gradient vanishes.
fn vary(table: &mut ParameterTable, name: &str, size: f32) {
    let Some(array) = table.position(name) else {
        return;
    };
    for (index, value) in table.arrays[array].values.iter_mut().enumerate() {
        *value += size * (1.7 * index as f32).sin();
    }
}

/// Returns Gaussians of a box that crosses the views, on a path.
fn crossing_box(scene: &TrainingScene) -> Part {
    let path = ObjectPath {
        centre: BSpline {
            degree: 1,
            knots: BSpline::uniform_knots(1, 2, 0.0, 14.0),
            coefficients: vec![[-0.7, 0.2, 3.0], [0.7, 0.2, 3.0]],
        },
        heading_seconds: vec![0.0],
        headings: vec![0.3],
    };
    let object = TrackedObject {
        id: 5,
        dimensions: [1.4; 3].map(|side| (side * scene.normalization.scale) as f32),
        path: RigidPath::new(&path, -DVec3::Y, 0.7, 1, &scene.normalization),
    };
    let half = object.half_box();
    let mut gaussians = InitialGaussians::default();
    for index in 0..40 {
        let place = |axis: usize| half[axis] * (1.3 * (index * (axis + 1)) as f32).sin();
        gaussians.push_isotropic([0, 1, 2].map(place), 0.1, [0.8, 0.3, 0.2], 0.5);
    }
    let mut table = tracked::table(&gaussians, &[0; 40]);
    vary(&mut table, "log_scales", 0.4);
    vary(&mut table, "quaternions", 0.5);
    Part::new(TrackedGaussians::new(vec![object], false), table)
}

/// Returns static Gaussians, and moving ones: some with lifespans of two frames, some of sixty; and those of an object
/// where the settings have objects.
fn model(scene: &TrainingScene, settings: &TrainSettings) -> Model {
    let dynamics = settings.dynamics.as_ref().unwrap();
    let mut fixed = static_gaussians::table(&initial(scene, 0), 1);
    let moving = initial(scene, 4);
    let len = moving.positions.len();
    let times = InitialTimes::constant(len, 0.0, 10.0);
    let mut table = dynamics.time.table(&moving, &times, 1);
    for table in [&mut fixed, &mut table] {
        vary(table, "log_scales", 0.4);
        vary(table, "quaternions", 0.5);
        vary(table, "sh_rest", 0.05);
    }
    for (name, size) in [
        (PEAK_TIMES, 7.0),
        (LOG_LIFESPANS, 1.7),
        (VELOCITIES, 0.03),
        (RADIAL_VELOCITIES, 0.03),
        (TANGENTIAL_VELOCITIES, 0.05),
    ] {
        vary(&mut table, name, size);
    }
    let mut model = Model::new(vec![
        Part::new(StaticGaussians, fixed),
        Part::new(dynamics.parameterization(), table),
    ]);
    if settings.objects {
        model.parts.push(crossing_box(scene));
    }
    let views = &scene.input_views;
    let seconds = views.iter().map(|view| view.view.time_seconds).collect();
    let refines_poses = settings.pose_refinement.is_some();
    model.poses = refines_poses.then(|| PoseCorrections::new(seconds));
    model
}

fn dynamics(scene: &TrainingScene, velocity: VelocityModel) -> DynamicSettings {
    let mut dynamics = random_models::dynamics(scene.clock().unwrap());
    dynamics.time.velocity = velocity;
    dynamics.density = None;
    dynamics
}

/// Returns PVG's settings with both of its losses on maps.
fn periodic(scene: &TrainingScene) -> TrainSettings {
    let mut dynamics = dynamics(scene, VelocityModel::Free);
    dynamics.time.least_marginal = 0.05;
    dynamics.velocity_loss = Some(VelocityLoss {
        weight: 0.3,
        outside_masks: false,
    });
    dynamics.lifespan_weight = 0.2;
    dynamics.features = TemporalFeatures {
        velocity_unit: Some(0.05),
        lifespan: Some(LifespanFeature {
            unit_frames: 50.0,
            largest_frames: 30.0,
        }),
    };
    settings(dynamics)
}

/// Returns Omni4DGS's settings with all of its losses, with larger weights.
fn omni4dgs(scene: &TrainingScene, form: VelocityForm, origin: DirectionOrigin) -> TrainSettings {
    let decomposition = Decomposition {
        gamma: 0.5,
        form,
        origin,
    };
    let mut dynamics = dynamics(scene, VelocityModel::Decomposed(decomposition));
    dynamics.dynamic_loss = Some(DynamicLoss {
        weight: 0.4,
        ssim_weight: 0.3,
        begin_iteration: 2,
    });
    dynamics.velocity_loss = Some(VelocityLoss {
        weight: 0.3,
        outside_masks: true,
    });
    dynamics.features.velocity_unit = Some(0.05);
    dynamics.motion_loss = Some(MotionLoss {
        weight: 3.0,
        form: MotionForm::Mean,
    });
    settings(dynamics)
}

fn settings(dynamics: DynamicSettings) -> TrainSettings {
    TrainSettings {
        rendering: RenderSettings {
            background: [0.1, 0.3, 0.2],
            ..RenderSettings::new(0.01)
        },
        dynamics: Some(dynamics),
        ..baseline::published_settings(100)
    }
}

/// Returns a rate for every array of a model.
fn rates(model: &Model) -> Vec<f32> {
    let rate = |name: &str| match name {
        "positions" => 2e-3,
        "opacity_logits" => 0.05,
        PEAK_TIMES => 0.04,
        VELOCITIES | RADIAL_VELOCITIES | TANGENTIAL_VELOCITIES => 1e-3,
        _ => 2.5e-3,
    };
    let arrays = model.trained_arrays();
    arrays.iter().map(|array| rate(array.name)).collect()
}

fn compare(what: &str, scene: &TrainingScene, settings: &TrainSettings) {
    for gpu in devices() {
        compare_on(&gpu, what, scene, settings);
    }
}

fn compare_on(gpu: &Arc<Gpu>, what: &str, scene: &TrainingScene, settings: &TrainSettings) {
    let begins = || model(scene, settings);
    let rates = rates(&begins());
    let mut on_gpu = GpuStepper::new(Arc::clone(gpu), scene.inputs(), begins(), settings).unwrap();
    let mut on_cpu = CpuStepper::new(scene.inputs(), begins(), settings);
    assert!(matches!(on_gpu.backend(), Backend::Gpu { .. }));
    for iteration in 1..=4 {
        let schedule = StepSchedule {
            iteration,
            scheduled: iteration,
            sh_degree: 1,
            shift_frames: [0.0, 0.7, 0.0, -1.2][iteration as usize - 1],
            learning_rates: rates.clone(),
            ..StepSchedule::default()
        };
        on_gpu.step(2 + iteration as usize, &schedule).unwrap();
        on_cpu.step(2 + iteration as usize, &schedule).unwrap();
        if iteration == 2 {
            compare_gradients(
                &format!("{what}, step {iteration}"),
                &mut on_gpu,
                &mut on_cpu,
            );
        }
    }
    let sums = [
        on_gpu.take_statistics().unwrap(),
        on_cpu.take_statistics().unwrap(),
    ];
    let [gpu, cpu] = sums.each_ref().map(|sums| (sums.loss, sums.squared_error));
    assert!(
        (gpu.0 - cpu.0).abs() < 1e-5 * cpu.0.abs(),
        "{what}: {gpu:?} {cpu:?}"
    );
    assert!(
        (gpu.1 - cpu.1).abs() < 1e-5 * cpu.1,
        "{what}: {gpu:?} {cpu:?}"
    );
    assert_eq!(sums[0].refused, vec![0; rates.len()], "{what}");
    let view = &scene.novel_views[0].view;
    let images = [
        on_gpu.image(view, 1).unwrap(),
        on_cpu.image(view, 1).unwrap(),
    ];
    let pairs = images[0].data.iter().zip(&images[1].data);
    let error: f32 = pairs.map(|(a, b)| (a - b).abs()).sum();
    let mean = error / images[0].data.len() as f32;
    assert!(mean < 1e-3, "{what}: images differ by {mean}");
}

fn compare_gradients(what: &str, on_gpu: &mut GpuStepper<'_>, on_cpu: &mut CpuStepper<'_>) {
    let of_gpu = on_gpu.model_with_gradients().unwrap();
    let of_cpu = on_cpu.model().unwrap();
    for (gpu, cpu) in of_gpu.parts.iter().zip(&of_cpu.parts) {
        for (gpu, cpu) in gpu.table.arrays.iter().zip(&cpu.table.arrays) {
            let name = format!("{what}, {}", gpu.name);
            assert_gradients_agree(&name, &gpu.gradients, &cpu.gradients);
        }
        let Statistics {
            sums,
            views,
            time_gradients,
        } = &gpu.statistics;
        assert_eq!(views, &cpu.statistics.views, "{what}");
        assert_gradients_agree(what, sums, &cpu.statistics.sums);
        assert_gradients_agree(what, time_gradients, &cpu.statistics.time_gradients);
    }
    for (gpu, cpu) in of_gpu.poses.iter().zip(&of_cpu.poses) {
        for (gpu, cpu) in gpu.table.arrays.iter().zip(&cpu.table.arrays) {
            assert_gradients_agree(gpu.name, &gpu.first_moments, &cpu.first_moments);
        }
    }
}

#[test]
fn steps_of_periodic_gaussians_are_those_of_the_cpu() {
    let scene = scene();
    compare("periodic", &scene, &periodic(&scene));
}

#[test]
fn steps_of_omni4dgs_are_those_of_the_cpu() {
    let scene = scene();
    for form in [VelocityForm::Literal, VelocityForm::Projected] {
        let settings = omni4dgs(&scene, form, DirectionOrigin::World);
        compare(&format!("{form:?}"), &scene, &settings);
    }
}

/// Checks steps with gains removed from the images, poses that move, and Gaussians left out; half of the views
/// have no mask.
#[test]
fn steps_with_gains_poses_and_dropout_are_those_of_the_cpu() {
    let mut scene = scene();
    for view in scene.input_views.iter_mut().step_by(2) {
        view.mask = None;
    }
    let pair = |gain: f32| {
        let pair = move |point: usize| {
            let level = 0.1 + 0.004 * point as f32;
            [[level * gain; 3], [level; 3]]
        };
        (0..100).map(pair).collect::<Vec<_>>()
    };
    let exposure = Exposure::estimate(&[(0.0, pair(0.8)), (14.0, pair(1.25))]);
    let settings = TrainSettings {
        exposure: Some(exposure.unwrap()),
        pose_refinement: Some(PoseRefinement { begin_iteration: 2 }),
        dropout: Some(Dropout {
            last_share: 0.4,
            iterations: 2,
            seed: 5,
        }),
        ..omni4dgs(&scene, VelocityForm::Literal, DirectionOrigin::Camera)
    };
    compare("gains, poses and dropout", &scene, &settings);
}

/// Checks steps with an object beside Gaussians with times: for the losses on maps it is dynamic and without velocity.
#[test]
fn steps_with_an_object_beside_times_are_those_of_the_cpu() {
    let scene = scene();
    let settings = TrainSettings {
        objects: true,
        ..periodic(&scene)
    };
    compare("an object", &scene, &settings);
}

/// Checks models in which only the opacity depends on time, and only the position.
#[test]
fn steps_with_parts_of_time_left_out_are_those_of_the_cpu() {
    let scene = scene();
    let mut fading = dynamics(&scene, VelocityModel::None);
    fading.time.least_marginal = 0.05;
    compare("no motion", &scene, &settings(fading));
    let mut moving = dynamics(&scene, VelocityModel::Free);
    moving.time.lifespans = None;
    // A pixel is 0.065 radians here: about as much for a Gaussian as above.
    moving.motion_loss = Some(MotionLoss {
        weight: 0.3,
        form: MotionForm::Seen,
    });
    compare("no lifespans", &scene, &settings(moving));
}
