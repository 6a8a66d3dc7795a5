//! Content that comes and goes before a camera that stands.
//!
//! A frame is compared with views of the same camera before and after it, at least a fifth of a second apart. Content
//! moves if it differs from most views before and from most after, by more than the pixel itself changes from view to
//! view. A place that content has left, or will enter, agrees with one of the two. Leaves that tremble stay within
//! their neighbours' grey values or change as much all the time. Content that comes to rest or has rested ceases to
//! be marked once it agrees with one side; so does the inside of content that stays over its own place.
//!
//! A camera stands while nearby views agree in most of their detail, without any registration.

use std::{
    collections::{BTreeMap, btree_map::Entry},
    marker::PhantomData,
    path::Path,
    sync::Arc,
};

use omnilife_schemas::{records::Sequence, rgb::Mask};
use opencv::{core::Mat, imgproc};

use super::{changes::ComparableFrame, combined, field::Field, vote};
use crate::{
    error::CurateError,
    opencv_images::{across_seam, disc, square},
};

/// Views of one side are at least this far apart, seconds.
const LEAST_GAP_SECONDS: f64 = 0.2;
/// Views of one side, at most.
const MOST_VIEWS: usize = 10;
/// Views of one side from which on it has a say ...
const ENOUGH_VIEWS: usize = 5;
/// ... and where neither side has so many, as in a short shot, the side with the most needs this many.
const FEWEST_VIEWS: usize = 3;
/// Detail may lie this many pixels from its place.
const SLACK_PIXELS: usize = 1;
/// Differences are averaged over squares that reach so many pixels.
const REACH_PIXELS: usize = 2;
/// Differences of grey values, of [0, 1], are clamped to this.
const LARGEST_DIFFERENCE: f32 = 0.25;
/// Slope of grey values, of [0, 1] per pixel, from which on a pixel has detail.
const DETAIL: f32 = 0.02;
/// Share of all pixels that must have detail.
const LEAST_DETAIL: f64 = 0.01;
/// Share of the detail that agrees in views of one camera that stands. It is 0.97 to 1.00 in the labelled rain forest,
/// and at most 0.32 in the rendered street, where the camera walks for 0.2 s or longer.
const LEAST_AGREEMENT: f64 = 0.75;
/// Change of grey values, of [0, 1], from which on a pixel belongs to moving content ...
const LEAST_CHANGE: f32 = 0.01;
/// ... if a pixel of the same region changes by this much.
const CLEAR_CHANGE: f32 = 0.03;
/// Least area of a region, steradians.
const LEAST_STERADIANS: f64 = 3e-3;
/// The same in a perspective frame, as a share of it.
const LEAST_FRAME_SHARE: f64 = 1.5e-4;
/// Gaps of up to twice this are closed, pixels.
const CLOSED_PIXELS: usize = 4;
/// Rim that differences gain by their squares, pixels.
const RIM_PIXELS: usize = 1;

/// Returns the settings, for the record.
pub(super) fn settings() -> String {
    format!(
        "a standing camera: {LEAST_CHANGE} to {CLEAR_CHANGE} from {FEWEST_VIEWS} to {MOST_VIEWS} views before and \
         after, {LEAST_GAP_SECONDS} s apart, in which {LEAST_AGREEMENT} of the detail agrees"
    )
}

/// A frame and the range of grey values around each of its pixels.
struct View {
    luma: Field,
    darkest: Vec<f32>,
    brightest: Vec<f32>,
    has_detail: Vec<bool>,
    /// True for panoramas: columns go on across the seam.
    wraps: bool,
}

impl View {
    fn new(luma: Field, wraps: bool) -> opencv::Result<Self> {
        let reach = if wraps { SLACK_PIXELS } else { 0 };
        let kernel = square(SLACK_PIXELS)?;
        let (values, width) = (&luma.values, luma.width);
        let darkest = across_seam(values, width, reach, |from, to| {
            imgproc::erode_def(from, to, &kernel)
        })?;
        let brightest = across_seam(values, width, reach, |from, to| {
            imgproc::dilate_def(from, to, &kernel)
        })?;
        let slopes = luma.slopes(wraps);
        Ok(Self {
            has_detail: slopes.values.iter().map(|&slope| slope > DETAIL).collect(),
            darkest,
            brightest,
            luma,
            wraps,
        })
    }

