//! `method.toml`: description of a method and its commands.
//!
//! `docs/guides/external.md` has the format. The texts in braces are those of `placeholders.rs`.
#![cfg_attr(
    not(test),
    deny(clippy::indexing_slicing, clippy::arithmetic_side_effects)
)]

use std::{
    collections::BTreeMap,
    fs,
    path::Path,
    process,
    time::{Duration, SystemTime, UNIX_EPOCH},
};

use omnilife_schemas::{child::Container, records::PhaseName, store::StoreError};
use serde::Deserialize;

use super::placeholders::{self, Places};
use crate::error::BenchError;

/// A `method.toml`, checked.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Manifest {
    /// Its name in the tables: lower-case letters, digits, `-`, `_` and `.`.
    pub id: String,
    /// Address of its code.
    pub source: Option<String>,
    /// Its licence.
    pub licence: Option<String>,
    /// Notes for readers: conventions, resolution, conversion of its views.
    pub notes: Option<String>,
    /// Limit of each command, seconds; positive.
    pub time_limit_seconds: Option<f64>,
    /// Environment of its commands.
    #[serde(default)]
    pub environment: Environment,
    prepare: Option<Command>,
    train: Option<Command>,
    render: Command,
    /// Places of its views.
    pub predictions: PredictionFiles,
}

#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
struct Command {
    command: Vec<String>,
}

/// Patterns of the files that hold a method's views.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PredictionFiles {
    /// Pattern of a novel view.
    pub novel: String,
    /// Pattern of an input view, if the method renders them.
    pub input: Option<String>,
    /// Cell of the view in its image, if that is a grid.
    pub cell: Option<Cell>,
}

/// Cell of a grid of equal cells.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Cell {
    /// Number of columns.
    pub columns: u32,
    /// Number of rows.
    #[serde(default = "one")]
    pub rows: u32,
    /// Column of the view, from 0.
    pub column: u32,
    /// Row of the view, from 0.
    #[serde(default)]
    pub row: u32,
    /// Pixels between cells, and around the grid.
    #[serde(default)]
    pub gap: u32,
}

fn one() -> u32 {
    1
}

/// Environment of a method's commands.
#[derive(Debug, Clone, PartialEq, Default, Deserialize)]
#[serde(tag = "kind", rename_all = "kebab-case", deny_unknown_fields)]
pub enum Environment {
    /// No special environment.
    #[default]
    Plain,
    /// A Python virtual environment.
    Venv {
        /// Its folder.
        path: String,
    },
    /// A conda environment, through `conda run`.
    Conda {
        /// Its name.
        name: String,
    },
    /// A container that sees the scene, the split and the manifest's folder for reading and the work folder for
    /// writing, under their own paths. It is run with `--rm`, `--init` and a `--name` of its own, unless the options
    /// have one. If its command fails or is ended, `kill` and that name end the container.
    Container {
        /// The image.
        image: String,
        /// `docker` or a program with the same options.
        #[serde(default = "docker")]
        runtime: String,
        /// Further options, such as those for GPUs.
        #[serde(default)]
        options: Vec<String>,
    },
}

fn docker() -> String {
    "docker".to_owned()
}

impl Manifest {
    /// Reads and checks a `method.toml`.
    ///
    /// # Errors
    /// When it cannot be read, is not TOML, has an unknown entry or placeholder, or a pattern cannot tell two views
    /// apart.
    pub fn read(path: &Path) -> Result<Self, BenchError> {
        let bytes = fs::read(path).map_err(|source| StoreError::read(path, source))?;
        Self::from_bytes(path, &bytes)
    }

    /// Reads and checks the bytes of a file; `path` names it.
    ///
    /// # Errors
    /// Those of [`Manifest::read`].
    pub fn from_bytes(path: &Path, bytes: &[u8]) -> Result<Self, BenchError> {
        let text =
            std::str::from_utf8(bytes).map_err(|_| BenchError::mismatch(path, "is not UTF-8"))?;
        let manifest: Self = toml::from_str(text).map_err(|error| {
            let message = error.message().lines().next().unwrap_or("").to_owned();
            let line = error.span().and_then(|span| {
                Some(
                    text.get(..span.start)?
                        .matches('\n')
                        .count()
                        .saturating_add(1),
                )
            });
            let place = line.map_or(String::new(), |line| format!("line {line}: "));
            BenchError::mismatch(path, format!("{place}{message}"))
        })?;
        manifest
            .check()
            .map_err(|reason| BenchError::mismatch(path, reason))?;
        Ok(manifest)
    }

