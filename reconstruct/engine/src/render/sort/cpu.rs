//! Stable radix sort of distance bits.
//!
//! Distances are positive and finite (the projection culls all others), so that their bit patterns sort in
//! the same order. Keys are created in order of the index, and the sort is stable: ties keep that order.

const RADIX_BITS: u32 = 11;
const BUCKETS: usize = 1 << RADIX_BITS;

/// Memory of [`by_distance`], reused over views.
#[derive(Debug, Default)]
pub struct SortScratch {
    /// Distance bits and index, so that the passes read memory in order.
    keys: Vec<(u32, u32)>,
    other: Vec<(u32, u32)>,
}

/// Sorts the drawn Gaussians: `order` receives their indices from near to far, and `ranks` the rank of each
/// Gaussian in it (`u32::MAX` if its distance is infinite: not drawn).
pub fn by_distance(
    distances: &[f32],
    order: &mut Vec<u32>,
    ranks: &mut Vec<u32>,
    scratch: &mut SortScratch,
) {
    let SortScratch { keys, other } = scratch;
    keys.clear();
    keys.extend(
        (0_u32..)
            .zip(distances)
            .filter(|(_, distance)| distance.is_finite())
            .map(|(index, distance)| (distance.to_bits(), index)),
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
    order.extend(keys.iter().map(|&(_, index)| index));
    ranks.clear();
    ranks.resize(distances.len(), u32::MAX);
    for (rank, &index) in (0_u32..).zip(order.iter()) {
        ranks[index as usize] = rank;
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn sorts_as_the_standard_library_does(distances in prop::collection::vec(prop_oneof![
            1e-20_f32..1e20, Just(1.0_f32), Just(2.5_f32), Just(f32::INFINITY)], 0..300)) {
            let (mut order, mut ranks) = (Vec::new(), Vec::new());
            let mut scratch = SortScratch::default();
            by_distance(&distances, &mut order, &mut ranks, &mut scratch);
            let mut expected: Vec<u32> = (0..distances.len() as u32)
                .filter(|&index| distances[index as usize].is_finite())
                .collect();
            expected.sort_by(|&a, &b| {
                distances[a as usize].total_cmp(&distances[b as usize])
            });
            for (rank, &index) in order.iter().enumerate() {
                prop_assert_eq!(ranks[index as usize], rank as u32);
            }
            let not_drawn = ranks.iter().filter(|&&rank| rank == u32::MAX).count();
            prop_assert_eq!(not_drawn, distances.len() - order.len());
            prop_assert_eq!(order, expected);
        }
    }
}
