//! Responses compared with their definition in f64, with finite differences, and with known cameras.

use omnilife_schemas::camera::{ErpCamera, PinholeCamera};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

use super::*;

const ERP: Camera = Camera::Erp(ErpCamera {
    width: 40,
    height: 20,
});

/// Returns a pinhole whose axis is off the middle of the image.
fn pinhole() -> Camera {
    Camera::Pinhole(PinholeCamera {
        width: 24,
        height: 18,
        fx: 20.0,
        fy: 22.0,
        cx: 10.0,
        cy: 11.5,
    })
}

/// Numbers of a response in f64: the definition as plain loops.
#[derive(Clone)]
struct Reference {
    camera: Camera,
    log_gains: [f64; 3],
    /// `p`, `q`, `a1`, `a2`, `a3`.
    shared: [f64; 5],
}

impl Reference {
    fn shown(&self, pixel: usize, channel: usize, level: f64) -> f64 {
        let [p, q, a1, a2, a3] = self.shared;
        let r = match self.camera {
            Camera::Erp(_) => 0.0,
            Camera::Pinhole(PinholeCamera { width, cx, cy, .. }) => {
                let width = width as usize;
                let distance = |x: f64, y: f64| (x - cx).powi(2) + (y - cy).powi(2);
                let corners = [(0.0, 0.0), (24.0, 0.0), (0.0, 18.0), (24.0, 18.0)];
                let farthest = corners.map(|(x, y)| distance(x, y));
                let farthest = farthest.into_iter().fold(0.0, f64::max);
                let (x, y) = ((pixel % width) as f64 + 0.5, (pixel / width) as f64 + 0.5);
                distance(x, y) / farthest
            }
        };
        let light = if level <= 0.040_45 {
            level / 12.92
        } else {
            ((level + 0.055) / 1.055).powf(2.4)
        };
        let z = (self.log_gains[channel] + a1 * r + a2 * r.powi(2) + a3 * r.powi(3)).exp() * light;
        let y = if z <= 0.003_130_8 {
            12.92 * z
        } else {
            1.055 * z.powf(1.0 / 2.4) - 0.055
        };
        let curve = |y: f64| y.powf(p.exp()) * (-p.exp() * (q.exp() - 1.0) * (1.0 - y)).exp();
        let dark = 1.0 / 255.0;
        if y > 1.0 {
            1.0 + (p + q).exp() * (y - 1.0)
        } else if y < dark {
            y / dark * curve(dark)
        } else {
            curve(y)
        }
    }

    /// Returns the sum of shown values with weights.
    fn sum(&self, render: &[f32], weights: &[f32]) -> f64 {
        let values = render.iter().zip(weights).enumerate();
        let weighted = values.map(|(at, (&level, &weight))| {
            f64::from(weight) * self.shown(at / 3, at % 3, f64::from(level))
        });
        weighted.sum()
    }

    fn response(&self) -> CameraResponse {
        let mut response = CameraResponse::new(vec![0.0], &self.camera, None);
        let gains = &mut response.gains.arrays[0].values;
        for (gain, log) in gains.iter_mut().zip(self.log_gains) {
            *gain = log as f32;
        }
        for (value, number) in response.shared.array.values.iter_mut().zip(self.shared) {
            *value = number as f32;
        }
        response
    }
}

/// Returns responses of both cameras, whose numbers are exact in f32.
fn references() -> Vec<Reference> {
    [ERP, pinhole()]
        .into_iter()
        .flat_map(|camera| {
            [
                [0.25, -0.375, 0.125, -0.25, 0.5],
                [-0.5, 0.5, -0.75, 0.25, -0.125],
            ]
            .map(|shared| Reference {
                camera,
                log_gains: [0.5, -0.25, 0.125],
                shared,
            })
        })
        .collect()
}

