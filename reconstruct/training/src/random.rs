//! Random streams: one for each purpose, so that draws of one do not shift another. Two methods with one seed see
//! the same views in the same order.

use rand::SeedableRng;
use rand_pcg::Pcg64Mcg;

/// Purpose of random numbers.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Purpose {
    /// Order of a training's views.
    ViewOrder,
    /// Shifts in time of rendered Gaussians.
    TimeShift,
    /// Positions of the children of split Gaussians.
    Density,
    /// Choice of a sweep's places that become points.
    SweptPoints,
    /// Choice of a step's rays from a clip.
    Rays,
    /// First peak times of Gaussians at scene points.
    PeakTimes,
    /// First values of fields of grids and networks.
    Fields,
}

/// Steps of the golden ratio keep the seeds of the purposes apart.
const SEED_STEP: u64 = 0x9e37_79b9_7f4a_7c15;

/// Returns the seed of a purpose under a run's seed.
pub fn seed_of(seed: u64, purpose: Purpose) -> u64 {
    seed.wrapping_add((purpose as u64).wrapping_mul(SEED_STEP))
}

/// Returns the stream of a purpose under a run's seed.
pub fn stream(seed: u64, purpose: Purpose) -> Pcg64Mcg {
    Pcg64Mcg::seed_from_u64(seed_of(seed, purpose))
}

#[cfg(test)]
mod tests {
    use rand::RngExt;

    use super::*;

    #[test]
    fn purposes_and_seeds_have_streams_of_their_own() {
        let purposes = [
            Purpose::ViewOrder,
            Purpose::TimeShift,
            Purpose::Density,
            Purpose::SweptPoints,
            Purpose::Rays,
            Purpose::PeakTimes,
            Purpose::Fields,
        ];
        let mut first: Vec<u64> = Vec::new();
        for seed in 0..100 {
            first.extend(purposes.map(|purpose| stream(seed, purpose).random::<u64>()));
        }
        let count = first.len();
        first.sort_unstable();
        first.dedup();
        assert_eq!(first.len(), count);
        let again = || stream(7, Purpose::Density).random::<u64>();
        assert_eq!(again(), again());
    }
}
