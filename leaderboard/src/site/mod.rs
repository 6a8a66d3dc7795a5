//! The static site: one folder that works from `file://` and offline.

mod chart;
pub(crate) mod comparisons;
mod dataset_page;
pub(crate) mod downloads;
mod html_table;
mod index_page;
mod layout;
mod links;
mod mean_curve;
mod method_cards;
mod method_facts;
mod method_page;
mod panorama;
mod protocol;
mod run_time;
mod scene_cards;
mod scene_page;
mod standings;

use std::{
    collections::{BTreeMap, BTreeSet, HashMap},
    path::{Path, PathBuf},
    sync::OnceLock,
};

use rayon::prelude::*;

use omnilife_results::{CurvePoint, SceneFacts};
use omnilife_schemas::{
    layout::SCORING_FILE,
    records::{Dataset, MethodCard, Protocol, ResultRecord, ScoringRecord, Verification},
    store,
};

use comparisons::Comparisons;
use links::Links;
pub use links::is_web_address;

use crate::{
    description::MethodDescription,
    error::LeaderboardError,
    format::slug,
    group::{Group, SceneRow},
    outputs::Outputs,
    published::Paper,
    table::Table,
};

/// Folder of the site.
const FOLDER: &str = "site";

/// First page.
pub(crate) const FIRST_PAGE: &str = "site/index.html";

/// Comparisons by scene.
type SceneViews = BTreeMap<String, Comparisons>;

/// Files beside the results.
pub(crate) struct SiteFiles {
    /// Results are keyed by their address: they are borrowed, not copied.
    results: HashMap<usize, SideFiles>,
    /// Scoring time of the newest result, if recorded.
    newest: Option<String>,
    facts: BTreeMap<String, SceneFacts>,
}

/// Files beside a result.
struct SideFiles {
    folder: PathBuf,
    curve: Vec<CurvePoint>,
    /// Texts and addresses of its files, from a page in a folder of the site.
    links: Vec<(&'static str, String)>,
    /// Scoring time, if recorded.
    scored_at: Option<String>,
}

impl SiteFiles {
    /// Reads the files beside all results. The site goes into `out`.
    ///
    /// # Errors
    /// When a curve, or a record beside the dataset's, is broken.
    pub(crate) fn of(
        files: &[(PathBuf, ResultRecord)],
        results: &Path,
        out: &Path,
        dataset: Option<(&Path, &Dataset)>,
    ) -> Result<Self, LeaderboardError> {
        let links = Links::between(results, &out.join(FOLDER));
        let read: Vec<_> = (files.par_iter())
            .map(|(path, result)| {
                let folder = path.parent().unwrap_or(Path::new("")).to_owned();
                Ok(SideFiles {
                    curve: omnilife_results::read_curve(&folder, result)?,
                    links: links.of_result(&folder, result),
                    scored_at: scored_at(&folder)?,
                    folder,
                })
            })
            .collect();
        let mut found = HashMap::new();
        let mut newest = None;
        // In the order of the files, so that the named broken one is always the first.
        for ((_, result), read) in files.iter().zip(read) {
            let read: Result<SideFiles, LeaderboardError> = read;
            let beside = read?;
            newest = newest.max(beside.scored_at.clone());
            found.insert(address(result), beside);
        }
        Ok(Self {
            results: found,
            newest,
            facts: dataset.map_or_else(
                || Ok(BTreeMap::new()),
                |(file, dataset)| omnilife_results::read_scene_facts(file, dataset),
            )?,
        })
    }
}

/// Input of the site.
pub(crate) struct SiteRequest<'a> {
    pub(crate) groups: &'a [Group<'a>],
    pub(crate) surroundings: &'a SiteFiles,
    pub(crate) papers: &'a [Paper],
    /// Tables of assets.
    pub(crate) assets: &'a [Table],
    /// Known protocols by hash.
    pub(crate) protocols: &'a BTreeMap<String, Protocol>,
    /// Cards of submitted methods.
    pub(crate) cards: &'a [MethodCard],
    /// Counts of their verified results, by method.
    pub(crate) verifications: &'a BTreeMap<String, Verification>,
    pub(crate) dataset: Option<&'a Dataset>,
    /// Maximum number of rendered views per scene and method.
    pub(crate) views: usize,
    /// Address of the project.
    pub(crate) project: Option<&'a str>,
    /// The program's own methods.
    pub(crate) descriptions: &'a [MethodDescription],
    /// True if there is a Parquet table of the results: at least one run must have succeeded.
    pub(crate) has_values: bool,
    /// The footer of all pages, made by the first one: it examines every result.
    pub(crate) footer: OnceLock<String>,
}

