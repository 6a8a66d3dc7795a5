//! The inside of an object's mask in one frame, resampled over a plane that touches the unit sphere.
//!
//! A perspective image is its own plane. In a panorama the plane touches the sphere in the middle of the mask, so
//! that neither the seam nor a pole bends or splits what is inside.

use glam::{DMat3, DVec2, DVec3};
use omnilife_engine::camera::Camera;

use super::super::{
    grey_at, pixel_at,
    silhouettes::{Silhouette, plane_axes},
};
use crate::clip::{Clip, camera_direction, pixel_centre, project};

/// Samples beside the mask, each way.
const BESIDE: f64 = 2.0;
/// Maximum number of samples of a side.
const MOST_SAMPLES: f64 = 1024.0;
/// Maximum number of places along each axis that are averaged for a sample.
const MOST_PLACES: f64 = 4.0;
/// Minimum covered share of a sample that shows the object.
const COVERED: f64 = 0.5;

/// Grey values and coverage on a regular grid of a tangent plane, one unit from the camera.
#[derive(Debug, Clone)]
pub struct Patch {
    /// Position of the first sample.
    pub origin: DVec2,
    /// Distance of neighbouring samples.
    pub step: f64,
    /// Number of samples across.
    pub width: usize,
    /// Number of samples down.
    pub height: usize,
    /// Mean of the three channels, [0, 1], row by row.
    pub grey: Vec<f64>,
    /// Share of each sample that the mask covers, [0, 1].
    pub cover: Vec<f64>,
}

/// Returns the position of a direction on the plane with these axes; `None` behind the plane.
pub fn tangent(axes: &DMat3, direction: DVec3) -> Option<DVec2> {
    let local = axes.transpose() * direction;
    (local.z > 1e-6 * local.length()).then(|| local.truncate() / local.z)
}

/// Returns the size of a pixel on the tangent plane of a mask.
pub fn pixel_size(camera: &Camera) -> f64 {
    match camera {
        Camera::Pinhole(camera) => 1.0 / camera.fx.max(camera.fy),
        Camera::Erp(camera) => std::f64::consts::TAU / f64::from(camera.width),
    }
}

/// Returns the corners of a mask on its tangent plane; `None` where a part of it is behind the plane.
pub fn extent(clip: &Clip, seen: &Silhouette) -> Option<[DVec2; 2]> {
    let axes = plane_axes(&clip.camera, seen.direction);
    let [width, _] = clip.size();
    let (mut low, mut high) = (DVec2::MAX, DVec2::MIN);
    for &pixel in &seen.pixels {
        let direction = camera_direction(&clip.camera, pixel_centre(pixel, width));
        let at = tangent(&axes, direction)?;
        (low, high) = (low.min(at), high.max(at));
    }
    (low.x <= high.x).then_some([low, high])
}

impl Patch {
    /// Makes a patch of a function that returns grey value and coverage at a position.
    pub fn drawn(
        origin: DVec2,
        step: f64,
        [width, height]: [usize; 2],
        draw: impl Fn(DVec2) -> [f64; 2],
    ) -> Self {
        let places = (0..width * height).map(|sample| {
            let at = DVec2::new((sample % width) as f64, (sample / width) as f64);
            draw(origin + step * at)
        });
        let (grey, cover) = places.map(|[grey, cover]| (grey, cover)).unzip();
        Self {
            origin,
            step,
            width,
            height,
            grey,
            cover,
        }
    }

