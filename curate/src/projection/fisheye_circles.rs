//! Detection of fisheye circles: black around them, or two of them that see the same rim.

use omnilife_schemas::statistics;
use std::f64::consts::TAU;

use super::{ProjectionTest, black_border::is_black, median_over};
use crate::video::Rgb8Image;

/// Tested radii, as shares of half the image (of half of each half for two circles): from this to 1 in so many steps.
const SMALLEST_RADIUS: f64 = 0.8;
const RADIUS_STEPS: u32 = 40;
/// Width of the ring inside a circle that must contain image.
const RING: f64 = 0.1;
/// Half the width of the ignored border between circle and surroundings.
const BORDER: f64 = 0.02;

/// Points on a rim.
const RIM_POINTS: usize = 180;
/// Largest tested rotation of one lens against the other, in rim points of 2 degrees.
const LARGEST_TURN: usize = 3;
/// Radius in rim points of the mean that is removed: any rim is bright above and dark below.
const RIM_DETAIL_RADIUS: usize = 10;

/// Least peak of the correlation at the right radius.
const LEAST_PEAK: f64 = 0.15;

/// Black around one or two circles.
pub(super) const BLACK_AROUND: ProjectionTest = ProjectionTest {
    id: "black-around-circles",
    summary: "Share of black outside of one or two circles less that just inside, for the radius \
              that fits best.",
    limit: 0.7,
    at_most: "no circles amid black",
    above: "circles amid black, as of fisheye lenses",
    measure: |_, samples| median_over(samples, black_around),
};

/// Two circles that meet on the sphere.
pub(super) const COMMON_RIM: ProjectionTest = ProjectionTest {
    id: "common-rim",
    summary: "Correlation of detail along the rims of two circles side by side, one of them \
              mirrored: two fisheye lenses back to back see the same rim.",
    limit: 0.85,
    at_most: "two circles side by side would have nothing in common",
    above: "two circles side by side see the same rim",
    measure: |_, samples| median_over(samples, common_rim),
};

fn radii() -> impl Iterator<Item = f64> {
    (0..=RADIUS_STEPS).map(|step| {
        SMALLEST_RADIUS + (1.0 - SMALLEST_RADIUS) * f64::from(step) / f64::from(RADIUS_STEPS)
    })
}

/// Returns `None` for a frame without black or of black alone, which gives no evidence.
fn black_around(image: &Rgb8Image) -> Option<f64> {
    let black: Vec<bool> = (0..image.width * image.height)
        .map(|at| is_black(image.pixel(at % image.width, at / image.width)))
        .collect();
    let count = black.iter().filter(|&&black| black).count();
    if count == black.len() {
        return None;
    }
    let mut best = 0.0_f64;
    for circles in [1, 2] {
        // Black and all pixels by distance from the nearest centre, in hundredths of the radius.
        let mut rings = [(0_u32, 0_u32); 128];
        let half = 0.5 / f64::from(circles);
        for (at, &black) in black.iter().enumerate() {
            let u = (at % image.width) as f64 + 0.5;
            let v = (at / image.width) as f64 + 0.5;
            let across = (u / image.width as f64) % (2.0 * half) / half - 1.0;
            let down = 2.0 * v / image.height as f64 - 1.0;
            let radius = (across * across + down * down).sqrt();
            let ring = ((radius * 100.0) as usize).min(127);
            rings[ring].0 += u32::from(black);
            rings[ring].1 += 1;
        }
        let share = |from: f64, to: f64| {
            let range = (from * 100.0).round() as usize..((to * 100.0).round() as usize).min(128);
            let (black, all) = rings[range]
                .iter()
                .fold((0, 0), |sum, ring| (sum.0 + ring.0, sum.1 + ring.1));
            f64::from(black) / f64::from(all.max(1))
        };
        for radius in radii() {
            let outside = share(radius + BORDER, 1.28);
            let inside = share(radius - BORDER - RING, radius - BORDER);
            best = best.max(outside - inside);
        }
    }
    Some(best)
}

