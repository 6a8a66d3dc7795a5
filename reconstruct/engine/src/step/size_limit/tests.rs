//! Gaussians that are too large for a view.

use std::f32::consts::PI;

use glam::Mat3;
use omnilife_schemas::camera::{ErpCamera, PinholeCamera};

use super::*;
use crate::{
    camera::Camera,
    clock::Clock,
    device::test_device,
    gaussians::{
        deformable::{DeformationModel, settings::DeformationSettings},
        parameterization::Viewpoint,
        static_gaussians::{self, InitialGaussians},
        temporal::TemporalFeatures,
    },
    parameters::{ParameterArray, adam::SecondMomentDecay},
    schedule::StepSchedule,
    step::{BackendChoice, settings::tests::settings, stepper},
    training_view::{InputViews, TrainingView},
};

const PANORAMA: Camera = Camera::Erp(ErpCamera::new(32, 16));

fn view(camera: Camera, rotation: Mat3) -> View {
    View {
        camera,
        rotation,
        centre: Vec3::ZERO,
        time_seconds: 0.0,
    }
}

/// Returns Gaussians two units away: one with two axes that are too long, one that is nearly too large, a faint one,
/// and one on the other side.
fn four() -> Model {
    let before = [0.0, 0.0, 2.0];
    let mut initial = InitialGaussians::isotropic(
        vec![before, before, before, [0.0, 0.0, -2.0]],
        &[3.0, 1.9, 3.0, 3.0],
        vec![[0.5; 3]; 4],
        vec![0.5, 0.5, 0.003, 0.5],
    );
    initial.scales[0] = [3.0, 0.2, 2.5];
    let mut model = Model::of_static(static_gaussians::table(&initial, 0));
    let sizes = &mut model.parts[0].table.arrays[LOG_SCALES];
    sizes.first_moments.fill(1.0);
    model
}

fn sizes(model: &Model) -> &ParameterArray {
    &model.parts[0].table.arrays[LOG_SCALES]
}

/// Checks the axes of the four Gaussians after the limit for a view: those that it cuts are half of the distance
/// long, without first moments, and all others keep their bits.
fn assert_cut(view: &View, is_cut: [[bool; 3]; 4]) {
    let mut model = four();
    let at = Viewpoint::of_image(view);
    let mut activated = ActivatedGaussians::default();
    model.activate(&at, &TemporalFeatures::default(), &mut activated);
    let limit = SizeLimit::of(&model, &settings(None)).expect("sizes learn");
    limit.cut(&mut model, &mut activated, view);
    let begin = four();
    for (index, is_cut) in is_cut.as_flattened().iter().enumerate() {
        let value = sizes(&model).values[index];
        let moment = sizes(&model).first_moments[index];
        if *is_cut {
            assert!(
                value.abs() < 1e-5 && moment == 0.0,
                "{index}: {value} {moment}"
            );
            assert_eq!(activated.scales.as_flattened()[index], 1.0, "{index}");
        } else {
            assert_eq!(value, sizes(&begin).values[index], "{index}");
            assert_eq!(moment, 1.0, "{index}");
        }
    }
}

/// Returns views with the axes of the four Gaussians that each cuts.
fn cases() -> [(View, [[bool; 3]; 4]); 3] {
    let two_axes = [true, false, true];
    let (all, none) = ([true; 3], [false; 3]);
    let pinhole = PinholeCamera::with_horizontal_field_of_view(32, 16, 1.5);
    let pinhole = |rotation| view(Camera::Pinhole(pinhole), rotation);
    [
        (view(PANORAMA, Mat3::IDENTITY), [two_axes, none, none, all]),
        (pinhole(Mat3::IDENTITY), [two_axes, none, none, none]),
        (pinhole(Mat3::from_rotation_y(PI)), [none, none, none, all]),
    ]
}

#[test]
fn what_a_view_leaves_out_for_its_size_is_cut_and_what_it_draws_keeps_its_bits() {
    for (view, is_cut) in cases() {
        assert_cut(&view, is_cut);
    }
}

#[test]
fn sizes_are_free_where_all_are_drawn_and_where_they_do_not_learn() {
    let mut free = settings(None);
    free.rendering.footprint = Footprint::Ray;
    assert_eq!(SizeLimit::of(&four(), &free), None);
    let mut published = settings(None);
    published.renderer = RendererChoice::OdgsPublished;
    assert_eq!(SizeLimit::of(&four(), &published), None);
    let mut frozen = four();
    frozen.parts[0].table.freeze(LOG_SCALES);
    assert_eq!(SizeLimit::of(&frozen, &settings(None)), None);
    let mut deformed = settings(None);
    deformed.deformation = Some(DeformationSettings {
        clock: Clock::new(0.0, 0.1, 10.0),
        model: DeformationModel::published(1.0),
        warm_up_iterations: 0,
        time_noise: None,
    });
    assert_eq!(SizeLimit::of(&four(), &deformed), None);
}

