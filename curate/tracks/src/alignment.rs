//! Alignment of depth priors to the scale of a scene: `1/D = scale/E + shift`.
//!
//! Networks estimate distances, or inverse distances, up to a scale and mostly a shift of the inverse (Ranftl et al.,
//! "Towards Robust Monocular Depth Estimation", 2020, section 5). Both are estimated from points of known distance by
//! RANSAC over pairs of them, then by least squares with Huber weights over the inliers. If all distances are nearly
//! alike, scale and shift are ambiguous, and the scale alone is estimated.

use omnilife_schemas::statistics::{median, quantile};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

/// Draws of two points.
const DRAWS: usize = 200;
/// Largest relative error of an inlier's distance.
const AGREES: f64 = 0.05;
/// Least number of inliers of an alignment.
pub const LEAST_INLIERS: usize = 50;
/// Least difference of the 5th and 95th percentile of inverse distances, over their median; below, a scene is flat.
const FLAT_SPREAD: f64 = 0.1;
/// Largest ratio of the singular values of the two columns; above, scale and shift are ambiguous.
const WORST_CONDITION: f64 = 100.0;
/// Rounds of least squares, and the number of standard deviations from which on a point counts less.
const ROUNDS: usize = 20;
const HUBER: f64 = 1.345;

/// A point with known and estimated distance.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pair {
    /// Along the ray, in the unit of the estimates.
    pub estimate: f64,
    /// Along the ray, world units.
    pub distance: f64,
}

/// Map from estimates of a frame to distances.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Alignment {
    /// Factor of inverse estimates.
    pub scale: f64,
    /// Added to them, one over a world unit; 0 where the scene is flat.
    pub shift: f64,
    /// Number of inliers.
    pub inliers: usize,
    /// True if the scene is flat, so that only the scale was estimated.
    pub is_flat: bool,
}

impl Alignment {
    /// Returns the distance of an estimate, world units; `None` if it is behind infinity.
    pub fn distance(&self, estimate: f64) -> Option<f64> {
        let inverse = self.scale / estimate + self.shift;
        let distance = 1.0 / inverse;
        (inverse > 0.0 && distance.is_finite()).then_some(distance)
    }

    /// Returns how many points are its inliers.
    pub fn agreeing(&self, pairs: &[Pair]) -> usize {
        pairs.iter().filter(|pair| self.agrees(pair)).count()
    }

    fn agrees(&self, pair: &Pair) -> bool {
        self.distance(pair.estimate)
            .is_some_and(|distance| (distance / pair.distance - 1.0).abs() <= AGREES)
    }
}

/// Estimates the alignment of a frame; `None` if no alignment has [`LEAST_INLIERS`] inliers. `scale_alone` fixes the
/// shift at zero, as required for estimates of metric networks.
pub fn align(pairs: &[Pair], scale_alone: bool) -> Option<Alignment> {
    let usable = |pair: &&Pair| {
        let sound = |value: f64| value.is_finite() && value > 0.0 && (1.0 / value).is_finite();
        sound(pair.estimate) && sound(pair.distance)
    };
    let pairs: Vec<Pair> = pairs.iter().filter(usable).copied().collect();
    let is_flat = scale_alone || is_flat(&pairs);
    let mut random = Pcg64Mcg::seed_from_u64(pairs.len() as u64);
    let mut best: Option<Alignment> = None;
    for _ in 0..DRAWS.min(pairs.len() * pairs.len()) {
        let [one, other] = [(); 2].map(|()| pairs[random.random_range(0..pairs.len())]);
        let Some(drawn) = through(one, other, is_flat) else {
            continue;
        };
        let inliers = drawn.agreeing(&pairs);
        if best.is_none_or(|best| inliers > best.inliers) {
            best = Some(Alignment { inliers, ..drawn });
        }
    }
    let best = best.filter(|best| best.inliers >= LEAST_INLIERS)?;
    let agreeing: Vec<Pair> = pairs
        .iter()
        .filter(|pair| best.agrees(pair))
        .copied()
        .collect();
    let refined = refined(&agreeing, best);
    let inliers = refined.agreeing(&pairs);
    // If least squares makes it worse, the drawn one stays.
    if inliers >= best.inliers / 2 {
        Some(Alignment { inliers, ..refined })
    } else {
        Some(best)
    }
}

