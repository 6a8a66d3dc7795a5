//! A run's Gaussians, or those of a PLY, as levels of detail for web viewers, with a record and a page.
//!
//! * `viewer_limits`: what viewers can draw. [`levels`]: how many, which, how large. [`page`]: one HTML file
//!   with everything in it. [`serve`]: the same from a server on this machine, for levels that no page holds.

pub mod levels;
pub mod page;
pub mod serve;
mod viewer_limits;

use std::{
    path::{Path, PathBuf},
    time::Instant,
};

use glam::DVec3;
use omnilife_engine::gaussians::{
    ActivatedGaussians, parameterization::Viewpoint, temporal::TemporalFeatures,
};
use omnilife_schemas::{
    Similarity,
    layout::ASSET_FILE,
    lock::FolderLock,
    progress::Progress,
    records::{Asset, AssetLevel, AssetPage, AssetSource, RunRecord},
    stage::StagePlan,
    store,
};

use self::{
    levels::{Level, nested},
    page::{MOST_SPLATS_INSIDE, PageContent},
    viewer_limits::{Drawable, drawable},
};
use crate::{
    error::ReconstructError,
    formats::splat::{self, MOST_ROWS},
    jobs::{opened_gaussians::Source, reconstruct::RUN_FILE},
};

/// The page, in an asset's folder.
pub const PAGE_FILE: &str = "index.html";

/// What to export.
#[derive(Debug, Clone, PartialEq)]
pub struct ExportRequest {
    /// A run's folder, or a PLY.
    pub gaussians: PathBuf,
    /// Levels that are asked for.
    pub levels: Vec<Level>,
    /// Whether a page is asked for.
    pub with_page: bool,
    /// Up in the world; that of the run's cameras, or of a world with z up, where nothing is said.
    pub up: Option<[f64; 3]>,
    /// The moment that is shown of a scene that moves, seconds.
    pub time_seconds: f64,
    /// Folder of the asset.
    pub out: PathBuf,
}

/// An exported asset, and lines that its maker should know.
#[derive(Debug)]
pub struct Exported {
    /// The record.
    pub asset: Asset,
    /// What is not as it was asked for.
    pub notes: Vec<String>,
}

/// Exports.
///
/// # Errors
/// When the Gaussians cannot be read, no level is as small as the scene, a level has more Gaussians than
/// viewers can draw, or a file cannot be written or is somebody else's.
pub fn export(
    request: &ExportRequest,
    progress: &dyn Progress,
) -> Result<Exported, ReconstructError> {
    let begun = Instant::now();
    let (drawable, source) = drawable_of(request)?;
    let splats = drawable.rows.len() as u64;
    let Wanted {
        levels: wanted,
        left_out,
    } = levels_within(request, splats)?;
    let mut notes = left_out.clone();
    let libraries = match request.with_page.then(page::libraries) {
        None => None,
        Some(Ok(libraries)) => Some(libraries),
        Some(Err(missing)) => {
            notes.push(missing.to_string());
            None
        }
    };
    let _lock = FolderLock::take(&request.out, progress)?;
    let stage = StagePlan::new(&request.out, "export").with_text("source", &source.sha256);
    let mut outputs: Vec<String> = wanted.iter().map(|(level, _)| level.file()).collect();
    outputs.push(ASSET_FILE.to_owned());
    outputs.extend(libraries.iter().map(|_| PAGE_FILE.to_owned()));
    stage.claim(&outputs)?;
    // A record must not stand beside levels of another export.
    store::remove(&request.out.join(ASSET_FILE))?;
    stage
        .own_files()
        .remove(|file| !outputs.iter().any(|new| new == file))?;
    let levels = write_levels(&request.out, &drawable, &wanted, progress)?;
    let mut asset = Asset {
        source,
        splats,
        levels,
        left_out,
        placement: drawable.placement,
        changes: drawable.changes,
        page: None,
        wall_seconds: 0.0,
    };
    if let Some(libraries) = &libraries {
        asset.page = Some(write_page(&request.out, &asset, libraries, &mut notes)?);
    }
    asset.wall_seconds = begun.elapsed().as_secs_f64();
    store::write_record(&request.out.join(ASSET_FILE), &asset)?;
    stage.finish(&outputs, asset.wall_seconds)?;
    Ok(Exported { asset, notes })
}

