//! Images of one view through the response, and its VJP, in f32.
//!
//! The curve falls from white as a power of `y`, whose slope in logarithms is `e^p` in the dark and `e^(p+q)` at
//! white. It is monotone for all `p` and `q`, and the identity where both are 0:
//!
//! ```text
//! T(y) = exp(e^p (ln y - (e^q - 1) (1 - y)))      1/255 <= y <= 1
//! ```
//!
//! Below, it is the line to 0, because the slope of a power has no bound there; above 1 its tangent.

use omnilife_schemas::{RgbImage, camera::Camera, srgb};
use rayon::prelude::*;

use crate::render::raster::Raster;

/// Numbers of a curve.
pub(super) const CURVE_VALUES: usize = 2;
/// Numbers of a curve and a vignette.
pub(super) const SHARED_VALUES: usize = CURVE_VALUES + 3;
/// Level below which the curve is a line.
const DARK: f32 = 1.0 / 255.0;
/// Pixels per task, independent of the number of threads.
const PIXELS_PER_TASK: usize = 1 << 12;

/// Response at one view.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ViewResponse {
    /// Gains of light, by channel.
    gains: [f32; 3],
    /// Coefficients with the image's lens.
    vignette: Option<([f32; 3], Lens)>,
    curve: Curve,
}

/// Gradient of a loss by the response at one view.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct ResponseGradient {
    /// By the logarithms of the gains.
    pub gains: [f64; 3],
    /// By `p` and `q` of the curve, then by the coefficients of a vignette.
    pub shared: [f64; SHARED_VALUES],
}

impl ResponseGradient {
    fn plus(self, other: &Self) -> Self {
        Self {
            gains: std::array::from_fn(|at| self.gains[at] + other.gains[at]),
            shared: std::array::from_fn(|at| self.shared[at] + other.shared[at]),
        }
    }
}

impl ViewResponse {
    pub(super) fn new(
        gains: [f32; 3],
        vignette: Option<([f32; 3], Lens)>,
        curve: [f32; CURVE_VALUES],
    ) -> Self {
        Self {
            gains,
            vignette,
            curve: Curve::new(curve),
        }
    }

    /// Writes a render (HWC) as the camera shows it, not clamped.
    pub fn show(&self, render: &[f32], shown: &mut Vec<f32>) {
        shown.clear();
        shown.resize(render.len(), 0.0);
        let tasks = (
            shown.par_chunks_mut(3 * PIXELS_PER_TASK),
            render.par_chunks(3 * PIXELS_PER_TASK),
        );
        tasks
            .into_par_iter()
            .enumerate()
            .for_each(|(task, (shown, render))| {
                let colours = shown.as_chunks_mut::<3>().0.iter_mut();
                let pixels = colours.zip(render.as_chunks::<3>().0).enumerate();
                for (at, (shown, rgb)) in pixels {
                    let falloff = self.falloff(task * PIXELS_PER_TASK + at).1;
                    *shown = std::array::from_fn(|channel| {
                        let lit = GainLevel::new(rgb[channel], falloff * self.gains[channel]);
                        self.curve.at(lit.level).shown
                    });
                }
            });
    }

    /// Returns a raster as the camera shows it, clamped to [0, 1].
    pub fn image(&self, raster: &Raster) -> RgbImage {
        let mut data = Vec::new();
        self.show(&raster.colour, &mut data);
        for value in &mut data {
            *value = value.clamp(0.0, 1.0);
        }
        RgbImage {
            width: raster.width,
            height: raster.height,
            data,
        }
    }

    /// Computes the VJP of [`ViewResponse::show`]: writes the gradient by the render from that by the shown image, and
    /// returns that by the response. Sums do not depend on the number of threads.
    pub fn show_vjp(
        &self,
        render: &[f32],
        by_shown: &[f32],
        by_render: &mut Vec<f32>,
    ) -> ResponseGradient {
        by_render.clear();
        by_render.resize(render.len(), 0.0);
        let tasks = (
            by_render.par_chunks_mut(3 * PIXELS_PER_TASK),
            render.par_chunks(3 * PIXELS_PER_TASK),
            by_shown.par_chunks(3 * PIXELS_PER_TASK),
        );
        let sums: Vec<ResponseGradient> = tasks
            .into_par_iter()
            .enumerate()
            .map(|(task, (by_render, render, by_shown))| {
                let mut sum = ResponseGradient::default();
                let colours = render.as_chunks::<3>().0.iter();
                let pixels = colours.zip(by_shown.as_chunks::<3>().0);
                let pixels = by_render.as_chunks_mut::<3>().0.iter_mut().zip(pixels);
                for (at, (by_render, (rgb, by_shown))) in pixels.enumerate() {
                    let pixel = task * PIXELS_PER_TASK + at;
                    *by_render = self.pixel_vjp(pixel, (rgb, by_shown), &mut sum);
                }
                sum
            })
            .collect();
        let none = ResponseGradient::default();
        sums.iter().fold(none, ResponseGradient::plus)
    }

