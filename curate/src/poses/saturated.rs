//! Files of distances with many pixels at the largest value of 16 bits.
//!
//! Some programs write it for the sky and for distances beyond their range. Here an unknown distance is 0, so such
//! pixels count as a surface, which a line reports.

use std::path::Path;

use omnilife_schemas::{plain_text, progress::Progress};

/// Share of the pixels of a file from which on it is reported.
const LEAST_SHARE: f64 = 0.01;

/// Saturated files among those of distances.
pub(super) struct SaturatedFiles {
    /// Length of a step of 1, in units of the world.
    unit: f64,
    names: Vec<String>,
}

impl SaturatedFiles {
    /// Makes an empty list of files in which a step of 1 means `unit`.
    pub(super) fn new(unit: f64) -> Self {
        Self {
            unit,
            names: Vec::new(),
        }
    }

    /// Adds a file if enough of its pixels have the largest value.
    pub(super) fn add(&mut self, file: &Path, are_largest: impl ExactSizeIterator<Item = bool>) {
        let pixels = are_largest.len().max(1);
        let largest = are_largest.filter(|&is_largest| is_largest).count();
        if largest as f64 >= LEAST_SHARE * pixels as f64 {
            let name = file.file_name().unwrap_or_default();
            self.names.push(name.to_string_lossy().into_owned());
        }
    }

    /// Reports the files, if any.
    pub(super) fn report(&self, progress: &dyn Progress) {
        if self.names.is_empty() {
            return;
        }
        progress.note(&format!(
            "{} of distances have the value 65535 in 1 % of their pixels or more, which is taken as a distance of {}: \
             write 0 where it is unknown ({})",
            plain_text::counted(self.names.len(), "file"),
            f64::from(u16::MAX) * self.unit,
            plain_text::first_of(&self.names)
        ));
    }
}
