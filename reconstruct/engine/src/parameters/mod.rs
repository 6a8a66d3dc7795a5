//! Tables of named parameter arrays, and their optimizer.
//!
//! * [`adam`]: the optimizer; [`decay`]: decay of its step sizes; [`short_schedule`]: larger step sizes for
//!   shorter schedules. [`memory`]: memory of tables.
//! * [`device_table`]: a table in GPU memory; `rows`: copying, removing and ordering its rows there.

pub mod adam;
pub mod decay;
pub mod device_table;
pub mod memory;
pub(crate) mod rows;
pub mod short_schedule;

/// One raw parameter of every Gaussian, with the state of its optimization. The weights of a network are also
/// one, with a single row.
#[derive(Debug, Clone, PartialEq)]
pub struct ParameterArray {
    /// Name, unique in its table.
    pub name: &'static str,
    /// Values per Gaussian.
    pub width: usize,
    /// `len * width` values.
    pub values: Vec<f32>,
    /// `len * width` gradients of the loss; empty for a frozen array, which has no moments either, and for a
    /// shard that is not being trained.
    pub gradients: Vec<f32>,
    /// Adam's first moments.
    pub first_moments: Vec<f32>,
    /// Adam's second moments.
    pub second_moments: Vec<f32>,
    /// Step size of the next update.
    pub learning_rate: f32,
}

impl ParameterArray {
    /// Returns the bytes of values, gradients and moments.
    pub fn bytes(&self) -> u64 {
        let moments = self.first_moments.len() + self.second_moments.len();
        let values = self.values.len() + self.gradients.len() + moments;
        (values * size_of::<f32>()) as u64
    }

    /// Returns true if its values are frozen: it has neither gradients nor moments.
    pub fn is_frozen(&self) -> bool {
        self.first_moments.len() < self.values.len()
    }
}

/// Parameters shared by all Gaussians of a table, such as the weights of a network, with the state of their
/// optimization.
#[derive(Debug, Clone, PartialEq)]
pub struct SharedParameters {
    /// All values, as a single row.
    pub array: ParameterArray,
    /// Optimizer steps so far; they may start later than those of the Gaussians.
    pub steps: u64,
}

impl SharedParameters {
    /// Creates parameters without gradients and steps.
    pub fn new(name: &'static str, values: Vec<f32>) -> Self {
        let zeros = vec![0.0; values.len()];
        Self {
            array: ParameterArray {
                name,
                width: values.len(),
                gradients: zeros.clone(),
                first_moments: zeros.clone(),
                second_moments: zeros,
                values,
                learning_rate: 0.0,
            },
            steps: 0,
        }
    }
}

/// Gradient memory of a table, which another table may reuse.
#[derive(Debug, Default)]
pub struct GradientMemory(Vec<Vec<f32>>);

/// Name and width of a parameter array, for any number of Gaussians.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ArrayShape {
    /// Name, unique in its table.
    pub name: &'static str,
    /// Values per Gaussian.
    pub width: usize,
}

/// Parameter arrays of equal length.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct ParameterTable {
    /// The arrays, in the order in which the parameterization added them.
    pub arrays: Vec<ParameterArray>,
    len: usize,
}

impl ParameterTable {
    /// Creates a table of `len` Gaussians without parameters.
    pub fn new(len: usize) -> Self {
        Self {
            arrays: Vec::new(),
            len,
        }
    }

    /// Returns the number of Gaussians.
    pub fn len(&self) -> usize {
        self.len
    }

    /// Returns true if there are no Gaussians.
    pub fn is_empty(&self) -> bool {
        self.len == 0
    }

    /// Adds an array and returns its index in [`ParameterTable::arrays`].
    ///
    /// # Panics
    /// If `values` does not hold `len * width` values.
    pub fn add(
        &mut self,
        name: &'static str,
        width: usize,
        values: Vec<f32>,
        learning_rate: f32,
    ) -> usize {
        assert_eq!(values.len(), self.len * width, "array {name}");
        // Separate allocations: pages of zeros take no memory until they are written.
        let zeros = || vec![0.0; values.len()];
        self.arrays.push(ParameterArray {
            name,
            width,
            gradients: zeros(),
            first_moments: zeros(),
            second_moments: zeros(),
            values,
            learning_rate,
        });
        self.arrays.len() - 1
    }

