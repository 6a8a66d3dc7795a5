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

use glam::DVec2;
use omnilife_schemas::{band_matrix::BandMatrix, statistics::median};

use super::patch::Patch;

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
/// Tukey's constant, for 95 % efficiency under normal errors.
const TUKEY: f64 = 4.685;
/// Minimum standard deviation of grey values' errors.
const LEAST_SIGMA: f64 = 0.01;
/// Standard deviation of normal errors over the median of their absolute values.
const SIGMA_OF_MEDIAN: f64 = 1.4826;
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

/// A point of a template.
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
        let sizes: Vec<f64> = errors.iter().map(|error| error.abs()).collect();
        let sigma = SIGMA_OF_MEDIAN * median(&sizes).unwrap_or(0.0);
        sigma.min(self.contrast / TUKEY).max(LEAST_SIGMA)
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

    /// Returns the points in view with their differences from the target.
    fn differences<'a>(
        &self,
        template: &'a Template,
        target: &Patch,
    ) -> Vec<(&'a TemplatePoint, f64)> {
        let points = template.points.iter();
        points
            .filter_map(|point| {
                let seen = target.sample(self.motion.apply(point.place))?;
                Some((point, seen - point.grey))
            })
            .collect()
    }

    /// Returns what a difference leaves after the change of brightness.
    fn error(&self, point: &TemplatePoint, difference: f64) -> f64 {
        difference - self.gain * point.grey - self.offset
    }
}

/// Returns Tukey's weight of an error, over the standard deviation of errors.
fn weight(error: f64, sigma: f64) -> f64 {
    let share = error / (TUKEY * sigma);
    let inside = 1.0 - share * share;
    if inside > 0.0 { inside * inside } else { 0.0 }
}