/// Returns true if scale and shift are ambiguous.
fn is_flat(pairs: &[Pair]) -> bool {
    let inverse: Vec<f64> = pairs.iter().map(|pair| 1.0 / pair.distance).collect();
    let at = |share: f64| quantile(&inverse, share).unwrap_or(0.0);
    let middle = at(0.5);
    if !(middle > 0.0 && (at(0.95) - at(0.05)) / middle >= FLAT_SPREAD) {
        return true;
    }
    // Singular values of the columns (x / median, 1) by the eigenvalues of their products.
    let estimates: Vec<f64> = pairs.iter().map(|pair| 1.0 / pair.estimate).collect();
    let unit = median(&estimates).unwrap_or(1.0);
    let (mut squares, mut sum) = (0.0, 0.0);
    for estimate in &estimates {
        let own = estimate / unit;
        squares += own * own;
        sum += own;
    }
    let count = estimates.len() as f64;
    let half = 0.5 * (squares + count);
    let root = (half * half - (squares * count - sum * sum))
        .max(0.0)
        .sqrt();
    let [least, largest] = [(half - root).max(0.0).sqrt(), (half + root).sqrt()];
    // Without any number they are ambiguous, too.
    largest.is_nan() || largest > WORST_CONDITION * least
}

/// Returns the alignment through two points, or one.
fn through(one: Pair, other: Pair, is_flat: bool) -> Option<Alignment> {
    let [x, other_x] = [one, other].map(|pair| 1.0 / pair.estimate);
    let [y, other_y] = [one, other].map(|pair| 1.0 / pair.distance);
    let scale = if is_flat {
        y / x
    } else {
        (other_y - y) / (other_x - x)
    };
    let shift = if is_flat { 0.0 } else { y - scale * x };
    let is_sound = scale.is_finite() && scale > 0.0 && shift.is_finite();
    is_sound.then_some(Alignment {
        scale,
        shift,
        inliers: 0,
        is_flat,
    })
}

/// Refines by least squares of the relative error of the inverse distance, with Huber weights.
fn refined(pairs: &[Pair], begin: Alignment) -> Alignment {
    let mut found = begin;
    for _ in 0..ROUNDS {
        let residual =
            |pair: &Pair| (found.scale / pair.estimate + found.shift) * pair.distance - 1.0;
        let errors: Vec<f64> = pairs.iter().map(|pair| residual(pair).abs()).collect();
        let deviation = 1.4826 * median(&errors).unwrap_or(0.0);
        let limit = HUBER * deviation.max(1e-12);
        // The relative error is linear: scale * (D / E) + shift * D - 1.
        let (mut aa, mut ab, mut bb, mut a, mut b) = (0.0, 0.0, 0.0, 0.0, 0.0);
        for (pair, error) in pairs.iter().zip(&errors) {
            let weight = (limit / error.max(limit)).min(1.0);
            let (by_scale, by_shift) = (pair.distance / pair.estimate, pair.distance);
            aa += weight * by_scale * by_scale;
            ab += weight * by_scale * by_shift;
            bb += weight * by_shift * by_shift;
            a += weight * by_scale;
            b += weight * by_shift;
        }
        let (scale, shift) = if found.is_flat {
            (a / aa, 0.0)
        } else {
            let determinant = aa * bb - ab * ab;
            (
                (a * bb - b * ab) / determinant,
                (b * aa - a * ab) / determinant,
            )
        };
        if !(scale.is_finite() && scale > 0.0 && shift.is_finite()) {
            return found;
        }
        let change = (scale / found.scale - 1.0).abs();
        found = Alignment {
            scale,
            shift,
            ..found
        };
        if change < 1e-12 {
            break;
        }
    }
    found
}

/// Returns alignments of neighbouring frames, in order. Scale and shift are the medians over five frames if those have
/// nearly as many inliers, and frames without an alignment take that of the nearest frame. Also returns which; empty if
/// no frame has one.
pub fn smoothed(found: &[Option<Alignment>], pairs: &[Vec<Pair>]) -> (Vec<Alignment>, Vec<usize>) {
    const HALF: usize = 2;
    let known: Vec<usize> = (0..found.len()).filter(|&at| found[at].is_some()).collect();
    let mut borrowed = Vec::new();
    let alignments = (0..found.len()).filter_map(|at| {
        let Some(own) = found[at] else {
            borrowed.push(at);
            let nearest = known.iter().min_by_key(|&&other| other.abs_diff(at))?;
            return found[*nearest];
        };
        let near: Vec<Alignment> = found[at.saturating_sub(HALF)..(at + HALF + 1).min(found.len())]
            .iter()
            .flatten()
            .filter(|one| one.is_flat == own.is_flat)
            .copied()
            .collect();
        let middle = |part: fn(&Alignment) -> f64| {
            median(&near.iter().map(part).collect::<Vec<f64>>()).unwrap_or(0.0)
        };
        let even = Alignment {
            scale: middle(|one| one.scale),
            shift: middle(|one| one.shift),
            ..own
        };
        let inliers = even.agreeing(&pairs[at]);
        // Networks without an absolute scale give every frame another one.
        if inliers * 100 >= own.inliers * 95 {
            Some(Alignment { inliers, ..even })
        } else {
            Some(own)
        }
    });
    let alignments: Vec<Alignment> = alignments.collect();
    (alignments, borrowed)
}

