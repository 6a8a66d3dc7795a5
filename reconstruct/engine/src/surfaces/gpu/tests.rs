//! Layers on a device compared with those of the CPU in f64.

use glam::DVec3;

use super::*;
use crate::{
    device::test_device,
    surfaces::compose::{Layer, compose, compose_vjp},
};

const SURFACES: usize = 64;

fn layer(surface: usize, opacity: f64) -> Layer {
    Layer {
        distance: surface as f64,
        surface,
        colour: DVec3::new(0.1, 0.5, 0.9) * (1.0 - 0.01 * surface as f64),
        opacity,
    }
}

/// Opaque layers, opacities next to 1, and a ray without a hit.
#[test]
fn layers_and_their_gradients_are_those_of_the_cpu() {
    let Some(gpu) = test_device() else { return };
    let rays: Vec<Vec<Layer>> = [
        vec![1.0; SURFACES],
        vec![0.0, 1.0 - 1e-7, 1.0, 0.5],
        vec![0.0; 16],
        vec![0.3, 1.0, 0.2, 1.0],
        Vec::new(),
    ]
    .into_iter()
    .map(|opacities| {
        let numbered = opacities.into_iter().enumerate();
        numbered.map(|(at, opacity)| layer(at, opacity)).collect()
    })
    .collect();
    let kernels = SurfaceKernels::new(&gpu, 0.1).expect("compiles");
    let on_device = Rays::new(&gpu, rays.len(), SURFACES).expect("fits");
    // A layer for each surface and ray.
    let firsts: Vec<usize> = (0..SURFACES).map(|surface| surface * rays.len()).collect();
    let mut layers = vec![[0.0_f32; 4]; SURFACES * rays.len()];
    let mut hits: Vec<Vec<(usize, usize)>> = Vec::new();
    for (ray, of_ray) in rays.iter().enumerate() {
        for layer in of_ray {
            let [r, g, b] = layer.colour.as_vec3().to_array();
            layers[firsts[layer.surface] + ray] = [r, g, b, layer.opacity as f32];
        }
        hits.push(of_ray.iter().map(|layer| (layer.surface, ray)).collect());
    }
    on_device.place(&gpu, &hits, &firsts);
    on_device.layers.write(&gpu, 0, &layers);
    // Every colour is below the target, or above it.
    let targets = RayTargets {
        colours: &vec![[2.0, -1.0, 2.0]; rays.len()],
        covered: &[],
        mask_weight: 0.0,
    };
    on_device.aim(&gpu, rays.len(), Some(&targets));
    let mut program = Program::default();
    let [batch, begins] = [&on_device.uniform.raw, &on_device.begins.raw];
    let [of_hits, of_layers] = [&on_device.hits.raw, &on_device.layers.raw];
    program.run(
        &gpu,
        &kernels.compose,
        &on_device.rows,
        &[batch, begins, of_hits, of_layers, &on_device.colours.raw],
    );
    program.run(
        &gpu,
        &kernels.compose_vjp,
        &on_device.rows,
        &[
            batch,
            begins,
            of_hits,
            of_layers,
            &on_device.targets.raw,
            &on_device.covered.raw,
            &on_device.by_layers.raw,
            &on_device.losses.raw,
        ],
    );
    program.submit(&gpu);
    let colours = on_device.colours.read(&gpu).expect("reads");
    let by_layers = on_device.by_layers.read(&gpu).expect("reads");
    let weight = 1.0 / (3 * rays.len()) as f64;
    let upstream = weight * DVec3::new(-1.0, 1.0, -1.0);
    for (ray, of_ray) in rays.iter().enumerate() {
        let expected = compose(of_ray).to_array();
        for (found, expected) in colours[ray].iter().zip(expected) {
            assert!((f64::from(*found) - expected).abs() < 1e-6, "{ray}");
        }
        let mut gradients = Vec::new();
        compose_vjp(of_ray, upstream, &mut gradients);
        for (layer, expected) in of_ray.iter().zip(&gradients) {
            let found = by_layers[firsts[layer.surface] + ray].map(f64::from);
            let [r, g, b] = expected.colour.to_array();
            for (found, expected) in found.iter().zip([r, g, b, expected.opacity]) {
                let error = (found - expected).abs();
                assert!(error < 3e-6 * weight, "{ray}: {found} {expected}");
            }
        }
    }
}
