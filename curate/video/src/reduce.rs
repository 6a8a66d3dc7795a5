//! Reduction of large frames by whole factors, before colours are converted.
//!
//! A detector on images of 128 pixels does not need the colours of 8 million. Blocks of samples are averaged plane by
//! plane, in the source's own YUV; the general scaler gets a small image.

use ffmpeg_next as ffmpeg;

use super::{
    PixelFormat,
    planes::{self, Plane},
    scaler::FrameShape,
};

/// Least number of rows that are averaged into one, if there are that many.
const ROWS_AVERAGED: u32 = 4;

/// Reduction of frames of one format and size.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Reduction {
    source: PlaneLayout,
    /// Output shape, with the source's depth.
    pub(super) target: FrameShape,
    /// Columns and rows of luma samples that become one.
    factor: u32,
    /// Columns and rows of chroma samples that become one.
    chroma_factor: [u32; 2],
    /// One row of this many is read. A detector sees no difference, and the time depends on the samples read.
    row_step: u32,
}

/// Formats whose planes are rows of samples and nothing else.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct PlaneLayout {
    /// Luma samples per chroma sample, along rows and along columns.
    subsampling: [u32; 2],
    bytes: usize,
    /// The same format without subsampling, and as it is.
    full: PixelFormat,
    same: PixelFormat,
}

impl PlaneLayout {
    fn of(format: PixelFormat) -> Option<Self> {
        let (subsampling, bytes, full) = match format {
            PixelFormat::YUV420P => ([2, 2], 1, PixelFormat::YUV444P),
            PixelFormat::YUVJ420P => ([2, 2], 1, PixelFormat::YUVJ444P),
            PixelFormat::YUV422P => ([2, 1], 1, PixelFormat::YUV444P),
            PixelFormat::YUV444P => ([1, 1], 1, PixelFormat::YUV444P),
            PixelFormat::YUV420P10LE => ([2, 2], 2, PixelFormat::YUV444P10LE),
            _ => return None,
        };
        Some(Self {
            subsampling,
            bytes,
            full,
            same: format,
        })
    }
}

impl Reduction {
    /// Returns the reduction by the largest whole factor that leaves at least `width_limit` pixels per row and no
    /// remainder. `None` if that is 1 or the format does not have plain planes.
    pub(super) fn new(shape: FrameShape, width_limit: u32) -> Option<Self> {
        let FrameShape { width, height, .. } = shape;
        let source = PlaneLayout::of(shape.format)?;
        let [across, down] = source.subsampling;
        let (chroma_width, chroma_height) = (width.div_ceil(across), height.div_ceil(down));
        (2..=width / width_limit.max(1)).rev().find_map(|factor| {
            // With an even factor every pixel gets its own chroma, else as many as before.
            let (format, chroma_factor) =
                if factor.is_multiple_of(across) && factor.is_multiple_of(down) {
                    (source.full, [factor / across, factor / down])
                } else {
                    (source.same, [factor, factor])
                };
            let sizes = [width, height, chroma_width, chroma_height];
            let factors = [factor, factor, chroma_factor[0], chroma_factor[1]];
            let fits = sizes
                .iter()
                .zip(factors)
                .all(|(size, factor)| size.is_multiple_of(factor));
            fits.then_some(Self {
                source,
                target: FrameShape {
                    format,
                    width: width / factor,
                    height: height / factor,
                },
                factor,
                chroma_factor,
                row_step: (factor / ROWS_AVERAGED).max(1),
            })
        })
    }

    /// Returns the reduction of a frame of the format and size for which it was created.
    ///
    /// # Errors
    /// When the frame's planes are not those of its format, or there is not enough memory.
    pub(super) fn apply(
        &self,
        image: &ffmpeg::frame::Video,
    ) -> Result<ffmpeg::frame::Video, ffmpeg::Error> {
        let FrameShape {
            format,
            width,
            height,
        } = self.target;
        let mut reduced = planes::allocated(format, width, height)?;
        for plane in 0..3 {
            let factors = if plane == 0 {
                [self.factor; 2]
            } else {
                self.chroma_factor
            };
            let source = Plane::of(image, plane).ok_or(ffmpeg::Error::InvalidData)?;
            let columns = format
                .row_bytes(plane, width as usize)
                .ok_or(ffmpeg::Error::InvalidData)?
                / self.source.bytes;
            let blocks = Blocks {
                across: factors[0] as usize,
                down: factors[1] as usize,
                row_step: self.row_step as usize,
                columns,
            };
            let target = planes::rows_mut(&mut reduced, plane)?;
            if self.source.bytes == 1 {
                blocks.average_bytes(source, target);
            } else {
                blocks.average_words(source, target);
            }
        }
        Ok(reduced)
    }
}

