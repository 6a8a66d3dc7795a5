//! Robust alignment of a template with another patch by a similarity of the plane.
//!
//! ```text
//! min sum w(e) e^2      e = I(W(x)) - T(x) - [ J(x)' grad T(x), T(x), 1 ] z      z = (a, b, tau, gain, offset)
//! J(x) = [ x -y 1 0 ]   D(x) = (1 + a + i b) x + tau                             W <- W o D^-1
//!        [ y  x 0 1 ]
//! ```
//!
//! Inverse compositional Lucas-Kanade with Tukey's weights: S. Baker, I. Matthews, "Lucas-Kanade 20 Years On", IJCV
//! 56 (2004), section 3.2, and part 2 (CMU-RI-TR-03-01) for the weights and for changes of brightness. Positions
//! are complex numbers.
//!
//! Patches of vehicles have an alignment of their own (`reconstruct/training/src/alignment.rs`): a rigid motion without
//! a scale, and its covariance. A mask's texture also gets nearer and changes its contrast.

use glam::DVec2;
use omnilife_schemas::{
    band_matrix::BandMatrix,
    statistics::{TUKEY, tukey_weight},
};

use super::patch::Patch;
use crate::robust::sigma_of;

/// Unknowns of a step.
const UNKNOWNS: usize = 6;
/// Maximum number of points of a template.
const MOST_POINTS: usize = 1500;
/// Minimum number of points of a template, and of seen ones.
const LEAST_POINTS: usize = 24;
/// Steps on one level, at most.
const STEPS: usize = 30;
/// Movement in samples below which a level is done.
const STILL: f64 = 0.01;
/// Minimum standard deviation of grey values' errors.
const LEAST_SIGMA: f64 = 0.01;
/// Errors beyond this share of the template's contrast (its standard deviation) do not agree.
const AGREEING: f64 = 0.5;
/// Minimum contrast of a template.
const LEAST_CONTRAST: f64 = 0.02;
/// Bounds of the change of brightness: a flat image must not explain a texture.
const GAINS: [f64; 2] = [-0.5, 1.0];
/// Standard deviation of a shift without evidence, samples.
const BELIEVED_SHIFT: f64 = 5.0;
/// Standard deviation of gain and offset without evidence.
const BELIEVED_LIGHT: f64 = 0.5;
/// Bounds of a change of scale.
const SCALES: [f64; 2] = [0.1, 10.0];

/// Similarity of the plane: `turn * x + shift`, in complex numbers.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PlanarSimilarity {
    /// Scale and rotation.
    pub turn: DVec2,
    /// Image of the origin.
    pub shift: DVec2,
}

/// Returns the product of two complex numbers.
pub fn product(a: DVec2, b: DVec2) -> DVec2 {
    DVec2::new(a.x * b.x - a.y * b.y, a.x * b.y + a.y * b.x)
}

/// Returns the quotient of two complex numbers.
pub fn quotient(a: DVec2, b: DVec2) -> DVec2 {
    product(a, DVec2::new(b.x, -b.y)) / b.length_squared()
}

impl PlanarSimilarity {
    /// Returns the similarity with this scale, rotation (radians) and shift.
    pub fn new(scale: f64, angle: f64, shift: DVec2) -> Self {
        Self {
            turn: scale * DVec2::from_angle(angle),
            shift,
        }
    }

    /// Returns the factor of lengths.
    pub fn scale(&self) -> f64 {
        self.turn.length()
    }

    /// Returns the rotation, radians.
    pub fn angle(&self) -> f64 {
        self.turn.y.atan2(self.turn.x)
    }

    /// Returns the image of a position.
    pub fn apply(&self, at: DVec2) -> DVec2 {
        product(self.turn, at) + self.shift
    }

    /// Returns the similarity that applies `first`, then this one.
    #[must_use]
    pub fn after(&self, first: &Self) -> Self {
        Self {
            turn: product(self.turn, first.turn),
            shift: self.apply(first.shift),
        }
    }

    /// Returns the inverse.
    #[must_use]
    pub fn inverse(&self) -> Self {
        let turn = quotient(DVec2::X, self.turn);
        Self {
            turn,
            shift: -product(turn, self.shift),
        }
    }
}

#[derive(Debug, Clone, Copy)]
struct TemplatePoint {
    /// Position around the template's centre.
    place: DVec2,
    grey: f64,
    /// Derivatives of the grey value by the unknowns.
    row: [f64; UNKNOWNS],
}

/// Texture inside of a mask, with its derivatives.
#[derive(Debug, Clone)]
pub struct Template {
    points: Vec<TemplatePoint>,
    /// Distance of neighbouring samples.
    step: f64,
    /// Root mean square of the points' distances from the centre.
    radius: f64,
    /// Standard deviation of its grey values.
    contrast: f64,
}

