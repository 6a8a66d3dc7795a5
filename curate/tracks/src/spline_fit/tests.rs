use glam::{DMat3, dvec3};
use omnilife_schemas::camera::{Camera, CameraModel, ErpCamera, PinholeCamera};

use std::path::Path;

use serde::Deserialize;

use super::*;

struct Noise(u64);

impl Noise {
    fn uniform(&mut self) -> f64 {
        self.0 = self
            .0
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 11) as f64 / (1_u64 << 53) as f64
    }

    fn normal(&mut self) -> f64 {
        (-2.0 * self.uniform().max(1e-300).ln()).sqrt() * (TAU * self.uniform()).cos()
    }
}

/// Cameras that fly over a path and look down.
fn views(times: &[f64], camera: Camera) -> Vec<PosedView> {
    times
        .iter()
        .enumerate()
        .map(|(frame, &seconds)| PosedView {
            frame: frame as u32,
            seconds,
            camera,
            to_world: DMat3::from_cols(DVec3::X, -DVec3::Y, -DVec3::Z)
                * DMat3::from_rotation_x(0.2 + 0.02 * seconds),
            centre: dvec3(0.5 * seconds, -12.0 + seconds, 50.0),
        })
        .collect()
}

fn pinhole() -> Camera {
    PinholeCamera::with_horizontal_field_of_view(640, 360, 1.14).into()
}

/// Returns a car that comes, stops for four seconds and turns away.
fn truth(seconds: f64) -> DVec3 {
    let along = |seconds: f64| 6.0 * seconds.min(6.0) + 6.0 * (seconds - 10.0).max(0.0);
    let turned = (seconds - 12.0).max(0.0);
    dvec3(along(seconds) - 30.0, 0.25 * turned * turned, 0.75)
}

fn observe<'a>(
    views: &'a [PosedView],
    noise: &mut Noise,
    [pixels, distance]: [f64; 2],
    path: impl Fn(f64) -> DVec3,
) -> Vec<Observation<'a>> {
    views
        .iter()
        .filter_map(|view| {
            let place = path(view.seconds);
            let mut pixel = view.camera.project(view.in_camera(place))?;
            pixel += pixels * DVec2::new(noise.normal(), noise.normal());
            if pixels > 0.0 && noise.uniform() < 0.08 {
                pixel += 30.0 * DVec2::new(noise.normal(), noise.normal());
            }
            Some(Observation {
                view,
                pixel,
                distance: place.distance(view.centre) * (1.0 + distance * noise.normal()),
                slack: 1.0,
            })
        })
        .collect()
}

fn mean_error(errors: impl Iterator<Item = f64>) -> f64 {
    let errors: Vec<f64> = errors.collect();
    (errors.iter().map(|e| e * e).sum::<f64>() / errors.len() as f64).sqrt()
}

#[test]
fn a_path_without_noise_is_recovered_by_any_camera() {
    let times: Vec<f64> = (0..41).map(|n| 0.5 * f64::from(n)).collect();
    let erp = ErpCamera {
        width: 1024,
        height: 512,
    }
    .into();
    for camera in [pinhole(), erp] {
        let views = views(&times, camera);
        let observations = observe(&views, &mut Noise(1), [0.0, 0.0], truth);
        let fitted = fit_with(&observations, 3, 27, 0.005).expect("a path");
        let error = mean_error(views.iter().map(|view| {
            fitted
                .spline
                .position(view.seconds)
                .distance(truth(view.seconds))
        }));
        assert!(error < 0.2, "{error} m");
    }
}

/// From one detection, which gives only a place, to as many as have a cubic path; a whole fit, and its start.
#[test]
fn paths_far_from_the_origin_are_those_near_it() {
    let offset = dvec3(5e5, 5e6, 0.0);
    for count in [1, 2, 3, 4, 9] {
        let times: Vec<f64> = (0..count).map(|n| 0.5 * f64::from(n)).collect();
        let near = views(&times, pinhole());
        let mut far = near.clone();
        for view in &mut far {
            view.centre += offset;
        }
        let of_near = observe(&near, &mut Noise(7), [1.0, 0.01], truth);
        let of_far: Vec<Observation<'_>> = of_near
            .iter()
            .zip(&far)
            .map(|(one, view)| Observation { view, ..*one })
            .collect();
        let fitted = [&of_near, &of_far].map(|all| fit(all, 0.01).expect("a path").spline);
        let begun = [&of_near, &of_far].map(|all| {
            let mut spline = fitted[0].clone();
            lift(&mut spline, all, LIFT_PULL).expect("a path");
            spline
        });
        for ([near, far], reach) in [(fitted, 1e-3), (begun, 1e-5)] {
            assert_eq!(near.coefficients.len(), far.coefficients.len());
            for (one, other) in near.coefficients.iter().zip(&far.coefficients) {
                let moved = DVec3::from_array(*one) + offset;
                let error = moved.distance(DVec3::from_array(*other));
                assert!(error < reach, "{count} detections: {error} m");
            }
        }
    }
}

