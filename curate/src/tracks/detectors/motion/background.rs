//! Frames of other times as they would look from here, and how far a frame is from them.

use glam::DVec3;
use omnilife_schemas::{RgbImage, camera::CameraModel};
use rayon::prelude::*;

use crate::{
    ground_plane::Plane, posed_view::PosedView, tracks::detectors::depth_of_points::DistanceMap,
};

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

/// Where the ray of a pixel meets the static surface.
#[derive(Debug, Clone, Copy)]
pub(super) struct SurfacePoint {
    at: DVec3,
    /// Where else it may meet it beside edges: there the surface is not known to a pixel.
    edge: Option<Edge>,
}

/// Places at which the ray of a pixel beside an edge may meet the surface.
#[derive(Debug, Clone, Copy)]
struct Edge {
    nearest: DVec3,
    farthest: DVec3,
    /// The ground, where it is between the two.
    ground: Option<DVec3>,
}

/// The farthest surface around a pixel may be this much beyond the nearest where there is no edge.
const EDGE: f64 = 1.005;
/// The ground is between the nearest and the farthest surface when it is by this share beyond either.
const GROUND_REACH: f64 = 1.02;

/// The static surface that a frame's pixels see; `None` where nothing is known of it.
pub(super) fn surface(here: &Looked<'_>, ground: Plane) -> Vec<Option<SurfacePoint>> {
    let width = here.image.width;
    let [least, most] = here.distances.around(AROUND);
    let point = |pixel: usize| {
        let centre = glam::dvec2((pixel % width) as f64 + 0.5, (pixel / width) as f64 + 0.5);
        let (near, far) = (f64::from(least[pixel]), f64::from(most[pixel]));
        let ray = here.view.ray(centre);
        let on_ray = |distance: f64| here.view.centre + ray * distance;
        let edge = || {
            let on_ground = ground.meet(here.view.centre, ray);
            let between = near / GROUND_REACH..=far * GROUND_REACH;
            Edge {
                nearest: on_ray(near),
                farthest: on_ray(far),
                ground: on_ground.filter(|at| between.contains(at)).map(on_ray),
            }
        };
        far.is_finite().then(|| SurfacePoint {
            at: on_ray(f64::from(here.distances.values[pixel])),
            edge: (far > EDGE * near).then(edge),
        })
    };
    (0..least.len()).into_par_iter().map(point).collect()
}

/// Another frame as it would look from here, and how far this one is from it.
pub(super) struct Compared {
    /// Its colours; NaN where it does not show the surface that is here.
    pub(super) colours: Vec<[f32; 3]>,
    /// Of each pixel's colour; NaN where it says nothing.
    pub(super) difference: Vec<f32>,
}

