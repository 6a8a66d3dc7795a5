//! Binary `omnilife`: curates 360-degree video, reconstructs it, scores it, makes tables.
#![cfg_attr(not(test), warn(clippy::disallowed_methods))]

mod cli;
mod colour;
mod commands;
mod display;
mod doctor;
mod exit;
mod memory_exhausted;
mod plans;
mod preparation;
mod prerequisites;
mod progress;
mod run;
mod termination;
mod width;

use std::process::ExitCode;

use cli::{Cli, Command};
use progress::Terminal;

fn main() -> ExitCode {
    display::keep_drivers_quiet();
    omnilife_schemas::provenance::state_commit(env!("OMNILIFE_COMMIT"));
    exit::code_of(|| {
        let cli = Cli::of_arguments();
        let terminal = Terminal::new(cli.quiet, cli.progress);
        if !cli.is_worker() {
            termination::announce()?;
        }
        match cli.command {
            Command::Run(arguments) => run::main_job(&arguments, &terminal),
            Command::Curate(arguments) => commands::curate::execute(&arguments.command, &terminal),
            Command::Reconstruct(command) => commands::reconstruct::execute(&command, &terminal),
            Command::Bench(command) => commands::bench::execute(&command, &terminal),
            Command::Leaderboard(command) => commands::leaderboard::execute(&command, &terminal),
            Command::Sweep(command) => commands::sweep::execute(&command, &terminal),
            Command::Completions { shell } => commands::completions(shell),
            Command::Doctor { json } => commands::doctor(json),
        }
    })
}
