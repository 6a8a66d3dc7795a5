//! Temporal consistency of a video without a truth, such as an edited one: T-LPIPS over its pairs of neighbouring
//! frames, mean and standard deviation (Neural Atlas Graphs, supplement C.2 and Table 7).
//!
//! The scene and the camera move too, so the number is read beside that of a reference video, such as the views of the
//! run that was edited.

use std::path::{Path, PathBuf};

use omnilife_schemas::{natural_order::natural_paths, rgba, store};
use serde::Serialize;

use crate::{
    error::BenchError,
    lpips::{Backbone, InputRange, Lpips},
};

/// T-LPIPS of a folder of frames.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct VideoConsistency {
    /// Number of pairs of neighbouring frames.
    pub pairs: u32,
    /// Width and height of the frames, pixels.
    pub size: [usize; 2],
    /// Mean of LPIPS with `AlexNet` over the pairs.
    pub temporal_lpips: f64,
    /// Standard deviation over the pairs; `None` with a single one.
    pub standard_deviation: Option<f64>,
    /// Names beside the frames that are not PNG images.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub left_out: Vec<String>,
}

impl VideoConsistency {
    /// Checks that a reference can be read beside a video: as many frames, of one size.
    ///
    /// # Errors
    /// One line about the reference.
    pub fn check_reference(&self, folder: &Path, reference: &Self) -> Result<(), BenchError> {
        let frames = [self, reference].map(|one| u64::from(one.pairs) + 1);
        if frames[0] == frames[1] && self.size == reference.size {
            return Ok(());
        }
        let [width, height] = self.size;
        let reason = format!(
            "must have {} frames of {width}x{height} as the video, got {} of {}x{}",
            frames[0], frames[1], reference.size[0], reference.size[1]
        );
        Err(BenchError::mismatch(folder, reason))
    }
}

/// Returns the T-LPIPS of the PNG images in a folder, in natural order of their names, transparent ones over black.
///
/// # Errors
/// When the network's weights are missing, there are fewer than two images, or one cannot be read, has another size or
/// is too small for the network.
pub fn video_consistency(folder: &Path) -> Result<VideoConsistency, BenchError> {
    let paths = store::paths_in(folder)?.into_iter();
    let is_png = |path: &PathBuf| {
        let is_png = path.extension().is_some_and(|extension| extension == "png");
        is_png && !store::is_hidden(path)
    };
    let (mut images, others): (Vec<PathBuf>, Vec<PathBuf>) = paths.partition(is_png);
    images.sort_by(|a, b| natural_paths(a, b));
    if images.len() < 2 {
        return Err(too_few(folder, images.len()));
    }
    // After the folder: the network's weights may be missing, and the folder's fault is the one to mend first.
    let network = Lpips::published(Backbone::Alex)?;
    let features = |size: [usize; 2], image: &[u8]| {
        network
            .features(size, image, InputRange::Signed)
            .ok_or_else(|| {
                let least = Backbone::Alex.smallest_side();
                format!(
                    "must have at least {least} rows and columns, got {}x{}",
                    size[0], size[1]
                )
            })
    };
    let found = over_pairs(folder, &images, features, |before, now| {
        network.distance_of_features([before, now])
    })?;
    let names = others.iter().filter_map(|path| path.file_name());
    Ok(VideoConsistency {
        left_out: names
            .map(|name| name.to_string_lossy().into_owned())
            .collect(),
        ..found
    })
}

fn too_few(folder: &Path, count: usize) -> BenchError {
    let reason = format!("must have at least two PNG images, got {count}");
    BenchError::mismatch(folder, reason)
}