    /// Returns how far each pixel lies outside of what another view shows around its place, averaged over a square.
    fn difference(&self, that: &Self) -> opencv::Result<Field> {
        let range = that.darkest.iter().zip(&that.brightest);
        let values = self.luma.values.iter().zip(range);
        let values = values.map(|(&value, (&darkest, &brightest))| {
            (value - brightest)
                .max(darkest - value)
                .clamp(0.0, LARGEST_DIFFERENCE)
        });
        let difference = Field {
            values: values.collect(),
            ..self.luma
        };
        difference.box_mean(REACH_PIXELS, self.wraps)
    }

    /// Returns true if most of this view's detail agrees, by its difference to another one.
    fn agrees(&self, difference: &Field) -> bool {
        let detailed = self.has_detail.iter().zip(&difference.values);
        let detailed = detailed.filter(|&(&has_detail, _)| has_detail);
        let (mut all, mut same) = (0_usize, 0_usize);
        for (_, &difference) in detailed {
            all += 1;
            same += usize::from(difference < LEAST_CHANGE);
        }
        all as f64 >= LEAST_DETAIL * self.has_detail.len() as f64
            && same as f64 >= LEAST_AGREEMENT * all as f64
    }
}

/// Views before or after a frame, the nearest first, with the frame's differences to them.
#[derive(Default)]
struct Side {
    views: Vec<Arc<View>>,
    differences: Vec<Field>,
}

impl Side {
    /// Takes views from the nearest one on, as long as they agree with the frame.
    fn of(
        this: &View,
        views: impl Iterator<Item = Result<Arc<View>, CurateError>>,
        folder: &Path,
    ) -> Result<Self, CurateError> {
        let mut side = Self::default();
        for view in views {
            let view = view?;
            let difference = this.difference(&view);
            let difference = difference.map_err(|error| CurateError::internal(folder, error))?;
            if !this.agrees(&difference) {
                break;
            }
            side.views.push(view);
            side.differences.push(difference);
        }
        Ok(side)
    }

    /// Returns the differences between neighbouring views.
    fn changes(&self) -> opencv::Result<Vec<Field>> {
        let pairs = self.views.windows(2);
        pairs
            .filter_map(|pair| match pair {
                [nearer, farther] => Some(nearer.difference(farther)),
                _ => None,
            })
            .collect()
    }
}

/// Views of a sequence, for frames in order of time.
pub(super) struct StillViews<'a, I> {
    folder: &'a Path,
    sequence: &'a Sequence,
    /// Frames that others are compared with, in order of time.
    compared: Vec<usize>,
    held: BTreeMap<usize, Arc<View>>,
    frame: PhantomData<I>,
}

impl<'a, I: ComparableFrame> StillViews<'a, I> {
    pub(super) fn new(folder: &'a Path, sequence: &'a Sequence) -> Self {
        let entries = sequence.frames.entries.iter();
        let times: Vec<f64> = entries.map(|entry| entry.time_seconds).collect();
        Self {
            folder,
            sequence,
            compared: spaced(&times),
            held: BTreeMap::new(),
            frame: PhantomData,
        }
    }

    /// Marks the dynamic regions of a frame, at the size at which frames are compared; `None` unless the camera stands
    /// around it. Frames are asked for in order of time.
    ///
    /// # Errors
    /// When a frame cannot be read or filtered.
    pub(super) fn of_frame(&mut self, index: usize) -> Result<Option<Mask>, CurateError> {
        let folder = self.folder;
        let this = self.view(index)?;
        let [before, after] = around(&self.compared, index);
        let oldest = before.last().copied().unwrap_or(index);
        let compared = &self.compared;
        self.held
            .retain(|held, _| *held >= oldest && compared.binary_search(held).is_ok());
        let before = Side::of(&this, before.into_iter().map(|at| self.view(at)), folder)?;
        let after = Side::of(&this, after.into_iter().map(|at| self.view(at)), folder)?;
        let mask = marked([&before, &after], I::IS_SPHERE);
        mask.map_err(|error| CurateError::internal(folder, error))
    }

    fn view(&mut self, index: usize) -> Result<Arc<View>, CurateError> {
        match self.held.entry(index) {
            Entry::Occupied(view) => Ok(Arc::clone(view.get())),
            Entry::Vacant(place) => {
                let luma = I::read(self.folder, self.sequence, index)?.grey();
                let view = View::new(luma, I::IS_SPHERE);
                let view = view.map_err(|error| CurateError::internal(self.folder, error))?;
                Ok(Arc::clone(place.insert(Arc::new(view))))
            }
        }
    }
}

