//! A table as data, from layouts to renderers.

use omnilife_schemas::{bootstrap::Confidence, records::Direction};

use crate::{
    class::MethodClass,
    format::{self, decimals},
    group::{Group, MethodRow},
    numbers::Numbers,
    quantity::Quantity,
};

pub(crate) struct Table {
    pub(crate) title: String,
    /// Leading columns of names, then columns of cells.
    pub(crate) names: Vec<String>,
    pub(crate) columns: Vec<Column>,
    /// Results under one protocol. Rows of one class stand together, best first if the title says so.
    pub(crate) rows: Vec<Row>,
    /// Figures of papers: apart from the measured rows and never ranked with them.
    pub(crate) published: Vec<PublishedBlock>,
    /// Lines below the measured rows.
    pub(crate) notes: Vec<String>,
}

#[derive(Debug, Clone)]
pub(crate) struct Column {
    /// Heading over several columns.
    pub(crate) group: Option<String>,
    pub(crate) name: String,
    /// Direction of better values, if the column has its own.
    pub(crate) direction: Option<Direction>,
    pub(crate) holds: ColumnContent,
    /// Reason for missing values, if more is known than that they were not measured.
    pub(crate) missing: Option<String>,
}

/// Content of a column, by which published columns find their place.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) enum ColumnContent {
    /// A metric; the id `lpips` is the published one of unknown variant.
    Score(Quantity),
    /// A place's scores; the row states the metric.
    Place(String),
    /// The mean over places.
    Average,
    /// Anything else.
    Other,
}

#[derive(Default)]
pub(crate) struct Row {
    /// One per entry of [`Table::names`].
    pub(crate) names: Vec<String>,
    /// One per entry of [`Table::columns`].
    pub(crate) cells: Vec<Cell>,
    /// The class of its heading, if the table is by class.
    pub(crate) class: Option<MethodClass>,
    /// Views that could not be scored.
    pub(crate) failures: usize,
    /// Behind its last name.
    pub(crate) marks: Vec<Mark>,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Mark {
    Incomplete,
    OtherBudget,
    Partial,
    Suspect,
}

/// Mark of a number stated by authors.
pub(crate) const STATED_MARK: &str = "§";

impl Mark {
    /// Returns the marks of a row with these numbers, except its budget.
    pub(crate) fn of(numbers: &Numbers) -> Vec<Self> {
        let marks = [
            numbers.suspect.then_some(Self::Suspect),
            (!numbers.complete).then_some(Self::Incomplete),
            numbers.partial.then_some(Self::Partial),
        ];
        marks.into_iter().flatten().collect()
    }

    pub(crate) fn symbol(self) -> &'static str {
        match self {
            Self::Incomplete => "†",
            Self::OtherBudget => "‡",
            Self::Partial => "‖",
            Self::Suspect => "¶",
        }
    }

    /// Returns its meaning for a row.
    pub(crate) fn meaning(self) -> &'static str {
        match self {
            Self::Incomplete => "The run failed or some views could not be scored",
            Self::OtherBudget => "Trained for other iterations than is usual in its class",
            Self::Partial => "Metrics of the protocol were left out for a quick look",
            Self::Suspect => "Its scores speak for another convention, as a warning says",
        }
    }
}

/// Rows of a published table.
pub(crate) struct PublishedBlock {
    /// Paper and table.
    pub(crate) source: String,
    pub(crate) rows: Vec<Row>,
    pub(crate) notes: Vec<String>,
}

impl PublishedBlock {
    /// Returns the columns of the measured table in which it has any value.
    pub(crate) fn columns(&self) -> Vec<usize> {
        let count = self.rows.first().map_or(0, |row| row.cells.len());
        let has_any = |&at: &usize| self.rows.iter().any(|row| row.cells[at] != Cell::Missing);
        (0..count).filter(has_any).collect()
    }
}

#[derive(Debug, Clone, PartialEq)]
pub(crate) enum Cell {
    /// Not measured.
    Missing,
    /// Does not apply.
    Blank,
    Score(Score),
    /// A number without a ranking.
    Number {
        value: f64,
        decimals: usize,
        /// Its unit or mark, with the space before it.
        remark: String,
    },
    Rank {
        rank: usize,
        /// Ranked methods of the class.
        of: usize,
        interval: Option<[usize; 2]>,
    },
    Text(String),
}

