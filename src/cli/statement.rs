//! Options that state facts about a run which no record has measured.

use std::path::PathBuf;

use clap::{Args, ValueEnum};
use omnilife_bench::Statement;
use omnilife_leaderboard::submission::read_card;
use omnilife_schemas::records::{MethodCard, StatedClock, TrainingKind};

use super::numbers;
use crate::exit::BadRequest;

#[derive(Debug, Clone, Copy, ValueEnum)]
pub(crate) enum ClassArgument {
    PerScene,
    WithoutTraining,
}

impl From<ClassArgument> for TrainingKind {
    fn from(argument: ClassArgument) -> Self {
        match argument {
            ClassArgument::PerScene => Self::PerScene,
            ClassArgument::WithoutTraining => Self::WithoutTraining,
        }
    }
}

#[derive(Debug, Clone, Copy, ValueEnum)]
pub(crate) enum StatedClockArgument {
    Wall,
    Cpu,
    Gpu,
}

impl From<StatedClockArgument> for StatedClock {
    fn from(argument: StatedClockArgument) -> Self {
        match argument {
            StatedClockArgument::Wall => Self::Wall,
            StatedClockArgument::Cpu => Self::Cpu,
            StatedClockArgument::Gpu => Self::Gpu,
        }
    }
}

#[derive(Debug, Clone, Args)]
#[command(next_help_heading = "Facts that are stated, where no record of the run has them")]
pub(crate) struct StatementArguments {
    /// Takes name, class, iterations, hardware and code from the card of the method (TOML), the one that
    /// `leaderboard submit` packs; options beside it win.
    #[arg(long, value_name = "CARD")]
    about: Option<PathBuf>,
    /// Ranks the method among those that train on each scene, or among those that do not.
    #[arg(long, value_enum)]
    class: Option<ClassArgument>,
    /// Training time of this scene: the tables mark it as stated.
    #[arg(long, value_name = "SECONDS", value_parser = numbers::not_negative)]
    training_seconds: Option<f64>,
    /// Clock of --training-seconds [default: wall].
    #[arg(long, value_enum, requires = "training_seconds")]
    clock: Option<StatedClockArgument>,
    /// Number of optimizer steps on this scene.
    #[arg(long, value_name = "N", value_parser = numbers::whole::<u64>)]
    iterations: Option<u64>,
    /// Number of Gaussians, or of other primitives of the model.
    #[arg(long, value_name = "N", value_parser = numbers::whole::<u64>)]
    primitives: Option<u64>,
    /// Random seed of the run: results that differ by it alone are repetitions.
    #[arg(long, value_name = "SEED", value_parser = numbers::whole::<u64>)]
    seed: Option<u64>,
    /// Processors, GPUs and memory that it ran on.
    #[arg(long, value_name = "TEXT")]
    hardware: Option<String>,
    /// Address of the method's code.
    #[arg(long, value_name = "URL")]
    code: Option<String>,
}

impl StatementArguments {
    /// The statement, and the method's name where a card has it.
    ///
    /// # Errors
    /// When the card cannot be read, or is of another method than `method`.
    pub(crate) fn read(&self, method: Option<&str>) -> anyhow::Result<(Statement, Option<String>)> {
        let card: Option<MethodCard> = self.about.as_deref().map(read_card).transpose()?;
        if let (Some(card), Some(method), Some(file)) = (&card, method, &self.about)
            && card.method != method
        {
            return Err(BadRequest(format!(
                "{}: is the card of method {}, not of {method}",
                file.display(),
                card.method
            ))
            .into());
        }
        let of_card = card.as_ref();
        let statement = Statement {
            training: (self.class.map(TrainingKind::from))
                .or_else(|| of_card.and_then(|card| card.training)),
            training_seconds: self.training_seconds,
            clock: self.clock.map(StatedClock::from),
            iterations: self
                .iterations
                .or_else(|| of_card.and_then(|card| card.iterations)),
            primitives: self.primitives,
            seed: self.seed,
            hardware: (self.hardware.clone()).or_else(|| of_card.map(|card| card.hardware.clone())),
            code: (self.code.clone()).or_else(|| of_card.and_then(|card| card.code.clone())),
        };
        Ok((statement, card.map(|card| card.method)))
    }
}