    /// Returns the gradient by a pixel of the render, and adds that by the response.
    fn pixel_vjp(
        &self,
        pixel: usize,
        (rgb, by_shown): (&[f32; 3], &[f32; 3]),
        sum: &mut ResponseGradient,
    ) -> [f32; 3] {
        let (radius, falloff) = self.falloff(pixel);
        let mut by_falloff = 0.0;
        let by_render = std::array::from_fn(|channel| {
            let lit = GainLevel::new(rgb[channel], falloff * self.gains[channel]);
            let toned = self.curve.at(lit.level);
            let by_level = by_shown[channel] * toned.slope;
            let by_gain = f64::from(by_level * lit.by_log_gain);
            sum.gains[channel] += by_gain;
            by_falloff += by_gain;
            sum.shared[0] += f64::from(by_shown[channel] * toned.by_exponent);
            sum.shared[1] += f64::from(by_shown[channel] * toned.by_white);
            by_level * lit.by_render
        });
        let mut power = f64::from(radius);
        for by in &mut sum.shared[CURVE_VALUES..] {
            *by += by_falloff * power;
            power *= f64::from(radius);
        }
        by_render
    }

    /// Returns the squared radius of a pixel, and the share of the light that its vignette lets through; 0 and 1 for a
    /// view without a vignette.
    fn falloff(&self, pixel: usize) -> (f32, f32) {
        let Some(([a1, a2, a3], lens)) = &self.vignette else {
            return (0.0, 1.0);
        };
        let radius = lens.squared_radius(pixel);
        (radius, (radius * (a1 + radius * (a2 + radius * a3))).exp())
    }
}

/// Level of a render under a gain, with its derivatives.
struct GainLevel {
    level: f32,
    /// By the level of the render.
    by_render: f32,
    /// By the logarithm of the gain.
    by_log_gain: f32,
}

impl GainLevel {
    /// Computes `y` of a level `x` under a gain: with light `L = l(x)`, `dy/dx = y'(g L) g l'(x)`. Slopes of both
    /// branches of sRGB follow from their values.
    fn new(render: f32, gain: f32) -> Self {
        let light = srgb::to_linear(render);
        let lit = gain * light;
        let level = srgb::from_linear(lit);
        let of_light = if render <= 0.040_45 {
            1.0 / 12.92
        } else {
            2.4 * light / (render + 0.055)
        };
        let of_level = if lit <= 0.003_130_8 {
            12.92
        } else {
            (level + 0.055) / (2.4 * lit)
        };
        Self {
            level,
            by_render: of_level * gain * of_light,
            by_log_gain: of_level * lit,
        }
    }
}

#[derive(Debug, Clone, Copy, PartialEq)]
struct Curve {
    /// `e^p`.
    exponent: f32,
    /// `e^q`.
    white: f32,
}

/// Level of the curve with its derivatives.
struct CurveLevel {
    shown: f32,
    slope: f32,
    /// By `p`.
    by_exponent: f32,
    /// By `q`.
    by_white: f32,
}

impl Curve {
    fn new(values: [f32; CURVE_VALUES]) -> Self {
        let [exponent, white] = values.map(f32::exp);
        Self { exponent, white }
    }

    fn at(&self, level: f32) -> CurveLevel {
        if level > 1.0 {
            let slope = self.exponent * self.white;
            let above = slope * (level - 1.0);
            return CurveLevel {
                shown: 1.0 + above,
                slope,
                by_exponent: above,
                by_white: above,
            };
        }
        if level < DARK {
            let (edge, share) = (self.within(DARK), level / DARK);
            return CurveLevel {
                shown: share * edge.shown,
                slope: edge.shown / DARK,
                by_exponent: share * edge.by_exponent,
                by_white: share * edge.by_white,
            };
        }
        self.within(level)
    }

    /// Evaluates the formula of the module's documentation.
    fn within(&self, level: f32) -> CurveLevel {
        let (further, below) = (self.white - 1.0, 1.0 - level);
        let log = self.exponent * (level.ln() - further * below);
        let shown = log.exp();
        CurveLevel {
            shown,
            slope: shown * self.exponent * (1.0 / level + further),
            by_exponent: shown * log,
            by_white: -shown * self.exponent * self.white * below,
        }
    }
}

/// Place of a pinhole's axis in its image.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Lens {
    width: usize,
    /// Principal point, pixels.
    centre: [f32; 2],
    /// One over the squared distance of the farthest corner from it.
    per_square: f32,
}

impl Lens {
    /// Returns the lens of a pinhole; `None` for a panorama, which is stitched from several.
    pub(super) fn of(camera: &Camera) -> Option<Self> {
        let Camera::Pinhole(pinhole) = camera else {
            return None;
        };
        let reach = |centre: f64, pixels: u32| centre.abs().max((f64::from(pixels) - centre).abs());
        let farthest =
            reach(pinhole.cx, pinhole.width).powi(2) + reach(pinhole.cy, pinhole.height).powi(2);
        Some(Self {
            width: pinhole.width as usize,
            centre: [pinhole.cx as f32, pinhole.cy as f32],
            per_square: (1.0 / farthest) as f32,
        })
    }

    /// Returns the squared distance of a pixel's centre from the axis: 0 there, 1 in the farthest corner.
    fn squared_radius(&self, pixel: usize) -> f32 {
        let [column, row] = [pixel % self.width, pixel / self.width].map(|at| at as f32 + 0.5);
        let [across, along] = [column - self.centre[0], row - self.centre[1]];
        self.per_square * (across * across + along * along)
    }
}
