//! Parameter table in GPU memory: its arrays are concatenated in four buffers, each with capacity for more
//! Gaussians.

use crate::device::{DeviceBuffer, Gpu, GpuError};
use crate::parameters::{ParameterArray, adam::gpu::MAX_ARRAYS};

/// Values, gradients and moments of all arrays of a table. Value `i` of Gaussian `g` in an array of width `w` has
/// the index `b + g * w + i` in each buffer, where `b` is the array's [`TableBuffers::begin`].
#[derive(Debug)]
pub struct TableBuffers {
    /// Raw parameters, in the units of their parameterization.
    pub values: DeviceBuffer<f32>,
    /// Gradients of the loss by the raw parameters.
    pub gradients: DeviceBuffer<f32>,
    /// Adam's first moments.
    pub first_moments: DeviceBuffer<f32>,
    pub(crate) second_moments: DeviceBuffer<f32>,
    /// Values per Gaussian of each array.
    pub(crate) widths: Vec<usize>,
    /// Capacity in Gaussians.
    pub capacity: usize,
}

impl TableBuffers {
    /// Allocates zeros for arrays of these widths.
    pub(crate) fn zeros(gpu: &Gpu, widths: Vec<usize>, capacity: usize) -> Result<Self, GpuError> {
        assert!(widths.len() <= MAX_ARRAYS, "too many arrays");
        let len = widths.iter().sum::<usize>() * capacity;
        if u32::try_from(len).is_err() {
            return Err(GpuError::TooSmall {
                adapter: gpu.adapter().name.clone(),
                what: "the parameters of all Gaussians (values)".to_owned(),
                needed: len as u64,
                offered: u64::from(u32::MAX),
            });
        }
        let zeros = |label| DeviceBuffer::zeros(gpu, label, len);
        Ok(Self {
            values: zeros("parameters")?,
            gradients: zeros("gradients by parameters")?,
            first_moments: zeros("first moments")?,
            second_moments: zeros("second moments")?,
            widths,
            capacity,
        })
    }

    /// Uploads a table's arrays of `rows` rows, with a capacity of `capacity`.
    pub(crate) fn new(
        gpu: &Gpu,
        arrays: &[ParameterArray],
        [rows, capacity]: [usize; 2],
    ) -> Result<Self, GpuError> {
        let widths = arrays.iter().map(|array| array.width).collect();
        let buffers = Self::zeros(gpu, widths, capacity)?;
        for (number, array) in arrays.iter().enumerate() {
            assert_eq!(array.values.len(), rows * array.width, "{}", array.name);
            let first = buffers.begin(number) as usize;
            buffers.values.write(gpu, first, &array.values);
            // Empty for a frozen array, whose step size is zero.
            buffers
                .first_moments
                .write(gpu, first, &array.first_moments);
            buffers
                .second_moments
                .write(gpu, first, &array.second_moments);
        }
        Ok(buffers)
    }

    /// Returns the offset of array number `array`, in values.
    pub fn begin(&self, array: usize) -> u32 {
        let before: usize = self.widths[..array].iter().sum();
        (before * self.capacity) as u32
    }

    /// Returns the values per Gaussian of all arrays.
    pub(crate) fn width(&self) -> usize {
        self.widths.iter().sum()
    }

    /// Copies values and moments back into arrays of the same widths, in their length.
    pub(crate) fn read(&self, gpu: &Gpu, arrays: &mut [ParameterArray]) -> Result<(), GpuError> {
        type Column = fn(&mut ParameterArray) -> &mut Vec<f32>;
        let columns: [(&DeviceBuffer<f32>, Column); 3] = [
            (&self.values, |array| &mut array.values),
            (&self.first_moments, |array| &mut array.first_moments),
            (&self.second_moments, |array| &mut array.second_moments),
        ];
        for (buffer, column) in columns {
            self.read_column(gpu, buffer, arrays, column)?;
        }
        Ok(())
    }

    /// Copies gradients back, for tests: every step overwrites them.
    pub(crate) fn read_gradients(
        &self,
        gpu: &Gpu,
        arrays: &mut [ParameterArray],
    ) -> Result<(), GpuError> {
        self.read_column(gpu, &self.gradients, arrays, |array| &mut array.gradients)
    }

    fn read_column(
        &self,
        gpu: &Gpu,
        buffer: &DeviceBuffer<f32>,
        arrays: &mut [ParameterArray],
        column: fn(&mut ParameterArray) -> &mut Vec<f32>,
    ) -> Result<(), GpuError> {
        // A frozen array has neither gradients nor moments.
        let ranges: Vec<_> = (0..)
            .zip(arrays.iter_mut())
            .map(|(number, array)| {
                let begin = self.begin(number) as usize;
                (buffer, begin..begin + column(array).len())
            })
            .collect();
        let read = DeviceBuffer::read_ranges(gpu, &ranges)?;
        for (array, values) in arrays.iter_mut().zip(read) {
            *column(array) = values;
        }
        Ok(())
    }
}
