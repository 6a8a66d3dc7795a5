//! Options of tracking, the same for every command that makes tracks.

use std::path::{Path, PathBuf};

use crate::{
    association::Association,
    detectors::{Detector, command, motion},
    distance::DistanceMethod,
    error::TracksError,
};

/// Stages of tracking that a user can choose, with their files.
#[derive(Debug, Clone)]
pub struct TrackOptions {
    /// One of [`DETECTORS`](crate::detectors::DETECTORS).
    pub detector: &'static Detector,
    /// A file of boxes.
    pub detections: Option<PathBuf>,
    /// A TOML of a program that finds boxes.
    pub program: Option<PathBuf>,
    /// The way to find distances.
    pub distance: DistanceMethod,
    /// The way to find which detections are of one object.
    pub association: Association,
    /// Metres in a unit of the world, where the scene does not say.
    pub metres_per_unit: Option<f64>,
    /// The scene's video, of which every frame is used; the samples alone if `None`.
    pub video: Option<PathBuf>,
}

impl Default for TrackOptions {
    /// Returns the choices that need no files and no weights.
    fn default() -> Self {
        Self {
            detector: &motion::DETECTOR,
            detections: None,
            program: None,
            distance: DistanceMethod::Auto,
            association: Association::GroundChains,
            metres_per_unit: None,
            video: None,
        }
    }
}

impl TrackOptions {
    /// Checks everything that holds for any scene, so that a long job can begin with it: the detector has its files,
    /// they can be read, and the network of the association is there.
    ///
    /// # Errors
    /// With the first that does not hold.
    pub fn check(&self) -> Result<(), TracksError> {
        let own = self.program.as_ref().or(self.detections.as_ref());
        let place = own.map_or(Path::new(self.detector.id), PathBuf::as_path);
        let files = self.detector.check_files(self);
        files.map_err(|reason| TracksError::input(place, reason))?;
        if let Some(file) = &self.program {
            command::check(file)?;
        }
        if let Some(file) = self.detections.as_ref().filter(|file| !file.is_file()) {
            let reason = "must be a file of boxes (--detections)";
            return Err(TracksError::input(file, reason));
        }
        if let Some(metres) = self.metres_per_unit
            && !(metres.is_finite() && metres > 0.0)
        {
            let reason = format!("--metres-per-unit must be positive, got {metres}");
            return Err(TracksError::input(place, reason));
        }
        if self.association == Association::DeepSort {
            crate::appearance::published_weights()?;
        }
        Ok(())
    }

    /// Checks that distances are known at every frame of a video.
    ///
    /// # Errors
    /// When they are to be estimates, which samples alone have.
    pub fn check_every_frame(&self) -> Result<(), TracksError> {
        if !self.distance.needs_estimates() {
            return Ok(());
        }
        let reason =
            "has estimates of samples alone, and --every-frame needs distances on the ground";
        let option = format!("--distance {}", self.distance.id());
        Err(TracksError::input(Path::new(&option), reason))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::detectors::files;

    #[test]
    fn faults_of_any_scene_are_found_before_it() {
        assert!(TrackOptions::default().check().is_ok());
        let without_file = TrackOptions {
            detector: &files::DETECTOR,
            ..TrackOptions::default()
        };
        let missing = TrackOptions {
            detections: Some("no/such/boxes.txt".into()),
            ..without_file.clone()
        };
        let of_another = TrackOptions {
            program: Some("program.toml".into()),
            ..TrackOptions::default()
        };
        let without_unit = TrackOptions {
            metres_per_unit: Some(0.0),
            ..TrackOptions::default()
        };
        for (options, named) in [
            (without_file, "--detections FILE"),
            (missing, "no/such/boxes.txt"),
            (of_another, "--program"),
            (without_unit, "--metres-per-unit"),
        ] {
            let refusal = options.check().map_err(|error| error.to_string());
            assert!(
                refusal.as_ref().is_err_and(|words| words.contains(named)),
                "{named}: {refusal:?}"
            );
        }
        for (distance, is_known) in [
            (DistanceMethod::Auto, true),
            (DistanceMethod::Ground, true),
            (DistanceMethod::Monocular, false),
        ] {
            let options = TrackOptions {
                distance,
                ..TrackOptions::default()
            };
            assert_eq!(options.check_every_frame().is_ok(), is_known);
        }
    }
}