/// Returns the first of these times and those that are far enough from the one before, as indices.
fn spaced(times: &[f64]) -> Vec<usize> {
    let mut last = f64::NEG_INFINITY;
    let mut found = Vec::new();
    for (index, &time) in times.iter().enumerate() {
        if time - last >= LEAST_GAP_SECONDS - 1e-6 {
            last = time;
            found.push(index);
        }
    }
    found
}

/// Returns the frames before and after one, the nearest first, at most [`MOST_VIEWS`] each.
fn around(compared: &[usize], index: usize) -> [Vec<usize>; 2] {
    let before = compared.iter().rev().filter(|&&other| other < index);
    let after = compared.iter().filter(|&&other| other > index);
    [
        before.take(MOST_VIEWS).copied().collect(),
        after.take(MOST_VIEWS).copied().collect(),
    ]
}

/// Marks what differs from the views before and after; from those of one side if the other has too few, and `None` if
/// both do.
fn marked(sides: [&Side; 2], is_sphere: bool) -> opencv::Result<Option<Mask>> {
    let Some(change) = change(sides)? else {
        return Ok(None);
    };
    let size = [change.width, change.height];
    let least = if is_sphere {
        LEAST_STERADIANS
    } else {
        LEAST_FRAME_SHARE
    };
    let area = combined::area(size, !is_sphere);
    let possible: Vec<bool> = change.values.iter().map(|&at| at > LEAST_CHANGE).collect();
    let mut marks = vec![0_u8; possible.len()];
    for region in vote::regions(&possible, change.width, is_sphere) {
        let is_clear = region.iter().any(|&at| change.values[at] > CLEAR_CHANGE);
        let covered: f64 = region.iter().map(|&at| area(at / change.width)).sum();
        if is_clear && covered >= least {
            for at in region {
                marks[at] = 255;
            }
        }
    }
    let marks = closed(&marks, change.width, is_sphere)?;
    Ok(Some(Mask::new(change.width, change.height, marks)))
}

/// Returns the change of each pixel that views on both sides agree on, above its own change from view to view.
fn change(sides: [&Side; 2]) -> opencv::Result<Option<Field>> {
    let most = sides.map(|side| side.views.len()).into_iter().max();
    let enough = most.unwrap_or(0).clamp(FEWEST_VIEWS, ENOUGH_VIEWS);
    let heard = sides.into_iter();
    let heard = heard.filter(|side| side.views.len() >= enough);
    let heard: Vec<&Side> = heard.collect();
    let changes = heard.iter().map(|side| median(&side.differences));
    let Some(mut change) = changes.flatten().reduce(|a, b| a.smaller(&b)) else {
        return Ok(None);
    };
    let mut own = Vec::new();
    for side in heard {
        own.extend(side.changes()?);
    }
    if let Some(own) = median(&own) {
        for (value, own) in change.values.iter_mut().zip(own.values) {
            *value -= own;
        }
    }
    Ok(Some(change))
}

/// Returns the lower median of each pixel; `None` without a field.
fn median(fields: &[Field]) -> Option<Field> {
    let first = fields.first()?;
    let mut values = Vec::with_capacity(fields.len());
    let of_pixel = |pixel: usize| {
        values.clear();
        values.extend(fields.iter().map(|field| field.values[pixel]));
        let middle = (values.len() - 1) / 2;
        *values.select_nth_unstable_by(middle, f32::total_cmp).1
    };
    Some(Field {
        values: (0..first.values.len()).map(of_pixel).collect(),
        ..*first
    })
}