/// The blocks of a plane that become one sample each.
struct Blocks {
    /// Samples of a block along a row.
    across: usize,
    /// Rows of a block.
    down: usize,
    /// One row of this many is read.
    row_step: usize,
    /// Blocks per row.
    columns: usize,
}

impl Blocks {
    fn average_bytes<'a>(&self, source: Plane<'_>, target: impl Iterator<Item = &'a mut [u8]>) {
        let mut sums = vec![0_u16; self.across * self.columns];
        for (row, target) in target.enumerate() {
            let count = self.sum_rows(row, &mut sums, |y, sums| {
                let samples = &source.row(y)[..sums.len()];
                add(sums, samples.iter().map(|&sample| u16::from(sample)));
            });
            let means = means(&sums, self.across, count);
            target.iter_mut().zip(means).for_each(|(target, mean)| {
                *target = mean as u8;
            });
        }
    }

    /// Averages samples of 10 bits in two bytes, the lower first.
    fn average_words<'a>(&self, source: Plane<'_>, target: impl Iterator<Item = &'a mut [u8]>) {
        let mut sums = vec![0_u16; self.across * self.columns];
        for (row, target) in target.enumerate() {
            let count = self.sum_rows(row, &mut sums, |y, sums| {
                let samples = source.row(y)[..2 * sums.len()].as_chunks::<2>().0;
                add(sums, samples.iter().map(|&bytes| u16::from_le_bytes(bytes)));
            });
            let means = means(&sums, self.across, count);
            let (target, _) = target.as_chunks_mut::<2>();
            target.iter_mut().zip(means).for_each(|(target, mean)| {
                *target = (mean as u16).to_le_bytes();
            });
        }
    }

    /// Adds the rows that are read of a row of blocks to `sums` by `add_row`, and counts them. These are at most 7 rows
    /// of 10 bits: 16 bits hold their sum.
    fn sum_rows(
        &self,
        row: usize,
        sums: &mut [u16],
        mut add_row: impl FnMut(usize, &mut [u16]),
    ) -> u32 {
        sums.fill(0);
        let rows = (row * self.down..(row + 1) * self.down).step_by(self.row_step);
        let count = rows.len() as u32;
        rows.for_each(|y| add_row(y, sums));
        count
    }
}

/// Adds without checks for overflow, which cannot happen; checks would keep processors from adding eight at once.
fn add(sums: &mut [u16], samples: impl Iterator<Item = u16>) {
    for (sum, sample) in sums.iter_mut().zip(samples) {
        *sum = sum.wrapping_add(sample);
    }
}

/// Returns rounded means of blocks of columns, each the sum of `rows` samples.
fn means(sums: &[u16], across: usize, rows: u32) -> impl Iterator<Item = u32> {
    let count = rows * across as u32;
    sums.chunks_exact(across).map(move |block| {
        let sum = block
            .iter()
            .fold(0_u32, |sum, &value| sum.wrapping_add(u32::from(value)));
        (sum + count / 2) / count
    })
}

#[cfg(test)]
mod tests {
    use ffmpeg::format::Pixel;

    use super::*;

    fn reduction(format: Pixel, (width, height): (u32, u32), limit: u32) -> Option<Reduction> {
        let format = format.into();
        Reduction::new(
            FrameShape {
                format,
                width,
                height,
            },
            limit,
        )
    }

