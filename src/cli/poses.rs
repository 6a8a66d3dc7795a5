//! Arguments about cameras and what is known beside them.

use std::path::PathBuf;

use clap::{Args, ValueEnum};
use omnilife_curate::{
    FrameCommand, GivenDepth, GivenPrior, GivenTruth, GroundScale, IgnoredRegion, PoseRequest,
    PriorProgram, SfmSettings, poses::sfm::Road,
};
use omnilife_schemas::records::{DistanceConvention, DistanceGrid, PoseConvention};

use super::numbers;
use crate::exit::BadRequest;

#[derive(Debug, Args)]
#[command(next_help_heading = "Camera poses")]
pub(crate) struct PoseArguments {
    /// Camera poses: a poses.json, a folder with a COLMAP model, or a .npy [default: structure from motion]. A .npy
    /// has a matrix for every frame (N x 4 x 4 or N x 3 x 4).
    #[arg(long)]
    pub(crate) poses: Option<PathBuf>,
    /// Direction of the matrices of a .npy file, with camera axes x right, y down, z forward.
    #[arg(long, value_enum, value_name = "CONVENTION", requires = "poses")]
    pub(crate) poses_convention: Option<PosesConventionArgument>,
    /// Road from panoramas to poses: features of the panorama itself, features of a cube's faces put back on the
    /// sphere, or overlapping perspective faces as a rig of cameras. The default tries them in turn until poses
    /// are valid.
    #[arg(long, value_enum, conflicts_with = "poses")]
    pub(crate) road: Option<RoadArgument>,
    #[command(flatten)]
    pub(crate) ignored: IgnoreMaskArgument,
    /// Brings poses of arbitrary scale to metres by the median height of the drone above the ground.
    #[arg(long, value_name = "METRES", conflicts_with = "gsd", value_parser = numbers::positive)]
    pub(crate) altitude: Option<f64>,
    /// Brings poses to metres by the ground sample distance instead: the size of a pixel on the ground straight
    /// below.
    #[arg(long, value_name = "METRES", value_parser = numbers::positive)]
    pub(crate) gsd: Option<f64>,
    /// Mean angle of a hovering drone's camera below the horizon, 20 to 90: assumes level ground below it, tilted by
    /// that. With --altitude or --gsd alone the camera counts as looking straight down. The ground of a hovering drone
    /// requires one of the three.
    #[arg(long, value_name = "DEGREES", value_parser = numbers::positive, conflicts_with = "poses")]
    pub(crate) camera_pitch: Option<f64>,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
pub(crate) enum RoadArgument {
    Auto,
    Spherical,
    Mixed,
    Faces,
}

impl From<RoadArgument> for Road {
    fn from(argument: RoadArgument) -> Self {
        match argument {
            RoadArgument::Auto => Self::Auto,
            RoadArgument::Spherical => Self::Spherical,
            RoadArgument::Mixed => Self::Mixed,
            RoadArgument::Faces => Self::Faces,
        }
    }
}

#[derive(Debug, Clone, Copy, ValueEnum)]
pub(crate) enum PosesConventionArgument {
    CameraToWorld,
    WorldToCamera,
}

impl From<PosesConventionArgument> for PoseConvention {
    fn from(argument: PosesConventionArgument) -> Self {
        match argument {
            PosesConventionArgument::CameraToWorld => Self::CameraToWorld,
            PosesConventionArgument::WorldToCamera => Self::WorldToCamera,
        }
    }
}

/// Masks of dynamic regions.
#[derive(Debug, Args)]
#[command(next_help_heading = "Camera poses")]
pub(crate) struct MovingMasksArgument {
    /// Folder of masks, one per frame, white where something moves, such as `curate masks` makes:
    /// structure from motion leaves it out, and the scene keeps it.
    #[arg(long)]
    pub(crate) masks: Option<PathBuf>,
}

/// Masks of ignored regions.
#[derive(Debug, Args)]
#[command(next_help_heading = "Camera poses")]
pub(crate) struct IgnoreMaskArgument {
    /// Ignored region, such as the operator or a tripod: an image for all frames, or a folder with one per
    /// frame, white where it is. The form nadir:DEGREES ignores all within that angle of straight down. An ignored
    /// region gives no features, nothing is learned from it, and no score counts it.
    #[arg(long, value_name = "PATH")]
    pub(crate) ignore_mask: Option<IgnoredRegion>,
}

impl PoseArguments {
    /// Source of poses, with a folder of masks of moving content.
    pub(crate) fn request(&self, masks: Option<&PathBuf>) -> PoseRequest {
        self.poses.clone().map_or_else(
            || {
                PoseRequest::Sfm(SfmSettings {
                    masks: masks.cloned(),
                    road: self.road.map(Road::from).unwrap_or_default(),
                    ..SfmSettings::default()
                })
            },
            PoseRequest::Given,
        )
    }

    /// Source of poses by a comparison of all roads.
    pub(crate) fn comparison(&self, masks: Option<&PathBuf>) -> PoseRequest {
        match self.request(masks) {
            PoseRequest::Sfm(settings) => PoseRequest::Sfm(SfmSettings {
                compare: true,
                ..settings
            }),
            given @ PoseRequest::Given(_) => given,
        }
    }

