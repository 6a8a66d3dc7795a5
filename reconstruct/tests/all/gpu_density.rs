//! Density control on a GPU compared with that in memory: the same Gaussians are cloned, split and removed,
//! whole rows are equal, and no Gaussians are read back.

use crate::support::{device, random_models, same_gaussians};
use std::sync::Arc;

use device::device;
use omnilife_engine::{
    density::{
        Densification, Densified, DensifySettings, DensityContext, LatitudeOf, SizeUnit, Threshold,
        reset_opacities,
    },
    device::Gpu,
    model::{Model, dynamic_settings::TemporalDensity},
    schedule::StepSchedule,
    step::{Stepper, gpu::GpuStepper, settings::TrainSettings},
};
use rand::SeedableRng;
use rand_pcg::Pcg64Mcg;
use random_models::{
    SHORTEN_FROM, Scene, density, random_deformed, random_model, random_objects, spoil,
    train_settings,
};
use same_gaussians::assert_same_gaussians;

/// Bytes that the host reads per part: numbers of clones, of all copies and of remaining rows.
const BYTES_OF_PART: u64 = 12;

struct Case<'a> {
    what: &'a str,
    settings: DensifySettings,
    scheduled: u64,
    last_view: usize,
}

/// Densifies a model on a device and in memory; returns the counts and the device's model.
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
                // Pruned Gaussians make no room.
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
            // A device reproduces the same bits.
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
    // Fewer than a workgroup, and no moving Gaussians.
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
    densify_within_a_training(&gpu, &scene, &settings, random_objects([300, 200], 6));
}

/// Trains on from the device's decision: first into larger buffers, then within them.
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
    let (mut cloned, mut split) = (0, 0);
    for (first, growing) in [(4, 120), (7, 30), (10, 30)] {
        let before = stepper.model().unwrap().clone();
        let settings = DensifySettings {
            gradient_threshold: Threshold::constant(1e-6),
            maximum_gaussians: before.len() as u64 + growing,
            // Below the upper bound of an opacity reset.
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
        cloned += done.cloned;
        split += done.split;
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
        // The same as in buffers without spare capacity.
        let mut anew = made_of(expected);
        steps(&mut anew, first);
        assert!(
            anew.model().unwrap() == stepper.model().unwrap(),
            "after {what}"
        );
    }
    assert!(cloned > 0 && split > 0, "{cloned} {split}");
    assert_eq!(stepper.take_statistics().unwrap().steps, 12);
    assert_eq!(stepper.most_gaussians(), room);
}