#[test]
fn a_path_is_nearer_than_its_lifted_detections() {
    let times: Vec<f64> = (0..41).map(|n| 0.5 * f64::from(n)).collect();
    let views = views(&times, pinhole());
    for (sigma, most) in [(0.02, 0.6), (0.005, 0.7)] {
        let (mut raw, mut fitted) = (0.0, 0.0);
        for seed in 0..10 {
            let observations = observe(&views, &mut Noise(seed), [1.5, sigma], truth);
            raw += mean_error(
                observations
                    .iter()
                    .map(|o| o.position().distance(truth(o.view.seconds))),
            );
            let path = fit(&observations, sigma).expect("a path");
            fitted += mean_error(observations.iter().map(|o| {
                path.spline
                    .position(o.view.seconds)
                    .distance(truth(o.view.seconds))
            }));
        }
        assert!(fitted < most * raw, "{sigma}: {fitted} against {raw}");
    }
}

/// Checks that the same detections weigh as much in images of twice the size, but for the least pixels.
#[test]
fn detections_have_the_error_of_an_angle() {
    let pinhole = |width: u32| -> Camera {
        PinholeCamera::with_horizontal_field_of_view(width, width * 9 / 16, 1.14).into()
    };
    let [small, usual, large] = [160, 640, 2560].map(|width| sigma_pixels(&pinhole(width)));
    assert!((usual - 2.0).abs() < 0.01 && (large - 4.0 * usual).abs() < 1e-9);
    assert_eq!(small, LEAST_SIGMA_PIXELS);
    let erp = |width: u32| {
        Camera::from(ErpCamera {
            width,
            height: width / 2,
        })
    };
    assert!((sigma_pixels(&erp(4096)) / 4096.0 * TAU - 0.004).abs() < 1e-12);
}

#[test]
fn one_two_and_three_detections_make_points_lines_and_arcs() {
    for count in 1..=3 {
        let times: Vec<f64> = (0..count).map(f64::from).collect();
        let views = views(&times, pinhole());
        let observations = observe(&views, &mut Noise(3), [0.0, 0.0], truth);
        let path = fit(&observations, 0.005).expect("a path");
        assert_eq!(path.spline.degree, count as usize - 1);
        assert_eq!(path.spline.fault(), None);
        for view in &views {
            let error = path
                .spline
                .position(view.seconds)
                .distance(truth(view.seconds));
            assert!(error < 1e-3, "{count}: {error}");
        }
    }
    assert_eq!(fit(&[], 0.005), None);
}

#[test]
fn gaps_and_detections_at_one_time_do_no_harm() {
    let mut times: Vec<f64> = (0..10).map(|n| 0.5 * f64::from(n)).collect();
    times.extend((0..10).map(|n| 16.0 + 0.5 * f64::from(n)));
    let across_a_gap = views(&times, pinhole());
    let path = fit(
        &observe(&across_a_gap, &mut Noise(2), [0.0, 0.0], truth),
        0.005,
    )
    .expect("a path");
    assert!(
        path.spline
            .coefficients
            .as_flattened()
            .iter()
            .all(|value| value.abs() < 200.0)
    );
    let at_once = views(&[3.0; 6], pinhole());
    let path = fit(&observe(&at_once, &mut Noise(2), [0.0, 0.0], truth), 0.005).expect("a path");
    assert!(path.spline.position(3.0).distance(truth(3.0)) < 0.1);
}

/// Output of `scripts/golden/spline.py` with `SciPy`.
#[derive(Deserialize)]
struct Golden {
    intrinsics: [f64; 4],
    times: Vec<f64>,
    centres: Vec<DVec3>,
    /// Rows.
    to_world: Vec<[[f64; 3]; 3]>,
    pixels: Vec<DVec2>,
    distances: Vec<f64>,
    fits: Vec<GoldenFit>,
}

