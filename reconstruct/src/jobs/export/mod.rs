//! A run's Gaussians, or those of a file, as levels of detail for viewers, with a record and a page.
//!
//! * `source`: exported Gaussians. `moments`: dynamic scenes. `viewer_limits`: limits of viewers of `.splat`. `whole`:
//!   unchanged Gaussians, for other formats.
//! * [`levels`]: number, choice and size of Gaussians. [`page`]: one HTML file with everything in it.
//! * `in_time`: closed forms of dynamic scenes, and sequences of files.

mod in_time;
pub mod levels;
mod moments;
pub mod page;
mod player;
mod source;
mod viewer_limits;
mod whole;

use std::path::{Path, PathBuf};

use omnilife_engine::gaussians::ActivatedGaussians;
use omnilife_schemas::{
    elapsed::Stopwatch,
    layout::ASSET_FILE,
    names,
    ownership::OwnFile,
    progress::Progress,
    records::{Asset, AssetLevel, AssetMoment, AssetMoments, AssetPage, AssetSplats},
    stage::StagePlan,
    store,
};

use self::{
    in_time::TimeExport,
    levels::{Level, nested, selections},
    moments::Moments,
    page::{EmbeddedData, MOST_SPLATS_INSIDE, MOST_SPLATS_OF_MOMENTS, PageContent},
    source::ExportedScene,
    viewer_limits::Drawable,
};
use omnilife_training::{
    error::ReconstructError,
    formats::{
        exchange::{self, SplatFormat},
        splat::{self, MOST_ROWS, SplatRow},
    },
};

/// The page, in an asset's folder.
const PAGE_FILE: &str = "index.html";
/// File of the static Gaussians of a dynamic scene.
const STILL_FILE: &str = "still.splat";

/// Returns the file of the dynamic Gaussians at a moment.
fn moment_file(number: usize) -> String {
    format!("moment-{number:03}.splat")
}

/// Request of an export.
#[derive(Debug, Clone, PartialEq)]
pub struct ExportRequest {
    /// A run's folder, or a file of Gaussians.
    pub gaussians: PathBuf,
    /// Name of the format, one of [`format_names`].
    pub format: String,
    /// Requested levels.
    pub levels: Vec<Level>,
    /// True if a page is requested.
    pub with_page: bool,
    /// Up in the world; by default that of the run's cameras, or of a world with z up.
    pub up: Option<[f64; 3]>,
    /// The moment that levels show of a dynamic scene, seconds; by default the middle of its clip.
    pub time_seconds: Option<f64>,
    /// Number of exported moments of a dynamic scene beside its levels; 1 for none. By default one per frame of
    /// its clip, within the limit of size.
    pub moments: Option<usize>,
    /// Folder of the asset.
    pub out: PathBuf,
}

/// An exported asset, with notes for its maker.
#[derive(Debug)]
pub struct ExportResult {
    /// The record.
    pub asset: Asset,
    /// Differences from the request.
    pub notes: Vec<String>,
}

