//! Evidence per direction that content stays in the camera's frame while the scene goes by.
//!
//! Carried content looks the same a second later. So does a rail or a wall along the camera's path, which looks the same
//! all along it. They differ by how much the image would change if it were moved along the path: a rail would not, the
//! outline of a helmet would. The path is found by that, too: along the wrong axis every rail would seem to be carried,
//! so that the axis with the least evidence over the whole sphere is the path's. Its two directions are alike. Where other
//! axes have hardly more, any of them may be the path's: what is carried stays along all of them.
//!
//! The haze of an even floor, or its shade towards the sun, is an appearance that stays too. It has no outline: evidence
//! counts where it is left beside what stays of the images without their slow shades.

use std::f32::consts::PI;

use glam::{Quat, Vec3};
use rayon::prelude::*;

use super::super::{
    field::Field,
    residual::{self, luma},
};
use crate::{
    motion::{GreySphere, grey::even_directions},
    opencv_images::grown,
};

/// Columns of the compared images.
pub(super) const WIDTH: usize = 256;
/// Smoothing that leaves the slow shades of a smoothed image, pixels: 4 degrees.
pub(super) const SHADES_PIXELS: f32 = 3.0;
/// Evidence counts within so many rows and columns of that without slow shades.
const NEAR_SHARP_PIXELS: usize = 2;
/// Differences are averaged over squares that reach so many pixels.
const REACH_PIXELS: usize = 1;
/// Angles by which images are moved along the path, radians: 2 to 7 times what detail spans.
const MOVED_RADIANS: [f32; 3] = [0.07, 0.12, 0.19];
/// Noise of differences, of grey values of [0, 1].
const NOISE: f32 = 1.0 / 255.0;
/// Largest ratio of the change over time to the change along the path, for content that stays.
const LARGEST_RATIO: f32 = 0.55;
/// Least change along the path for content that can be told from the scene, of grey values of [0, 1].
const LEAST_CHANGE: f32 = 6.0 / 255.0;
/// Least sine of the angle to the path: near its two ends the scene does not go by.
const LEAST_SINE: f32 = 0.35;
/// The same while axes are tried. Else the best axis would be the one with what is carried at its end, out of count.
const LEAST_SINE_TRIED: f32 = 0.05;
/// Least median ratio over the sphere, or the part below the horizon: below it nothing goes by there.
const LEAST_MEDIAN_RATIO: f32 = 0.7;
/// Latitude of the upper end of the part below the horizon, as a share of the rows: 15 degrees down.
const BELOW: f64 = 0.5 + 15.0 / 180.0;
/// Number of axes over half the sphere that are tried first, and steps by which the best is refined, radians.
const AXES: usize = 140;
const REFINEMENTS: [f32; 3] = [0.09, 0.045, 0.022];
/// Axes with up to this many times the least evidence may be the path's, if they are so far apart, radians.
const LIKELY: f32 = 1.1;
const APART_RADIANS: f32 = 0.2;
/// Number of frames that axes are tried on, and that the result is measured on.
const TRIED_FRAMES: usize = 3;
const MEASURED_FRAMES: usize = 12;

/// Evidence for each pixel of a panorama of [`WIDTH`] columns.
#[derive(Debug, Clone)]
pub(super) struct Evidence {
    /// Change along the path less the change over time, of grey values of [0, 1], where content stays; 0 elsewhere.
    pub(super) stays: Field,
    /// The same of the images without their slow shades.
    pub(super) sharp: Field,
    pub(super) goes_by: GoesBy,
}

/// Part of the sphere in which the scene goes by.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum GoesBy {
    /// Most of the sphere.
    Around,
    /// Most of the part below the horizon: water below a far coast, or below a camera that stands.
    Below,
}

impl GoesBy {
    /// Judges by the change over time and along the path; `None` if the camera stands.
    fn of(over_time: &Field, along: &Field) -> Option<Self> {
        let ratios = ratios(over_time, along);
        let goes_by = |first_row: usize| {
            over_time.median_below(first_row) >= NOISE
                && ratios.median_below(first_row) >= LEAST_MEDIAN_RATIO
        };
        match (goes_by(0), goes_by(below(over_time.height))) {
            (true, _) => Some(Self::Around),
            (false, true) => Some(Self::Below),
            (false, false) => None,
        }
    }
}

