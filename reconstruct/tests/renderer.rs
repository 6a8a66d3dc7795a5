//! The kernels against the f64 reference: images, gradients, seam, poles, threads.
#![expect(
    clippy::unwrap_used,
    reason = "a failure to build a test scene is a failed test"
)]

mod support;

use glam::{DMat3, DQuat, DVec3, dvec3};
use omnilife_reconstruct::{
    camera::View,
    gaussians::{GaussianTable, InstantGaussians, static_gaussians},
    kernels::raster::RasterGradient,
    render::{RenderSettings, Renderer},
};
use omnilife_schemas::camera::ErpCamera;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use support::reference::{self, RawGaussian, RefView};

const NEAR: f64 = 0.01;
const BACKGROUND: [f64; 3] = [0.1, 0.3, 0.2];

fn table(gaussians: &[RawGaussian]) -> GaussianTable {
    let mut table = static_gaussians::table(&static_gaussians::InitialGaussians {
        positions: vec![[0.0; 3]; gaussians.len()],
        scales: vec![1.0; gaussians.len()],
        colours: vec![[0.5; 3]; gaussians.len()],
        opacities: vec![0.5; gaussians.len()],
    });
    let mut begin = 0;
    for array in &mut table.arrays {
        array.values = gaussians
            .iter()
            .flat_map(|gaussian| gaussian.parameters()[begin..begin + array.width].to_vec())
            .map(|value| value as f32)
            .collect();
        begin += array.width;
    }
    table
}

/// The reference must see what the kernels see: parameters rounded to f32.
fn rounded(gaussian: RawGaussian) -> RawGaussian {
    RawGaussian::from_parameters(gaussian.parameters().map(|value| f64::from(value as f32)))
}

fn ref_view(width: u32, height: u32, rotation: DQuat, centre: DVec3) -> RefView {
    // Rounded as the kernels' view is.
    RefView {
        camera: ErpCamera { width, height },
        rotation: DMat3::from_quat(rotation).as_mat3().as_dmat3(),
        centre: centre.as_vec3().as_dvec3(),
        near: f64::from(NEAR as f32),
        background: BACKGROUND,
    }
}

fn view(reference: &RefView) -> View {
    View {
        camera: reference.camera.into(),
        rotation: reference.rotation.as_mat3(),
        centre: reference.centre.as_vec3(),
        time_seconds: 0.0,
    }
}

fn renderer() -> Renderer {
    Renderer::new(RenderSettings {
        background: BACKGROUND.map(|value| value as f32),
        ..RenderSettings::new(NEAR as f32)
    })
}

fn colour_gradient(colour: &[f32]) -> RasterGradient<'_> {
    RasterGradient {
        colour,
        features: &[],
    }
}

fn instant(table: &GaussianTable) -> InstantGaussians {
    let mut instant = InstantGaussians::default();
    static_gaussians::instantiate(table, &mut instant);
    instant
}

/// A Gaussian in a direction of the camera frame (camera at the origin, not rotated).
fn at(direction: DVec3, distance: f64, scale: [f64; 3], opacity: f64, sh: [f64; 3]) -> RawGaussian {
    rounded(RawGaussian {
        position: (direction.normalize() * distance).to_array(),
        log_scale: scale.map(f64::ln),
        quaternion: [0.8, 0.3, -0.4, 0.33],
        opacity_logit: (opacity / (1.0 - opacity)).ln(),
        sh,
    })
}

/// Random Gaussians all around, with the awkward ones first: on the seam, near both poles, as large
/// as their distance nearly, needles, and one beside the seam's far end.
fn scene(random: &mut Pcg64Mcg, count: usize) -> Vec<RawGaussian> {
    let mut gaussians = vec![
        at(
            dvec3(0.0, 0.1, -1.0),
            2.0,
            [0.2, 0.3, 0.25],
            0.6,
            [0.9, -0.3, 0.1],
        ),
        at(
            dvec3(0.02, -0.2, -1.0),
            3.0,
            [0.5, 0.1, 0.2],
            0.5,
            [0.1, 0.8, -0.4],
        ),
        at(
            dvec3(0.1, -1.0, 0.05),
            2.5,
            [0.2, 0.3, 0.1],
            0.6,
            [0.4, 0.2, 1.0],
        ),
        at(
            dvec3(-0.08, 1.0, -0.09),
            1.5,
            [0.1, 0.2, 0.15],
            0.5,
            [1.0, 0.2, 0.3],
        ),
        at(
            dvec3(1.0, 0.3, 0.4),
            1.0,
            [0.6, 0.5, 0.7],
            0.3,
            [0.2, 0.5, 0.7],
        ),
        at(
            dvec3(-1.0, 0.2, 0.7),
            4.0,
            [2.0, 0.002, 0.002],
            0.7,
            [0.6, 1.1, 0.2],
        ),
    ];
    while gaussians.len() < count {
        let mut uniform = |low: f64, high: f64| random.random_range(low..high);
        let direction = dvec3(uniform(-1.0, 1.0), uniform(-1.0, 1.0), uniform(-1.0, 1.0));
        if direction.length() < 0.2 {
            continue;
        }
        let distance = uniform(1.0, 6.0);
        let scale = [0; 3].map(|_| distance * uniform(0.01, 0.12));
        let opacity = uniform(0.05, 0.8);
        let sh = [0; 3].map(|_| uniform(-1.2, 1.5));
        let mut gaussian = at(direction, distance, scale, opacity, sh);
        gaussian.quaternion = [0; 4].map(|_| uniform(-1.0, 1.0));
        gaussians.push(rounded(gaussian));
    }
    gaussians
}

