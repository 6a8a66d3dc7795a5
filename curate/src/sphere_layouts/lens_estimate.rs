//! Estimation of a camera's two lenses from its frames: their circles, from the black around them, and their field of
//! view, from their overlap.
//!
//! The position of a direction depends on the pixels per radian alone. Glare around a lens makes its circle look
//! larger. The estimated field of view then grows by as much, and directions stay in place.

use std::{f64::consts::TAU, path::Path};

use glam::{DMat3, DVec2, DVec3, dvec2, dvec3};
use omnilife_schemas::{
    interpolation::{Edges, bilinear},
    records::{CheckOutcome, FisheyeCircle, Probe, SphereLayout},
    statistics,
};
use omnilife_video::{Converter, Rgb8Image, Scaling, VideoReader};
use rayon::prelude::*;

use super::places::Lens;
use crate::{
    criteria,
    error::CurateError,
    projection::{FrameSamples, black_border::is_black, fisheye_circles::without_local_mean},
};

/// Width of the examined frames, pixels: finer than a quarter of a degree.
const WIDTH_PIXELS: u32 = 2048;
/// Tested fields of view, degrees, in these steps.
const FIELDS_OF_VIEW_DEGREES: [f64; 2] = [183.0, 280.0];
const STEP_DEGREES: f64 = 0.5;
/// Rings around the plane between the lenses, on which their images are compared, degrees to either side.
const RINGS_DEGREES: [f64; 5] = [-2.0, -1.0, 0.0, 1.0, 2.0];
/// Number of samples on a ring.
const RING_PLACES: usize = 360;
/// Radius, in samples, of the mean that is subtracted from a ring: lenses differ in brightness at their rims.
const DETAIL_RADIUS: usize = 10;
/// The share of a circle's radius up to which its rim is sharp.
const SHARP_SHARE: f64 = 0.985;
/// Minimum correlation of both images at the right field of view, and its minimum excess over most others.
const LEAST_CORRELATION: f64 = 0.75;
const LEAST_PEAK: f64 = 0.15;

/// Number of rays that search for the edge of a circle, the minimum that must meet one, and their maximum median
/// distance from the circle, as a share of its radius.
const CIRCLE_RAYS: usize = 360;
const LEAST_CIRCLE_RAYS: usize = 120;
const LARGEST_RESIDUAL: f64 = 0.01;

/// Estimates the layout of a video of two fisheye circles with unknown lenses.
///
/// # Errors
/// When the video cannot be decoded; a rejection if no field of view aligns the overlap of the lenses.
pub(crate) fn estimated_dual_fisheye(
    video: &Path,
    probe: &Probe,
) -> Result<SphereLayout, CurateError> {
    let mut reader = VideoReader::open(video)?;
    reader.choose_key_frames();
    let mut converter = Converter::new(Scaling::MaxWidth(WIDTH_PIXELS));
    let turns = probe.clockwise_quarter_turns();
    let mut samples = FrameSamples::default();
    while let Some(frame) = reader.next_frame()? {
        if samples.wants(frame.time_seconds) {
            let image = converter.convert(video, &frame.image)?.turned(turns);
            samples.offer(frame.time_seconds, image);
        }
    }
    estimate(samples.images()).map_err(|reason| {
        let check = CheckOutcome {
            check: criteria::PROJECTION.to_owned(),
            passed: false,
            value: reason.clone(),
            threshold: "two fisheye lenses".to_owned(),
        };
        let reason = format!(
            "{reason}; if it has two, say what they see: --projection dual-fisheye:DEGREES"
        );
        CurateError::rejected(video, reason, vec![check])
    })
}

