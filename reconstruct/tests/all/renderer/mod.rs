//! The kernels against the f64 reference: images, gradients, seam, poles, threads.

mod pose;
mod sphere;

use glam::{DQuat, DVec3, dvec3};
use omnilife_engine::{
    camera::Camera,
    gaussians::ActivatedGaussians,
    render::{Visible, cpu::Renderer, raster::RasterGradient, settings::Footprint},
};
use omnilife_schemas::camera::PinholeCamera;
use omnilife_stability::channels::gradient_rows;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use support::{
    reference::{self, Gaussian, RefView, instant, parameter_arrays},
    scenes::{self, Richness, erp, pinhole, scene, settings, turned},
};

use crate::support;

const FOOTPRINTS: [Footprint; 2] = [Footprint::Projected, Footprint::Ray];

/// Asserts that values are close. They may differ by more where a Gaussian's 1/255 edge or the end of compositing
/// falls on different sides in f32.
fn assert_close(what: &str, values: &[f32], expected: &[f64], tolerance: f64) {
    assert_eq!(values.len(), expected.len(), "{what}");
    let mut off_by_a_switch = 0;
    for (index, (value, expected)) in values.iter().zip(expected).enumerate() {
        let error = (f64::from(*value) - expected).abs();
        if error.is_nan() || error > tolerance {
            off_by_a_switch += 1;
            assert!(
                error < 8e-3,
                "{what}, value {index}: {value} against {expected}"
            );
        }
    }
    let allowed = values.len() / 1500;
    assert!(
        off_by_a_switch <= allowed,
        "{what}: {off_by_a_switch} of {} values differ",
        expected.len()
    );
}

#[test]
fn images_are_those_of_the_reference() {
    let mut random = Pcg64Mcg::seed_from_u64(11);
    // 40 and 72 are not multiples of a tile: the seam runs through tiles.
    for camera in [erp(64), erp(40), erp(72), pinhole(50, 35)] {
        for footprint in FOOTPRINTS {
            for (rotation, sh_degree) in [(DQuat::IDENTITY, 1), (turned(), 3)] {
                let richness = Richness::new(sh_degree, 2);
                let gaussians = scene(&mut random, 60, richness);
                let centre = dvec3(0.05, -0.02, 0.04);
                let view = RefView::new(camera, rotation, centre, settings(footprint));
                let (expected, _) = reference::render(&view, &gaussians, None);
                let mut renderer = Renderer::new(view.settings);
                let raster = renderer.forward(&view.view(), &instant(&gaussians));
                let what = format!("{camera:?}, {footprint:?}");
                assert_close(&what, &raster.colour, &expected.colour, 2e-5);
                assert_close(&what, &raster.features, &expected.features, 2e-5);
            }
        }
    }
}

fn check_gradients(view: &RefView, gaussians: &[Gaussian], random: &mut Pcg64Mcg) {
    let pixels = view.camera.width() as usize * view.camera.height() as usize;
    let features = gaussians[0].features.len();
    let mut weights =
        |count: usize| -> Vec<f32> { (0..count).map(|_| random.random_range(-1.0..1.0)).collect() };
    let (by_colour, by_features) = (weights(pixels * 3), weights(pixels * features));
    let dot = |values: &[f64], weights: &[f32]| -> f64 {
        values
            .iter()
            .zip(weights)
            .map(|(a, &b)| a * f64::from(b))
            .sum()
    };
    let expected = reference::gradients(view, gaussians, |image| {
        dot(&image.colour, &by_colour) + dot(&image.features, &by_features)
    });

    let instant = instant(gaussians);
    let mut renderer = Renderer::new(view.settings);
    renderer.forward(&view.view(), &instant);
    let upstream = RasterGradient::new(&by_colour, &by_features);
    let mut gradient = ActivatedGaussians::default();
    renderer.backward(&view.view(), &instant, &upstream, &mut gradient);
    let values = gradient_rows(&instant, &gradient);

    let mut begin = 0;
    for (name, width) in parameter_arrays(&gaussians[0]) {
        let range = begin..begin + width;
        begin += width;
        let all: Vec<f64> = expected
            .iter()
            .flat_map(|row| row[range.clone()].to_vec())
            .collect();
        if all.is_empty() {
            continue;
        }
        let scale = (all.iter().map(|g| g * g).sum::<f64>() / all.len() as f64).sqrt();
        assert!(scale > 1e-3, "{name} does nothing in this scene");
        for (index, (values, expected)) in values.iter().zip(&expected).enumerate() {
            for parameter in range.clone() {
                let (value, expected) = (values[parameter], expected[parameter]);
                let error = (value - expected).abs();
                assert!(
                    error < 1e-3 * expected.abs().max(scale),
                    "{name} of Gaussian {index} ({parameter}): {value} against {expected} \
                     (typical {scale}), {:?} {:?}",
                    view.camera,
                    view.settings.footprint
                );
            }
        }
    }
}

