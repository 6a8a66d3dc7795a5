//! One video from file to sequences: the stages, their dependencies, and their results.
//!
//! A video's folder holds `analysis.json`, `signals.parquet`, `samples.parquet`, `signature.parquet`
//! and `boundaries.json`, and per sequence `seq-NNN/sequence.json` with `seq-NNN/frames/NNNNNN.png`.

use std::{fs, path::Path};

use omnilife_schemas::{
    layout::{ANALYSIS_FILE, SAMPLES_FILE, SIGNALS_FILE, SIGNATURE_FILE},
    lock::FolderLock,
    progress::Progress,
    records::{Probe, SourceVideo, SphereLayout, VideoAnalysis},
    stage::StagePlan,
    store::{self, StoreError},
};

use crate::{
    admission,
    analysis::{self, Analysis},
    boundaries::{self, Detector, Signals},
    criteria, decoding_notes,
    error::CurateError,
    frames,
    near_duplicates::signature,
    overlays::{self, MosaicPass, OverlayPass},
    projection,
    sequences::{self, Sequencing},
    settings::{CurateSettings, FrameSelection, LayoutChoice},
    sharpness::View,
    shots::{self, Samples, ShotList},
    sphere_layouts, stills,
    video_folder::{ANALYSIS_FILES, claim},
};

/// Curates one video into `folder` and returns the names of its sequence folders in order of time.
///
/// Decodes at most twice: once for the analysis of every frame, once to extract the sampled ones. Each is skipped, with
/// a note, while the video and the settings it depends on are unchanged.
///
/// # Errors
/// [`CurateError::Video`] for a file that is not a sound video, [`CurateError::Rejected`] for one that the criteria (if
/// enforced) or the ERP projection exclude, [`CurateError::Input`] for invalid settings and for a folder that holds
/// another video, [`CurateError::Store`] when files cannot be written.
pub fn curate_video(
    video: &Path,
    folder: &Path,
    settings: &CurateSettings,
    progress: &dyn Progress,
) -> Result<Vec<String>, CurateError> {
    settings.check(video)?;
    progress.begin("hashing", None);
    let source = identify(video);
    progress.end();
    curate_source(video, &source?, folder, settings, progress)
}

/// Curates as [`curate_video`], with checked settings and a video that is hashed already.
pub(crate) fn curate_source(
    video: &Path,
    source: &SourceVideo,
    folder: &Path,
    settings: &CurateSettings,
    progress: &dyn Progress,
) -> Result<Vec<String>, CurateError> {
    let outcome = match video.is_dir() {
        true => stills::curate(video, source, folder, settings, progress),
        false => sequences_of(video, source, folder, settings, progress),
    };
    if let Err(error) = &outcome
        && let Some(failed) = error.failed_checks()
        && is_of(folder, source)?
    {
        let _lock = FolderLock::take(folder, progress)?;
        sequences::withdraw(folder, failed, progress)?;
    }
    outcome
}

/// Returns true if a folder holds an earlier run's results of this video.
fn is_of(folder: &Path, source: &SourceVideo) -> Result<bool, CurateError> {
    let record = folder.join(ANALYSIS_FILE);
    if !record.is_file() {
        return Ok(false);
    }
    let held: VideoAnalysis = store::read_record(&record)?;
    Ok(held.source.sha256 == source.sha256)
}

