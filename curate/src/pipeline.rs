//! One video from file to sequences: the stages, what they depend on, and what they leave behind.
//!
//! A video's folder holds `analysis.json`, `signals.parquet` and `boundaries.json`, and per
//! sequence `seq-NNN/sequence.json` with `seq-NNN/frames/NNNNNN.png`.

use std::{
    fs,
    path::{Path, PathBuf},
    time::Instant,
};

use omnilife_schemas::{
    progress::Progress,
    records::{
        Admission, BoundaryLedger, ErpVerdict, FrameSet, Sampling, Sequence, SourceVideo,
        TimeRange, Verdict, VideoAnalysis,
    },
    stage::StagePlan,
    store,
};
use serde::{Deserialize, Serialize};

use crate::{
    admission,
    analysis::{self, Analysis},
    boundaries::{self, DEFAULT_DETECTOR, Detector, Signals},
    criteria,
    error::CurateError,
    frames::{self, Selection},
    slice, verdict, video,
};

/// File of the analysis in a video's folder.
pub const ANALYSIS_FILE: &str = "analysis.json";
/// File of the boundary ledger in a video's folder.
pub const BOUNDARIES_FILE: &str = "boundaries.json";
/// File of the per-frame signals in a video's folder.
pub const SIGNALS_FILE: &str = "signals.parquet";
/// File of the sequence record in a sequence's folder.
pub const SEQUENCE_FILE: &str = "sequence.json";

/// What the user decides about curation.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct CurateSettings {
    /// Name of the admission criteria, see [`criteria::PROFILES`].
    pub profile: String,
    /// Whether a video that misses them is rejected; otherwise they are evaluated and recorded.
    pub enforce: bool,
    /// How frames are sampled.
    pub sampling: Sampling,
    /// Width of sampled frames in pixels; at most 1024 where none is given.
    pub width: Option<u32>,
    /// Takes the video as `erp` or `erp-squeezed` whatever the evidence says.
    pub accept: Option<Verdict>,
    /// Shorter shots are dropped, seconds.
    pub minimum_shot_seconds: f64,
    /// Id of the boundary detector, see [`boundaries::DETECTORS`].
    pub detector: String,
}

impl Default for CurateSettings {
    fn default() -> Self {
        Self {
            profile: criteria::OMNILIFE360.id.to_owned(),
            enforce: true,
            sampling: Sampling::MaxFrames(120),
            width: None,
            accept: None,
            minimum_shot_seconds: 1.0,
            detector: DEFAULT_DETECTOR.to_owned(),
        }
    }
}

impl CurateSettings {
    /// Refuses settings that make no sense and names that are not known; `video` is named in the
    /// error.
    pub(crate) fn check(&self, video: &Path) -> Result<(), CurateError> {
        boundaries::detector(&self.detector, video)?;
        criteria::profile(&self.profile, video)?;
        let sampling_is_positive = match self.sampling {
            Sampling::MaxFrames(most) => most > 0,
            Sampling::FramesPerSecond(rate) => rate.is_finite() && rate > 0.0,
        };
        let reason = if !sampling_is_positive {
            "frames are sampled by a positive number"
        } else if !self.minimum_shot_seconds.is_finite() || self.minimum_shot_seconds < 0.0 {
            "the minimum shot length is not a number of seconds from 0 on"
        } else if self
            .accept
            .is_some_and(|verdict| !verdict.is_monoscopic_erp())
        {
            "only erp and erp-squeezed can be accepted, nothing else can be reconstructed"
        } else {
            return Ok(());
        };
        Err(CurateError::input(video, reason))
    }
}

/// Curates one video into `folder` and returns the names of its sequence folders in order of time.
///
/// Two decodes at most: one that looks at every frame, one that extracts the sampled ones. Each is
/// skipped, with a note, while the video and the settings it depends on have not changed.
///
/// # Errors
/// [`CurateError::Video`] for a file that is no sound video, [`CurateError::Rejected`] for one that
/// the criteria (where enforced) or the ERP verdict keep out, [`CurateError::Input`] for settings
/// that make no sense and for a folder that holds another video, [`CurateError::Store`] when files
/// cannot be written.
pub fn curate_video(
    video: &Path,
    folder: &Path,
    settings: &CurateSettings,
    progress: &dyn Progress,
) -> Result<Vec<String>, CurateError> {
    settings.check(video)?;
    let detector = boundaries::detector(&settings.detector, video)?;
    let profile = criteria::profile(&settings.profile, video)?;
    let probe = video::probe(video)?;
    let size = frames::frame_size(video, &probe, settings.width)?;
    // What the header shows already need not be found out by decoding gigabytes.
    let early = criteria::Candidate {
        probe: &probe,
        verdict: None,
        damaged_frames: None,
    };
    admission::enforce(video, &criteria::admit(profile, &early, settings.enforce))?;

    let source = source(video, progress)?;
    claim(video, folder, &source)?;
    let analysis = analysed(video, folder, &source, detector, progress)?;
    let verdict = admission::effective_verdict(video, &analysis, settings, progress)?;
    let candidate = criteria::Candidate {
        probe: &analysis.probe,
        verdict: Some(analysis.verdict.verdict),
        damaged_frames: Some(analysis.damaged_frames),
    };
    let admission = criteria::admit(profile, &candidate, settings.enforce);
    admission::enforce(video, &admission)?;
    if let Some(failures) = criteria::failures(&admission) {
        progress.note(&format!(
            "{}: would not be admitted by {}: {failures}",
            video.display(),
            profile.id
        ));
    }
    let work = Sequencing {
        video,
        folder,
        source: &source,
        settings,
        detector,
        analysis: &analysis,
        verdict,
        admission,
        size,
    };
    work.run(progress)
}