/// Returns the first row of the part below the horizon.
fn below(height: usize) -> usize {
    (BELOW * height as f64) as usize
}

/// Measures the evidence in pairs of smoothed images, each with the one a second later; `None` if the camera stands.
pub(super) fn measure(pairs: &[[&GreySphere; 2]]) -> opencv::Result<Option<Evidence>> {
    let images: Vec<&GreySphere> = pairs.iter().map(|[first, _]| *first).collect();
    let Some(over_time) = change_over_time(pairs)? else {
        return Ok(None);
    };
    let rests = |first_row: usize| over_time.median_below(first_row) < NOISE;
    if rests(0) && rests(below(over_time.height)) {
        return Ok(None);
    }
    let directions = residual::directions(over_time.width);
    let axes = likely_axes(&over_time, &spread(&images, TRIED_FRAMES), &directions)?;
    let along = changes_along(&images, &axes, &directions)?;
    let Some(goes_by) = GoesBy::of(&over_time, &along[0]) else {
        return Ok(None);
    };
    let stays = staying_along_all(&over_time, &along, &axes, &directions);
    let sharp: opencv::Result<Vec<[GreySphere; 2]>> = (pairs.iter())
        .map(|[first, second]| Ok([without_shades(first)?, without_shades(second)?]))
        .collect();
    let sharp = sharp?;
    let compared: Vec<[&GreySphere; 2]> = sharp.iter().map(|[a, b]| [a, b]).collect();
    let sharp = staying_in(&compared, &axes, &directions)?;
    let stays = near_sharp(stays, &sharp)?;
    Ok(Some(Evidence {
        stays,
        sharp,
        goes_by,
    }))
}

/// Returns the evidence of each pixel in pairs of images, along all of the axes.
fn staying_in(
    pairs: &[[&GreySphere; 2]],
    axes: &[Vec3],
    directions: &[Vec3],
) -> opencv::Result<Field> {
    let images: Vec<&GreySphere> = pairs.iter().map(|[first, _]| *first).collect();
    let over_time = change_over_time(pairs)?.unwrap_or_else(|| nowhere(directions));
    let along = changes_along(&images, axes, directions)?;
    Ok(staying_along_all(&over_time, &along, axes, directions))
}

/// Returns the mean change of images along each axis.
fn changes_along(
    images: &[&GreySphere],
    axes: &[Vec3],
    directions: &[Vec3],
) -> opencv::Result<Vec<Field>> {
    let images = spread(images, MEASURED_FRAMES);
    let along = |&axis: &Vec3| change_along(&images, axis, directions);
    axes.par_iter().map(along).collect()
}

/// Returns the least evidence of each pixel along the axes.
///
/// Nothing is evidence near the ends of the first axis, the best; another axis tells nothing of what is near its ends.
fn staying_along_all(
    over_time: &Field,
    along: &[Field],
    axes: &[Vec3],
    directions: &[Vec3],
) -> Field {
    let mut paths = along.iter().zip(axes);
    let Some((along, &best)) = paths.next() else {
        return nowhere(directions);
    };
    let mut least = staying([over_time, along], best, directions, LEAST_SINE);
    for (along, &axis) in paths {
        let stays = staying([over_time, along], axis, directions, 0.0);
        let pixels = least.values.iter_mut().zip(stays.values).zip(directions);
        for ((least, stays), &direction) in pixels {
            if tangent(axis, direction).length() > LEAST_SINE {
                *least = least.min(stays);
            }
        }
    }
    least
}

/// Returns a field of zeros.
fn nowhere(directions: &[Vec3]) -> Field {
    Field {
        width: WIDTH,
        height: WIDTH / 2,
        values: vec![0.0; directions.len()],
    }
}

fn without_shades(image: &GreySphere) -> opencv::Result<GreySphere> {
    let shades = luma(image).blurred(SHADES_PIXELS, true)?;
    let values = image.luma().iter().zip(&shades.values);
    let values = values.map(|(value, shade)| value - shade).collect();
    Ok(GreySphere::of_luma(image.width(0), values))
}

