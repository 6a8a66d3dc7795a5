//! From a folder of still panoramas to its one sequence.
//!
//! The folder holds `analysis.json`, `boundaries.json` without boundaries, and `seq-000/sequence.json` with the
//! stills in `seq-000/frames/`.

use std::{
    fs,
    path::{Path, PathBuf},
};

use omnilife_schemas::{
    RgbImage,
    elapsed::Stopwatch,
    image_file::ImageFile,
    layout::{ANALYSIS_FILE, BOUNDARIES_FILE, SEQUENCE_FILE, SLICES_FILE, sequence_name},
    lock::FolderLock,
    progress::Progress,
    records::{
        Admission, BoundaryLedger, DetectedProjection, FrameEntry, FrameSet, Probe, Sampling,
        Segment, SegmentOutcome, Sequence, Slices, SourceVideo, TimeRange, VideoAnalysis,
    },
    rgb,
    stage::StagePlan,
    staging::Staging,
    statistics::frame_interval,
    store::{self, StoreError},
};
use omnilife_video::Rgb8Image;

use super::{SECONDS_APART, Still, Stills, colour_notes, sha256};
use crate::{
    admission,
    error::CurateError,
    frame_order, frames, projection, sequences,
    settings::{CurateSettings, FrameSelection},
    video_folder,
};

/// Width in pixels of the images from which the projection is judged.
const SAMPLE_WIDTH_PIXELS: usize = 512;
/// Maximum number of stills from which the projection is judged.
const MOST_SAMPLES: usize = 12;
/// Container and codec in records of stills, which have neither.
const STILLS: &str = "stills";

/// Identifies a folder of stills by its images.
///
/// # Errors
/// When it has none, or one cannot be read.
pub(crate) fn identify(folder: &Path) -> Result<SourceVideo, CurateError> {
    let images = frame_order::images_in(folder)?;
    if images.is_empty() {
        return Err(CurateError::video(folder, "is a folder without images"));
    }
    let mut bytes = 0;
    for image in &images {
        let metadata = fs::metadata(image).map_err(|error| StoreError::read(image, error))?;
        bytes += metadata.len();
    }
    let name = folder.file_name().unwrap_or_default();
    Ok(SourceVideo {
        file_name: name.to_string_lossy().into_owned(),
        sha256: sha256(&images)?,
        bytes,
    })
}

/// Curates a folder of stills into `folder` and returns the name of its one sequence.
///
/// # Errors
/// [`CurateError::Rejected`] for stills excluded by their projection, [`CurateError::Input`] for images that are not
/// panoramas of one size and for parts of spheres, [`CurateError::Store`] when files cannot be read or written.
pub(crate) fn curate(
    input: &Path,
    source: &SourceVideo,
    folder: &Path,
    settings: &CurateSettings,
    progress: &dyn Progress,
) -> Result<Vec<String>, CurateError> {
    let stills = Stills::read(input)?;
    if let Some(part) = stills.stills.iter().find(|still| still.placement.is_some()) {
        let reason = "shows a part of a sphere by its GPano metadata; omnilife curate import --format panoramas \
                      takes it";
        return Err(CurateError::input(&part.path, reason));
    }
    let colours = stills
        .stills
        .iter()
        .map(|still| (still.name(), still.colours));
    let colours = colour_notes(&colours.collect::<Vec<_>>());
    let notes = stills.notes.iter().chain([&stills.times_note]);
    for note in notes.chain(&colours) {
        progress.note(&format!("{}: {note}", input.display()));
    }
    video_folder::claim(input, folder, source)?;
    let _lock = FolderLock::take(folder, progress)?;
    let analysis = analyse(&stills, source)?;
    let projection =
        admission::effective_projection(input, &analysis, None, settings, 0.0, progress)?;
    if settings.enforce {
        progress.note(&format!(
            "{}: criteria {} are of videos, stills are not held against them",
            input.display(),
            settings.profile
        ));
    }
    let admission = Admission {
        profile: STILLS.to_owned(),
        checks: Vec::new(),
        reported: Vec::new(),
        admitted: true,
        enforced: false,
    };
    store::update_record(&folder.join(ANALYSIS_FILE), &analysis)?;
    store::update_record(&folder.join(BOUNDARIES_FILE), &no_boundaries(&analysis))?;
    store::update_record(&folder.join(SLICES_FILE), &no_slices(&analysis, settings))?;
    let (width, _) = frames::frame_size(input, &analysis.probe, settings.width, None, None)?;
    if settings.select == FrameSelection::Sharp {
        progress.note(&format!(
            "{}: stills are taken evenly, the sharpest frames are chosen in videos",
            input.display()
        ));
    }
    let work = Work {
        folder,
        chosen: chosen(&stills, &analysis, settings.sampling),
        analysis: &analysis,
        projection,
        admission,
        sampling: settings.sampling,
        size: [width, width / 2],
    };
    work.run(progress)
}

