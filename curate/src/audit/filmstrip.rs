//! Small images of chosen frames, from one decode of the video.

use std::{collections::BTreeMap, io::Cursor, path::Path};

use base64::{Engine, engine::general_purpose::STANDARD};
use image::{ExtendedColorType, ImageEncoder, codecs::jpeg::JpegEncoder};
use omnilife_schemas::{progress::Progress, records::Probe};

use super::Image;
use crate::{
    error::CurateError,
    ledger::Candidate,
    video::{Converter, Rgb8Image, Scaling, VideoReader},
};

/// Width of an image, pixels.
const WIDTH_PIXELS: u32 = 192;
/// JPEG quality, 1 to 100.
const QUALITY: u8 = 70;
/// Frames before and after a boundary.
const AROUND: usize = 4;
/// Most frames inside a boundary.
const INSIDE: usize = 8;
/// Most frames of the overview.
const OVERVIEW: usize = 48;

/// Which frames are shown where.
pub(super) struct Filmstrips {
    strips: Vec<Vec<usize>>,
    overview: Vec<usize>,
    times: Vec<f64>,
}

impl Filmstrips {
    pub(super) fn plan(times: &[f64], candidates: &[Candidate]) -> Self {
        let last = times.len().saturating_sub(1);
        let nearest = |seconds: f64| {
            times
                .partition_point(|&time| time < seconds - 1e-6)
                .min(last)
        };
        let strips = candidates
            .iter()
            .map(|candidate| {
                let begin = nearest(candidate.boundary.begin_seconds);
                let end = nearest(candidate.boundary.end_seconds).max(begin);
                let mut strip: Vec<usize> = (begin.saturating_sub(AROUND)..=begin).collect();
                strip.extend(spread(begin, end, INSIDE + 1));
                strip.extend(end..=(end + AROUND).min(last));
                strip.dedup();
                strip
            })
            .collect();
        Self {
            strips,
            overview: spread(0, last, OVERVIEW).collect(),
            times: times.to_vec(),
        }
    }

    /// Images of the strips and of the overview.
    ///
    /// # Errors
    /// When the video breaks off before the last frame that is shown.
    pub(super) fn draw(
        self,
        video: &Path,
        probe: &Probe,
        progress: &dyn Progress,
    ) -> Result<(Vec<Vec<Image>>, Vec<Image>), CurateError> {
        let mut images: BTreeMap<usize, Option<Image>> = self
            .strips
            .iter()
            .flatten()
            .chain(&self.overview)
            .map(|&frame| (frame, None))
            .collect();
        let turns = probe.clockwise_quarter_turns();
        progress.begin("drawing filmstrips", Some(self.times.len() as u64));
        let drawn = self.decode(video, turns, &mut images, progress);
        progress.end();
        drawn?;
        let encoded = |&frame: &usize| {
            images.get(&frame).cloned().flatten().ok_or_else(|| {
                CurateError::video(video, format!("has no frame at {} s", self.times[frame]))
            })
        };
        let strips: Result<Vec<Vec<Image>>, CurateError> = self
            .strips
            .iter()
            .map(|strip| strip.iter().map(encoded).collect())
            .collect();
        let overview: Result<Vec<Image>, CurateError> = self.overview.iter().map(encoded).collect();
        Ok((strips?, overview?))
    }

    fn decode(
        &self,
        video: &Path,
        turns: u32,
        images: &mut BTreeMap<usize, Option<Image>>,
        progress: &dyn Progress,
    ) -> Result<(), CurateError> {
        let mut reader = VideoReader::open(video)?;
        let mut converter = Converter::new(Scaling::MaxWidth(WIDTH_PIXELS));
        let last = images.keys().next_back().copied().unwrap_or(0);
        while let Some(frame) = reader.next_frame()? {
            progress.advance(1);
            let index = self
                .times
                .partition_point(|&time| time < frame.time_seconds - 1e-6);
            if let Some(slot) = images.get_mut(&index) {
                let small = converter.convert(video, &frame.image)?.turned(turns);
                let url = data_url(&small).map_err(|error| CurateError::internal(video, error))?;
                *slot = Some(Image { frame: index, url });
            }
            if index >= last {
                break;
            }
        }
        Ok(())
    }
}

/// At most `count` numbers from `first` up to `last`, evenly, with both.
fn spread(first: usize, last: usize, count: usize) -> impl Iterator<Item = usize> {
    let steps = (last - first).min(count.saturating_sub(1));
    (0..=steps).map(move |step| first + (last - first) * step / steps.max(1))
}

fn data_url(rendered: &Rgb8Image) -> Result<String, image::ImageError> {
    let mut bytes = Cursor::new(Vec::new());
    JpegEncoder::new_with_quality(&mut bytes, QUALITY).write_image(
        &rendered.data,
        rendered.width as u32,
        rendered.height as u32,
        ExtendedColorType::Rgb8,
    )?;
    Ok(format!(
        "data:image/jpeg;base64,{}",
        STANDARD.encode(bytes.get_ref())
    ))
}
