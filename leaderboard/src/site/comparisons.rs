//! Rendered views beside their ground truth, in the comparison images of scoring.

use std::{
    collections::{BTreeMap, BTreeSet},
    fs::File,
    io::Read,
    path::{Path, PathBuf},
};

use omnilife_schemas::{
    records::ResultRecord,
    store::{self, StoreError},
};

use super::{SiteRequest, unique_slug};
use crate::group::{Group, SceneRow};

/// Folder of the images beside a result: prediction left, ground truth right.
pub(crate) const COMPARISONS: &str = "comparisons";

/// A score that exists only for views of the whole sphere.
const SPHERE_SCORE: &str = "ws-psnr";

/// Width of the line between the two halves in pixels.
pub(crate) const SEPARATOR: u32 = 4;

/// An image of one view by one method.
pub(super) struct ComparisonImage {
    pub(super) method: String,
    pub(super) protocol_hash: String,
    /// `novel view 4`.
    pub(super) view: String,
    /// Relative to the folder of scene pages.
    pub(super) file: String,
    pub(super) source: PathBuf,
    /// Width and height of one half in pixels.
    pub(super) half: [u32; 2],
    /// True if it shows the whole sphere; false for scenes of perspective images.
    pub(super) is_sphere: bool,
}

impl ComparisonImage {
    /// Returns the width of the whole image over that of one half.
    pub(super) fn width_ratio(&self) -> f64 {
        f64::from(2 * self.half[0] + SEPARATOR) / f64::from(self.half[0])
    }

    /// Returns the offset of the second half from the left edge of the first, in widths of a half.
    pub(super) fn truth_offset(&self) -> f64 {
        f64::from(self.half[0] + SEPARATOR) / f64::from(self.half[0])
    }
}

/// The images of one scene, and the omissions.
#[derive(Default)]
pub(super) struct Comparisons {
    pub(super) by_view: BTreeMap<String, Vec<ComparisonImage>>,
    /// Views that have images, by protocol's hash.
    pub(super) views: BTreeMap<String, usize>,
    /// Files that are not such images, with the reason.
    pub(super) left_out: Vec<String>,
}

impl Comparisons {
    pub(super) fn images(&self) -> impl Iterator<Item = &ComparisonImage> {
        self.by_view.values().flatten()
    }
}

/// Finds the images of a scene's results: at most `most` views of every protocol, evenly spaced, novel views before
/// input views, and for each method the first seed.
pub(super) fn find(
    rows: &[(&Group<'_>, &SceneRow<'_>)],
    request: &SiteRequest<'_>,
    most: usize,
) -> Result<Comparisons, StoreError> {
    let mut all: BTreeMap<String, Vec<ComparisonImage>> = BTreeMap::new();
    // Protocols split a scene differently: each has views of its own.
    let mut by_protocol: BTreeMap<String, BTreeSet<String>> = BTreeMap::new();
    let mut left_out = Vec::new();
    for (group, row) in rows {
        let result = row.results[0];
        let folder = request.folder(result);
        // Views of a failed run are not shown beside those of others.
        let Some(folder) = folder.filter(|_| result.run_failure.is_none()) else {
            continue;
        };
        for source in images_in(&folder.join(COMPARISONS))? {
            let name = source
                .file_stem()
                .unwrap_or_default()
                .to_string_lossy()
                .into_owned();
            if let Err(reason) = check_size(&source, result.scored_size)? {
                left_out.push(format!("{}, {name}: {reason}", row.method));
                continue;
            }
            let identity = format!("{}\n{}\n{}", row.scene, row.method, group.protocol_hash);
            let of_protocol = by_protocol
                .entry(group.protocol_hash.to_owned())
                .or_default();
            of_protocol.insert(name.clone());
            all.entry(name.clone()).or_default().push(ComparisonImage {
                method: row.method.to_owned(),
                protocol_hash: group.protocol_hash.to_owned(),
                view: view_title(&name),
                file: format!(
                    "{}/{}-{name}.png",
                    unique_slug(row.scene),
                    unique_slug(&identity)
                ),
                source,
                half: result.scored_size,
                is_sphere: is_sphere(result),
            });
        }
    }
    let shown: BTreeMap<&str, Vec<String>> = (by_protocol.iter())
        .map(|(protocol, names)| (protocol.as_str(), spread(names, most)))
        .collect();
    for (name, images) in &mut all {
        images.retain(|image| shown[image.protocol_hash.as_str()].contains(name));
    }
    all.retain(|_, images| !images.is_empty());
    let views = (by_protocol.iter())
        .map(|(protocol, names)| (protocol.clone(), names.len()))
        .collect();
    Ok(Comparisons {
        by_view: all,
        views,
        left_out,
    })
}