/// Steps on one level until nothing moves; `None` where too little is seen or the texture does not tell.
fn converged(template: &Template, target: &Patch, mut state: State) -> Option<State> {
    for _ in 0..STEPS {
        let seen = state.differences(template, target);
        if seen.len() < LEAST_POINTS {
            return None;
        }
        let errors: Vec<f64> = seen
            .iter()
            .map(|&(point, difference)| state.error(point, difference))
            .collect();
        let sigma = template.sigma_of(&errors);
        let weights: Vec<f64> = errors.iter().map(|&error| weight(error, sigma)).collect();
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
    let seen = state.differences(template, target);
    if seen.len() < LEAST_POINTS {
        return None;
    }
    let errors: Vec<f64> = seen
        .iter()
        .map(|&(point, difference)| state.error(point, difference))
        .collect();
    let limit = AGREEING * template.contrast / TUKEY;
    let agreement = errors
        .iter()
        .map(|&error| weight(error, limit))
        .sum::<f64>();
    let sigma = template.sigma_of(&errors);
    let weights = errors.iter().map(|&error| weight(error, sigma));
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
mod tests {
    use super::*;

    /// Returns a texture without a direction of its own.
    fn texture(at: DVec2) -> f64 {
        0.5 + 0.15 * (31.0 * at.x + 9.0 * at.y).sin()
            + 0.15 * (13.0 * at.x - 27.0 * at.y + 1.0).cos()
            + 0.1 * (19.0 * at.x * (1.0 + at.y)).sin()
    }

    fn disc(at: DVec2) -> f64 {
        if at.length() < 0.25 { 1.0 } else { 0.0 }
    }

    fn patch(draw: impl Fn(DVec2) -> [f64; 2]) -> Vec<Patch> {
        Patch::drawn(DVec2::splat(-0.5), 0.008, [126, 126], draw).pyramid(16, 4)
    }

    fn template() -> Vec<Template> {
        Template::pyramid(&patch(|at| [texture(at), disc(at)]), DVec2::ZERO)
    }

    /// Returns the disc moved by a similarity, in another light; `hide` changes grey value and coverage in the
    /// disc's own coordinates.
    fn moved(by: &PlanarSimilarity, hide: impl Fn(DVec2, [f64; 2]) -> [f64; 2]) -> Vec<Patch> {
        let back = by.inverse();
        patch(|at| {
            let own = back.apply(at);
            hide(own, [0.9 * texture(own) + 0.04, disc(own)])
        })
    }

    fn apart(found: &PlanarSimilarity, truth: &PlanarSimilarity) -> [f64; 3] {
        let turn = quotient(found.turn, truth.turn);
        [
            (turn.length() - 1.0).abs(),
            turn.y.atan2(turn.x).abs(),
            found.shift.distance(truth.shift),
        ]
    }

    #[test]
    fn similarities_compose_and_invert() {
        let a = PlanarSimilarity::new(1.3, 0.7, DVec2::new(0.2, -0.1));
        let b = PlanarSimilarity::new(0.6, -2.9, DVec2::new(-0.5, 0.4));
        for at in [DVec2::ZERO, DVec2::new(0.3, -2.0)] {
            assert!(a.after(&b).apply(at).distance(a.apply(b.apply(at))) < 1e-14);
            assert!(a.inverse().apply(a.apply(at)).distance(at) < 1e-14);
        }
        assert!((a.angle() - 0.7).abs() < 1e-14 && (b.scale() - 0.6).abs() < 1e-14);
    }

    #[test]
    fn rows_are_central_differences() {
        // Fine samples: the patch's own differences have an error of the square of their distance.
        let fine = Patch::drawn(DVec2::splat(-0.1), 1e-4, [200, 200], |at| {
            [texture(at), 1.0]
        });
        let template = Template::of(&fine, DVec2::new(0.02, -0.03)).expect("enough samples");
        let centre = DVec2::new(0.02, -0.03);
        let step = 1e-6;
        for point in template.points.iter().step_by(97) {
            let at = |unknown: usize, by: f64| {
                let mut z = [0.0; 4];
                z[unknown] = by;
                let by = PlanarSimilarity {
                    turn: DVec2::new(1.0 + z[0], z[1]),
                    shift: DVec2::new(z[2], z[3]),
                };
                texture(centre + by.apply(point.place))
            };
            for unknown in 0..4 {
                let expected = (at(unknown, step) - at(unknown, -step)) / (2.0 * step);
                let found = point.row[unknown];
                assert!(
                    (found - expected).abs() < 1e-3,
                    "{unknown}: {found} {expected}"
                );
            }
            assert_eq!(point.row[4..], [point.grey, 1.0]);
        }
    }

    #[test]
    fn scale_and_rotation_are_found() {
        let template = template();
        for (scale, angle, shift) in [
            (1.0, 0.0, [0.0, 0.0]),
            (1.1, 0.15, [0.02, -0.015]),
            (0.92, -0.15, [-0.02, 0.015]),
        ] {
            let truth = PlanarSimilarity::new(scale, angle, DVec2::from_array(shift));
            let target = moved(&truth, |_, seen| seen);
            let start = PlanarSimilarity::new(1.0, 0.0, DVec2::ZERO);
            let found = aligned(&template, &target, &[start]).expect("it is in view");
            let [by_scale, by_angle, by_shift] = apart(&found.motion, &truth);
            assert!(by_scale < 0.01 && by_angle < 0.01, "{found:?}");
            assert!(by_shift < 0.002, "{found:?}");
            assert!(
                found.agreement > 0.8 && found.uncertainty < 0.01,
                "{found:?}"
            );
        }
    }

    /// Checks that neither what the mask leaves out nor a foreign thing inside of the mask shrinks an object.
    #[test]
    fn a_thing_that_hides_forty_percent_does_not_shrink_it() {
        let template = template();
        let truth = PlanarSimilarity::new(1.04, 0.08, DVec2::new(0.02, 0.01));
        // A strip of 40 % of a disc's area: |x| < 0.32 of its radius.
        let is_hidden = |own: DVec2| own.x.abs() < 0.32 * 0.25;
        let cut_out = moved(
            &truth,
            |own, seen| {
                if is_hidden(own) { [0.2, 0.0] } else { seen }
            },
        );
        let painted = moved(&truth, |own, seen| {
            if is_hidden(own) {
                [0.95, seen[1]]
            } else {
                seen
            }
        });
        let start = PlanarSimilarity::new(1.0, 0.0, DVec2::ZERO);
        for target in [cut_out, painted] {
            let found = aligned(&template, &target, &[start]).expect("it is in view");
            let [by_scale, by_angle, _] = apart(&found.motion, &truth);
            assert!(by_scale < 0.03, "{found:?}");
            assert!(by_angle < 5_f64.to_radians(), "{found:?}");
        }
    }

    #[test]
    fn a_flat_thing_is_not_tracked() {
        let flat = patch(|at| [0.5, disc(at)]);
        let template = Template::pyramid(&flat, DVec2::ZERO);
        let start = PlanarSimilarity::new(1.0, 0.0, DVec2::ZERO);
        let found = aligned(&template, &flat, &[start]);
        assert!(
            found.is_none_or(|found| found.uncertainty > 0.5),
            "{found:?}"
        );
    }
}
