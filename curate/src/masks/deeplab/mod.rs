//! Masks by class: people, animals and vehicles, found by DeepLabV3 in overlapping views of a frame.
//!
//! A parked car is marked like a driving one. Moving content outside the classes, such as shadows and reflections, is
//! not.

mod crops;
pub mod network;

use std::{collections::BTreeMap, path::Path};

use glam::DVec2;
use omnilife_networks::{Matrix, Weights, WeightsError};
use omnilife_schemas::{
    RgbImage, image_file::ImageFile, progress::Progress, records::Sequence, rgb::Mask,
    store::StoreError,
};
use rayon::prelude::*;

use self::{
    crops::{Pixel, View},
    network::{CLASSES, Network, SCORE_SIDE, SIDE},
};
use super::{FrameMasks, MaskMethod};
use crate::error::CurateError;

/// The method.
pub const METHOD: MaskMethod = MaskMethod {
    id: "deeplab",
    about: "people, animals and vehicles, by a segmentation network (scripts/setup --models)",
    settings,
    find,
};

/// Name of the weights; `scripts/setup --models` knows it too.
const WEIGHTS: &str = "deeplab";
/// SHA-256 of the converted weights.
const WEIGHTS_SHA256: &str = "78bd5c9301dec8055023a3a9f89ad45572d67e274f83421018c15b1dd29dc3fe";
/// Number of kinds of movable content.
pub(super) const KINDS: usize = 3;
/// Kind of people.
pub(super) const PERSON: usize = 0;
/// Name of each kind, and its classes of Pascal VOC. Vehicles: aeroplane, bicycle, boat, bus, car, motorbike, train.
/// Animals: bird, cat, cow, dog, horse, sheep.
const CLASSES_OF_KINDS: [(&str, &[usize]); KINDS] = [
    ("person", &[15]),
    ("vehicle", &[1, 2, 4, 6, 7, 14, 19]),
    ("animal", &[3, 8, 10, 12, 13, 17]),
];
/// Probability of all kinds together from which on a pixel is marked.
pub(super) const PROBABILITY: f32 = 0.5;

fn settings() -> String {
    format!(
        "probability {PROBABILITY} in 8 views of 103 degrees, or in squares of a perspective frame, weights \
         {WEIGHTS_SHA256}"
    )
}

fn find(
    folder: &Path,
    sequence: &Sequence,
    progress: &dyn Progress,
) -> Result<Vec<FrameMasks>, CurateError> {
    let network = Network::load(&published_weights()?)?;
    let (entries, views) = (&sequence.frames.entries, Views::of(sequence));
    progress.begin("segmenting", Some(entries.len() as u64));
    let masks = entries
        .iter()
        .map(|entry| {
            let frame = views.read(&folder.join(&entry.file))?;
            let size = views.size;
            let likelihoods = views.likelihoods(&views.all(), &network, &frame, size);
            progress.advance(1);
            Ok(likelihoods.masks(PROBABILITY))
        })
        .collect();
    progress.end();
    masks
}

/// Returns the published weights, as `scripts/setup --models` leaves them.
///
/// # Errors
/// When they are missing or differ from the published ones.
pub fn published_weights() -> Result<Weights, WeightsError> {
    Weights::load_published(WEIGHTS, WEIGHTS_SHA256)
}

/// Marks movable content in a panorama.
pub fn movable(network: &Network, panorama: &RgbImage) -> Mask {
    let size = [panorama.width, panorama.height];
    let views = Views::new(false, size);
    let likelihoods = views.likelihoods(&views.all(), network, panorama, size);
    likelihoods.masks(PROBABILITY).moving
}

/// Views of the frames of a sequence that the network looks at.
#[derive(Debug)]
pub(super) struct Views {
    /// Width and height of the frames.
    size: [usize; 2],
    views: Vec<View>,
    /// Places in the frames of the pixels of each view.
    places: Vec<Vec<DVec2>>,
}

impl Views {
    /// Returns those that cover panoramas, or perspective frames, of a size (width, height).
    pub(super) fn new(is_perspective: bool, size: [usize; 2]) -> Self {
        let views = View::all(is_perspective, size);
        Self {
            size,
            places: (views.par_iter())
                .map(|view| view.places(size, SIDE))
                .collect(),
            views,
        }
    }

