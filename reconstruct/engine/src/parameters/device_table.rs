//! A table of parameter arrays in the device's memory: array after array in four buffers.

use crate::device::{DeviceBuffer, Gpu, GpuError};
use crate::parameters::{ParameterArray, adam::gpu::MAX_ARRAYS};

/// Values, gradients and moments of all arrays of a table.
#[derive(Debug)]
pub(crate) struct TableBuffers {
    pub(crate) values: DeviceBuffer<f32>,
    pub(crate) gradients: DeviceBuffer<f32>,
    pub(crate) first_moments: DeviceBuffer<f32>,
    pub(crate) second_moments: DeviceBuffer<f32>,
    /// Where each array ends, in values from the beginning of the first.
    pub(crate) ends: Vec<u32>,
}

impl TableBuffers {
    /// Zeros, for arrays with these values for each of `rows` Gaussians.
    pub(crate) fn zeros(gpu: &Gpu, widths: &[usize], rows: usize) -> Result<Self, GpuError> {
        assert!(widths.len() <= MAX_ARRAYS, "too many arrays");
        let mut len = 0;
        let ends = widths
            .iter()
            .map(|width| {
                len += width * rows;
                u32::try_from(len).map_err(|_| GpuError::TooSmall {
                    adapter: gpu.adapter().name.clone(),
                    what: "the parameters of all Gaussians (values)".to_owned(),
                    needed: len as u64,
                    offered: u64::from(u32::MAX),
                })
            })
            .collect::<Result<Vec<u32>, GpuError>>()?;
        let zeros = |label| DeviceBuffer::zeros(gpu, label, len);
        Ok(Self {
            values: zeros("parameters")?,
            gradients: zeros("gradients by parameters")?,
            first_moments: zeros("first moments")?,
            second_moments: zeros("second moments")?,
            ends,
        })
    }

    /// A copy of a table's arrays.
    pub(crate) fn new(gpu: &Gpu, arrays: &[ParameterArray]) -> Result<Self, GpuError> {
        let lengths: Vec<usize> = arrays.iter().map(|array| array.values.len()).collect();
        let buffers = Self::zeros(gpu, &lengths, 1)?;
        let mut first = 0;
        for array in arrays {
            buffers.values.write(gpu, first, &array.values);
            // None of a frozen array, whose steps have no size.
            buffers
                .first_moments
                .write(gpu, first, &array.first_moments);
            buffers
                .second_moments
                .write(gpu, first, &array.second_moments);
            first += array.values.len();
        }
        Ok(buffers)
    }

    /// Where array number `array` begins.
    pub(crate) fn begin(&self, array: usize) -> u32 {
        if array == 0 { 0 } else { self.ends[array - 1] }
    }

    /// Values of one array.
    pub(crate) fn read_array(&self, gpu: &Gpu, array: usize) -> Result<Vec<f32>, GpuError> {
        let values = self.begin(array) as usize..self.ends[array] as usize;
        self.values.read_range(gpu, values)
    }

    /// Copies values and moments back into arrays of the same sizes; of those that are frozen, nothing.
    pub(crate) fn read(&self, gpu: &Gpu, arrays: &mut [ParameterArray]) -> Result<(), GpuError> {
        type Column = fn(&mut ParameterArray) -> &mut Vec<f32>;
        let columns: [(&DeviceBuffer<f32>, Column); 3] = [
            (&self.values, |array| &mut array.values),
            (&self.first_moments, |array| &mut array.first_moments),
            (&self.second_moments, |array| &mut array.second_moments),
        ];
        for (buffer, column) in columns {
            read_column(gpu, buffer, arrays, column)?;
        }
        Ok(())
    }

    /// Copies gradients back: every step makes them anew, and only those who judge it want them.
    pub(crate) fn read_gradients(
        &self,
        gpu: &Gpu,
        arrays: &mut [ParameterArray],
    ) -> Result<(), GpuError> {
        read_column(gpu, &self.gradients, arrays, |array| &mut array.gradients)
    }
}

fn read_column(
    gpu: &Gpu,
    buffer: &DeviceBuffer<f32>,
    arrays: &mut [ParameterArray],
    column: fn(&mut ParameterArray) -> &mut Vec<f32>,
) -> Result<(), GpuError> {
    let all = buffer.read(gpu)?;
    let mut rest = all.as_slice();
    for array in arrays {
        let (mine, others) = rest.split_at(array.values.len());
        rest = others;
        if !array.is_frozen() {
            column(array).copy_from_slice(mine);
        }
    }
    Ok(())
}