    /// Freezes an array: its values stay, its gradients and moments are dropped.
    pub fn freeze(&mut self, array: usize) {
        let array = &mut self.arrays[array];
        array.gradients = Vec::new();
        array.first_moments = Vec::new();
        array.second_moments = Vec::new();
    }

    /// Moves the memory of the gradients, whose values are lost, out for another table.
    pub fn take_gradients(&mut self, memory: &mut GradientMemory) {
        memory.0.resize(self.arrays.len(), Vec::new());
        for (array, kept) in self.arrays.iter_mut().zip(&mut memory.0) {
            if !array.is_frozen() {
                *kept = std::mem::take(&mut array.gradients);
            }
        }
    }

    /// Allocates gradients of the trained arrays from this memory; their values are arbitrary.
    pub fn lend_gradients(&mut self, memory: &mut GradientMemory) {
        memory.0.resize(self.arrays.len(), Vec::new());
        for (array, kept) in self.arrays.iter_mut().zip(&mut memory.0) {
            if !array.is_frozen() {
                array.gradients = std::mem::take(kept);
                array.gradients.resize(array.values.len(), 0.0);
            }
        }
    }

    /// Concatenates the values of several tables with the same arrays; the result is not trainable.
    pub fn joined<'a>(tables: impl Iterator<Item = &'a Self> + Clone) -> Self {
        let mut joined = Self::new(tables.clone().map(Self::len).sum());
        let shapes = tables.clone().next().map(Self::shapes).unwrap_or_default();
        for (number, ArrayShape { name, width }) in shapes.into_iter().enumerate() {
            let values = tables
                .clone()
                .flat_map(|table| &table.arrays[number].values);
            let added = joined.add(name, width, values.copied().collect(), 0.0);
            joined.freeze(added);
        }
        joined
    }

    /// Returns the values of one Gaussian in one array.
    pub fn row(&self, array: usize, index: usize) -> &[f32] {
        let array = &self.arrays[array];
        &array.values[index * array.width..(index + 1) * array.width]
    }

    /// Resizes to `len` Gaussians with arbitrary values.
    pub(crate) fn resize(&mut self, len: usize) {
        for array in &mut self.arrays {
            let is_frozen = array.is_frozen();
            array.values.resize(len * array.width, 0.0);
            if !is_frozen {
                array.gradients.resize(len * array.width, 0.0);
                array.first_moments.resize(len * array.width, 0.0);
                array.second_moments.resize(len * array.width, 0.0);
            }
        }
        self.len = len;
    }

    /// Keeps the Gaussians whose flag is set, with their moments, in order.
    pub fn retain(&mut self, keep: &[bool]) {
        debug_assert_eq!(keep.len(), self.len);
        for array in &mut self.arrays {
            for column in [
                &mut array.values,
                &mut array.gradients,
                &mut array.first_moments,
                &mut array.second_moments,
            ] {
                retain_rows(column, array.width, keep);
            }
        }
        self.len = keep.iter().filter(|&&flag| flag).count();
    }

    /// Appends copies of the Gaussians `sources`, with zero moments and gradients (3DGS
    /// `densification_postfix`).
    pub fn append_copies(&mut self, sources: &[usize]) {
        for array in &mut self.arrays {
            let width = array.width;
            for &source in sources {
                array
                    .values
                    .extend_from_within(source * width..(source + 1) * width);
            }
            if array.gradients.is_empty() {
                continue;
            }
            let total = array.values.len();
            array.gradients.resize(total, 0.0);
            array.first_moments.resize(total, 0.0);
            array.second_moments.resize(total, 0.0);
        }
        self.len += sources.len();
    }

    /// Permutes the Gaussians, with their moments: new row `i` is old row `order[i]`.
    pub fn permute(&mut self, order: &[usize]) {
        debug_assert_eq!(order.len(), self.len);
        for array in &mut self.arrays {
            let width = array.width;
            for column in [
                &mut array.values,
                &mut array.gradients,
                &mut array.first_moments,
                &mut array.second_moments,
            ] {
                if column.is_empty() {
                    continue;
                }
                let rows = order.iter().map(|&row| row * width..(row + 1) * width);
                *column = rows.flat_map(|row| column[row].iter().copied()).collect();
            }
        }
    }

    /// Returns the index of the array of this name in [`ParameterTable::arrays`].
    pub fn position(&self, name: &str) -> Option<usize> {
        self.arrays.iter().position(|array| array.name == name)
    }

    /// Returns names and widths of all arrays.
    pub fn shapes(&self) -> Vec<ArrayShape> {
        self.arrays
            .iter()
            .map(|array| ArrayShape {
                name: array.name,
                width: array.width,
            })
            .collect()
    }
}