/// Identifies a video by its content.
fn source(video: &Path, progress: &dyn Progress) -> Result<SourceVideo, CurateError> {
    let bytes = fs::metadata(video)
        .map_err(|error| store::StoreError::read(video, error))?
        .len();
    progress.begin("hashing", None);
    let sha256 = store::sha256_file(video);
    progress.end();
    Ok(SourceVideo {
        file_name: video
            .file_name()
            .unwrap_or_default()
            .to_string_lossy()
            .into_owned(),
        sha256: sha256?,
        bytes,
    })
}

/// Makes the folder, or makes sure that an existing one belongs to this video.
fn claim(video: &Path, folder: &Path, source: &SourceVideo) -> Result<(), CurateError> {
    let refuse = |reason: String| Err(CurateError::input(folder, reason));
    if folder.is_file() {
        return refuse("is a file; the output needs a folder".to_owned());
    }
    let record = folder.join(ANALYSIS_FILE);
    if record.is_file() {
        let held: VideoAnalysis = store::read_record(&record)?;
        if held.source.sha256 != source.sha256 {
            return refuse(format!(
                "holds another input ({}, sha256 {:.12}); remove it or choose another output for {}",
                held.source.file_name,
                held.source.sha256,
                video.display()
            ));
        }
    } else if folder.is_dir() {
        let entries = fs::read_dir(folder).map_err(|e| store::StoreError::read(folder, e))?;
        let is_foreign = entries
            .filter_map(Result::ok)
            .any(|entry| !is_ours_before_analysis(&entry.file_name().to_string_lossy()));
        if is_foreign {
            return refuse("is not empty and holds no curated video".to_owned());
        }
    }
    Ok(store::create_folder(folder)?)
}

/// What an interrupted analysis may leave: done-records, temporary files and the signals.
fn is_ours_before_analysis(name: &str) -> bool {
    name.starts_with('.') || name == SIGNALS_FILE
}

/// The analysis stage.
fn analysed(
    video: &Path,
    folder: &Path,
    source: &SourceVideo,
    detector: &Detector,
    progress: &dyn Progress,
) -> Result<VideoAnalysis, CurateError> {
    let plan = StagePlan::new(folder, "analysis")
        .with_hash("video", source.sha256.clone())
        .with_text("file name", &source.file_name)
        .with_text("detector", detector.id);
    let record_path = folder.join(ANALYSIS_FILE);
    if plan.is_done() {
        progress.note(&format!("{}: analysis unchanged, skipped", video.display()));
        return Ok(store::read_record(&record_path)?);
    }
    plan.begin()?;
    let started = Instant::now();
    let Analysis {
        probe,
        range,
        signals,
        samples,
        damaged_frames,
    } = analysis::analyse(video, detector, progress)?;
    if damaged_frames > 0 {
        progress.note(&format!(
            "{}: {damaged_frames} damaged frames were patched up or left out",
            video.display()
        ));
    }
    let record = VideoAnalysis {
        source: source.clone(),
        range,
        verdict: verdict::judge(&probe, samples.pictures()),
        probe,
        damaged_frames,
        signals: SIGNALS_FILE.to_owned(),
    };
    signals.write_parquet(&folder.join(SIGNALS_FILE))?;
    store::write_record(&record_path, &record)?;
    plan.finish(
        [ANALYSIS_FILE, SIGNALS_FILE],
        started.elapsed().as_secs_f64(),
    )?;
    Ok(record)
}

/// The stage that cuts a video into sequences and extracts their frames.
struct Sequencing<'a> {
    video: &'a Path,
    folder: &'a Path,
    source: &'a SourceVideo,
    settings: &'a CurateSettings,
    detector: &'a Detector,
    analysis: &'a VideoAnalysis,
    verdict: ErpVerdict,
    admission: Admission,
    size: (u32, u32),
}

