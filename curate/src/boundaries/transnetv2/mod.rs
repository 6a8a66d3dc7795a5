//! TransNetV2 with its published weights, used as by its authors: images of 48x27 pixels, a threshold of 0.5, and
//! windows of 100 frames every 50. Of each window the frames 25 to 75 count.

mod block;
mod clip;
mod network;

use std::collections::VecDeque;

use omnilife_networks::{Weights, WeightsError};
use omnilife_schemas::records::{Boundary, BoundaryKind};

use self::network::{FrameScores, HEIGHT, IMAGE_BYTES, KEPT, Network, WIDTH, WINDOW};
use super::{Detector, MissingSignal, SignalPass, Signals};
use crate::{
    error::CurateError,
    video::{Rgb8Image, Scaling},
};

/// The detector.
pub const DETECTOR: Detector = Detector {
    id: "transnetv2",
    summary: "TransNetV2 with the published weights: per-frame scores of a convolutional network \
              on images of 48x27 pixels, thresholded.",
    settings: || format!("threshold {THRESHOLD}, weights {WEIGHTS_SHA256}"),
    images: Scaling::Exactly {
        width: WIDTH as u32,
        height: HEIGHT as u32,
    },
    start,
    decide,
};

/// Name of the weights; `scripts/setup --models` knows it too.
const WEIGHTS: &str = "transnetv2";
/// SHA-256 of the converted weights.
const WEIGHTS_SHA256: &str = "d4614c48e0b018913c687b285b206d74e37cf6c9257269c32940b29464a02ce6";
/// The authors' threshold on the score of the middle frame.
const THRESHOLD: f32 = 0.5;

/// Signal: score that a frame is the middle of a transition.
const MIDDLE: &str = "transnetv2_middle";
/// Signal: score that a frame belongs to a transition.
const ANY: &str = "transnetv2_any";

fn start() -> Result<Box<dyn SignalPass>, CurateError> {
    Ok(Box::new(TransNetPass {
        network: Network::load(&published_weights()?)?,
        window: VecDeque::new(),
        times: Vec::new(),
        scores: Vec::new(),
    }))
}

/// Returns the published weights, as `scripts/setup --models` leaves them.
///
/// # Errors
/// When they are missing or differ from the published ones.
pub fn published_weights() -> Result<Weights, WeightsError> {
    Weights::load_published(WEIGHTS, WEIGHTS_SHA256)
}

/// Keeps the images of one window.
struct TransNetPass {
    network: Network,
    window: VecDeque<Box<[u8; IMAGE_BYTES]>>,
    times: Vec<f64>,
    scores: Vec<FrameScores>,
}

impl SignalPass for TransNetPass {
    fn observe(&mut self, time_seconds: f64, image: &Rgb8Image) -> Result<(), String> {
        let pixels: Box<[u8; IMAGE_BYTES]> = image
            .data
            .clone()
            .into_boxed_slice()
            .try_into()
            .map_err(|_| format!("an image is not {WIDTH}x{HEIGHT} pixels"))?;
        if self.times.is_empty() {
            // The first frame stands for those before it.
            self.window
                .extend(std::iter::repeat_n(pixels.clone(), KEPT.start));
        }
        self.times.push(time_seconds);
        self.push(pixels);
        Ok(())
    }

    fn finish(mut self: Box<Self>) -> Signals {
        // The last frame stands for those after it.
        while self.scores.len() < self.times.len() {
            let Some(last) = self.window.back().cloned() else {
                break;
            };
            self.push(last);
        }
        self.scores.truncate(self.times.len());
        let column = |score: fn(&FrameScores) -> f32| self.scores.iter().map(score).collect();
        Signals {
            columns: vec![
                (MIDDLE.to_owned(), column(|scores| scores.middle)),
                (ANY.to_owned(), column(|scores| scores.any)),
            ],
            times: self.times,
        }
    }
}

impl TransNetPass {
    fn push(&mut self, pixels: Box<[u8; IMAGE_BYTES]>) {
        self.window.push_back(pixels);
        if self.window.len() == WINDOW {
            let images: Vec<_> = self.window.iter().map(AsRef::as_ref).collect();
            self.scores.extend(self.network.scores(&images));
            self.window.drain(..KEPT.len());
        }
    }
}

/// Finds transitions: runs of frames whose middle score is above the threshold, as in the authors' code. The extent is
/// that of the surrounding frames that belong to a transition. A cut is scored at the last frame of the old shot.
fn decide(signals: &Signals) -> Result<Vec<Boundary>, MissingSignal> {
    let (middle, any) = (signals.column(MIDDLE)?, signals.column(ANY)?);
    let mut boundaries = Vec::new();
    let mut next = 0;
    while let Some(first) = (next..middle.len()).find(|&frame| middle[frame] > THRESHOLD) {
        let belongs = |&frame: &usize| middle[frame] > THRESHOLD || any[frame] > THRESHOLD;
        let begin = (next..first)
            .rev()
            .take_while(belongs)
            .last()
            .unwrap_or(first);
        let end = (first..middle.len())
            .take_while(belongs)
            .last()
            .unwrap_or(first);
        next = end + 1;
        let Some(&end_seconds) = signals.times.get(next) else {
            // Nothing comes after it: the video ends in its transition.
            break;
        };
        let score = middle[begin..next].iter().copied().fold(0.0, f32::max);
        boundaries.push(Boundary {
            begin_seconds: signals.times[begin],
            end_seconds,
            kind: if begin == end {
                BoundaryKind::Cut
            } else {
                BoundaryKind::Gradual
            },
            score: f64::from(score),
        });
    }
    Ok(boundaries)
}