#[derive(Deserialize)]
struct GoldenFit {
    knots: Vec<f64>,
    /// Coefficients of `make_lsq_spline` through the lifted places.
    coefficients: Vec<[f64; 3]>,
    /// The least sum of Huber losses that `least_squares` finds.
    huber: f64,
}

#[test]
fn least_squares_and_huber_fits_are_those_of_scipy() {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/golden/spline.json");
    let golden = std::fs::read(file).expect("the golden file");
    let golden: Golden = serde_json::from_slice(&golden).expect("sound JSON");
    let [fx, fy, cx, cy] = golden.intrinsics;
    let camera = Camera::Pinhole(PinholeCamera {
        width: 640,
        height: 360,
        fx,
        fy,
        cx,
        cy,
    });
    let view = |frame: usize| PosedView {
        frame: frame as u32,
        seconds: golden.times[frame],
        camera,
        to_world: DMat3::from_cols_array_2d(&golden.to_world[frame]).transpose(),
        centre: golden.centres[frame],
    };
    let views: Vec<PosedView> = (0..golden.times.len()).map(view).collect();
    let observation = |frame: usize| Observation {
        view: &views[frame],
        pixel: golden.pixels[frame],
        distance: golden.distances[frame],
        slack: 1.0,
    };
    let observations: Vec<Observation<'_>> = (0..views.len()).map(observation).collect();
    let [begin, end] = [0, views.len() - 1].map(|frame| golden.times[frame]);
    for fit in golden.fits {
        let size = fit.coefficients.len();
        let mut spline = BSpline {
            degree: 3,
            knots: BSpline::uniform_knots(3, size, begin, end),
            coefficients: vec![[0.0; 3]; size],
        };
        for (knot, expected) in spline.knots.iter().zip(&fit.knots) {
            assert!((knot - expected).abs() < 1e-12, "{knot} {expected}");
        }
        lift(&mut spline, &observations, 0.0).expect("a spline");
        let values = spline.coefficients.as_flattened().iter();
        for (value, expected) in values.zip(fit.coefficients.as_flattened()) {
            assert!(
                (value - expected).abs() < 1e-9 * expected.abs().max(1.0),
                "{value} {expected}"
            );
        }
        let path = fit_with(&observations, 3, size, 0.005).expect("a path");
        let loss = total_loss(&path.spline, &observations, 0.005);
        assert!(
            loss < fit.huber * (1.0 + 1e-4),
            "{size}: {loss}, SciPy {}",
            fit.huber
        );
        assert!(
            loss > fit.huber * (1.0 - 1e-4),
            "{size}: {loss}, SciPy {}",
            fit.huber
        );
    }
}

/// BIC chooses among six numbers of coefficients. Paths are made with one of them, each time another way.
#[test]
fn bic_chooses_the_number_that_made_the_path_or_the_next() {
    let times: Vec<f64> = (0..40).map(|n| 0.5 * f64::from(n)).collect();
    let views = views(&times, pinhole());
    // Of 40 detections.
    let sizes = [4, 8, 10, 13, 20, 27];
    let (mut near, mut all) = (0, 0);
    for (number, size) in sizes.into_iter().enumerate() {
        for seed in 0..10 {
            let mut noise = Noise(1 + seed + 100 * number as u64);
            let mut place = dvec3(0.0, 8.0, 0.75);
            let step = 80.0 / size as f64;
            let mut coefficients = Vec::new();
            for _ in 0..size {
                place += step * dvec3(noise.normal(), noise.normal(), 0.0);
                // It stays in sight.
                place = place.clamp(dvec3(-22.0, -6.0, 0.75), dvec3(22.0, 14.0, 0.75));
                coefficients.push(place.to_array());
            }
            let made = BSpline {
                degree: 3,
                knots: BSpline::uniform_knots(3, size, 0.0, 19.5),
                coefficients,
            };
            let observations = observe(&views, &mut noise, [1.5, 0.005], |seconds| {
                made.position(seconds)
            });
            let path = fit(&observations, 0.005).expect("a path");
            let found = path.spline.coefficients.len();
            let chosen = sizes.iter().position(|&size| size == found);
            let chosen = chosen.unwrap_or_else(|| panic!("{found} is not one of the numbers"));
            near += usize::from(chosen.abs_diff(number) <= 1);
            all += 1;
        }
    }
    assert!(10 * near >= 9 * all, "{near} of {all}");
}