impl Sequencing<'_> {
    fn run(&self, progress: &dyn Progress) -> Result<Vec<String>, CurateError> {
        let plan = StagePlan::new(self.folder, "sequences")
            .with_hash("video", self.source.sha256.clone())
            .with_text("file name", &self.source.file_name)
            .with_settings("settings", self.settings)
            .with_settings("analysis", self.analysis);
        if plan.is_done() {
            let names = sequence_folders(self.folder)?;
            progress.note(&format!(
                "{}: {} sequences unchanged, skipped",
                self.video.display(),
                names.len()
            ));
            return Ok(names);
        }
        plan.begin()?;
        let started = Instant::now();
        let signals = Signals::read_parquet(&self.folder.join(SIGNALS_FILE))?;
        let shots = self.shots(&signals)?;
        let staging = Staging::new(self.folder)?;
        let selections: Vec<Selection> = shots
            .iter()
            .enumerate()
            .map(|(index, &shot)| Selection {
                times: frames::choose(&signals.times, shot, self.settings.sampling),
                folder: staging.folder.join(sequence_name(index)),
            })
            .collect();
        let probe = &self.analysis.probe;
        let entries = frames::extract(self.video, probe, &selections, self.size, progress)?;
        let mut outputs = vec![BOUNDARIES_FILE.to_owned()];
        for (index, (&range, entries)) in shots.iter().zip(entries).enumerate() {
            let name = sequence_name(index);
            outputs.push(format!("{name}/{SEQUENCE_FILE}"));
            outputs.extend(entries.iter().map(|entry| format!("{name}/{}", entry.file)));
            let sequence = Sequence {
                id: format!("{}/{name}", self.folder_name()),
                source: self.source.clone(),
                range,
                probe: probe.clone(),
                verdict: self.verdict.clone(),
                admission: self.admission.clone(),
                frames: FrameSet {
                    width: self.size.0,
                    height: self.size.1,
                    sampling: self.settings.sampling,
                    resampling: frames::resampling(probe, self.size),
                    entries,
                },
            };
            store::write_record(&selections[index].folder.join(SEQUENCE_FILE), &sequence)?;
        }
        let names = staging.publish(shots.len())?;
        plan.finish(outputs, started.elapsed().as_secs_f64())?;
        progress.note(&format!(
            "{}: {}, {} sequences",
            self.video.display(),
            self.verdict.verdict.name(),
            names.len()
        ));
        Ok(names)
    }

    /// Name of the video in its dataset.
    fn folder_name(&self) -> String {
        let name = self.folder.file_name().unwrap_or_default();
        name.to_string_lossy().into_owned()
    }

    /// Decides the boundaries, writes the ledger and returns the shots that are long enough.
    fn shots(&self, signals: &Signals) -> Result<Vec<TimeRange>, CurateError> {
        let boundaries = (self.detector.decide)(signals);
        let least = self.settings.minimum_shot_seconds;
        let shots = slice::shots(&signals.times, self.analysis.range, &boundaries, least);
        let ledger = BoundaryLedger {
            source: self.source.clone(),
            range: self.analysis.range,
            detector: format!("{}: {}", self.detector.id, (self.detector.settings)()),
            boundaries,
            dropped: shots.dropped,
        };
        store::write_record(&self.folder.join(BOUNDARIES_FILE), &ledger)?;
        if shots.kept.is_empty() {
            return Err(CurateError::rejected(
                self.video,
                format!("none of its shots lasts {least} s"),
            ));
        }
        Ok(shots.kept)
    }
}

/// A hidden folder beside the final ones; removed with what is left in it.
struct Staging<'a> {
    parent: &'a Path,
    folder: PathBuf,
}

impl<'a> Staging<'a> {
    fn new(parent: &'a Path) -> Result<Self, CurateError> {
        let folder = store::temporary_beside(&parent.join("sequences"));
        store::create_folder(&folder)?;
        Ok(Self { parent, folder })
    }

    /// Replaces the sequence folders of the video by the first `count` staged ones.
    fn publish(self, count: usize) -> Result<Vec<String>, CurateError> {
        for name in sequence_folders(self.parent)? {
            let stale = self.parent.join(name);
            fs::remove_dir_all(&stale).map_err(|error| store::StoreError::write(&stale, error))?;
        }
        let names: Vec<String> = (0..count).map(sequence_name).collect();
        for name in &names {
            let target = self.parent.join(name);
            fs::rename(self.folder.join(name), &target)
                .map_err(|error| store::StoreError::write(&target, error))?;
        }
        Ok(names)
    }
}

impl Drop for Staging<'_> {
    fn drop(&mut self) {
        // Nothing depends on it any more; what cannot be removed is hidden and harmless.
        drop(fs::remove_dir_all(&self.folder));
    }
}

fn sequence_name(index: usize) -> String {
    format!("seq-{index:03}")
}

/// Names of the sequence folders in a video's folder, in order.
///
/// # Errors
/// When the folder cannot be read.
pub fn sequence_folders(folder: &Path) -> Result<Vec<String>, CurateError> {
    let entries = fs::read_dir(folder).map_err(|error| store::StoreError::read(folder, error))?;
    let mut names: Vec<String> = entries
        .filter_map(Result::ok)
        .map(|entry| entry.file_name().to_string_lossy().into_owned())
        .filter(|name| name.starts_with("seq-") && folder.join(name).join(SEQUENCE_FILE).is_file())
        .collect();
    names.sort();
    Ok(names)
}

/// File name without its extension: the name of the video's folder in a dataset.
pub fn stem(video: &Path) -> String {
    video
        .file_stem()
        .unwrap_or_default()
        .to_string_lossy()
        .into_owned()
}
