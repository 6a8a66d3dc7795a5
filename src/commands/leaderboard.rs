//! `omnilife leaderboard`.

use omnilife_leaderboard::{
    AnswerFormat, DatasetsFormat, LeaderboardRequest, QueryRequest, RESULTS, build_leaderboard,
    check_leaderboard, datasets,
    figure::{FigureRequest, GalleryRequest, figure, gallery},
    query, render, results_table,
};
use omnilife_schemas::{lock::FolderLock, plain_text::counted, progress::Progress, store};

use super::{method_list, submission};
use crate::{
    cli::{
        AnswerFormatArgument, DatasetsArguments, FigureArguments, GalleryArguments,
        LeaderboardBuildArguments, LeaderboardCommand, QueryArguments,
    },
    exit,
};

pub(crate) fn execute(command: &LeaderboardCommand, progress: &dyn Progress) -> anyhow::Result<()> {
    match command {
        LeaderboardCommand::Build(arguments) => build(arguments, progress),
        LeaderboardCommand::Query(arguments) => answer(arguments, progress),
        LeaderboardCommand::Datasets(arguments) => list_datasets(arguments),
        LeaderboardCommand::Figure(arguments) => draw(arguments),
        LeaderboardCommand::Gallery(arguments) => draw_gallery(arguments),
        LeaderboardCommand::Submit(arguments) => submission::submit(arguments, progress),
        LeaderboardCommand::Add(arguments) => submission::add(arguments, progress),
    }
}

fn build(arguments: &LeaderboardBuildArguments, progress: &dyn Progress) -> anyhow::Result<()> {
    let request = LeaderboardRequest {
        results: arguments.results.clone(),
        out: arguments.out.clone(),
        dataset: arguments.dataset.clone(),
        page: arguments.page.clone(),
        site: !arguments.no_site,
        views: arguments.views,
        project: arguments.project.clone(),
        descriptions: method_list::descriptions(),
    };
    if arguments.check {
        check_leaderboard(&request)?;
        return exit::print("The tables are what the results give.\n");
    }
    // Read first, so that the output cannot be taken for it.
    store::names_in(&request.results)?;
    let _lock = FolderLock::take(&request.out, progress)?;
    let built = build_leaderboard(&request)?;
    for note in &built.notes {
        progress.note(note);
    }
    let site = built
        .site
        .map_or_else(String::new, |page| format!("\nSite: {}\n", page.display()));
    let table = exit::for_reader(&built.short, &built.markdown);
    exit::print(&format!("{table}{site}"))
}

fn answer(arguments: &QueryArguments, progress: &dyn Progress) -> anyhow::Result<()> {
    let answer = query(&QueryRequest {
        results: arguments.results.clone(),
        dataset: arguments.dataset.clone(),
        table: results_table(&arguments.table).unwrap_or(&RESULTS),
        by: arguments.by.clone(),
        metrics: arguments.metrics.clone(),
        conditions: arguments.conditions.clone(),
    })?;
    for note in &answer.notes {
        progress.note(note);
    }
    let format = match arguments.format {
        AnswerFormatArgument::Table => AnswerFormat::Table,
        AnswerFormatArgument::Csv => AnswerFormat::Csv,
        AnswerFormatArgument::Json => AnswerFormat::Json,
        AnswerFormatArgument::Parquet => AnswerFormat::Parquet,
    };
    let bytes = render(&answer, format)?;
    match &arguments.out {
        Some(file) => Ok(store::write_bytes(file, &bytes)?),
        None if format == AnswerFormat::Table => exit::print(&String::from_utf8_lossy(&bytes)),
        None => exit::print_data(&bytes),
    }
}

fn list_datasets(arguments: &DatasetsArguments) -> anyhow::Result<()> {
    let format = arguments.format.into();
    let table = datasets(&arguments.datasets, format)?;
    match format {
        DatasetsFormat::Table => exit::print(&String::from_utf8_lossy(&table)),
        DatasetsFormat::Csv | DatasetsFormat::Markdown | DatasetsFormat::Latex => {
            exit::print_data(&table)
        }
    }
}

fn draw(arguments: &FigureArguments) -> anyhow::Result<()> {
    let drawn = figure(&FigureRequest {
        results: arguments.results.clone(),
        out: arguments.out.clone(),
        protocol: arguments.protocol.clone(),
        scenes: arguments.scenes.clone(),
        methods: arguments.methods.clone(),
        frame: arguments.frame,
        inset: arguments.inset,
        panel_width: usize::from(arguments.panel_width),
    })?;
    let rows = drawn
        .rows
        .iter()
        .map(|(scene, frame)| format!("{scene} (frame {frame})"));
    exit::print(&format!(
        "{}\n{}\nRows: {}\nColumns: {}\n",
        drawn.png.display(),
        drawn.svg.display(),
        rows.collect::<Vec<_>>().join(", "),
        drawn.columns.join(", ")
    ))
}

fn draw_gallery(arguments: &GalleryArguments) -> anyhow::Result<()> {
    let drawn = gallery(&GalleryRequest {
        dataset: arguments.dataset.clone(),
        out: arguments.out.clone(),
        sequences: arguments.sequences.clone(),
        most: usize::from(arguments.most),
        columns: usize::from(arguments.columns),
        panel_width: usize::from(arguments.panel_width),
    })?;
    exit::print(&format!(
        "{}\n{}\n{} of {}: {}\n",
        drawn.png.display(),
        drawn.svg.display(),
        drawn.sequences.len(),
        counted(drawn.of, "sequence"),
        drawn.sequences.join(", ")
    ))
}
