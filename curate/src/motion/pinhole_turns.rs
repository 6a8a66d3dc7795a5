//! Rotations of a perspective camera from frame to frame, from the images alone.
//!
//! A rotating camera maps images to each other by the homography `K R K^-1`. Neighbouring frames are registered by it
//! directly: Gauss-Newton minimizes the sum of robust squared differences of luma over the rotation vector. It goes
//! from coarse images to fine ones, over pixels without masks in the first frame. The focal length is the one of a grid
//! whose registrations leave the least cost. If the camera also translates, the result is the rotation that explains
//! most of it; [`remainder()`] measures what that leaves.

mod remainder;

use glam::{DMat3, DQuat, DVec2, DVec3};
use rayon::prelude::*;

pub use remainder::remainder;
#[cfg(test)]
pub(crate) use remainder::tests as flat_ground;

/// Width of the finest images that are registered, at most.
const FINEST: usize = 320;
/// Width of the coarsest.
const COARSEST: usize = 40;
/// Focal lengths that are tried, over the width.
pub const FOCALS: [f64; 8] = [0.6, 0.75, 0.9, 1.1, 1.35, 1.65, 2.0, 2.5];
/// A difference of luma beyond which a pixel counts less, of 255.
const HUBER: f64 = 6.0;
/// Difference of luma below which a pixel fits, of 255.
const FITS: f64 = 16.0;
/// Steps of Gauss-Newton at each size of images.
const STEPS: usize = 12;

/// A grey image with its usable pixels.
#[derive(Debug, Clone)]
pub struct GreyFrame {
    /// Pixels per row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Luma, [0, 255].
    pub luma: Vec<f32>,
    /// Pixels that no moving content covers.
    pub open: Vec<bool>,
}

/// The rotations of a clip.
#[derive(Debug, Clone, PartialEq)]
pub struct Turns {
    /// Camera to the first frame's camera.
    pub rotations: Vec<DQuat>,
    /// Focal length over the images' width.
    pub focal: f64,
    /// The least share of pixels that fit, over all neighbouring frames.
    pub least_fit: f64,
    /// Sum of the shifts of the image's middle, in widths.
    pub path: f64,
    /// Sum of the mean robust costs of a pixel, over all neighbouring frames.
    pub cost: f64,
}

/// A frame and its copies, each at half the size of the one before.
struct Pyramid(Vec<GreyFrame>);

impl GreyFrame {
    fn halved(&self) -> Self {
        let (width, height) = (self.width / 2, self.height / 2);
        let at = |x: usize, y: usize| y * self.width + x;
        let four = |pixel: usize| {
            let (x, y) = (2 * (pixel % width), 2 * (pixel / width));
            [at(x, y), at(x + 1, y), at(x, y + 1), at(x + 1, y + 1)]
        };
        let pixels = 0..width * height;
        Self {
            width,
            height,
            luma: pixels
                .clone()
                .map(|pixel| four(pixel).iter().map(|&p| self.luma[p]).sum::<f32>() / 4.0)
                .collect(),
            open: pixels
                .map(|pixel| four(pixel).iter().all(|&p| self.open[p]))
                .collect(),
        }
    }

    /// Returns luma and its derivatives at a place in pixels (whole numbers are centres). `None` at the border and if
    /// moving content covers one of the four pixels around it. Half of its outline lies outside of its place in the
    /// other frame, and its edge would bias the result.
    fn sample(&self, at: DVec2) -> Option<(f64, DVec2)> {
        let floor = at.floor();
        let is_inside = floor.x >= 0.0
            && floor.y >= 0.0
            && floor.x < (self.width - 1) as f64
            && floor.y < (self.height - 1) as f64;
        if !is_inside {
            return None;
        }
        let part = at - floor;
        let first = floor.y as usize * self.width + floor.x as usize;
        let around = [first, first + 1, first + self.width, first + self.width + 1];
        if !around.iter().all(|&pixel| self.open[pixel]) {
            return None;
        }
        let [a, b, c, d] = around.map(|pixel| f64::from(self.luma[pixel]));
        let value = (1.0 - part.y) * ((1.0 - part.x) * a + part.x * b)
            + part.y * ((1.0 - part.x) * c + part.x * d);
        let by_x = (1.0 - part.y) * (b - a) + part.y * (d - c);
        let by_y = (1.0 - part.x) * (c - a) + part.x * (d - b);
        Some((value, DVec2::new(by_x, by_y)))
    }
}

