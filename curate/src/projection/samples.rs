//! Frames of a video that are sampled for its projection.

use crate::video::Rgb8Image;

/// At this many frames every other one is dropped.
const MOST: usize = 24;
/// Interval of the first frames, seconds.
const FIRST_INTERVAL_SECONDS: f64 = 0.25;

/// Frames spread evenly over a video of any length: 12 to 24 once it is long enough.
///
/// It is built while the video streams by: whenever there are 24, every other one is dropped and the interval doubles.
/// This needs neither the length of the video nor a correct header.
pub struct FrameSamples {
    images: Vec<Rgb8Image>,
    interval_seconds: f64,
    next_seconds: Option<f64>,
}

impl Default for FrameSamples {
    fn default() -> Self {
        Self {
            images: Vec::new(),
            interval_seconds: FIRST_INTERVAL_SECONDS,
            next_seconds: None,
        }
    }
}

impl std::fmt::Debug for FrameSamples {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        formatter
            .debug_struct("FrameSamples")
            .field("images", &self.images.len())
            .field("interval_seconds", &self.interval_seconds)
            .finish_non_exhaustive()
    }
}

impl FrameSamples {
    /// Returns true if a frame at this time is due.
    pub(crate) fn wants(&self, time_seconds: f64) -> bool {
        self.next_seconds.is_none_or(|next| time_seconds >= next)
    }

    /// Takes the image of a frame if it is due.
    pub(crate) fn offer(&mut self, time_seconds: f64, image: Rgb8Image) {
        if !self.wants(time_seconds) {
            return;
        }
        self.images.push(image);
        if self.images.len() == MOST {
            let mut index = 0;
            self.images.retain(|_| {
                index += 1;
                index % 2 == 1
            });
            self.interval_seconds *= 2.0;
        }
        self.next_seconds = Some(time_seconds + self.interval_seconds);
    }

    /// Returns the frames in order of time.
    pub fn images(&self) -> &[Rgb8Image] {
        &self.images
    }
}
