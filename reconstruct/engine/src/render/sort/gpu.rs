//! Radix sort on a GPU, for distances and for tile indices.

use crate::device::{
    DeviceBuffer, Gpu, GpuError, Program, Shader, Uniform, Workgroups, kernels, wgsl_struct,
};

/// Pairs that one workgroup moves.
pub(crate) const BLOCK: usize = 1024;
/// Bits of the key per pass.
const DIGIT_BITS: u32 = 8;

wgsl_struct! {
    pub(crate) struct SortPass {
        /// Lowest bit of the digit in the key.
        shift: u32,
        /// Capacity of the buffers in pairs.
        capacity: u32,
    }
}

pub(crate) fn shader() -> Shader {
    Shader {
        file: "sort.wgsl",
        constants: String::new(),
        parts: &[
            include_str!("../../device/common.wgsl"),
            include_str!("sort.wgsl"),
        ],
    }
}

/// Keys with their items, in two alternating sets of buffers.
#[derive(Debug)]
pub(crate) struct Pairs {
    /// Unsorted keys.
    pub(crate) keys: DeviceBuffer<u32>,
    pub(crate) items: DeviceBuffer<u32>,
    other_keys: DeviceBuffer<u32>,
    other_items: DeviceBuffer<u32>,
}

/// Keys and items in one of the two sets of buffers.
#[derive(Debug, Clone, Copy)]
pub(crate) struct PairBuffers<'a> {
    pub(crate) keys: &'a DeviceBuffer<u32>,
    pub(crate) items: &'a DeviceBuffer<u32>,
}

/// Returns the number of passes of a sort by `bits` bits.
fn passes(bits: u32) -> u32 {
    bits.div_ceil(DIGIT_BITS)
}

impl Pairs {
    pub(crate) fn new(gpu: &Gpu, capacity: usize) -> Result<Self, GpuError> {
        let zeros = |label| DeviceBuffer::zeros(gpu, label, capacity);
        Ok(Self {
            keys: zeros("sort keys")?,
            items: zeros("sort items")?,
            other_keys: zeros("sort keys, other half")?,
            other_items: zeros("sort items, other half")?,
        })
    }

    /// Returns the buffers that hold the pairs after some passes.
    fn after(&self, passes: u32) -> PairBuffers<'_> {
        if passes.is_multiple_of(2) {
            PairBuffers {
                keys: &self.keys,
                items: &self.items,
            }
        } else {
            PairBuffers {
                keys: &self.other_keys,
                items: &self.other_items,
            }
        }
    }

    /// Returns the buffers that hold the pairs after a sort by `bits` bits.
    pub(crate) fn sorted(&self, bits: u32) -> PairBuffers<'_> {
        self.after(passes(bits))
    }
}

kernels! {
    /// Stable sort of pairs by the low bits of their keys.
    pub(crate) struct RadixSort() = shader() => [count_digits, sum_digits, move_pairs];
}

#[derive(Debug, Clone, Copy)]
pub(crate) struct PairCount<'a> {
    pub(crate) count: &'a DeviceBuffer<u32>,
    /// Workgroups that cover all blocks of pairs.
    pub(crate) blocks: Workgroups<'a>,
}