/// Runs the stages from the header to the sequences.
fn sequences_of(
    video: &Path,
    source: &SourceVideo,
    folder: &Path,
    settings: &CurateSettings,
    progress: &dyn Progress,
) -> Result<Vec<String>, CurateError> {
    let detector = boundaries::detector(&settings.detector, video)?;
    let criteria = criteria::criteria(&settings.profile, video)?;
    let probe = analysis::timed_probe(video)?;
    // Before anything is decoded; the size of a layout found by evidence is checked again later.
    let early_layout = match settings.layout {
        Some(LayoutChoice::Known(layout)) => Some(layout),
        Some(LayoutChoice::UnknownDualFisheye) => Some(sphere_layouts::NARROWEST_DUAL_FISHEYE),
        None if settings.accept.is_some() => None,
        // Frames of another shape than the stated layout's are judged by their pixels.
        None => sphere_layouts::stated(&probe)
            .filter(|layout| sphere_layouts::expect_shape(*layout, probe.upright_size()).is_ok()),
    };
    frames::frame_size(video, &probe, settings.width, settings.accept, early_layout)?;
    // Faults in the header and the time stamps need no decoding of gigabytes.
    let early = criteria::Candidate {
        probe: &probe,
        layout: early_layout,
        projection: None,
        damaged_frames: None,
        overlays: None,
    };
    admission::enforce(video, &criteria::admit(&criteria, &early, settings.enforce))?;

    let asked = asked_layout(video, &probe, settings, progress)?;
    if let (Some(layout), Some(stated)) = (asked, sphere_layouts::stated(&probe))
        && layout != stated
    {
        progress.note(&format!(
            "{}: its container states {stated}, and --projection takes it as {layout}",
            video.display()
        ));
    }
    claim(video, folder, source)?;
    let _lock = FolderLock::take(folder, progress)?;
    let measured = match settings.select {
        FrameSelection::Even => None,
        FrameSelection::Sharp => Some(settings.view()),
    };
    let analysis = analysed(video, folder, source, asked, detector, measured, progress)?;
    let layout = match settings.accept {
        Some(_) => None,
        None => analysis.layout,
    };
    let signals = Signals::read_parquet(&folder.join(SIGNALS_FILE))?;
    let samples = Samples::read(&folder.join(SAMPLES_FILE))?;
    let shots = ShotList::of(folder, &analysis, detector, settings, &signals, &samples)?;
    let sphere_share = shots.sphere_share;
    let projection = admission::effective_projection(
        video,
        &analysis,
        layout,
        settings,
        sphere_share,
        progress,
    )?;
    let size = frames::frame_size(video, &probe, settings.width, settings.accept, layout)?;
    if let Some(line) = settings.sampling.excess(analysis.probe.frames_per_second) {
        progress.note(&format!("{}: {line}", video.display()));
    }
    let candidate = criteria::Candidate {
        probe: &analysis.probe,
        layout,
        projection: Some(&projection),
        damaged_frames: Some(analysis.damaged_frames + analysis.frames_out_of_time),
        overlays: analysis.overlays.as_ref(),
    };
    let admission = criteria::admit(&criteria, &candidate, settings.enforce);
    admission::enforce(video, &admission)?;
    if let Some(failures) = criteria::failures(&admission) {
        progress.note(&format!(
            "{}: would not be admitted by {}: {failures}",
            video.display(),
            criteria.name
        ));
    }
    for line in criteria::unenforced(&admission) {
        progress.note(&format!("{}: {line}", video.display()));
    }
    let work = Sequencing {
        video,
        folder,
        settings,
        detector,
        analysis: &analysis,
        signals: &signals,
        list: &shots,
        layout,
        projection,
        admission,
        size,
    };
    work.run(progress)
}

/// Returns the user's layout, with lenses that are estimated unless given.
fn asked_layout(
    video: &Path,
    probe: &Probe,
    settings: &CurateSettings,
    progress: &dyn Progress,
) -> Result<Option<SphereLayout>, CurateError> {
    match settings.layout {
        None => Ok(None),
        Some(LayoutChoice::Known(layout)) => Ok(Some(layout)),
        Some(LayoutChoice::UnknownDualFisheye) => {
            progress.begin("looking for two lenses", None);
            let found = sphere_layouts::estimated_dual_fisheye(video, probe);
            progress.end();
            let found = found?;
            progress.note(&format!(
                "{}: its lenses are taken for {found}, by what both see",
                video.display()
            ));
            Ok(Some(found))
        }
    }
}

/// Identifies a video by its content.
///
/// # Errors
/// When it cannot be read.
pub(crate) fn identify(video: &Path) -> Result<SourceVideo, CurateError> {
    let metadata = fs::metadata(video).map_err(|error| StoreError::read(video, error))?;
    if metadata.is_dir() {
        return stills::identify(video);
    }
    Ok(SourceVideo {
        file_name: video
            .file_name()
            .unwrap_or_default()
            .to_string_lossy()
            .into_owned(),
        sha256: store::sha256_file(video)?,
        bytes: metadata.len(),
    })
}

