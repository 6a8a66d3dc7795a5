//! Prerequisites of long commands, checked before anything is hashed, decoded or extracted. The first that is not met
//! ends the command in one line, and nothing has been written.

use std::{fs, io, path::Path};

use omnilife_curate::{
    CurateError, CurateSettings, GivenTruth, PoseRequest, boundaries, dataset, origins, poses::sfm,
};
use omnilife_reconstruct::{backends, request::BackendChoice};
use omnilife_schemas::{
    layout::DATASET_FILE,
    records::{Dataset, PoseConvention, Sampling, VideoStatus},
    stage::StagePlan,
    store::{self, StoreError},
};

use crate::doctor;

/// Columns of frames to assume for the needed space where no width is requested; a video may have fewer than the
/// default.
const FEW_COLUMNS: u64 = 512;
/// Largest number of frames to assume for the needed space; a video may have fewer than are allowed.
const FEW_FRAMES: u64 = 120;
/// Largest ratio of the bytes of pixels to those on the disk: images of cameras shrink to a half or a third as PNG.
const MOST_COMPRESSION: u64 = 20;

#[derive(Debug, Clone, Copy)]
pub(crate) enum Prerequisite<'a> {
    /// Valid settings of a curation. The video is named in errors.
    Settings(&'a CurateSettings, &'a Path),
    /// Weights of the boundary detector of these settings, where it is a network.
    BoundaryDetector(&'a CurateSettings, &'a Path),
    /// Readable files of poses and masks; matrices with their convention.
    PoseFiles(&'a PoseRequest, Option<PoseConvention>),
    /// Files with further data of the frames.
    TruthFiles(&'a GivenTruth),
    /// Readable list of the origins of videos.
    Origins(&'a Path),
    /// Python with pycolmap.
    StructureFromMotion,
    /// GPU adapter, where a GPU is to compute.
    Backend(BackendChoice),
    /// Output folder that is a dataset or empty, in which a stage finds no foreign files under the names of its
    /// files.
    Output(&'a Path, &'a StagePlan, &'a [&'a str]),
    /// Space for the frames of a sequence in a folder, which is created where it is missing.
    Room(&'a Path, &'a CurateSettings),
}

/// Checks all prerequisites in turn.
///
/// # Errors
/// With the first that is missing.
pub(crate) fn require<'a>(
    needed: impl IntoIterator<Item = Prerequisite<'a>>,
) -> anyhow::Result<()> {
    needed.into_iter().try_for_each(Prerequisite::check)
}

impl Prerequisite<'_> {
    fn check(self) -> anyhow::Result<()> {
        match self {
            Self::Settings(settings, video) => settings.check(video)?,
            Self::BoundaryDetector(settings, video) => {
                let detector = boundaries::detector(&settings.detector, video)?;
                drop((detector.start)()?);
            }
            Self::PoseFiles(request, convention) => request.check_files(convention)?,
            Self::TruthFiles(truth) => truth.check()?,
            Self::Origins(list) => drop(origins::read(list)?),
            Self::StructureFromMotion => drop(sfm::installation().map_err(CurateError::from)?),
            Self::Backend(backend) => backends::check(backend)?,
            Self::Output(folder, stage, files) => {
                dataset::refuse_foreign(folder)?;
                let own = stage.own_files();
                files.iter().try_for_each(|file| own.refuse_foreign(file))?;
            }
            Self::Room(folder, settings) => {
                store::create_folder(folder)?;
                refuse_full(folder, least_bytes(settings))?;
            }
        }
        Ok(())
    }
}

/// Returns true for an output with sequences of an earlier run, whose stages may be done.
pub(crate) fn has_sequences(out: &Path) -> bool {
    let held = store::read_record::<Dataset>(&out.join(DATASET_FILE)).ok();
    held.is_some_and(|held| {
        held.videos.iter().any(|video| {
            matches!(&video.status, VideoStatus::Curated { sequences } if !sequences.is_empty())
        })
    })
}

/// Returns whether the file of a video is not empty. Nothing more is checked, because a video is opened in a process
/// of its own.
pub(crate) fn is_filled(video: &Path) -> bool {
    fs::metadata(video).is_ok_and(|file| file.len() > 0)
}

/// Estimates the least number of bytes that the frames of a sequence take.
fn least_bytes(settings: &CurateSettings) -> u64 {
    let frames = match settings.sampling {
        Sampling::MaxFrames(most) => u64::from(most).min(FEW_FRAMES),
        Sampling::FramesPerSecond(_) => 1,
    };
    let columns = settings.width.map_or(FEW_COLUMNS, u64::from);
    let pixels = columns.saturating_mul(columns / 2);
    frames.saturating_mul(pixels.saturating_mul(3)) / MOST_COMPRESSION
}

/// Refuses a folder whose file system has fewer bytes left. Where the system does not report them, writing fails
/// later.
fn refuse_full(folder: &Path, bytes: u64) -> Result<(), StoreError> {
    match doctor::free_bytes(folder) {
        Ok(free) if free < bytes => {
            let reason = format!(
                "No space left: {:.3} MB are free, the frames alone take {:.3} MB or more",
                free as f64 / 1e6,
                bytes as f64 / 1e6
            );
            let full = io::Error::new(io::ErrorKind::StorageFull, reason);
            Err(StoreError::write(folder, full))
        }
        _ => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_disk_is_full_only_where_no_sequence_could_fit() {
        let of = |sampling, width| {
            least_bytes(&CurateSettings {
                sampling,
                width,
                ..CurateSettings::default()
            })
        };
        // 120 frames of 4096x2048 are 3 GB as pixels and never less than 100 MB as PNG.
        assert!((100_000_000..200_000_000).contains(&of(Sampling::MaxFrames(120), Some(4096))));
        assert!(of(Sampling::MaxFrames(1_000_000), None) < 5_000_000);
        assert!(of(Sampling::FramesPerSecond(1e9), Some(4096)) < 2_000_000);
        assert_eq!(of(Sampling::MaxFrames(10), Some(0)), 0);

        let folder = tempfile::tempdir().expect("a folder");
        refuse_full(folder.path(), 0).expect("nothing fits anywhere");
        let refused = refuse_full(folder.path(), u64::MAX);
        if cfg!(unix) {
            let message = refused.expect_err("no disk is that large").to_string();
            assert!(message.contains("No space left"), "{message}");
        }
    }
}