impl RadixSort {
    /// Records sorting of the first `count[0]` pairs by the lowest `bits` of their keys. The result is in
    /// [`Pairs::sorted`].
    pub(crate) fn record(
        &self,
        gpu: &Gpu,
        program: &mut Program,
        pairs: &Pairs,
        of: PairCount<'_>,
        bits: u32,
    ) -> Result<(), GpuError> {
        let capacity = pairs.keys.len();
        let blocks = capacity.div_ceil(BLOCK);
        let places = DeviceBuffer::<u32>::zeros(gpu, "sort places", blocks << DIGIT_BITS)?;
        let totals = DeviceBuffer::<u32>::zeros(gpu, "sort digits", 1 << DIGIT_BITS)?;
        for pass in 0..passes(bits) {
            let (from, to) = (pairs.after(pass), pairs.after(pass + 1));
            let sort_pass = SortPass {
                shift: pass * DIGIT_BITS,
                capacity: capacity as u32,
            };
            let sort_pass = Uniform::of(gpu, "sort pass", &sort_pass)?;
            let [uniform, count, places] = [&sort_pass.raw, &of.count.raw, &places.raw];
            let counted = [uniform, count, places, &from.keys.raw];
            program.run_workgroups(gpu, &self.count_digits, of.blocks, &counted);
            let summed = [uniform, count, places, &totals.raw];
            let digits = Workgroups::Fixed(1 << DIGIT_BITS);
            program.run_workgroups(gpu, &self.sum_digits, digits, &summed);
            let moved = [
                uniform,
                count,
                places,
                &from.keys.raw,
                &from.items.raw,
                &to.keys.raw,
                &to.items.raw,
                &totals.raw,
            ];
            program.run_workgroups(gpu, &self.move_pairs, of.blocks, &moved);
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use rand::{RngExt, SeedableRng};
    use rand_pcg::Pcg64Mcg;

    use super::*;
    use crate::device::{Scan, test_device};

    /// Sorts with the standard library's stable sort.
    fn expected(keys: &[u32], count: usize, bits: u32) -> (Vec<u32>, Vec<u32>) {
        let mask = u32::MAX >> (32 - bits);
        let mut pairs: Vec<(u32, u32)> = keys[..count].iter().copied().zip(0..).collect();
        pairs.sort_by_key(|pair| pair.0 & mask);
        pairs.into_iter().unzip()
    }

    #[test]
    fn sorts_as_the_standard_library_does() {
        let Some(gpu) = test_device() else { return };
        let sort = RadixSort::new(&gpu).expect("compiles");
        let mut random = Pcg64Mcg::seed_from_u64(1);
        // Less than a workgroup, one block, several blocks; many ties; fewer pairs than the capacity.
        for (capacity, count, bits, range) in [
            (3, 3, 32, 9),
            (2048, 2048, 32, u32::MAX),
            (5000, 5000, 32, u32::MAX),
            (5000, 4100, 16, 900),
            (5000, 4100, 7, 128),
            (3000, 2999, 8, 256),
            (90_000, 90_000, 24, 1 << 24),
            (300_000, 280_000, 12, 4096),
            (1_200_000, 1_100_000, 11, 2048),
            (2048, 0, 8, 256),
        ] {
            let keys: Vec<u32> = (0..capacity)
                .map(|_| random.random_range(0..range))
                .collect();
            let pairs = Pairs::new(&gpu, capacity).expect("fits");
            pairs.keys.write(&gpu, 0, &keys);
            let numbers: Vec<u32> = (0..capacity as u32).collect();
            pairs.items.write(&gpu, 0, &numbers);
            let counted = DeviceBuffer::of(&gpu, "count", &[count as u32]).expect("fits");
            let mut program = Program::default();
            let of = PairCount {
                count: &counted,
                blocks: Workgroups::Fixed(usize::div_ceil(count, BLOCK)),
            };
            sort.record(&gpu, &mut program, &pairs, of, bits)
                .expect("fits");
            program.submit(&gpu);
            let (keys_out, items_out) = expected(&keys, count, bits);
            let sorted = pairs.sorted(bits);
            assert_eq!(sorted.keys.read(&gpu).expect("reads")[..count], keys_out);
            assert_eq!(sorted.items.read(&gpu).expect("reads")[..count], items_out);
        }
    }

    #[test]
    fn prefix_sums_saturate() {
        let Some(gpu) = test_device() else { return };
        let scan = Scan::new(&gpu).expect("compiles");
        for len in [1, 7, 1024, 1025, 1_100_000] {
            let values: Vec<u32> = (0..len as u32).map(|index| index % 7).collect();
            let buffer = DeviceBuffer::of(&gpu, "values", &values).expect("fits");
            let mut program = Program::default();
            scan.record(&gpu, &mut program, &buffer).expect("fits");
            program.submit(&gpu);
            let mut sum = 0;
            let expected: Vec<u32> = values
                .iter()
                .map(|value| {
                    sum += value;
                    sum - value
                })
                .collect();
            assert!(
                buffer.read(&gpu).expect("reads") == expected,
                "{len} values"
            );
        }
        let buffer = DeviceBuffer::of(&gpu, "values", &[u32::MAX - 1, 1, 1, 5]).expect("fits");
        let mut program = Program::default();
        scan.record(&gpu, &mut program, &buffer).expect("fits");
        program.submit(&gpu);
        assert_eq!(
            buffer.read(&gpu).expect("reads"),
            [0, u32::MAX - 1, u32::MAX, u32::MAX]
        );
    }
}