/// What is exported, as files hold it.
fn drawable_of(request: &ExportRequest) -> Result<(Drawable, AssetSource), ReconstructError> {
    let as_they_are = Similarity {
        offset: [0.0; 3],
        scale: 1.0,
    };
    let source = Source::open(&request.gaussians, as_they_are)?;
    let mut model = source.model()?;
    let at = Viewpoint {
        seconds: request.time_seconds,
        shift_frames: 0.0,
        centre: glam::Vec3::ZERO,
        down: glam::Vec3::Y,
        scheduled: None,
    };
    let moves = model
        .parts
        .iter()
        .any(|part| part.parameterization.id() != "static");
    let mut gaussians = ActivatedGaussians::default();
    model.activate(&at, &TemporalFeatures::default(), &mut gaussians);
    drop(model);
    let record_path = request.gaussians.join(RUN_FILE);
    let record: Option<RunRecord> = request
        .gaussians
        .is_dir()
        .then(|| store::read_record(&record_path))
        .transpose()?;
    let up = up(request, record.as_ref())?;
    let normalization = &source.normalization;
    let drawable = drawable(
        &gaussians,
        up,
        DVec3::from_array(normalization.offset),
        1.0 / normalization.scale,
    );
    if drawable.rows.is_empty() {
        let reason = "has no Gaussian that a viewer could draw";
        return Err(ReconstructError::scene(&request.gaussians, reason));
    }
    let hashed = if record.is_some() {
        &record_path
    } else {
        &request.gaussians
    };
    let source = AssetSource {
        sha256: store::sha256_file(hashed)?,
        method: record.as_ref().map(|record| record.method.clone()),
        scene: record.map(|record| record.scene),
        time_seconds: moves.then_some(request.time_seconds),
    };
    Ok((drawable, source))
}

/// Up in the world.
fn up(request: &ExportRequest, record: Option<&RunRecord>) -> Result<DVec3, ReconstructError> {
    let given = request.up.or_else(|| record.and_then(|record| record.up));
    let up = DVec3::from_array(given.unwrap_or([0.0, 0.0, 1.0]));
    if up.is_finite() && up.length() > 1e-9 {
        return Ok(up);
    }
    Err(ReconstructError::Request {
        reason: format!("{up} is no direction up"),
    })
}

/// Which levels there will be.
struct Wanted {
    /// The smallest first, each with its number of Gaussians.
    levels: Vec<(Level, u64)>,
    /// Why others are not there.
    left_out: Vec<String>,
}

/// The levels that there are Gaussians for.
fn levels_within(request: &ExportRequest, splats: u64) -> Result<Wanted, ReconstructError> {
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
    wanted.dedup_by(|a, b| a.0.file() == b.0.file() || a.1 == b.1);
    let Some((level, count)) = wanted.last() else {
        return refuse(format!(
            "has {splats} Gaussians, fewer than every level that is asked for; ask for full"
        ));
    };
    if *count > MOST_ROWS {
        return refuse(format!(
            "level {} has {count} Gaussians, viewers draw {MOST_ROWS} at most; ask for a smaller one",
            level.name
        ));
    }
    Ok(Wanted {
        levels: wanted,
        left_out,
    })
}

fn write_levels(
    out: &Path,
    drawable: &Drawable,
    wanted: &[(Level, u64)],
    progress: &dyn Progress,
) -> Result<Vec<AssetLevel>, ReconstructError> {
    progress.begin("writing levels", Some(wanted.len() as u64));
    // The largest first: the smaller ones are part of it.
    let counts: Vec<u64> = wanted.iter().rev().map(|(_, count)| *count).collect();
    let rows = nested(&drawable.rows, &counts);
    let mut levels = Vec::new();
    let written = wanted
        .iter()
        .rev()
        .zip(rows)
        .try_for_each(|((level, _), of_level)| {
            let file = level.file();
            let path = out.join(&file);
            splat::write(&path, &of_level.rows)?;
            levels.push(AssetLevel {
                name: level.name.clone(),
                sha256: store::sha256_file(&path)?,
                file,
                splats: of_level.rows.len() as u64,
                bytes: (of_level.rows.len() * splat::ROW_BYTES) as u64,
                growth: of_level.growth,
            });
            progress.advance(1);
            Ok::<(), ReconstructError>(())
        });
    progress.end();
    written?;
    levels.reverse();
    Ok(levels)
}

/// The page with the largest level that fits inside.
fn write_page(
    out: &Path,
    asset: &Asset,
    libraries: &[Vec<u8>],
    notes: &mut Vec<String>,
) -> Result<AssetPage, ReconstructError> {
    let fits = |level: &&AssetLevel| level.splats <= MOST_SPLATS_INSIDE;
    let inside = asset.levels.iter().rev().find(fits);
    let bytes = inside
        .map(|level| {
            let path = out.join(&level.file);
            std::fs::read(&path).map_err(|error| store::StoreError::read(&path, error))
        })
        .transpose()?;
    if inside.is_none() {
        notes.push(format!(
            "the page has no Gaussians inside: no level has {MOST_SPLATS_INSIDE} or fewer; open one in it, \
             or `omnilife reconstruct serve {}`",
            out.display()
        ));
    }
    let content = PageContent {
        title: asset.source.scene.as_deref().unwrap_or("Gaussians"),
        levels: &asset.levels,
        placement: asset.placement,
        inside: inside
            .zip(bytes.as_deref())
            .map(|(level, bytes)| (level.name.as_str(), bytes)),
    };
    let text = page::html(&content, libraries);
    store::write_bytes(&out.join(PAGE_FILE), text.as_bytes())?;
    Ok(AssetPage {
        file: PAGE_FILE.to_owned(),
        level: inside.map(|level| level.name.clone()),
        bytes: text.len() as u64,
    })
}
