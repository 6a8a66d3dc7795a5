//! The network of TransNetV2 (Souček and Lokoč, "TransNet V2: An effective deep network
//! architecture for fast shot transition detection", arXiv 2008.04838), inference alone.
//!
//! Three stages of two [`Block`]s, each stage with a shortcut and a 2x2 mean. Beside their output the last layer gets
//! the similarity of every frame to the 50 before and after it, by learned features and by colours.

use omnilife_networks::{Matrix, Weights, WeightsError};

use super::{block::Block, clip::Clip};

/// Frames of a window.
pub(super) const WINDOW: usize = 100;
/// The frames of a window whose scores count.
pub(super) const KEPT: std::ops::Range<usize> = 25..75;
/// Size of the images, pixels.
pub(super) const WIDTH: usize = 48;
pub(super) const HEIGHT: usize = 27;
/// Bytes of an image, RGB.
pub(super) const IMAGE_BYTES: usize = WIDTH * HEIGHT * 3;

/// Channels of one branch in the first stage; they double from stage to stage.
const FILTERS: usize = 16;
const STAGES: usize = 3;
/// Frames to which a frame is compared, itself in the middle.
const LOOKUP: usize = 101;
/// Length of similarity features and of the last hidden layer.
const SIMILARITY: usize = 128;
const HIDDEN: usize = 1024;
/// Colours: three bits per channel.
const COLOURS: usize = 512;

/// Scores of a frame in [0, 1].
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct FrameScores {
    /// Score for the middle frame of a transition.
    pub(super) middle: f32,
    /// Score for any frame of a transition.
    pub(super) any: f32,
}

/// A fully connected layer.
struct Dense {
    /// Inputs by outputs.
    matrix: Matrix,
    bias: Vec<f32>,
}

pub(super) struct Network {
    stages: Vec<[Block; 2]>,
    projection: Dense,
    similarity: Dense,
    colours: Dense,
    hidden: Dense,
    middle: Dense,
    any: Dense,
}

impl Network {
    pub(super) fn load(weights: &Weights) -> Result<Self, WeightsError> {
        let mut stages = Vec::new();
        let mut inputs = 3;
        let mut features = 0;
        for stage in 0..STAGES {
            let filters = FILTERS << stage;
            let block = |index: usize, inputs: usize| {
                let name = format!("SDDCNN.{stage}.DDCNN.{index}");
                Block::load(weights, &name, inputs, filters)
            };
            stages.push([block(0, inputs)?, block(1, 4 * filters)?]);
            inputs = 4 * filters;
            features += inputs;
        }
        let (width, height) = (WIDTH >> STAGES, HEIGHT >> STAGES);
        let flat = width * height * inputs + 2 * SIMILARITY;
        Ok(Self {
            stages,
            projection: Dense::load(weights, "frame_sim_layer.projection", features, SIMILARITY)?,
            similarity: Dense::load(weights, "frame_sim_layer.fc", LOOKUP, SIMILARITY)?,
            colours: Dense::load(weights, "color_hist_layer.fc", LOOKUP, SIMILARITY)?,
            hidden: Dense::load(weights, "fc1", flat, HIDDEN)?,
            middle: Dense::load(weights, "cls_layer1", HIDDEN, 1)?,
            any: Dense::load(weights, "cls_layer2", HIDDEN, 1)?,
        })
    }

    /// Scores of the frames [`KEPT`] of a window of [`WINDOW`] images, RGB.
    pub(super) fn scores(&self, images: &[&[u8; IMAGE_BYTES]]) -> Vec<FrameScores> {
        let mut clip = input(images);
        let mut means = Vec::new();
        for [first, second] in &self.stages {
            let shortcut = first.apply(&clip);
            let mut output = second.apply(&shortcut);
            for (value, short) in output.data.iter_mut().zip(&shortcut.data) {
                *value += short;
            }
            clip = output.halved();
            means.push((clip.channels, clip.spatial_means()));
        }
        let learned = self.projection.apply(&joined(&means));
        let learned = relu(self.similarity.apply(&similarities(unit_rows(learned))));
        let colours = relu(self.colours.apply(&similarities(colour_histograms(images))));

        let pixels = clip.height * clip.width;
        let mut flat = Matrix::zeros(KEPT.len(), 2 * SIMILARITY + pixels * clip.channels);
        let columns = flat.columns;
        for (row, frame) in flat.data.chunks_exact_mut(columns).zip(KEPT) {
            let index = frame - KEPT.start;
            row[..SIMILARITY].copy_from_slice(colours.row(index));
            row[SIMILARITY..2 * SIMILARITY].copy_from_slice(learned.row(index));
            let rest = row[2 * SIMILARITY..].chunks_exact_mut(clip.channels);
            for (values, pixel) in rest.zip(clip.data.chunks_exact(clip.pixel_len())) {
                values.copy_from_slice(&pixel[frame * clip.channels..][..clip.channels]);
            }
        }
        let hidden = relu(self.hidden.apply(&flat));
        let (middle, any) = (self.middle.apply(&hidden), self.any.apply(&hidden));
        middle
            .data
            .iter()
            .zip(&any.data)
            .map(|(&middle, &any)| FrameScores {
                middle: sigmoid(middle),
                any: sigmoid(any),
            })
            .collect()
    }
}

