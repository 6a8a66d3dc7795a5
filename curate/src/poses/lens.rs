//! Lenses of cameras, and their removal from frames.

mod distortion;
mod models;

use glam::{DVec2, dvec2};
use omnilife_schemas::{RgbImage, camera::PinholeCamera, interpolation::Edges, rgb::Mask};
use rayon::prelude::*;

pub use distortion::{Distortion, Projection};
pub(super) use models::LensModel;

/// A lens that moves no pixel by more than this is negligible, pixels.
const LEAST_SHIFT_PIXELS: f64 = 0.25;
/// Largest ratio between the focal lengths of the undistorted and the original camera, either way.
const LARGEST_ZOOM: f64 = 4.0;
/// Least ratio if the projection of the lens is not perspective. The middle keeps its resolution, and the border of a
/// wider image, which would be stretched, is cut off.
const LEAST_ZOOM_OF_WIDE_LENSES: f64 = 1.0;
/// Steps of a bisection of the zoom.
const BISECTIONS: usize = 40;

/// Places along a side of a frame, at most.
const MOST_PLACES: u32 = 4096;

/// A pinhole camera behind a lens.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Lens {
    /// Size and intrinsics of the original frames.
    pub camera: PinholeCamera,
    /// Distortion of the lens.
    pub distortion: Distortion,
}

impl Lens {
    /// Returns the largest distance by which it moves a pixel of the frame's border.
    pub fn largest_shift_pixels(&self) -> f64 {
        border(&self.camera)
            .map(|pixel| self.source(&self.camera, pixel).distance(pixel))
            // A direction outside the lens's image counts as an infinite shift.
            .map(|shift| if shift.is_nan() { f64::INFINITY } else { shift })
            .fold(0.0, f64::max)
    }

    /// Returns the angle across the middle row of an undistorted camera, degrees.
    pub(super) fn angle_across_degrees(straight: &PinholeCamera) -> f64 {
        let angle = |pixels: f64| (pixels / straight.fx).atan();
        (angle(straight.cx) + angle(f64::from(straight.width) - straight.cx)).to_degrees()
    }

    /// Returns true if frames look the same without it.
    pub fn is_negligible(&self) -> bool {
        self.largest_shift_pixels() < LEAST_SHIFT_PIXELS
    }

    /// Returns the camera of the undistorted frames, of the same size and principal point. It has the shortest focal
    /// length at which the lens shows every pixel; for a fisheye it is not below that of the lens. `None` if no such
    /// camera fits.
    pub fn straight(&self) -> Option<PinholeCamera> {
        let zoomed = |zoom: f64| PinholeCamera {
            fx: zoom * self.camera.fx,
            fy: zoom * self.camera.fy,
            ..self.camera
        };
        let (width, height) = (f64::from(self.camera.width), f64::from(self.camera.height));
        let is_whole = |zoom: f64| {
            border(&self.camera).all(|pixel| {
                let source = self.source(&zoomed(zoom), pixel);
                let is_inside =
                    (0.0..=width).contains(&source.x) && (0.0..=height).contains(&source.y);
                is_inside
                    && self
                        .distortion
                        .keeps_order(at_depth_one(&zoomed(zoom), pixel))
            })
        };
        let mut most = LARGEST_ZOOM;
        let mut least = match self.distortion.projection {
            Projection::Perspective => 1.0 / LARGEST_ZOOM,
            _ => LEAST_ZOOM_OF_WIDE_LENSES,
        };
        if !is_whole(most) {
            return None;
        }
        for _ in 0..BISECTIONS {
            let middle = 0.5 * (least + most);
            if is_whole(middle) {
                most = middle;
            } else {
                least = middle;
            }
        }
        Some(zoomed(most))
    }

    /// Returns the pixel in a frame that corresponds to one of an undistorted camera.
    pub fn source(&self, straight: &PinholeCamera, pixel: DVec2) -> DVec2 {
        let seen = self.distortion.distorted(at_depth_one(straight, pixel));
        dvec2(
            self.camera.fx * seen.x + self.camera.cx,
            self.camera.fy * seen.y + self.camera.cy,
        )
    }