/// Returns the path of a file beside the first page.
pub(crate) fn file(name: &str) -> String {
    format!("{FOLDER}/{name}")
}

/// Returns true if a path of the outputs belongs to the site.
pub(crate) fn is_of_site(path: &str) -> bool {
    path.starts_with("site/")
}

/// Adds all pages and their images.
pub(crate) fn add(
    outputs: &mut Outputs,
    request: &SiteRequest<'_>,
) -> Result<(), LeaderboardError> {
    let scenes: Vec<_> = scenes(request.groups).into_iter().collect();
    let views: Vec<Result<(String, Comparisons), LeaderboardError>> = (scenes.par_iter())
        .map(|(scene, rows)| {
            let found = comparisons::find(rows, request, request.views)?;
            Ok(((*scene).to_owned(), found))
        })
        .collect();
    // In the order of the scenes, so that the named broken one is always the first.
    let views = views.into_iter().collect::<Result<SceneViews, _>>()?;
    let mut page = |name: String, markup: maud::Markup| {
        outputs.add(format!("{FOLDER}/{name}"), markup.into_string());
    };
    page(
        "index.html".to_owned(),
        index_page::render(request, &views)?,
    );
    if let Some(dataset) = request.dataset {
        let markup = dataset_page::render(request, dataset)?;
        page("dataset.html".to_owned(), markup);
    }
    let pages: Vec<_> = (scenes.par_iter())
        .map(|(scene, rows)| scene_page::render(request, scene, rows, &views[*scene]))
        .collect();
    for ((scene, _), markup) in scenes.iter().zip(pages) {
        page(scene_file(scene), markup?);
    }
    let methods: Vec<&str> = methods(request.groups).into_iter().collect();
    let pages: Vec<_> = (methods.par_iter())
        .map(|method| method_page::render(request, method, &views))
        .collect();
    for (method, markup) in methods.iter().zip(pages) {
        page(method_page::file(method), markup?);
    }
    for image in views.values().flat_map(Comparisons::images) {
        let target = format!("{FOLDER}/scenes/{}", image.file);
        outputs.add_copy(target, image.source.clone());
    }
    let script = concat!(include_str!("script.js"), "\n", include_str!("panorama.js"));
    outputs.add(format!("{FOLDER}/style.css"), include_str!("style.css"));
    outputs.add(format!("{FOLDER}/script.js"), script);
    Ok(())
}

impl SiteRequest<'_> {
    fn beside(&self, result: &ResultRecord) -> Option<&SideFiles> {
        self.surroundings.results.get(&address(result))
    }

    /// Returns the folder of a result.
    fn folder(&self, result: &ResultRecord) -> Option<&Path> {
        self.beside(result).map(|beside| beside.folder.as_path())
    }

    /// Returns error against run time of a result; empty if its run left none.
    fn curve(&self, result: &ResultRecord) -> &[CurvePoint] {
        self.beside(result).map_or(&[], |beside| &beside.curve)
    }

    /// Texts and addresses of the files of a result and its run, from a page in a folder.
    fn links(&self, result: &ResultRecord) -> Vec<(&'static str, String)> {
        self.beside(result)
            .map_or_else(Vec::new, |beside| beside.links.clone())
    }
}

/// Returns the scoring time of the result in a folder, if its record exists and states it.
fn scored_at(folder: &Path) -> Result<Option<String>, LeaderboardError> {
    let file = folder.join(SCORING_FILE);
    if !file.is_file() {
        return Ok(None);
    }
    Ok(store::read_record::<ScoringRecord>(&file)?.scored_at)
}

/// Returns the key that distinguishes results.
fn address(result: &ResultRecord) -> usize {
    std::ptr::from_ref(result).addr()
}

/// Returns every scene with its rows under all protocols.
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

/// Returns a scene's page relative to the site. The hash distinguishes similar ids.
fn scene_file(scene: &str) -> String {
    format!("scenes/{}.html", unique_slug(scene))
}

/// Returns a file name that is unique to a text.
fn unique_slug(text: &str) -> String {
    let hash = store::sha256_bytes(text.as_bytes());
    format!("{}-{}", slug(text), &hash[..8])
}

/// Returns all methods of all groups.
fn methods<'a>(groups: &'a [Group<'a>]) -> BTreeSet<&'a str> {
    groups
        .iter()
        .flat_map(|group| group.methods.iter().map(|method| method.method))
        .collect()
}
