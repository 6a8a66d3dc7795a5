//! Shot boundaries: where one continuous take ends and the next begins.
//!
//! A detector works in two steps. Its [`SignalPass`] sees every frame of the analysis pass once and
//! leaves a row of numbers; [`Detector::decide`] turns the finished table into boundaries and can
//! be re-run on the stored table. Everything is in seconds, so that a 25 and a 60 fps copy of one
//! video give the same boundaries.
//!
//! To add a detector: one file, and one line in [`DETECTORS`].

mod descriptor;
pub mod histogram;
pub mod signals;

pub use signals::Signals;

use std::path::Path;

use omnilife_schemas::records::Boundary;

use crate::{error::CurateError, video::Rgb8Picture};

/// A way of finding boundaries.
pub struct Detector {
    /// Unique id, recorded in the boundary ledger.
    pub id: &'static str,
    /// What it looks at, in one sentence.
    pub summary: &'static str,
    /// Its settings in words, recorded with its boundaries.
    pub settings: fn() -> String,
    /// Begins a pass over a video.
    pub start: fn() -> Box<dyn SignalPass>,
    /// Boundaries in order of time from the signals of a whole video.
    pub decide: fn(&Signals) -> Vec<Boundary>,
}

/// One pass over the frames of a video.
pub trait SignalPass {
    /// Sees the next frame, about 128 pixels wide.
    ///
    /// # Errors
    /// One line when an image operation fails.
    fn observe(&mut self, time_seconds: f64, picture: &Rgb8Picture) -> Result<(), String>;

    /// The signals, one row per frame.
    fn finish(self: Box<Self>) -> Signals;
}

/// All detectors; tests walk it.
pub static DETECTORS: &[Detector] = &[histogram::DETECTOR];

/// The detector that is used where none is named.
pub const DEFAULT_DETECTOR: &str = histogram::DETECTOR.id;

/// The detector with this id. `video` is named in the error.
///
/// # Errors
/// [`CurateError::Input`] that lists the known ids.
pub fn detector(id: &str, video: &Path) -> Result<&'static Detector, CurateError> {
    DETECTORS
        .iter()
        .find(|detector| detector.id == id)
        .ok_or_else(|| {
            let known: Vec<_> = DETECTORS.iter().map(|detector| detector.id).collect();
            CurateError::input(
                video,
                format!(
                    "boundary detector {id} is not known; there is {}",
                    known.join(", ")
                ),
            )
        })
}
