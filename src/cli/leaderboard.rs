//! `omnilife leaderboard`.

use std::path::PathBuf;

use clap::{Args, Subcommand, ValueEnum, builder::PossibleValuesParser};
use omnilife_leaderboard::{DatasetsFormat, RESULTS, TABLES, is_web_address};

use super::numbers;

#[derive(Debug, Subcommand)]
pub(crate) enum LeaderboardCommand {
    /// Makes tables and a static site from all results in a folder.
    ///
    /// OUT/table.md and table.csv hold all results; OUT/tables/ the layouts of the paper (Markdown, LaTeX,
    /// CSV), one folder per protocol; OUT/site/index.html opens without a network.
    Build(LeaderboardBuildArguments),
    /// Answers a question of all results in a folder: means by any columns.
    ///
    /// Scores of different protocols, methods, kinds of view, regions or metrics are never averaged. Views of
    /// a result weigh the same, then repetitions on a scene, then scenes; incomplete results are left out.
    Query(QueryArguments),
    /// Prints a table of datasets, one's own beside those of Table 1 of OmniLife360.
    ///
    /// Own rows come from the records and annotations of `curate`; an unknown value is shown as unknown, and
    /// is empty in CSV.
    Datasets(DatasetsArguments),
    /// Draws rendered views of several methods beside the ground truth, for a paper.
    ///
    /// Rows are scenes, columns the ground truth and the methods by rank; below each image a part of it
    /// enlarged and its error, four times as bright. OUT.png holds the pixels, OUT.svg the names as well.
    Figure(FigureArguments),
    /// Draws a gallery of a dataset, for a paper: a frame of every kind of sequence, below it the dynamic region.
    ///
    /// One sequence of every group, category and class of ego-motion that the annotations name, then a
    /// second one; dynamic regions are coloured. OUT.png holds the pixels, OUT.svg the names as well.
    Gallery(GalleryArguments),
    /// Packs a method's results, predictions and card into a submission.
    Submit(SubmitResultsArguments),
    /// Checks a submission, scores a sample of it again, and adds it to the results.
    Add(AddArguments),
}

#[derive(Debug, Args)]
pub(crate) struct QueryArguments {
    /// Folder that is searched for result.json files.
    pub(crate) results: PathBuf,
    /// Asks the means of results, the scores of every view, or the scores along trainings.
    #[arg(long, default_value = RESULTS.name, value_name = "TABLE",
        value_parser = PossibleValuesParser::new(TABLES.map(|table| table.name)))]
    pub(crate) table: String,
    /// Gives a row for every value of these columns, such as video, scene, category, ego-motion or third;
    /// numbers in steps with distance-to-given:0.5. A wrong name lists all columns of the table.
    #[arg(long, value_name = "COLUMN", value_delimiter = ',')]
    pub(crate) by: Vec<String>,
    /// Averages these metrics; the first one orders methods.
    #[arg(
        long = "metric",
        value_name = "METRIC",
        value_delimiter = ',',
        default_value = "psnr"
    )]
    pub(crate) metrics: Vec<String>,
    /// Takes only rows that meet a condition: COLUMN=VALUE or COLUMN!=VALUE (several values between commas),
    /// COLUMN<NUMBER, also <=, > and >=; may be repeated, and all must hold.
    #[arg(long = "where", value_name = "CONDITION")]
    pub(crate) conditions: Vec<String>,
    /// Adds the columns of the annotations of this dataset.json.
    #[arg(long, value_name = "FILE")]
    pub(crate) dataset: Option<PathBuf>,
    /// Prints a table to read, or the same in another format.
    #[arg(long, value_enum, default_value_t = AnswerFormatArgument::Table)]
    pub(crate) format: AnswerFormatArgument,
    /// Writes the answer to this file instead of printing it.
    #[arg(long, value_name = "FILE", required_if_eq("format", "parquet"))]
    pub(crate) out: Option<PathBuf>,
}

/// The formats of answers.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(crate) enum AnswerFormatArgument {
    Table,
    Csv,
    Json,
    Parquet,
}

#[derive(Debug, Args)]
pub(crate) struct DatasetsArguments {
    /// Folders of datasets, or their dataset.json.
    #[arg(required = true, value_name = "DATASET")]
    pub(crate) datasets: Vec<PathBuf>,
    /// Prints a table to read, or the same in another format.
    #[arg(long, value_enum, default_value_t = DatasetsFormatArgument::Table)]
    pub(crate) format: DatasetsFormatArgument,
}

/// The formats of the table of datasets.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(crate) enum DatasetsFormatArgument {
    Table,
    Csv,
    Markdown,
    Latex,
}

impl From<DatasetsFormatArgument> for DatasetsFormat {
    fn from(argument: DatasetsFormatArgument) -> Self {
        match argument {
            DatasetsFormatArgument::Table => Self::Table,
            DatasetsFormatArgument::Csv => Self::Csv,
            DatasetsFormatArgument::Markdown => Self::Markdown,
            DatasetsFormatArgument::Latex => Self::Latex,
        }
    }
}