impl Template {
    /// Makes a template of the inside of a patch, around `centre`; `None` where it has too few samples.
    pub fn of(patch: &Patch, centre: DVec2) -> Option<Self> {
        let inside: Vec<usize> = (0..patch.width * patch.height)
            .filter(|&sample| patch.is_inside(sample))
            .collect();
        if inside.len() < LEAST_POINTS {
            return None;
        }
        // Whole rows and columns would alias with stripes: an odd stride meets rows at different columns.
        let stride = inside.len().div_ceil(MOST_POINTS) | 1;
        let point = |&sample: &usize| {
            let place = patch.place(sample) - centre;
            let across = patch.grey[sample + 1] - patch.grey[sample - 1];
            let down = patch.grey[sample + patch.width] - patch.grey[sample - patch.width];
            let gradient = DVec2::new(across, down) / (2.0 * patch.step);
            let grey = patch.grey[sample];
            TemplatePoint {
                place,
                grey,
                row: [
                    gradient.dot(place),
                    gradient.dot(DVec2::new(-place.y, place.x)),
                    gradient.x,
                    gradient.y,
                    grey,
                    1.0,
                ],
            }
        };
        let points: Vec<TemplatePoint> = inside.iter().step_by(stride).map(point).collect();
        let count = points.len() as f64;
        let mean = points.iter().map(|point| point.grey).sum::<f64>() / count;
        let variance = points.iter().map(|point| (point.grey - mean).powi(2));
        let squares = points.iter().map(|point| point.place.length_squared());
        Some(Self {
            contrast: (variance.sum::<f64>() / count).sqrt().max(LEAST_CONTRAST),
            radius: (squares.sum::<f64>() / count).sqrt(),
            step: patch.step,
            points,
        })
    }

    /// Returns the standard deviation of errors by their median. It is at most what lets errors as large as the
    /// contrast count: a foreign thing inside of the mask must not be a part of the first step.
    fn sigma_of(&self, errors: &[f64]) -> f64 {
        sigma_of(errors).min(self.contrast / TUKEY).max(LEAST_SIGMA)
    }

    /// Returns the weighted normal matrix of some points. A weak belief that unknowns are 0 keeps what the texture
    /// does not tell, such as a shift along a stripe.
    fn normal_matrix<'a>(
        &self,
        points: impl Iterator<Item = (&'a TemplatePoint, f64)>,
        sigma: f64,
    ) -> BandMatrix {
        let mut matrix = BandMatrix::new(UNKNOWNS, UNKNOWNS - 1);
        let shift = BELIEVED_SHIFT * self.step;
        let believed = [1.0, 1.0, shift, shift, BELIEVED_LIGHT, BELIEVED_LIGHT];
        for (unknown, believed) in believed.into_iter().enumerate() {
            matrix.add(unknown, unknown, (sigma / believed).powi(2));
        }
        for (point, weight) in points {
            for row in 0..UNKNOWNS {
                for column in 0..=row {
                    matrix.add(row, column, weight * point.row[row] * point.row[column]);
                }
            }
        }
        matrix
    }

    /// Makes templates of the levels of a pyramid, while they have enough samples.
    pub fn pyramid(levels: &[Patch], centre: DVec2) -> Vec<Self> {
        let templates = levels.iter().map(|level| Self::of(level, centre));
        templates.map_while(|template| template).collect()
    }
}

/// A similarity under which a template agrees with a patch.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Aligned {
    /// From positions around the template's centre to those of the patch.
    pub motion: PlanarSimilarity,
    /// Share of the template's points inside of the other mask.
    pub seen: f64,
    /// Agreement of these, [0, 1].
    pub agreement: f64,
    /// Standard deviation of scale and rotation by the errors, radians; 1 where the texture does not tell.
    pub uncertainty: f64,
}

impl Aligned {
    /// Returns the agreeing share of the template, in view or not.
    fn explained(&self) -> f64 {
        self.seen * self.agreement
    }
}

/// Aligns the levels of a template with those of a patch, from the best of some first guesses. The coarsest level on
/// which enough is seen decides which that is. `None` where too little is seen from all of them.
pub fn aligned(
    template: &[Template],
    target: &[Patch],
    starts: &[PlanarSimilarity],
) -> Option<Aligned> {
    let levels = template.len().min(target.len());
    let best_on = |level: usize| {
        let (template, target) = (&template[level], &target[level]);
        let found = starts.iter().filter_map(|start| {
            let state = converged(template, target, State::new(*start))?;
            Some((judged(template, target, &state)?.explained(), state))
        });
        let (_, state) = found.max_by(|a, b| a.0.total_cmp(&b.0))?;
        Some((level, state))
    };
    let (first, mut state) = (0..levels).rev().find_map(best_on)?;
    for level in (0..first).rev() {
        state = converged(&template[level], &target[level], state)?;
    }
    judged(&template[0], &target[0], &state)
}

