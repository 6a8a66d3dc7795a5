//! Units of a sweep: their commands, inputs and outputs.

pub(crate) mod ablation;
pub(crate) mod benchmark;
pub(crate) mod curation;
pub(crate) mod left_out;
pub(crate) mod lines;

use std::path::{Path, PathBuf};

use anyhow::Context;
use clap::Parser;
use omnilife_bench::lpips::Backbone;
use omnilife_reconstruct::jobs::reconstruct;
use omnilife_schemas::records::UnitNeeds;

use crate::{
    cli::{Cli, Command, PlanArguments, ReconstructCommand},
    exit::BadRequest,
};

/// Returns the requested resources of every unit of a plan.
fn needs(arguments: &PlanArguments) -> anyhow::Result<UnitNeeds> {
    Ok(UnitNeeds {
        cores: arguments.unit_cores,
        memory_bytes: arguments.unit_memory,
        gpus: arguments.unit_gpus,
        limit_seconds: arguments.unit_limit,
    })
}

/// Returns a path that is valid for commands in any folder.
fn absolute(path: &Path) -> anyhow::Result<PathBuf> {
    std::path::absolute(path).with_context(|| format!("{}: cannot be located", path.display()))
}

/// Returns the installed weights of the networks that score views: a result without LPIPS is stale once they are there.
///
/// # Errors
/// When a path is not UTF-8.
pub(crate) fn scoring_networks() -> anyhow::Result<Vec<String>> {
    let installed = Backbone::ALL
        .into_iter()
        .filter_map(|backbone| backbone.published_weights().ok());
    installed.map(|weights| argument(weights.path())).collect()
}

/// Returns a path as an argument of a command.
///
/// # Errors
/// When it is not UTF-8, which a plan cannot hold.
fn argument(path: &Path) -> anyhow::Result<String> {
    let text = path.to_str().map(str::to_owned);
    text.ok_or_else(|| BadRequest(format!("{}: is not UTF-8", path.display())).into())
}

/// Returns the words of a command of this program after parsing them: a faulty command must not be found out by a
/// thousand units.
fn own_command(words: Vec<String>) -> anyhow::Result<Vec<String>> {
    let mut command = vec!["omnilife".to_owned()];
    command.extend(words);
    match Cli::try_parse_from(&command) {
        Ok(cli) => {
            refuse_training(&cli.command)?;
            Ok(command)
        }
        Err(error) => {
            let message = error.to_string();
            let line = message.lines().next().unwrap_or_default();
            let line = line.strip_prefix("error: ").unwrap_or(line);
            Err(BadRequest(format!("{}: {line}", command[1..3].join(" "))).into())
        }
    }
}

/// Refuses a training whose method does not have the requested options, components or backend.
fn refuse_training(command: &Command) -> anyhow::Result<()> {
    if let Command::Reconstruct(ReconstructCommand::Train {
        method, iterations, ..
    }) = command
    {
        let settings = method.request(*iterations)?;
        reconstruct::check(&method.method, &settings, method.backend.into())?;
    }
    Ok(())
}

/// Returns the command that scores the run of a record into `out`. Views that fail are rows of its result, not a
/// failure of the unit.
///
/// # Errors
/// When a path is not UTF-8.
fn scoring(scene: &str, split: &str, record: &Path, out: &Path) -> anyhow::Result<Vec<String>> {
    let (record, out) = (argument(record)?, argument(out)?);
    let places = [
        "--scene", scene, "--split", split, "--run", &record, "--out", &out,
    ];
    let command = [&["bench", "score"], &places[..], &["--accept-failures"]].concat();
    own_command(words(&command))
}

/// Returns the option of a training that shows itself in TensorBoard.
///
/// # Errors
/// When the folder is not UTF-8.
fn tensorboard(folder: &Path) -> anyhow::Result<[String; 2]> {
    Ok(["--tensorboard".to_owned(), argument(&absolute(folder)?)?])
}

/// Returns words as a command holds them.
fn words(list: &[&str]) -> Vec<String> {
    list.iter().map(|&word| word.to_owned()).collect()
}