    fn check(&self) -> Result<(), String> {
        let good = |c: char| c.is_ascii_lowercase() || c.is_ascii_digit() || "-_.".contains(c);
        if self.id.is_empty() || !self.id.chars().all(good) || self.id.starts_with('.') {
            return Err(format!(
                "id {:?} is not lower-case letters, digits, -, _ and .",
                self.id
            ));
        }
        if let Some(limit) = self.time_limit_seconds
            && !(limit > 0.0 && limit < Duration::MAX.as_secs_f64())
        {
            return Err(format!("the time limit must be positive, got {limit} s"));
        }
        for (name, command) in self.phases() {
            if command.is_empty() {
                return Err(format!("the command of [{}] is empty", name.name()));
            }
            for word in command {
                placeholders::check_command(word)
                    .map_err(|reason| format!("[{}] {reason}", name.name()))?;
            }
        }
        if let Some(cell) = self.predictions.cell
            && (cell.column >= cell.columns || cell.row >= cell.rows)
        {
            return Err(format!(
                "[predictions.cell] column {} and row {} are outside of {} columns and {} rows",
                cell.column, cell.row, cell.columns, cell.rows
            ));
        }
        for pattern in [
            Some(&self.predictions.novel),
            self.predictions.input.as_ref(),
        ]
        .into_iter()
        .flatten()
        {
            placeholders::check_pattern(pattern)
                .map_err(|reason| format!("[predictions] {reason}"))?;
        }
        Ok(())
    }

    /// Returns its commands in order of execution.
    pub(super) fn phases(&self) -> impl Iterator<Item = (PhaseName, &Vec<String>)> {
        [
            (PhaseName::Prepare, self.prepare.as_ref()),
            (PhaseName::Train, self.train.as_ref()),
            (PhaseName::Render, Some(&self.render)),
        ]
        .into_iter()
        .filter_map(|(name, command)| Some((name, &command?.command)))
    }

    pub(super) fn time_limit(&self) -> Option<Duration> {
        self.time_limit_seconds.map(Duration::from_secs_f64)
    }
}

impl Environment {
    pub(super) fn describe(&self) -> String {
        match self {
            Self::Plain => "plain".to_owned(),
            Self::Venv { path } => format!("venv {path}"),
            Self::Conda { name } => format!("conda {name}"),
            Self::Container { image, runtime, .. } => format!("container {image} ({runtime})"),
        }
    }

    /// Returns the container for one command, if the environment has one: named by the user's options, or by a unique
    /// name.
    pub(super) fn container(&self) -> Option<Container> {
        let Self::Container {
            runtime, options, ..
        } = self
        else {
            return None;
        };
        let name = name_in(options).unwrap_or_else(|| {
            let now = SystemTime::now().duration_since(UNIX_EPOCH);
            let nanoseconds = now.unwrap_or_default().as_nanos();
            format!("omnilife-{}-{nanoseconds}", process::id())
        });
        Some(Container {
            runtime: runtime.clone(),
            name,
        })
    }

    /// Returns the command that runs `command` in this environment, and in this container.
    pub(super) fn wrap(
        &self,
        command: Vec<String>,
        places: &Places,
        container: Option<&Container>,
    ) -> Vec<String> {
        let mut words: Vec<String> = match self {
            Self::Plain | Self::Venv { .. } => Vec::new(),
            Self::Conda { name } => ["conda", "run", "--no-capture-output", "-n", name]
                .map(str::to_owned)
                .into(),
            Self::Container {
                image,
                runtime,
                options,
            } => {
                let work = places.work.display();
                // A process of its own that forwards signals, and reaps orphans.
                let mut words: Vec<String> = [runtime.as_str(), "run", "--rm", "--init"]
                    .map(str::to_owned)
                    .into();
                if let Some(container) = container.filter(|_| name_in(options).is_none()) {
                    words.extend(["--name".to_owned(), container.name.clone()]);
                }
                for readable in places.readable_folders() {
                    words.extend(["-v".to_owned(), format!("{0}:{0}:ro", readable.display())]);
                }
                words.extend(["-v".to_owned(), format!("{work}:{work}")]);
                words.extend(["-w".to_owned(), work.to_string()]);
                words.extend(options.iter().cloned());
                words.push(image.clone());
                words
            }
        };
        words.extend(command);
        words
    }

    /// Returns environment variables for the commands.
    pub(super) fn variables(&self) -> BTreeMap<String, String> {
        let Self::Venv { path } = self else {
            return BTreeMap::new();
        };
        // Only the program search needs the old value; one that is not Unicode is left out.
        let old = std::env::var("PATH").unwrap_or_default();
        BTreeMap::from([
            ("VIRTUAL_ENV".to_owned(), path.clone()),
            ("PATH".to_owned(), format!("{path}/bin:{old}")),
        ])
    }
}

/// Returns the container's name in the options of its runtime; the last one counts.
fn name_in(options: &[String]) -> Option<String> {
    let mut options = options.iter();
    let mut name = None;
    while let Some(option) = options.next() {
        if option == "--name" {
            name = options.next().cloned();
        } else if let Some(given) = option.strip_prefix("--name=") {
            name = Some(given.to_owned());
        }
    }
    name
}