/// Returns the layout of these frames; an error gives the reason in words.
fn estimate(frames: &[Rgb8Image]) -> Result<SphereLayout, String> {
    let Some(first) = frames.first() else {
        return Err("none of its key frames can be decoded".to_owned());
    };
    let size = dvec2(first.width as f64, first.height as f64);
    let circles = [0, 1].map(|half| circle(frames, half).unwrap_or(FisheyeCircle::WHOLE));
    let [least, most] = FIELDS_OF_VIEW_DEGREES;
    let tried: Vec<f64> = (0..=((most - least) / STEP_DEGREES) as usize)
        .map(|step| least + STEP_DEGREES * step as f64)
        .collect();
    let scores: Vec<f64> = tried
        .par_iter()
        .map(|degrees| likeness(frames, size, &circles, degrees.to_radians()))
        .collect();
    let best = (0..scores.len()).max_by(|&a, &b| scores[a].total_cmp(&scores[b]));
    let best = best.unwrap_or(0);
    let stands_out = scores[best] - statistics::median(&scores).unwrap_or(1.0);
    // At an end of the range the best value would lie beyond it.
    let is_inside = best > 0 && best + 1 < scores.len();
    let fault = if scores[best] < LEAST_CORRELATION {
        Some(format!(
            "is {:.2}, {LEAST_CORRELATION} is asked for",
            scores[best]
        ))
    } else if stands_out < LEAST_PEAK {
        Some("is as good at most others".to_owned())
    } else {
        (!is_inside).then(|| "is best at the end of the range".to_owned())
    };
    if let Some(fault) = fault {
        return Err(format!(
            "no field of view from {least} to {most} degrees brings what its two lenses see together (their \
             correlation at {} degrees {fault})",
            tried[best]
        ));
    }
    let between = peak(scores[best - 1], scores[best], scores[best + 1]);
    Ok(SphereLayout::DualFisheye {
        // A tenth of a degree is less than the parallax of nearby objects between the lenses.
        field_of_view_degrees: (10.0 * (tried[best] + STEP_DEGREES * between)).round() / 10.0,
        circles,
    })
}

/// Returns the peak of the parabola through three equally distant values, in steps from the middle one.
fn peak(before: f64, at: f64, after: f64) -> f64 {
    let bend = before - 2.0 * at + after;
    if bend < 0.0 {
        (0.5 * (before - after) / bend).clamp(-0.5, 0.5)
    } else {
        0.0
    }
}

/// Returns the similarity of both lenses' images of the plane between them, -1 to 1.
fn likeness(frames: &[Rgb8Image], size: DVec2, circles: &[FisheyeCircle; 2], field: f64) -> f64 {
    let lens = |number: usize| Lens {
        is_front: number == 1,
        field_of_view: field,
        circle: circles[number],
    };
    let (back, front) = (lens(0), lens(1));
    let sharp = 0.5 * field * SHARP_SHARE;
    let (mut product, mut squares) = (0.0, [0.0; 2]);
    for degrees in RINGS_DEGREES {
        let ahead = f64::to_radians(degrees);
        if TAU / 4.0 + ahead.abs() > sharp {
            continue;
        }
        let directions = (0..RING_PLACES).map(|number| {
            let around = TAU * number as f64 / RING_PLACES as f64;
            let plane = dvec2(around.cos(), around.sin()) * ahead.cos();
            dvec3(plane.x, plane.y, ahead.sin())
        });
        let directions: Vec<DVec3> = directions.collect();
        for frame in frames {
            let [a, b] = [back, front].map(|lens| {
                without_local_mean(&ring(frame, size, &lens, &directions), DETAIL_RADIUS)
            });
            for (a, b) in a.iter().flatten().zip(b.iter().flatten()) {
                product += a * b;
                squares[0] += a * a;
                squares[1] += b * b;
            }
        }
    }
    // Without detail all images are alike.
    let values = 3 * RING_PLACES * frames.len();
    if squares.iter().any(|&sum| sum < values as f64) {
        return 0.0;
    }
    product / (squares[0] * squares[1]).sqrt()
}

