//! Grey images of the sphere that are sampled by direction.

use std::f32::consts::{PI, TAU};

use glam::Vec3;
use omnilife_schemas::RgbImage;

/// A grey equirectangular image and its smaller copies, each half the size of the one before.
#[derive(Debug, Clone)]
pub struct GreySphere {
    levels: Vec<Level>,
}

#[derive(Debug, Clone)]
struct Level {
    width: usize,
    height: usize,
    data: Vec<f32>,
}

impl GreySphere {
    /// Takes the luma (BT.709) of an ERP image at `width` x `width / 2` pixels, with smaller copies down to 32 pixels
    /// across.
    pub fn new(image: &RgbImage, width: usize) -> Self {
        let small = image.resized_by_area(width, width / 2);
        let (pixels, _) = small.data.as_chunks::<3>();
        let luma = pixels
            .iter()
            .map(|[r, g, b]| 0.2126 * r + 0.7152 * g + 0.0722 * b);
        Self::of_luma(width, luma.collect())
    }

    /// Creates it from grey values, row-major, `width / 2` rows of them.
    pub fn of_luma(width: usize, luma: Vec<f32>) -> Self {
        let mut levels = vec![Level {
            width,
            height: width / 2,
            data: luma,
        }];
        while let Some(last) = levels.last().filter(|level| level.width >= 64) {
            let halved = last.halved();
            levels.push(halved);
        }
        Self { levels }
    }

    /// Returns the grey values of the largest level, row-major.
    pub fn luma(&self) -> &[f32] {
        &self.levels[0].data
    }

    /// Returns the number of levels, the largest first.
    pub fn levels(&self) -> usize {
        self.levels.len()
    }

    /// Columns of a level.
    pub fn width(&self, level: usize) -> usize {
        self.levels[level].width
    }

    /// Returns the angle that a pixel of a level spans at the equator, radians.
    pub fn pixel_radians(&self, level: usize) -> f32 {
        TAU / self.levels[level].width as f32
    }

    /// Returns the bilinear value in a direction of any length except zero, across the seam and up to the poles.
    pub fn sample(&self, level: usize, direction: Vec3) -> f32 {
        let level = &self.levels[level];
        let (width, height) = (level.width as f32, level.height as f32);
        let longitude = direction.x.atan2(direction.z);
        let latitude = (-direction.y).atan2(direction.x.hypot(direction.z));
        let x = (longitude / TAU + 0.5) * width - 0.5;
        let y = ((0.5 - latitude / PI) * height - 0.5).clamp(0.0, height - 1.0);
        let (x0, y0) = (x.floor(), y.floor());
        let (fx, fy) = (x - x0, y - y0);
        let left = (x0 as i64).rem_euclid(level.width as i64) as usize;
        let right = (left + 1) % level.width;
        let top = y0 as usize;
        let bottom = (top + 1).min(level.height - 1);
        let at = |column: usize, row: usize| level.data[row * level.width + column];
        let upper = at(left, top) * (1.0 - fx) + at(right, top) * fx;
        let lower = at(left, bottom) * (1.0 - fx) + at(right, bottom) * fx;
        upper * (1.0 - fy) + lower * fy
    }
}

impl Level {
    fn halved(&self) -> Self {
        let (width, height) = (self.width / 2, self.height / 2);
        let mut data = Vec::with_capacity(width * height);
        for y in 0..height {
            for x in 0..width {
                let at = |dx, dy| self.data[(2 * y + dy) * self.width + 2 * x + dx];
                data.push(0.25 * (at(0, 0) + at(1, 0) + at(0, 1) + at(1, 1)));
            }
        }
        Self {
            width,
            height,
            data,
        }
    }
}

/// Returns two unit directions that span the tangent plane at a unit direction.
pub(super) fn tangents(direction: Vec3) -> (Vec3, Vec3) {
    direction.any_orthonormal_pair()
}

/// Returns `count` directions spread evenly over the sphere (a Fibonacci lattice).
pub(crate) fn even_directions(count: usize) -> impl Iterator<Item = Vec3> {
    let golden = PI * (3.0 - 5.0_f32.sqrt());
    (0..count).map(move |index| {
        let y = 1.0 - 2.0 * (index as f32 + 0.5) / count as f32;
        let radius = (1.0 - y * y).sqrt();
        let (sin, cos) = (golden * index as f32).sin_cos();
        Vec3::new(radius * cos, y, radius * sin)
    })
}