fn retain_rows(column: &mut Vec<f32>, width: usize, keep: &[bool]) {
    if column.is_empty() {
        return;
    }
    let mut write = 0;
    for (read, &flag) in keep.iter().enumerate() {
        if flag {
            column.copy_within(read * width..(read + 1) * width, write * width);
            write += 1;
        }
    }
    column.truncate(write * width);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_frozen_array_has_values_alone_whatever_happens_to_the_rows() {
        let mut table = ParameterTable::new(3);
        table.add("a", 2, vec![0.0, 1.0, 2.0, 3.0, 4.0, 5.0], 0.1);
        table.freeze(0);
        table.permute(&[2, 1, 0]);
        table.retain(&[true, false, true]);
        table.append_copies(&[0]);
        let array = &table.arrays[0];
        assert_eq!(array.values, [4.0, 5.0, 0.0, 1.0, 4.0, 5.0]);
        assert!(array.is_frozen() && array.gradients.is_empty());
        assert!(array.first_moments.is_empty() && array.second_moments.is_empty());
        assert_eq!(array.bytes(), 24);
    }

    #[test]
    fn tables_hand_on_the_memory_of_their_gradients_and_learn_as_before() {
        let table = |len: usize, first: f32| {
            let mut table = ParameterTable::new(len);
            table.add("kept", 1, vec![first; len], 0.0);
            table.add("learnt", 2, vec![first; 2 * len], 0.0);
            table.freeze(0);
            table
        };
        let (mut one, mut other) = (table(3, 1.0), table(2, 2.0));
        let mut memory = GradientMemory::default();
        for table in [&mut one, &mut other] {
            table.take_gradients(&mut memory);
        }
        assert!(!one.arrays[1].is_frozen() && one.arrays[1].gradients.is_empty());
        for table in [&mut one, &mut other] {
            table.lend_gradients(&mut memory);
            assert_eq!(table.arrays[1].gradients.len(), 2 * table.len());
            assert!(table.arrays[0].is_frozen() && table.arrays[0].gradients.is_empty());
            table.take_gradients(&mut memory);
        }
        assert_eq!(memory.0[1].len(), 4);
        let joined = ParameterTable::joined([&one, &other].into_iter());
        assert_eq!(joined.arrays[0].values, [1.0, 1.0, 1.0, 2.0, 2.0]);
        assert_eq!((joined.len(), joined.arrays[1].values.len()), (5, 10));
        assert!(joined.arrays.iter().all(ParameterArray::is_frozen));
    }

    #[test]
    fn retain_and_append_keep_rows_together() {
        let mut table = ParameterTable::new(3);
        table.add("a", 2, vec![0.0, 1.0, 2.0, 3.0, 4.0, 5.0], 0.1);
        table.arrays[0].first_moments = vec![1.0; 6];
        table.retain(&[true, false, true]);
        assert_eq!(table.arrays[0].values, [0.0, 1.0, 4.0, 5.0]);
        table.append_copies(&[1]);
        assert_eq!(table.len(), 3);
        assert_eq!(table.arrays[0].values, [0.0, 1.0, 4.0, 5.0, 4.0, 5.0]);
        assert_eq!(
            table.arrays[0].first_moments,
            [1.0, 1.0, 1.0, 1.0, 0.0, 0.0]
        );
    }
}