/// Returns the colours of directions in a lens's image.
fn ring(frame: &Rgb8Image, size: DVec2, lens: &Lens, directions: &[DVec3]) -> Vec<[f64; 3]> {
    let colour = |direction: &DVec3| {
        let Some(place) = lens.place(size, *direction) else {
            return [0.0; 3];
        };
        let [first, last] = place.part;
        let at = place.at.clamp(first + 0.5, last - 0.5);
        let mut colour = [0.0; 3];
        for (index, weight) in bilinear([frame.width, frame.height], Edges::Repeated, at) {
            for (sum, level) in colour.iter_mut().zip(&frame.data[3 * index..]) {
                *sum += weight * f64::from(*level);
            }
        }
        colour
    };
    directions.iter().map(colour).collect()
}

/// Returns the circle in a half of the frames by the black around it; `None` if none is visible, or the half is not
/// square.
fn circle(frames: &[Rgb8Image], half: usize) -> Option<FisheyeCircle> {
    let side = frames.first()?.height as f64;
    let width = frames.first()?.width / 2;
    if (width as f64 / side - 1.0).abs() > 0.02 {
        return None;
    }
    let is_lit = |place: DVec2| {
        let (x, y) = (place.x as usize, place.y as usize);
        let is_inside = place.min_element() >= 0.0 && x < width && y < side as usize;
        is_inside && (frames.iter()).any(|frame| !is_black(frame.pixel(half * width + x, y)))
    };
    let middle = dvec2(0.5 * width as f64, 0.5 * side);
    let ends = (0..CIRCLE_RAYS).filter_map(|number| {
        let towards = DVec2::from_angle(TAU * number as f64 / CIRCLE_RAYS as f64);
        // To the edge of the half.
        let most = (middle / towards.abs().max(DVec2::splat(1e-9))).min_element();
        let mut at = most - 1.0;
        while at > 0.4 * side {
            if (0..4).all(|inward| is_lit(middle + (at - f64::from(inward)) * towards)) {
                // Light up to the edge continues beyond it.
                return (at < most - 2.0).then_some(middle + (at + 0.5) * towards);
            }
            at -= 0.5;
        }
        None
    });
    let (centre, radius) = fitted(ends.collect())?;
    // A tenth of a pixel: the same on every machine.
    let rounded = |share: f64| (share * 1e4).round() / 1e4;
    Some(FisheyeCircle {
        centre: [rounded(centre.x / width as f64), rounded(centre.y / side)],
        radius: rounded(radius / side),
    })
}

/// Fits the circle through most of these places.
fn fitted(mut places: Vec<DVec2>) -> Option<(DVec2, f64)> {
    for _ in 0..4 {
        if places.len() < LEAST_CIRCLE_RAYS {
            return None;
        }
        let (centre, radius) = through(&places)?;
        let miss = |place: &DVec2| (place.distance(centre) - radius).abs();
        let median = statistics::median(&places.iter().map(miss).collect::<Vec<_>>())?;
        let tolerated = (3.0 * median).max(1.5);
        let all = places.len();
        places.retain(|place| miss(place) <= tolerated);
        if places.len() == all {
            return (median <= LARGEST_RESIDUAL * radius).then_some((centre, radius));
        }
    }
    None
}

/// Returns centre and radius of the least-squares circle, `x^2 + y^2 = 2 a x + 2 b y + c`.
fn through(places: &[DVec2]) -> Option<(DVec2, f64)> {
    let mut normal = DMat3::ZERO;
    let mut right = DVec3::ZERO;
    for place in places {
        let row = dvec3(2.0 * place.x, 2.0 * place.y, 1.0);
        normal += DMat3::from_cols(row * row.x, row * row.y, row * row.z);
        right += row * place.length_squared();
    }
    let solution = normal.inverse() * right;
    let centre = dvec2(solution.x, solution.y);
    let radius = (solution.z + centre.length_squared()).sqrt();
    (centre.is_finite() && radius.is_finite()).then_some((centre, radius))
}

#[cfg(test)]
mod tests {
    use super::*;

    const HALF: usize = 512;