#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Score {
    pub(crate) value: f64,
    /// Digits after the point.
    pub(crate) decimals: usize,
    /// 95 % interval.
    pub(crate) interval: Option<[f64; 2]>,
    pub(crate) standing: ScoreRank,
}

/// A score's standing among its rivals.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(crate) enum ScoreRank {
    Best,
    Second,
    #[default]
    Other,
}

impl Cell {
    pub(crate) fn number(value: Option<f64>, decimals: usize) -> Self {
        value.map_or(Self::Missing, |value| Self::Number {
            value,
            decimals,
            remark: String::new(),
        })
    }

    /// Returns the mean of a field of results, with the clock of a training time and the mark of a
    /// stated number.
    fn cost(numbers: &Numbers, field: &str, value: Option<f64>, decimals: usize) -> Self {
        let mut remark = String::new();
        if let Some(clocks) = numbers.clocks().filter(|_| field == "training_seconds") {
            remark.push(' ');
            remark.push_str(&clocks);
        }
        if numbers.stated.contains(field) {
            remark.push(' ');
            remark.push_str(STATED_MARK);
        }
        value.map_or(Self::Missing, |value| Self::Number {
            value,
            decimals,
            remark,
        })
    }

    /// Returns the number of views that could not be scored, or the failure of a run.
    pub(crate) fn failures(numbers: &Numbers) -> Self {
        if numbers.failed {
            Self::Text("failed".to_owned())
        } else {
            Self::count(numbers.failures)
        }
    }

    pub(crate) fn count(value: usize) -> Self {
        Self::number(Some(value as f64), 0)
    }

    pub(crate) fn score(value: Option<f64>, metric: &str, interval: Option<[f64; 2]>) -> Self {
        value.map_or(Self::Missing, |value| {
            Self::Score(Score {
                value,
                decimals: decimals(metric),
                interval,
                standing: ScoreRank::Other,
            })
        })
    }

    /// Returns the cell without emphasis, for people.
    pub(crate) fn plain(&self) -> String {
        match self {
            Self::Missing => "–".to_owned(),
            Self::Blank => String::new(),
            Self::Score(score) => score.value(),
            Self::Number {
                value,
                decimals: 0,
                remark,
            } => format::grouped(*value) + remark,
            Self::Number {
                value,
                decimals,
                remark,
            } => format!("{value:.decimals$}{remark}"),
            Self::Rank { rank, of, interval } => match interval {
                Some([low, high]) if low != high => format!("{rank} of {of} [{low}–{high}]"),
                _ => format!("{rank} of {of}"),
            },
            Self::Text(text) => text.clone(),
        }
    }
}

impl Score {
    /// Returns the score without its interval.
    pub(crate) fn value(&self) -> String {
        let digits = self.decimals;
        format!("{:.digits$}", self.value)
    }

    /// Returns the score's interval: ` [24.1, 25.9]`, or nothing.
    pub(crate) fn interval(&self) -> String {
        let digits = self.decimals;
        self.interval.map_or_else(String::new, |[low, high]| {
            format!(" [{low:.digits$}, {high:.digits$}]")
        })
    }
}

impl Table {
    /// Returns the measured rows class by class.
    pub(crate) fn blocks(&self) -> impl Iterator<Item = &[Row]> {
        self.rows.chunk_by(|a, b| a.class == b.class)
    }

    /// Returns the table with some of its columns.
    pub(crate) fn with_columns(mut self, keep: impl Fn(&Column) -> bool) -> Self {
        let kept: Vec<bool> = self.columns.iter().map(keep).collect();
        let blocks = self.published.iter_mut().flat_map(|block| &mut block.rows);
        for row in self.rows.iter_mut().chain(blocks) {
            let mut stays = kept.iter();
            row.cells
                .retain(|_| stays.next().is_some_and(|&stays| stays));
        }
        let mut stays = kept.iter();
        self.columns
            .retain(|_| stays.next().is_some_and(|&stays| stays));
        self
    }
}