    /// Resamples the surroundings of a mask; `None` where a part of it is behind the tangent plane, or the patch
    /// would be larger than any image needs.
    pub fn of(clip: &Clip, object: usize, seen: &Silhouette, step: f64) -> Option<Self> {
        let [low, high] = extent(clip, seen)?;
        let size = (high - low) / step + 2.0 * BESIDE + 1.0;
        if size.max_element() > MOST_SAMPLES {
            return None;
        }
        let axes = plane_axes(&clip.camera, seen.direction);
        let frame = &clip.frames[seen.frame];
        let [columns, rows] = clip.size().map(|side| side as f64);
        let parts = (step / pixel_size(&clip.camera))
            .ceil()
            .clamp(1.0, MOST_PLACES);
        let draw = |at: DVec2| {
            let mut sums = [0.0; 2];
            for part in 0..(parts * parts) as usize {
                let place =
                    DVec2::new((part as f64 % parts).floor(), (part as f64 / parts).floor());
                let beside = ((place + 0.5) / parts - 0.5) * step;
                let seen_at = project(&clip.camera, axes * (at + beside).extend(1.0))
                    .filter(|at| at.x >= 0.0 && at.y >= 0.0 && at.x <= columns && at.y <= rows);
                if let Some(at) = seen_at {
                    sums[0] += grey_at(clip, frame, at);
                    sums[1] += frame.covered(object, pixel_at(clip, at));
                }
            }
            sums.map(|sum| sum / (parts * parts))
        };
        let origin = low - BESIDE * step;
        let size = [size.x.ceil() as usize, size.y.ceil() as usize];
        Some(Self::drawn(origin, step, size, draw))
    }

    /// Returns the patch at half the resolution: means of four samples, of the covered ones where there are any.
    #[must_use]
    pub fn halved(&self) -> Self {
        let (width, height) = (self.width / 2, self.height / 2);
        let (mut grey, mut cover) = (Vec::new(), Vec::new());
        for sample in 0..width * height {
            let first = 2 * (sample / width) * self.width + 2 * (sample % width);
            let four = [first, first + 1, first + self.width, first + self.width + 1];
            let covered: f64 = four.iter().map(|&at| self.cover[at]).sum();
            let inside: f64 = four.iter().map(|&at| self.cover[at] * self.grey[at]).sum();
            let all: f64 = four.iter().map(|&at| self.grey[at]).sum();
            grey.push(if covered > 0.0 {
                inside / covered
            } else {
                all / 4.0
            });
            cover.push(covered / 4.0);
        }
        Self {
            origin: self.origin + 0.5 * self.step,
            step: 2.0 * self.step,
            width,
            height,
            grey,
            cover,
        }
    }

    /// Returns the patch and coarser ones, the finest first; the coarsest has at least `least` samples a side.
    pub fn pyramid(self, least: usize, most_levels: usize) -> Vec<Self> {
        let mut levels = vec![self];
        while let Some(last) = levels.last()
            && levels.len() < most_levels
            && last.width.min(last.height) >= 2 * least
        {
            let next = last.halved();
            levels.push(next);
        }
        levels
    }

    /// Returns the position of a sample.
    pub fn place(&self, sample: usize) -> DVec2 {
        let at = [sample % self.width, sample / self.width].map(|at| at as f64);
        self.origin + self.step * DVec2::from_array(at)
    }

    /// Returns true if a sample and its eight neighbours are in the mask.
    pub fn is_inside(&self, sample: usize) -> bool {
        let (column, row) = (sample % self.width, sample / self.width);
        let has_neighbours =
            column > 0 && row > 0 && column + 1 < self.width && row + 1 < self.height;
        has_neighbours
            && (row - 1..=row + 1).all(|row| {
                let first = row * self.width + column - 1;
                self.cover[first..first + 3].iter().all(|&c| c >= COVERED)
            })
    }

    /// Returns the grey value at a position, linear between samples; `None` where one of these is outside of the
    /// mask.
    pub fn sample(&self, at: DVec2) -> Option<f64> {
        let place = (at - self.origin) / self.step;
        let floor = place.floor();
        let is_within = floor.x >= 0.0
            && floor.y >= 0.0
            && floor.x + 1.0 < self.width as f64
            && floor.y + 1.0 < self.height as f64;
        if !is_within {
            return None;
        }
        let part = place - floor;
        let first = floor.y as usize * self.width + floor.x as usize;
        let four = [first, first + 1, first + self.width, first + self.width + 1];
        let weights = [
            (1.0 - part.x) * (1.0 - part.y),
            part.x * (1.0 - part.y),
            (1.0 - part.x) * part.y,
            part.x * part.y,
        ];
        let are_inside = four.iter().all(|&at| self.cover[at] >= COVERED);
        are_inside.then(|| {
            let terms = four.iter().zip(weights);
            terms.map(|(&at, weight)| weight * self.grey[at]).sum()
        })
    }
}
