//! The tables and their columns. A new column is one entry here: files, queries and the documentation walk these lists.

use crate::rows::{Loaded, Row, SideFile, ValueOf, View};

/// A table.
#[derive(Debug, Clone, Copy)]
pub struct Table {
    /// Name on the command line, and of its file without `.parquet`.
    pub name: &'static str,
    /// One line: the meaning of a row.
    pub about: &'static str,
    /// Columns after the common ones, [`COMMON`].
    pub own: &'static [Column],
    /// Columns that a query always groups by.
    pub(crate) always: &'static [&'static str],
    /// True if every result should have its source file.
    pub of_every_result: bool,
    /// File that is read beside every result.
    pub(crate) beside: SideFile,
    /// Calls back with every row of a result.
    pub(crate) rows: for<'a> fn(&'a Loaded<'a>, &mut dyn FnMut(Row<'a>)),
}

/// A column.
#[derive(Debug, Clone, Copy)]
pub struct Column {
    /// Name in the file; queries may write `-` for `_`.
    pub name: &'static str,
    /// One line.
    pub about: &'static str,
    pub(crate) values: Getter,
}

/// Gives the value of a row; `None` if it has none.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Getter {
    Text(for<'a> fn(&Row<'a>) -> Option<&'a str>),
    Number(fn(&Row<'_>) -> Option<f64>),
    Count(fn(&Row<'_>) -> Option<i64>),
    Flag(fn(&Row<'_>) -> bool),
}

impl Getter {
    /// Returns the name of the kind of value.
    pub(crate) fn kind(&self) -> &'static str {
        match self {
            Self::Text(_) => "text",
            Self::Number(_) => "number",
            Self::Count(_) => "count",
            Self::Flag(_) => "true or false",
        }
    }
}

impl Column {
    const fn text(
        name: &'static str,
        about: &'static str,
        get: for<'a> fn(&Row<'a>) -> Option<&'a str>,
    ) -> Self {
        let values = Getter::Text(get);
        Self {
            name,
            about,
            values,
        }
    }

    const fn number(
        name: &'static str,
        about: &'static str,
        get: fn(&Row<'_>) -> Option<f64>,
    ) -> Self {
        let values = Getter::Number(get);
        Self {
            name,
            about,
            values,
        }
    }

    const fn count(
        name: &'static str,
        about: &'static str,
        get: fn(&Row<'_>) -> Option<i64>,
    ) -> Self {
        let values = Getter::Count(get);
        Self {
            name,
            about,
            values,
        }
    }

    const fn flag(name: &'static str, about: &'static str, get: fn(&Row<'_>) -> bool) -> Self {
        let values = Getter::Flag(get);
        Self {
            name,
            about,
            values,
        }
    }

    /// Returns the kind of its values in a word: text, number, count, or true or false.
    pub fn kind(&self) -> &'static str {
        self.values.kind()
    }
}

/// Means over the views of every result.
pub const RESULTS: Table = Table {
    name: "results",
    about: "one mean over the views of a result",
    own: OF_MEANS,
    always: &[],
    of_every_result: true,
    beside: SideFile::Nothing,
    rows: |loaded, each| loaded.means(each),
};

/// Scores of every view.
pub const VIEWS: Table = Table {
    name: "views",
    about: "one score of a view",
    own: OF_VIEWS,
    always: &[],
    of_every_result: true,
    beside: SideFile::Views,
    rows: |loaded, each| loaded.views(each),
};

/// Means over the views of every object.
pub const OBJECTS: Table = Table {
    name: "objects",
    about: "one mean over the views that show an object",
    own: OF_OBJECTS,
    always: &[],
    of_every_result: false,
    beside: SideFile::Nothing,
    rows: |loaded, each| loaded.objects(each),
};

/// Scores along trainings.
pub const CURVES: Table = Table {
    name: "curves",
    about: "one score at a row of a training's trace",
    own: OF_CURVES,
    always: &["iteration"],
    of_every_result: false,
    beside: SideFile::Curve,
    rows: |loaded, each| loaded.curve(each),
};

/// All tables.
pub const TABLES: [&Table; 4] = [&RESULTS, &VIEWS, &OBJECTS, &CURVES];

/// Returns the table of a name.
pub fn table(name: &str) -> Option<&'static Table> {
    TABLES.into_iter().find(|table| table.name == name)
}

impl Table {
    /// Returns the name of its file.
    pub fn file(&self) -> String {
        format!("{}.parquet", self.name)
    }

    /// Returns the usual name of its source file beside a result.
    pub fn source_file(&self) -> &'static str {
        self.beside.file()
    }

    /// Returns all of its columns.
    pub fn columns(&self) -> impl Iterator<Item = &'static Column> {
        COMMON.iter().chain(OF_DATASET).chain(self.own)
    }

    /// Returns the column of a name, in which `-` stands for `_`.
    pub(crate) fn column(&self, name: &str) -> Option<&'static Column> {
        let name = name.replace('-', "_");
        self.columns().find(|column| column.name == name)
    }
}

/// Columns of all tables.
pub const COMMON: &[Column] = &[
    Column::text("protocol", "Id and version of the protocol.", |row| {
        Some(&row.source.result.protocol)
    }),
    Column::text("protocol_hash", "SHA-256 of the protocol.", |row| {
        Some(&row.source.result.protocol_hash)
    }),
    Column::text("scene", "Id of the scene.", |row| {
        Some(&row.source.result.scene)
    }),
    Column::text(
        "video",
        "Id of the video that the scene was cut from.",
        |row| Some(row.source.video()),
    ),
    Column::text("method", "Id of the method.", |row| {
        Some(&row.source.result.method)
    }),
    Column::text(
        "training",
        "`per-scene` or `without-training`, where a record or a statement says.",
        |row| row.source.training(),
    ),
    Column::text("seed", "Random seed of the run.", |row| {
        row.source.seed.as_deref()
    }),
    Column::flag(
        "complete",
        "True where every view of the result was scored.",
        |row| row.source.result.is_complete(),
    ),
    Column::text("view", "`input` or `novel`.", |row| Some(row.view)),
    Column::text("region", "`whole`, `static` or `dynamic`.", |row| {
        Some(row.region)
    }),
    Column::text("metric", "Id of the metric, without its region.", |row| {
        Some(row.metric)
    }),
    Column::number("value", "The score.", |row| Some(row.value)),
];

/// Columns of all tables that come from a dataset, empty without one.
pub const OF_DATASET: &[Column] = &[
    Column::text(
        "category",
        "Category of the scene, from its annotation.",
        |row| row.source.facts?.category.as_deref(),
    ),
    Column::text("group", "Semantic group of the category.", |row| {
        row.source.facts?.group.as_deref()
    }),
    Column::text("action", "Action class of the scene.", |row| {
        row.source.facts?.action.as_deref()
    }),
    Column::text(
        "ego_motion",
        "Measured class of the camera's motion.",
        |row| row.source.facts?.ego_motion.as_deref(),
    ),
    Column::text(
        "dynamics",
        "Measured class of how much moves beside the camera.",
        |row| row.source.facts?.dynamics.as_deref(),
    ),
    Column::number("duration_seconds", "Length of the scene.", |row| {
        row.source.facts?.duration_seconds
    }),
];

const OF_MEANS: &[Column] = &[
    Column::number(
        "deviation",
        "Sample standard deviation over the views.",
        deviation,
    ),
    Column::count("views", "Views that have a value.", views),
    Column::number("training_seconds", "Training time.", |row| {
        row.source.result.training_seconds
    }),
    Column::number(
        "rendering_seconds",
        "Time to render all predictions.",
        |row| row.source.result.rendering_seconds,
    ),
    Column::count("peak_memory_bytes", "Highest resident memory.", |row| {
        count(row.source.result.peak_memory_bytes)
    }),
    Column::count("primitives", "Primitives of the model.", |row| {
        count(row.source.result.primitives)
    }),
    Column::count("iterations", "Iterations of the training.", |row| {
        count(row.source.result.iterations)
    }),
];

const OF_VIEWS: &[Column] = &[
    Column::count("frame", "Number of the frame in its scene.", |row| {
        Some(i64::from(view(row)?.frame))
    }),
    Column::number("time_seconds", "Time of the frame.", |row| {
        Some(view(row)?.time_seconds)
    }),
    Column::count(
        "third",
        "1 to 3: the third of the time from the first novel view to the last one, whatever views a method has beside them; empty where these have one time.",
        |row| view(row)?.third,
    ),
    Column::number(
        "distance_to_given",
        "World units from the camera to the nearest camera of an input view.",
        |row| view(row)?.distance_to_given,
    ),
];

const OF_OBJECTS: &[Column] = &[
    Column::text("object", "Name of the object.", |row| {
        Some(&row.object?.object)
    }),
    Column::text("class", "`vehicle`, `person` or `other`.", |row| {
        Some(row.object?.class.name())
    }),
    Column::number(
        "deviation",
        "Sample standard deviation over the views.",
        deviation,
    ),
    Column::count("views", "Views that have a value.", views),
];

const OF_CURVES: &[Column] = &[
    Column::count("iteration", "Iterations done.", |row| match row.of {
        ValueOf::Point(point) => count(Some(point.iteration)),
        _ => None,
    }),
    Column::number(
        "wall_seconds",
        "Wall-clock time of the training steps so far.",
        |row| match row.of {
            ValueOf::Point(point) => Some(point.seconds),
            _ => None,
        },
    ),
    Column::number(
        "cpu_seconds",
        "CPU time of the training steps so far.",
        |row| match row.of {
            ValueOf::Point(point) => point.cpu_seconds,
            _ => None,
        },
    ),
    Column::count("primitives", "Primitives of the model.", |row| {
        match row.of {
            ValueOf::Point(point) => count(point.primitives),
            _ => None,
        }
    }),
];

fn count(number: Option<u64>) -> Option<i64> {
    i64::try_from(number?).ok()
}

fn deviation(row: &Row<'_>) -> Option<f64> {
    match row.of {
        ValueOf::Views(summary) => summary.standard_deviation,
        _ => None,
    }
}

fn views(row: &Row<'_>) -> Option<i64> {
    match row.of {
        ValueOf::Views(summary) => Some(i64::from(summary.views)),
        _ => None,
    }
}

fn view(row: &Row<'_>) -> Option<View> {
    match row.of {
        ValueOf::View(view) => Some(view),
        _ => None,
    }
}