    /// Creates a frame whose samples are `value` of plane, column and row.
    fn frame(
        format: Pixel,
        (width, height): (u32, u32),
        value: impl Fn(usize, usize, usize) -> u16,
    ) -> ffmpeg::frame::Video {
        let mut frame = ffmpeg::frame::Video::new(format, width, height);
        let bytes = PlaneLayout::of(format.into()).map_or(1, |layout| layout.bytes);
        for plane in 0..3 {
            let stride = frame.stride(plane);
            let (columns, rows) = (frame.plane_width(plane), frame.plane_height(plane));
            for y in 0..rows as usize {
                for x in 0..columns as usize {
                    let sample = value(plane, x, y).to_le_bytes();
                    let at = y * stride + x * bytes;
                    frame.data_mut(plane)[at..at + bytes].copy_from_slice(&sample[..bytes]);
                }
            }
        }
        frame
    }

    /// Asserts that every sample of a reduced frame is right, by the definition.
    fn assert_means(format: Pixel, size: (u32, u32), limit: u32, levels: u16) -> Reduction {
        let value = |plane: usize, x: usize, y: usize| {
            ((x * 7 + y * 13 + x * y % 31 + plane * 50) % usize::from(levels)) as u16
        };
        let reduction = reduction(format, size, limit)
            .unwrap_or_else(|| panic!("{format:?} {size:?} is not reduced"));
        let reduced = reduction
            .apply(&frame(format, size, value))
            .unwrap_or_else(|error| panic!("{format:?}: {error}"));
        let bytes = reduction.source.bytes;
        for plane in 0..3 {
            let [across, down] = if plane == 0 {
                [reduction.factor as usize; 2]
            } else {
                reduction.chroma_factor.map(|factor| factor as usize)
            };
            for y in 0..reduced.plane_height(plane) as usize {
                for x in 0..reduced.plane_width(plane) as usize {
                    let rows = (y * down..(y + 1) * down).step_by(reduction.row_step as usize);
                    let samples: Vec<f64> = rows
                        .flat_map(|row| (0..across).map(move |i| (x * across + i, row)))
                        .map(|(column, row)| f64::from(value(plane, column, row)))
                        .collect();
                    let mean = samples.iter().sum::<f64>() / samples.len() as f64;
                    let at = y * reduced.stride(plane) + x * bytes;
                    let data = &reduced.data(plane)[at..at + bytes];
                    let found = data
                        .iter()
                        .rev()
                        .fold(0, |sum, &byte| sum * 256 + u32::from(byte));
                    assert!(
                        (f64::from(found) - mean).abs() <= 0.5 + 1e-9,
                        "{format:?} plane {plane} ({x}, {y}): {found}, the mean is {mean}"
                    );
                }
            }
        }
        reduction
    }

    #[test]
    fn samples_are_the_means_of_their_blocks() {
        // An even factor gives every pixel its own chroma.
        let halved = assert_means(Pixel::YUV420P, (256, 128), 32, 256);
        assert_eq!(
            (halved.target.format, halved.factor),
            (PixelFormat::YUV444P, 8)
        );
        let odd = assert_means(Pixel::YUVJ420P, (192, 108), 64, 256);
        assert_eq!((odd.target.format, odd.factor), (PixelFormat::YUVJ420P, 3));
        let deep = assert_means(Pixel::YUV420P10LE, (256, 64), 16, 1024);
        assert_eq!(
            (deep.target.format, deep.row_step),
            (PixelFormat::YUV444P10LE, 4)
        );
        let _ = assert_means(Pixel::YUV422P, (256, 128), 60, 256);
        let _ = assert_means(Pixel::YUV444P, (256, 128), 100, 256);
    }

    #[test]
    fn what_leaves_a_remainder_takes_the_next_smaller_factor_or_none() {
        let factor = |width, height, limit| {
            reduction(Pixel::YUV420P, (width, height), limit).map(|r| r.factor)
        };
        assert_eq!(factor(3840, 1920, 512), Some(6));
        assert_eq!(factor(1920, 1080, 512), Some(3));
        assert_eq!(factor(4096, 2048, 128), Some(32));
        assert_eq!(factor(1366, 683, 512), None);
        assert_eq!(factor(512, 256, 512), None);
        assert_eq!(reduction(Pixel::RGB24, (4096, 2048), 128), None);
        assert_eq!(factor(4096, 2048, 0).map(|factor| factor > 1), Some(true));
    }
}
