//! Passages between indoors and outdoors: suggestions for people to decide on.
//!
//! Outdoors something above is bright and smooth: sky, cloud, surf or light between leaves. Indoors there are beams,
//! lamps and joints. `Place` measures the share of the cap above 40 degrees of latitude that is open in this sense, by
//! solid angle. It also measures exposure and colour of the whole sphere. A change is suggested if the open share
//! passes from clearly closed to clearly open or back, and exposure or colour change with it. Waves and leaves that
//! pass overhead cover the sky without a change of place.
//!
//! A white ceiling is bright and smooth as well, and a night sky is not: this proposes and never decides. Its error
//! rate is in `docs/results/boundaries.md`.

use std::f32::consts::PI;

use omnilife_schemas::records::{Boundary, BoundaryKind};
use omnilife_video::{Rgb8Image, Scaling};

use super::{Detector, MissingSignal, SignalPass, Signals};

/// The detector.
pub const DETECTOR: Detector = Detector {
    id: "indoor-outdoor",
    summary: "Share of the upper sphere that is bright and smooth, with exposure and colour: passages \
              between indoors and outdoors alone, for people to decide on.",
    settings: || format!("{SETTINGS:?}"),
    images: Scaling::MaxWidth(64),
    start: || Ok(Box::new(PlacePass::default())),
    decide,
};

/// Limits of the detector, set on the clips that `docs/results/boundaries.md` names.
#[derive(Debug, Clone, Copy)]
struct Settings {
    /// Latitude above which the sky is looked for, degrees.
    cap_degrees: f32,
    /// Luminance changes by less than this share per pixel where something is smooth.
    smooth: f32,
    /// Open shares of the cap below which a place is closed and above which it is open.
    closed: f32,
    open: f32,
    /// Logarithm of the exposure, or share of a colour, that changes with the place.
    exposure_change: f32,
    colour_change: f32,
    /// Means are taken over this long before and after.
    side_seconds: f64,
    /// A passage lasts up to twice one of these; the shortest that shows it counts.
    half_passages_seconds: [f64; 4],
}

const SETTINGS: Settings = Settings {
    cap_degrees: 40.0,
    smooth: 0.15,
    closed: 0.22,
    open: 0.28,
    exposure_change: 0.1,
    colour_change: 0.015,
    side_seconds: 1.0,
    half_passages_seconds: [0.0, 0.5, 1.0, 2.0],
};

/// Columns of the table: open share of the cap, logarithm of the mean luminance, shares of red and
/// blue in the whole.
const COLUMNS: [&str; 4] = ["open_above", "log_luminance", "red_share", "blue_share"];

/// Keeps luminance away from zero where it is divided by; levels are 0 to 1.
const DARK: f32 = 0.02;

/// Measurements of one frame, in the order of [`COLUMNS`].
type Place = [f32; COLUMNS.len()];

#[derive(Default)]
struct PlacePass {
    times: Vec<f64>,
    places: [Vec<f32>; COLUMNS.len()],
}

impl SignalPass for PlacePass {
    fn observe(&mut self, time_seconds: f64, image: &Rgb8Image) -> Result<(), String> {
        self.times.push(time_seconds);
        for (column, value) in self.places.iter_mut().zip(place(image)) {
            column.push(value);
        }
        Ok(())
    }

    fn finish(self: Box<Self>) -> Signals {
        Signals {
            times: self.times,
            columns: COLUMNS
                .map(str::to_owned)
                .into_iter()
                .zip(self.places)
                .collect(),
        }
    }
}