/// Returns at most `most` views of a protocol: novel views if there are any, evenly spaced.
fn spread(all: &BTreeSet<String>, most: usize) -> Vec<String> {
    let novel: Vec<&String> = all
        .iter()
        .filter(|name| name.starts_with("novel-"))
        .collect();
    let names: Vec<&String> = if novel.is_empty() {
        all.iter().collect()
    } else {
        novel
    };
    let count = names.len().min(most);
    (0..count)
        .map(|index| names[index * names.len() / count].clone())
        .collect()
}

/// Returns true if views are whole spheres: twice as wide as high, with no score refused that needs a sphere.
fn is_sphere(result: &ResultRecord) -> bool {
    let [width, height] = result.scored_size;
    let mut unavailable = result.unavailable.iter();
    width == 2 * height && !unavailable.any(|score| score.metric == SPHERE_SCORE)
}

/// Returns the title of a view: `novel-000004` is novel view 4.
fn view_title(name: &str) -> String {
    let parts = name.split_once('-');
    let frame = parts.and_then(|(kind, digits)| Some((kind, digits.parse::<u32>().ok()?)));
    frame.map_or_else(
        || name.to_owned(),
        |(kind, frame)| format!("{kind} view {frame}"),
    )
}

/// Returns PNG files of a folder, sorted; none if the folder is missing.
fn images_in(folder: &Path) -> Result<Vec<PathBuf>, StoreError> {
    if !folder.is_dir() {
        return Ok(Vec::new());
    }
    let mut images = store::paths_in(folder)?;
    images.retain(|path| {
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        let is_comparison = ["novel-", "input-"]
            .iter()
            .any(|kind| name.starts_with(kind));
        is_comparison && name.ends_with(".png")
    });
    Ok(images)
}

/// Checks that a file is a PNG as wide as two halves and the line between them (PNG specification, sections 5.2 and
/// 11.2.1: signature, then the header chunk with width and height).
pub(crate) fn check_size(path: &Path, half: [u32; 2]) -> Result<Result<(), String>, StoreError> {
    let failed = |source| StoreError::read(path, source);
    let mut head = Vec::with_capacity(24);
    File::open(path)
        .map_err(failed)?
        .take(24)
        .read_to_end(&mut head)
        .map_err(failed)?;
    let number = |at: usize| {
        let bytes = head.get(at..at + 4)?.try_into().ok()?;
        Some(u32::from_be_bytes(bytes))
    };
    let is_png = head.starts_with(b"\x89PNG\r\n\x1a\n") && head.get(12..16) == Some(b"IHDR");
    let (Some(width), Some(height), true) = (number(16), number(20), is_png) else {
        return Ok(Err("is not a PNG image".to_owned()));
    };
    let wide = 2 * u64::from(half[0]) + u64::from(SEPARATOR);
    let expected = [wide, u64::from(half[1])];
    Ok(if [width, height].map(u64::from) == expected {
        Ok(())
    } else {
        let [wide, high] = expected;
        Err(format!(
            "has {width}x{height} pixels instead of {wide}x{high}"
        ))
    })
}