/// Returns levels from darkness to beyond white, away from the kinks of the curve and of sRGB.
fn render(reference: &Reference) -> Vec<f32> {
    let mut random = Pcg64Mcg::seed_from_u64(4);
    let [width, height] = reference.camera.size();
    let [_, _, a1, a2, a3] = reference.shared;
    let without_curve = Reference {
        shared: [0.0, 0.0, a1, a2, a3],
        ..reference.clone()
    };
    let is_near_kink = |value: f64| {
        let kinks = [1.0 / 255.0, 0.040_45, 1.0];
        kinks.iter().any(|kink| (value / kink - 1.0).abs() < 0.01)
    };
    let level = |at: usize| loop {
        let root: f32 = random.random_range(0.04..1.3);
        let level = root.powi(2);
        let lit = without_curve.shown(at / 3, at % 3, f64::from(level));
        if !is_near_kink(lit) && !is_near_kink(f64::from(level)) {
            break level;
        }
    };
    (0..3 * width * height).map(level).collect()
}

#[test]
fn images_are_those_of_the_definition() {
    for reference in references() {
        let render = render(&reference);
        let mut shown = Vec::new();
        let response = reference.response();
        let view = response.of_view(0, &reference.camera);
        view.show(&render, &mut shown);
        let mut range = [f32::MAX, 0.0_f32];
        for (at, (&level, &found)) in render.iter().zip(&shown).enumerate() {
            let expected = reference.shown(at / 3, at % 3, f64::from(level));
            let error = (f64::from(found) - expected).abs();
            assert!(error < 5e-6 * (1.0 + expected), "{at}: {found} {expected}");
            range = [range[0].min(level), range[1].max(found)];
        }
        assert!(range[0] < 1.0 / 255.0 && range[1] > 1.0, "{range:?}");
    }
}

#[test]
fn gradients_are_finite_differences_of_the_definition() {
    let mut random = Pcg64Mcg::seed_from_u64(5);
    for reference in references() {
        let render = render(&reference);
        let weights: Vec<f32> = render
            .iter()
            .map(|_| random.random_range(-0.2..1.0))
            .collect();
        let view = reference.response().of_view(0, &reference.camera);
        let mut by_render = Vec::new();
        let found = view.show_vjp(&render, &weights, &mut by_render);

        let step = 1e-6;
        let slope = |change: &dyn Fn(&mut Reference, f64)| {
            let at = |by: f64| {
                let mut moved = reference.clone();
                change(&mut moved, by);
                moved.sum(&render, &weights)
            };
            (at(step) - at(-step)) / (2.0 * step)
        };
        let scale = render.len() as f64;
        for channel in 0..3 {
            let expected = slope(&|moved: &mut Reference, by: f64| moved.log_gains[channel] += by);
            let error = (found.gains[channel] - expected).abs();
            assert!(error < 1e-6 * scale, "{channel}: {found:?} {expected}");
            assert!(expected.abs() > 1e-4 * scale);
        }
        for number in 0..reference.response().shared.array.values.len() {
            let expected = slope(&|moved: &mut Reference, by: f64| moved.shared[number] += by);
            let error = (found.shared[number] - expected).abs();
            assert!(error < 1e-6 * scale, "{number}: {found:?} {expected}");
        }
        for (at, (&level, &by)) in render.iter().zip(&by_render).enumerate() {
            let shown = |level: f64| reference.shown(at / 3, at % 3, level);
            let step = 1e-4 * f64::from(level);
            let slope =
                (shown(f64::from(level) + step) - shown(f64::from(level) - step)) / (2.0 * step);
            let expected = f64::from(weights[at]) * slope;
            let error = (f64::from(by) - expected).abs();
            assert!(
                error < 1e-4 * (1e-2 + expected.abs()),
                "{at}: {by} {expected}"
            );
        }
    }
}

#[test]
fn a_new_response_is_the_identity_and_any_curve_is_monotone() {
    let levels: Vec<f32> = (0..3_000).map(|at| at as f32 / 2_000.0).collect();
    let mut shown = Vec::new();
    for camera in [ERP, pinhole()] {
        let response = CameraResponse::new(vec![0.0, 1.0], &camera, None);
        response.at(0.7, &camera).show(&levels, &mut shown);
        for (level, shown) in levels.iter().zip(&shown) {
            assert!((level - shown).abs() < 5e-6, "{level} {shown}");
        }
    }
    for (p, q) in [(2.0, -3.0), (-2.0, 3.0), (1.5, 1.5), (-1.5, -1.5)] {
        let mut response = CameraResponse::new(vec![0.0], &ERP, None);
        response.shared.array.values = vec![p, q];
        let grey: Vec<f32> = levels.iter().flat_map(|&level| [level; 3]).collect();
        response.at(0.0, &ERP).show(&grey, &mut shown);
        assert!(shown.is_sorted() && shown[0] == 0.0, "{p} {q}");
        assert!((shown[3 * 2_000] - 1.0).abs() < 1e-5, "{p} {q}");
    }
}