#[test]
fn gradients_are_those_of_the_reference() {
    let mut random = Pcg64Mcg::seed_from_u64(12);
    let cases = [
        (erp(40), Footprint::Projected, 3, 1),
        (erp(48), Footprint::Projected, 0, 0),
        (erp(40), Footprint::Ray, 2, 2),
        (pinhole(36, 24), Footprint::Projected, 1, 1),
        (pinhole(36, 24), Footprint::Ray, 0, 0),
    ];
    for (camera, footprint, sh_degree, features) in cases {
        for rotation in [DQuat::IDENTITY, turned()] {
            let richness = Richness::new(sh_degree, features);
            let gaussians = scene(&mut random, 16, richness);
            let centre = dvec3(0.03, 0.02, -0.05);
            let view = RefView::new(camera, rotation, centre, settings(footprint));
            check_gradients(&view, &gaussians, &mut random);
        }
    }
}

/// Checks a Gaussian that is nearly opaque in every pixel: where opacity is clamped, its gradient is that of the
/// unclamped one.
#[test]
fn gradients_of_an_opaque_gaussian_are_those_of_the_reference() {
    let mut random = Pcg64Mcg::seed_from_u64(13);
    let camera = PinholeCamera::with_horizontal_field_of_view(24, 16, 0.05);
    let (front, back) = (dvec3(0.1, -0.05, 1.0), dvec3(0.0, 0.02, 1.0));
    let gaussians = [
        scenes::at(front, 3.0, [0.9, 0.8, 0.7], 0.9999).rounded(),
        scenes::at(back, 5.0, [0.9, 0.8, 0.7], 0.9999).rounded(),
    ];
    for footprint in FOOTPRINTS {
        let settings = settings(footprint);
        let view = RefView::new(
            Camera::Pinhole(camera),
            DQuat::IDENTITY,
            DVec3::ZERO,
            settings,
        );
        check_gradients(&view, &gaussians, &mut random);
    }
}

/// Checks that a stored degree above the drawn one has no effect and gets no gradient.
#[test]
fn harmonics_above_the_drawn_degree_are_not_there() {
    let mut random = Pcg64Mcg::seed_from_u64(16);
    let rich = Richness::new(3, 0);
    let gaussians = scene(&mut random, 30, rich);
    let mut plain = gaussians.clone();
    for gaussian in &mut plain {
        gaussian.sh.truncate(4);
    }
    let mut settings = settings(Footprint::Projected);
    settings.sh_degree = 1;
    let view = RefView::new(erp(64), turned(), DVec3::ZERO, settings).view();
    let upstream = vec![1.0; 64 * 32 * 3];
    let upstream = RasterGradient::new(&upstream, &[]);
    let [rich, plain] = [&gaussians, &plain].map(|gaussians| {
        let instant = instant(gaussians);
        let mut renderer = Renderer::new(settings);
        let image = renderer.forward(&view, &instant).clone();
        let mut gradient = ActivatedGaussians::default();
        renderer.backward(&view, &instant, &upstream, &mut gradient);
        (image, gradient)
    });
    assert_eq!(rich.0, plain.0);
    assert_eq!(rich.1.positions, plain.1.positions);
    for (rich, plain) in rich.1.sh_rest.chunks(15).zip(plain.1.sh_rest.chunks(3)) {
        assert_eq!(&rich[..3], plain);
        assert!(rich[3..].iter().all(|row| *row == [0.0; 3]));
    }
}