/// Returns the analysis of all stills as if they were frames of a video.
fn analyse(stills: &Stills, source: &SourceVideo) -> Result<VideoAnalysis, CurateError> {
    let interval = frame_interval(&stills.times).unwrap_or(SECONDS_APART);
    let last = stills.times.last().copied().unwrap_or_default();
    let range = TimeRange::new(0.0, last + interval);
    let longest = stills.times.windows(2).map(|pair| pair[1] - pair[0]);
    let probe = Probe {
        frames_per_second: 1.0 / interval,
        duration_seconds: range.duration_seconds(),
        decoded_frames: Some(stills.stills.len() as u64),
        longest_interval_seconds: longest.max_by(f64::total_cmp),
        ..probe_of(stills.stills[0].size)
    };
    let paths: Vec<&Path> = stills
        .stills
        .iter()
        .map(|still| still.path.as_path())
        .collect();
    Ok(VideoAnalysis {
        source: source.clone(),
        range,
        projection: judge(&paths, &probe)?,
        probe,
        layout: None,
        overlays: None,
        damaged_frames: 0,
        interlaced_frames: 0,
        repeated_frames: 0,
        longest_repetition_frames: 0,
        frames_out_of_time: 0,
        signals: String::new(),
    })
}

/// Returns the probe of images of `size` that are not frames of a video.
fn probe_of(size: [u32; 2]) -> Probe {
    Probe {
        container: STILLS.to_owned(),
        codec: STILLS.to_owned(),
        pixel_format: "rgb24".to_owned(),
        ..Probe::of_size(size)
    }
}

/// Judges by their pixels whether images are panoramas.
fn judge(images: &[&Path], probe: &Probe) -> Result<DetectedProjection, CurateError> {
    let step = images.len().div_ceil(MOST_SAMPLES).max(1);
    let samples: Vec<Rgb8Image> = images
        .iter()
        .step_by(step)
        .map(|path| sample(path))
        .collect::<Result<_, _>>()?;
    Ok(projection::judge(probe, &samples))
}

/// Returns true if images of `size` are panoramas by their pixels.
///
/// # Errors
/// When one cannot be decoded, or is transparent in places.
pub(crate) fn are_panoramas(images: &[&Path], size: [u32; 2]) -> Result<bool, CurateError> {
    let probe = probe_of(size);
    let may_be = projection::aspect::is_two_to_one(&probe);
    Ok(may_be && judge(images, &probe)?.projection.is_monoscopic_erp())
}

/// Returns a small image of a still.
fn sample(path: &Path) -> Result<Rgb8Image, CurateError> {
    let image = image(path)?;
    let width = SAMPLE_WIDTH_PIXELS.min(image.width);
    let height = (width * image.height / image.width).max(1);
    let small = image.resized_by_area(width, height);
    Ok(Rgb8Image::new(width, height, small.to_rgb8()))
}

/// Returns a still as viewers show it.
///
/// # Errors
/// When it cannot be decoded, or is transparent in places.
fn image(path: &Path) -> Result<RgbImage, CurateError> {
    let shown = ImageFile::open(path)?.decode_shown()?;
    if shown.transparent.is_some() {
        let reason = "is transparent in places; omnilife curate import --format panoramas takes it";
        return Err(CurateError::input(path, reason));
    }
    let [width, height] = shown.size;
    Ok(RgbImage::from_rgb8(width, height, &shown.rgb))
}

fn no_boundaries(analysis: &VideoAnalysis) -> BoundaryLedger {
    BoundaryLedger {
        source: analysis.source.clone(),
        range: analysis.range,
        detector: STILLS.to_owned(),
        ledger_sha256: None,
        boundaries: Vec::new(),
        dropped: Vec::new(),
        left_out: Vec::new(),
        rejected: Vec::new(),
    }
}

/// Returns one segment of all stills, without a video.
fn no_slices(analysis: &VideoAnalysis, settings: &CurateSettings) -> Slices {
    Slices {
        source: analysis.source.clone(),
        range: analysis.range,
        segments: vec![Segment {
            range: analysis.range,
            outcome: SegmentOutcome::Kept {
                sequence: sequence_name(0),
                slice: None,
            },
        }],
        no_slices: settings
            .slices
            .map(|_| "slices need a video, got still images".to_owned()),
    }
}