/// Returns evidence near that of sharp images; 0 elsewhere.
fn near_sharp(mut stays: Field, sharp: &Field) -> opencv::Result<Field> {
    let marks: Vec<u8> = (sharp.values.iter())
        .map(|&value| 255 * u8::from(value > 0.0))
        .collect();
    let near = grown(&marks, sharp.width, NEAR_SHARP_PIXELS)?;
    for (value, near) in stays.values.iter_mut().zip(near) {
        if near == 0 {
            *value = 0.0;
        }
    }
    Ok(stays)
}

/// Returns up to `count` of the images, spread evenly.
fn spread<'a>(images: &[&'a GreySphere], count: usize) -> Vec<&'a GreySphere> {
    let step = images.len().div_ceil(count).max(1);
    images
        .iter()
        .skip(step / 2)
        .step_by(step)
        .copied()
        .collect()
}

/// Returns the mean change over the pairs around each pixel; `None` without pairs.
fn change_over_time(pairs: &[[&GreySphere; 2]]) -> opencv::Result<Option<Field>> {
    let changes = pairs.iter().map(|[first, second]| {
        let values = first.luma().iter().zip(second.luma());
        let values = values.map(|(a, b)| (a - b).abs()).collect();
        Field {
            values,
            ..luma(first)
        }
    });
    mean(changes.collect())
}

/// Returns the mean of fields over squares; `None` without fields.
fn mean(fields: Vec<Field>) -> opencv::Result<Option<Field>> {
    let count = fields.len() as f32;
    let sum = fields.into_iter().reduce(|mut sum, field| {
        for (sum, value) in sum.values.iter_mut().zip(field.values) {
            *sum += value;
        }
        sum
    });
    let mean = sum.map(|mut sum| {
        for value in &mut sum.values {
            *value /= count;
        }
        sum.box_mean(REACH_PIXELS, true)
    });
    mean.transpose()
}

/// Returns the mean change of images around each pixel if they are moved along the path, both ways.
fn change_along(images: &[&GreySphere], axis: Vec3, directions: &[Vec3]) -> opencv::Result<Field> {
    let both = MOVED_RADIANS.iter().flat_map(|&angle| [angle, -angle]);
    let moved = both.map(|angle| -> Vec<Vec3> {
        let move_one = |&direction: &Vec3| {
            let along = tangent(axis, direction).normalize_or_zero();
            angle.cos() * direction + angle.sin() * along
        };
        directions.iter().map(move_one).collect()
    });
    let moved: Vec<Vec<Vec3>> = moved.collect();
    let changes = images.iter().flat_map(|image| {
        moved.iter().map(move |moved| {
            let values = moved.iter().zip(image.luma());
            let change =
                |(&direction, here): (&Vec3, &f32)| (image.sample(0, direction) - here).abs();
            Field {
                values: values.map(change).collect(),
                ..luma(image)
            }
        })
    });
    Ok(mean(changes.collect())?.unwrap_or_else(|| nowhere(directions)))
}

/// Returns the part of an axis at right angles to a direction; its length is the sine of the angle between them.
fn tangent(axis: Vec3, direction: Vec3) -> Vec3 {
    axis - axis.dot(direction) * direction
}

fn ratios(over_time: &Field, along: &Field) -> Field {
    let values = over_time.values.iter().zip(&along.values);
    Field {
        values: values.map(|(time, along)| time / (along + NOISE)).collect(),
        ..along.clone()
    }
}

/// Returns the evidence of each pixel, from its change over time and its change along the path.
fn staying(
    [over_time, along]: [&Field; 2],
    axis: Vec3,
    directions: &[Vec3],
    least_sine: f32,
) -> Field {
    let pixels = over_time.values.iter().zip(&along.values).zip(directions);
    let value = |((&time, &along), &direction): ((&f32, &f32), &Vec3)| {
        let stays = time < LARGEST_RATIO * (along + NOISE)
            && along > LEAST_CHANGE
            && tangent(axis, direction).length() > least_sine;
        if stays { (along - time).max(0.0) } else { 0.0 }
    };
    Field {
        values: pixels.map(value).collect(),
        ..along.clone()
    }
}

