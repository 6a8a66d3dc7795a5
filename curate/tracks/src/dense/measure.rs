//! Depths of a scene's views: choice of neighbours, sweep, and mutual confirmation.

use std::path::Path;

use glam::DVec3;
use omnilife_schemas::{
    RgbImage,
    camera::{Camera, PinholeCamera},
    object_regions::Region,
    posed_view::PosedView,
    progress::Progress,
    records::Scene,
    rgb::Mask,
    statistics,
};
use rayon::prelude::*;

use super::{
    consistency::{DepthMap, confirmed},
    neighbours::{Neighbours, neighbours},
    sweep::{self, GreyImage, Hypotheses, SweptView},
};
use crate::error::TracksError;

/// Least number of points seen by a view for them to limit its search.
pub(super) const LEAST_SEEN: usize = 50;
/// Quantiles of the depths of a view's points that limit its search, with factors beyond.
const RANGE: [(f64, f64); 2] = [(0.99, 1.25), (0.01, 0.8)];
/// Near limit of the search in a scene without points, in distances between the cameras; the far limit is infinity.
const NEAREST_BASELINES: f64 = 1.25;
/// Every this many pixels of a first search give one point.
const FIRST_STRIDE: usize = 7;

/// Depth measurement of a scene.
pub(super) struct Stereo<'a> {
    pub(super) folder: &'a Path,
    pub(super) scene: &'a Scene,
    pub(super) views: Vec<PosedView>,
    /// Points of approximate scene depth, world.
    pub(super) points: Vec<DVec3>,
}

/// The camera at the size of the search.
pub(super) struct SizedCamera {
    camera: PinholeCamera,
    pixels: [usize; 2],
}

/// The depths of a view, with their confidence.
pub(super) struct MeasuredDepths {
    pub(super) map: DepthMap,
    /// Share of the compared views that confirm each pixel; 0 if unknown.
    pub(super) confidence: Vec<f32>,
    pub(super) colours: Vec<u8>,
    pub(super) compared_with: Vec<usize>,
    witnesses: Vec<usize>,
    pub(super) inverse_depths: [f64; 2],
    pub(super) hypotheses: usize,
}