/// Returns mean and deviation of a distance between neighbouring images, from the features of each.
fn over_pairs<T>(
    folder: &Path,
    images: &[PathBuf],
    features: impl Fn([usize; 2], &[u8]) -> Result<T, String>,
    distance: impl Fn(&T, &T) -> f64,
) -> Result<VideoConsistency, BenchError> {
    let mut before: Option<([usize; 2], T)> = None;
    let mut distances = Vec::new();
    for path in images {
        let image = rgba::read_over_black(path)?;
        let size = [image.width, image.height];
        let found = features(size, &image.to_rgb8());
        let now = found.map_err(|reason| BenchError::mismatch(path, reason))?;
        if let Some((expected, earlier)) = &before {
            if size != *expected {
                let [width, height] = *expected;
                let reason = format!(
                    "must be {width}x{height} as the image before it, got {}x{}",
                    size[0], size[1]
                );
                return Err(BenchError::mismatch(path, reason));
            }
            distances.push(distance(earlier, &now));
        }
        before = Some((size, now));
    }
    let Some((size, _)) = before.filter(|_| !distances.is_empty()) else {
        return Err(too_few(folder, images.len()));
    };
    let count = distances.len() as f64;
    let mean = distances.iter().sum::<f64>() / count;
    let squares: f64 = distances.iter().map(|one| (one - mean).powi(2)).sum();
    Ok(VideoConsistency {
        pairs: distances.len() as u32,
        size,
        left_out: Vec::new(),
        temporal_lpips: mean,
        standard_deviation: (distances.len() > 1).then(|| (squares / (count - 1.0)).sqrt()),
    })
}

#[cfg(test)]
mod tests {
    use omnilife_schemas::rgb::write_rgb8_png;

    use super::*;

    /// Returns the consistency of grey images, by the absolute difference of their greys.
    fn of_greys(folder: &Path, images: &[PathBuf]) -> Result<VideoConsistency, String> {
        let grey = |_, image: &[u8]| {
            let first = image.first().copied();
            first.map(f64::from).ok_or_else(|| "is empty".to_owned())
        };
        let found = over_pairs(folder, images, grey, |before, now| (before - now).abs());
        found.map_err(|error| error.to_string())
    }

    fn written(folder: &Path, number: usize, width: usize, grey: u8) -> PathBuf {
        let path = folder.join(format!("{number:06}.png"));
        let image = vec![grey; width * 3];
        let written = write_rgb8_png(&path, width, 1, &image);
        assert!(written.is_ok(), "{written:?}");
        path
    }

    #[test]
    fn neighbours_are_compared_in_their_order() -> Result<(), Box<dyn std::error::Error>> {
        let folder = tempfile::tempdir()?;
        let greys = [10, 20, 50, 50];
        let images = greys.into_iter().enumerate();
        let mut images: Vec<PathBuf> = images
            .map(|(number, grey)| written(folder.path(), number, 4, grey))
            .collect();
        // Differences 10, 30, 0: mean 40/3, variance (100 + 900 - 1600/3) / 2.
        let found = of_greys(folder.path(), &images)?;
        assert_eq!(found.pairs, 3);
        assert!(
            (found.temporal_lpips - 40.0 / 3.0).abs() < 1e-9,
            "{found:?}"
        );
        let deviation = ((1000.0 - 1600.0 / 3.0) / 2.0_f64).sqrt();
        assert!(
            found
                .standard_deviation
                .is_some_and(|one| (one - deviation).abs() < 1e-9)
        );
        let pair = of_greys(folder.path(), &images[..2])?;
        assert_eq!((pair.temporal_lpips, pair.standard_deviation), (10.0, None));
        assert_eq!(found.size, [4, 1]);
        let refusal = |reference: &VideoConsistency| {
            let checked = found.check_reference(folder.path(), reference);
            checked.err().map(|error| error.to_string())
        };
        assert_eq!(refusal(&found), None);
        let shorter = refusal(&pair).unwrap_or_default();
        assert!(shorter.contains("4 frames of 4x1") && shorter.contains("got 2 of 4x1"));
        let wider = VideoConsistency {
            size: [5, 1],
            ..found.clone()
        };
        assert!(refusal(&wider).is_some());
        let alone = of_greys(folder.path(), &images[..1]);
        assert!(alone.is_err_and(|reason| reason.contains("at least two PNG images, got 1")));
        images.push(written(folder.path(), 4, 5, 50));
        let other_size = of_greys(folder.path(), &images);
        assert!(other_size.is_err_and(|reason| reason.contains("must be 4x1")));
        Ok(())
    }
}