/// Returns the axis with the least evidence over the sphere, and after it those with hardly more.
fn likely_axes(
    over_time: &Field,
    images: &[&GreySphere],
    directions: &[Vec3],
) -> opencv::Result<Vec<Vec3>> {
    let cost = |axis: Vec3| -> opencv::Result<(f32, Vec3)> {
        let along = change_along(images, axis, directions)?;
        let stays = staying([over_time, &along], axis, directions, LEAST_SINE_TRIED);
        Ok((weighted_sum(&stays), axis))
    };
    let by_cost = |axes: Vec<Vec3>| -> opencv::Result<Vec<(f32, Vec3)>> {
        let mut costs: Vec<(f32, Vec3)> =
            axes.into_par_iter().map(cost).collect::<Result<_, _>>()?;
        costs.sort_by(|a, b| a.0.total_cmp(&b.0));
        Ok(costs)
    };
    let half = even_directions(2 * AXES).filter(|axis| axis.y >= 0.0);
    let tried = by_cost(half.collect())?;
    let mut best = tried.first().copied().unwrap_or((0.0, Vec3::Z));
    for step in REFINEMENTS {
        let (first, second) = best.1.any_orthonormal_pair();
        let around = (0..8).map(|turn| {
            let angle = PI / 4.0 * turn as f32;
            let about = angle.cos() * first + angle.sin() * second;
            Quat::from_axis_angle(about, step) * best.1
        });
        let better = by_cost(around.collect())?.first().copied();
        if let Some(better) = better.filter(|found| found.0 < best.0) {
            best = better;
        }
    }
    let mut likely = vec![best.1];
    for (_, axis) in tried.iter().filter(|(cost, _)| *cost <= LIKELY * best.0) {
        let is_apart = |other: &Vec3| axis.dot(*other).abs() < APART_RADIANS.cos();
        if likely.iter().all(is_apart) {
            likely.push(*axis);
        }
    }
    Ok(likely)
}

/// Returns the sum over the sphere, weighted by the cosine of latitude.
fn weighted_sum(field: &Field) -> f32 {
    let rows = field.values.chunks_exact(field.width).enumerate();
    rows.map(|(row, values)| {
        let weight = (PI * (row as f32 + 0.5) / field.height as f32).sin();
        weight * values.iter().sum::<f32>()
    })
    .sum()
}

#[cfg(test)]
mod tests {
    use rand::{RngExt, SeedableRng};
    use rand_pcg::Pcg64Mcg;

    use super::*;

    const HELMET_TOP: f32 = 0.6;

    /// A tunnel along z with rails, seen from a place along it; the camera carries a striped plate below.
    fn tunnel(place: f32) -> GreySphere {
        let directions = residual::directions(WIDTH);
        let level = |direction: &Vec3| {
            if direction.y > HELMET_TOP && direction.x.abs() < 0.5 {
                return if direction.y > 0.8 { 0.9 } else { 0.1 };
            }
            let radius = direction.x.hypot(direction.y).max(1e-3);
            let along = place + direction.z / radius;
            let around = direction.y.atan2(direction.x);
            let rails = 0.15 * (9.0 * around).sin();
            let rings = 0.15 * (3.0 * along).sin() * (4.0 * around + along).cos();
            0.5 + rails + rings
        };
        GreySphere::of_luma(WIDTH, directions.iter().map(level).collect())
    }

    #[test]
    fn rails_go_by_and_what_is_carried_stays() {
        let images: Vec<GreySphere> = [0.0, 0.7, 1.5, 2.6].map(tunnel).into();
        let pairs: Vec<[&GreySphere; 2]> = (images.windows(2))
            .map(|pair| [&pair[0], &pair[1]])
            .collect();
        let evidence = measure(&pairs).expect("filtered").expect("it moves");
        let directions = residual::directions(WIDTH);
        let (mut on_plate, mut elsewhere) = (0.0, 0.0);
        for (row, values) in evidence.stays.values.chunks_exact(WIDTH).enumerate() {
            let weight = (PI * (row as f32 + 0.5) / (WIDTH / 2) as f32).sin();
            for (column, value) in values.iter().enumerate() {
                let direction = directions[row * WIDTH + column];
                match direction.y > HELMET_TOP - 0.15 && direction.x.abs() < 0.65 {
                    true => on_plate += weight * value,
                    false => elsewhere += weight * value,
                }
            }
        }
        assert!(on_plate > 10.0 * elsewhere, "{on_plate} {elsewhere}");
    }