fn turned() -> DQuat {
    DQuat::from_euler(glam::EulerRot::XYZ, 0.3, -1.1, 0.2)
}

#[test]
fn images_are_those_of_the_reference() {
    let mut random = Pcg64Mcg::seed_from_u64(11);
    // 40 and 72 are no multiples of a tile: the seam runs through tiles.
    for (width, height) in [(64, 32), (40, 20), (72, 36)] {
        for rotation in [DQuat::IDENTITY, turned()] {
            let mut gaussians = scene(&mut random, 60);
            // Inside the floor of rho beside the pole.
            gaussians.push(at(
                dvec3(0.002, -1.0, 0.001),
                3.0,
                [0.3, 0.2, 0.25],
                0.4,
                [0.3, 0.6, 0.2],
            ));
            let reference_view = ref_view(width, height, rotation, dvec3(0.05, -0.02, 0.04));
            let (expected, _) = reference::render(&reference_view, &gaussians, None);
            let instant = instant(&table(&gaussians));
            let mut renderer = renderer();
            let raster = renderer.forward(&view(&reference_view), &instant);
            let mut off_by_a_switch = 0;
            for (index, (value, expected)) in raster.colour.iter().zip(&expected).enumerate() {
                let error = (f64::from(*value) - expected).abs();
                // A Gaussian at its 1/255 edge may fall on either side in f32.
                if error > 2e-5 {
                    off_by_a_switch += 1;
                    assert!(
                        error < 6e-3,
                        "pixel value {index}: {value} against {expected}"
                    );
                }
            }
            assert!(
                off_by_a_switch <= 6,
                "{off_by_a_switch} of {} values differ at {width}x{height}",
                expected.len()
            );
        }
    }
}

#[test]
fn gradients_are_those_of_the_reference() {
    let mut random = Pcg64Mcg::seed_from_u64(12);
    for (rotation, width) in [(DQuat::IDENTITY, 48), (turned(), 40)] {
        let height = width / 2;
        let gaussians = scene(&mut random, 24);
        let reference_view = ref_view(width, height, rotation, dvec3(0.03, 0.02, -0.05));
        let weights: Vec<f64> = (0..width * height * 3)
            .map(|_| f64::from(random.random_range(-1.0_f32..1.0)))
            .collect();
        let (_, decisions) = reference::render(&reference_view, &gaussians, None);
        let loss = |gaussians: &[RawGaussian]| {
            let (image, _) = reference::render(&reference_view, gaussians, Some(&decisions));
            image
                .iter()
                .zip(&weights)
                .map(|(value, weight)| value * weight)
                .sum::<f64>()
        };

        let mut table = table(&gaussians);
        let instant = instant(&table);
        let mut renderer = renderer();
        let view = view(&reference_view);
        renderer.forward(&view, &instant);
        let image_gradient: Vec<f32> = weights.iter().map(|&weight| weight as f32).collect();
        let mut gradient = InstantGaussians::default();
        renderer.backward(
            &view,
            &instant,
            &colour_gradient(&image_gradient),
            &mut gradient,
        );
        static_gaussians::instantiate_vjp(&mut table, &instant, &gradient);

        let mut begin = 0;
        for array in &table.arrays {
            let mut reference = Vec::new();
            for index in 0..gaussians.len() {
                for parameter in begin..begin + array.width {
                    let shifted = |step: f64| {
                        let mut shifted = gaussians.clone();
                        let mut all = shifted[index].parameters();
                        all[parameter] += step;
                        shifted[index] = RawGaussian::from_parameters(all);
                        loss(&shifted)
                    };
                    reference.push((shifted(1e-5) - shifted(-1e-5)) / 2e-5);
                }
            }
            begin += array.width;
            let scale =
                (reference.iter().map(|g| g * g).sum::<f64>() / reference.len() as f64).sqrt();
            assert!(scale > 1e-3, "{} does nothing in this scene", array.name);
            for (index, (value, reference)) in array.gradients.iter().zip(&reference).enumerate() {
                let error = (f64::from(*value) - reference).abs();
                assert!(
                    error < 1e-3 * reference.abs().max(scale),
                    "{}[{index}]: {value} against {reference} (typical {scale})",
                    array.name
                );
            }
        }
    }
}

