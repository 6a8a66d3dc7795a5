//! `omnilife curate`.

use std::path::PathBuf;

use clap::{Args, Subcommand};
use omnilife_curate::{CurateSettings, SfmSettings};
use omnilife_schemas::records::{Sampling, Verdict};

#[derive(Debug, Args)]
pub(crate) struct CurationArguments {
    /// Samples this many frames per second.
    #[arg(long, conflicts_with = "max_frames")]
    pub(crate) fps: Option<f64>,
    /// Samples at most this many frames per sequence, evenly in time.
    #[arg(long, default_value_t = 120)]
    pub(crate) max_frames: u32,
    /// Width of the sampled frames in pixels [default: the video's, at most 1024].
    #[arg(long)]
    pub(crate) width: Option<u32>,
    /// Takes the videos as this kind of picture, whatever the evidence says.
    #[arg(long, value_name = "KIND", value_parser = parse_accept)]
    pub(crate) accept: Option<Verdict>,
    /// Drops shots shorter than this, in seconds.
    #[arg(long, default_value_t = 1.0, value_name = "SECONDS")]
    pub(crate) min_shot: f64,
}

impl CurationArguments {
    /// The settings of the curation, with a profile of criteria.
    pub(crate) fn settings(&self, profile: &str, enforce: bool) -> CurateSettings {
        CurateSettings {
            profile: profile.to_owned(),
            enforce,
            sampling: self.fps.map_or(
                Sampling::MaxFrames(self.max_frames),
                Sampling::FramesPerSecond,
            ),
            width: self.width,
            accept: self.accept,
            minimum_shot_seconds: self.min_shot,
            ..CurateSettings::default()
        }
    }
}

fn parse_accept(text: &str) -> Result<Verdict, String> {
    [Verdict::Erp, Verdict::ErpSqueezed]
        .into_iter()
        .find(|verdict| verdict.name() == text)
        .ok_or_else(|| "only erp and erp-squeezed can be accepted".to_owned())
}

#[derive(Debug, Args)]
pub(crate) struct PoseArguments {
    /// Camera poses: a poses.json or a folder with a COLMAP text model [default: structure from
    /// motion].
    #[arg(long)]
    pub(crate) poses: Option<PathBuf>,
    /// Folder of masks for structure from motion, one per frame; white is left out.
    #[arg(long, conflicts_with = "poses")]
    pub(crate) masks: Option<PathBuf>,
}

impl PoseArguments {
    /// Where poses come from.
    pub(crate) fn request(&self) -> omnilife_curate::PoseRequest {
        self.poses.clone().map_or_else(
            || {
                omnilife_curate::PoseRequest::Sfm(SfmSettings {
                    masks: self.masks.clone(),
                    ..SfmSettings::default()
                })
            },
            omnilife_curate::PoseRequest::Given,
        )
    }
}

#[derive(Debug, Subcommand)]
pub(crate) enum CurateCommand {
    /// Prints what the container and the decoder say about a video, as JSON.
    Probe {
        /// The video.
        video: PathBuf,
    },
    /// Prints whether a video is equirectangular, with evidence, as JSON.
    Verdict {
        /// The video.
        video: PathBuf,
    },
    /// Prints where shots begin and end, as JSON.
    Boundaries {
        /// The video.
        video: PathBuf,
    },
    /// Probe, verdict, boundaries, slices and sampled frames of many videos: a dataset.
    Build {
        /// Videos, or folders of videos.
        #[arg(required = true)]
        videos: Vec<PathBuf>,
        /// Folder of the dataset.
        #[arg(long)]
        out: PathBuf,
        #[command(flatten)]
        curation: CurationArguments,
        /// Criteria that every video must meet: omnilife360 or none.
        #[arg(long, default_value = "omnilife360")]
        criteria: String,
    },
    /// Poses a sequence: writes its scene.json and points.ply.
    Poses {
        /// Folder with a sequence.json.
        sequence: PathBuf,
        #[command(flatten)]
        poses: PoseArguments,
    },
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_monoscopic_erp_can_be_accepted() {
        assert_eq!(parse_accept("erp"), Ok(Verdict::Erp));
        assert!(parse_accept("eac").is_err());
    }
}
