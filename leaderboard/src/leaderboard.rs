//! The whole leaderboard of a folder of results: tables, site, and the table of a page.

use std::{
    path::{Path, PathBuf},
    sync::OnceLock,
};

use omnilife_schemas::{
    records::{Dataset, ResultRecord},
    store,
};

use crate::{
    collect::RecordFiles,
    description::MethodDescription,
    error::LeaderboardError,
    group, layouts,
    outputs::Outputs,
    published, questions, readme,
    site::{self, SiteFiles, SiteRequest},
    submission,
    table::Table,
    tables::{self, CSV_FILE, MARKDOWN_FILE},
};

/// Input and files of a leaderboard.
#[derive(Debug, Clone)]
pub struct LeaderboardRequest {
    /// Folder to search for `result.json` files.
    pub results: PathBuf,
    /// Folder of the leaderboard.
    pub out: PathBuf,
    /// `dataset.json` whose videos the site shows.
    pub dataset: Option<PathBuf>,
    /// Page whose table, between two marker lines, is replaced.
    pub page: Option<PathBuf>,
    /// True to make the site.
    pub site: bool,
    /// Maximum number of rendered views per scene and method that the site shows beside their ground truth.
    pub views: usize,
    /// Address of the project, an `https` or `http` URL that every page of the site links to.
    pub project: Option<String>,
    /// The program's own methods, for their pages.
    pub descriptions: Vec<MethodDescription>,
}

/// A leaderboard as built.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Leaderboard {
    /// The table of all results in Markdown.
    pub markdown: String,
    /// The same tables with the few columns that fit a terminal.
    pub short: String,
    /// Lines on missing values in the tables.
    pub notes: Vec<String>,
    /// The first page of the site, if made.
    pub site: Option<PathBuf>,
}

/// Builds tables in all layouts and the site. The same results give the same bytes.
///
/// # Errors
/// When there are no results, a record cannot be read, results contradict each other, or a file
/// cannot be written.
pub fn build_leaderboard(request: &LeaderboardRequest) -> Result<Leaderboard, LeaderboardError> {
    build_leaderboard_of(request, |_| true)
}

/// Builds tables and site as [`build_leaderboard`], from the results whose files `is_wanted` accepts.
///
/// # Errors
/// Those of [`build_leaderboard`].
pub fn build_leaderboard_of(
    request: &LeaderboardRequest,
    is_wanted: impl Fn(&Path) -> bool,
) -> Result<Leaderboard, LeaderboardError> {
    let files = RecordFiles::below(&request.results)?;
    let mut results = files.results()?;
    results.retain(|(file, _)| is_wanted(file));
    let prepared = prepare(request, &files, &results, request.site)?;
    store::create_folder(&request.out)?;
    prepared.outputs.write(&request.out)?;
    if let Some(page) = &request.page {
        readme::write(page, &prepared.groups)?;
    }
    Ok(Leaderboard {
        markdown: prepared.markdown,
        short: prepared.short,
        notes: prepared.notes,
        site: request.site.then(|| request.out.join(site::FIRST_PAGE)),
    })
}

/// Compares the tables, and that of the page, with those that the results give; writes nothing. The site is left out:
/// it has the same numbers and is not meant to be committed.
///
/// # Errors
/// Those of [`build_leaderboard`], and when a file is missing, differs or is left over.
pub fn check_leaderboard(request: &LeaderboardRequest) -> Result<(), LeaderboardError> {
    let files = RecordFiles::below(&request.results)?;
    let results = files.results()?;
    let prepared = prepare(request, &files, &results, false)?;
    prepared
        .outputs
        .check(&request.out, |path| !site::is_of_site(path))?;
    match &request.page {
        Some(page) => readme::check(page, &prepared.groups),
        None => Ok(()),
    }
}

struct PreparedTables<'a> {
    groups: Vec<group::Group<'a>>,
    outputs: Outputs,
    markdown: String,
    short: String,
    notes: Vec<String>,
}

fn prepare<'a>(
    request: &LeaderboardRequest,
    files: &RecordFiles,
    results: &'a [(PathBuf, ResultRecord)],
    with_site: bool,
) -> Result<PreparedTables<'a>, LeaderboardError> {
    let groups = group::groups(results)?;
    submission::check_means_of(results)?;
    let papers = published::papers()?;
    let assets = layouts::assets::tables(&files.assets()?, &papers);
    let facts = questions::scene_facts(request.dataset.as_deref())?;
    let mut values = Outputs::default();
    let notes = questions::add_tables(&mut values, results, &facts)?;
    let has_values = values.has(site::downloads::PARQUET_FILE);
    let ((all, layouts), site) = rayon::join(
        || {
            rayon::join(
                || tables::all_results(&groups, &request.out),
                || tables::in_all_layouts(layouts::LAYOUTS, &groups, &papers, &request.out),
            )
        },
        || match with_site {
            true => site_of(
                request, files, results, &groups, &papers, &assets, has_values,
            ),
            false => Ok(Outputs::default()),
        },
    );
    let all = all?;
    let mut outputs = layouts?;
    outputs.append(site?);
    outputs.add(MARKDOWN_FILE, all.markdown.clone());
    if with_site {
        outputs.add(site::file(CSV_FILE), all.csv.clone());
    }
    outputs.add(CSV_FILE, all.csv);
    tables::add_assets(&mut outputs, &assets, &request.out)?;
    outputs.append(values);
    if with_site {
        site::downloads::add(&mut outputs, &groups, &papers);
    }
    Ok(PreparedTables {
        groups,
        outputs,
        markdown: all.markdown,
        short: all.short,
        notes,
    })
}

/// Returns all pages.
fn site_of(
    request: &LeaderboardRequest,
    files: &RecordFiles,
    results: &[(PathBuf, ResultRecord)],
    groups: &[group::Group<'_>],
    papers: &[published::Paper],
    assets: &[Table],
    has_values: bool,
) -> Result<Outputs, LeaderboardError> {
    let protocols = files.protocols(results)?;
    let cards = files.cards()?;
    let verifications = files.verifications()?;
    let dataset = request
        .dataset
        .as_deref()
        .map(|file: &Path| store::read_record::<Dataset>(file))
        .transpose()?;
    let dataset = request.dataset.as_deref().zip(dataset.as_ref());
    let surroundings = SiteFiles::of(results, &request.results, &request.out, dataset)?;
    let mut outputs = Outputs::default();
    site::add(
        &mut outputs,
        &SiteRequest {
            groups,
            surroundings: &surroundings,
            papers,
            assets,
            protocols: &protocols,
            cards: &cards,
            verifications: &verifications,
            dataset: dataset.map(|(_, dataset)| dataset),
            views: request.views,
            project: request.project.as_deref(),
            descriptions: &request.descriptions,
            has_values,
            footer: OnceLock::new(),
        },
    )?;
    Ok(outputs)
}
