//! `omnilife reconstruct`.

use std::path::PathBuf;

use clap::{Args, Subcommand};
use omnilife_reconstruct::methods::{METHODS, MethodRequest};

use crate::exit::BadRequest;

#[derive(Debug, Args)]
pub(crate) struct MethodArguments {
    /// Reconstruction method.
    #[arg(long, default_value = METHODS[0].id)]
    pub(crate) method: String,
    /// Ends training after this many seconds, whatever the iterations; schedules shrink to fit.
    #[arg(long, value_name = "SECONDS")]
    pub(crate) budget: Option<f64>,
    /// Seed of everything random.
    #[arg(long, default_value_t = 0)]
    pub(crate) seed: u64,
    /// Adds no Gaussians above this number [default: half the pixels of a view].
    #[arg(long)]
    pub(crate) max_gaussians: Option<u64>,
}

impl MethodArguments {
    /// What is asked of the method.
    ///
    /// # Errors
    /// When a number makes no sense.
    pub(crate) fn request(&self, iterations: u64) -> anyhow::Result<MethodRequest> {
        if iterations == 0 || self.max_gaussians == Some(0) {
            return Err(BadRequest("iterations and Gaussians are at least 1".to_owned()).into());
        }
        if self
            .budget
            .is_some_and(|budget| !(budget > 0.0 && budget.is_finite()))
        {
            return Err(BadRequest("a budget is a positive number of seconds".to_owned()).into());
        }
        Ok(MethodRequest {
            iterations,
            budget_seconds: self.budget,
            seed: self.seed,
            maximum_gaussians: self.max_gaussians,
        })
    }
}

#[derive(Debug, Subcommand)]
pub(crate) enum ReconstructCommand {
    /// Trains a method on a scene's input views and renders all views of the split.
    Train {
        /// The scene.json.
        scene: PathBuf,
        /// The split.json.
        #[arg(long)]
        split: PathBuf,
        /// Folder of the run.
        #[arg(long)]
        out: PathBuf,
        #[command(flatten)]
        method: MethodArguments,
        /// Optimizer steps; schedules scale with them.
        #[arg(long, default_value_t = 30_000)]
        iterations: u64,
    },
    /// Lists the methods.
    Methods,
}