    /// Returns those of a sequence.
    pub(super) fn of(sequence: &Sequence) -> Self {
        let frames = &sequence.frames;
        let size = [frames.width as usize, frames.height as usize];
        Self::new(sequence.is_pinhole(), size)
    }

    /// Returns the numbers of those that show at least so many steradians, or so large a share of a perspective frame, of
    /// what a mask marks.
    pub(super) fn showing(
        &self,
        mask: &Mask,
        least: f64,
        area: impl Fn(usize) -> f64,
    ) -> Vec<usize> {
        let mut shown = vec![0.0; self.views.len()];
        for at in (0..mask.data.len()).filter(|&at| mask.data[at] != 0) {
            let (column, row) = (at % mask.width, at / mask.width);
            let pixel = Pixel::new([column, row], [mask.width, mask.height]);
            for (view, shown) in self.views.iter().zip(&mut shown) {
                if view.place_of(&pixel).is_some() {
                    *shown += area(row);
                }
            }
        }
        (0..shown.len()).filter(|&at| shown[at] >= least).collect()
    }

    /// Reads a frame of the sequence.
    ///
    /// # Errors
    /// When it is damaged, or has another size than the sequence states.
    pub(super) fn read(&self, file: &Path) -> Result<RgbImage, StoreError> {
        RgbImage::decode(ImageFile::open(file)?.expect_size(self.size)?)
    }

    /// Returns the numbers of all.
    pub(super) fn all(&self) -> Vec<usize> {
        (0..self.views.len()).collect()
    }

    /// Returns the likelihoods of all kinds for the pixels of a frame at a size (width, height), as some of the views show
    /// it. Views overlap, and count by how far from their edge a pixel is.
    ///
    /// # Panics
    /// When the frame has another size than the others of its sequence.
    pub(super) fn likelihoods(
        &self,
        chosen: &[usize],
        network: &Network,
        frame: &RgbImage,
        [width, height]: [usize; 2],
    ) -> Likelihoods {
        assert_eq!([frame.width, frame.height], self.size, "size of a frame");
        // Squares are places in the frame as it is.
        let scale = [
            frame.width as f64 / width as f64,
            frame.height as f64 / height as f64,
        ];
        let in_frame = |at: usize, axis: usize| ((at as f64 + 0.5) * scale[axis]) as usize;
        let found: Vec<(View, Vec<[f32; KINDS]>)> = (chosen.par_iter())
            .map(|&number| {
                let view = self.views[number];
                let image = view.image(frame, &self.places[number]);
                (view, of_kinds(&network.scores(&image)))
            })
            .collect();
        let of_pixel = |at: usize| {
            let place = [in_frame(at % width, 0), in_frame(at / width, 1)];
            let pixel = Pixel::new(place, self.size);
            let (mut sums, mut total) = ([0.0; KINDS], 0.0);
            for (view, found) in &found {
                if let Some(place) = view.place_of(&pixel) {
                    let weight = crops::weight(place) as f32 + 1e-6;
                    let values = interpolated(found, place);
                    (sums.iter_mut().zip(values)).for_each(|(sum, value)| *sum += weight * value);
                    total += weight;
                }
            }
            if total > 0.0 {
                sums.map(|sum| sum / total)
            } else {
                sums
            }
        };
        Likelihoods {
            width,
            height,
            of_kinds: (0..width * height).into_par_iter().map(of_pixel).collect(),
        }
    }
}

/// Likelihoods of the kinds of movable content.
#[derive(Debug, Clone)]
pub(super) struct Likelihoods {
    pub(super) width: usize,
    pub(super) height: usize,
    /// For each pixel, row by row; 0 where no view looked.
    pub(super) of_kinds: Vec<[f32; KINDS]>,
}

impl Likelihoods {
    /// Marks the pixels at which all kinds together are at least so likely; each belongs to its likeliest kind.
    pub(super) fn masks(&self, least: f32) -> FrameMasks {
        let kind = |values: &[f32; KINDS]| {
            let is_movable = values.iter().sum::<f32>() >= least;
            is_movable.then(|| likeliest(values))
        };
        let kinds: Vec<Option<usize>> = self.of_kinds.iter().map(kind).collect();
        self.masks_of(&kinds)
    }