/// A backward pass without a forward pass before it renders the view itself.
#[test]
fn gradients_without_an_earlier_image_are_those_of_the_view() {
    let mut random = Pcg64Mcg::seed_from_u64(15);
    let plain = Richness::new(0, 0);
    let gaussians = instant(&scene(&mut random, 40, plain));
    for settings in FOOTPRINTS.map(settings) {
        let view = RefView::new(erp(64), turned(), DVec3::ZERO, settings).view();
        let colour = vec![1.0; 64 * 32 * 3];
        let upstream = RasterGradient::new(&colour, &[]);
        let [alone, behind_image] = [false, true].map(|draws| {
            let mut renderer = Renderer::new(settings);
            if draws {
                renderer.forward(&view, &gaussians);
            }
            let mut gradient = ActivatedGaussians::default();
            renderer.backward(&view, &gaussians, &upstream, &mut gradient);
            gradient
        });
        assert!(alone.positions.iter().flatten().any(|&value| value != 0.0));
        assert_eq!(alone, behind_image);
    }
}

#[test]
fn results_do_not_depend_on_the_number_of_threads() {
    let mut random = Pcg64Mcg::seed_from_u64(14);
    let richness = Richness::new(2, 1);
    let gaussians = scene(&mut random, 3000, richness);
    let instant = instant(&gaussians);
    let view = RefView::new(
        erp(96),
        turned(),
        DVec3::ZERO,
        settings(Footprint::Projected),
    );
    let mut weights =
        |count: usize| -> Vec<f32> { (0..count).map(|_| random.random_range(-1.0..1.0)).collect() };
    let (by_colour, by_features) = (weights(96 * 48 * 3), weights(96 * 48));
    let upstream = RasterGradient::new(&by_colour, &by_features);
    let run = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads);
        pool.build().unwrap().install(|| {
            let mut renderer = Renderer::new(view.settings);
            let image = renderer.forward(&view.view(), &instant).clone();
            let mut gradient = ActivatedGaussians::default();
            renderer.backward(&view.view(), &instant, &upstream, &mut gradient);
            (image, gradient)
        })
    };
    assert_eq!(run(1), run(3));
}

/// Checks that gradients of some consecutive Gaussians are those of all, to the last bit.
#[test]
fn some_gaussians_learn_what_they_learn_among_all() {
    let mut random = Pcg64Mcg::seed_from_u64(15);
    let richness = Richness::new(1, 1);
    let gaussians = scene(&mut random, 700, richness);
    let instant = instant(&gaussians);
    for (camera, footprint) in [
        (erp(96), Footprint::Projected),
        (erp(64), Footprint::Ray),
        (pinhole(70, 50), Footprint::Projected),
    ] {
        let view = RefView::new(camera, turned(), DVec3::ZERO, settings(footprint));
        let mut renderer = Renderer::new(view.settings);
        let raster = renderer.forward(&view.view(), &instant).clone();
        let mut weights = |count: usize| -> Vec<f32> {
            (0..count).map(|_| random.random_range(-1.0..1.0)).collect()
        };
        let (colour, features) = (weights(raster.colour.len()), weights(raster.features.len()));
        let upstream = RasterGradient::new(&colour, &features);
        let mut all = ActivatedGaussians::default();
        renderer.backward(&view.view(), &instant, &upstream, &mut all);
        let seen: Vec<Visible> = renderer.visible().collect();
        let mut seen_in_shards = Vec::new();
        for range in [0..301, 301..302, 302..302, 302..700] {
            let mut of_shard = ActivatedGaussians::default();
            renderer.backward_of(
                range.clone(),
                &view.view(),
                &instant,
                &upstream,
                &mut of_shard,
            );
            let mut expected = ActivatedGaussians::default();
            expected.copy_entries(&all, range);
            assert_eq!(of_shard, expected);
            seen_in_shards.extend(renderer.visible());
        }
        assert_eq!(seen_in_shards, seen);
        assert!(seen.len() > 100, "{}", seen.len());
    }
}