    /// Returns a texture in every direction, a few degrees wide.
    fn world(direction: DVec3, turn: f64) -> [u8; 3] {
        let d = glam::DQuat::from_rotation_y(turn) * direction;
        let detail = (21.0 * d.x + 6.0 * d.y).sin() * (17.0 * d.z - 5.0 * d.y).cos()
            + 0.6 * (9.0 * d.y + 3.0 * d.x).sin();
        [0.0, 0.6, 1.3].map(|phase| (130.0 + 60.0 * (detail + phase).sin()) as u8)
    }

    /// Returns an image of two lenses with these circles, black around them; `surround` lights the outside.
    fn frame(field_degrees: f64, circles: [FisheyeCircle; 2], turn: f64) -> Rgb8Image {
        let pixels = (0..2 * HALF * HALF).map(|at| {
            let (x, y) = (at % (2 * HALF), at / (2 * HALF));
            let lens = x / HALF;
            let circle = circles[lens];
            let place = dvec2((x % HALF) as f64 + 0.5, y as f64 + 0.5) / HALF as f64;
            let from_centre = (place - DVec2::from_array(circle.centre)) / circle.radius;
            if from_centre.length() > 1.0 {
                return [16; 3];
            }
            let angle = from_centre.length() * 0.5 * field_degrees.to_radians();
            let across = from_centre.normalize_or_zero() * angle.sin();
            let side = if lens == 1 { 1.0 } else { -1.0 };
            world(dvec3(side * across.x, across.y, side * angle.cos()), turn)
        });
        Rgb8Image::new(2 * HALF, HALF, pixels.flatten().collect())
    }

    #[test]
    fn lenses_are_found_to_a_degree_and_their_circles_to_a_pixel() -> Result<(), String> {
        let circle = |x, y, radius| FisheyeCircle {
            centre: [x, y],
            radius,
        };
        for (degrees, circles) in [
            (200.0, [FisheyeCircle::WHOLE; 2]),
            (
                187.0,
                [circle(0.49, 0.503, 0.46), circle(0.512, 0.5, 0.455)],
            ),
            (230.0, [circle(0.5, 0.48, 0.44), circle(0.47, 0.5, 0.45)]),
            // Cut off above and below.
            (205.0, [circle(0.5, 0.5, 0.53), circle(0.5, 0.5, 0.53)]),
        ] {
            let frames = [0.0, 0.4].map(|turn| frame(degrees, circles, turn));
            let SphereLayout::DualFisheye {
                field_of_view_degrees,
                circles: found,
            } = estimate(&frames)?
            else {
                return Err("no dual fisheye".to_owned());
            };
            for (found, truth) in found.iter().zip(&circles) {
                let scale = found.radius / field_of_view_degrees;
                let expected = truth.radius / degrees;
                assert!(
                    (scale / expected - 1.0).abs() < 0.005,
                    "{degrees} degrees: {found:?} at {field_of_view_degrees}"
                );
                let away = DVec2::from_array(found.centre) - DVec2::from_array(truth.centre);
                assert!(
                    away.length() * (HALF as f64) < 1.5,
                    "{degrees} degrees: {found:?}"
                );
            }
        }
        Ok(())
    }

    #[test]
    fn images_that_have_nothing_in_common_are_refused() {
        let one = frame(200.0, [FisheyeCircle::WHOLE; 2], 0.0);
        let other = frame(200.0, [FisheyeCircle::WHOLE; 2], 2.0);
        let mut mixed = one;
        let rows = mixed.data.chunks_exact_mut(6 * HALF);
        for (row, other) in rows.zip(other.data.chunks_exact(6 * HALF)) {
            row[..3 * HALF].copy_from_slice(&other[..3 * HALF]);
        }
        let message = estimate(&[mixed]).map(|layout| layout.to_string());
        assert!(
            message
                .as_ref()
                .is_err_and(|reason| reason.contains("no field of view")),
            "{message:?}"
        );
        let black = Rgb8Image::new(2 * HALF, HALF, vec![0; 6 * HALF * HALF]);
        assert!(estimate(&[black]).is_err());
    }
}
