//! Contact sheets: small frames of a sequence with its masks and the overlays of its video.

use std::path::Path;

use omnilife_schemas::{
    image_file::ImageFile,
    layout::ANALYSIS_FILE,
    records::{Overlay, OverlayClass, VideoAnalysis},
    rgb::Mask,
    store::StoreError,
};
use omnilife_video::Rgb8Image;

use super::{
    finds::{self, Find, MOST_FINDS},
    marks::{self, Mark},
    parts::{FrameFiles, Records},
};
use crate::{error::CurateError, jpeg, publish::optional};

/// Frames of a sheet.
const FRAMES: usize = 8;
/// Width of a frame, pixels.
const WIDTH: usize = 256;
/// Largest height of a frame, pixels.
const MOST_HEIGHT: usize = 256;
/// JPEG quality, 1 to 100.
const QUALITY: u8 = 72;

/// Contact sheet of a sequence.
pub(super) struct Sheet {
    pub(super) frames: Vec<SheetFrame>,
    /// Classes of the overlays that are drawn.
    pub(super) overlays: Vec<OverlayClass>,
    /// The largest of these overlays.
    pub(super) finds: Vec<Find>,
    /// Reason why the overlays are not known.
    pub(super) fault: Option<String>,
}

pub(super) struct SheetFrame {
    /// Number of the frame in its sequence.
    pub(super) number: usize,
    pub(super) time_seconds: f64,
    /// True if an overlay stays at its time.
    pub(super) has_overlay: bool,
    /// The drawn frame, or the reason why it cannot be shown.
    pub(super) shown: Result<Thumbnail, String>,
}

/// Small image.
pub(super) struct Thumbnail {
    /// JPEG as a data URL.
    pub(super) url: String,
    pub(super) width: usize,
    pub(super) height: usize,
    /// Masks of the frame at this size.
    pub(super) masks: Vec<(Mark, Mask)>,
}

impl Sheet {
    /// Draws evenly spaced frames of a sequence.
    pub(super) fn draw(records: &Records) -> Self {
        let wraps = !records.is_pinhole();
        // Overlays are regions of panoramas.
        let (mut overlays, fault) = match wraps.then(|| overlays(records)) {
            Some(Ok(overlays)) => (overlays, None),
            Some(Err(error)) => (Vec::new(), Some(error.for_records())),
            None => (Vec::new(), None),
        };
        let frames = records.frames();
        // Those of the other shots are on the sheets of their sequences.
        overlays.retain(|overlay| finds::concerns(overlay, &frames));
        let shown = spread(frames.len()).map(|number| {
            let frame = &frames[number];
            let is_shown = |overlay: &&Overlay| finds::is_shown(overlay, frame.time_seconds);
            let here: Vec<Overlay> = overlays.iter().filter(is_shown).cloned().collect();
            SheetFrame {
                number,
                time_seconds: frame.time_seconds,
                has_overlay: !here.is_empty(),
                shown: shown(&records.path, frame, &here, wraps)
                    .map_err(|error| error.for_records()),
            }
        });
        let finds = overlays.iter().take(MOST_FINDS);
        Self {
            frames: shown.collect(),
            finds: finds
                .map(|overlay| Find::of(&records.path, &frames, overlay))
                .collect(),
            overlays: overlays.iter().map(|overlay| overlay.class).collect(),
            fault,
        }
    }

    /// Returns the kinds of regions that its frames show.
    pub(super) fn marks(&self) -> impl Iterator<Item = Mark> {
        let shown = move || (self.frames.iter()).filter_map(|frame| frame.shown.as_ref().ok());
        Mark::ALL.into_iter().filter(move |mark| match mark {
            Mark::Overlay => !self.overlays.is_empty(),
            mark => shown().any(|shown| shown.masks.iter().any(|(of, _)| of == mark)),
        })
    }
}

/// Returns the overlays of the sequence's video.
fn overlays(records: &Records) -> Result<Vec<Overlay>, CurateError> {
    let Some(video) = records.path.parent() else {
        return Ok(Vec::new());
    };
    let analysis: Option<VideoAnalysis> = optional(&video.join(ANALYSIS_FILE))?;
    let report = analysis.and_then(|analysis| analysis.overlays);
    Ok(report.map_or_else(Vec::new, |report| report.overlays))
}

/// Returns at most [`FRAMES`] evenly spaced numbers below `count`, the first and the last included.
fn spread(count: usize) -> impl Iterator<Item = usize> {
    let shown = count.min(FRAMES);
    let steps = shown.saturating_sub(1).max(1);
    (0..shown).map(move |step| step * (count - 1) / steps)
}

fn shown(
    folder: &Path,
    frame: &FrameFiles<'_>,
    overlays: &[Overlay],
    wraps: bool,
) -> Result<Thumbnail, CurateError> {
    let path = folder.join(frame.image);
    let image = ImageFile::open(&path)?.decode()?;
    let (old_width, old_height) = (image.width() as usize, image.height() as usize);
    let height = (WIDTH * old_height).div_ceil(old_width.max(1));
    let height = height.clamp(1, MOST_HEIGHT);
    let width = (height * old_width / old_height.max(1)).clamp(1, WIDTH);
    let small = image.thumbnail_exact(width as u32, height as u32);
    let mut rgb = small.into_rgb8().into_raw();
    let of_frame = [
        (Mark::Moving, frame.moving.as_deref()),
        (Mark::Ignored, frame.ignored),
    ];
    let of_frame = of_frame
        .into_iter()
        .filter_map(|(mark, file)| Some((mark, file?)));
    let masks = of_frame.map(|(mark, file)| {
        let mask = Mask::read(&folder.join(file))?;
        Ok((mark, mask.resized_to_any(width, height)))
    });
    let masks = masks.collect::<Result<Vec<_>, StoreError>>()?;
    for (mark, mask) in &masks {
        marks::draw(&mut rgb, mask, *mark, wraps);
    }
    if !overlays.is_empty() {
        let discs = marks::overlays(overlays, width, height);
        marks::draw(&mut rgb, &discs, Mark::Overlay, wraps);
    }
    let small = Rgb8Image::new(width, height, rgb);
    let url =
        jpeg::data_url(&small, QUALITY).map_err(|error| CurateError::internal(&path, error))?;
    Ok(Thumbnail {
        url,
        width,
        height,
        masks,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_are_spread_from_the_first_to_the_last() {
        let numbers = |count| spread(count).collect::<Vec<_>>();
        assert_eq!(numbers(0), [0; 0]);
        assert_eq!(numbers(1), [0]);
        assert_eq!(numbers(3), [0, 1, 2]);
        assert_eq!(numbers(15), [0, 2, 4, 6, 8, 10, 12, 14]);
        assert_eq!(numbers(120).last(), Some(&119));
    }
}
