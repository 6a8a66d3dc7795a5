//! Frames of other times as they would look from here, and how far a frame is from them.

use glam::DVec3;
use omnilife_schemas::{RgbImage, camera::CameraModel};
use rayon::prelude::*;

use crate::{posed_view::PosedView, tracks::detectors::depth_of_points::DistanceMap};

/// Surfaces of a warped view may be this much farther or nearer than they should, relatively.
const OCCLUSION: f32 = 0.03;
/// Frames that one is compared with, at most.
const OTHERS: usize = 8;
/// They are at least this far apart, seconds; half of that from the frame itself.
const APART_SECONDS: f64 = 1.0;

/// Fewer frames that show a pixel say nothing of it, where there are more.
const LEAST_KNOWN: usize = 3;
/// Radius in which the surface may be any that is there, pixels.
const AROUND: usize = 4;
/// Places of a pixel in another frame that are farther apart than this are not known, pixels.
const AMBIGUOUS: f64 = 2.5;

/// A frame that is compared.
pub(super) struct Looked<'a> {
    pub(super) view: &'a PosedView,
    pub(super) image: &'a RgbImage,
    pub(super) distances: &'a DistanceMap,
}

/// The frames that others are compared with: [`APART_SECONDS`] apart.
pub(super) fn background_frames(seconds: &[f64]) -> Vec<usize> {
    let mut chosen: Vec<usize> = Vec::new();
    for (number, &time) in seconds.iter().enumerate() {
        // A little less than the interval: time stamps are rounded.
        if chosen
            .last()
            .is_none_or(|&last| time - seconds[last] >= APART_SECONDS - 0.01)
        {
            chosen.push(number);
        }
    }
    chosen
}

/// The frames that one is compared with, the nearest first: every second of those of the background, on
/// both sides as long as there are any. A short clip has no choice.
pub(super) fn compared_with(index: usize, seconds: &[f64], background: &[usize]) -> Vec<usize> {
    let apart = |other: usize| (seconds[other] - seconds[index]).abs();
    let far = background
        .iter()
        .copied()
        .filter(|&other| apart(other) >= 0.5 * APART_SECONDS - 0.01);
    let (mut before, after): (Vec<usize>, Vec<usize>) = far.partition(|&other| other < index);
    before.reverse();
    let step = if before.len() + after.len() < 2 * OTHERS {
        1
    } else {
        2
    };
    let mut others: Vec<usize> = [&before, &after]
        .into_iter()
        .flat_map(|side| side.iter().copied().step_by(step))
        .collect();
    if others.is_empty() {
        others = (0..seconds.len()).filter(|&other| other != index).collect();
    }
    others.sort_by(|&a, &b| apart(a).total_cmp(&apart(b)));
    others.truncate(OTHERS);
    others
}

/// A pixel's surface: the points where its ray may meet it, the nearest and the farthest of what is around.
pub(super) type Surface = Option<[DVec3; 2]>;

/// The static surface that a frame's pixels see; `None` where nothing is known of it.
pub(super) fn surface(here: &Looked<'_>) -> Vec<Surface> {
    let width = here.image.width;
    let [least, most] = here.distances.around(AROUND);
    let pixels = (0..least.len()).into_par_iter();
    let point = |pixel: usize| {
        let centre = glam::dvec2((pixel % width) as f64 + 0.5, (pixel / width) as f64 + 0.5);
        let (near, far) = (f64::from(least[pixel]), f64::from(most[pixel]));
        let ray = here.view.ray(centre);
        far.is_finite()
            .then(|| [near, far].map(|distance| here.view.centre + ray * distance))
    };
    pixels.map(point).collect()
}

/// Another frame as it would look from here; NaN where it does not show the surface that is here, and
/// where it does not say which: beside edges the surface is not known to a pixel, and from another place
/// another colour is behind them.
pub(super) fn warped(here: &Looked<'_>, surface: &[Surface], other: &Looked<'_>) -> Vec<[f32; 3]> {
    let unknown = [f32::NAN; 3];
    let warp = |(pixel, points): (usize, &Surface)| {
        let Some([near, far]) = *points else {
            return unknown;
        };
        let centre = here.view.centre;
        let distance = f64::from(here.distances.values[pixel]);
        let (ray, length) = (far - centre).normalize_and_length();
        if length > 1.005 * near.distance(centre) {
            let project = |point: DVec3| other.view.camera.project(other.view.in_camera(point));
            match (project(near), project(far)) {
                (Some(near), Some(far)) if near.distance(far) <= AMBIGUOUS => {}
                _ => return unknown,
            }
        }
        seen(other, centre + ray * distance).unwrap_or(unknown)
    };
    surface.par_iter().enumerate().map(warp).collect()
}

/// How far each pixel's colour is from all that a background has within a pixel; NaN where it has none.
pub(super) fn difference(image: &RgbImage, background: &[[f32; 3]]) -> Vec<f32> {
    let (width, height) = (image.width, image.height);
    let mut out = vec![f32::NAN; background.len()];
    out.par_chunks_mut(width)
        .enumerate()
        .for_each(|(row, out)| {
            for (column, out) in out.iter_mut().enumerate() {
                if background[row * width + column][0].is_nan() {
                    continue;
                }
                let (mut low, mut high) = ([f32::INFINITY; 3], [f32::NEG_INFINITY; 3]);
                for row in row.saturating_sub(1)..=(row + 1).min(height - 1) {
                    for column in column.saturating_sub(1)..=(column + 1).min(width - 1) {
                        let colour = background[row * width + column];
                        for channel in 0..3 {
                            // NaN changes neither.
                            low[channel] = low[channel].min(colour[channel]);
                            high[channel] = high[channel].max(colour[channel]);
                        }
                    }
                }
                let shown = &image.data[3 * (row * width + column)..];
                let beyond = |channel: usize| {
                    let value = shown[channel];
                    (value - high[channel]).max(low[channel] - value).max(0.0)
                };
                *out = (0..3).map(beyond).sum::<f32>() / 3.0;
            }
        });
    out
}