/// Exports Gaussians as an asset.
///
/// # Errors
/// When the format is unknown, the Gaussians cannot be read, or every level is larger than the scene. When a level
/// has more Gaussians than viewers can draw or the format can hold. When a file cannot be written or belongs to
/// someone else.
pub fn export(
    request: &ExportRequest,
    progress: &dyn Progress,
) -> Result<ExportResult, ReconstructError> {
    let begun = Stopwatch::with_children();
    if let Some(kind) = TimeExport::named(&request.format) {
        return in_time::export(request, kind, progress);
    }
    let format = format_of(request)?;
    let ExportedScene {
        drawable,
        source,
        invalid,
        without_moments,
    } = ExportedScene::open(request, format, progress)?;
    let splats = drawable.len() as u64;
    let LevelPlan {
        levels: wanted,
        mut left_out,
    } = levels_within(request, format, splats)?;
    left_out.extend(without_moments);
    let mut notes = left_out.clone();
    notes.extend(drawable.changes.notes());
    let libraries = match request.with_page.then(page::libraries) {
        None => None,
        Some(Ok(libraries)) => Some(libraries),
        Some(Err(missing)) => {
            notes.push(missing.to_string());
            None
        }
    };
    let stage = StagePlan::new(&request.out, "export").with_text("source", &source.sha256);
    let mut outputs: Vec<String> = (wanted.iter())
        .map(|(level, _)| level.file(format.ending))
        .collect();
    outputs.push(ASSET_FILE.to_owned());
    outputs.extend(libraries.iter().map(|_| PAGE_FILE.to_owned()));
    if let Some(moments) = &drawable.moments {
        outputs.push(STILL_FILE.to_owned());
        outputs.extend((0..moments.moving.len()).map(moment_file));
    }
    stage.run(&outputs, progress, |out| {
        out.count_from(begun);
        // A record must not stand beside levels of another export.
        store::remove(&request.out.join(ASSET_FILE))?;
        stage
            .own_files()
            .remove(|file| !outputs.iter().any(|new| new == file))?;
        let levels = write_levels(&request.out, &drawable, format, &wanted, progress)?;
        let moments = drawable
            .moments
            .as_ref()
            .map(|moments| write_moments(&request.out, moments, progress))
            .transpose()?;
        let mut asset = Asset {
            source,
            splats,
            levels,
            moments,
            sequence: Vec::new(),
            left_out,
            placement: drawable.placement,
            changes: drawable.changes,
            invalid,
            page: None,
            wall_seconds: 0.0,
        };
        if let Some(libraries) = &libraries {
            asset.page = Some(write_page(&request.out, &asset, libraries, &mut notes)?);
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

/// Returns the names of all formats of exports.
pub fn format_names() -> Vec<&'static str> {
    let of_levels = exchange::SPLAT_FORMATS.iter().map(|format| format.name);
    of_levels.chain(in_time::NAMES).collect()
}

fn format_of(request: &ExportRequest) -> Result<&'static SplatFormat, ReconstructError> {
    names::find("format", &request.format, &format_names(), |name| name)?;
    let format = exchange::by_name(&request.format)?;
    if request.with_page && !format.is_for_old_viewers {
        return Err(ReconstructError::Request {
            reason: format!(
                "a page holds .splat levels: leave out the page, or the format {}",
                format.name
            ),
        });
    }
    Ok(format)
}

/// Levels of an asset.
struct LevelPlan {
    /// The smallest first, each with its number of Gaussians.
    levels: Vec<(Level, u64)>,
    /// Reasons for leaving out others.
    left_out: Vec<String>,
}

/// Returns the levels that the scene has enough Gaussians for.
fn levels_within(
    request: &ExportRequest,
    format: &SplatFormat,
    splats: u64,
) -> Result<LevelPlan, ReconstructError> {
    let refuse = |reason: String| Err(ReconstructError::scene(&request.gaussians, reason));
    let (mut wanted, mut left_out) = (Vec::new(), Vec::new());
    for level in &request.levels {
        match level.most {
            Some(most) if most >= splats => left_out.push(format!(
                "level {} is left out: the scene has {splats} Gaussians, which is the level full",
                level.name
            )),
            most => wanted.push((level.clone(), most.unwrap_or(splats))),
        }
    }
    wanted.sort_by_key(|(_, count)| *count);
    let file = |level: &Level| level.file(format.ending);
    wanted.dedup_by(|a, b| file(&a.0) == file(&b.0) || a.1 == b.1);
    let Some((level, count)) = wanted.last() else {
        return refuse(format!(
            "has {splats} Gaussians, fewer than every level that is asked for; ask for full"
        ));
    };
    if format.is_for_old_viewers && *count > MOST_ROWS {
        return refuse(format!(
            "level {} has {count} Gaussians, viewers draw {MOST_ROWS} at most; ask for a smaller one",
            level.name
        ));
    }
    Ok(LevelPlan {
        levels: wanted,
        left_out,
    })
}

fn write_levels(
    out: &Path,
    drawable: &Drawable,
    format: &SplatFormat,
    wanted: &[(Level, u64)],
    progress: &dyn Progress,
) -> Result<Vec<AssetLevel>, ReconstructError> {
    progress.begin("writing levels", Some(wanted.len() as u64));
    // The largest first: the smaller ones are part of it.
    let counts: Vec<u64> = wanted.iter().rev().map(|(_, count)| *count).collect();
    let names = wanted.iter().rev().map(|(level, _)| level);
    let mut levels = Vec::new();
    let mut add = |level: &Level, written: AssetSplats, growth: f64| {
        levels.push(AssetLevel {
            name: level.name.clone(),
            file: written.file,
            splats: written.splats,
            bytes: written.bytes,
            sha256: written.sha256,
            growth,
        });
        progress.advance(1);
    };
    let file = |level: &Level| level.file(format.ending);
    let written: Result<(), ReconstructError> = match &drawable.whole {
        None => (names.zip(nested(&drawable.rows, &counts))).try_for_each(|(level, of_level)| {
            let written = write_splats(out, file(level), &of_level.rows)?;
            add(level, written, of_level.growth);
            Ok(())
        }),
        Some(all) => {
            let chosen = selections(all.positions.clone(), &counts);
            names.zip(chosen).try_for_each(|(level, selection)| {
                let gaussians = selection.gaussians(all);
                let written = write_whole(out, file(level), format, &gaussians)?;
                add(level, written, selection.growth);
                Ok(())
            })
        }
    };
    progress.end();
    written?;
    levels.reverse();
    Ok(levels)
}

fn write_whole(
    out: &Path,
    file: String,
    format: &SplatFormat,
    gaussians: &ActivatedGaussians,
) -> Result<AssetSplats, ReconstructError> {
    let path = out.join(&file);
    let bytes =
        (format.write)(gaussians).map_err(|reason| ReconstructError::scene(&path, reason))?;
    store::write_bytes(&path, &bytes)?;
    Ok(AssetSplats {
        file,
        splats: gaussians.len() as u64,
        bytes: bytes.len() as u64,
        sha256: store::sha256_bytes(&bytes),
    })
}

fn write_splats(
    out: &Path,
    file: String,
    rows: &[SplatRow],
) -> Result<AssetSplats, ReconstructError> {
    Ok(AssetSplats {
        sha256: splat::write(&out.join(&file), rows)?,
        file,
        splats: rows.len() as u64,
        bytes: (rows.len() * splat::ROW_BYTES) as u64,
    })
}

fn write_moments(
    out: &Path,
    moments: &Moments,
    progress: &dyn Progress,
) -> Result<AssetMoments, ReconstructError> {
    let still = write_splats(out, STILL_FILE.to_owned(), &moments.still)?;
    progress.begin("writing moments", Some(moments.moving.len() as u64));
    let write = |(number, (time_seconds, rows)): (usize, &(f64, Vec<SplatRow>))| {
        let moving = write_splats(out, moment_file(number), rows)?;
        progress.advance(1);
        Ok(AssetMoment {
            time_seconds: *time_seconds,
            moving,
        })
    };
    let written: Result<Vec<_>, ReconstructError> =
        moments.moving.iter().enumerate().map(write).collect();
    progress.end();
    Ok(AssetMoments {
        still,
        moments: written?,
    })
}

/// Writes the page with all moments of a dynamic scene, or with the largest level that fits inside.
fn write_page(
    out: &Path,
    asset: &Asset,
    libraries: &[Vec<u8>],
    notes: &mut Vec<String>,
) -> Result<AssetPage, ReconstructError> {
    let inside = inside(asset);
    if inside.is_none() {
        notes.push(format!(
            "the page has no Gaussians inside: no level has {MOST_SPLATS_INSIDE} or fewer; open one in it, \
             or `python3 -m http.server --bind 127.0.0.1 --directory {}`",
            out.display()
        ));
    }
    let mut bytes = Vec::new();
    for file in inside.iter().flat_map(EmbeddedData::files) {
        let path = out.join(file);
        let read = std::fs::read(&path).map_err(|error| store::StoreError::read(&path, error))?;
        bytes.extend(read);
    }
    let content = PageContent {
        title: asset.source.scene.as_deref().unwrap_or("Gaussians"),
        levels: &asset.levels,
        moments: asset.moments.as_ref(),
        placement: asset.placement,
        inside,
        bytes: &bytes,
    };
    let text = page::html(&content, libraries);
    store::write_bytes(&out.join(PAGE_FILE), text.as_bytes())?;
    Ok(AssetPage {
        file: PAGE_FILE.to_owned(),
        level: match inside {
            Some(EmbeddedData::Level(level)) => Some(level.name.clone()),
            _ => None,
        },
        holds_moments: matches!(inside, Some(EmbeddedData::Moments(_))),
        bytes: text.len() as u64,
    })
}

/// Returns the part of an asset in its page.
fn inside(asset: &Asset) -> Option<EmbeddedData<'_>> {
    let fits = |level: &&AssetLevel| level.splats <= MOST_SPLATS_INSIDE;
    let all_of = |moments: &AssetMoments| {
        let moving = moments.moments.iter().map(|moment| moment.moving.splats);
        moments.still.splats + moving.sum::<u64>()
    };
    let moments = asset.moments.as_ref();
    let moments = moments.filter(|moments| all_of(moments) <= MOST_SPLATS_OF_MOMENTS);
    moments.map(EmbeddedData::Moments).or_else(|| {
        asset
            .levels
            .iter()
            .rev()
            .find(fits)
            .map(EmbeddedData::Level)
    })
}
