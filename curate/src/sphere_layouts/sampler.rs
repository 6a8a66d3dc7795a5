//! Equirectangular sampling: lookup of the stored frame for rays spread over each pixel.

use glam::{DVec2, dvec2};
use omnilife_schemas::{
    camera::{CameraModel, ErpCamera},
    interpolation::{Edges, bilinear},
    records::SphereLayout,
    rgb::Mask,
};
use omnilife_video::Rgb8Image;
use rayon::prelude::*;

use super::places;

/// Rays along a side of a pixel at most.
const MOST_RAYS: usize = 4;

/// Map from the rays of an equirectangular image to frames of one layout and size.
#[derive(Debug)]
pub(super) struct SphereSampler {
    stored: [usize; 2],
    size: [usize; 2],
    /// Rays of one pixel.
    rays: usize,
    /// Places in a frame, pixels from its corner, by pixel and ray; NaN for directions that are not stored.
    places: Vec<[f32; 2]>,
}

impl SphereSampler {
    /// Creates a sampler from frames of `stored` pixels to images of `size`.
    pub(super) fn new(layout: SphereLayout, stored: [usize; 2], size: [usize; 2]) -> Self {
        let [width, height] = size;
        let native = layout.erp_width((stored[0] as u32, stored[1] as u32)) as usize;
        let side = native.div_ceil(width).clamp(1, MOST_RAYS);
        let camera = ErpCamera::new(width as u32, height as u32);
        let place = |pixel: usize, ray: usize| {
            let corner = dvec2((pixel % width) as f64, (pixel / width) as f64);
            let within = dvec2((ray % side) as f64, (ray / side) as f64) + 0.5;
            let direction = camera.unproject(corner + within / side as f64);
            places::place(layout, stored, direction).map_or([f32::NAN; 2], |place| {
                // Pixels beyond the part belong to another direction.
                let [first, last] = place.part;
                let at = place.at.clamp(first + 0.5, last - 0.5);
                [at.x as f32, at.y as f32]
            })
        };
        let rays = side * side;
        Self {
            stored,
            size,
            rays,
            places: (0..width * height * rays)
                .into_par_iter()
                .map(|at| place(at / rays, at % rays))
                .collect(),
        }
    }

    /// Returns true if it is for frames of `stored` pixels and images of `size`.
    pub(super) fn is_for(&self, stored: [usize; 2], size: [usize; 2]) -> bool {
        self.stored == stored && self.size == size
    }

    /// Marks the pixels with a ray in a direction that is not stored.
    pub(super) fn unrecorded(&self) -> Mask {
        let [width, height] = self.size;
        let is_open = |places: &[[f32; 2]]| places.iter().any(|place| place[0].is_nan());
        let pixels = self.places.chunks_exact(self.rays);
        Mask {
            width,
            height,
            data: pixels
                .map(|places| 255 * u8::from(is_open(places)))
                .collect(),
        }
    }

    /// Returns the image of a frame; black for directions that are not stored.
    pub(super) fn apply(&self, frame: &Rgb8Image) -> Rgb8Image {
        let [width, height] = self.size;
        let mut data = vec![0; 3 * width * height];
        let pixels = data.as_chunks_mut::<3>().0;
        pixels
            .par_iter_mut()
            .zip(self.places.par_chunks_exact(self.rays))
            .for_each(|(pixel, places)| {
                let mut sum = [0.0; 3];
                for place in places.iter().filter(|place| !place[0].is_nan()) {
                    let place = DVec2::new(place[0].into(), place[1].into());
                    for (index, weight) in bilinear(self.stored, Edges::Repeated, place) {
                        let stored = &frame.data[3 * index..3 * index + 3];
                        for (sum, &level) in sum.iter_mut().zip(stored) {
                            *sum += weight * f64::from(level);
                        }
                    }
                }
                *pixel = sum.map(|sum| (sum / self.rays as f64).round() as u8);
            });
        Rgb8Image::new(width, height, data)
    }
}