    /// Returns the masks and the scale that come with the poses: dynamic masks, where poses are given, and ignored
    /// regions.
    pub(crate) fn truth(&self, masks: Option<&PathBuf>) -> GivenTruth {
        GivenTruth {
            masks: self.poses.as_ref().and(masks.cloned()),
            ignored: self.ignored.ignore_mask.clone(),
            pose_convention: self.poses_convention.map(Into::into),
            camera_pitch: self.camera_pitch,
            scale: self
                .altitude
                .map(GroundScale::Altitude)
                .or(self.gsd.map(GroundScale::PixelOnGround)),
            ..GivenTruth::default()
        }
    }
}

/// Ground truth of frames beside their cameras, for the metrics that need it.
#[derive(Debug, Args)]
#[command(next_help_heading = "Ground truth")]
pub(crate) struct TruthArguments {
    /// Folder of distances along the rays: 16-bit grey PNG files named like the frames, 0 where the
    /// distance is not known.
    #[arg(long, value_name = "FOLDER", requires = "depth_unit")]
    pub(crate) depth: Option<PathBuf>,
    /// Scale of the files of --depth: distance of a value of 1, in units of the world.
    #[arg(long, value_name = "UNITS", requires = "depth", value_parser = numbers::positive)]
    pub(crate) depth_unit: Option<f64>,
    /// Masks of the objects of a class, such as human or vehicle: images named like the frames, white
    /// where they are; may be repeated.
    #[arg(long = "class", value_name = "NAME=FOLDER", value_parser = parse_class)]
    pub(crate) classes: Vec<(String, PathBuf)>,
    /// Folder of depth priors (of a network, a sensor), for methods that start from them. Files are 16-bit
    /// grey PNG or .npy named like the frames, at any size, 0 where the distance is not known.
    #[arg(
        long,
        value_name = "FOLDER",
        requires = "depth_prior_unit",
        group = "prior_files"
    )]
    pub(crate) depth_prior: Option<PathBuf>,
    /// Scale of the files of --depth-prior: distance of a value of 1, in units of the world.
    #[arg(long, value_name = "UNITS", requires = "prior_files", value_parser = numbers::positive)]
    pub(crate) depth_prior_unit: Option<f64>,
    /// Direction of the distances of --depth-prior: along the ray, or along the optical axis (z).
    #[arg(long, value_enum, default_value_t = ConventionArgument::Ray)]
    pub(crate) depth_prior_convention: ConventionArgument,
    /// Name of the source of --depth-prior, for the record.
    #[arg(long, value_name = "NAME", default_value = "given")]
    pub(crate) depth_prior_source: String,
    /// Pixel grid of --depth-prior: centres at half pixels, or the first and last column in one direction and the
    /// first and last row at the poles.
    #[arg(long, value_enum, default_value_t = GridArgument::HalfPixel)]
    pub(crate) grid: GridArgument,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
pub(crate) enum ConventionArgument {
    Ray,
    Z,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
pub(crate) enum GridArgument {
    HalfPixel,
    Endpoint,
}

impl From<ConventionArgument> for DistanceConvention {
    fn from(argument: ConventionArgument) -> Self {
        match argument {
            ConventionArgument::Ray => Self::Ray,
            ConventionArgument::Z => Self::Z,
        }
    }
}

impl From<GridArgument> for DistanceGrid {
    fn from(argument: GridArgument) -> Self {
        match argument {
            GridArgument::HalfPixel => Self::HalfPixel,
            GridArgument::Endpoint => Self::Endpoint,
        }
    }
}

impl TruthArguments {
    /// Returns a program that estimates distances, with the form of its files; `None` without their unit.
    pub(crate) fn prior_program(&self, command: FrameCommand) -> Option<PriorProgram> {
        Some(PriorProgram {
            command,
            unit: self.depth_prior_unit?,
            grid: self.grid.into(),
            convention: self.depth_prior_convention.into(),
        })
    }

    /// Adds the given ground truth to what is known already.
    ///
    /// # Errors
    /// When a class is given twice.
    pub(crate) fn given(&self, mut truth: GivenTruth) -> anyhow::Result<GivenTruth> {
        let depth = self.depth.clone().zip(self.depth_unit);
        truth.depth = depth.map(|(folder, unit)| GivenDepth { folder, unit });
        let prior = self.depth_prior.clone().zip(self.depth_prior_unit);
        truth.prior = prior.map(|(folder, unit)| GivenPrior {
            folder,
            unit,
            grid: self.grid.into(),
            convention: self.depth_prior_convention.into(),
            source: self.depth_prior_source.clone(),
        });
        for (name, folder) in &self.classes {
            if truth.classes.insert(name.clone(), folder.clone()).is_some() {
                return Err(BadRequest(format!("class {name} is given twice")).into());
            }
        }
        Ok(truth)
    }
}

fn parse_class(text: &str) -> Result<(String, PathBuf), String> {
    let (name, folder) = text
        .split_once('=')
        .ok_or_else(|| "expected a name and a folder, such as human=masks/human".to_owned())?;
    Ok((name.to_owned(), PathBuf::from(folder)))
}