    /// Waves of which every frame has others, and two parts of a floor that stay: the lines of one run along x, those of
    /// the other along z.
    fn floors(frame: u64) -> GreySphere {
        let mut noise = Pcg64Mcg::seed_from_u64(frame);
        let level = |direction: Vec3| {
            let waves = 0.5 + 0.2 * noise.random_range(-1.0..1.0_f32);
            let lines = |across: f32| 0.5 + 0.2 * (18.0 * direction.y.atan2(across)).sin();
            let is_low = direction.y > 0.5;
            match (is_low && direction.x > 0.4, is_low && direction.z > 0.4) {
                (true, false) => lines(direction.z),
                (false, true) => lines(direction.x),
                _ => waves,
            }
        };
        let levels = residual::directions(WIDTH).into_iter().map(level);
        GreySphere::of_luma(WIDTH, levels.collect())
    }

    #[test]
    fn what_stays_along_one_of_two_likely_paths_is_not_carried() {
        let images: Vec<GreySphere> = (0..7).map(floors).collect();
        let pairs: Vec<[&GreySphere; 2]> = (images.windows(2))
            .map(|pair| [&pair[0], &pair[1]])
            .collect();
        let directions = residual::directions(WIDTH);
        let along = |axis: Vec3| {
            let stays = staying_in(&pairs, &[axis], &directions).expect("filtered");
            weighted_sum(&stays)
        };
        let evidence = measure(&pairs).expect("filtered").expect("it moves");
        let all = weighted_sum(&evidence.stays);
        let least = along(Vec3::X).min(along(Vec3::Z));
        assert!(all < 0.5 * least, "{all} {least}");
    }

    /// A field with one value above the part below the horizon, and one in it.
    fn parts(above: f32, below_it: f32) -> Field {
        let rows = WIDTH / 2;
        let value = |at: usize| match at / WIDTH < below(rows) {
            true => above,
            false => below_it,
        };
        Field {
            width: WIDTH,
            height: rows,
            values: (0..WIDTH * rows).map(value).collect(),
        }
    }

    #[test]
    fn the_scene_goes_by_around_below_or_nowhere() {
        let along = parts(0.1, 0.1);
        let judged = |above: f32, below_it: f32| GoesBy::of(&parts(above, below_it), &along);
        assert_eq!(judged(0.1, 0.1), Some(GoesBy::Around));
        assert_eq!(judged(0.1, 0.01), Some(GoesBy::Around));
        assert_eq!(judged(0.01, 0.1), Some(GoesBy::Below));
        assert_eq!(judged(0.01, 0.01), None);
        // Noise of even surfaces.
        let even = parts(0.0, 0.0);
        assert_eq!(GoesBy::of(&parts(0.003, 0.003), &even), None);
    }

    #[test]
    fn slow_shades_leave_no_evidence_and_outlines_do() {
        let (mut stays, mut sharp) = (parts(0.2, 0.2), parts(0.0, 0.0));
        sharp.values[80 * WIDTH + 255] = 0.1;
        stays.values[81 * WIDTH] = 0.0;
        let kept = near_sharp(stays, &sharp).expect("filtered");
        let near = kept.values.iter().filter(|value| **value > 0.0).count();
        assert_eq!(near, 24);
        assert_eq!(kept.values[82 * WIDTH + 1], 0.2);
        let shade: Vec<f32> = residual::directions(WIDTH)
            .iter()
            .map(|at| 0.3 * at.y)
            .collect();
        let flat = without_shades(&GreySphere::of_luma(WIDTH, shade)).expect("filtered");
        let most = flat
            .luma()
            .iter()
            .fold(0.0_f32, |most, value| most.max(value.abs()));
        assert!(most < LEAST_CHANGE / 2.0, "{most}");
    }

    #[test]
    fn a_camera_that_stands_tells_nothing() {
        let image = tunnel(0.0);
        let pairs = [[&image, &image]; 3];
        assert!(measure(&pairs).expect("filtered").is_none());
        assert!(measure(&[]).expect("filtered").is_none());
    }
}