/// Turning the camera by half a turn and rolling the image back must change nothing: the seam is
/// nowhere.
#[test]
fn half_a_turn_moves_the_seam_and_nothing_else() {
    let mut random = Pcg64Mcg::seed_from_u64(13);
    let gaussians = scene(&mut random, 200);
    let instant = instant(&table(&gaussians));
    for width in [128_u32, 120] {
        let height = width / 2;
        let straight = view(&ref_view(width, height, DQuat::IDENTITY, DVec3::ZERO));
        let mut back = straight;
        back.rotation = glam::Mat3::from_diagonal(glam::vec3(-1.0, 1.0, -1.0));
        let first = renderer().forward(&straight, &instant).colour.clone();
        let second = renderer().forward(&back, &instant).colour.clone();
        let (row, half) = (width as usize * 3, width as usize / 2 * 3);
        let mut differing = 0;
        for (index, value) in first.iter().enumerate() {
            let rolled = index / row * row + (index % row + half) % row;
            let error = (value - second[rolled]).abs();
            if error > 2e-5 {
                differing += 1;
                assert!(error < 6e-3, "{index}: {value} against {}", second[rolled]);
            }
        }
        assert!(differing <= 6, "{differing} values differ at width {width}");
    }
}

#[test]
fn a_gaussian_over_a_pole_covers_every_column_without_holes() {
    for y in [-1.0, 1.0] {
        let gaussian = at(dvec3(0.0, y, 0.0), 2.0, [0.4; 3], 0.9, [1.0; 3]);
        let instant = instant(&table(&[gaussian]));
        let (width, height) = (96, 48);
        let view = view(&ref_view(width, height, DQuat::IDENTITY, DVec3::ZERO));
        let mut renderer = renderer();
        let raster = renderer.forward(&view, &instant);
        let row = if y < 0.0 { 0 } else { height as usize - 1 };
        for column in 0..width as usize {
            let left = raster.transmittance[row * width as usize + column];
            assert!(
                left < 0.35,
                "column {column} of the pole row lets {left} through"
            );
        }
    }
}

#[test]
fn results_do_not_depend_on_the_number_of_threads() {
    let mut random = Pcg64Mcg::seed_from_u64(14);
    let gaussians = scene(&mut random, 300);
    let instant = instant(&table(&gaussians));
    let view = view(&ref_view(96, 48, turned(), DVec3::ZERO));
    let weights: Vec<f32> = (0..96 * 48 * 3)
        .map(|_| random.random_range(-1.0..1.0))
        .collect();
    let run = |threads| {
        rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .unwrap()
            .install(|| {
                let mut renderer = renderer();
                let image = renderer.forward(&view, &instant).clone();
                let mut gradient = InstantGaussians::default();
                renderer.backward(&view, &instant, &colour_gradient(&weights), &mut gradient);
                (image, gradient)
            })
    };
    assert_eq!(run(1), run(3));
}

#[test]
fn hopeless_gaussians_are_left_out_and_harm_nothing() {
    let mut random = Pcg64Mcg::seed_from_u64(15);
    let gaussians = scene(&mut random, 30);
    let view = view(&ref_view(64, 32, DQuat::IDENTITY, DVec3::ZERO));
    let clean = renderer()
        .forward(&view, &instant(&table(&gaussians)))
        .clone();
    let mut hopeless = gaussians.clone();
    let plain = at(dvec3(0.0, 0.0, 1.0), 2.0, [0.1; 3], 0.5, [0.0; 3]);
    for change in [
        |g: &mut RawGaussian| g.position = [f64::NAN, 0.0, 1.0],
        |g: &mut RawGaussian| g.position = [0.0; 3],
        |g: &mut RawGaussian| g.position = [f64::INFINITY, 0.0, 0.0],
        |g: &mut RawGaussian| g.log_scale = [80.0, 0.0, 0.0],
        |g: &mut RawGaussian| g.log_scale = [f64::NAN; 3],
        |g: &mut RawGaussian| g.opacity_logit = f64::NAN,
        |g: &mut RawGaussian| g.opacity_logit = -100.0,
        |g: &mut RawGaussian| g.quaternion = [f64::NAN; 4],
    ] {
        let mut gaussian = plain;
        change(&mut gaussian);
        hopeless.push(gaussian);
    }
    let instant = instant(&table(&hopeless));
    let mut renderer = renderer();
    let raster = renderer.forward(&view, &instant);
    assert_eq!(raster, &clean);
    let gradient_of_one = vec![1.0; raster.colour.len()];
    let mut gradient = InstantGaussians::default();
    renderer.backward(
        &view,
        &instant,
        &colour_gradient(&gradient_of_one),
        &mut gradient,
    );
    let mut table = table(&hopeless);
    static_gaussians::instantiate_vjp(&mut table, &instant, &gradient);
    // Culled Gaussians get no gradient; a NaN parameter alone keeps its own.
    for array in &table.arrays {
        let of_clean = &array.gradients[..gaussians.len() * array.width];
        assert!(
            of_clean.iter().all(|value| value.is_finite()),
            "{}",
            array.name
        );
    }
    assert!(
        gradient.positions[gaussians.len()..]
            .iter()
            .all(|row| *row == [0.0; 3])
    );
}
