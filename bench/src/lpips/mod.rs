//! LPIPS: perceptual difference of two images in the features of a recognition network (Zhang, Isola, Efros, Shechtman
//! and Wang, "The unreasonable effectiveness of deep features as a perceptual metric", 2018; version 0.1 of the linear
//! layers).
//!
//! Both images go through a backbone. After each of its five stages the features of every pixel are scaled to unit
//! length, their squared differences weighted by channel and averaged over the image. The distance is the sum over the
//! stages.
//!
//! Convolutions are in f32 and round differently on processors with other vector instructions: between machines the
//! sixth decimal may differ. On one machine a distance does not depend on the number of threads.

mod backbone;
mod distance;

use std::sync::OnceLock;

use omnilife_networks::{Features, WeightsError};

pub use backbone::Backbone;
use backbone::Stage;

/// Input range of a network for bytes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum InputRange {
    /// [-1, 1], for which the constants of the network are made: `lpips` by its authors.
    Signed,
    /// [0, 1], as the codes of 3DGS and ODGS pass their images (3DGS issue 1239).
    Unsigned,
}

/// Features of an image in all stages of a network.
#[derive(Debug, Clone)]
pub struct ImageFeatures {
    stages: Vec<Features>,
}

/// Mean and deviation of red, green and blue in [-1, 1] over the images that the backbones were
/// trained with (`ScalingLayer` of the authors' code).
const SHIFT: [f32; 3] = [-0.030, -0.088, -0.188];
const SCALE: [f32; 3] = [0.458, 0.448, 0.450];

/// Rows of a stage that are processed together, if the stage keeps the size of its input. A multiple of the tiles of
/// the convolutions and of the windows of the pooling.
const STRIP: usize = 64;
/// Rows above and below a strip that its convolutions need: one for each, rounded up to whole tiles.
const HALO: usize = 4;

/// A backbone with its linear layers.
#[derive(Debug)]
pub struct Lpips {
    backbone: Backbone,
    stages: Vec<Stage>,
}

impl Lpips {
    /// Returns the network with its published weights, read once per process.
    ///
    /// # Errors
    /// When the weights were not fetched or differ from the published ones.
    pub fn published(backbone: Backbone) -> Result<&'static Self, WeightsError> {
        static LOADED: [OnceLock<Lpips>; 2] = [const { OnceLock::new() }; 2];
        let slot = &LOADED[backbone as usize];
        if let Some(network) = slot.get() {
            return Ok(network);
        }
        let weights = backbone.published_weights()?;
        let network = Self {
            backbone,
            stages: backbone.stages(&weights)?,
        };
        Ok(slot.get_or_init(|| network))
    }

    /// Returns the distance of two 8-bit RGB images, 0 for equal ones; `None` if they are smaller than
    /// [`Backbone::smallest_side`].
    ///
    /// # Panics
    /// When an image does not hold `width * height * 3` bytes.
    pub fn distance(
        &self,
        [width, height]: [usize; 2],
        images: [&[u8]; 2],
        range: InputRange,
    ) -> Option<f64> {
        if width.min(height) < self.backbone.smallest_side() {
            return None;
        }
        let mut features = input([width, height], &images, range);
        let mut pooled = Features::zeros(0, 0, 0, 0);
        let mut buffers = [pooled.clone(), pooled.clone()];
        let mut sum = 0.0;
        for (stage, next) in self.stages.iter().zip(1..) {
            // Windows of one pixel are the pixels themselves.
            let pooling = self.backbone.pooling(next).unwrap_or([1, 1]);
            sum += apply(stage, &features, pooling, &mut buffers, &mut pooled);
            std::mem::swap(&mut features, &mut pooled);
        }
        Some(sum)
    }

    /// Returns the features of an 8-bit RGB image, all stages at once: for images that are compared with several
    /// others. `None` if it is smaller than [`Backbone::smallest_side`].
    ///
    /// # Panics
    /// When the image does not hold `width * height * 3` bytes.
    pub fn features(
        &self,
        [width, height]: [usize; 2],
        image: &[u8],
        range: InputRange,
    ) -> Option<ImageFeatures> {
        if width.min(height) < self.backbone.smallest_side() {
            return None;
        }
        let mut source = input([width, height], &[image], range);
        let mut stages = Vec::new();
        for (stage, next) in self.stages.iter().zip(1..) {
            for convolution in &stage.convolutions {
                source = convolution.apply_rectified(&source);
            }
            let pooled = self.backbone.pooling(next);
            let pooled = pooled.map(|[side, stride]| source.max_pool(side, stride));
            stages.push(source.clone());
            source = pooled.unwrap_or(source);
        }
        Some(ImageFeatures { stages })
    }

    /// Returns [`Self::distance`] of two images of one size, to the last bit, from their features.
    ///
    /// # Panics
    /// When the features belong to images of two sizes.
    pub fn distance_of_features(&self, images: [&ImageFeatures; 2]) -> f64 {
        let [left, right] = images.map(|image| image.stages.iter());
        let stages = self.stages.iter().zip(left.zip(right));
        let distances = stages.map(|(stage, (left, right))| {
            let strip = if stage.keeps_size() {
                STRIP
            } else {
                left.height
            };
            let strips = (0..left.height).step_by(strip).map(|top| {
                let rows = top..(top + strip).min(left.height);
                let images = [left.data.as_slice(), &right.data];
                distance::weighted(images, left.row_len(), rows, &stage.linear)
            });
            strips.sum::<f64>() / (left.height * left.width) as f64
        });
        distances.sum()
    }

    /// Returns the approximate memory of an image's features, bytes.
    pub fn features_bytes(&self, [width, height]: [usize; 2]) -> usize {
        let bytes_per_pixel = match self.backbone {
            // Channels of the stages over the pixels of the image for each of theirs.
            Backbone::Alex => 4 * (64 / 16 + 192 / 64 + (384 + 256 + 256) / 256 + 1),
            Backbone::Vgg => 4 * (64 + 128 / 4 + 256 / 16 + 512 / 64 + 512 / 256),
        };
        width * height * bytes_per_pixel
    }

    /// Returns the approximate memory of a distance computation, bytes.
    pub fn memory_bytes(&self, [width, height]: [usize; 2]) -> usize {
        let pixels = width * height;
        match self.backbone {
            // Colours, stage one at a quarter of the rows and columns, its pooled features.
            Backbone::Alex => pixels * (24 + 60),
            // Colours, pooled features of two stages, and buffers of a strip.
            Backbone::Vgg => pixels * (24 + 128 + 64) + (STRIP + 2 * HALO) * width * 64 * 4 * 5,
        }
    }
}

