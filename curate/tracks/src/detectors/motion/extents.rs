//! Distances of colours from the range of a background within a pixel.

/// Colours of a row, channel by channel; NaN if unknown.
#[derive(Clone)]
pub(super) struct RowColours {
    pub(super) channels: [Vec<f32>; 3],
    /// True if any is known.
    pub(super) is_known: bool,
}

impl RowColours {
    pub(super) fn unknown(width: usize) -> Self {
        Self {
            channels: [0; 3].map(|_| vec![f32::NAN; width]),
            is_known: false,
        }
    }

    /// Forgets all of them.
    pub(super) fn clear(&mut self) {
        for channel in &mut self.channels {
            channel.fill(f32::NAN);
        }
        self.is_known = false;
    }

    pub(super) fn put(&mut self, column: usize, colour: [f32; 3]) {
        for (channel, value) in self.channels.iter_mut().zip(colour) {
            channel[column] = value;
        }
        self.is_known = true;
    }
}

/// Buffers of the width of a row with a column before and one behind it.
pub(super) struct RowExtents {
    low: Vec<f32>,
    high: Vec<f32>,
    beyond: Vec<f32>,
}

impl RowExtents {
    pub(super) fn new(width: usize) -> Self {
        Self {
            low: vec![f32::INFINITY; width + 2],
            high: vec![f32::NEG_INFINITY; width + 2],
            beyond: vec![0.0; width],
        }
    }

    /// Computes the distances of a row's colours from the range of a background within a pixel, if it has any in the
    /// same place; other values stay. `background` are the rows above, in the same place and below.
    pub(super) fn differences(
        &mut self,
        shown: [&[f32]; 3],
        background: [&RowColours; 3],
        out: &mut [f32],
    ) {
        self.beyond.fill(0.0);
        for (channel, shown) in shown.into_iter().enumerate() {
            let rows = background.map(|row| row.channels[channel].as_slice());
            add_beyond(
                shown,
                rows,
                [&mut self.low, &mut self.high],
                &mut self.beyond,
            );
        }
        let known = &background[1].channels[0];
        for ((out, beyond), known) in out.iter_mut().zip(&self.beyond).zip(known) {
            if !known.is_nan() {
                *out = beyond / 3.0;
            }
        }
    }
}

/// Returns the lesser of two; if the first is NaN, the second.
#[inline(always)]
pub(super) fn lesser(a: f32, b: f32) -> f32 {
    if a < b { a } else { b }
}

/// Returns the larger of two; if the first is NaN, the second.
#[inline(always)]
pub(super) fn larger(a: f32, b: f32) -> f32 {
    if a > b { a } else { b }
}

/// Adds the distances of a channel of a row from the range of three rows of a background within a column. `low` and
/// `high` have a neutral column before and behind the row's.
#[multiversion::multiversion(targets("x86_64+avx2"))]
fn add_beyond(
    shown: &[f32],
    [above, at, below]: [&[f32]; 3],
    [low, high]: [&mut [f32]; 2],
    beyond: &mut [f32],
) {
    let inner = low.iter_mut().zip(high.iter_mut()).skip(1);
    for ((low, high), ((above, at), below)) in inner.zip(above.iter().zip(at).zip(below)) {
        *low = lesser(*above, lesser(*at, lesser(*below, f32::INFINITY)));
        *high = larger(*above, larger(*at, larger(*below, f32::NEG_INFINITY)));
    }
    let lows = low.windows(3).zip(high.windows(3));
    for ((beyond, shown), (low, high)) in beyond.iter_mut().zip(shown).zip(lows) {
        let low = lesser(low[0], lesser(low[1], low[2]));
        let high = larger(high[0], larger(high[1], high[2]));
        *beyond += larger(larger(shown - high, low - shown), 0.0);
    }
}

/// The least and the largest colour of some pixels; NaN changes neither.
#[derive(Debug, Clone, Copy)]
pub(super) struct Extent {
    low: [f32; 3],
    high: [f32; 3],
}

