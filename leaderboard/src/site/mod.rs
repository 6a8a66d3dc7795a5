//! The static site: one folder that works from `file://` and offline.

mod chart;
mod comparisons;
mod dataset_page;
mod html_table;
mod index_page;
mod layout;
mod method_cards;
mod protocol;
mod published_page;
mod scene_page;

use std::{
    collections::{BTreeMap, BTreeSet},
    path::PathBuf,
};

use omnilife_schemas::{
    records::{Dataset, MethodCard, Protocol, ResultRecord},
    store,
};

use crate::{
    error::LeaderboardError,
    format::slug,
    group::{Group, SceneRow},
    outputs::Outputs,
    published::Paper,
};

/// Folder of the site.
const FOLDER: &str = "site";

/// Where to begin reading.
pub(crate) const FIRST_PAGE: &str = "site/index.html";

/// What the site is made of.
pub(crate) struct SiteRequest<'a> {
    pub(crate) groups: &'a [Group<'a>],
    /// All results with their files, beside which rendered views are.
    pub(crate) files: &'a [(PathBuf, ResultRecord)],
    pub(crate) papers: &'a [Paper],
    /// Protocols by hash, as far as they are known.
    pub(crate) protocols: &'a BTreeMap<String, Protocol>,
    /// Of the methods that others handed in.
    pub(crate) cards: &'a [MethodCard],
    pub(crate) dataset: Option<&'a Dataset>,
    /// Rendered views per scene and method, at most.
    pub(crate) views: usize,
}

/// Whether a path of the outputs is the site's.
pub(crate) fn is_of_site(path: &str) -> bool {
    path.starts_with("site/")
}

/// Adds all pages and what they show.
pub(crate) fn add(
    outputs: &mut Outputs,
    request: &SiteRequest<'_>,
) -> Result<(), LeaderboardError> {
    let mut page = |name: &str, markup: maud::Markup| {
        outputs.add(format!("{FOLDER}/{name}"), markup.into_string());
    };
    page("index.html", index_page::render(request)?);
    page("published.html", published_page::render(request)?);
    if let Some(dataset) = request.dataset {
        page("dataset.html", dataset_page::render(request, dataset)?);
    }
    let folders = result_folders(request.files);
    for (scene, rows) in scenes(request.groups) {
        let comparisons = comparisons::find(&rows, &folders, request.views)?;
        let name = scene_file(scene);
        let markup = scene_page::render(request, scene, &rows, &comparisons);
        outputs.add(format!("{FOLDER}/{name}"), markup.into_string());
        for picture in comparisons.pictures() {
            let target = format!("{FOLDER}/scenes/{}", picture.file);
            outputs.add_copy(target, picture.source.clone());
        }
    }
    outputs.add(format!("{FOLDER}/style.css"), include_str!("style.css"));
    outputs.add(format!("{FOLDER}/script.js"), include_str!("script.js"));
    Ok(())
}

/// Every result's folder. Results are told apart by their address: they are borrowed, not copied.
fn result_folders(files: &[(PathBuf, ResultRecord)]) -> BTreeMap<*const ResultRecord, PathBuf> {
    files
        .iter()
        .map(|(path, result)| {
            let folder = path.parent().map(std::path::Path::to_owned);
            (std::ptr::from_ref(result), folder.unwrap_or_default())
        })
        .collect()
}

/// Every scene with its rows under all protocols.
fn scenes<'a>(
    groups: &'a [Group<'a>],
) -> BTreeMap<&'a str, Vec<(&'a Group<'a>, &'a SceneRow<'a>)>> {
    let mut scenes: BTreeMap<&str, Vec<_>> = BTreeMap::new();
    for group in groups {
        for row in &group.scene_rows {
            scenes.entry(row.scene).or_default().push((group, row));
        }
    }
    scenes
}

/// A scene's page relative to the site. The hash keeps ids apart that read alike.
fn scene_file(scene: &str) -> String {
    format!("scenes/{}.html", unique_slug(scene))
}

/// A name for files that no other text has.
fn unique_slug(text: &str) -> String {
    let hash = store::sha256_bytes(text.as_bytes());
    format!("{}-{}", slug(text), &hash[..8])
}

/// All methods of all groups.
fn methods<'a>(groups: &'a [Group<'a>]) -> BTreeSet<&'a str> {
    groups
        .iter()
        .flat_map(|group| group.methods.iter().map(|method| method.method))
        .collect()
}