#[derive(Debug, Args)]
pub(crate) struct FigureArguments {
    /// Folder that is searched for results, beside which scoring left its views.
    pub(crate) results: PathBuf,
    /// Path of the figure, to which .png and .svg are added.
    #[arg(long)]
    pub(crate) out: PathBuf,
    /// Scenes, one per row [default: all scenes of which every method has views].
    #[arg(long, value_name = "SCENE", value_delimiter = ',')]
    pub(crate) scenes: Vec<String>,
    /// Methods, one per column after the ground truth [default: all methods by rank].
    #[arg(long, value_name = "METHOD", value_delimiter = ',')]
    pub(crate) methods: Vec<String>,
    /// Protocol of the results [default: the first one].
    #[arg(long, value_name = "PROTOCOL")]
    pub(crate) protocol: Option<String>,
    /// Shows the novel view with this frame number [default: the first one that the methods share].
    #[arg(long, value_name = "FRAME", value_parser = numbers::whole::<u32>)]
    pub(crate) frame: Option<u32>,
    /// Enlarges this part of the image, as shares of its width: left edge, upper edge, width; the height is
    /// half the width [default: where the methods differ most].
    #[arg(long, value_name = "LEFT,TOP,WIDTH", value_parser = inset)]
    pub(crate) inset: Option<[f64; 3]>,
    /// Width of an image in the figure in pixels.
    #[arg(long, default_value_t = 512, value_name = "PIXELS",
        value_parser = numbers::between::<u16, 64, 4_096>)]
    pub(crate) panel_width: u16,
}

#[derive(Debug, Args)]
pub(crate) struct GalleryArguments {
    /// Folder of a dataset, or its dataset.json.
    pub(crate) dataset: PathBuf,
    /// Path of the figure, to which .png and .svg are added.
    #[arg(long)]
    pub(crate) out: PathBuf,
    /// Sequences to show [default: as many kinds as there are].
    #[arg(long, value_name = "SEQUENCE", value_delimiter = ',')]
    pub(crate) sequences: Vec<String>,
    /// Shows at most this many sequences, without --sequences.
    #[arg(long, default_value_t = 12, value_name = "N",
        value_parser = numbers::between::<u16, 1, 400>)]
    pub(crate) most: u16,
    /// Number of sequences in a row.
    #[arg(long, default_value_t = 4, value_name = "N",
        value_parser = numbers::between::<u16, 1, 40>)]
    pub(crate) columns: u16,
    /// Width of an image in the figure in pixels.
    #[arg(long, default_value_t = 384, value_name = "PIXELS",
        value_parser = numbers::between::<u16, 64, 4_096>)]
    pub(crate) panel_width: u16,
}

fn web_address(text: &str) -> Result<String, String> {
    if is_web_address(text) {
        Ok(text.to_owned())
    } else {
        Err("must be an address that begins with https:// or http://".to_owned())
    }
}

/// `0.25,0.1,0.2`.
fn inset(text: &str) -> Result<[f64; 3], String> {
    let numbers: Option<Vec<f64>> = text
        .split(',')
        .map(|part| part.trim().parse().ok())
        .collect();
    let shares = numbers.and_then(|numbers| <[f64; 3]>::try_from(numbers).ok());
    shares
        .filter(|shares| shares.iter().all(|share| (0.0..=1.0).contains(share)) && shares[2] > 0.0)
        .ok_or_else(|| "expected three shares from 0 to 1, such as 0.25,0.1,0.2".to_owned())
}

#[derive(Debug, Args)]
pub(crate) struct SubmitResultsArguments {
    /// Folder that is searched for results of the card's method.
    pub(crate) results: PathBuf,
    /// The card, TOML: method, title, authors, hardware; code, licence, training (per-scene or
    /// without-training), iterations and notes where there are any.
    #[arg(long, value_name = "FILE")]
    pub(crate) card: PathBuf,
    /// Folder of the submission.
    #[arg(long)]
    pub(crate) out: PathBuf,
    /// Packs results with views that could not be scored, and those without some metrics, too: they are rows
    /// that are not ranked.
    #[arg(long)]
    pub(crate) with_failures: bool,
}

#[derive(Debug, Args)]
pub(crate) struct AddArguments {
    /// Folder of the submission.
    pub(crate) submission: PathBuf,
    /// Folder of results that it is added to.
    #[arg(long)]
    pub(crate) results: PathBuf,
    /// Scores the predictions of this many results again, and refuses the submission where a score differs.
    #[arg(long, default_value_t = 0, value_name = "N", value_parser = numbers::whole::<usize>)]
    pub(crate) audit: usize,
    /// Folder that is searched for the scenes, for --audit.
    #[arg(long, value_name = "FOLDER")]
    pub(crate) scenes: Option<PathBuf>,
    /// Seed of the sample of --audit [default: another one every time].
    #[arg(long, value_name = "SEED", value_parser = numbers::whole::<u64>)]
    pub(crate) audit_seed: Option<u64>,
}

#[derive(Debug, Args)]
pub(crate) struct LeaderboardBuildArguments {
    /// Folder that is searched for result.json files, and for split.json files that explain their
    /// protocols.
    pub(crate) results: PathBuf,
    /// Folder of the tables and of the site.
    #[arg(long)]
    pub(crate) out: PathBuf,
    /// A dataset.json whose videos the site shows.
    #[arg(long, value_name = "FILE")]
    pub(crate) dataset: Option<PathBuf>,
    /// A Markdown page whose table, between the lines `<!-- leaderboard: begin -->` and
    /// `<!-- leaderboard: end -->`, is replaced.
    #[arg(long, value_name = "FILE")]
    pub(crate) page: Option<PathBuf>,
    /// Rendered views per scene and method that the site shows, at most.
    #[arg(long, default_value_t = 4, value_name = "N", value_parser = numbers::whole::<usize>)]
    pub(crate) views: usize,
    /// Address of the project, which every page of the site links to.
    #[arg(long, value_name = "URL", value_parser = web_address)]
    pub(crate) project: Option<String>,
    /// Makes the tables alone.
    #[arg(long)]
    pub(crate) no_site: bool,
    /// Writes nothing, and fails where the tables, or that of --page, differ from the results.
    #[arg(long)]
    pub(crate) check: bool,
}