impl Extent {
    pub(super) const NOTHING: Self = Self {
        low: [f32::INFINITY; 3],
        high: [f32::NEG_INFINITY; 3],
    };

    #[inline]
    pub(super) fn with(&self, colour: [f32; 3]) -> Self {
        let ([a, b, c], low, high) = (colour, self.low, self.high);
        Self {
            low: [lesser(a, low[0]), lesser(b, low[1]), lesser(c, low[2])],
            high: [larger(a, high[0]), larger(b, high[1]), larger(c, high[2])],
        }
    }

    /// Returns the mean distance of a colour from the range over the channels.
    #[inline]
    pub(super) fn distance(&self, colour: [f32; 3]) -> f32 {
        let mut sum = 0.0;
        for ((value, low), high) in colour.iter().zip(&self.low).zip(&self.high) {
            sum += larger(larger(value - high, low - value), 0.0);
        }
        sum / 3.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Colours of an image of 8 x 8, channel by channel.
    type Image = [Vec<f32>; 3];

    /// Returns the differences of an image's rows from a background.
    fn differences(image: &Image, background: &Image) -> Vec<f32> {
        let width = 8;
        let mut rows: Vec<RowColours> = (0..8)
            .map(|row| RowColours {
                channels: [0, 1, 2]
                    .map(|channel| background[channel][8 * row..8 * row + 8].to_vec()),
                is_known: true,
            })
            .collect();
        rows.insert(0, RowColours::unknown(width));
        rows.push(RowColours::unknown(width));
        let mut out = vec![f32::NAN; 64];
        let mut extents = RowExtents::new(width);
        for (row, out) in out.chunks_exact_mut(8).enumerate() {
            let shown = [0, 1, 2].map(|channel| &image[channel][8 * row..8 * row + 8]);
            extents.differences(shown, [&rows[row], &rows[row + 1], &rows[row + 2]], out);
        }
        out
    }

    #[test]
    fn rows_and_single_pixels_say_the_same() {
        let noise = |seed: usize| {
            [0, 1, 2].map(|channel| {
                let value = |at: usize| ((at * 37 + channel * 11 + seed) * 53 % 101) as f32 / 101.0;
                (0..64).map(value).collect::<Vec<f32>>()
            })
        };
        let (image, mut background) = (noise(3), noise(40));
        // A masked pixel is unknown in every channel.
        for at in [0, 9, 10, 30, 63] {
            background
                .iter_mut()
                .for_each(|channel| channel[at] = f32::NAN);
        }
        let found = differences(&image, &background);
        for (pixel, found) in found.iter().enumerate() {
            let (row, column) = (pixel / 8, pixel % 8);
            let mut extent = Extent::NOTHING;
            for row in row.saturating_sub(1)..=(row + 1).min(7) {
                for column in column.saturating_sub(1)..=(column + 1).min(7) {
                    extent =
                        extent.with([0, 1, 2].map(|channel| background[channel][row * 8 + column]));
                }
            }
            let expected = extent.distance([0, 1, 2].map(|channel| image[channel][pixel]));
            if background[0][pixel].is_nan() {
                assert!(found.is_nan());
            } else {
                assert!((found - expected).abs() < 1e-6, "{found} {expected}");
            }
        }
    }

    #[test]
    fn a_shift_by_a_pixel_is_no_difference() {
        let step = |by: usize| {
            [0; 3].map(|_| {
                let value = |at: usize| if at % 8 < 4 + by { 0.2 } else { 0.8 };
                (0..64).map(value).collect::<Vec<f32>>()
            })
        };
        let largest = |by: usize| {
            let all = differences(&step(by), &step(0));
            all.into_iter().fold(0.0, f32::max)
        };
        assert_eq!(largest(1), 0.0);
        assert!(largest(2) > 0.5);
    }
}