    /// Makes masks of the kind of every pixel.
    pub(super) fn masks_of(&self, kinds: &[Option<usize>]) -> FrameMasks {
        let mask = |is_marked: &dyn Fn(Option<usize>) -> bool| Mask {
            width: self.width,
            height: self.height,
            data: kinds
                .iter()
                .map(|&kind| 255 * u8::from(is_marked(kind)))
                .collect(),
        };
        let classes = CLASSES_OF_KINDS.iter().enumerate();
        let classes: BTreeMap<&'static str, Mask> = classes
            .map(|(kind, (name, _))| (*name, mask(&|found| found == Some(kind))))
            .collect();
        FrameMasks {
            moving: mask(&|found| found.is_some()),
            classes,
        }
    }
}

/// Returns the kind with the largest value.
pub(super) fn likeliest(values: &[f32; KINDS]) -> usize {
    let best = (0..KINDS).max_by(|&a, &b| values[a].total_cmp(&values[b]));
    best.unwrap_or(0)
}

/// Returns the probabilities of the kinds, per place of the scores.
fn of_kinds(scores: &Matrix) -> Vec<[f32; KINDS]> {
    scores
        .data
        .chunks_exact(CLASSES)
        .map(|scores| {
            let largest = scores.iter().copied().fold(f32::NEG_INFINITY, f32::max);
            let powers: Vec<f32> = scores.iter().map(|score| (score - largest).exp()).collect();
            let all = powers.iter().sum::<f32>();
            CLASSES_OF_KINDS
                .map(|(_, classes)| classes.iter().map(|&class| powers[class]).sum::<f32>() / all)
        })
        .collect()
}

/// Interpolates bilinearly on the scores' grid, whose corners are the corners of the view.
fn interpolated(values: &[[f32; KINDS]], place: [f64; 2]) -> [f32; KINDS] {
    let [x, y] = place.map(|at| at * (SCORE_SIDE - 1) as f64);
    let [column, row] = [x, y].map(|at| (at as usize).min(SCORE_SIDE - 2));
    let share = [x - column as f64, y - row as f64].map(|share| share as f32);
    std::array::from_fn(|kind| {
        let at = |dx: usize, dy: usize| values[(row + dy) * SCORE_SIDE + column + dx][kind];
        let upper = at(0, 0) + (at(1, 0) - at(0, 0)) * share[0];
        let lower = at(0, 1) + (at(1, 1) - at(0, 1)) * share[0];
        upper + (lower - upper) * share[1]
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pixels_belong_to_their_likeliest_kind_if_all_together_are_likely() {
        let likelihoods = Likelihoods {
            width: 2,
            height: 2,
            of_kinds: vec![
                [0.3, 0.25, 0.0],
                [0.3, 0.1, 0.0],
                [0.0, 0.1, 0.8],
                [0.0; KINDS],
            ],
        };
        let masks = likelihoods.masks(0.5);
        assert_eq!(masks.moving.data, [255, 0, 255, 0]);
        assert_eq!(masks.classes["person"].data, [255, 0, 0, 0]);
        assert_eq!(masks.classes["animal"].data, [0, 0, 255, 0]);
        assert!(!masks.classes["vehicle"].marks_anything());
    }

    #[test]
    fn views_are_looked_at_where_something_is_marked() {
        let (width, height) = (64, 32);
        let mut mask = Mask::new(width, height, vec![0; width * height]);
        let views = Views::new(false, [width, height]);
        let count = |mask: &Mask| views.showing(mask, 0.5, |_| 1.0).len();
        assert_eq!(count(&mask), 0);
        mask.data[height / 2 * width + width / 2] = 255;
        let shown = count(&mask);
        assert!((1..8).contains(&shown), "{shown}");
        mask.data.fill(255);
        assert_eq!(count(&mask), 8);
    }

    #[test]
    fn a_frame_of_another_size_is_refused() -> Result<(), Box<dyn std::error::Error>> {
        let folder = tempfile::tempdir()?;
        let file = folder.path().join("frame.png");
        RgbImage::black(32, 16).write_png(&file)?;
        assert!(Views::new(false, [32, 16]).read(&file).is_ok());
        let refusal = Views::new(false, [64, 32]).read(&file).err();
        assert!(refusal.is_some_and(|refusal| refusal.to_string().contains("64x32")));
        Ok(())
    }
}
