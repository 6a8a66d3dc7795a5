//! The depth of a view's pixels: a sweep of planes of equal depth (Collins 1996) against several others.
//!
//! A pixel with viewing direction `r` (with `r.z = 1`) at inverse depth `w` is seen by another camera in the direction
//! `Q r + w s`: `Q` is the rotation between the cameras, `s` this centre in the other camera's frame. For every `w` the
//! other image is warped onto this one's grid and compared. Of the costs against several views the better half counts:
//! one side sees where the other does not (Kang, Szeliski, Chai, Handling occlusions in dense multi-view stereo, 2001).

use glam::{DMat3, DVec3, Mat3, Vec3, vec3};
use omnilife_schemas::camera::PinholeCamera;
use omnilife_stereo::{
    BestHypothesis, CostVolume, LARGEST_COST, Matcher, RowEnds, UNKNOWN_COST, aggregated, best,
};
use rayon::prelude::*;

use super::neighbours::MOST;

/// Parallax between two hypotheses, pixels.
const STEP_PIXELS: f64 = 1.25;
/// Hypotheses, at least and at most.
const COUNT: (usize, usize) = (16, 192);
/// Cost of a pixel that no other view shows.
const NOT_SHOWN: u8 = LARGEST_COST / 2;

/// A view whose depth is searched, or its neighbour.
#[derive(Debug, Clone, Copy)]
pub(super) struct SweptView<'a> {
    pub(super) camera: PinholeCamera,
    /// Camera to world.
    pub(super) to_world: DMat3,
    pub(super) centre: DVec3,
    pub(super) image: &'a GreyImage,
}

/// Inverse depths to test, in equal steps.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Hypotheses {
    pub(super) count: usize,
    farthest: f64,
    nearest: f64,
}

impl Hypotheses {
    /// Creates steps between two inverse depths, so that none moves a pixel of any other view by more than
    /// [`STEP_PIXELS`], unless that would be too many.
    pub(super) fn new(
        inverse_depths: [f64; 2],
        view: &SweptView<'_>,
        others: &[SweptView<'_>],
    ) -> Self {
        let [farthest, nearest] = inverse_depths;
        let parallax = others
            .iter()
            .map(|other| parallax(view, other, inverse_depths))
            .fold(0.0, f64::max);
        let steps = (parallax / STEP_PIXELS).ceil().min(COUNT.1 as f64) as usize;
        Self {
            count: (steps + 1).clamp(COUNT.0, COUNT.1),
            farthest,
            nearest,
        }
    }

    fn inverse_depth(&self, steps: f64) -> f64 {
        self.farthest + (self.nearest - self.farthest) * steps / (self.count - 1) as f64
    }
}

/// Returns the shift of an image's centre in another one between two inverse depths, pixels.
fn parallax(view: &SweptView<'_>, other: &SweptView<'_>, inverse_depths: [f64; 2]) -> f64 {
    let (turn, shift) = between(view, other);
    let middle = turn * DVec3::Z;
    let [far, near] = inverse_depths.map(|inverse| {
        let seen = middle + inverse * shift;
        // Points behind the other camera have no place in its image.
        let depth = seen.z.max(0.1 * seen.length());
        glam::dvec2(other.camera.fx * seen.x, other.camera.fy * seen.y) / depth
    });
    far.distance(near)
}

/// Returns rotation and shift from a view's frame to another one's.
fn between(view: &SweptView<'_>, other: &SweptView<'_>) -> (DMat3, DVec3) {
    let to_other = other.to_world.transpose();
    (
        to_other * view.to_world,
        to_other * (view.centre - other.centre),
    )
}

/// Returns depth of every pixel along the viewing direction, world units; infinite at inverse depth 0.
pub(super) fn depths(
    view: &SweptView<'_>,
    others: &[SweptView<'_>],
    hypotheses: &Hypotheses,
) -> Vec<f32> {
    let (width, height) = (view.image.width, view.image.height);
    let matcher = Matcher::new(&view.image.pixels, width, RowEnds::Open);
    let warps: Vec<Warp<'_>> = others.iter().map(|other| Warp::new(view, other)).collect();
    let planes: Vec<Vec<u8>> = (0..hypotheses.count)
        .into_par_iter()
        .map(|hypothesis| {
            let inverse_depth = hypotheses.inverse_depth(hypothesis as f64);
            let costs: Vec<Vec<u8>> = warps
                .iter()
                .map(|warp| matcher.costs(&warp.image(inverse_depth, width, height)))
                .collect();
            better_half(&costs, width * height)
        })
        .collect();
    let volume = CostVolume::of_planes(width, height, &planes);
    let sums = aggregated(&volume, &view.image.pixels, RowEnds::Open);
    let depth = |best: BestHypothesis| {
        (1.0 / hypotheses.inverse_depth(f64::from(best.steps)).max(0.0)) as f32
    };
    let depths: Vec<f32> = best(&sums).into_iter().map(depth).collect();
    median(&depths, width)
}

/// Returns the median of every pixel and its neighbours: a fraction of a step is less certain than a step.
fn median(depths: &[f32], width: usize) -> Vec<f32> {
    let height = depths.len() / width;
    let of_pixel = |pixel: usize| {
        let (row, column) = (pixel / width, pixel % width);
        let mut values = [0.0; 9];
        for (place, value) in values.iter_mut().enumerate() {
            let row = (row + place / 3).saturating_sub(1).min(height - 1);
            let column = (column + place % 3).saturating_sub(1).min(width - 1);
            *value = depths[row * width + column];
        }
        *values.select_nth_unstable_by(4, f32::total_cmp).1
    };
    (0..depths.len()).into_par_iter().map(of_pixel).collect()
}

/// Returns per pixel the mean of the better half of its costs against the views that show it, at most [`MOST`].
fn better_half(costs: &[Vec<u8>], pixels: usize) -> Vec<u8> {
    let of_pixel = |pixel: usize| {
        let mut sorted = [UNKNOWN_COST; MOST];
        for (sorted, costs) in sorted.iter_mut().zip(costs) {
            *sorted = costs[pixel];
        }
        // Unknown ones come last.
        for (a, b) in [(0, 1), (2, 3), (0, 2), (1, 3), (1, 2)] {
            (sorted[a], sorted[b]) = (sorted[a].min(sorted[b]), sorted[a].max(sorted[b]));
        }
        let [first, second, third, _] = sorted;
        match (first, third) {
            (UNKNOWN_COST, _) => NOT_SHOWN,
            (_, UNKNOWN_COST) => first,
            _ => first.midpoint(second),
        }
    };
    (0..pixels).map(of_pixel).collect()
}

/// Another view, ready to be warped onto a view's grid.
struct Warp<'a> {
    image: &'a GreyImage,
    /// From the pixel (column, row, 1) of the view to the other's pixel, homogeneous, at infinity.
    homography: Mat3,
    /// Shift at inverse depth 1.
    shift: Vec3,
}

impl<'a> Warp<'a> {
    fn new(view: &SweptView<'_>, other: &SweptView<'a>) -> Self {
        let (turn, shift) = between(view, other);
        let intrinsics = |camera: &PinholeCamera| {
            DMat3::from_cols(
                DVec3::X * camera.fx,
                DVec3::Y * camera.fy,
                DVec3::new(camera.cx, camera.cy, 1.0),
            )
        };
        let to_pixels = intrinsics(&other.camera);
        Self {
            image: other.image,
            homography: (to_pixels * turn * intrinsics(&view.camera).inverse()).as_mat3(),
            shift: (to_pixels * shift).as_vec3(),
        }
    }

