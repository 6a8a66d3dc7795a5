//! Runs of constant strokes: for each pixel, the one that goes on and the last that ended.

use super::stability::Sample;

/// Least gradient of a stroke, 8-bit levels per pixel.
const LEAST_STROKE: f32 = 14.0;
/// A stroke goes on while its gradient is this near to its mean, as a share of the longer one.
const KEPT_SHARE: f32 = 0.25;
/// Least number of samples of a run that counts.
const LEAST_SAMPLES: u32 = 4;

/// Runs of all pixels of an image, row by row.
#[derive(Debug, Clone, Default)]
pub(super) struct Runs {
    pixels: Vec<Pixel>,
}

#[derive(Debug, Clone, Copy, Default)]
struct Pixel {
    open: Run,
    /// The last run that ended and counts.
    ended: Option<Run>,
}

/// A stroke that stays over samples in succession.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Run {
    /// Number of its first sample.
    pub(super) begin: u32,
    /// Zero without a stroke.
    samples: u32,
    /// Means over the samples.
    pub(super) gradient: [f32; 2],
    pub(super) strength: f32,
    pub(super) level: f32,
    level_squared: f32,
}

impl Run {
    /// Returns the number of its last sample.
    pub(super) fn end(&self) -> u32 {
        self.begin + self.samples.saturating_sub(1)
    }

    /// Returns the standard deviation of its luminance, 8-bit levels.
    pub(super) fn variation(&self) -> f32 {
        (self.level_squared - self.level * self.level)
            .max(0.0)
            .sqrt()
    }

    fn counts(&self) -> bool {
        self.samples >= LEAST_SAMPLES
    }

    fn goes_on_with(&self, sample: &Sample) -> bool {
        let [x, y] = [0, 1].map(|axis| sample.gradient[axis] - self.gradient[axis]);
        let [mean_x, mean_y] = self.gradient;
        let mean = (mean_x * mean_x + mean_y * mean_y).sqrt();
        self.samples > 0
            && sample.strength() >= LEAST_STROKE
            && (x * x + y * y).sqrt() <= KEPT_SHARE * mean.max(sample.strength())
    }

    fn add(&mut self, sample: &Sample) {
        self.samples += 1;
        let share = 1.0 / self.samples as f32;
        let near = |mean: f32, value: f32| mean + (value - mean) * share;
        self.gradient = [0, 1].map(|axis| near(self.gradient[axis], sample.gradient[axis]));
        self.strength = near(self.strength, sample.strength());
        self.level = near(self.level, sample.level);
        self.level_squared = near(self.level_squared, sample.level * sample.level);
    }
}

impl Runs {
    /// Returns the number of pixels.
    pub(super) fn len(&self) -> usize {
        self.pixels.len()
    }

    /// Adds the sample of this number to all pixels.
    pub(super) fn add(&mut self, number: u32, samples: &[Sample]) {
        self.pixels.resize(samples.len(), Pixel::default());
        for (pixel, sample) in self.pixels.iter_mut().zip(samples) {
            if pixel.open.goes_on_with(sample) {
                pixel.open.add(sample);
                continue;
            }
            pixel.end();
            if sample.strength() >= LEAST_STROKE {
                pixel.open = Run {
                    begin: number,
                    ..Run::default()
                };
                pixel.open.add(sample);
            }
        }
    }

    /// Ends the runs that go on, after the last sample.
    pub(super) fn end(&mut self) {
        self.pixels.iter_mut().for_each(Pixel::end);
    }

    /// Returns the last ended runs with their pixels.
    pub(super) fn ended(&self) -> impl Iterator<Item = (usize, &Run)> {
        let pixels = self.pixels.iter().enumerate();
        pixels.filter_map(|(at, pixel)| Some((at, pixel.ended.as_ref()?)))
    }

    /// Returns true if a stroke stays in a pixel at or after the sample of this number.
    pub(super) fn has_stroke_since(&self, at: usize, number: u32) -> bool {
        let Pixel { open, ended } = &self.pixels[at];
        open.counts() || ended.is_some_and(|run| run.end() >= number)
    }
}

impl Pixel {
    fn end(&mut self) {
        if self.open.counts() {
            self.ended = Some(self.open);
        }
        self.open = Run::default();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn runs(gradients: &[f32]) -> Runs {
        let mut runs = Runs::default();
        for (number, &gradient) in gradients.iter().enumerate() {
            let sample = Sample {
                level: 100.0 + number as f32,
                gradient: [gradient, 0.0],
            };
            runs.add(number as u32, &[sample]);
        }
        runs
    }

    /// Begin, end and mean gradient of the last ended run.
    fn ended(gradients: &[f32]) -> Option<(u32, u32, f32)> {
        let runs = runs(gradients);
        let last = runs.ended().next();
        last.map(|(_, run)| (run.begin, run.end(), run.gradient[0]))
    }

    #[test]
    fn a_run_ends_where_a_stroke_changes_or_goes() {
        assert_eq!(
            ended(&[0.0, 40.0, 40.0, 40.0, 40.0, 0.0]),
            Some((1, 4, 40.0))
        );
        assert_eq!(ended(&[20.0, 20.0, 20.0, 20.0, 90.0]), Some((0, 3, 20.0)));
        // The other direction is another stroke.
        assert_eq!(
            ended(&[-50.0, -50.0, -50.0, -50.0, 50.0]),
            Some((0, 3, -50.0))
        );
    }

    #[test]
    fn short_and_faint_runs_do_not_count() {
        assert_eq!(ended(&[40.0, 40.0, 40.0, 0.0]), None);
        assert_eq!(ended(&[13.0; 9]), None);
        assert_eq!(ended(&[40.0; 9]), None);
        assert!(runs(&[40.0; 9]).has_stroke_since(0, 99));
        assert!(!runs(&[40.0; 3]).has_stroke_since(0, 0));
    }

    #[test]
    fn open_runs_end_after_the_last_sample() {
        let mut runs = runs(&[40.0; 5]);
        runs.end();
        let [(_, run)] = runs.ended().collect::<Vec<_>>()[..] else {
            panic!("one run")
        };
        assert_eq!((run.begin, run.end()), (0, 4));
        // Levels 100 to 104.
        assert!((run.level - 102.0).abs() < 1e-3);
        assert!((run.variation() - 2.0_f32.sqrt()).abs() < 1e-2);
    }
}
