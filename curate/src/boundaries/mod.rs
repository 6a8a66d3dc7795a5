//! Shot boundaries: the ends of continuous takes.
//!
//! A detector works in two steps. Its [`SignalPass`] sees every frame of the analysis pass once and
//! leaves a row of numbers; [`Detector::decide`] turns the finished table into boundaries and can
//! be re-run on the stored table. Everything is in seconds, so that a 25 and a 60 fps copy of one
//! video give the same boundaries.
//!
//! To add a detector: one file, and one line in [`DETECTORS`]. Its columns of the table have names of their own: by them
//! [`detected`] finds the detector of a stored table.

mod descriptor;
pub mod histogram;
pub mod indoor_outdoor;
pub mod signals;
pub mod transnetv2;

pub use signals::{MissingSignal, Signals};

use std::path::Path;

use omnilife_schemas::{names, records::Boundary, store};
use omnilife_video::{Rgb8Image, Scaling};

use crate::error::CurateError;

/// A boundary detector.
pub struct Detector {
    /// Unique id, recorded in the boundary ledger.
    pub id: &'static str,
    /// Its principle, in one sentence.
    pub summary: &'static str,
    /// Its settings in words, recorded with its boundaries and part of the cache key of stages.
    pub settings: fn() -> String,
    /// Scaling of its input images.
    pub images: Scaling,
    /// Starts a pass over a video. Fails if a requirement of the detector is missing.
    pub start: fn() -> Result<Box<dyn SignalPass>, CurateError>,
    /// Boundaries in order of time from the signals of a whole video.
    pub decide: fn(&Signals) -> Result<Vec<Boundary>, MissingSignal>,
}

impl Detector {
    /// Returns the detector and its settings in one line.
    pub fn description(&self) -> String {
        format!("{}: {}", self.id, (self.settings)())
    }

    /// Returns the detector as an author: its id and the first digits of the SHA-256 of its settings, which change with
    /// them. `boundaries.json` has the settings in words.
    pub fn author_name(&self) -> String {
        let hash = store::sha256_bytes((self.settings)().as_bytes());
        format!("{}@{}", self.id, &hash[..8])
    }
}

/// One pass over the frames of a video.
pub trait SignalPass {
    /// Sees the next frame, scaled as [`Detector::images`] says.
    ///
    /// # Errors
    /// One line when an image operation fails.
    fn observe(&mut self, time_seconds: f64, image: &Rgb8Image) -> Result<(), String>;

    /// Returns the signals, one row per frame.
    fn finish(self: Box<Self>) -> Signals;
}

/// All detectors; tests walk it.
pub static DETECTORS: &[Detector] = &[
    histogram::DETECTOR,
    transnetv2::DETECTOR,
    indoor_outdoor::DETECTOR,
];

/// The default detector.
pub const DEFAULT_DETECTOR: &str = histogram::DETECTOR.id;

/// Returns the detector that left a table of signals, with its boundaries.
pub fn detected(signals: &Signals) -> Option<(&'static Detector, Vec<Boundary>)> {
    detected_by(DETECTORS, signals)
}

/// Returns that of these detectors, as [`detected`] does of all.
fn detected_by<'d>(
    detectors: &'d [Detector],
    signals: &Signals,
) -> Option<(&'d Detector, Vec<Boundary>)> {
    let boundaries = |detector: &Detector| (detector.decide)(signals).ok();
    detectors
        .iter()
        .find_map(|detector| Some((detector, boundaries(detector)?)))
}

/// Returns the detector with this id. `video` is named in the error.
///
/// # Errors
/// [`CurateError::Input`] that lists the known ids.
pub fn detector(id: &str, video: &Path) -> Result<&'static Detector, CurateError> {
    names::find("boundary detector", id, DETECTORS, |detector| detector.id)
        .map_err(|unknown| CurateError::input(video, unknown.to_string()))
}

#[cfg(test)]
mod tests {
    use omnilife_schemas::records::BoundaryKind;

    use super::*;

    const BRIGHTNESS: &str = "toy_brightness";

    /// A cut wherever the first pixel becomes bright.
    const TOY: Detector = Detector {
        id: "toy",
        summary: "The first pixel becomes bright.",
        settings: || "bright above 128".to_owned(),
        images: Scaling::MaxWidth(1),
        start: || Ok(Box::new(ToyPass::default())),
        decide: |signals| {
            let values = signals.column(BRIGHTNESS)?;
            let pairs = values.windows(2).zip(signals.times.windows(2));
            let cuts = pairs.filter(|(values, _)| values[0] <= 128.0 && values[1] > 128.0);
            let cut = |times: &[f64]| Boundary {
                begin_seconds: times[0],
                end_seconds: times[1],
                kind: BoundaryKind::Cut,
                score: 1.0,
            };
            Ok(cuts.map(|(_, times)| cut(times)).collect())
        },
    };

    #[derive(Default)]
    struct ToyPass {
        times: Vec<f64>,
        values: Vec<f32>,
    }

    impl SignalPass for ToyPass {
        fn observe(&mut self, time_seconds: f64, image: &Rgb8Image) -> Result<(), String> {
            self.times.push(time_seconds);
            self.values.push(f32::from(image.data[0]));
            Ok(())
        }

        fn finish(self: Box<Self>) -> Signals {
            Signals {
                times: self.times,
                columns: vec![(BRIGHTNESS.to_owned(), self.values)],
            }
        }
    }

    #[test]
    fn a_detector_is_a_row_and_a_pass() {
        let mut pass = (TOY.start)().expect("it needs nothing");
        for (frame, value) in [10, 20, 200, 210].into_iter().enumerate() {
            let image = Rgb8Image::new(1, 1, vec![value; 3]);
            pass.observe(frame as f64, &image).expect("seen");
        }
        let signals = pass.finish();
        assert!(detected(&signals).is_none());
        let all = [histogram::DETECTOR, TOY];
        let (detector, boundaries) = detected_by(&all, &signals).expect("its own table");
        assert_eq!(detector.id, TOY.id);
        let places = boundaries
            .iter()
            .map(|one| [one.begin_seconds, one.end_seconds]);
        assert_eq!(places.collect::<Vec<_>>(), [[1.0, 2.0]]);
    }
}
