//! Symmetry of the sphere: seam and poles have no effect.

use glam::{DQuat, DVec3, dvec2, dvec3};
use omnilife_engine::{
    gaussians::ActivatedGaussians,
    render::{cpu::Renderer, settings::Footprint},
};
use omnilife_schemas::camera::{Camera, CameraModel, ErpCamera};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

use super::{
    FOOTPRINTS, erp, pinhole, settings,
    support::{
        reference::{Gaussian, RefView, instant},
        scenes::{Richness, at, scene},
    },
};

/// Checks that a half rotation of the camera with the image rolled back changes nothing: the seam has no effect.
#[test]
fn half_a_turn_moves_the_seam_and_nothing_else() {
    let mut random = Pcg64Mcg::seed_from_u64(13);
    let richness = Richness::new(0, 0);
    let gaussians = scene(&mut random, 200, richness);
    let instant = instant(&gaussians);
    for (width, footprint) in [128, 120]
        .into_iter()
        .flat_map(|w| FOOTPRINTS.map(|f| (w, f)))
    {
        let straight = RefView::new(
            erp(width),
            DQuat::IDENTITY,
            DVec3::ZERO,
            settings(footprint),
        );
        let mut back = straight.view();
        back.rotation = glam::Mat3::from_diagonal(glam::vec3(-1.0, 1.0, -1.0));
        let mut renderer = Renderer::new(straight.settings);
        let first = renderer.forward(&straight.view(), &instant).colour.clone();
        let second = renderer.forward(&back, &instant).colour.clone();
        let (row, half) = (width as usize * 3, width as usize / 2 * 3);
        let largest = first
            .iter()
            .enumerate()
            .map(|(index, value)| {
                let rolled = index / row * row + (index % row + half) % row;
                (value - second[rolled]).abs()
            })
            .fold(0.0, f32::max);
        assert!(largest < 1e-5, "{largest} at width {width}, {footprint:?}");
    }
}

/// Resamples an image rotated by `turn` (from the other camera's frame to this one's).
fn resampled(image: &[f32], camera: ErpCamera, turn: DQuat) -> Vec<f32> {
    seen_by(&camera.into(), image, camera, turn)
}

/// Returns a camera's view of a panorama, by Catmull-Rom interpolation; `turn` is from its frame to the
/// panorama's.
fn seen_by(other: &Camera, image: &[f32], camera: ErpCamera, turn: DQuat) -> Vec<f32> {
    let (width, height) = (i64::from(camera.width), i64::from(camera.height));
    let kernel = |x: f64| {
        let x = x.abs();
        if x < 1.0 {
            1.5 * x.powi(3) - 2.5 * x * x + 1.0
        } else if x < 2.0 {
            -0.5 * x.powi(3) + 2.5 * x * x - 4.0 * x + 2.0
        } else {
            0.0
        }
    };
    // Beyond a pole the image continues downwards, half a rotation away.
    let fetch = |column: i64, row: i64, channel: usize| {
        let (column, row) = if row < 0 {
            (column + width / 2, -1 - row)
        } else if row >= height {
            (column + width / 2, 2 * height - 1 - row)
        } else {
            (column, row)
        };
        let pixel = row * width + column.rem_euclid(width);
        f64::from(image[pixel as usize * 3 + channel])
    };
    let [columns, rows] = other.size();
    let mut out = Vec::with_capacity(3 * columns * rows);
    for pixel in 0..columns * rows {
        let centre = dvec2(
            (pixel % columns) as f64 + 0.5,
            (pixel / columns) as f64 + 0.5,
        );
        let place = camera.project(turn * other.unproject(centre)).unwrap() - 0.5;
        let first = place.floor();
        for channel in 0..3 {
            let mut sum = 0.0;
            for dy in -1..=2 {
                for dx in -1..=2 {
                    let (x, y) = (first.x as i64 + dx, first.y as i64 + dy);
                    sum += kernel(place.x - x as f64)
                        * kernel(place.y - y as f64)
                        * fetch(x, y, channel);
                }
            }
            out.push(sum as f32);
        }
    }
    out
}