/// Closes gaps in marks, then takes the rim away that differences have gained.
fn closed(marks: &[u8], width: usize, wraps: bool) -> opencv::Result<Vec<u8>> {
    let reach = if wraps {
        2 * CLOSED_PIXELS + RIM_PIXELS
    } else {
        0
    };
    across_seam(marks, width, reach, |from, to| {
        let (mut grown, mut shrunk) = (Mat::default(), Mat::default());
        imgproc::dilate_def(from, &mut grown, &disc(CLOSED_PIXELS)?)?;
        imgproc::erode_def(&grown, &mut shrunk, &disc(CLOSED_PIXELS)?)?;
        imgproc::erode_def(&shrunk, to, &disc(RIM_PIXELS)?)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    const WIDTH: usize = 96;
    const HEIGHT: usize = 48;
    /// View that the others are compared with.
    const THIS: usize = 10;

    /// A texture that the camera has shifted, a white square that moves by 2 columns a view, and a leaf with three grey
    /// values in turn.
    fn view(index: usize, shift: usize) -> Arc<View> {
        let left = 10 + 2 * index;
        let leaf = [0.2, 0.6, 0.9][index % 3];
        let value = |pixel: usize| {
            let (x, y) = (pixel % WIDTH, pixel / WIDTH);
            if (left..left + 12).contains(&x) && (20..32).contains(&y) {
                1.0
            } else if (70..76).contains(&x) && (8..14).contains(&y) {
                leaf
            } else {
                0.4 + 0.1 * ((x + shift) as f32 * 1.3).sin() * (y as f32 * 1.1).cos()
            }
        };
        let grey = Field {
            width: WIDTH,
            height: HEIGHT,
            values: (0..WIDTH * HEIGHT).map(value).collect(),
        };
        Arc::new(View::new(grey, false).expect("filtered"))
    }

    fn side(views: impl Iterator<Item = Arc<View>>) -> Side {
        Side::of(&view(THIS, 0), views.map(Ok), Path::new("frames")).expect("filtered")
    }

    #[test]
    fn what_comes_and_goes_is_marked_and_what_trembles_is_not() {
        let before = side((0..THIS).rev().map(|index| view(index, 0)));
        let after = side((THIS + 1..=2 * THIS).map(|index| view(index, 0)));
        assert_eq!([before.views.len(), after.views.len()], [10, 10]);
        let mask = marked([&before, &after], false).expect("filtered");
        let mask = mask.expect("a standing camera");
        let at = |x: usize, y: usize| mask.data[y * WIDTH + x];
        // The square is in columns 30 to 41. Column 20 was part of it in 6 of 10 views, and 51 will be.
        assert_eq!([at(36, 26), at(20, 26), at(51, 26)], [255, 0, 0]);
        assert_eq!(at(73, 11), 0);
        let marks = mask.data.iter().filter(|&&mark| mark != 0).count();
        assert!((120..240).contains(&marks), "{marks}");
    }

    #[test]
    fn views_of_a_camera_that_moves_have_no_say() {
        let moving = || side((0..THIS).rev().map(|index| view(index, 3)));
        assert!(moving().views.is_empty());
        let mask = marked([&moving(), &moving()], false).expect("filtered");
        assert_eq!(mask, None);
        // Views on one side are enough.
        let after = side((THIS + 1..=2 * THIS).map(|index| view(index, 0)));
        let mask = marked([&moving(), &after], false).expect("filtered");
        assert!(mask.is_some_and(|mask| mask.data[26 * WIDTH + 36] == 255));
    }

    #[test]
    fn three_views_are_enough_where_there_are_no_more() {
        let before = |views: usize| side((0..THIS).rev().take(views).map(|index| view(index, 0)));
        let change = |views: [usize; 2]| {
            let [shorter, longer] = views.map(before);
            change([&shorter, &longer]).expect("filtered")
        };
        assert_eq!(change([2, 2]), None);
        assert!(change([0, 3]).is_some());
        // A side with fewer views has no say beside a longer one.
        assert_eq!(change([2, 4]), change([0, 4]));
        assert_eq!(change([4, 7]), change([0, 7]));
        assert_ne!(change([5, 7]), change([0, 7]));
    }

    #[test]
    fn views_are_spaced_in_time_and_the_nearest_come_first() {
        assert_eq!(spaced(&[0.0, 0.1, 0.2, 0.3, 0.45]), [0, 2, 4]);
        let compared: Vec<usize> = (0..30).collect();
        let [before, after] = around(&compared, 20);
        let expected: (Vec<usize>, Vec<usize>) = ((10..20).rev().collect(), (21..30).collect());
        assert_eq!((before, after), expected);
    }

    #[test]
    fn medians_are_of_each_pixel() {
        let fields = [3.0, 1.0, 9.0, 2.0].map(|value| Field {
            width: 2,
            height: 1,
            values: vec![value, -value],
        });
        let middle = median(&fields).map(|field| field.values);
        assert_eq!(middle, Some(vec![2.0, -3.0]));
        assert_eq!(median(&[]), None);
    }
}