/// Returns the loss of a step of a model on a grey image, and the sizes after it. Nothing learns.
fn step(backend: BackendChoice, model: Model, view: View) -> (f64, ParameterArray) {
    let views = [TrainingView {
        frame: 0,
        view,
        pixels: vec![153; 32 * 16 * 3],
        mask: None,
        ignored: None,
    }];
    let inputs = InputViews {
        camera: view.camera,
        views: &views,
    };
    let schedule = StepSchedule {
        iteration: 1,
        learning_rates: model.trained_arrays().iter().map(|_| 0.0).collect(),
        second_moments: SecondMomentDecay::PUBLISHED,
        ..StepSchedule::default()
    };
    let mut stepper = stepper(inputs, model, &settings(None), backend).expect("static Gaussians");
    stepper.step(0, &schedule).expect("a finite loss");
    let loss = stepper.take_statistics().expect("finite losses").loss;
    let model = stepper.model().expect("a model");
    (loss, sizes(model).clone())
}

/// Returns the loss of a step on a grey image, and the sizes after it, of grey Gaussians of a size two units away in
/// all directions.
fn step_of_grey(backend: BackendChoice, size: f32) -> (f64, Vec<f32>) {
    let place = |index: usize| {
        let y = 1.0 - (index as f32 + 0.5) / 200.0;
        let (sin, cos) = (2.399_963 * index as f32).sin_cos();
        let rho = (1.0 - y * y).sqrt();
        [2.0 * rho * cos, 2.0 * y, 2.0 * rho * sin]
    };
    let grey = InitialGaussians::isotropic(
        (0..400).map(place).collect(),
        &[size; 400],
        vec![[0.6; 3]; 400],
        vec![0.95; 400],
    );
    let model = Model::of_static(static_gaussians::table(&grey, 0));
    let (loss, sizes) = step(backend, model, view(PANORAMA, Mat3::IDENTITY));
    (loss, sizes.values)
}

/// Checks that Gaussians of one and a half times their distance, all of which a render leaves out, show the image of
/// their colour: a transmittance of 1e-3 at most is left, against a loss of 0.48 for a black image.
fn assert_shown(backend: BackendChoice) {
    let (loss, sizes) = step_of_grey(backend, 3.0);
    assert!(loss < 0.01, "{loss}");
    assert!(sizes.iter().all(|size| size.abs() < 1e-5), "{sizes:?}");
    let (loss, sizes) = step_of_grey(backend, 1.9);
    assert!(loss < 0.01, "{loss}");
    assert!(sizes.iter().all(|&size| size == 1.9_f32.ln()), "{sizes:?}");
}

#[test]
fn a_scene_of_gaussians_that_are_all_too_large_is_shown() {
    assert_shown(BackendChoice::Cpu);
}

/// Checks that both backends cut the same axes of the four Gaussians, to the same sizes and moments.
fn assert_cut_alike(view: View, is_cut: [[bool; 3]; 4]) {
    let [cpu, gpu] =
        [BackendChoice::Cpu, BackendChoice::Gpu].map(|backend| step(backend, four(), view).1);
    for (index, &is_cut) in is_cut.as_flattened().iter().enumerate() {
        let [on_cpu, on_gpu] = [&cpu, &gpu].map(|sizes| sizes.values[index]);
        assert!((on_cpu - on_gpu).abs() < 1e-5, "{index}: {on_cpu} {on_gpu}");
        let [on_cpu, on_gpu] = [&cpu, &gpu].map(|sizes| sizes.first_moments[index]);
        assert!((on_cpu - on_gpu).abs() < 1e-3, "{index}: {on_cpu} {on_gpu}");
        // A step leaves nine tenths of a moment, and adds a tenth of a gradient.
        assert_eq!(on_gpu < 0.5, is_cut, "{index}: {on_gpu}");
    }
}

#[test]
fn a_gpu_cuts_as_the_cpu() {
    if test_device().is_some() {
        assert_shown(BackendChoice::Gpu);
        for (view, is_cut) in cases() {
            assert_cut_alike(view, is_cut);
        }
    }
}