/// Returns Gaussians all around the sphere, each at another distance: rounding must not decide their order.
fn all_around(count: u32, scales: std::ops::Range<f64>) -> ActivatedGaussians {
    let mut random = Pcg64Mcg::seed_from_u64(17);
    let gaussians: Vec<Gaussian> = (0..count)
        .map(|index| {
            let y = 1.0 - (f64::from(index) + 0.5) / f64::from(count) * 2.0;
            let (sin, cos) = (2.399_963 * f64::from(index)).sin_cos();
            let rho = (1.0 - y * y).sqrt();
            let distance = 2.0 + 2.0 * f64::from(index) / f64::from(count);
            let scale = [0; 3].map(|_| random.random_range(scales.clone()));
            let mut gaussian = at(dvec3(rho * cos, y, rho * sin), distance, scale, 0.6);
            gaussian.quaternion = [0; 4].map(|_| random.random_range(-1.0..1.0));
            gaussian.sh = vec![[0; 3].map(|_| random.random_range(-1.0..1.0))];
            gaussian.rounded()
        })
        .collect();
    instant(&gaussians)
}

/// Checks that a pitch by a quarter rotation brings the poles to the horizon: rotated back, the image is the same
/// up to resampling. The effect of resampling alone is measured without poles: the same Gaussians at the horizon,
/// rotated by up to half a pixel. Compared are root mean squares over all pixels within 30 degrees of the poles.
/// Single pixels may differ where the edges of footprints, steps of 1/255, fall between pixels.
#[test]
fn a_quarter_turn_moves_the_poles_and_nothing_else() {
    let camera = ErpCamera::new(256, 128);
    let half_pixel = std::f64::consts::PI / f64::from(camera.height) / 2.0;
    let quarter = DQuat::from_rotation_x(std::f64::consts::FRAC_PI_2);
    // Along the ray nothing is linearized. The projected footprint is linearized, and its low-pass filter is a
    // share of a pixel wide. A pixel spans less of the sphere at a pole, so that the result differs there by
    // definition.
    let gaussians = all_around(220, 0.1..0.25);
    let draw = |rotation: DQuat| {
        let view = RefView::new(camera, rotation, DVec3::ZERO, settings(Footprint::Ray));
        let mut renderer = Renderer::new(view.settings);
        renderer.forward(&view.view(), &gaussians).colour.clone()
    };
    let difference = |from: DQuat, turn: DQuat| -> Vec<f32> {
        let back = resampled(&draw(turn * from), camera, turn);
        let plain = draw(from);
        plain.iter().zip(&back).map(|(a, b)| a - b).collect()
    };
    let row = camera.width as usize * 3;
    let pole_rows = difference(DQuat::IDENTITY, quarter);
    let at_poles = Spread::of(pole_rows[..21 * row].iter().chain(&pole_rows[107 * row..]));
    let by_resampling = [[1.0, 0.0], [0.0, 1.0], [1.0, 1.0], [0.5, 0.5]].map(|[x, y]| {
        let turn = DQuat::from_rotation_y(y * half_pixel) * DQuat::from_rotation_x(x * half_pixel);
        let horizon_rows = difference(quarter, turn);
        Spread::of(&horizon_rows[43 * row..85 * row])
    });
    let usual = by_resampling.iter().map(|s| s.rms).fold(0.0, f64::max);
    let most = by_resampling.iter().map(|s| s.largest).fold(0.0, f64::max);
    assert!(
        at_poles.rms <= usual && at_poles.largest <= most + 1.0 / 255.0,
        "{at_poles:?} at the poles, {by_resampling:?} by resampling alone"
    );
}

