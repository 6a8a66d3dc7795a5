//! The GPU backend on any adapter: images against the f64 reference, gradients against those of the CPU, which
//! the reference judges in `renderer/`.

use std::sync::Arc;

use device::{assert_gradients_agree, device, devices};
use glam::{DQuat, dvec3};
use omnilife_engine::{
    camera::Camera,
    device::{Gpu, GpuError},
    gaussians::ActivatedGaussians,
    render::{
        Visible,
        cpu::Renderer,
        gpu::GpuRenderer,
        raster::{Raster, RasterGradient},
        settings::Footprint,
    },
};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use support::{
    reference::{self, Gaussian, RefView, instant},
    scenes::{Richness, at, erp, pinhole, scene, settings, turned},
};

use crate::support;
use crate::support::device;

const PLAIN: Richness = Richness::new(0, 0);

fn view(camera: Camera, rotation: DQuat, footprint: Footprint) -> RefView {
    RefView::new(
        camera,
        rotation,
        dvec3(0.05, -0.02, 0.04),
        settings(footprint),
    )
}

/// Asserts that every value is within 1e-3. A few pixels are exempt: there a Gaussian at the very edge of its
/// footprint, or the end of compositing, falls on different sides.
fn assert_images_agree(what: &str, of_gpu: &[f32], expected: &[f64]) {
    assert_eq!(of_gpu.len(), expected.len(), "{what}");
    let mut off_by_a_switch = 0;
    for (index, (gpu, expected)) in of_gpu.iter().zip(expected).enumerate() {
        let error = (f64::from(*gpu) - expected).abs();
        off_by_a_switch += usize::from(error > 1e-3);
        assert!(
            error < 8e-3,
            "{what}, value {index}: {gpu} on the device, expected {expected}"
        );
    }
    let allowed = of_gpu.len() / 1500;
    assert!(
        off_by_a_switch <= allowed,
        "{what}: {off_by_a_switch} values differ"
    );
}

/// Renders with the device, and judges the image and its gradient.
fn compare(renderer: &mut GpuRenderer, view: &RefView, gaussians: &[Gaussian]) {
    let what = format!("{:?}, {:?}", view.camera, view.settings.footprint);
    let (expected, _) = reference::render(view, gaussians, None);
    let (view, settings, gaussians) = (view.view(), view.settings, instant(gaussians));
    renderer.settings = settings;
    let raster = renderer.forward(&view, &gaussians).unwrap();
    assert_images_agree(&what, &raster.colour, &expected.colour);
    assert_images_agree(&what, &raster.features, &expected.features);
    let mut on_cpu = Renderer::new(settings);
    let of_cpu = on_cpu.forward(&view, &gaussians);
    let transmittance: Vec<f64> = of_cpu.transmittance.iter().map(|&t| t.into()).collect();
    assert_images_agree(&what, &raster.transmittance, &transmittance);

    let mut random = Pcg64Mcg::seed_from_u64(7);
    let mut noise =
        |len: usize| -> Vec<f32> { (0..len).map(|_| random.random_range(-1.0..1.0)).collect() };
    let (colour, features) = (noise(raster.colour.len()), noise(raster.features.len()));
    let upstream = RasterGradient::new(&colour, &features);
    let (mut gradient, mut expected) =
        (ActivatedGaussians::default(), ActivatedGaussians::default());
    renderer.backward(&upstream, &mut gradient).unwrap();
    on_cpu.backward(&view, &gaussians, &upstream, &mut expected);
    let agree = |name: &str, of_gpu: &[f32], of_cpu: &[f32]| {
        assert_gradients_agree(&format!("{what}, {name}"), of_gpu, of_cpu);
    };
    for (name, of_gpu, of_cpu) in [
        ("positions", &gradient.positions, &expected.positions),
        ("scales", &gradient.scales, &expected.scales),
        ("sh_constant", &gradient.sh_constant, &expected.sh_constant),
        ("sh_rest", &gradient.sh_rest, &expected.sh_rest),
    ] {
        agree(name, of_gpu.as_flattened(), of_cpu.as_flattened());
    }
    let rotations = expected.rotations.as_flattened();
    agree("rotations", gradient.rotations.as_flattened(), rotations);
    agree("opacities", &gradient.opacities, &expected.opacities);
    agree("features", &gradient.features, &expected.features);

    let (seen, expected): (Vec<Visible>, Vec<Visible>) =
        (renderer.visible().unwrap(), on_cpu.visible().collect());
    let indices =
        |visible: &[Visible]| -> Vec<usize> { visible.iter().map(|one| one.gaussian).collect() };
    assert_eq!(indices(&seen), indices(&expected), "{what}");
    let centres = |visible: &[Visible]| -> Vec<f32> {
        visible.iter().flat_map(|one| one.centre_gradient).collect()
    };
    agree("centres", &centres(&seen), &centres(&expected));
}

