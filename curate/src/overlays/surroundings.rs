//! Surroundings of a region that stays: what is painted over the image stays while they move.
//!
//! A sky stays with all that is around it, or in front of nothing that could move, and so is not an overlay.

use super::regions::Grid;

/// The surroundings begin and end so many pixels from a region.
const BEGIN_PIXELS: usize = 1;
const END_PIXELS: usize = 8;
/// Least share of the surroundings with detail.
const LEAST_DETAIL: f64 = 0.05;
/// Largest share of that detail that may stay.
const MOST_STAYING: f64 = 0.35;

/// Returns true if there is detail around a region, and most of it does not stay.
pub(super) fn are_moving(
    grid: &Grid,
    region: &[usize],
    is_detailed: impl Fn(usize) -> bool,
    stays: impl Fn(usize) -> bool,
) -> bool {
    let mut marks = vec![false; grid.width * grid.height];
    for &at in region {
        marks[at] = true;
    }
    let (inner, outer) = (
        grid.grown(&marks, BEGIN_PIXELS),
        grid.grown(&marks, END_PIXELS),
    );
    let around = || (0..marks.len()).filter(|&at| outer[at] && !inner[at]);
    let detailed = || around().filter(|&at| is_detailed(at));
    let count = detailed().count() as f64;
    let staying = detailed().filter(|&at| stays(at)).count() as f64;
    count > 0.0
        && count >= LEAST_DETAIL * around().count() as f64
        && staying <= MOST_STAYING * count
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_region_among_what_stays_or_in_front_of_nothing_is_no_overlay() {
        let grid = Grid {
            width: 64,
            height: 32,
        };
        let region: Vec<usize> = (20..30).map(|column| 16 * 64 + column).collect();
        let judged = |is_detailed: fn(usize) -> bool, stays: fn(usize) -> bool| {
            are_moving(&grid, &region, is_detailed, stays)
        };
        assert!(judged(|_| true, |_| false));
        assert!(judged(|at| at.is_multiple_of(4), |_| false));
        assert!(!judged(|_| true, |_| true));
        assert!(!judged(|_| false, |_| false));
    }
}