    /// Returns the other image on the view's grid; NaN for pixels that it does not show.
    fn image(&self, inverse_depth: f64, width: usize, height: usize) -> Vec<[f32; 1]> {
        let mut warped = vec![[f32::NAN]; width * height];
        let shift = self.shift * inverse_depth as f32;
        for (row, pixels) in warped.chunks_exact_mut(width).enumerate() {
            let begin = self.homography * vec3(0.5, row as f32 + 0.5, 1.0) + shift;
            for (column, pixel) in pixels.iter_mut().enumerate() {
                let place = begin + self.homography.x_axis * column as f32;
                // Points behind the other camera have no place in its image.
                if place.z > 0.0 {
                    let scale = 1.0 / place.z;
                    *pixel = [self.image.sample(place.x * scale, place.y * scale)];
                }
            }
        }
        warped
    }
}

#[derive(Debug, Clone)]
pub(super) struct GreyImage {
    pub(super) width: usize,
    pub(super) height: usize,
    pub(super) pixels: Vec<[f32; 1]>,
}

impl GreyImage {
    /// Converts 8-bit RGB.
    pub(super) fn of_rgb8(width: usize, height: usize, bytes: &[u8]) -> Self {
        let grey = |[red, green, blue]: &[u8; 3]| {
            let [red, green, blue] = [*red, *green, *blue].map(f32::from);
            [(0.299 * red + 0.587 * green + 0.114 * blue) / 255.0]
        };
        Self {
            width,
            height,
            pixels: bytes.as_chunks::<3>().0.iter().map(grey).collect(),
        }
    }

    /// Returns the bilinear value at a place; NaN outside of the image.
    fn sample(&self, x: f32, y: f32) -> f32 {
        let (width, height) = (self.width as f32, self.height as f32);
        // Half a pixel beyond the outermost centres belongs to the image.
        if !(x >= 0.0 && y >= 0.0 && x <= width && y <= height) {
            return f32::NAN;
        }
        let (x, y) = (
            (x - 0.5).clamp(0.0, width - 1.0),
            (y - 0.5).clamp(0.0, height - 1.0),
        );
        let (left, top) = (x as usize, y as usize);
        let (fx, fy) = (x - left as f32, y - top as f32);
        let right = usize::from(left + 1 < self.width);
        let below = if top + 1 < self.height { self.width } else { 0 };
        let at = top * self.width + left;
        let pixel = |offset: usize| self.pixels[at + offset][0];
        let upper = pixel(0) + fx * (pixel(right) - pixel(0));
        let lower = pixel(below) + fx * (pixel(below + right) - pixel(below));
        upper + fy * (lower - upper)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_better_half_of_what_is_known_counts() {
        let of = |costs: [u8; 4]| better_half(&costs.map(|cost| vec![cost]), 1)[0];
        assert_eq!(of([90, 10, 200, 30]), 20);
        assert_eq!(of([UNKNOWN_COST, 10, 200, 30]), 20);
        assert_eq!(of([UNKNOWN_COST, 90, UNKNOWN_COST, 30]), 30);
        assert_eq!(of([UNKNOWN_COST, UNKNOWN_COST, 7, UNKNOWN_COST]), 7);
        assert_eq!(of([UNKNOWN_COST; 4]), NOT_SHOWN);
        assert_eq!(better_half(&[vec![5, 9]], 2), [5, 9]);
    }
}