/// Returns the chosen stills with their times. A frame rate applies to videos only: all are taken.
fn chosen<'a>(
    stills: &'a Stills,
    analysis: &VideoAnalysis,
    sampling: Sampling,
) -> Vec<(&'a Still, f64)> {
    let times = match sampling {
        Sampling::FramesPerSecond(_) => stills.times.clone(),
        Sampling::MaxFrames(_) => frames::choose(&stills.times, analysis.range, sampling),
    };
    let all = stills.stills.iter().zip(stills.times.iter().copied());
    all.filter(|(_, time)| times.contains(time)).collect()
}

/// The stage that writes the frames.
struct Work<'a> {
    folder: &'a Path,
    chosen: Vec<(&'a Still, f64)>,
    analysis: &'a VideoAnalysis,
    projection: DetectedProjection,
    admission: Admission,
    sampling: Sampling,
    /// Width and height of the frames in pixels.
    size: [u32; 2],
}

impl Work<'_> {
    fn run(&self, progress: &dyn Progress) -> Result<Vec<String>, CurateError> {
        let name = sequence_name(0);
        let target = self.folder.join(&name);
        for other in sequences::sequence_folders(self.folder)? {
            if other != name {
                sequences::clear(self.folder, &other, progress)?;
            }
        }
        if self.plan(&target).is_done() {
            progress.note(&format!(
                "{}: stills unchanged, skipped",
                self.folder.display()
            ));
        } else {
            self.write(&name, progress)?;
        }
        store::update_record(&target.join(SEQUENCE_FILE), &self.record(&name))?;
        Ok(vec![name])
    }

    fn plan(&self, folder: &Path) -> StagePlan {
        let times: Vec<f64> = self.chosen.iter().map(|(_, time)| *time).collect();
        StagePlan::new(folder, sequences::STAGE)
            .with_hash("video", self.analysis.source.sha256.clone())
            .with_settings("timestamps in seconds", &times)
            .with_settings("size in pixels", &self.size)
    }

    fn write(&self, name: &str, progress: &dyn Progress) -> Result<(), CurateError> {
        let started = Stopwatch::with_children();
        let staging = Staging::new(self.folder, "sequences")?;
        let folder = staging.folder.join(name);
        progress.begin("stills", Some(self.chosen.len() as u64));
        let written = (|| {
            for (number, (still, _)) in self.chosen.iter().enumerate() {
                write_frame(still, self.size, &folder.join(frames::file_name(number)))?;
                progress.advance(1);
            }
            Ok::<(), CurateError>(())
        })();
        progress.end();
        written?;
        store::write_record(&folder.join(SEQUENCE_FILE), &self.record(name))?;
        let files = (0..self.chosen.len()).map(frames::file_name);
        self.plan(&folder).finish(files, started.elapsed())?;
        sequences::clear(self.folder, name, progress)?;
        let target: PathBuf = self.folder.join(name);
        Ok(store::rename(&folder, &target).map_err(|error| StoreError::write(&target, error))?)
    }

    fn record(&self, name: &str) -> Sequence {
        let [width, height] = self.size;
        let video = self.folder.file_name().unwrap_or_default();
        let is_resized = width != self.analysis.probe.width;
        let entries = self.chosen.iter().enumerate();
        let entries = entries.map(|(number, (still, time))| FrameEntry {
            file: frames::file_name(number),
            time_seconds: *time,
            capture: (!still.capture.is_empty()).then(|| still.capture.clone()),
        });
        Sequence {
            id: format!("{}/{name}", video.to_string_lossy()),
            source: self.analysis.source.clone(),
            range: self.analysis.range,
            probe: self.analysis.probe.clone(),
            projection: self.projection.clone(),
            admission: self.admission.clone(),
            frames: FrameSet {
                width,
                height,
                sampling: self.sampling,
                resampling: if is_resized { "area" } else { "none" }.to_owned(),
                converted_from: None,
                entries: entries.collect(),
                sharpest: None,
            },
            motion_frames: Vec::new(),
        }
    }
}

/// Writes a still as a PNG of `size`.
fn write_frame(still: &Still, [width, height]: [u32; 2], to: &Path) -> Result<(), CurateError> {
    if let Some(folder) = to.parent() {
        store::create_folder(folder)?;
    }
    let image = image(&still.path)?;
    let size = [width, height].map(|side| side as usize);
    let image = match [image.width, image.height] == size {
        true => image,
        false => image.resized_by_area(size[0], size[1]),
    };
    Ok(rgb::write_rgb8_png(to, size[0], size[1], &image.to_rgb8())?)
}