/// Measures one equirectangular image; every mean is weighted by solid angle.
fn place(image: &Rgb8Image) -> Place {
    let (width, height) = (image.width, image.height);
    let level = |x: usize, y: usize| image.pixel(x, y).map(|value| f32::from(value) / 255.0);
    // Rec. 709.
    let luminance: Vec<f32> = (0..width * height)
        .map(|at| {
            let [red, green, blue] = level(at % width, at / width);
            0.2126 * red + 0.7152 * green + 0.0722 * blue
        })
        .collect();
    let cosine = |y: usize| latitude(y, height).cos();
    let (mut weights, mut sums, mut bright) = (0.0, [0.0; 3], 0.0);
    for y in 0..height {
        for x in 0..width {
            weights += cosine(y);
            bright += cosine(y) * luminance[y * width + x];
            for (sum, value) in sums.iter_mut().zip(level(x, y)) {
                *sum += cosine(y) * value;
            }
        }
    }
    let mean = bright / weights;
    let (mut cap, mut open) = (0.0, 0.0);
    for y in (0..height).take_while(|&y| latitude(y, height) > SETTINGS.cap_degrees.to_radians()) {
        // Columns lie closer together near the pole: as far apart as rows are.
        let across = ((1.0 / cosine(y)).round() as usize).clamp(1, width / 4);
        for x in 0..width {
            let here = luminance[y * width + x];
            let right = luminance[y * width + (x + across) % width];
            let below = luminance[(y + 1).min(height - 1) * width + x];
            let change = (right - here).hypot(below - here) / (here + DARK);
            cap += cosine(y);
            if change < SETTINGS.smooth && here > mean {
                open += cosine(y);
            }
        }
    }
    let total = sums.iter().sum::<f32>() + DARK * weights;
    [
        if cap > 0.0 { open / cap } else { 0.0 },
        (mean + DARK).ln(),
        sums[0] / total,
        sums[2] / total,
    ]
}

/// Returns the latitude of a row's centre, radians, north up.
fn latitude(row: usize, height: usize) -> f32 {
    (0.5 - (row as f32 + 0.5) / height as f32) * PI
}

fn decide(signals: &Signals) -> Result<Vec<Boundary>, MissingSignal> {
    let mut columns = [[].as_slice(); COLUMNS.len()];
    for (column, name) in columns.iter_mut().zip(COLUMNS) {
        *column = signals.column(name)?;
    }
    let table = Table {
        times: &signals.times,
        columns,
    };
    let mut found: Vec<Boundary> = Vec::new();
    for half in SETTINGS.half_passages_seconds {
        for (passage, contrast) in table.passages(half) {
            let boundary = table.boundary(passage, half, contrast);
            let is_known = found.iter().any(|other| {
                let gap = (other.begin_seconds - boundary.end_seconds)
                    .max(boundary.begin_seconds - other.end_seconds);
                gap < SETTINGS.side_seconds
            });
            if !is_known {
                found.push(boundary);
            }
        }
    }
    found.sort_by(|a, b| a.begin_seconds.total_cmp(&b.begin_seconds));
    Ok(found)
}

struct Table<'a> {
    times: &'a [f64],
    columns: [&'a [f32]; COLUMNS.len()],
}

