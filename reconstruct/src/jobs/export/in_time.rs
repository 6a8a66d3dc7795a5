//! Exports of dynamic scenes: one file of closed forms with a page that plays it, or a file at each frame's time.

use glam::{DQuat, DVec3};
use omnilife_engine::{
    gaussians::{ActivatedGaussians, parameterization::Viewpoint, temporal::TemporalFeatures},
    model::Model,
};
use omnilife_schemas::{
    elapsed::Stopwatch,
    layout::ASSET_FILE,
    ownership::OwnFile,
    progress::Progress,
    records::{
        Asset, AssetChanges, AssetLevel, AssetMoment, AssetPage, AssetPlacement, AssetSource,
        InvalidGaussians,
    },
    stage::StagePlan,
    store,
};

use super::{
    ExportRequest, ExportResult, PAGE_FILE, player,
    source::{OpenedSource, asset_source},
    viewer_limits::FileFrame,
    whole::whole,
    write_whole,
};
use omnilife_training::{
    error::ReconstructError,
    formats::{
        self, exchange,
        in_time::{self, WrittenInTime},
        splat::Placement,
    },
};

/// Name of a sequence of files on the command line.
const SEQUENCE_NAME: &str = "spz-sequence";
/// Format of the files of a sequence.
const SEQUENCE_FORMAT: &str = "spz";
/// Names of the formats in time.
pub(super) const NAMES: [&str; 2] = [in_time::NAME, SEQUENCE_NAME];
/// Name of the only level.
const LEVEL: &str = "full";
/// Number of files of a sequence over a span without frames.
const MOMENTS: usize = 60;
/// Maximum number of Gaussians inside a page: about 100 MB of text.
const MOST_INSIDE: u64 = 2_500_000;

/// Export of a dynamic scene.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum TimeExport {
    /// One file of closed forms.
    ClosedForms,
    /// One file at each frame's time.
    Sequence,
}

impl TimeExport {
    pub(super) fn named(name: &str) -> Option<Self> {
        match name {
            in_time::NAME => Some(Self::ClosedForms),
            SEQUENCE_NAME => Some(Self::Sequence),
            _ => None,
        }
    }

    /// Refuses options of other formats.
    fn check(self, request: &ExportRequest) -> Result<(), ReconstructError> {
        let has_levels = request.levels.iter().any(|level| level.most.is_some());
        let is_file = self == Self::ClosedForms;
        let reason = if has_levels {
            "levels of detail are of static files: leave out --lod"
        } else if request.time_seconds.is_some() {
            "the export holds every moment: leave out --time"
        } else if is_file && request.moments.is_some() {
            "the file holds every moment: leave out --moments"
        } else if !is_file && request.with_page {
            "a page plays gtime or holds .splat levels: leave out the page, or the format spz-sequence"
        } else if is_file && request.up.is_some() && in_time::is_named(&request.gaussians) {
            "a file in time keeps its axes: leave out --up"
        } else {
            return Ok(());
        };
        Err(ReconstructError::Request {
            reason: reason.to_owned(),
        })
    }
}

/// Exports Gaussians in time as an asset.
///
/// # Errors
/// When an option belongs to another format, or the Gaussians cannot be read, have no closed form or do not move. When
/// a file cannot be written or belongs to someone else.
pub(super) fn export(
    request: &ExportRequest,
    kind: TimeExport,
    progress: &dyn Progress,
) -> Result<ExportResult, ReconstructError> {
    let begun = Stopwatch::with_children();
    kind.check(request)?;
    let OpenedSource {
        mut model,
        normalization,
        record,
        frame,
        mut invalid,
    } = OpenedSource::open(request)?;
    let source = asset_source(request, record, None)?;
    let refuse = |reason: String| ReconstructError::scene(&request.gaussians, reason);
    let content = match kind {
        TimeExport::ClosedForms if in_time::is_named(&request.gaussians) => {
            Content::ClosedForms(in_time::copy(&request.gaussians)?)
        }
        TimeExport::ClosedForms => {
            let placement = placement(&frame);
            let file = in_time::write(&model, &placement, &normalization, &mut invalid);
            Content::ClosedForms(file.map_err(refuse)?)
        }
        TimeExport::Sequence => Content::Sequence(moments(request, &model)?),
    };
    for note in formats::notes_on(&request.gaussians, &invalid) {
        progress.note(&note);
    }
    let stage = StagePlan::new(&request.out, "export").with_text("source", &source.sha256);
    let mut outputs = content.files();
    outputs.push(ASSET_FILE.to_owned());
    outputs.extend(request.with_page.then(|| PAGE_FILE.to_owned()));
    stage.run(&outputs, progress, |out| {
        out.count_from(begun);
        // A record must not stand beside files of another export.
        store::remove(&request.out.join(ASSET_FILE))?;
        stage
            .own_files()
            .remove(|file| !outputs.iter().any(|new| new == file))?;
        let mut asset = Asset {
            source,
            splats: 0,
            levels: Vec::new(),
            moments: None,
            sequence: Vec::new(),
            left_out: Vec::new(),
            placement: frame.placement(1.0),
            changes: AssetChanges::default(),
            invalid,
            page: None,
            wall_seconds: 0.0,
        };
        let mut notes = Vec::new();
        match &content {
            Content::ClosedForms(file) => {
                write_file(request, file, &mut asset)?;
                if request.with_page {
                    asset.page = Some(write_page(request, file, &asset.source, &mut notes)?);
                }
            }
            Content::Sequence(times) => {
                write_sequence(
                    request,
                    &mut model,
                    (&frame, &times[..]),
                    &mut asset,
                    progress,
                )?;
                notes.extend(asset.changes.notes());
            }
        }
        asset.wall_seconds = begun.elapsed().wall_seconds;
        for file in outputs.iter().filter(|file| *file != ASSET_FILE) {
            let level = asset.levels.iter().find(|level| level.file == *file);
            out.add_hashed(OwnFile {
                file: file.clone(),
                sha256: level.map(|level| level.sha256.clone()),
            });
        }
        out.write_record(ASSET_FILE, &asset)?;
        Ok(ExportResult { asset, notes })
    })
}