impl Stereo<'_> {
    pub(super) fn sized(&self, camera: PinholeCamera, width: u32) -> SizedCamera {
        let width = width.clamp(1, camera.width.max(1));
        let rows = f64::from(width) * f64::from(camera.height) / f64::from(camera.width);
        let height = (rows.round() as u32).max(1);
        let camera = match Camera::from(camera).resized(width, height) {
            Camera::Pinhole(camera) => camera,
            Camera::Erp(_) => camera,
        };
        SizedCamera {
            camera,
            pixels: [width as usize, height as usize],
        }
    }

    /// Returns approximate points of a scene without any: every frame against the ones around it, from infinity to a
    /// little beyond the distance between them.
    pub(super) fn first_points(
        &self,
        sized: &SizedCamera,
        progress: &dyn Progress,
    ) -> Result<Option<Vec<DVec3>>, TracksError> {
        let count = self.views.len();
        let around = |index: usize| -> Vec<usize> {
            let near = index.saturating_sub(2)..(index + 3).min(count);
            near.filter(|&other| other != index).collect()
        };
        let chosen: Vec<(Neighbours, [f64; 2])> = (0..count)
            .map(|index| {
                let others = around(index);
                let farthest = others
                    .iter()
                    .map(|&other| self.views[other].centre.distance(self.views[index].centre))
                    .fold(0.0, f64::max);
                if farthest <= 0.0 {
                    return (Neighbours::default(), [0.0; 2]);
                }
                let neighbours = Neighbours {
                    witnesses: others.clone(),
                    compared: others,
                };
                (neighbours, [0.0, 1.0 / (NEAREST_BASELINES * farthest)])
            })
            .collect();
        let measured = self.measure_against(sized, chosen, progress)?;
        let points: Vec<DVec3> = measured
            .iter()
            .flat_map(|view| {
                let known = (0..view.confidence.len()).step_by(FIRST_STRIDE);
                known
                    .filter(|&pixel| view.confidence[pixel] > 0.0)
                    .map(|pixel| view.map.point(pixel))
            })
            .collect();
        Ok((points.len() >= LEAST_SEEN).then_some(points))
    }

    /// Measures the depths of all views; `None` if no two can be compared.
    pub(super) fn measure(
        &self,
        sized: &SizedCamera,
        progress: &dyn Progress,
    ) -> Result<Option<Vec<MeasuredDepths>>, TracksError> {
        let chosen: Vec<(Neighbours, [f64; 2])> = (0..self.views.len())
            .into_par_iter()
            .map(|index| self.choose(index))
            .collect();
        if chosen.iter().all(|(others, _)| others.compared.is_empty()) {
            return Ok(None);
        }
        Ok(Some(self.measure_against(sized, chosen, progress)?))
    }

    /// Returns the neighbours of a view and the limits of its inverse depths.
    fn choose(&self, index: usize) -> (Neighbours, [f64; 2]) {
        let view = &self.views[index];
        let seen: Vec<DVec3> = self
            .points
            .iter()
            .copied()
            .filter(|&point| view.pixel(point).is_some())
            .collect();
        if seen.len() < LEAST_SEEN {
            return (Neighbours::default(), [0.0; 2]);
        }
        let depths: Vec<f64> = seen.iter().map(|&point| view.in_camera(point).z).collect();
        let range = RANGE.map(|(share, factor)| {
            1.0 / (factor * statistics::quantile(&depths, share).unwrap_or(f64::INFINITY))
        });
        (neighbours(index, &self.views, &seen), range)
    }

    /// Returns the depths of all views against chosen others.
    fn measure_against(
        &self,
        sized: &SizedCamera,
        chosen: Vec<(Neighbours, [f64; 2])>,
        progress: &dyn Progress,
    ) -> Result<Vec<MeasuredDepths>, TracksError> {
        let images = self.read_images(sized)?;
        progress.begin("dense stereo", Some(chosen.len() as u64));
        let mut measured: Vec<MeasuredDepths> = Vec::with_capacity(chosen.len());
        for (index, (neighbours, inverse_depths)) in chosen.into_iter().enumerate() {
            measured.push(self.swept(index, neighbours, inverse_depths, &images, sized));
            progress.advance(1);
        }
        progress.end();
        let confidences: Vec<Vec<f32>> = measured
            .iter()
            .map(|view| {
                let witnesses = view.witnesses.iter();
                let others: Vec<&DepthMap> = witnesses.map(|&one| &measured[one].map).collect();
                self.unmasked(view, confirmed(&view.map, &others), sized)
            })
            .collect::<Result<_, _>>()?;
        for (view, confidence) in measured.iter_mut().zip(confidences) {
            view.confidence = confidence;
        }
        Ok(measured)
    }

    /// Returns the images of all views at the size of the search, 8-bit RGB.
    fn read_images(&self, sized: &SizedCamera) -> Result<Vec<Vec<u8>>, TracksError> {
        let [width, height] = sized.pixels;
        let read = |view: &PosedView| {
            let entry = &self.scene.frames[view.frame as usize];
            let file = self.folder.join(&entry.image);
            let image = RgbImage::read(&file)?;
            if [image.width, image.height] != self.scene.camera.size() {
                let reason = format!(
                    "is {}x{} pixels, the scene's camera has another size",
                    image.width, image.height
                );
                return Err(TracksError::input(&file, reason));
            }
            Ok(image.resized_by_area(width, height).to_rgb8())
        };
        self.views.par_iter().map(read).collect()
    }

    /// Returns the depths of one view, not yet confirmed by others.
    fn swept(
        &self,
        index: usize,
        neighbours: Neighbours,
        inverse_depths: [f64; 2],
        images: &[Vec<u8>],
        sized: &SizedCamera,
    ) -> MeasuredDepths {
        let [width, height] = sized.pixels;
        let numbers: Vec<usize> = std::iter::once(index)
            .chain(neighbours.compared.iter().copied())
            .collect();
        let grey: Vec<GreyImage> = numbers
            .iter()
            .map(|&number| GreyImage::of_rgb8(width, height, &images[number]))
            .collect();
        let views: Vec<SweptView<'_>> = numbers
            .iter()
            .zip(&grey)
            .map(|(&number, image)| SweptView {
                camera: sized.camera,
                to_world: self.views[number].to_world,
                centre: self.views[number].centre,
                image,
            })
            .collect();
        let (this, others) = (&views[0], &views[1..]);
        let (depths, hypotheses) = if others.is_empty() {
            (vec![f32::INFINITY; width * height], 0)
        } else {
            let hypotheses = Hypotheses::new(inverse_depths, this, others);
            (sweep::depths(this, others, &hypotheses), hypotheses.count)
        };
        MeasuredDepths {
            map: DepthMap {
                camera: sized.camera,
                view: self.views[index],
                depths,
            },
            confidence: Vec::new(),
            colours: images[index].clone(),
            compared_with: neighbours.compared,
            witnesses: neighbours.witnesses,
            inverse_depths,
            hypotheses,
        }
    }

    /// Depths under masks are unknown.
    fn unmasked(
        &self,
        view: &MeasuredDepths,
        mut confidence: Vec<f32>,
        sized: &SizedCamera,
    ) -> Result<Vec<f32>, TracksError> {
        let frame = &self.scene.frames[view.map.view.frame as usize];
        let [width, height] = sized.pixels;
        let read = |file: &str| Mask::read(&self.folder.join(file));
        let moving = Region::Moving
            .source(self.scene, frame)
            .map(|source| source.mask(&self.scene.camera, [width, height], read))
            .transpose()?;
        let ignored = frame.ignore_mask.as_deref().map(read).transpose()?;
        let masks = [
            moving,
            ignored.map(|mask| mask.resized_to_any(width, height)),
        ];
        for mask in masks.iter().flatten() {
            for (confidence, &covered) in confidence.iter_mut().zip(&mask.data) {
                if covered != 0 {
                    *confidence = 0.0;
                }
            }
        }
        Ok(confidence)
    }
}