impl Dense {
    fn load(
        weights: &Weights,
        name: &str,
        inputs: usize,
        outputs: usize,
    ) -> Result<Self, WeightsError> {
        let stored = Matrix {
            rows: outputs,
            columns: inputs,
            data: weights.tensor(&format!("{name}.weight"), &[outputs, inputs])?,
        };
        Ok(Self {
            matrix: stored.transposed(),
            bias: weights.tensor(&format!("{name}.bias"), &[outputs])?,
        })
    }

    fn apply(&self, rows: &Matrix) -> Matrix {
        let mut product = rows.times(&self.matrix);
        for row in product.data.chunks_exact_mut(self.bias.len()) {
            for (value, bias) in row.iter_mut().zip(&self.bias) {
                *value += bias;
            }
        }
        product
    }
}

fn input(images: &[&[u8; IMAGE_BYTES]]) -> Clip {
    let mut clip = Clip::zeros(HEIGHT, WIDTH, images.len(), 3);
    let len = clip.pixel_len();
    for (at, pixel) in clip.data.chunks_exact_mut(len).enumerate() {
        for (values, image) in pixel.chunks_exact_mut(3).zip(images) {
            for (value, &byte) in values.iter_mut().zip(&image[3 * at..3 * at + 3]) {
                *value = f32::from(byte) / 255.0;
            }
        }
    }
    clip
}

/// Returns one row per frame: the stages' channels one after the other.
fn joined(stages: &[(usize, Vec<f32>)]) -> Matrix {
    let columns = stages.iter().map(|(channels, _)| channels).sum();
    let data = (0..WINDOW)
        .flat_map(|frame| {
            stages.iter().flat_map(move |(channels, means)| {
                means[frame * channels..(frame + 1) * channels]
                    .iter()
                    .copied()
            })
        })
        .collect();
    Matrix {
        rows: WINDOW,
        columns,
        data,
    }
}

fn unit_rows(mut matrix: Matrix) -> Matrix {
    for row in matrix.data.chunks_exact_mut(matrix.columns) {
        let norm = row.iter().map(|value| value * value).sum::<f32>().sqrt();
        let scale = 1.0 / norm.max(1e-12);
        row.iter_mut().for_each(|value| *value *= scale);
    }
    matrix
}

fn colour_histograms(images: &[&[u8; IMAGE_BYTES]]) -> Matrix {
    let mut histograms = Matrix::zeros(images.len(), COLOURS);
    for (bins, image) in histograms.data.chunks_exact_mut(COLOURS).zip(images) {
        for &[red, green, blue] in image.as_chunks::<3>().0 {
            let bits = |value: u8| usize::from(value >> 5);
            bins[(bits(red) << 6) + (bits(green) << 3) + bits(blue)] += 1.0;
        }
    }
    unit_rows(histograms)
}

/// Returns dot products of each frame that counts with those around it; zero outside the window.
fn similarities(frames: Matrix) -> Matrix {
    let all = frames.times(&frames.transposed());
    let mut around = Matrix::zeros(KEPT.len(), LOOKUP);
    for (row, frame) in around.data.chunks_exact_mut(LOOKUP).zip(KEPT) {
        for (offset, value) in row.iter_mut().enumerate() {
            let other = (frame + offset).checked_sub(LOOKUP / 2);
            if let Some(other) = other.filter(|&other| other < frames.rows) {
                *value = all.row(frame)[other];
            }
        }
    }
    around
}

fn relu(mut matrix: Matrix) -> Matrix {
    matrix
        .data
        .iter_mut()
        .for_each(|value| *value = value.max(0.0));
    matrix
}

fn sigmoid(value: f32) -> f32 {
    1.0 / (1.0 + (-value).exp())
}
