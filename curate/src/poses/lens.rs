//! Lens distortion as COLMAP models it, and taking it out of frames.
//!
//! With `x = X/Z`, `y = Y/Z` and `r^2 = x^2 + y^2`, a lens shows a direction at `(x + dx, y + dy)`:
//!
//! ```text
//! dx = x (k1 r^2 + k2 r^4) + 2 p1 x y + p2 (r^2 + 2 x^2)
//! dy = y (k1 r^2 + k2 r^4) + 2 p2 x y + p1 (r^2 + 2 y^2)
//! ```
//!
//! (COLMAP, `src/colmap/sensor/models.h`: `OPENCV`; `RADIAL` and `SIMPLE_RADIAL` have fewer terms).

use glam::{DVec2, dvec2};
use omnilife_schemas::{RgbImage, camera::PinholeCamera, interpolation::Edges, rgb::Mask};
use rayon::prelude::*;

/// A lens that moves no pixel by more than this is none, pixels.
const LEAST_SHIFT_PIXELS: f64 = 0.25;
/// The straight camera sees no wider, and no narrower than by this factor of the focal length.
const LARGEST_ZOOM: f64 = 4.0;
/// Steps of a bisection of the zoom.
const BISECTIONS: usize = 40;
/// Steps that undo the distortion of a place.
const INVERSIONS: usize = 60;

/// Places along a side of a frame, at most.
const MOST_PLACES: u32 = 4096;

/// COLMAP's models of perspective cameras: name, number (`CameraModelId`), and how many parameters.
const MODELS: [(&str, i32, usize); 5] = [
    ("SIMPLE_PINHOLE", 0, 3),
    ("PINHOLE", 1, 4),
    ("SIMPLE_RADIAL", 2, 4),
    ("RADIAL", 3, 5),
    ("OPENCV", 4, 8),
];
/// Its models whose lenses are not straightened; a model may hold one that no image uses.
const OTHER_MODELS: [(&str, i32, usize); 7] = [
    ("OPENCV_FISHEYE", 5, 8),
    ("FULL_OPENCV", 6, 12),
    ("FOV", 7, 5),
    ("SIMPLE_RADIAL_FISHEYE", 8, 4),
    ("RADIAL_FISHEYE", 9, 5),
    ("THIN_PRISM_FISHEYE", 10, 12),
    ("RAD_TAN_THIN_PRISM_FISHEYE", 11, 16),
];
/// The names of the models that are read, for messages.
pub(super) const MODEL_NAMES: &str = "SIMPLE_PINHOLE, PINHOLE, SIMPLE_RADIAL, RADIAL and OPENCV";

/// Number of parameters of a model by its name.
pub(super) fn parameters_of_name(name: &str) -> Option<(&'static str, usize)> {
    let model = MODELS.iter().find(|model| model.0 == name)?;
    Some((model.0, model.2))
}

/// Name of a model and number of its parameters by its own number.
pub(super) fn parameters_of_number(number: i32) -> Option<(&'static str, usize)> {
    let model = MODELS.iter().find(|model| model.1 == number)?;
    Some((model.0, model.2))
}

/// Name of a model whose lens is not straightened and number of its parameters, by its own number.
pub(super) fn parameters_of_other(number: i32) -> Option<(&'static str, usize)> {
    let model = OTHER_MODELS.iter().find(|model| model.1 == number)?;
    Some((model.0, model.2))
}

/// The terms of the distortion; 0 where a model does not have one.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Distortion {
    /// Radial, second and fourth order.
    pub radial: [f64; 2],
    /// Tangential.
    pub tangential: [f64; 2],
}

impl Distortion {
    /// How far a place at depth 1 is moved.
    fn shift(&self, p: DVec2) -> DVec2 {
        let ([k1, k2], [p1, p2]) = (self.radial, self.tangential);
        let square = p.length_squared();
        let radial = (k1 + k2 * square) * square;
        p * radial
            + dvec2(
                2.0 * p1 * p.x * p.y + p2 * (square + 2.0 * p.x * p.x),
                2.0 * p2 * p.x * p.y + p1 * (square + 2.0 * p.y * p.y),
            )
    }

    /// Whether places between the middle and this one stay in their order; beyond where they do not, the
    /// terms say nothing of a lens.
    fn keeps_order(&self, p: DVec2) -> bool {
        let [k1, k2] = self.radial;
        (1..=8).all(|step| {
            let square = p.length_squared() * (f64::from(step) / 8.0).powi(2);
            1.0 + (3.0 * k1 + 5.0 * k2 * square) * square > 0.0
        })
    }
}

