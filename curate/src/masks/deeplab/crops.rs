//! Perspective views of a panorama for a network for photographs, and the return of its scores to the sphere.
//!
//! Views overlap, so that nothing is cut by the seam, a pole or the edge of a view. Near its edge a view has little
//! weight, where another has it in its middle.

use glam::{DMat3, DQuat, DVec2, DVec3, dvec2, dvec3};
use omnilife_schemas::{
    RgbImage,
    camera::{CameraModel, ErpCamera},
    interpolation::Edges,
};

/// Half the field of view of every crop, as a slope: 103 degrees in all. So the six around the horizon and the two at
/// the poles leave no hole between them.
const REACH: f64 = 1.25;
/// Crops around the horizon.
const AROUND: usize = 6;
/// Largest step from a square of a perspective frame to the next, as a share of its side.
const MOST_STEP: f64 = 0.8;

/// A square view of a frame for the network.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum View {
    /// A perspective view of a panorama, by the rotation from the camera's frame to its own.
    Sphere(DMat3),
    /// A part of a perspective frame: its left and upper edges, width and height, as shares of the frame's.
    Part([f64; 4]),
}

impl View {
    /// Returns the views that cover a panorama, or a perspective frame of a size (width, height).
    pub(super) fn all(is_perspective: bool, size: [usize; 2]) -> Vec<Self> {
        if !is_perspective {
            return views().into_iter().map(Self::Sphere).collect();
        }
        let [width, height] = size.map(|side| side as f64);
        let (long, side) = (width.max(height), width.min(height));
        // Squares of the shorter side, evenly along the longer one, so that neighbours overlap.
        let count = ((long - side) / (MOST_STEP * side)).ceil() as usize + 1;
        let length = side / long;
        let begin = |index: usize| match count {
            1 => 0.0,
            _ => (1.0 - length) * index as f64 / (count - 1) as f64,
        };
        let part = |index: usize| match width >= height {
            true => Self::Part([begin(index), 0.0, length, 1.0]),
            false => Self::Part([0.0, begin(index), 1.0, length]),
        };
        (0..count).map(part).collect()
    }

    /// Returns the places in a frame of a size (width, height) that the pixels of the view's image show, `side` pixels
    /// square. The corners of the image are centres of pixels, as in the network's grid.
    pub(super) fn places(&self, [width, height]: [usize; 2], side: usize) -> Vec<DVec2> {
        let share = |at: usize| at as f64 / (side - 1) as f64;
        let pixels = (0..side * side).map(|at| [share(at % side), share(at / side)]);
        match self {
            Self::Sphere(rotation) => {
                let camera = ErpCamera::new(width as u32, height as u32);
                let to_panorama = rotation.transpose();
                let slope = |share: f64| (2.0 * share - 1.0) * REACH;
                let direction = |[x, y]: [f64; 2]| to_panorama * dvec3(slope(x), slope(y), 1.0);
                pixels
                    .map(|pixel| camera.project(direction(pixel)).unwrap_or_default())
                    .collect()
            }
            Self::Part([left, top, wide, high]) => pixels
                .map(|[x, y]| {
                    dvec2(
                        (left + x * wide) * width as f64,
                        (top + y * high) * height as f64,
                    )
                })
                .collect(),
        }
    }

    /// Returns the interleaved RGB of a frame at some places.
    pub(super) fn image(&self, frame: &RgbImage, places: &[DVec2]) -> Vec<u8> {
        let edges = match self {
            Self::Sphere(_) => Edges::Around,
            Self::Part(_) => Edges::Repeated,
        };
        let colour = |&place: &DVec2| {
            let colour = frame.sample(place, edges);
            colour.map(|value| (value.clamp(0.0, 1.0) * 255.0 + 0.5) as u8)
        };
        places.iter().flat_map(colour).collect()
    }

    /// Returns the place in the view's image, in [0, 1] from the left and the top, of a pixel; `None` outside.
    pub(super) fn place_of(&self, pixel: &Pixel) -> Option<[f64; 2]> {
        match self {
            Self::Sphere(rotation) => place(*rotation * pixel.direction),
            Self::Part([left, top, width, height]) => {
                let [x, y] = pixel.share;
                let at = [(x - left) / width, (y - top) / height];
                at.iter().all(|at| (0.0..=1.0).contains(at)).then_some(at)
            }
        }
    }
}

/// Middle of a pixel.
#[derive(Debug, Clone, Copy)]
pub(super) struct Pixel {
    /// In the camera's frame, if the frame is a panorama.
    direction: DVec3,
    /// Shares of the frame's width and height.
    share: [f64; 2],
}

