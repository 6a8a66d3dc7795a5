//! The best hypothesis of every pixel.

use rayon::prelude::*;

use crate::PathSums;

/// Margin of a hypothesis over all but its neighbours for full confidence, relative to the sum over all paths.
const CLEAR_MARGIN: f32 = 0.25;

/// Minimum of a pixel's sums.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BestHypothesis {
    /// Number of the hypothesis, to a fraction.
    pub steps: f32,
    /// Margin over all other hypotheses except its neighbours, 0 to 1.
    pub confidence: f32,
}

/// Returns the best hypothesis of every pixel, to a fraction of a step by a parabola through it and its neighbours.
pub fn best(sums: &PathSums) -> Vec<BestHypothesis> {
    sums.sums
        .par_chunks_exact(sums.count)
        .map(|sums| {
            let (best, steps) = minimum(sums);
            let least = f32::from(sums[best]);
            let rival = sums
                .iter()
                .enumerate()
                .filter(|(k, _)| k.abs_diff(best) > 2)
                .map(|(_, &sum)| f32::from(sum))
                .fold(f32::MAX, f32::min);
            let margin = (rival - least) / rival.max(1.0);
            BestHypothesis {
                steps,
                confidence: (margin / CLEAR_MARGIN).clamp(0.0, 1.0),
            }
        })
        .collect()
}

/// Returns the smallest sum (the farthest one of equals), and the vertex of the parabola through it, in steps.
fn minimum(sums: &[u16]) -> (usize, f32) {
    let mut best = 0;
    for (k, sum) in sums.iter().enumerate() {
        if *sum < sums[best] {
            best = k;
        }
    }
    if best == 0 || best + 1 == sums.len() {
        return (best, best as f32);
    }
    let [left, middle, right] = [best - 1, best, best + 1].map(|k| f32::from(sums[k]));
    let curvature = left - 2.0 * middle + right;
    let offset = if curvature > 0.0 {
        (0.5 * (left - right) / curvature).clamp(-0.5, 0.5)
    } else {
        0.0
    };
    (best, best as f32 + offset)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_vertex_of_a_parabola_is_found() {
        let sums: Vec<u16> = (0..9)
            .map(|k| (100.0 * (f32::from(k as u8) - 4.3).powi(2)) as u16)
            .collect();
        let (best, steps) = minimum(&sums);
        assert_eq!(best, 4);
        assert!((steps - 4.3).abs() < 0.01, "{steps}");
        assert_eq!(minimum(&[5, 5, 5]), (0, 0.0));
        assert_eq!(minimum(&[5, 4, 3]), (2, 2.0));
    }
}