/// Checks that a pinhole and a panorama in one place show the same in their common directions, across the seam
/// and the poles. A shift by one pixel is a difference.
#[test]
fn a_pinhole_and_a_panorama_agree_on_their_overlap() {
    let panorama = ErpCamera::new(1024, 512);
    // Pixels of about the same size: a Gaussian smaller than a pixel is spread over it.
    let narrow = pinhole(330, 240);
    let centre = dvec3(0.1, -0.05, 0.2);
    // Footprints in the image are linear about their middles, in each camera differently: the smaller, the
    // nearer.
    let large = all_around(220, 0.1..0.25);
    let small = all_around(2000, 0.02..0.06);
    for (footprint, gaussians, most) in [
        (Footprint::Ray, &large, 3e-4),
        (Footprint::Projected, &small, 3e-3),
    ] {
        let draw = |camera: Camera, rotation: DQuat| {
            let view = RefView::new(camera, rotation, centre, settings(footprint));
            let mut renderer = Renderer::new(view.settings);
            renderer.forward(&view.view(), gaussians).colour.clone()
        };
        let whole = draw(panorama.into(), DQuat::IDENTITY);
        for (towards, rotation) in [
            ("ahead", DQuat::IDENTITY),
            ("the seam", DQuat::from_rotation_y(3.0)),
            (
                "a pole",
                DQuat::from_rotation_x(1.4) * DQuat::from_rotation_y(0.4),
            ),
            (
                "askew",
                DQuat::from_rotation_z(0.7) * DQuat::from_rotation_y(1.9),
            ),
        ] {
            let drawn = draw(narrow, rotation);
            let of_panorama = seen_by(&narrow, &whole, panorama, rotation.inverse());
            let differences = |shift: usize| -> Vec<f32> {
                let moved = drawn[3 * shift..].iter().zip(&of_panorama);
                moved.map(|(a, b)| a - b).collect()
            };
            let [same, beside] = [0, 1].map(|shift| Spread::of(&differences(shift)));
            assert!(same.rms < most, "{footprint:?}, {towards}: {same:?}");
            assert!(beside.rms > 3.0 * same.rms, "{beside:?} beside {same:?}");
        }
    }
}

/// Distance of values from zero.
#[derive(Debug, Clone, Copy)]
struct Spread {
    rms: f64,
    largest: f64,
}

impl Spread {
    fn of<'a>(values: impl IntoIterator<Item = &'a f32>) -> Self {
        let (mut count, mut squares, mut largest) = (0_usize, 0.0, 0.0_f64);
        for value in values {
            let value = f64::from(*value);
            count += 1;
            squares += value * value;
            largest = largest.max(value.abs());
        }
        Self {
            rms: (squares / count as f64).sqrt(),
            largest,
        }
    }
}

#[test]
fn a_gaussian_over_a_pole_covers_every_column_without_holes() {
    for (y, footprint) in [-1.0, 1.0]
        .into_iter()
        .flat_map(|y| FOOTPRINTS.map(|f| (y, f)))
    {
        let gaussian = at(dvec3(0.0, y, 0.0), 2.0, [0.4; 3], 0.9);
        let instant = instant(&[gaussian]);
        let width = 96;
        let view = RefView::new(
            erp(width),
            DQuat::IDENTITY,
            DVec3::ZERO,
            settings(footprint),
        );
        let mut renderer = Renderer::new(view.settings);
        let raster = renderer.forward(&view.view(), &instant);
        let (width, height) = (width as usize, width as usize / 2);
        let row = if y < 0.0 { 0 } else { height - 1 };
        let pole_row = &raster.transmittance[row * width..(row + 1) * width];
        let (first, rest) = pole_row.split_first().unwrap();
        assert!(*first < 0.2, "the pole row lets {first} through");
        // A round Gaussian at the exact pole looks the same from every longitude.
        for left in rest {
            assert!((left - first).abs() < 1e-5, "{left} beside {first}");
        }
    }
}