#[test]
fn times_between_views_have_gains_between_theirs_and_the_same_curve() {
    let mut response = CameraResponse::new(vec![2.0, 0.0], &ERP, None);
    response.gains.arrays[0].values = vec![0.4, 0.0, -0.2, 0.0, 0.2, 0.2];
    response.shared.array.values = vec![0.1, -0.1];
    let with = |gains: [f32; 3]| ViewResponse::new(gains.map(f32::exp), None, [0.1, -0.1]);
    let image = |view: ViewResponse| {
        let mut shown = Vec::new();
        view.show(&[0.5; 3], &mut shown);
        shown
    };
    for (seconds, gains) in [
        (-1.0, [0.0, 0.2, 0.2]),
        (0.0, [0.0, 0.2, 0.2]),
        (0.5, [0.1, 0.15, 0.1]),
        (9.0, [0.4, 0.0, -0.2]),
    ] {
        let (found, expected) = (image(response.at(seconds, &ERP)), image(with(gains)));
        let pairs = found.iter().zip(&expected);
        let error = pairs.fold(0.0_f32, |most, (a, b)| most.max((a - b).abs()));
        assert!(error < 1e-6, "{seconds}: {found:?} {expected:?}");
    }
    assert_eq!(
        image(response.of_view(0, &ERP)),
        image(with([0.4, 0.0, -0.2]))
    );
    let learnt = response.learnt();
    let gains = learnt.as_ref().map(|learnt| &learnt.gains);
    assert!(gains.is_some());
    let again = CameraResponse::new(vec![2.0, 0.0], &ERP, gains);
    let [found, expected] = [&again, &response].map(|of| &of.gains.arrays[0].values);
    for (found, expected) in found.iter().zip(expected) {
        assert!((found - expected).abs() < 1e-6);
    }
}

#[test]
fn a_step_moves_one_view_against_the_others() {
    let mut response = CameraResponse::new(vec![0.0, 1.0, 2.0, 3.0], &pinhole(), None);
    let gradient = ResponseGradient {
        gains: [1.0, -2.0, f64::NAN],
        shared: [0.5, 0.0, -1.0, 0.0, 3.0],
    };
    assert_eq!(response.step(2, &gradient, [0.4, 0.1]), [1, 0]);
    assert_eq!(
        (&response.steps[..], response.shared.steps),
        (&[0, 0, 1, 0][..], 1)
    );
    let expected = [
        0.1, -0.1, 0.0, 0.1, -0.1, 0.0, -0.3, 0.3, 0.0, 0.1, -0.1, 0.0,
    ];
    for (found, expected) in response.gains.arrays[0].values.iter().zip(expected) {
        assert!((found - expected).abs() < 1e-5, "{found} {expected}");
    }
    let shared = response.shared.array.values.iter();
    for (found, expected) in shared.zip([-0.1, 0.0, 0.1, 0.0, -0.1]) {
        assert!((found - expected).abs() < 1e-5, "{found} {expected}");
    }
}

#[test]
fn without_a_loss_all_numbers_are_drawn_to_the_identity() {
    let mut response = CameraResponse::new(vec![0.0, 1.0], &ERP, None);
    response.gains.arrays[0].values = vec![0.05, -0.05, 0.1, -0.05, 0.05, -0.1];
    response.shared.array.values = vec![0.1, -0.1];
    for step in 0..400 {
        response.step(step % 2, &ResponseGradient::default(), [1e-3, 1e-3]);
    }
    for array in response.arrays() {
        assert!(largest(array) < 0.02, "{array:?}");
    }
}