/// Checks that a render does not depend on earlier renders.
#[test]
fn a_renderer_has_no_memory() {
    let mut random = Pcg64Mcg::seed_from_u64(18);
    let rich = Richness::new(1, 2);
    let (large, small) = (scene(&mut random, 80, rich), scene(&mut random, 20, rich));
    let views = [
        RefView::new(
            erp(64),
            turned(),
            DVec3::ZERO,
            settings(Footprint::Projected),
        ),
        RefView::new(
            pinhole(40, 30),
            DQuat::IDENTITY,
            DVec3::ZERO,
            settings(Footprint::Projected),
        ),
    ];
    let draw = |renderer: &mut Renderer, view: &RefView, gaussians: &[Gaussian]| {
        let instant = instant(gaussians);
        let raster = renderer.forward(&view.view(), &instant).clone();
        let ones = vec![1.0; raster.colour.len().max(raster.features.len())];
        let upstream = RasterGradient {
            colour: &ones[..raster.colour.len()],
            features: &ones[..raster.features.len()],
        };
        let mut gradient = ActivatedGaussians::default();
        renderer.backward(&view.view(), &instant, &upstream, &mut gradient);
        (raster, gradient)
    };
    let fresh = || Renderer::new(views[0].settings);
    let mut used = fresh();
    draw(&mut used, &views[0], &large);
    for (view, gaussians) in [
        (&views[1], &large),
        (&views[0], &small),
        (&views[1], &small),
    ] {
        assert_eq!(
            draw(&mut used, view, gaussians),
            draw(&mut fresh(), view, gaussians)
        );
    }
}

#[test]
fn hopeless_gaussians_are_left_out_and_harm_nothing() {
    let mut random = Pcg64Mcg::seed_from_u64(15);
    let richness = Richness::new(1, 0);
    let mut gaussians = instant(&scene(&mut random, 30, richness));
    let clean = gaussians.clone();
    let changes: [fn(&mut ActivatedGaussians); 8] = [
        |g| g.positions[30] = [f32::NAN, 0.0, 1.0],
        |g| g.positions[30] = [0.0; 3],
        |g| g.positions[30] = [f32::INFINITY, 0.0, 0.0],
        |g| g.scales[30] = [f32::INFINITY, 1.0, 1.0],
        |g| g.scales[30] = [f32::NAN; 3],
        |g| g.opacities[30] = f32::NAN,
        |g| g.opacities[30] = 1e-9,
        |g| g.rotations[30] = [f32::NAN; 4],
    ];
    gaussians.reshape(31, 1, 0);
    for (camera, footprint) in [erp(64), pinhole(40, 30)]
        .into_iter()
        .flat_map(|c| FOOTPRINTS.map(|f| (c, f)))
    {
        let view = RefView::new(camera, DQuat::IDENTITY, DVec3::ZERO, settings(footprint));
        let mut renderer = Renderer::new(view.settings);
        let expected = renderer.forward(&view.view(), &clean).clone();
        for (number, change) in changes.iter().enumerate() {
            let mut degenerate = gaussians.clone();
            degenerate.positions[30] = [0.0, 0.0, 2.0];
            degenerate.scales[30] = [0.1; 3];
            degenerate.rotations[30] = [1.0, 0.0, 0.0, 0.0];
            degenerate.opacities[30] = 0.5;
            change(&mut degenerate);
            let raster = renderer.forward(&view.view(), &degenerate);
            assert_eq!(
                raster, &expected,
                "change {number}, {camera:?} {footprint:?}"
            );
            let ones = vec![1.0; raster.colour.len()];
            let upstream = RasterGradient::new(&ones, &[]);
            let mut gradient = ActivatedGaussians::default();
            renderer.backward(&view.view(), &degenerate, &upstream, &mut gradient);
            assert_eq!(gradient.positions[30], [0.0; 3]);
            assert_eq!(gradient.scales[30], [0.0; 3]);
            let is_finite = gradient
                .positions
                .as_flattened()
                .iter()
                .all(|g| g.is_finite());
            assert!(is_finite, "change {number}");
        }
    }
}
