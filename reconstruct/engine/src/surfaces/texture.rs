//! Images on surfaces, interpolated linearly between texels, with derivatives by the position.

use glam::{DVec2, DVec3};

/// Values beyond the outermost texels.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TextureEdge {
    /// Zeros.
    Zero,
    /// The outermost texel.
    Border,
    /// An ERP image: columns wrap, and a row beyond a pole is the one half a turn away.
    Sphere,
}

/// An image with `C` channels, row-major.
#[derive(Debug, Clone, PartialEq)]
pub struct Texture<const C: usize> {
    /// Texels across.
    pub width: usize,
    /// Rows of texels.
    pub height: usize,
    /// `width * height` texels.
    pub texels: Vec<[f32; C]>,
}

/// Interpolated value at a position, with its derivatives by the position.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sample<const C: usize> {
    /// Value per channel.
    pub value: [f64; C],
    /// Derivatives by the first coordinate.
    pub by_u: [f64; C],
    /// Derivatives by the second coordinate.
    pub by_v: [f64; C],
}

impl<const C: usize> Texture<C> {
    /// Creates a texture of one value.
    pub fn constant(width: usize, height: usize, value: [f32; C]) -> Self {
        Self {
            width,
            height,
            texels: vec![value; width * height],
        }
    }

    fn texel(&self, column: i64, row: i64, beyond: TextureEdge) -> [f32; C] {
        let (width, height) = (self.width as i64, self.height as i64);
        let (column, row) = match beyond {
            TextureEdge::Sphere => {
                let (row, half) = if row < 0 {
                    (-1 - row, width / 2)
                } else if row >= height {
                    (2 * height - 1 - row, width / 2)
                } else {
                    (row, 0)
                };
                ((column + half).rem_euclid(width), row.clamp(0, height - 1))
            }
            TextureEdge::Border => (column.clamp(0, width - 1), row.clamp(0, height - 1)),
            TextureEdge::Zero => {
                if !(0..width).contains(&column) || !(0..height).contains(&row) {
                    return [0.0; C];
                }
                (column, row)
            }
        };
        self.texels[(row * width + column) as usize]
    }

    /// Interpolates at a position in texels; whole numbers are texel centres.
    fn sample_texels(&self, at: DVec2, beyond: TextureEdge) -> Sample<C> {
        let floor = at.floor();
        let [fx, fy] = (at - floor).to_array();
        let (column, row) = (floor.x as i64, floor.y as i64);
        let corner = |dx, dy| self.texel(column + dx, row + dy, beyond);
        let corners = [corner(0, 0), corner(1, 0), corner(0, 1), corner(1, 1)];
        let mut sample = Sample {
            value: [0.0; C],
            by_u: [0.0; C],
            by_v: [0.0; C],
        };
        for channel in 0..C {
            let [a, b, c, d] = corners.map(|texel| f64::from(texel[channel]));
            sample.value[channel] =
                (1.0 - fy) * ((1.0 - fx) * a + fx * b) + fy * ((1.0 - fx) * c + fx * d);
            sample.by_u[channel] = (1.0 - fy) * (b - a) + fy * (d - c);
            sample.by_v[channel] = (1.0 - fx) * (c - a) + fx * (d - b);
        }
        sample
    }

    /// Interpolates at `uv`; 0 and 1 are the centres of the outermost texels.
    pub fn sample(&self, uv: DVec2, beyond: TextureEdge) -> Sample<C> {
        let scale = DVec2::new(
            self.width.saturating_sub(1) as f64,
            self.height.saturating_sub(1) as f64,
        );
        let mut sample = self.sample_texels(
            uv.clamp(DVec2::splat(-1e6), DVec2::splat(1e6)) * scale,
            beyond,
        );
        sample.by_u = sample.by_u.map(|value| value * scale.x);
        sample.by_v = sample.by_v.map(|value| value * scale.y);
        sample
    }

    /// Interpolates at a unit direction of an ERP image: longitude `atan2(x, z)` grows to the right, latitude
    /// `asin(-y)` upwards; texel centres are at halves. The derivatives are those by the direction's
    /// components along the horizon and down; see [`direction_gradient`].
    pub fn sample_direction(&self, direction: DVec3) -> Sample<C> {
        use std::f64::consts::{PI, TAU};
        let longitude = direction.x.atan2(direction.z);
        let across = direction.x.hypot(direction.z);
        let latitude = (-direction.y).atan2(across);
        let (width, height) = (self.width as f64, self.height as f64);
        let at = DVec2::new(
            (longitude / TAU + 0.5) * width - 0.5,
            (0.5 - latitude / PI) * height - 0.5,
        );
        let mut sample = self.sample_texels(at, TextureEdge::Sphere);
        let per_radian = width / TAU / across.max(1e-6);
        sample.by_u = sample.by_u.map(|value| value * per_radian);
        sample.by_v = sample.by_v.map(|value| value * height / PI);
        sample
    }
}

/// Returns the gradient by a unit direction from those along the horizon and down of
/// [`Texture::sample_direction`].
pub fn direction_gradient(direction: DVec3, along: f64, down: f64) -> DVec3 {
    let across = direction.x.hypot(direction.z);
    let (sin, cos) = if across > 0.0 {
        (direction.x / across, direction.z / across)
    } else {
        (0.0, 1.0)
    };
    let horizon = DVec3::new(cos, 0.0, -sin);
    let downwards = DVec3::new(-direction.y * sin, across, -direction.y * cos);
    along * horizon + down * downwards
}