/// Returns the largest magnitude of an array's values.
fn largest(array: &ParameterArray) -> f32 {
    array
        .values
        .iter()
        .fold(0.0, |most, value| most.max(value.abs()))
}

/// Returns the response that is learnt by L1 from five images of a camera with another, beside the scene as it is.
fn learnt(truth: &CameraResponse, camera: &Camera) -> CameraResponse {
    let views = truth.steps.len();
    let [width, height] = camera.size();
    let mut random = Pcg64Mcg::seed_from_u64(7);
    let scene: Vec<f32> = (0..3 * width * height)
        .map(|_| random.random_range(0.02..1.0))
        .collect();
    let (mut image, mut by_render) = (Vec::new(), Vec::new());
    let bytes: Vec<Vec<f32>> = (0..views)
        .map(|view| {
            truth.of_view(view, camera).show(&scene, &mut image);
            let byte = |level: &f32| (255.0 * level.min(1.0)).round() / 255.0;
            image.iter().map(byte).collect()
        })
        .collect();
    let mut found = of_five_views(camera);
    let steps = 100 * views;
    for step in 0..steps {
        let view = step % views;
        let shown = found.of_view(view, camera);
        shown.show(&scene, &mut image);
        let pairs = image.iter().zip(&bytes[view]);
        let by_shown: Vec<f32> = pairs
            .map(|(&shown, &byte)| {
                let over = shown - byte;
                let is_settled = over == 0.0 || over > 0.0 && byte == 1.0;
                if is_settled {
                    0.0
                } else {
                    over.signum() / scene.len() as f32
                }
            })
            .collect();
        let gradient = shown.show_vjp(&scene, &by_shown, &mut by_render);
        let fall = 0.01_f32.powf(step as f32 / steps as f32);
        found.step(view, &gradient, [0.05 * fall, 0.02 * fall]);
    }
    found
}

#[test]
fn known_gains_and_gamma_are_recovered() {
    for exponent in [1.2_f32, 0.85] {
        let mut camera = of_five_views(&ERP);
        // Their mean is 0.
        camera.gains.arrays[0].values = vec![
            -0.3, -0.36, -0.3, 0.2, 0.14, 0.16, 0.1, -0.06, -0.14, 0.0, 0.04, 0.16, 0.0, 0.24, 0.12,
        ];
        camera.shared.array.values = vec![exponent.ln(), 0.0];
        let found = learnt(&camera, &ERP);
        let gains = |of: &CameraResponse| of.gains.arrays[0].values.clone();
        for (found, expected) in gains(&found).iter().zip(gains(&camera)) {
            assert!((found - expected).abs() < 0.03, "{found} {expected}");
        }
        let curve = &found.shared.array.values;
        assert!((curve[0].exp() / exponent - 1.0).abs() < 0.03, "{curve:?}");
        assert!(curve[1].abs() < 0.03, "{curve:?}");
    }
}

#[test]
fn a_camera_without_a_response_stays_within_half_a_percent() {
    let camera = of_five_views(&ERP);
    let found = learnt(&camera, &ERP);
    for array in found.arrays() {
        let most = largest(array);
        assert!(most < 0.005, "{}: {most}", array.name);
    }
}

#[test]
fn a_vignette_is_recovered() {
    let camera = pinhole();
    for vignette in [[-0.4, -0.2, 0.1], [-0.8, 0.0, 0.0]] {
        let mut truth = of_five_views(&camera);
        truth.shared.array.values[CURVE_VALUES..].copy_from_slice(&vignette);
        let found = learnt(&truth, &camera);
        let found = found.learnt().and_then(|found| found.vignette);
        let light = |[a1, a2, a3]: [f32; 3], r: f32| (a1 * r + a2 * r * r + a3 * r.powi(3)).exp();
        for r in [0.25, 0.5, 0.75] {
            let ratio = found.map(|found| light(found, r) / light(vignette, r));
            assert!(
                ratio.is_some_and(|ratio| (ratio - 1.0).abs() < 0.03),
                "{r}: {found:?}"
            );
        }
    }
}

/// Returns a new response of a camera for five views.
fn of_five_views(camera: &Camera) -> CameraResponse {
    CameraResponse::new((0..5).map(f64::from).collect(), camera, None)
}