#[test]
fn images_and_gradients_are_those_of_the_reference_and_of_the_cpu() {
    for gpu in devices() {
        images_and_gradients_agree(gpu);
    }
}

fn images_and_gradients_agree(gpu: Arc<Gpu>) {
    let mut unused = GpuRenderer::new(Arc::clone(&gpu), settings(Footprint::Projected));
    let upstream = RasterGradient::new(&[], &[]);
    let refused = unused.backward(&upstream, &mut ActivatedGaussians::default());
    assert!(
        matches!(refused, Err(GpuError::Failed { .. })),
        "{refused:?}"
    );

    let mut random = Pcg64Mcg::seed_from_u64(21);
    let mut renderer = GpuRenderer::new(gpu, settings(Footprint::Projected));
    for footprint in [Footprint::Projected, Footprint::Ray] {
        // 40 is not a multiple of a tile: the seam runs through one.
        for (camera, rotation, sh_degree) in [
            (erp(64), DQuat::IDENTITY, 1),
            (erp(40), turned(), 3),
            (pinhole(50, 35), turned(), 0),
        ] {
            let richness = Richness::new(sh_degree, 2);
            let gaussians = scene(&mut random, 60, richness);
            compare(
                &mut renderer,
                &view(camera, rotation, footprint),
                &gaussians,
            );
        }
    }
    // Harmonics above the drawn degree stay unchanged.
    let richness = Richness::new(3, 2);
    let mut view = view(erp(48), turned(), Footprint::Projected);
    view.settings.sh_degree = 1;
    compare(&mut renderer, &view, &scene(&mut random, 40, richness));
}

#[test]
fn more_entries_than_there_is_room_for_are_not_lost() {
    // Few Gaussians, each over many tiles.
    let gaussians: Vec<Gaussian> = (0..6)
        .map(|index| {
            let direction = dvec3(f64::from(index).sin(), 0.1, f64::from(index).cos());
            Gaussian {
                features: vec![0.5, 1.0],
                ..at(direction, 2.0 + f64::from(index), [1.4; 3], 0.3)
            }
            .rounded()
        })
        .collect();
    let view = view(erp(160), DQuat::IDENTITY, Footprint::Ray);
    for gpu in devices() {
        compare(&mut GpuRenderer::new(gpu, view.settings), &view, &gaussians);
    }
}

/// Checks that a long list behind an opaque surface, and one gradient repeated, depend neither on leftovers of
/// another step nor on the order of threads.
#[test]
fn what_is_hidden_has_no_gradient_and_gradients_are_the_same_each_time() {
    let layer = |index: u32| {
        let direction = dvec3(f64::from(index % 5) * 0.02, 0.0, 1.0);
        let size = if index < 30 { 0.6 } else { 0.05 };
        at(direction, 1.0 + 0.01 * f64::from(index), [size; 3], 0.6).rounded()
    };
    let layers: Vec<Gaussian> = (0..300).map(layer).collect();
    let view = view(erp(64), DQuat::IDENTITY, Footprint::Projected);
    for gpu in devices() {
        let mut renderer = GpuRenderer::new(gpu, view.settings);
        compare(&mut renderer, &view, &layers);
        let gradient = |renderer: &mut GpuRenderer| {
            let raster = renderer.forward(&view.view(), &instant(&layers)).unwrap();
            let upstream = RasterGradient::new(&raster.colour, &[]);
            let mut gradient = ActivatedGaussians::default();
            renderer.backward(&upstream, &mut gradient).unwrap();
            gradient
        };
        let first = gradient(&mut renderer);
        assert_eq!(first.opacities[299], 0.0, "hidden");
        assert!(first.opacities[0] != 0.0, "seen");
        for _ in 0..3 {
            assert_eq!(gradient(&mut renderer), first);
        }
    }
}