impl Pyramid {
    fn of(frame: &GreyFrame) -> Self {
        let mut levels = vec![frame.clone()];
        while let Some(last) = levels.last().filter(|last| last.width > FINEST) {
            levels = vec![last.halved()];
        }
        while let Some(last) = levels.last().filter(|last| last.width >= 2 * COARSEST) {
            levels.push(last.halved());
        }
        Self(levels)
    }
}

/// Result of a registration.
#[derive(Debug, Clone, Copy)]
struct Fit {
    /// From the first camera to the second.
    rotation: DQuat,
    /// Mean robust cost of a pixel.
    cost: f64,
    /// Share of the pixels that fit.
    share: f64,
}

/// Returns cost, fitting share, and the normal equations at a rotation from the first frame to the second.
fn normal_equations(
    first: &GreyFrame,
    second: &GreyFrame,
    focal: f64,
    rotation: DQuat,
) -> (f64, f64, DMat3, DVec3) {
    let focal = focal * first.width as f64;
    let middle = 0.5 * DVec2::new(first.width as f64 - 1.0, first.height as f64 - 1.0);
    let turn = DMat3::from_quat(rotation);
    let mut matrix = DMat3::ZERO;
    let (mut right, mut cost, mut fitting, mut count) = (DVec3::ZERO, 0.0, 0.0, 0.0);
    for pixel in (0..first.luma.len()).filter(|&pixel| first.open[pixel]) {
        let place = DVec2::new((pixel % first.width) as f64, (pixel / first.width) as f64);
        let point = turn * ((place - middle) / focal).extend(1.0);
        if point.z < 0.1 {
            continue;
        }
        let at = focal * point.truncate() / point.z + middle;
        let Some((luma, by_place)) = second.sample(at) else {
            continue;
        };
        let residual = luma - f64::from(first.luma[pixel]);
        let weight = (HUBER / residual.abs().max(HUBER)).min(1.0);
        // d(point) = omega x point.
        let by_point = DVec3::new(
            by_place.x,
            by_place.y,
            -(by_place.x * point.x + by_place.y * point.y) / point.z,
        ) * (focal / point.z);
        let by_turn = point.cross(by_point);
        matrix += weight
            * DMat3::from_cols(
                by_turn * by_turn.x,
                by_turn * by_turn.y,
                by_turn * by_turn.z,
            );
        right += weight * residual * by_turn;
        cost += if residual.abs() <= HUBER {
            0.5 * residual * residual
        } else {
            HUBER * (residual.abs() - 0.5 * HUBER)
        };
        fitting += f64::from(u8::from(residual.abs() < FITS));
        count += 1.0;
    }
    let count = f64::max(count, 1.0);
    (cost / count, fitting / count, matrix, right)
}

/// Registers the second frame to the first, starting from a guess.
fn register(first: &Pyramid, second: &Pyramid, focal: f64, guess: DQuat) -> Fit {
    let mut rotation = guess;
    let mut last = Fit {
        rotation,
        cost: f64::INFINITY,
        share: 0.0,
    };
    for (first, second) in first.0.iter().zip(&second.0).rev() {
        let mut best = f64::INFINITY;
        let mut kept = rotation;
        for _ in 0..STEPS {
            let (cost, share, matrix, right) = normal_equations(first, second, focal, rotation);
            if cost > best {
                break;
            }
            best = cost;
            kept = rotation;
            last = Fit {
                rotation,
                cost,
                share,
            };
            let trace = matrix.col(0).x + matrix.col(1).y + matrix.col(2).z;
            if trace <= 0.0 {
                break;
            }
            let damped = matrix + DMat3::from_diagonal(DVec3::splat(1e-6 * trace));
            let step = -(damped.inverse() * right);
            if !step.is_finite() || step.length() < 1e-7 {
                break;
            }
            rotation = (DQuat::from_scaled_axis(step.clamp_length_max(0.1)) * rotation).normalize();
        }
        rotation = kept;
    }
    last
}

/// Returns the chain of registrations at a focal length.
fn chain(pyramids: &[Pyramid], focal: f64) -> Vec<Fit> {
    let mut guess = DQuat::IDENTITY;
    pyramids
        .windows(2)
        .map(|pair| {
            // From the last pair's result, or from zero: cameras start and stop.
            let kept = register(&pair[0], &pair[1], focal, guess);
            let anew = register(&pair[0], &pair[1], focal, DQuat::IDENTITY);
            let fit = if kept.cost <= anew.cost { kept } else { anew };
            guess = fit.rotation;
            fit
        })
        .collect()
}

