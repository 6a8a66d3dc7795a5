//! Cameras by words of `omnilife reconstruct render`.

use std::path::PathBuf;

use clap::Args;
use omnilife_reconstruct::jobs::camera_words::{CameraPlaces, CameraWords, LookAt};

use super::{numbers, places, reconstruct::direction};
use crate::exit::BadRequest;

#[derive(Debug, Args)]
#[command(next_help_heading = "Cameras by words")]
pub(crate) struct CameraWordArguments {
    /// Circles the target once, or over this many degrees, at the median distance and height of the cameras. Cameras by
    /// words leave a cameras.json with the share of each view that no input view saw.
    #[arg(long, value_name = "DEGREES", num_args = 0..=1, default_missing_value = "360", allow_negative_numbers = true,
        value_parser = numbers::finite)]
    orbit: Option<f64>,
    /// Looks down on the target, with the upper edge where the cameras look.
    #[arg(long)]
    from_above: bool,
    /// Renders the frame with this number alone, from 0 on.
    #[arg(long, value_name = "FRAME", value_parser = numbers::whole::<usize>)]
    frame: Option<usize>,
    /// Keeps the camera of the frame with this number, from 0 on, while time goes on.
    #[arg(long, value_name = "FRAME", value_parser = numbers::whole::<usize>)]
    stationary: Option<usize>,
    /// Follows the poses of a file: CSV of `time_seconds,x,y,z,qw,qx,qy,qz` (camera to world), a JSON list of
    /// `{time_seconds, pose}`, or a poses.json.
    #[arg(long, value_name = "FILE")]
    path: Option<PathBuf>,
    /// Target of the cameras, a point of the world or the id of an object of the model [default: the median of the
    /// scene's points].
    #[arg(long, value_name = "X,Y,Z|OBJECT", value_parser = look_at, allow_hyphen_values = true)]
    look_at: Option<LookAt>,
    /// Up in the world as three numbers [default: that of the model's vehicles, else the mean of the cameras'].
    #[arg(long, value_name = "X,Y,Z", value_parser = direction, allow_hyphen_values = true)]
    up: Option<[f64; 3]>,
    /// A split.json, whose input views alone count as seen [default: all frames of the poses].
    #[arg(long, value_parser = places::split_file())]
    split: Option<PathBuf>,
}

impl CameraWordArguments {
    /// The cameras that are asked for.
    ///
    /// # Errors
    /// When words exclude each other or would be ignored, or an orbit has no degrees.
    pub(super) fn words(&self) -> anyhow::Result<CameraWords> {
        let refuse = |reason: String| Err(BadRequest(reason).into());
        let given: Vec<&str> = [
            ("--orbit", self.orbit.is_some()),
            ("--from-above", self.from_above),
            ("--frame", self.frame.is_some()),
            ("--stationary", self.stationary.is_some()),
            ("--path", self.path.is_some()),
            ("--look-at", self.path.is_some() && self.look_at.is_some()),
            ("--up", self.path.is_some() && self.up.is_some()),
        ]
        .into_iter()
        .filter_map(|(name, is_given)| is_given.then_some(name))
        .collect();
        if given.len() > 1 {
            return refuse(format!("{} exclude each other", given.join(" and ")));
        }
        let places = match (self.orbit, self.stationary, &self.path) {
            (Some(degrees), ..) if degrees.is_finite() && degrees != 0.0 => {
                CameraPlaces::Orbit(degrees)
            }
            (Some(degrees), ..) => {
                return refuse(format!("--orbit must go over some degrees, got {degrees}"));
            }
            (_, Some(frame), _) => CameraPlaces::Stationary(frame),
            (.., Some(file)) => CameraPlaces::Path(file.clone()),
            _ if self.from_above => CameraPlaces::FromAbove,
            _ => self
                .frame
                .map_or(CameraPlaces::OfPoses, CameraPlaces::Frame),
        };
        let words = CameraWords {
            places,
            target: self.look_at.clone(),
            up: self.up,
            split: self.split.clone(),
        };
        if words.are_of_poses() && words.split.is_some() {
            return refuse("--split goes with --orbit, --look-at and the like".to_owned());
        }
        let turns = matches!(
            words.places,
            CameraPlaces::Orbit(_) | CameraPlaces::FromAbove
        );
        if words.up.is_some() && !turns && words.target.is_none() {
            return refuse("--up goes with --orbit, --from-above or --look-at".to_owned());
        }
        Ok(words)
    }
}

fn look_at(text: &str) -> Result<LookAt, String> {
    match direction(text) {
        Ok(point) if point.iter().all(|value| value.is_finite()) => Ok(LookAt::Point(point)),
        _ if text.is_empty() || text.contains(',') => {
            Err("expected a point such as 1,2,3 or the id of an object".to_owned())
        }
        _ => Ok(LookAt::Object(text.to_owned())),
    }
}

#[cfg(test)]
mod tests {
    use clap::Parser;

    use super::*;

    #[derive(Debug, Parser)]
    struct WordLine {
        #[command(flatten)]
        cameras: CameraWordArguments,
    }

    #[test]
    fn no_word_is_ignored() {
        let words = |line: &str| {
            let line = ["omnilife"].into_iter().chain(line.split_whitespace());
            let parsed = WordLine::try_parse_from(line).expect("arguments");
            parsed.cameras.words().map_err(|error| error.to_string())
        };
        for line in [
            "",
            "--orbit --up 0,0,1",
            "--from-above --up 0,0,1",
            "--stationary 3 --look-at 1,2,3 --up 0,0,1",
            "--look-at car --up 0,0,1 --split split.json",
            "--path poses.csv --split split.json",
            "--frame 3",
            "--frame 3 --look-at car --split split.json",
        ] {
            assert!(words(line).is_ok(), "{line}");
        }
        for (line, reason) in [
            ("--up 0,0,1", "--up goes with"),
            ("--stationary 3 --up 0,0,1", "--up goes with"),
            ("--split split.json", "--split goes with"),
            ("--frame 3 --split split.json", "--split goes with"),
            ("--frame 3 --stationary 3", "exclude each other"),
            ("--path poses.csv --up 0,0,1", "exclude each other"),
            ("--path poses.csv --look-at car", "exclude each other"),
            ("--orbit --stationary 3", "exclude each other"),
        ] {
            let refused = words(line).expect_err(line);
            assert!(refused.contains(reason), "{line}: {refused}");
        }
    }

    #[test]
    fn a_target_is_a_point_or_an_object() {
        assert_eq!(look_at("1,-2,3.5"), Ok(LookAt::Point([1.0, -2.0, 3.5])));
        assert_eq!(look_at("7"), Ok(LookAt::Object("7".to_owned())));
        assert_eq!(look_at("car"), Ok(LookAt::Object("car".to_owned())));
        for text in ["", "1,2", "1,2,inf"] {
            assert!(look_at(text).is_err(), "{text}");
        }
    }
}