/// Compares a frame with another one through the surface that it sees.
///
/// Beside edges the surface is not known to a pixel, and from another place another colour is behind them.
/// Where the ground is one of the surfaces that may be there, what stands still looks like the other frame at
/// one of them, and counts by the one that it is most like; elsewhere nothing is said.
pub(super) fn compare(
    here: &Looked<'_>,
    surface: &[Option<SurfacePoint>],
    other: &Looked<'_>,
) -> Compared {
    let unknown = [f32::NAN; 3];
    let project = |point: DVec3| other.view.camera.project(other.view.in_camera(point));
    let is_sure = |point: &SurfacePoint| {
        let Some(edge) = point.edge else {
            return true;
        };
        match (project(edge.nearest), project(edge.farthest)) {
            (Some(near), Some(far)) => near.distance(far) <= AMBIGUOUS,
            _ => false,
        }
    };
    let sure: Vec<bool> = surface
        .par_iter()
        .map(|point| point.as_ref().is_some_and(is_sure))
        .collect();
    let warp = |(point, sure): (&Option<SurfacePoint>, &bool)| match point {
        Some(point) if *sure => seen(other, point.at).unwrap_or(unknown),
        _ => unknown,
    };
    let mut colours: Vec<[f32; 3]> = surface.par_iter().zip(&sure).map(warp).collect();
    let mut difference = difference(here.image, &colours);
    let edges: Vec<(usize, DVec3, Edge)> = surface
        .iter()
        .zip(&sure)
        .enumerate()
        .filter(|(_, (_, sure))| !**sure)
        .filter_map(|(pixel, (point, _))| {
            let point = point.as_ref()?;
            Some((pixel, point.at, point.edge?))
        })
        .filter(|(_, _, edge)| edge.ground.is_some())
        .collect();
    let mut layers = Layers {
        here: here.image,
        other,
        edges: &edges,
        colours: vec![unknown; colours.len()],
    };
    let everywhere = vec![true; edges.len()];
    let mut least = layers.differences(&everywhere, |_, edge| edge.ground);
    for &(pixel, ..) in &edges {
        colours[pixel] = layers.colours[pixel];
    }
    let wanted = layers.beside(|at| least[at] > IS_GROUND);
    for kind in [
        (|_, edge| Some(edge.nearest)) as fn(DVec3, &Edge) -> Option<DVec3>,
        |_, edge| Some(edge.farthest),
        |at, _| Some(at),
    ] {
        let of_layer = layers.differences(&wanted, kind);
        for (least, value) in least.iter_mut().zip(of_layer) {
            // Without the ground nothing is said: NaN is not more than any.
            if value < *least {
                *least = value;
            }
        }
    }
    for (&(pixel, ..), value) in edges.iter().zip(least) {
        difference[pixel] = value;
    }
    Compared {
        colours,
        difference,
    }
}

/// What looks as much like the ground as this is not compared with other surfaces, of [0, 1].
const IS_GROUND: f32 = 0.01;

/// Another frame beside edges, through one of the surfaces that may be there at a time.
struct Layers<'a> {
    here: &'a RgbImage,
    other: &'a Looked<'a>,
    edges: &'a [(usize, DVec3, Edge)],
    /// Of the whole image; NaN where there is no edge or the other frame does not show it.
    colours: Vec<[f32; 3]>,
}

impl Layers<'_> {
    /// How far pixels beside edges are from the other frame through one kind of surface, where that is wanted; NaN
    /// elsewhere.
    fn differences(
        &mut self,
        wanted: &[bool],
        kind: impl Fn(DVec3, &Edge) -> Option<DVec3> + Sync,
    ) -> Vec<f32> {
        let shown: Vec<[f32; 3]> = self
            .edges
            .par_iter()
            .zip(wanted)
            .map(|((_, at, edge), wanted)| {
                let at = if *wanted { kind(*at, edge) } else { None };
                at.and_then(|at| seen(self.other, at))
                    .unwrap_or([f32::NAN; 3])
            })
            .collect();
        for ((pixel, ..), shown) in self.edges.iter().zip(shown) {
            self.colours[*pixel] = shown;
        }
        self.edges
            .par_iter()
            .map(|(pixel, ..)| beyond(self.here, &self.colours, *pixel))
            .collect()
    }

    /// Which pixels beside edges are one of some, or beside one.
    fn beside(&self, is_one: impl Fn(usize) -> bool) -> Vec<bool> {
        let (width, height) = (self.here.width, self.here.height);
        let mut near = vec![false; self.colours.len()];
        for (at, (pixel, ..)) in self.edges.iter().enumerate() {
            if is_one(at) {
                let (row, column) = (pixel / width, pixel % width);
                for row in row.saturating_sub(1)..=(row + 1).min(height - 1) {
                    let first = row * width;
                    near[first + column.saturating_sub(1)..=first + (column + 1).min(width - 1)]
                        .fill(true);
                }
            }
        }
        self.edges.iter().map(|(pixel, ..)| near[*pixel]).collect()
    }
}

/// How far a pixel's colour is from all that a background has within a pixel of it; NaN where it has none there.
fn beyond(image: &RgbImage, background: &[[f32; 3]], pixel: usize) -> f32 {
    let (width, height) = (image.width, image.height);
    if background[pixel][0].is_nan() {
        return f32::NAN;
    }
    let (row, column) = (pixel / width, pixel % width);
    let mut extent = Extent::NOTHING;
    for row in row.saturating_sub(1)..=(row + 1).min(height - 1) {
        for column in column.saturating_sub(1)..=(column + 1).min(width - 1) {
            extent = extent.with(&Extent::of(background[row * width + column]));
        }
    }
    extent.distance(&image.data[3 * pixel..3 * pixel + 3])
}

