//! One decode of a video for all images of its page.

use std::{collections::BTreeMap, path::Path};

use omnilife_schemas::{
    progress::Progress,
    records::{Boundary, VideoAnalysis},
};
use omnilife_video::{Converter, Scaling, VideoReader};

use super::{
    Image,
    filmstrip::{self, Filmstrips},
    proxy::{self, Proxy, ProxyWriter},
};
use crate::{
    boundaries::{Signals, indoor_outdoor},
    error::CurateError,
    jpeg,
};

/// Content of a page that comes from its video.
pub(super) struct PageImages {
    /// Frames around each candidate, in the order of the candidates.
    pub(super) filmstrips: Vec<Vec<Image>>,
    /// Frames spread over the video.
    pub(super) overview: Vec<Image>,
    pub(super) proxy: Proxy,
    /// Suggested boundaries between indoors and outdoors.
    pub(super) suggestions: Vec<Boundary>,
}

/// Input of the decode.
pub(super) struct DecodeInputs<'a> {
    pub(super) video: &'a Path,
    pub(super) page: &'a Path,
    pub(super) analysis: &'a VideoAnalysis,
    /// Timestamps of all frames, seconds.
    pub(super) times: &'a [f64],
    pub(super) strips: &'a Filmstrips,
    /// A small video up to this size is embedded in the page.
    pub(super) embedded_bytes: u64,
}

impl DecodeInputs<'_> {
    /// # Errors
    /// When the video breaks off before its end, or the small video cannot be written.
    pub(super) fn look(&self, progress: &dyn Progress) -> Result<PageImages, CurateError> {
        progress.begin("drawing the page", Some(self.times.len() as u64));
        let decoded = self.decode(progress);
        progress.end();
        let (images, proxy, signals) = decoded?;
        let (filmstrips, overview) = self.strips.filled(&images).map_err(|frame| {
            let reason = format!("has no frame at {} s", self.times[frame]);
            CurateError::video(self.video, reason)
        })?;
        let end = self.analysis.range.end_seconds;
        Ok(PageImages {
            filmstrips,
            overview,
            proxy: proxy.finish(self.page, end, self.embedded_bytes)?,
            suggestions: (indoor_outdoor::DETECTOR.decide)(&signals)
                .map_err(|error| CurateError::internal(self.video, error))?,
        })
    }

    fn decode(
        &self,
        progress: &dyn Progress,
    ) -> Result<(BTreeMap<usize, Image>, ProxyWriter, Signals), CurateError> {
        let internal = |reason: String| CurateError::internal(self.video, reason);
        let turns = self.analysis.probe.clockwise_quarter_turns();
        let wanted = self.strips.frames();
        let mut images = BTreeMap::new();
        let mut proxy = ProxyWriter::new(self.page, self.analysis.range.begin_seconds);
        let mut places = (indoor_outdoor::DETECTOR.start)()?;
        let mut reader = VideoReader::open(self.video)?;
        let converter = |scaling| {
            let mut converter = Converter::new(scaling);
            move |frame: &ffmpeg_next::frame::Video| {
                Ok::<_, CurateError>(converter.convert(self.video, frame)?.turned(turns))
            }
        };
        let mut strip = converter(Scaling::MaxWidth(filmstrip::WIDTH_PIXELS));
        let mut small = converter(Scaling::MaxWidth(proxy::WIDTH_PIXELS));
        let mut tiny = converter(indoor_outdoor::DETECTOR.images);
        while let Some(frame) = reader.next_frame()? {
            progress.advance(1);
            let seconds = frame.time_seconds;
            proxy.push(&small(&frame.image)?, seconds)?;
            places
                .observe(seconds, &tiny(&frame.image)?)
                .map_err(internal)?;
            let index = self.times.partition_point(|&time| time < seconds - 1e-6);
            if wanted.contains(&index) {
                let url = jpeg::data_url(&strip(&frame.image)?, filmstrip::QUALITY);
                let url = url.map_err(|error| internal(error.to_string()))?;
                images.insert(index, Image { frame: index, url });
            }
        }
        Ok((images, proxy, places.finish()))
    }
}
