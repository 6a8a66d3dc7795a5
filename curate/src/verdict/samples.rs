//! The few frames of a video that the ERP verdict looks at.

use std::path::Path;

use crate::{
    error::CurateError,
    video::{Converter, Rgb8Picture, Scaling, decode::Frame},
};

/// Width in pixels at which the verdict looks at frames.
const WIDTH_PIXELS: u32 = 512;
/// At this many frames every other one is let go.
const MOST: usize = 24;
/// Distance of the first frames, seconds.
const FIRST_INTERVAL_SECONDS: f64 = 0.25;

/// Frames spread evenly over a video of any length: 12 to 24 once it is long enough.
///
/// Built as the video streams by: whenever there are 24, every other one is dropped and the
/// distance doubles. So neither the length of the video nor a correct header is needed.
pub struct FrameSamples {
    pictures: Vec<Rgb8Picture>,
    interval_seconds: f64,
    next_seconds: Option<f64>,
    converter: Converter,
}

impl Default for FrameSamples {
    fn default() -> Self {
        Self {
            pictures: Vec::new(),
            interval_seconds: FIRST_INTERVAL_SECONDS,
            next_seconds: None,
            converter: Converter::new(Scaling::MaxWidth(WIDTH_PIXELS)),
        }
    }
}

impl std::fmt::Debug for FrameSamples {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        formatter
            .debug_struct("FrameSamples")
            .field("pictures", &self.pictures.len())
            .field("interval_seconds", &self.interval_seconds)
            .finish_non_exhaustive()
    }
}

impl FrameSamples {
    /// Takes the frame if its time has come; it is turned by `turns` quarter turns.
    pub(crate) fn offer(
        &mut self,
        video: &Path,
        frame: &Frame,
        turns: u32,
    ) -> Result<(), CurateError> {
        if self
            .next_seconds
            .is_some_and(|next| frame.time_seconds < next)
        {
            return Ok(());
        }
        let picture = self.converter.convert(video, &frame.picture)?;
        self.pictures.push(picture.turned(turns));
        if self.pictures.len() == MOST {
            let mut index = 0;
            self.pictures.retain(|_| {
                index += 1;
                index % 2 == 1
            });
            self.interval_seconds *= 2.0;
        }
        self.next_seconds = Some(frame.time_seconds + self.interval_seconds);
        Ok(())
    }

    /// The frames in order of time.
    pub fn pictures(&self) -> &[Rgb8Picture] {
        &self.pictures
    }
}