/// A pinhole camera behind a lens.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Lens {
    /// Size and intrinsics of the frames as they are.
    pub camera: PinholeCamera,
    /// What the lens does.
    pub distortion: Distortion,
}

impl Lens {
    /// The lens of a camera of COLMAP; `None` for parameters that are not of the model, are not finite, or
    /// have a focal length that is not positive.
    pub(super) fn of_model(
        model: &str,
        [width, height]: [u32; 2],
        parameters: &[f64],
    ) -> Option<Self> {
        let (f, rest) = match (model, parameters) {
            ("SIMPLE_PINHOLE" | "SIMPLE_RADIAL" | "RADIAL", [f, rest @ ..]) => ([*f, *f], rest),
            (_, [fx, fy, rest @ ..]) => ([*fx, *fy], rest),
            _ => return None,
        };
        let [cx, cy, terms @ ..] = rest else {
            return None;
        };
        let term = |number: usize| terms.get(number).copied().unwrap_or(0.0);
        let is_sound =
            parameters.iter().all(|value| value.is_finite()) && f.iter().all(|&f| f > 0.0);
        is_sound.then(|| Self {
            camera: PinholeCamera {
                width,
                height,
                fx: f[0],
                fy: f[1],
                cx: *cx,
                cy: *cy,
            },
            distortion: Distortion {
                radial: [term(0), term(1)],
                tangential: [term(2), term(3)],
            },
        })
    }

    /// The largest distance by which it moves a pixel of the frame's border.
    pub fn largest_shift_pixels(&self) -> f64 {
        border(&self.camera)
            .map(|pixel| self.source(&self.camera, pixel).distance(pixel))
            .fold(0.0, f64::max)
    }

    /// Whether frames look the same without it.
    pub fn is_negligible(&self) -> bool {
        self.largest_shift_pixels() < LEAST_SHIFT_PIXELS
    }

    /// The camera of the frames without the distortion: of the same size and principal point, with the
    /// shortest focal length at which every pixel is one that the lens shows; `None` where there is none.
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
        let (mut least, mut most) = (1.0 / LARGEST_ZOOM, LARGEST_ZOOM);
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

    /// Where a frame shows what is at a pixel of a straight camera.
    pub fn source(&self, straight: &PinholeCamera, pixel: DVec2) -> DVec2 {
        let place = at_depth_one(straight, pixel);
        let seen = place + self.distortion.shift(place);
        dvec2(
            self.camera.fx * seen.x + self.camera.cx,
            self.camera.fy * seen.y + self.camera.cy,
        )
    }

    /// Where a straight camera shows what is at a pixel of a frame.
    pub fn straightened(&self, straight: &PinholeCamera, pixel: DVec2) -> DVec2 {
        let seen = at_depth_one(&self.camera, pixel);
        let mut place = seen;
        for _ in 0..INVERSIONS {
            place = seen - self.distortion.shift(place);
        }
        dvec2(
            straight.fx * place.x + straight.cx,
            straight.fy * place.y + straight.cy,
        )
    }

    /// The same lens before frames of another size.
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

    /// Prepares frames of a straight camera.
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

/// Places along the border of a frame, a pixel apart in frames of up to 4096 pixels.
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

/// Where every pixel of a straight frame is in the one as it is.
pub(crate) struct Straightening {
    width: usize,
    height: usize,
    places: Vec<[f32; 2]>,
}

impl Straightening {
    /// Width and height of the frames, pixels.
    pub(crate) fn size(&self) -> [usize; 2] {
        [self.width, self.height]
    }

    /// A frame without the distortion. Both have the size of the camera.
    pub(crate) fn image(&self, frame: &RgbImage) -> RgbImage {
        let mut straight = RgbImage::black(self.width, self.height);
        let pixels = straight.data.as_chunks_mut::<3>().0;
        for (pixel, &[x, y]) in pixels.iter_mut().zip(&self.places) {
            *pixel = frame.sample(dvec2(x.into(), y.into()), Edges::Repeated);
        }
        straight
    }

    /// The same of a mask: the nearest of its pixels.
    pub(crate) fn mask(&self, mask: &Mask) -> Mask {
        let nearest = |&[x, y]: &[f32; 2]| {
            let column = (x.max(0.0) as usize).min(mask.width - 1);
            let row = (y.max(0.0) as usize).min(mask.height - 1);
            mask.data[row * mask.width + column]
        };
        Mask {
            width: self.width,
            height: self.height,
            data: self.places.iter().map(nearest).collect(),
        }
    }
}

#[cfg(test)]
mod tests;