    /// Returns the place in an undistorted camera of a frame's pixel; NaN without one.
    pub fn straightened(&self, straight: &PinholeCamera, pixel: DVec2) -> DVec2 {
        let place = self
            .distortion
            .straightened(at_depth_one(&self.camera, pixel));
        dvec2(
            straight.fx * place.x + straight.cx,
            straight.fy * place.y + straight.cy,
        )
    }

    /// Returns the same lens for frames of another size.
    #[must_use]
    pub fn resized(&self, width: u32, height: u32) -> Self {
        let (x, y) = (
            f64::from(width) / f64::from(self.camera.width),
            f64::from(height) / f64::from(self.camera.height),
        );
        Self {
            camera: PinholeCamera {
                width,
                height,
                fx: x * self.camera.fx,
                fy: y * self.camera.fy,
                cx: x * self.camera.cx,
                cy: y * self.camera.cy,
            },
            ..*self
        }
    }

    /// Prepares frames of an undistorted camera.
    pub(crate) fn straightening(&self, straight: &PinholeCamera) -> Straightening {
        let (width, height) = (straight.width as usize, straight.height as usize);
        let place = |pixel: usize| {
            let centre = dvec2((pixel % width) as f64 + 0.5, (pixel / width) as f64 + 0.5);
            self.source(straight, centre).as_vec2().to_array()
        };
        Straightening {
            width,
            height,
            places: (0..width * height).into_par_iter().map(place).collect(),
        }
    }
}

fn at_depth_one(camera: &PinholeCamera, pixel: DVec2) -> DVec2 {
    dvec2(
        (pixel.x - camera.cx) / camera.fx,
        (pixel.y - camera.cy) / camera.fy,
    )
}

/// Returns places along the border of a frame, a pixel apart in frames of up to 4096 pixels.
fn border(camera: &PinholeCamera) -> impl Iterator<Item = DVec2> {
    let (width, height) = (camera.width, camera.height);
    let (right, bottom) = (f64::from(width), f64::from(height));
    let along = |pixels: u32| {
        let places = pixels.min(MOST_PLACES);
        (0..=places)
            .map(move |place| f64::from(place) * f64::from(pixels) / f64::from(places.max(1)))
    };
    along(width)
        .flat_map(move |x| [dvec2(x, 0.0), dvec2(x, bottom)])
        .chain(along(height).flat_map(move |y| [dvec2(0.0, y), dvec2(right, y)]))
}

/// Map from every pixel of an undistorted frame to its place in the original one.
pub(crate) struct Straightening {
    width: usize,
    height: usize,
    places: Vec<[f32; 2]>,
}

impl Straightening {
    /// Returns width and height of the frames, pixels.
    pub(crate) fn size(&self) -> [usize; 2] {
        [self.width, self.height]
    }

    /// Returns the undistorted frame. Both have the size of the camera.
    pub(crate) fn image(&self, frame: &RgbImage) -> RgbImage {
        let mut straight = RgbImage::black(self.width, self.height);
        let pixels = straight.data.as_chunks_mut::<3>().0;
        for (pixel, &[x, y]) in pixels.iter_mut().zip(&self.places) {
            *pixel = frame.sample(dvec2(x.into(), y.into()), Edges::Repeated);
        }
        straight
    }

    /// Returns the undistorted mask, by nearest pixels.
    pub(crate) fn mask(&self, mask: &Mask) -> Mask {
        let nearest = |&[x, y]: &[f32; 2]| {
            let column = (x.max(0.0) as usize).min(mask.width - 1);
            let row = (y.max(0.0) as usize).min(mask.height - 1);
            mask.data[row * mask.width + column]
        };
        Mask::new(
            self.width,
            self.height,
            self.places.iter().map(nearest).collect(),
        )
    }
}

#[cfg(test)]
mod tests;