/// Images as the backbones expect their colours.
fn input([width, height]: [usize; 2], images: &[&[u8]], range: InputRange) -> Features {
    let mut features = Features::zeros(images.len(), height, width, 3);
    let image_len = features.image_len();
    let (gain, offset) = match range {
        InputRange::Signed => (2.0, -1.0),
        InputRange::Unsigned => (1.0, 0.0),
    };
    for (values, bytes) in features.data.chunks_exact_mut(image_len).zip(images) {
        assert_eq!(bytes.len(), image_len, "bytes of an image");
        for (index, (value, &byte)) in values.iter_mut().zip(*bytes).enumerate() {
            let signed = gain * (f32::from(byte) / 255.0) + offset;
            *value = (signed - SHIFT[index % 3]) / SCALE[index % 3];
        }
    }
    features
}

/// Returns a stage's distance, and its output pooled for the next stage into `pooled`.
///
/// Stages that keep the size of their input are processed in strips of rows, so that only the pooled features take
/// memory.
fn apply(
    stage: &Stage,
    input: &Features,
    pooling: [usize; 2],
    [features, next]: &mut [Features; 2],
    pooled: &mut Features,
) -> f64 {
    let strip = if stage.keeps_size() {
        STRIP
    } else {
        input.height
    };
    let mut distance = 0.0;
    let mut pixels = 0;
    for top in (0..input.height).step_by(strip) {
        let bottom = (top + strip).min(input.height);
        let begin = top.saturating_sub(HALO);
        let mut source = &input.rows(begin..(bottom + HALO).min(input.height));
        for convolution in &stage.convolutions {
            convolution.apply_rectified_into(source, next);
            std::mem::swap(features, next);
            source = features;
        }
        let rows = if stage.keeps_size() {
            top - begin..bottom - begin
        } else {
            0..features.height
        };
        let images = [0, 1].map(|image| features.image(image));
        let row_len = features.row_len();
        distance += distance::weighted(images, row_len, rows.clone(), &stage.linear);
        pixels += rows.len() * features.width;
        if top == 0 {
            // Without strips the height of the stage is known now.
            let height = if stage.keeps_size() {
                input.height
            } else {
                features.height
            };
            let [side, stride] = pooling;
            let length = |length: usize| (length - side) / stride + 1;
            let (height, width) = (length(height), length(features.width));
            pooled.reshape(features.images, height, width, features.channels);
        }
        features.max_pool_rows(rows, pooling, pooled, top / pooling[1]);
    }
    distance / pixels as f64
}