enum Content {
    ClosedForms(WrittenInTime),
    /// Times of the files, seconds.
    Sequence(Vec<f64>),
}

impl Content {
    fn files(&self) -> Vec<String> {
        match self {
            Self::ClosedForms(_) => vec![level_file()],
            Self::Sequence(times) => (0..times.len()).map(sequence_file).collect(),
        }
    }
}

fn level_file() -> String {
    format!("{LEVEL}{}", in_time::ENDING)
}

fn sequence_file(number: usize) -> String {
    format!("frame-{number:06}.spz")
}

/// Returns the place of files of a frame in the world.
fn placement(frame: &FileFrame) -> Placement {
    let placement = frame.placement(1.0);
    let [w, x, y, z] = placement.rotation_wxyz;
    Placement {
        offset: DVec3::from_array(placement.offset),
        scale: placement.scale,
        rotation: DQuat::from_xyzw(x, y, z, w),
    }
}

/// Returns the times of a sequence.
fn moments(request: &ExportRequest, model: &Model) -> Result<Vec<f64>, ReconstructError> {
    let refuse = |reason: &str| Err(ReconstructError::scene(&request.gaussians, reason));
    let Some(span) = model.time_span() else {
        return refuse("does not move: --format spz writes it");
    };
    match request.moments.or(span.frames).unwrap_or(MOMENTS) {
        0 | 1 => refuse("is a sequence of one moment: --format spz writes it"),
        count => Ok(span.moments(count)),
    }
}

fn write_file(
    request: &ExportRequest,
    written: &WrittenInTime,
    asset: &mut Asset,
) -> Result<(), ReconstructError> {
    store::write_bytes(&request.out.join(level_file()), &written.bytes)?;
    let rotation = written.placement.rotation;
    asset.splats = written.gaussians;
    asset.changes.transparent = written.transparent;
    asset.placement = AssetPlacement {
        offset: written.placement.offset.to_array(),
        scale: written.placement.scale,
        rotation_wxyz: [rotation.w, rotation.x, rotation.y, rotation.z],
    };
    asset.levels.push(AssetLevel {
        name: LEVEL.to_owned(),
        file: level_file(),
        splats: written.gaussians,
        bytes: written.bytes.len() as u64,
        sha256: store::sha256_bytes(&written.bytes),
        growth: 1.0,
    });
    Ok(())
}

/// Writes the page that plays a file, which is inside unless it is too large.
fn write_page(
    request: &ExportRequest,
    written: &WrittenInTime,
    source: &AssetSource,
    notes: &mut Vec<String>,
) -> Result<AssetPage, ReconstructError> {
    let is_inside = written.gaussians <= MOST_INSIDE;
    if !is_inside {
        notes.push(format!(
            "the page has no Gaussians inside: there are more than {MOST_INSIDE}; open {} in it",
            level_file()
        ));
    }
    let title = source.scene.as_deref().unwrap_or("Gaussians in time");
    let inside = if is_inside { &written.bytes[..] } else { &[] };
    let text = player::html(title, inside);
    store::write_bytes(&request.out.join(PAGE_FILE), text.as_bytes())?;
    Ok(AssetPage {
        file: PAGE_FILE.to_owned(),
        level: is_inside.then(|| LEVEL.to_owned()),
        holds_moments: is_inside,
        bytes: text.len() as u64,
    })
}

fn write_sequence(
    request: &ExportRequest,
    model: &mut Model,
    (frame, times): (&FileFrame, &[f64]),
    asset: &mut Asset,
    progress: &dyn Progress,
) -> Result<(), ReconstructError> {
    let format = exchange::by_name(SEQUENCE_FORMAT)?;
    progress.begin("writing a sequence", Some(times.len() as u64));
    let mut write = |number: usize, seconds: f64| -> Result<(), ReconstructError> {
        let mut gaussians = ActivatedGaussians::default();
        let at = Viewpoint::of_moment(seconds);
        model.activate(&at, &TemporalFeatures::default(), &mut gaussians);
        let mut invalid = InvalidGaussians::default();
        let drawable = whole(&gaussians, frame, &mut invalid);
        // The others were counted when the source was read.
        let far = asset.invalid.out_of_reach.max(invalid.out_of_reach);
        asset.invalid.out_of_reach = far;
        let mut changes = drawable.changes;
        let visible = drawable.whole.filter(|visible| !visible.is_empty());
        let Some(visible) = visible else {
            let reason = format!("has no Gaussian that a viewer could draw at {seconds} seconds");
            return Err(ReconstructError::scene(&request.gaussians, reason));
        };
        format.ranges.count(&visible, &mut changes);
        asset.changes.merge(&changes);
        let moving = write_whole(&request.out, sequence_file(number), format, &visible)?;
        asset.splats = asset.splats.max(moving.splats);
        asset.sequence.push(AssetMoment {
            time_seconds: seconds,
            moving,
        });
        progress.advance(1);
        Ok(())
    };
    let mut all = times.iter().enumerate();
    let written = all.try_for_each(|(number, &seconds)| write(number, seconds));
    progress.end();
    written
}