/// For each pixel the difference that a quarter of those known are below; NaN where none is.
pub(super) fn ranked(differences: &[Vec<f32>]) -> Vec<f32> {
    let pixels = differences.first().map_or(0, Vec::len);
    (0..pixels)
        .into_par_iter()
        .map(|pixel| {
            let mut known = [0.0; OTHERS];
            let mut count = 0;
            for difference in differences.iter().take(OTHERS) {
                let value = difference[pixel];
                if !value.is_nan() {
                    known[count] = value;
                    count += 1;
                }
            }
            if count < LEAST_KNOWN.min(differences.len()) {
                return f32::NAN;
            }
            let known = &mut known[..count];
            known.sort_unstable_by(f32::total_cmp);
            known.get(count / 4).copied().unwrap_or(f32::NAN)
        })
        .collect()
}

/// Per channel the middle of what backgrounds show of a pixel; NaN where none shows it.
pub(super) fn middle_colour(backgrounds: &[Vec<[f32; 3]>], pixel: usize) -> [f32; 3] {
    [0, 1, 2].map(|channel| {
        let mut known: Vec<f32> = backgrounds
            .iter()
            .map(|background| background[pixel][channel])
            .filter(|value| !value.is_nan())
            .collect();
        known.sort_unstable_by(f32::total_cmp);
        known.get(known.len() / 2).copied().unwrap_or(f32::NAN)
    })
}

/// The colour of a point of the surface in a frame, bilinear; `None` where it is hidden or outside.
fn seen(other: &Looked<'_>, point: DVec3) -> Option<[f32; 3]> {
    let (width, height) = (other.image.width, other.image.height);
    let pixel = other.view.camera.project(other.view.in_camera(point))? - 0.5;
    let (column, row) = (pixel.x.floor(), pixel.y.floor());
    if column < 0.0 || row < 0.0 || column + 1.0 >= width as f64 || row + 1.0 >= height as f64 {
        return None;
    }
    let (x, y) = ((pixel.x - column) as f32, (pixel.y - row) as f32);
    let at = row as usize * width + column as usize;
    let expected = point.distance(other.view.centre) as f32;
    if other.distances.values[at] < expected * (1.0 - OCCLUSION) {
        return None;
    }
    let value = |at: usize, channel: usize| other.image.data[3 * at + channel];
    Some([0, 1, 2].map(|channel| {
        let top = (1.0 - x) * value(at, channel) + x * value(at + 1, channel);
        let bottom = (1.0 - x) * value(at + width, channel) + x * value(at + width + 1, channel);
        (1.0 - y) * top + y * bottom
    }))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_are_compared_with_others_seconds_apart() {
        let others = |index: usize, rate: f64, count: usize| {
            let seconds: Vec<f64> = (0..count).map(|n| n as f64 / rate).collect();
            let mut others = compared_with(index, &seconds, &background_frames(&seconds));
            others.sort_unstable();
            others
        };
        assert_eq!(others(15, 1.0, 31), [8, 10, 12, 14, 16, 18, 20, 22]);
        // Five times as many frames: the same seconds.
        let every_fifth = [40, 50, 60, 70, 80, 90, 100, 110];
        assert_eq!(others(75, 5.0, 151), every_fifth);
        assert_eq!(others(77, 5.0, 151).len(), OTHERS);
        assert_eq!(others(0, 1.0, 5), [1, 2, 3, 4]);
        assert_eq!(others(1, 1.0, 2), [0]);
        // Nothing is far enough: what there is.
        assert_eq!(others(0, 10.0, 3), [1, 2]);
    }

    #[test]
    fn what_passed_in_some_frames_leaves_no_trace_where_it_was() {
        let static_pixel = [0.0, 0.0, 0.4, 0.0, 0.5, 0.0, 0.0, 0.3];
        let moving_pixel = [0.4, 0.3, 0.4, 0.01, 0.5, 0.4, 0.3, 0.3];
        let unknown = [f32::NAN; 8];
        let differences: Vec<Vec<f32>> = (0..8)
            .map(|n| vec![static_pixel[n], moving_pixel[n], unknown[n]])
            .collect();
        let ranked = ranked(&differences);
        assert_eq!(ranked[0], 0.0);
        assert!(ranked[1] > 0.2 && ranked[2].is_nan());
    }

    #[test]
    fn a_shift_by_a_pixel_is_no_difference() {
        let background: Vec<[f32; 3]> = (0..64)
            .map(|pixel| if pixel % 8 < 4 { [0.2; 3] } else { [0.8; 3] })
            .collect();
        let shifted = |by: usize| RgbImage {
            width: 8,
            height: 8,
            data: (0..192)
                .map(|at| if at / 3 % 8 < 4 + by { 0.2 } else { 0.8 })
                .collect(),
        };
        let largest = |by: usize| {
            let all = difference(&shifted(by), &background);
            all.into_iter().fold(0.0, f32::max)
        };
        assert_eq!(largest(1), 0.0);
        assert!(largest(2) > 0.5);
    }
}
