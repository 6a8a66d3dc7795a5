//! Sums over pixels with a thread per splat: gradients against finite differences of the f64 reference, and
//! against the form with a thread per pixel on the same adapter.

use std::sync::Arc;

use device::{assert_gradients_agree, device, devices};
use glam::{DQuat, DVec3, dvec3};
use omnilife_engine::{
    device::{Gpu, PixelSums},
    gaussians::ActivatedGaussians,
    render::{gpu::GpuRenderer, raster::RasterGradient, settings::Footprint},
};
use omnilife_stability::channels::gradient_rows;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use support::{
    reference::{self, Gaussian, RefView, instant, parameter_arrays},
    scenes::{Richness, at, erp, pinhole, scene, settings, turned},
};

use crate::support;
use crate::support::device;

/// Returns the device with a thread per splat, or `None` without any adapter.
fn per_splat() -> Option<Arc<Gpu>> {
    devices()
        .into_iter()
        .find(|gpu| gpu.pixel_sums() == PixelSums::Splats)
}

/// Weights of a loss that is linear in the image.
struct Weights {
    colour: Vec<f32>,
    features: Vec<f32>,
}

impl Weights {
    fn new(view: &RefView, features: usize, random: &mut Pcg64Mcg) -> Self {
        let pixels = view.camera.width() as usize * view.camera.height() as usize;
        let mut draw = |count: usize| -> Vec<f32> {
            (0..count).map(|_| random.random_range(-1.0..1.0)).collect()
        };
        Self {
            colour: draw(pixels * 3),
            features: draw(pixels * features),
        }
    }

    /// Returns the gradient of the loss by the Gaussians, computed on a device.
    fn gradient(
        &self,
        gpu: &Arc<Gpu>,
        view: &RefView,
        gaussians: &ActivatedGaussians,
    ) -> ActivatedGaussians {
        let mut renderer = GpuRenderer::new(Arc::clone(gpu), view.settings);
        renderer.forward(&view.view(), gaussians).unwrap();
        let upstream = RasterGradient {
            colour: &self.colour,
            features: &self.features,
        };
        let mut gradient = ActivatedGaussians::default();
        renderer.backward(&upstream, &mut gradient).unwrap();
        gradient
    }
}

fn dot(values: &[f64], weights: &[f32]) -> f64 {
    let products = values.iter().zip(weights);
    products
        .map(|(value, &weight)| value * f64::from(weight))
        .sum()
}

/// Compares a device's gradient with the reference, array by array, within 5e-3 of the larger of a value and
/// the typical value of its array.
fn compare_with_reference(
    gpu: &Arc<Gpu>,
    view: &RefView,
    gaussians: &[Gaussian],
    random: &mut Pcg64Mcg,
) {
    let weights = Weights::new(view, gaussians[0].features.len(), random);
    let expected = reference::gradients(view, gaussians, |image| {
        dot(&image.colour, &weights.colour) + dot(&image.features, &weights.features)
    });
    let instant = instant(gaussians);
    let rows = gradient_rows(&instant, &weights.gradient(gpu, view, &instant));
    let mut start = 0;
    for (name, width) in parameter_arrays(&gaussians[0]) {
        let of_array = |rows: &[Vec<f64>]| -> Vec<f32> {
            let values = rows.iter().flat_map(|row| &row[start..start + width]);
            values.map(|&value| value as f32).collect()
        };
        let what = format!("{:?}, {:?}, {name}", view.camera, view.settings.footprint);
        assert_gradients_agree(&what, &of_array(&rows), &of_array(&expected));
        start += width;
    }
}

#[test]
fn gradients_per_splat_are_those_of_the_reference() {
    let Some(gpu) = per_splat() else { return };
    let mut random = Pcg64Mcg::seed_from_u64(31);
    let cases = [
        (erp(40), Footprint::Projected, 1, 1),
        (erp(40), Footprint::Ray, 0, 4),
        (pinhole(36, 24), Footprint::Projected, 0, 0),
    ];
    for (camera, footprint, sh_degree, features) in cases {
        let richness = Richness {
            sh_degree,
            features,
        };
        let gaussians = scene(&mut random, 16, richness);
        let centre = dvec3(0.03, 0.02, -0.05);
        let view = RefView::new(camera, turned(), centre, settings(footprint));
        compare_with_reference(&gpu, &view, &gaussians, &mut random);
    }
}

/// Returns layers behind one another that all cover the same tiles. Together they stop no pixel.
fn layers(count: u32) -> Vec<Gaussian> {
    let layer = |index: u32| {
        let side = f64::from(index % 7) * 0.02;
        let distance = 1.0 + 0.01 * f64::from(index);
        at(dvec3(side, -side, 1.0), distance, [0.3; 3], 0.02).rounded()
    };
    (0..count).map(layer).collect()
}

/// Checks lists shorter than a workgroup, as long as one, and longer by a splat: threads start and end their
/// splats at different moments.
#[test]
fn gradients_per_splat_are_those_per_pixel_for_lists_of_every_length() {
    let Some(gpu) = per_splat() else { return };
    let Some(per_pixel) = device() else { return };
    assert!(
        per_pixel.pixel_sums() != PixelSums::Splats,
        "OMNILIFE_GPU_SUMS is set"
    );
    let mut random = Pcg64Mcg::seed_from_u64(32);
    let view = RefView::new(
        erp(48),
        DQuat::IDENTITY,
        DVec3::ZERO,
        settings(Footprint::Projected),
    );
    for count in [1, 2, 63, 64, 65, 127, 128, 129, 200] {
        let gaussians = instant(&layers(count));
        let weights = Weights::new(&view, 0, &mut random);
        let [of_splats, of_pixels] =
            [&gpu, &per_pixel].map(|gpu| weights.gradient(gpu, &view, &gaussians));
        let (splats, pixels) = (
            gradient_rows(&gaussians, &of_splats),
            gradient_rows(&gaussians, &of_pixels),
        );
        let all = || pixels.iter().flatten();
        let typical = (all().map(|value| value * value).sum::<f64>() / all().count() as f64).sqrt();
        assert!(typical > 0.0, "{count} splats have no gradient");
        for (of_splat, of_pixel) in splats.iter().flatten().zip(all()) {
            assert!(
                (of_splat - of_pixel).abs() < 1e-3 * of_pixel.abs().max(typical),
                "{count} splats: {of_splat} per splat, {of_pixel} per pixel (typical {typical})"
            );
        }
    }
}

#[test]
fn gradients_per_splat_are_the_same_each_time() {
    let Some(gpu) = per_splat() else { return };
    let mut random = Pcg64Mcg::seed_from_u64(33);
    let richness = Richness {
        sh_degree: 1,
        features: 2,
    };
    let gaussians = instant(&scene(&mut random, 300, richness));
    let centre = dvec3(0.05, -0.02, 0.04);
    let view = RefView::new(erp(64), turned(), centre, settings(Footprint::Ray));
    let weights = Weights::new(&view, richness.features, &mut random);
    let first = weights.gradient(&gpu, &view, &gaussians);
    assert!(first.opacities.iter().any(|&value| value != 0.0));
    for _ in 0..3 {
        assert_eq!(weights.gradient(&gpu, &view, &gaussians), first);
    }
}
