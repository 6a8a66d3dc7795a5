//! Perspective views of a panorama for a network for photographs, and the return of its scores to the sphere.
//!
//! Views overlap, so that nothing is cut by the seam, a pole or the edge of a view. Near its edge a view has little
//! weight, where another has it in its middle.

use glam::{DMat3, DQuat, DVec3, dvec2, dvec3};
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

    /// Returns the image of the view, `side` pixels square, interleaved RGB.
    pub(super) fn image(&self, frame: &RgbImage, side: usize) -> Vec<u8> {
        match self {
            Self::Sphere(rotation) => crop(frame, rotation, side),
            Self::Part([left, top, width, height]) => {
                let share = |at: usize| at as f64 / (side - 1) as f64;
                let colour = |at: usize| {
                    let x = (left + share(at % side) * width) * frame.width as f64;
                    let y = (top + share(at / side) * height) * frame.height as f64;
                    let colour = frame.sample(dvec2(x, y), Edges::Repeated);
                    colour.map(|value| (value.clamp(0.0, 1.0) * 255.0).round() as u8)
                };
                (0..side * side).flat_map(colour).collect()
            }
        }
    }

    /// Returns the place in the view's image, in [0, 1] from the left and the top, of the middle of a pixel (column,
    /// row) of the frame at a size (width, height); `None` outside.
    pub(super) fn place_of(&self, pixel: [usize; 2], size: [usize; 2]) -> Option<[f64; 2]> {
        let middle = dvec2(pixel[0] as f64 + 0.5, pixel[1] as f64 + 0.5);
        match self {
            Self::Sphere(rotation) => {
                let camera = ErpCamera::new(size[0] as u32, size[1] as u32);
                place(*rotation * camera.unproject(middle))
            }
            Self::Part([left, top, width, height]) => {
                let [x, y] = [middle.x / size[0] as f64, middle.y / size[1] as f64];
                let at = [(x - left) / width, (y - top) / height];
                at.iter().all(|at| (0.0..=1.0).contains(at)).then_some(at)
            }
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

/// Returns the image of a view, `side` pixels square, interleaved RGB. The corners of the image are centres of pixels,
/// as in the network's grid.
fn crop(panorama: &RgbImage, view: &DMat3, side: usize) -> Vec<u8> {
    let camera = ErpCamera::new(panorama.width as u32, panorama.height as u32);
    let to_panorama = view.transpose();
    let slope = |at: usize| (2.0 * at as f64 / (side - 1) as f64 - 1.0) * REACH;
    let mut out = Vec::with_capacity(side * side * 3);
    for row in 0..side {
        for column in 0..side {
            let direction = to_panorama * dvec3(slope(column), slope(row), 1.0);
            let colour = match camera.project(direction) {
                Some(place) => panorama.sample(place, Edges::Around),
                None => [0.0; 3],
            };
            out.extend(colour.map(|value| (value.clamp(0.0, 1.0) * 255.0).round() as u8));
        }
    }
    out
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
                let places = views.iter().filter_map(|view| view.place_of(pixel, size));
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
            let crop = crop(&panorama, &view, 33);
            for (at, pixel) in crop.chunks_exact(3).enumerate() {
                let slope = |at: usize| (at as f64 / 16.0 - 1.0) * REACH;
                let inside = dvec3(slope(at % 33), slope(at / 33), 1.0);
                let expected = (view.transpose() * inside.normalize()) * 0.5 + 0.5;
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