/// Estimates the rotations of a clip. `focal` is the focal length over the width if known.
pub fn turns(frames: &[GreyFrame], focal: Option<f64>) -> Turns {
    let pyramids: Vec<Pyramid> = frames.par_iter().map(Pyramid::of).collect();
    let cost = |fits: &[Fit]| fits.iter().map(|fit| fit.cost).sum::<f64>();
    let tried: Vec<f64> = focal.map_or_else(|| FOCALS.to_vec(), |focal| vec![focal]);
    let chains: Vec<(f64, Vec<Fit>)> = tried
        .into_par_iter()
        .map(|focal| (focal, chain(&pyramids, focal)))
        .collect();
    let least = chains
        .iter()
        .map(|(_, fits)| cost(fits))
        .fold(f64::INFINITY, f64::min);
    // A static camera does not determine its focal length: then it is the one nearest to a width.
    let from_width = |focal: f64| focal.ln().abs();
    let found = chains
        .into_iter()
        .filter(|(_, fits)| cost(fits) <= 1.001 * least + 1e-9)
        .min_by(|a, b| from_width(a.0).total_cmp(&from_width(b.0)));
    let (focal, fits) = found.unwrap_or((1.0, Vec::new()));
    let mut rotations = vec![DQuat::IDENTITY];
    let mut path = 0.0;
    for fit in &fits {
        let last = rotations.last().copied().unwrap_or(DQuat::IDENTITY);
        rotations.push((last * fit.rotation.inverse()).normalize());
        let middle = fit.rotation * DVec3::Z;
        path += focal * (middle.truncate() / middle.z.max(0.1)).length();
    }
    rotations.truncate(frames.len());
    Turns {
        rotations,
        focal,
        least_fit: fits.iter().map(|fit| fit.share).fold(1.0, f64::min),
        path,
        cost: cost(&fits),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const WIDTH: usize = 96;
    const HEIGHT: usize = 64;

    /// Returns the view of a texture at infinity; a square in the middle moves by itself.
    fn frame(rotation: DQuat, focal: f64, number: usize) -> GreyFrame {
        let middle = 0.5 * DVec2::new(WIDTH as f64 - 1.0, HEIGHT as f64 - 1.0);
        let mut open = vec![true; WIDTH * HEIGHT];
        let luma = (0..WIDTH * HEIGHT).map(|pixel| {
            let place = DVec2::new((pixel % WIDTH) as f64, (pixel / WIDTH) as f64);
            let direction = rotation * ((place - middle) / (focal * WIDTH as f64)).extend(1.0);
            let at = direction.truncate() / direction.z;
            let wave = (14.0 * at.x + 5.0 * at.y).sin() + (9.0 * at.y - 4.0 * at.x).cos();
            128.0 + 40.0 * wave as f32
        });
        let mut luma: Vec<f32> = luma.collect();
        for row in 20..36 {
            for column in 30 + 3 * number..46 + 3 * number {
                luma[row * WIDTH + column] = 250.0;
                open[row * WIDTH + column] = false;
            }
        }
        GreyFrame {
            width: WIDTH,
            height: HEIGHT,
            luma,
            open,
        }
    }

    #[test]
    fn turns_and_focal_length_come_back() {
        let truth: Vec<DQuat> = (0..6)
            .map(|number| {
                let angle = f64::from(number);
                DQuat::from_scaled_axis(DVec3::new(0.02 * angle, 0.08 * angle, 0.01 * angle))
            })
            .collect();
        let frames: Vec<GreyFrame> = truth
            .iter()
            .enumerate()
            .map(|(number, &rotation)| frame(rotation, 0.9, number))
            .collect();
        let found = turns(&frames, None);
        assert!((found.focal - 0.9).abs() < 1e-9, "{}", found.focal);
        assert!(found.least_fit > 0.95, "{}", found.least_fit);
        // The square that moves by itself leaves the chain alone, in either frame of a pair.
        for (found, truth) in found.rotations.iter().zip(&truth) {
            let pixels = found.angle_between(*truth) * 0.9 * WIDTH as f64;
            assert!(pixels < 0.03, "{pixels} pixels");
        }
        let still = vec![frames[0].clone(); 3];
        let found = turns(&still, Some(1.0));
        assert!(found.path * (WIDTH as f64) < 0.1 && found.least_fit > 0.999);
    }

    #[test]
    fn images_of_different_things_do_not_fit() {
        let other = |number: usize| frame(DQuat::from_rotation_y(0.9 * number as f64), 0.9, 0);
        let frames: Vec<GreyFrame> = (0..3).map(other).collect();
        assert!(turns(&frames, Some(0.9)).least_fit < 0.8);
    }
}