impl Table<'_> {
    /// Frames in the middle of passages of twice `half` seconds, each with the change of the open
    /// share: of neighbouring frames that show the same passage the one that shows it most.
    fn passages(&self, half: f64) -> Vec<(usize, f32)> {
        let mut found: Vec<(usize, f32)> = Vec::new();
        let mut last = None;
        for frame in 1..self.times.len() {
            let Some(contrast) = self.contrast(frame, half) else {
                last = None;
                continue;
            };
            match (last, found.last_mut()) {
                (Some(before), Some(best)) if f32::signum(before) == contrast.signum() => {
                    if contrast.abs() > best.1.abs() {
                        *best = (frame, contrast);
                    }
                }
                _ => found.push((frame, contrast)),
            }
            last = Some(contrast);
        }
        found
    }

    /// Returns the increase of the open share across a frame, if the place changes.
    fn contrast(&self, frame: usize, half: f64) -> Option<f32> {
        let middle = self.times[frame];
        let (side, slack) = (SETTINGS.side_seconds, 1e-6);
        let before = self.mean(middle - half - side, middle - half - slack)?;
        let after = self.mean(middle + half - slack, middle + half + side)?;
        let closes = before[0] > SETTINGS.open && after[0] < SETTINGS.closed;
        let opens = before[0] < SETTINGS.closed && after[0] > SETTINGS.open;
        let change = |column: usize| (after[column] - before[column]).abs();
        let is_other_light = change(1) > SETTINGS.exposure_change
            || change(2).max(change(3)) > SETTINGS.colour_change;
        ((opens || closes) && is_other_light).then(|| after[0] - before[0])
    }

    /// Means of the columns over a span of which at least half lies in the video.
    fn mean(&self, begin: f64, end: f64) -> Option<Place> {
        let first = self.times.partition_point(|&time| time < begin);
        let behind = self.times.partition_point(|&time| time <= end);
        let (Some(&from), Some(&to)) = (self.times.get(first), self.times.get(behind.max(1) - 1))
        else {
            return None;
        };
        if first >= behind || to - from < 0.5 * (end - begin) {
            return None;
        }
        let share = 1.0 / (behind - first) as f32;
        Some(
            self.columns
                .map(|column| column[first..behind].iter().sum::<f32>() * share),
        )
    }

    /// Returns the boundary around the frame in the middle of a passage.
    fn boundary(&self, frame: usize, half: f64, contrast: f32) -> Boundary {
        let middle = self.times[frame];
        let first = self.times.partition_point(|&time| time < middle - half);
        let last = self.times.partition_point(|&time| time < middle + half);
        Boundary {
            begin_seconds: self.times[first.min(frame - 1)],
            end_seconds: self.times[last.clamp(frame, self.times.len() - 1)],
            kind: BoundaryKind::IndoorOutdoor,
            score: f64::from(contrast.abs()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns a smooth bright sky, or a ceiling with beams; the rest is grey.
    fn image(is_open: bool, x_of_beams: usize) -> Rgb8Image {
        let (width, height) = (64, 32);
        let mut data = Vec::new();
        for y in 0..height {
            for x in 0..width {
                let beam = if (x + x_of_beams) % 4 < 2 { 60 } else { 160 };
                let colour = match (y < height / 2, is_open) {
                    (true, true) => [190, 210, 255],
                    (true, false) => [beam, beam, beam - 10],
                    (false, _) => [90, 85, 80],
                };
                data.extend_from_slice(&colour);
            }
        }
        Rgb8Image::new(width, height, data)
    }

    fn boundaries(is_open: impl Fn(usize) -> bool) -> Vec<Boundary> {
        let mut pass = Box::new(PlacePass::default());
        for frame in 0..150 {
            pass.observe(frame as f64 / 25.0, &image(is_open(frame), frame / 3))
                .expect("observed");
        }
        decide(&pass.finish()).expect("its own columns")
    }

    #[test]
    fn other_light_below_an_open_sky_is_no_passage() {
        let times: Vec<f64> = (0..150).map(|frame| f64::from(frame) / 25.0).collect();
        let step = |before: f32, after: f32| [[before; 75], [after; 75]].concat();
        let contrast = |open_after: f32| {
            let columns = [
                step(0.9, open_after),
                step(0.0, 1.0),
                step(0.3, 0.3),
                step(0.3, 0.3),
            ];
            let table = Table {
                times: &times,
                columns: columns.each_ref().map(Vec::as_slice),
            };
            table.contrast(75, SETTINGS.half_passages_seconds[0])
        };
        assert_eq!(contrast(0.9), None);
        let closes = contrast(0.0).expect("a passage");
        assert!((closes + 0.9).abs() < 0.1, "{closes}");
    }

    #[test]
    fn a_passage_is_found_to_the_frame_and_a_place_that_stays_gives_none() {
        let found = boundaries(|frame| frame >= 70);
        assert_eq!(found.len(), 1, "{found:?}");
        assert!((found[0].begin_seconds - 69.0 / 25.0).abs() < 1e-9);
        assert!((found[0].end_seconds - 70.0 / 25.0).abs() < 1e-9);
        assert_eq!(found[0].kind, BoundaryKind::IndoorOutdoor);
        assert_eq!(boundaries(|frame| frame < 70).len(), 1);
        assert!(boundaries(|_| true).is_empty() && boundaries(|_| false).is_empty());
        // Covered for a moment: no other place.
        assert!(boundaries(|frame| !(70..74).contains(&frame)).is_empty());
    }

    #[test]
    fn what_is_measured_does_not_depend_on_where_the_camera_looks() {
        let straight = image(false, 0);
        let mut turned = straight.clone();
        for y in 0..straight.height {
            for x in 0..straight.width {
                let at = (y * straight.width + (x + 8) % straight.width) * 3;
                turned.data[at..at + 3].copy_from_slice(&straight.pixel(x, y));
            }
        }
        for (a, b) in place(&straight).into_iter().zip(place(&turned)) {
            assert!((a - b).abs() < 1e-4, "{a} {b}");
        }
    }
}