impl Column {
    pub(crate) fn of_score(group: &Group<'_>, index: usize, with_kind: bool) -> Self {
        let (quantity, direction) = &group.quantities[index];
        Self {
            group: with_kind.then(|| format::kind_title(quantity.kind)),
            name: format::metric_title(&quantity.metric),
            direction: Some(*direction),
            holds: ColumnContent::Score(quantity.clone()),
            missing: group
                .why_unavailable(quantity.kind, &quantity.metric)
                .map(str::to_owned),
        }
    }

    pub(crate) fn plain(name: &str) -> Self {
        Self {
            group: None,
            name: name.to_owned(),
            direction: None,
            holds: ColumnContent::Other,
            missing: None,
        }
    }

    /// Returns the whole heading on one line, with an arrow to the better values.
    pub(crate) fn heading(&self) -> String {
        let arrow = self.direction.map(format::arrow);
        [self.group.as_deref(), Some(self.name.as_str()), arrow]
            .into_iter()
            .flatten()
            .collect::<Vec<_>>()
            .join(" ")
    }
}

/// Returns columns of cost at the end of every table of methods.
pub(crate) fn cost_columns() -> Vec<Column> {
    ["Training (s)", "Memory (GB)", "Primitives", "Iterations"]
        .map(|name| Column {
            missing: Some("not in the records of the run".to_owned()),
            ..Column::plain(name)
        })
        .to_vec()
}

pub(crate) fn cost_cells(numbers: &Numbers) -> [Cell; 4] {
    let gigabytes = numbers.peak_memory_bytes.map(|bytes| bytes / 1e9);
    let seconds = numbers.training_seconds;
    [
        Cell::cost(numbers, "training_seconds", seconds, 1),
        Cell::cost(numbers, "peak_memory_bytes", gigabytes, 2),
        Cell::cost(numbers, "primitives", numbers.primitives, 0),
        Cell::cost(numbers, "iterations", numbers.iterations, 0),
    ]
}

/// Returns a method's mean of one quantity with its interval.
pub(crate) fn method_score(group: &Group<'_>, method: &MethodRow<'_>, index: usize) -> Cell {
    let Confidence { mean, .. } = method.confidence[index];
    let metric = &group.quantities[index].0.metric;
    Cell::score(method.numbers.scores[index], metric, mean)
}

/// Returns a method's rank by one quantity.
pub(crate) fn method_rank(method: &MethodRow<'_>, index: usize) -> Cell {
    let confidence = method.confidence[index];
    match confidence.rank {
        Some(rank) => Cell::Rank {
            rank,
            of: method.ranked[index],
            interval: confidence.rank_interval,
        },
        None => Cell::Missing,
    }
}

/// Marks the best and the second best of each column among the rows of one contest.
///
/// Scores are compared as printed: equal prints are equally good. A best needs two rivals, a second best three. Rows
/// without a contest are skipped.
pub(crate) fn mark_standings<'a>(
    rows: impl Iterator<Item = (&'a mut Row, bool)>,
    directions: &[Option<Direction>],
) {
    let mut rows: Vec<&mut Row> = rows
        .filter_map(|(row, competes)| competes.then_some(row))
        .collect();
    for (column, direction) in directions.iter().enumerate() {
        let Some(direction) = *direction else {
            continue;
        };
        let mut rivals: Vec<&mut Score> = rows
            .iter_mut()
            .filter_map(|row| match &mut row.cells[column] {
                Cell::Score(score) => Some(score),
                _ => None,
            })
            .collect();
        let best = leader(&rivals, direction, None);
        let second = best.and_then(|best| leader(&rivals, direction, Some(best)));
        let count = rivals.len();
        for rival in &mut rivals {
            let printed = Some(as_printed(rival));
            rival.standing = match () {
                () if count >= 2 && printed == best => ScoreRank::Best,
                () if count >= 3 && printed == second => ScoreRank::Second,
                () => ScoreRank::Other,
            };
        }
    }
}

/// Returns the best printed value except one.
fn leader(rivals: &[&mut Score], direction: Direction, but: Option<f64>) -> Option<f64> {
    rivals
        .iter()
        .map(|rival| as_printed(rival))
        .filter(|&value| Some(value) != but)
        .reduce(|best, value| {
            if direction.prefers(value, best) {
                value
            } else {
                best
            }
        })
}

/// Returns the value rounded as printed.
fn as_printed(score: &Score) -> f64 {
    let scale = 10_f64.powi(score.decimals as i32);
    (score.value * scale).round() / scale
}