#[cfg(test)]
mod tests {
    use super::*;

    const SCALE: f64 = 0.7;
    const SHIFT: f64 = 0.004;

    /// Points of a slope from 30 to 60 units away; every fifth two are estimated by something else.
    fn pairs(count: usize, nearest: f64, farthest: f64) -> Vec<Pair> {
        let mut random = Pcg64Mcg::seed_from_u64(5);
        (0..count)
            .map(|at| {
                let distance = nearest + (farthest - nearest) * (at as f64 + 0.5) / count as f64;
                let noise = 1.0 + 0.01 * (random.random::<f64>() - 0.5);
                let estimate = if at % 5 < 2 {
                    5.0 + 90.0 * random.random::<f64>()
                } else {
                    noise * SCALE / (1.0 / distance - SHIFT)
                };
                Pair { estimate, distance }
            })
            .collect()
    }

    #[test]
    fn scale_and_shift_come_back_with_two_fifths_of_outliers() {
        let found = align(&pairs(2000, 30.0, 60.0), false).expect("agrees");
        assert!(!found.is_flat);
        assert!((found.scale / SCALE - 1.0).abs() < 0.005, "{found:?}");
        assert!((found.shift / SHIFT - 1.0).abs() < 0.005, "{found:?}");
        for distance in [30.0, 45.0, 60.0] {
            let estimate = SCALE / (1.0 / distance - SHIFT);
            let own = found.distance(estimate).expect("in front");
            assert!((own / distance - 1.0).abs() < 0.005, "{own} of {distance}");
        }
        assert!((1150..1400).contains(&found.inliers), "{}", found.inliers);
    }

    /// Straight down at a flat road the two are ambiguous: one of them is omitted, with a note.
    #[test]
    fn a_flat_scene_has_a_scale_alone() {
        let flat = align(&pairs(2000, 49.0, 51.0), false).expect("agrees");
        assert!(flat.is_flat && flat.shift == 0.0);
        let estimate = SCALE / (1.0 / 50.0 - SHIFT);
        let own = flat.distance(estimate).expect("in front");
        assert!((own / 50.0 - 1.0).abs() < 0.01, "{own}");
        // All equal to the last bit, and fixed to zero shift.
        let alike = vec![
            Pair {
                estimate: 2.0,
                distance: 40.0
            };
            100
        ];
        assert!(align(&alike, false).is_some_and(|one| one.is_flat && one.scale == 0.05));
        assert!(align(&pairs(2000, 30.0, 60.0), true).is_some_and(|one| one.is_flat));
    }

    #[test]
    fn nothing_agrees_with_noise() {
        let mut random = Pcg64Mcg::seed_from_u64(9);
        let noise: Vec<Pair> = (0..400)
            .map(|_| Pair {
                estimate: 1.0 + 1e4 * random.random::<f64>().powi(4),
                distance: 20.0 + 900.0 * random.random::<f64>(),
            })
            .collect();
        assert_eq!(align(&noise, false), None);
        assert_eq!(align(&[], false), None);
        let broken = [0.0, f64::INFINITY, f64::NAN].map(|estimate| Pair {
            estimate,
            distance: 40.0,
        });
        assert_eq!(align(&broken.repeat(40), false), None);
    }

    #[test]
    fn frames_without_an_alignment_take_their_neighbours() {
        let good = align(&pairs(2000, 30.0, 60.0), false);
        let all = vec![pairs(2000, 30.0, 60.0); 4];
        let (found, borrowed) = smoothed(&[None, good, good, None], &all);
        assert_eq!((found.len(), borrowed), (4, vec![0, 3]));
        assert!(smoothed(&[None; 4], &all).0.is_empty());
        // A frame with another scale keeps it.
        let other = good.map(|one| Alignment {
            scale: 2.0 * one.scale,
            ..one
        });
        let doubled: Vec<Pair> = (all[0].iter())
            .map(|pair| Pair {
                estimate: 2.0 * pair.estimate,
                ..*pair
            })
            .collect();
        let pairs = [all[0].clone(), doubled, all[0].clone()];
        let (found, _) = smoothed(&[good, other, good], &pairs);
        assert_eq!(found[1].scale, other.map_or(0.0, |one| one.scale));
    }
}