/// The least and the largest colour of some pixels; NaN changes neither.
#[derive(Debug, Clone, Copy)]
struct Extent {
    low: [f32; 3],
    high: [f32; 3],
}

impl Extent {
    const NOTHING: Self = Self {
        low: [f32::INFINITY; 3],
        high: [f32::NEG_INFINITY; 3],
    };

    fn of(colour: [f32; 3]) -> Self {
        Self::NOTHING.with(&Self {
            low: colour,
            high: colour,
        })
    }

    fn with(&self, other: &Self) -> Self {
        Self {
            low: std::array::from_fn(|channel| self.low[channel].min(other.low[channel])),
            high: std::array::from_fn(|channel| self.high[channel].max(other.high[channel])),
        }
    }

    /// Mean over the channels of how far a colour is outside.
    fn distance(&self, colour: &[f32]) -> f32 {
        let beyond = |channel: usize| {
            let value = colour[channel];
            (value - self.high[channel])
                .max(self.low[channel] - value)
                .max(0.0)
        };
        (0..3).map(beyond).sum::<f32>() / 3.0
    }
}

/// The extent of each pixel of a row with those beside it.
fn extents_across(row: &[[f32; 3]]) -> Vec<Extent> {
    let single: Vec<Extent> = row.iter().map(|&colour| Extent::of(colour)).collect();
    let mut across = single.clone();
    for (extent, right) in across.iter_mut().zip(single.iter().skip(1)) {
        *extent = extent.with(right);
    }
    for (extent, left) in across.iter_mut().skip(1).zip(&single) {
        *extent = extent.with(left);
    }
    across
}

/// Rows that are worked on together: each row's extents are needed by the rows beside it.
const BAND_ROWS: usize = 16;

/// How far each pixel's colour is from all that a background has within a pixel; NaN where it has none.
fn difference(image: &RgbImage, background: &[[f32; 3]]) -> Vec<f32> {
    let (width, height) = (image.width, image.height);
    let mut out = vec![f32::NAN; background.len()];
    let band = |(number, out): (usize, &mut [f32])| {
        let first = number * BAND_ROWS;
        let from = first.saturating_sub(1);
        let to = (first + out.len() / width + 1).min(height);
        let across: Vec<Vec<Extent>> = background[from * width..to * width]
            .chunks_exact(width)
            .map(extents_across)
            .collect();
        for (row, out) in (first..).zip(out.chunks_exact_mut(width)) {
            let beside = &across[row.saturating_sub(1) - from..(row + 2).min(to) - from];
            let known = &background[row * width..(row + 1) * width];
            let shown = image.data[3 * row * width..].as_chunks::<3>().0;
            for (column, out) in out.iter_mut().enumerate() {
                if known[column][0].is_nan() {
                    continue;
                }
                let extents = beside.iter().map(|row| &row[column]);
                let extent = extents.fold(Extent::NOTHING, |all, one| all.with(one));
                *out = extent.distance(&shown[column]);
            }
        }
    };
    out.par_chunks_mut(BAND_ROWS * width)
        .enumerate()
        .for_each(band);
    out
}

/// For each pixel the difference that a quarter of those known are below; NaN where none is.
pub(super) fn ranked(differences: &[&[f32]]) -> Vec<f32> {
    let pixels = differences.first().map_or(0, |difference| difference.len());
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
pub(super) fn middle_colour(backgrounds: &[Compared], pixel: usize) -> [f32; 3] {
    [0, 1, 2].map(|channel| {
        let mut known: Vec<f32> = backgrounds
            .iter()
            .map(|background| background.colours[pixel][channel])
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
        let differences: Vec<&[f32]> = differences.iter().map(Vec::as_slice).collect();
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