#[test]
fn nothing_to_draw_is_the_background() {
    let Some(gpu) = device() else { return };
    let view = view(erp(24), turned(), Footprint::Projected);
    let mut renderer = GpuRenderer::new(gpu, view.settings);
    let raster: Raster = renderer
        .forward(&view.view(), &ActivatedGaussians::default())
        .unwrap();
    assert!(raster.transmittance.iter().all(|&left| left == 1.0));
    assert!(
        raster
            .colour
            .as_chunks()
            .0
            .iter()
            .all(|&pixel: &[f32; 3]| pixel == [0.1, 0.3, 0.2])
    );
}

#[test]
fn hopeless_gaussians_are_left_out_and_harm_nothing() {
    let Some(gpu) = device() else { return };
    let mut random = Pcg64Mcg::seed_from_u64(25);
    let clean = instant(&scene(&mut random, 40, PLAIN));
    let view = view(erp(64), turned(), Footprint::Projected);
    let mut renderer = GpuRenderer::new(gpu, view.settings);
    let view = view.view();
    let expected = renderer.forward(&view, &clean).unwrap();
    type Change = fn(&mut ActivatedGaussians, usize);
    let changes: [Change; 9] = [
        |g, i| g.positions[i] = [f32::NAN, 0.0, 1.0],
        |g, i| g.positions[i] = [0.0; 3],
        |g, i| g.positions[i] = [f32::INFINITY, 0.0, 0.0],
        |g, i| g.positions[i] = [1e30, 0.0, 0.0],
        |g, i| g.scales[i] = [1e30, 1.0, 1.0],
        |g, i| g.scales[i] = [f32::NAN, 0.1, 0.1],
        |g, i| g.opacities[i] = f32::NAN,
        |g, i| g.opacities[i] = 1e-30,
        |g, i| g.rotations[i] = [f32::NAN, 0.0, 0.0, 0.0],
    ];
    let mut degenerate = clean.clone();
    degenerate.reshape(clean.len() + changes.len(), 0, 0);
    for (index, change) in (clean.len()..).zip(changes) {
        degenerate.positions[index] = [0.0, 0.0, 2.0];
        degenerate.scales[index] = [0.1; 3];
        degenerate.rotations[index] = [1.0, 0.0, 0.0, 0.0];
        degenerate.opacities[index] = 0.5;
        change(&mut degenerate, index);
    }
    let raster = renderer.forward(&view, &degenerate).unwrap();
    assert_eq!(raster, expected);
    let ones = vec![1.0; raster.colour.len()];
    let upstream = RasterGradient::new(&ones, &[]);
    let mut gradient = ActivatedGaussians::default();
    renderer.backward(&upstream, &mut gradient).unwrap();
    let (of_clean, of_hopeless) = gradient.positions.split_at(clean.len());
    assert!(
        of_clean
            .as_flattened()
            .iter()
            .all(|value| value.is_finite())
    );
    assert!(of_clean.as_flattened().iter().any(|&value| value != 0.0));
    assert!(of_hopeless.iter().all(|row| *row == [0.0; 3]));
}

#[test]
fn a_lost_device_is_an_error_and_no_panic() {
    let Some(gpu) = device() else { return };
    let mut random = Pcg64Mcg::seed_from_u64(26);
    let gaussians = instant(&scene(&mut random, 12, PLAIN));
    let view = view(erp(32), turned(), Footprint::Projected);
    let mut renderer = GpuRenderer::new(Arc::clone(&gpu), view.settings);
    let view = view.view();
    renderer.forward(&view, &gaussians).unwrap();
    gpu.destroy();
    let error = renderer.forward(&view, &gaussians).unwrap_err();
    assert!(matches!(error, GpuError::Lost { .. }), "{error}");
    assert!(error.to_string().contains(&gpu.adapter().name), "{error}");
}