impl Pixel {
    /// Returns the middle of a pixel (column, row) of a frame at a size (width, height).
    pub(super) fn new([column, row]: [usize; 2], [width, height]: [usize; 2]) -> Self {
        let middle = dvec2(column as f64 + 0.5, row as f64 + 0.5);
        Self {
            direction: ErpCamera::new(width as u32, height as u32).unproject(middle),
            share: [middle.x / width as f64, middle.y / height as f64],
        }
    }
}

/// Returns the rotations from the camera's frame to the views'.
fn views() -> Vec<DMat3> {
    let around = (0..AROUND).map(|index| {
        let yaw = index as f64 / AROUND as f64 * std::f64::consts::TAU;
        DQuat::from_rotation_y(-yaw)
    });
    let poles = [1.0, -1.0].map(|side| DQuat::from_rotation_x(side * std::f64::consts::FRAC_PI_2));
    around.chain(poles).map(DMat3::from_quat).collect()
}

/// Returns the place in a view's image of a direction in its frame, in [0, 1] from the left and the top; `None`
/// outside.
fn place(direction: DVec3) -> Option<[f64; 2]> {
    let DVec3 { x, y, z } = direction;
    let reach = REACH * z;
    (z > 0.0 && x.abs() <= reach && y.abs() <= reach)
        .then(|| [x / reach, y / reach].map(|at| 0.5 * (at + 1.0)))
}

/// Returns the weight of a view at a place: 1 in its middle, 0 at its edge.
pub(super) fn weight([x, y]: [f64; 2]) -> f64 {
    let from_edge = [x, y].map(|at| 1.0 - (2.0 * at - 1.0).abs());
    from_edge[0] * from_edge[1]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn squares_cover_a_perspective_frame_and_overlap() {
        for (size, count) in [
            ([1920, 1080], 2),
            ([1080, 1920], 2),
            ([600, 600], 1),
            ([3000, 1000], 4),
        ] {
            let views = View::all(true, size);
            assert_eq!(views.len(), count, "{size:?}");
            for pixel in [
                [0, 0],
                [size[0] - 1, size[1] - 1],
                [size[0] / 2, size[1] / 2],
            ] {
                let places = views
                    .iter()
                    .filter_map(|view| view.place_of(&Pixel::new(pixel, size)));
                assert!(places.count() > 0, "{pixel:?} of {size:?}");
            }
        }
    }

    #[test]
    fn every_direction_is_well_inside_some_view() {
        let views = views();
        let camera = ErpCamera::new(180, 90);
        for pixel in 0..180 * 90 {
            let centre = dvec2(f64::from(pixel % 180) + 0.5, f64::from(pixel / 180) + 0.5);
            let direction = camera.unproject(centre);
            let best = views
                .iter()
                .filter_map(|view| place(*view * direction))
                .map(weight)
                .fold(0.0, f64::max);
            assert!(best > 0.05, "{direction} counts {best}");
        }
    }

    /// The colour of a pixel is its direction.
    #[test]
    fn images_show_what_lies_in_their_direction() {
        let camera = ErpCamera::new(256, 128);
        let mut panorama = RgbImage::black(256, 128);
        for (at, pixel) in panorama.data.chunks_exact_mut(3).enumerate() {
            let centre = dvec2((at % 256) as f64 + 0.5, (at / 256) as f64 + 0.5);
            let direction = camera.unproject(centre) * 0.5 + 0.5;
            pixel.copy_from_slice(&direction.as_vec3().to_array());
        }
        for view in views() {
            let rotation = view;
            let view = View::Sphere(rotation);
            let crop = view.image(&panorama, &view.places([256, 128], 33));
            for (at, pixel) in crop.chunks_exact(3).enumerate() {
                let slope = |at: usize| (at as f64 / 16.0 - 1.0) * REACH;
                let inside = dvec3(slope(at % 33), slope(at / 33), 1.0);
                let expected = (rotation.transpose() * inside.normalize()) * 0.5 + 0.5;
                for (value, expected) in pixel.iter().zip(expected.to_array()) {
                    let error = f64::from(*value) / 255.0 - expected;
                    assert!(error.abs() < 0.02, "{pixel:?} for {expected}");
                }
                let back = place(inside).unwrap_or_default();
                assert!((back[0] - (at % 33) as f64 / 32.0).abs() < 1e-9);
            }
        }
    }
}
