//! `omnilife reconstruct`.

use omnilife_reconstruct::{
    job::{self, ReconstructRequest},
    methods::METHODS,
};
use omnilife_schemas::progress::Progress;

use crate::{cli::ReconstructCommand, exit};

pub(crate) fn execute(command: &ReconstructCommand, progress: &dyn Progress) -> anyhow::Result<()> {
    match command {
        ReconstructCommand::Train {
            scene,
            split,
            out,
            method,
            iterations,
        } => {
            let record = job::reconstruct(
                &ReconstructRequest {
                    scene: scene.clone(),
                    split: split.clone(),
                    method: method.method.clone(),
                    settings: method.request(*iterations)?,
                    out: out.clone(),
                },
                progress,
            )?;
            exit::print(&format!(
                "{} on {}: {} iterations, {} Gaussians, trained in {:.1} s; {}\n",
                record.method,
                record.scene,
                record.iterations,
                record.gaussians,
                record.training_seconds,
                out.join(job::RUN_FILE).display()
            ))
        }
        ReconstructCommand::Methods => {
            let lines: String = METHODS
                .iter()
                .map(|method| {
                    format!(
                        "{}\n  {}\n  {}\n  {}\n",
                        method.id, method.title, method.source, method.description
                    )
                })
                .collect();
            exit::print(&lines)
        }
    }
}
