//! A stable radix sort of distance bits.
//!
//! Distances are positive and finite (the projection culls everything else), so their bit patterns
//! order as they do. Splats arrive in order of their index and the sort is stable: ties keep it.

use crate::kernels::project::Splat;

const RADIX_BITS: u32 = 11;
const BUCKETS: usize = 1 << RADIX_BITS;

/// Memory of [`by_distance`], reused over views.
#[derive(Debug, Default)]
pub struct SortScratch {
    /// Distance bits and position, so that the passes read memory in order.
    keys: Vec<(u32, u32)>,
    other: Vec<(u32, u32)>,
}

/// Positions of `splats` from near to far, written to `order`.
pub fn by_distance(splats: &[Splat], order: &mut Vec<u32>, scratch: &mut SortScratch) {
    let SortScratch { keys, other } = scratch;
    keys.clear();
    keys.extend(
        (0_u32..)
            .zip(splats)
            .map(|(position, splat)| (splat.distance.to_bits(), position)),
    );
    other.resize(keys.len(), (0, 0));
    for pass in 0..3 {
        let digit = |key: u32| (key >> (pass * RADIX_BITS)) as usize & (BUCKETS - 1);
        let mut starts = [0_u32; BUCKETS];
        for &(key, _) in keys.iter() {
            starts[digit(key)] += 1;
        }
        let mut sum = 0;
        for start in &mut starts {
            sum += std::mem::replace(start, sum);
        }
        for &pair in keys.iter() {
            let slot = &mut starts[digit(pair.0)];
            other[*slot as usize] = pair;
            *slot += 1;
        }
        std::mem::swap(keys, other);
    }
    order.clear();
    order.extend(keys.iter().map(|&(_, position)| position));
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn sorts_as_the_standard_library_does(distances in prop::collection::vec(prop_oneof![
            1e-20_f32..1e20, Just(1.0_f32), Just(2.5_f32)], 0..300)) {
            let splats: Vec<Splat> = distances
                .iter()
                .map(|&distance| Splat { distance, ..Splat::default() })
                .collect();
            let (mut order, mut scratch) = (Vec::new(), SortScratch::default());
            by_distance(&splats, &mut order, &mut scratch);
            let mut expected: Vec<u32> = (0..splats.len() as u32).collect();
            expected.sort_by(|&a, &b| {
                distances[a as usize].total_cmp(&distances[b as usize])
            });
            prop_assert_eq!(order, expected);
        }
    }
}
