//! Options of tracking, which `run` and `curate tracks` share.

use std::path::PathBuf;

use clap::Args;
use omnilife_schemas::names::{UnknownName, find};
use omnilife_tracks::{
    TrackOptions, association::ASSOCIATIONS, detectors::DETECTORS, distance::DISTANCES,
};

use super::numbers;
use crate::exit::BadRequest;

/// Choices of the chain from videos to paths of vehicles.
#[derive(Debug, Args)]
#[command(next_help_heading = "Tracks of vehicles")]
pub(crate) struct TrackArguments {
    /// Detects vehicles by motion that the points of the scene do not explain, by files of boxes, or by a command.
    #[arg(long, value_name = "DETECTOR", default_value = "motion")]
    pub(crate) vehicle_detector: String,
    /// Boxes of another program for the detector files: MOT text, or COCO JSON.
    #[arg(long, value_name = "FILE")]
    pub(crate) detections: Option<PathBuf>,
    /// Runs the program of this file for the detector command; the file states its arguments and its output.
    #[arg(long, value_name = "FILE.toml")]
    pub(crate) program: Option<PathBuf>,
    /// Places vehicles on the ground around them, or at the distances of a depth prior (`curate poses
    /// --depth-prior`); auto chooses, and records the reason.
    #[arg(long, default_value = "auto")]
    pub(crate) distance: String,
    /// Links the detections of a vehicle by whole chains on the ground, or in the image as DeepSORT does, with its
    /// appearance network (scripts/setup --models).
    #[arg(long, default_value = "ground-chains")]
    pub(crate) association: String,
    /// Metres per unit of the world, for speeds and sizes, where the scene does not state it.
    #[arg(long, value_name = "METRES", value_parser = numbers::positive)]
    pub(crate) metres_per_unit: Option<f64>,
    /// Tracks in every frame of the video, with poses interpolated between those of the samples. Refused where
    /// samples that are left out and interpolated move the ground by more than two pixels.
    #[arg(long)]
    pub(crate) every_frame: bool,
}

impl TrackArguments {
    /// Returns the options of tracking; a video is to be added where `every_frame` is set.
    ///
    /// # Errors
    /// [`UnknownName`] where there is another detector, distance or association.
    pub(crate) fn options(&self) -> Result<TrackOptions, UnknownName> {
        let detector = find("detector", &self.vehicle_detector, DETECTORS, |one| one.id)?;
        Ok(TrackOptions {
            detector,
            detections: self.detections.clone(),
            program: self.program.clone(),
            distance: *find("distance", &self.distance, &DISTANCES, |one| one.id())?,
            association: *find("association", &self.association, &ASSOCIATIONS, |one| {
                one.id()
            })?,
            metres_per_unit: self.metres_per_unit,
            video: None,
        })
    }

    /// Refuses folders of still images where every frame of a video is to be tracked.
    ///
    /// # Errors
    /// One line with the folder.
    pub(crate) fn refuse_stills(&self, videos: &[PathBuf]) -> Result<(), BadRequest> {
        match videos.iter().find(|video| video.is_dir()) {
            Some(folder) if self.every_frame => Err(BadRequest(format!(
                "--every-frame needs videos, got the folder of still images {}",
                folder.display()
            ))),
            _ => Ok(()),
        }
    }

    /// Returns the first option that differs from its default; `None` where tracks are made as every command makes
    /// them.
    pub(crate) fn first_choice(&self) -> Option<&'static str> {
        let default = TrackOptions::default();
        [
            ("--detections", self.detections.is_some()),
            ("--program", self.program.is_some()),
            (
                "--vehicle-detector",
                self.vehicle_detector != default.detector.id,
            ),
            ("--distance", self.distance != default.distance.id()),
            (
                "--association",
                self.association != default.association.id(),
            ),
            ("--metres-per-unit", self.metres_per_unit.is_some()),
            ("--every-frame", self.every_frame),
        ]
        .into_iter()
        .find_map(|(option, is_chosen)| is_chosen.then_some(option))
    }
}

#[cfg(test)]
mod tests {
    use clap::Parser;

    use super::*;

    #[derive(Debug, Parser)]
    struct Tracking {
        #[command(flatten)]
        tracks: TrackArguments,
    }

    fn parsed(words: &str) -> TrackArguments {
        let words = ["tracking"].into_iter().chain(words.split_whitespace());
        let parsed = Tracking::try_parse_from(words).map(|parsed| parsed.tracks);
        parsed.unwrap_or_else(|error| panic!("{error}"))
    }

    #[test]
    fn stills_are_refused_for_every_frame_alone() {
        // The folder of this crate stands for one of stills.
        let folder = [PathBuf::from(env!("CARGO_MANIFEST_DIR"))];
        let file = [PathBuf::from("flight.mp4")];
        assert!(parsed("--every-frame").refuse_stills(&folder).is_err());
        assert!(parsed("--every-frame").refuse_stills(&file).is_ok());
        assert!(parsed("").refuse_stills(&folder).is_ok());
    }

    #[test]
    fn options_without_words_are_those_of_the_library() {
        let (own, library) = (parsed(""), TrackOptions::default());
        assert_eq!(own.first_choice(), None);
        let own = own.options().unwrap_or_else(|error| panic!("{error}"));
        assert_eq!(own.detector.id, library.detector.id);
        assert_eq!(own.distance.id(), library.distance.id());
        assert_eq!(own.association.id(), library.association.id());
        assert_eq!(own.metres_per_unit, library.metres_per_unit);
    }

    #[test]
    fn every_option_is_a_choice_and_names_are_checked() {
        for words in [
            "--vehicle-detector files",
            "--detections boxes.txt",
            "--program yolo.toml",
            "--distance monocular",
            "--association deepsort",
            "--metres-per-unit 2",
            "--every-frame",
        ] {
            let option = words.split(' ').next();
            assert_eq!(parsed(words).first_choice(), option, "{words}");
        }
        for words in [
            "--vehicle-detector radar",
            "--distance far",
            "--association sort",
        ] {
            let refusal = parsed(words).options().map_err(|error| error.name);
            let name = words.split(' ').nth(1).map(str::to_owned);
            assert_eq!(refusal.err(), name, "{words}");
        }
    }
}