/// Returns `None` if the rims have no detail, or all radii agree: then the image is so plain that all its circles look
/// alike.
fn common_rim(image: &Rgb8Image) -> Option<f64> {
    let by_radius: Vec<f64> = radii()
        .filter_map(|radius| {
            // The lenses look opposite ways: the right of one is the left of the other.
            let left = detail(&rim(image, 0.25, radius, 1.0))?;
            let right = detail(&rim(image, 0.75, radius, -1.0))?;
            (0..=2 * LARGEST_TURN)
                .map(|turn| turned_correlation(&left, &right, turn))
                .max_by(f64::total_cmp)
        })
        .collect();
    let best = by_radius.iter().copied().max_by(f64::total_cmp)?;
    (best - statistics::median(&by_radius)? >= LEAST_PEAK).then_some(best)
}

/// Returns the correlation of two rims, the second turned by `turn - LARGEST_TURN` points.
fn turned_correlation(left: &[[f64; 3]], right: &[[f64; 3]], turn: usize) -> f64 {
    (0..RIM_POINTS)
        .map(|at| {
            let other = right[(at + RIM_POINTS + turn - LARGEST_TURN) % RIM_POINTS];
            left[at].iter().zip(other).map(|(a, b)| a * b).sum::<f64>()
        })
        .sum()
}

/// Colours along a circle about the centre of one half, bilinear.
fn rim(image: &Rgb8Image, centre: f64, radius: f64, direction: f64) -> Vec<[f64; 3]> {
    let (width, height) = (image.width as f64, image.height as f64);
    (0..RIM_POINTS)
        .map(|at| {
            let angle = TAU * at as f64 / RIM_POINTS as f64;
            let x = (centre + direction * 0.25 * radius * angle.cos()) * width - 0.5;
            let y = (0.5 + 0.5 * radius * angle.sin()) * height - 0.5;
            bilinear(image, x, y)
        })
        .collect()
}

fn bilinear(image: &Rgb8Image, x: f64, y: f64) -> [f64; 3] {
    let x = x.clamp(0.0, (image.width - 1) as f64);
    let y = y.clamp(0.0, (image.height - 1) as f64);
    let (left, top) = (x as usize, y as usize);
    let (right, bottom) = (
        (left + 1).min(image.width - 1),
        (top + 1).min(image.height - 1),
    );
    let (share_x, share_y) = (x - left as f64, y - top as f64);
    std::array::from_fn(|channel| {
        let level = |x, y| f64::from(image.pixel(x, y)[channel]);
        let above = level(left, top) * (1.0 - share_x) + level(right, top) * share_x;
        let below = level(left, bottom) * (1.0 - share_x) + level(right, bottom) * share_x;
        above * (1.0 - share_y) + below * share_y
    })
}

/// Returns colours along a closed curve without their means over `radius` points to either side; `radius` must not
/// exceed the number of points.
pub(crate) fn without_local_mean(curve: &[[f64; 3]], radius: usize) -> Vec<[f64; 3]> {
    let count = 2 * radius + 1;
    let points = curve.len();
    (0..points)
        .map(|at| {
            let mut point = curve[at];
            for offset in 0..count {
                let other = curve[(at + points + offset - radius) % points];
                for (level, neighbour) in point.iter_mut().zip(other) {
                    *level -= neighbour / count as f64;
                }
            }
            point
        })
        .collect()
}

/// Returns a rim without its local mean, of unit norm.
fn detail(rim: &[[f64; 3]]) -> Option<Vec<[f64; 3]>> {
    let mut detail = without_local_mean(rim, RIM_DETAIL_RADIUS);
    let norm = detail
        .iter()
        .flatten()
        .map(|level| level * level)
        .sum::<f64>()
        .sqrt();
    // 1.5 levels on average.
    if norm < 1.5 * ((3 * RIM_POINTS) as f64).sqrt() {
        return None;
    }
    detail.iter_mut().flatten().for_each(|level| *level /= norm);
    Some(detail)
}