/// Runs the analysis stage.
fn analysed(
    video: &Path,
    folder: &Path,
    source: &SourceVideo,
    asked: Option<SphereLayout>,
    detector: &Detector,
    measured: Option<View>,
    progress: &dyn Progress,
) -> Result<VideoAnalysis, CurateError> {
    let mut plan = StagePlan::new(folder, "analysis")
        .with_hash("video", source.sha256.clone())
        .with_text("detector", &detector.description())
        .with_text("samples", shots::SETTINGS)
        .with_text("overlays", overlays::SETTINGS)
        .with_text("signature", signature::SETTINGS);
    if let Some(layout) = asked {
        plan = plan.with_settings("layout", &layout);
    }
    if let Some(view) = measured {
        plan = plan.with_text("sharpness", view.description());
    }
    let record_path = folder.join(ANALYSIS_FILE);
    if plan.is_done() {
        progress.note(&format!("{}: analysis unchanged, skipped", video.display()));
        let held: VideoAnalysis = store::read_record(&record_path)?;
        if held.source == *source {
            return Ok(held);
        }
        // The same content under another name. The new record must not fail the done-record's
        // sizes.
        let renamed = VideoAnalysis {
            source: source.clone(),
            ..held
        };
        store::write_record(&record_path, &renamed)?;
        plan.finish(ANALYSIS_FILES, 0.0)?;
        return Ok(renamed);
    }
    plan.run(ANALYSIS_FILES, progress, |out| {
        let Analysis {
            probe,
            range,
            mut signals,
            samples,
            shot_samples,
            overlays,
            mosaics,
            mut signature,
            damaged_frames,
            interlaced_frames,
            frames_out_of_time,
            repetitions,
        } = analysis::analyse_with(video, detector, asked, measured, progress)?;
        let faults = decoding_notes::Faults {
            damaged_frames,
            frames_out_of_time,
            interlaced_frames,
            repetitions,
        };
        for line in decoding_notes::lines(&probe, &faults) {
            progress.note(&format!("{}: {line}", video.display()));
        }
        projection::note_turns(video, &probe, progress);
        let projection = projection::judge(&probe, samples.images());
        let mut shot_samples = shot_samples.finish();
        let evident = || sphere_layouts::evident(&projection, &probe);
        let layout = asked.or_else(evident);
        let screened = |pass: &OverlayPass, mosaics: &MosaicPass, signals: &Signals| {
            // Boundaries of people, in the ledger, come later and change no measurement.
            let boundaries = (detector.decide)(signals)
                .map_err(|error| CurateError::internal(&folder.join(SIGNALS_FILE), error))?;
            Ok::<_, CurateError>(overlays::report(pass, mosaics, &boundaries))
        };
        let overlays = if layout == asked {
            // In a video of another kind, shots may still be spheres for most of the time.
            let is_sphere = layout.is_some() || projection.projection.is_monoscopic_erp();
            (is_sphere || shot_samples.show_spheres())
                .then(|| screened(&overlays, &mosaics, &signals))
                .transpose()?
        } else {
            // What the frames store is known only now.
            let again = analysis::analyse_with(video, detector, layout, measured, progress)?;
            // Of equirectangular images, unlike the first ones.
            signals = again.signals;
            signature = again.signature;
            shot_samples = again.shot_samples.finish();
            Some(screened(&again.overlays, &again.mosaics, &signals)?)
        };
        let record = VideoAnalysis {
            source: source.clone(),
            range,
            overlays,
            layout,
            projection,
            probe,
            damaged_frames,
            interlaced_frames,
            repeated_frames: repetitions.frames,
            longest_repetition_frames: repetitions.longest,
            frames_out_of_time,
            signals: SIGNALS_FILE.to_owned(),
        };
        signals.write_parquet(&folder.join(SIGNALS_FILE))?;
        shot_samples.write(&folder.join(SAMPLES_FILE))?;
        (signature.finish()).write_parquet(&folder.join(SIGNATURE_FILE))?;
        out.add_all([SIGNALS_FILE, SAMPLES_FILE, SIGNATURE_FILE]);
        out.write_record(ANALYSIS_FILE, &record)?;
        Ok(record)
    })
}

/// Returns the file name without its extension, the name of the video's folder in a dataset. For any file name it is
/// visible, on one line and no step to another folder.
pub fn stem(video: &Path) -> String {
    let stem = video.file_stem().unwrap_or_default().to_string_lossy();
    let is_broken = |character: char| character.is_control() || character == '\\';
    let rest = stem.trim_start_matches('.');
    let dots = stem.len() - rest.len();
    match "_".repeat(dots) + &rest.replace(is_broken, "_") {
        empty if empty.is_empty() => "video".to_owned(),
        name => name,
    }
}