/// Points of a template that a patch has in view.
struct Differences<'a> {
    /// Each with its difference from the target.
    seen: Vec<(&'a TemplatePoint, f64)>,
    /// The differences without the change of brightness.
    errors: Vec<f64>,
}

/// Similarity and brightness so far.
#[derive(Debug, Clone, Copy)]
struct State {
    motion: PlanarSimilarity,
    gain: f64,
    offset: f64,
}

impl State {
    fn new(motion: PlanarSimilarity) -> Self {
        Self {
            motion,
            gain: 0.0,
            offset: 0.0,
        }
    }

    /// Returns the points in view; `None` where too little is seen.
    fn differences<'a>(&self, template: &'a Template, target: &Patch) -> Option<Differences<'a>> {
        let points = template.points.iter();
        let seen: Vec<(&TemplatePoint, f64)> = points
            .filter_map(|point| {
                let seen = target.sample(self.motion.apply(point.place))?;
                Some((point, seen - point.grey))
            })
            .collect();
        if seen.len() < LEAST_POINTS {
            return None;
        }
        let errors = seen
            .iter()
            .map(|&(point, difference)| self.error(point, difference))
            .collect();
        Some(Differences { seen, errors })
    }

    /// Returns what a difference leaves after the change of brightness.
    fn error(&self, point: &TemplatePoint, difference: f64) -> f64 {
        difference - self.gain * point.grey - self.offset
    }
}

/// Steps on one level until nothing moves; `None` where too little is seen or the texture does not tell.
fn converged(template: &Template, target: &Patch, mut state: State) -> Option<State> {
    for _ in 0..STEPS {
        let Differences { seen, errors } = state.differences(template, target)?;
        let sigma = template.sigma_of(&errors);
        let weights: Vec<f64> = errors
            .iter()
            .map(|&error| tukey_weight(error, sigma))
            .collect();
        let points = seen.iter().map(|&(point, _)| point);
        let matrix = template.normal_matrix(points.zip(weights.iter().copied()), sigma);
        let mut right = [0.0; UNKNOWNS];
        for ((point, difference), weight) in seen.iter().zip(&weights) {
            for (sum, value) in right.iter_mut().zip(point.row) {
                *sum += weight * value * difference;
            }
        }
        let solution = matrix.solve(&right)?;
        let &[a, b, x, y, gain, offset] = solution.first_chunk::<UNKNOWNS>()?;
        let delta = PlanarSimilarity {
            turn: DVec2::new(1.0 + a, b),
            shift: DVec2::new(x, y),
        };
        state.motion = state.motion.after(&delta.inverse());
        state.gain = gain.clamp(GAINS[0], GAINS[1]);
        state.offset = offset;
        let is_sound = (SCALES[0]..=SCALES[1]).contains(&state.motion.scale());
        if !is_sound || !state.motion.shift.is_finite() {
            return None;
        }
        let moved = delta.shift.length() + template.radius * DVec2::new(a, b).length();
        if moved < STILL * template.step {
            break;
        }
    }
    Some(state)
}

/// Judges a similarity; `None` where too little is seen.
fn judged(template: &Template, target: &Patch, state: &State) -> Option<Aligned> {
    let Differences { seen, errors } = state.differences(template, target)?;
    let limit = AGREEING * template.contrast / TUKEY;
    let agreement = errors
        .iter()
        .map(|&error| tukey_weight(error, limit))
        .sum::<f64>();
    let sigma = template.sigma_of(&errors);
    let weights = errors.iter().map(|&error| tukey_weight(error, sigma));
    let points = seen.iter().map(|&(point, _)| point);
    let matrix = template.normal_matrix(points.zip(weights), sigma);
    let variance = |unknown: usize| {
        let mut unit = [0.0; UNKNOWNS];
        unit[unknown] = 1.0;
        let solution = matrix.clone().solve(&unit);
        solution.map_or(f64::INFINITY, |solution| solution[unknown] * sigma * sigma)
    };
    Some(Aligned {
        motion: state.motion,
        seen: seen.len() as f64 / template.points.len() as f64,
        agreement: agreement / seen.len() as f64,
        uncertainty: variance(0).max(variance(1)).sqrt(),
    })
}

#[cfg(test)]
mod tests;
